#!/bin/bash
# The whole daemon makes the same volumes from eight USB cameras, through V4L2 and through libcamera, as from
# the images themselves in files - within what the pixel format loses.
# vm-modprobe: vhci-hcd
# vm-modprobe: uvcvideo
# vm-before: "$b/bin/pyrovox" simcams --cameras 8 --size 160x120 --voxels 24 --ring 1 --noise 0 --write-rig "$out/rig.yaml" --write-frames "$out/none"
# vm-before: for f in mono8 rgb8; do "$b/bin/pyrovox" simcams --rig "$out/rig.yaml" --ring 3 --noise 0 --format $f --write-frames "$out/png-$f"; "$b/tests/vm/vm_flame" "$out/png-$f" "$out/$f"; done
# vm-before: for f in yuyv mjpg bayer; do "$b/tests/vm/vm_flame" "$out/png-rgb8" "$out/$f" $f; done
name=030
. "$(dirname "$0")/lib.sh"
instants=3
fake_firmware
udevd_start

# One daemon: name, format, cameras of the configuration, further lines.  Its volumes go to $dir/$1.
# Nothing here depends on the time of day or on the set before; a fixed number of iterations, so that a
# small difference of the images stays one.
settings() {
    echo "rig: /out/rig.yaml
publish: {endpoints: [\"$volumes\"], sample: f32, wait_subscriber: true}
control: {endpoint: \"$control\"}
cameras: $2
pixel_format: $1
transfer: linear
fps: 5
matrix_cache: $dir/matrix
photometry: {black: 0.02, threshold: 0.02}
solver: {stop: iterations, iterations: 20, warm_start: off, deadline_ms: 0}"
}
reference() { # name, format, folder
    settings "$2" "\"files:$3/{name}/%06d.npy\"" > "$dir/$1.yaml"
    echo "lossless: true" >> "$dir/$1.yaml"
    start "$1-record.log" "$pyrovox" record --quiet --endpoint "$volumes" --out "$dir/$1"
    local recorder=$started
    start "$1.log" "$pyrovoxd" --config "$dir/$1.yaml"
    ended "$started" 0 && ended "$recorder" 0 && [ "$(ls "$dir/$1"/*.npy | wc -l)" = $instants ]
}
live() { # name, format, cameras: until it has published two rounds of instants
    settings "$2" "$3" > "$dir/$1.yaml"
    start "$1-record.log" "$pyrovox" record --quiet --endpoint "$volumes" --volumes $((2 * instants)) --out "$dir/$1"
    local recorder=$started
    start "$1.log" "$pyrovoxd" --config "$dir/$1.yaml"
    local daemon=$started
    wait_for gone $recorder
    ended $recorder 0 || { status > "$dir/status.log"; return 1; }
    kill -TERM $daemon && ended $daemon 0
}
v4l2='{cam0: "v4l2:usb-FLAME000", cam1: "v4l2:usb-FLAME001", cam2: "v4l2:usb-FLAME002", cam3: "v4l2:usb-FLAME003", cam4: "v4l2:usb-FLAME004", cam5: "v4l2:usb-FLAME005", cam6: "v4l2:usb-FLAME006", cam7: "v4l2:usb-FLAME007"}'
libcamera='{cam0: "libcamera:VHCI-1:", cam1: "libcamera:VHCI-2:", cam2: "libcamera:VHCI-3:", cam3: "libcamera:VHCI-4:", cam4: "libcamera:VHCI-5:", cam5: "libcamera:VHCI-6:", cam6: "libcamera:VHCI-7:", cam7: "libcamera:VHCI-8:"}'

same() { "$vm/vm_volumes" "$dir/$1" "$dir/$2" "$3" > "$dir/volumes.log"; local got=$?; grep -v ^PASS "$dir/volumes.log"; return $got; }
chain() { # label, format, reference, bound, backends
    local backend
    for backend in ${5:-v4l2 libcamera}; do
        check "$1-$backend-runs" live "$1-$backend" "$2" "${!backend}"
        check "$1-$backend-volumes-as-from-files" same "$1-$backend" "$3" "$4"
    done
}
check grey-files reference ref-grey Mono8 /out/mono8
check grey-cameras-come uvc_start /out/mono8 8 --rate 5
chain grey Mono8 ref-grey 1e-6 # the same bytes, the same sums in the same order; measured: 0
uvc_stop > "$dir/uvc.log"
wait_for uvc_there 0

# Colour.  Against files of pictures with the format's loss, made by other code: rounding is left.  Against the
# pictures themselves: the loss, with room over what was measured (0.04 and 0.1).
check rgb-files reference ref-rgb RGB8 /out/rgb8
check yuyv-files reference ref-yuyv RGB32f /out/yuyv
check mjpg-files reference ref-mjpg RGB8 /out/mjpg
check yuyv-loses-so-much same ref-yuyv ref-rgb 0.06
check mjpg-loses-so-much same ref-mjpg ref-rgb 0.15
check bayer-files reference ref-bayer BayerRG8 /out/bayer
check rgb-cameras-come uvc_start /out/rgb8 8 --rate 5
chain yuyv YUV422_8 ref-yuyv 2e-3 # whole-number arithmetic against double: measured 1e-3
chain mjpg JPEG ref-mjpg 1e-4 # two users of one decoder: measured 0
# Raw Bayer; 10 bits of a byte differ from it by less than one of them.
chain bayer8 BayerRG8 ref-bayer 1e-6
chain bayer16 BayerRG16 ref-bayer 1e-5 libcamera
chain bayer10csi BayerRG10csi ref-bayer 5e-3 libcamera
exit $rc
