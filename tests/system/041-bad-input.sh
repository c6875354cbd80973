#!/bin/bash
# What is wrong with configuration, rig, sources and endpoints is said with its place, and exit 1.
name=041
. "$(dirname "$0")/lib.sh"
refused() { # text that must be in the message; configuration on standard input
    local text=$1 got
    cat > "$dir/bad.yaml"
    timeout "$patience" "$pyrovoxd" --config "$dir/bad.yaml" ${2:+$2} > "$dir/out" 2>&1
    got=$?
    [ $got = 1 ] && grep -qF -- "$text" "$dir/out" || { echo "  exit $got: $(cat "$dir/out")"; return 1; }
}
rig=$PWD/tests/data/rig4.yaml
check no-file bash -c "! '$pyrovoxd' --config '$dir/none.yaml' 2>'$dir/out' && grep -q none.yaml '$dir/out'"
check unknown-key refused "bad.yaml:2: fsp: unknown key" <<< $'rig: x\nfsp: 20'
check wrong-value refused "bad.yaml:1: fps: 'x' is not a finite number" <<< 'fps: x'
check duplicate-key refused "given twice" <<< $'fps: 20\nfps: 20'
check not-yaml refused "not valid YAML" <<< 'rig: ['
check no-rig refused "rig: not given" <<< 'cameras: "sim:"'
check no-cameras refused "cameras: none given" <<< "rig: $rig"
check rig-missing refused "nowhere.yaml" <<< $'rig: nowhere.yaml\ncameras: "sim:"'
check unknown-camera refused "cameras.cam9" <<< "{rig: $rig, cameras: {cam9: \"sim:\"}}"
check unknown-source refused "cam0" <<< "{rig: $rig, cameras: \"magic:1\", control: {endpoint: \"$control\"}}"
check unknown-source-in-check refused "magic:1" --check-config <<< "{rig: $rig, cameras: \"magic:1\"}"
check unquoted-source refused 'needs quotes, as "sim:"' <<< $'rig: x\ncameras: sim:'
check too-few-cameras refused "sync.min_cameras: 9, but there are not so many" --check-config <<< "{rig: $rig, cameras: \"sim:\", sync: {min_cameras: 9}}"
check one-camera refused "hull.min_views: 2, but there is only one camera: set it to 1" --check-config <<< "{rig: $rig, cameras: {cam0: \"sim:\"}, sync: {min_cameras: 1}}"
check wide-tolerance refused "sync.tolerance_ms: 30 is not below half a period" --check-config <<< "{rig: $rig, cameras: \"sim:\", fps: 30, sync: {tolerance_ms: 30}}"
check camera-twice refused "cameras.cam1: 'aravis:127.0.0.2' is cam0 already" --check-config <<< "{rig: $rig, cameras: {cam0: \"aravis:127.0.0.2\", cam1: \"aravis:127.0.0.2\"}}"
check bad-address-in-check refused "action.addresses: '1.2.3'" --check-config <<< "{rig: $rig, cameras: \"sim:\", action: {addresses: [\"1.2.3\"]}}"
check bad-binning-in-check refused "binning 7 does not divide" --check-config <<< "{rig: $rig, cameras: \"sim:\", binning: 7}"
sed 's/  - name: cam1/  - nome: cam1/' "$rig" > "$dir/rig.yaml"
check broken-rig refused "rig.yaml:$(grep -n nome "$dir/rig.yaml" | cut -d: -f1)" <<< "{rig: rig.yaml, cameras: \"sim:\"}"
awk '/^    t: /{gsub(/[][,]/, " "); $0 = "    t: [" 1e3 * $2 ", " 1e3 * $3 ", " 1e3 * $4 "]"} 1' "$rig" > "$dir/mm.yaml"
check blind-rig refused "mm.yaml: no camera sees the volume; 4 of 4 would see it if t is in millimetres" <<< "{rig: mm.yaml, cameras: \"sim:\"}"
run "$pyrovox" matrix --rig "$dir/mm.yaml"
check blind-rig-has-no-matrix says 1 "would see it if t is in millimetres"
check bad-endpoint refused "not an endpoint" <<< "{rig: $rig, cameras: \"sim:\", control: {endpoint: \"$control\"}, publish: {endpoints: [\"nonsense\"]}}"
open() { refused "$1" --check-config <<< "{rig: $rig, cameras: \"sim:\", $2}"; }
check open-volumes open "publish.endpoints: tcp://*:5555 lets everybody in" "publish: {endpoints: [\"ipc:///tmp/x\", \"tcp://*:5555\"]}"
check open-control open "control.endpoint: on tcp://127.0.0.1:5556 everybody could stop" "control: {endpoint: \"tcp://127.0.0.1:5556\"}"
check open-if-told bash -c "'$pyrovoxd' --check-config --config <(echo '{rig: $rig, cameras: \"sim:\", insecure: true, control: {endpoint: \"tcp://127.0.0.1:5556\"}}') | grep -q ': ok: '"
check wrong-usage bash -c "'$pyrovoxd' --nonsense 2>/dev/null; [ \$? = 2 ]"
check good-file bash -c "'$pyrovoxd' --config daemon/config/pyrovoxd.example.yaml --print-config | grep -q '^fps: 20'"

