#!/bin/bash
# Camera backends under the unit as it is, with all that it forbids: V4L2, libcamera, GigE Vision, files and takes; USB3 Vision
# needs a camera of metal.  What only systemd itself can show: journal, status, credentials, socket activation.
# vm-modprobe: vhci-hcd
# vm-modprobe: uvcvideo
# vm-memory: 2048
# vm-before: "$b/bin/pyrovox" simcams --cameras 4 --size 160x120 --voxels 24 --ring 1 --noise 0 --write-rig "$out/rig.yaml" --write-frames "$out/none"
# vm-before: "$b/bin/pyrovox" simcams --rig "$out/rig.yaml" --ring 3 --noise 0 --format mono8 --write-frames "$out/png"; "$b/tests/vm/vm_flame" "$out/png" "$out/mono8"
name=210
. "$(dirname "$0")/lib.sh"
systemd/install.sh "$b" "" /usr 2> /dev/null
systemd-sysusers pyrovoxd.conf pyrovox-view.conf && systemd-tmpfiles --create pyrovoxd.conf 2> /dev/null
check firmware-names-the-controller fake_firmware
udevd_start
check cameras-come uvc_start /out/mono8 4 --rate 5
# what Debian's rules of udev do
devices() { chgrp video /dev/video* /dev/media* && chmod 660 /dev/video* /dev/media*; }
check devices-are-for-the-group-video devices
for i in 2 3 4 5; do ip addr add 127.0.0.$i/8 dev lo; done
start simcams.log "$pyrovox" simcams --rig tests/data/rig4.yaml --ring 3 --fps 5 --noise 0 --format mono8
serving() { grep -q ^serving "$dir/simcams.log"; }
check gige-cameras-serve wait_for serving
systemd_start

