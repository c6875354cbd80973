#!/bin/bash
# A USB cable is pulled and plugged again while the daemon runs, through V4L2 and through libcamera (which hears of it
# from udevd, and would crash without capture/libcamera/hold.h).
# Exposure, gain and controls by name reach the cameras.
# vm-modprobe: vhci-hcd
# vm-modprobe: uvcvideo
# vm-before: "$b/bin/pyrovox" simcams --cameras 4 --size 160x120 --voxels 16 --ring 3 --noise 0 --format mono8 --write-rig "$out/rig.yaml" --write-frames "$out/png"; "$b/tests/vm/vm_flame" "$out/png" "$out/mono8"
name=035
. "$(dirname "$0")/lib.sh"
check firmware-names-the-controller fake_firmware
udevd_start
check cameras-come uvc_start /out/mono8 4 --rate 5

daemon() { # name, cameras, further lines
    echo "rig: /out/rig.yaml
publish: {endpoints: [\"$volumes\"]}
control: {endpoint: \"$control\"}
cameras: $2
pixel_format: Mono8
fps: 5
sync: {policy: partial}
photometry: {black: 0.02, threshold: 0.02}
matrix_cache: $dir/matrix
$3" > "$dir/$1.yaml"
    start "$1.log" "$pyrovoxd" --config "$dir/$1.yaml"
}
complete() { field "s['sets']['complete'] >= $1"; }
partial() { field "s['sets']['partial'] >= $1"; }
gone_2() { field "s['cameras'][2]['state'] != 'running' and s['cameras'][2]['counts']['lost_camera'] == 1"; }
back_2() { field "s['cameras'][2]['state'] == 'running' and s['cameras'][2]['fps'] > 0"; }
others() { field "all(s['cameras'][i]['counts']['lost_camera'] == 0 for i in (0, 1, 3))"; }
is() { [ "$(uvc_stat "$1" "$2")" = "$3" ] || { echo "  camera $1: $2 $(uvc_stat "$1" "$2"), want $3"; return 1; }; }
logged() { [ "$(grep -c 'cam2.*connection lost' "$dir/$1.log")" = "$2" ] || { grep cam2 "$dir/$1.log"; return 1; }; }

pulled() { # name
    check "$1-sets-complete" wait_for complete 3
    uvc_order unplug 2
    check "$1-loss-is-seen" wait_for gone_2
    local n; n=$(status | "$py" -c 'import json, sys; print(json.load(sys.stdin)["sets"]["partial"])')
    check "$1-others-go-on" wait_for partial $((n + 3))
}
plugged() { # name
    local n
    uvc_order plug 2
    check "$1-comes-back" wait_for back_2
    kill -0 "$started" 2>/dev/null || { echo "  the daemon is gone"; exit 1; }
    n=$(status | "$py" -c 'import json, sys; print(json.load(sys.stdin)["sets"]["complete"])')
    check "$1-sets-complete-again" wait_for complete $((n + 3))
    check "$1-only-that-one-was-lost" others
}
end() { # name, losses
    kill -TERM "$started" && check "$1-ends" ended "$started" 0
    check "$1-losses-are-logged-once-each" logged "$1" "$2"
}

daemon v4l2 '{cam0: "v4l2:usb-FLAME000", cam1: "v4l2:usb-FLAME001", cam2: "v4l2:usb-FLAME002", cam3: "v4l2:usb-FLAME003"}' \
    'exposure_us: 20000
gain: 33
features: {brightness: 7}'
pulled v4l2
plugged v4l2
end v4l2 1
check v4l2-exposure is 0 exposure 200
check v4l2-gain is 3 gain 33
check v4l2-control-by-name is 2 brightness 7 # of the camera that came back

daemon libcamera '{cam0: "libcamera:VHCI-1:", cam1: "libcamera:VHCI-2:", cam2: "libcamera:VHCI-3:", cam3: "libcamera:VHCI-4:"}' \
    'exposure_us: 10000
gain: 2
features: {Brightness: 0.5}'
# libcamera takes controls with requests only, for these cameras: they go with the first one of each buffer, reach the camera
# at the start, and are not said again with every frame.
check libcamera-starts wait_for complete 6
turned=$(uvc_stat 1 turned)
# automatic exposure off, time, gain, brightness
check libcamera-controls-are-said [ "$turned" -ge 4 ]
check libcamera-controls-are-said-at-the-start [ "$(uvc_stat 1 turned_at)" -le 6 ]
check libcamera-goes-on wait_for complete 16
check libcamera-controls-are-not-said-again is 1 turned "$turned"
check libcamera-gain is 1 gain 40
pulled libcamera
plugged libcamera
# again, and another one twice: each time the camera has other numbers
for i in 1 2; do
    uvc_order unplug 2; check libcamera-loss-is-seen-$i wait_for field "s['cameras'][2]['counts']['lost_camera'] == $((i + 1))"
    uvc_order plug 2; check libcamera-comes-back-$i wait_for back_2
done
end libcamera 3
check libcamera-exposure is 0 exposure 100
check libcamera-control-by-name is 3 brightness 32 # half of 64
check libcamera-control-after-return is 2 brightness 32

refused() {
    daemon bad '{cam0: "libcamera:VHCI-1:", cam1: "libcamera:VHCI-2:", cam2: "libcamera:VHCI-3:", cam3: "libcamera:VHCI-4:"}' 'features: {Nonsense: 1}'
    says() { field "'has no control Nonsense; there are:' in s['cameras'][0]['error']"; }
    wait_for says && kill -TERM "$started" && ended "$started" 0
}
check libcamera-refuses-unknown-controls refused
exit $rc