# what may never end is not opened; a pipe that the shell hands over is read
mkfifo -m 600 "$dir/pipe" "$dir/pipe.png" "$dir/pipe.npy" "$dir/pipe.h5"
with() { # photometry of cam0
    sed "0,/^    t: /s|^    t: |    photometry: { $1 }\n&|" "$rig" > "$dir/with.yaml"
    echo "{rig: with.yaml, cameras: \"sim:\", publish: {endpoints: [\"$volumes\"]}, control: {endpoint: \"$control\"}}"
}
run "$pyrovoxd" --check-config --config "$dir/pipe"
check pipe-as-configuration says 1 "pipe: is a named pipe, which may never end"
check pipe-as-rig refused "pipe: is a named pipe" <<< '{rig: pipe, cameras: "sim:"}'
check device-as-rig refused "/dev/zero: is a device" <<< '{rig: /dev/zero, cameras: "sim:"}'
check pipe-as-mask refused "cam0: mask: $dir/pipe.png: is a named pipe" < <(with 'mask: pipe.png')
check pipe-as-dark refused "cam0: $dir/pipe.npy: is a named pipe" < <(with "dark: {file: pipe.npy, hash: '0123456789abcdef'}")
check pipe-as-keys refused "pipe: is a named pipe" <<< "{rig: $rig, cameras: \"sim:\", keys: {server: pipe, clients: pipe}, publish: {endpoints: [\"tcp://*:5599\"]}, control: {endpoint: \"$control\"}}"
run "$pyrovox" status --endpoint "$control" --key "$dir/pipe" --timeout 1
check pipe-as-key says 1 "pipe: is a named pipe"
run "$pyrovox" replay --info "$dir/pipe.h5"
check pipe-as-take says 1 "pipe.h5"
run "$pyrovox" matrix --rig <(cat "$rig")
check rig-from-the-shell says 0 "24 x 24 x 24"
run "$pyrovox" matrix --rig /dev/stdin < <(cat "$rig")
check rig-from-standard-input says 0 "24 x 24 x 24"

if "$py" -c 'import zmq' 2>/dev/null; then
    start port.log "$py" -c 'import sys, time, zmq
s = zmq.Context().socket(zmq.PUB); print(s.bind_to_random_port("tcp://127.0.0.1"), flush=True); time.sleep(3000)'
    wait_for test -s "$dir/port.log"
    check port-in-use refused "in use" <<< "{rig: $rig, cameras: \"sim:\", control: {endpoint: \"$control\"}, publish: {endpoints: [\"tcp://127.0.0.1:$(cat "$dir/port.log")\"]}}"
else
    echo "SKIP $name:port-in-use (no python3-zmq)"
fi
exit $rc