says() { in_it "$pyrovox" status --json --endpoint "${@:2}" 2> /dev/null | "$py" -c 'import json, sys
try: s = json.load(sys.stdin)
except ValueError: sys.exit(1)
sys.exit(0 if eval(sys.argv[1]) else 1)' "$1" 2> /dev/null; }
journal() { in_it journalctl --no-pager -q -u pyrovoxd "$@"; }
settings() { # name, cameras, more lines
    if [ "$1" = aravis ]; then cp tests/data/rig4.yaml /etc/pyrovox/rig-aravis.yaml; else cp /out/rig.yaml "/etc/pyrovox/rig-$1.yaml"; fi
    cat > /etc/pyrovox/pyrovoxd.yaml << Y
rig: rig-$1.yaml
cameras: $2
fps: 5
pixel_format: Mono8
transfer: linear
photometry: {black: 0.02, threshold: 0.02}
solver: {deadline_ms: 0}
record: {volumes: npy, volumes_path: /var/lib/pyrovox/$1}
${3:-}
Y
}
backend() { # name, cameras, more lines, endpoint and options of control: the daemon starts by its unit, and makes volumes of sets that are whole
    settings "$@"
    [ $# -ge 4 ] || set -- "$1" "$2" "${3:-}" ipc:///run/pyrovox/control
    in_it systemctl restart pyrovoxd && wait_for says 's["sets"]["published"] >= 5 and all(c["counts"]["received"] >= 5 for c in s["cameras"])' "${@:4}" ||
        { journal -n 30; return 1; }
}
recorded() { [ "$(find /var/lib/pyrovox/"$1"-* -name '*.npy' | wc -l)" -ge 5 ]; }
real_time() { in_it ps -L -o cls= -p "$(in_it systemctl show -P MainPID pyrovoxd)" | grep -q RR; }
forbidden() { # what the unit has to keep from it, as the kernel says
    local p; p=/proc/$(in_it systemctl show -P MainPID pyrovoxd)/status
    in_it grep -qx 'NoNewPrivs:[[:space:]]1' "$p" && in_it grep -qx 'CapEff:[[:space:]]0*' "$p" && in_it grep -qx 'CapBnd:[[:space:]]0*' "$p" &&
        in_it grep -qx 'Seccomp:[[:space:]]2' "$p"
}
for c in 0 1 2 3; do v4l2+=", cam$c: \"v4l2:usb-FLAME00$c\"" libcamera+=", cam$c: \"libcamera:VHCI-$((c + 1)):\""; done
check v4l2 backend v4l2 "{${v4l2#, }}"
check v4l2-in-real-time real_time
check holds-no-right forbidden
# a cable that is pulled and plugged: in the journal by its fields, in the unit's status, and the camera is used again
entry() { in_it journalctl --no-pager -q -o cat -u pyrovoxd PYROVOX_CAUSE=lost_camera PYROVOX_CAMERA=cam3 | grep -q "$1"; }
status_says() { in_it systemctl show -P StatusText pyrovoxd | grep -q "$1"; }
check unplug uvc_order unplug 3
check journal-has-cause-and-camera wait_for entry 'trying again'
check status-has-the-camera wait_for status_says 'not there: cam3 (1 of 4 cameras)'
check plug uvc_order plug 3
wait_for uvc_there 4 && devices
check camera-is-back wait_for entry 'frames come again'
check status-is-well wait_for eval '! status_says "not there"'
check libcamera backend libcamera "{${libcamera#, }}"
check aravis backend aravis '"aravis:127.0.0.2+"' 'gige: {frame_retention_ms: 500}'
check aravis-in-real-time real_time
packet_sockets() { tail -n +2 /proc/net/packet | grep -c .; }
check has-no-packet-sockets [ "$(packet_sockets)" = 0 ]
drop_in() { # its lines on standard input
    mkdir -p /etc/systemd/system/pyrovoxd.service.d && cat > /etc/systemd/system/pyrovoxd.service.d/override.conf && in_it systemctl daemon-reload
}
sed -n '/^    \[Service\]/,$s/^    //p' systemd/README.md | drop_in
check aravis-with-the-lines-of-the-manual backend aravis '"aravis:127.0.0.2+"' 'gige: {frame_retention_ms: 500}'
check has-packet-sockets [ "$(packet_sockets)" -ge 4 ]
drop_in < /dev/null
check files backend files '"files:/out/mono8/{name}/%06d.npy"' 'loop: true'
raw() { # a take of its frames, by the unit
    in_it "$pyrovox" record --raw start --control ipc:///run/pyrovox/control --out /var/lib/pyrovox/raw.h5 &&
        wait_for says 's["record"]["sets"] >= 10' ipc:///run/pyrovox/control && in_it "$pyrovox" record --raw stop --control ipc:///run/pyrovox/control
}
check take-is-made raw
check take backend take '"take:/var/lib/pyrovox/raw.h5"' 'loop: true'
for i in v4l2 libcamera aravis files take; do check $i-recorded recorded $i; done
# the key of a daemon that others reach lies encrypted on the disk
keep_key() {
    mkdir -p -m 700 /etc/credstore.encrypted && "$pyrovox" keygen "$dir/lab" > /dev/null && "$pyrovox" keygen "$dir/bert" --control --server "$dir/lab.pub" > /dev/null &&
        in_it systemd-creds encrypt --with-key=host --name=pyrovox.key "$dir/lab.key" /etc/credstore.encrypted/pyrovox.key && mv "$dir/lab.key" /etc/pyrovox/ &&
        cp "$dir/bert.pub" /etc/pyrovox/clients.keys && ! grep -q secret /etc/credstore.encrypted/pyrovox.key
}
check key-is-encrypted keep_key
keyed() {
    backend keyed '"files:/out/mono8/{name}/%06d.npy"' 'loop: true
control: {endpoint: "tcp://127.0.0.1:5556"}
keys: {server: "credential:pyrovox.key", clients: clients.keys}' tcp://127.0.0.1:5556 --key "$dir/bert.key"
}
check starts-with-that-key keyed
rm /etc/credstore.encrypted/pyrovox.key
drop_in <<< $'[Service]\nLoadCredential=pyrovox.key:/etc/pyrovox/lab.key'
check starts-with-one-of-root keyed
drop_in < /dev/null

in_it systemctl start pyrovox-view
view_serves() { in_it bash -c 'exec 3<> /dev/tcp/127.0.0.1/8737' 2> /dev/null && [ "$(in_it systemctl show -P NRestarts pyrovox-view)" = 0 ]; }
check page-serves wait_for view_serves
check stops in_it systemctl stop pyrovoxd
# asleep, and woken by one question, from a user of its group
settings woken '"files:/out/mono8/{name}/%06d.npy"' 'loop: true'
check socket-listens in_it systemctl start pyrovoxd.socket
asleep() { [ "$(in_it systemctl show -P ActiveState pyrovoxd)" = inactive ]; }
asks() { in_it setpriv --reuid pyrovox-view --regid pyrovox-view --groups "$(getent group pyrovox | cut -d: -f3)" "$pyrovox" status --endpoint ipc:///run/pyrovox/control --timeout "$patience" --json | grep -q '^{'; }
check is-asleep asleep
check is-woken-by-a-question asks
check socket-stays in_it systemctl stop pyrovoxd
check is-woken-again asks
check both-stop in_it systemctl stop pyrovoxd.socket pyrovoxd
never_failed() { [ "$(in_it systemctl show -P Result pyrovoxd)" = success ] && [ "$(in_it systemctl show -P NRestarts pyrovoxd)" = 0 ]; }
check ended-in-order never_failed
[ $rc = 0 ] || in_it journalctl --no-pager -u pyrovoxd -u pyrovox-view -n 60
exit $rc
