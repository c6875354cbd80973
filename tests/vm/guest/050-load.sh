#!/bin/bash
# Eight virtual USB cameras at 640x480, as a lab has them: every picture byte for byte, and as fast as the emulated
# machine goes.  Each rate is asked for until the cameras can no longer send all they should; what they sent has to
# arrive or be counted as missing, at every rate.
# vm-modprobe: vhci-hcd
# vm-modprobe: uvcvideo
# vm-memory: 2560
# vm-before: "$b/bin/pyrovox" simcams --cameras 8 --size 640x480 --voxels 24 --ring 4 --noise 0 --format rgb8 --write-frames "$out/png"; "$b/tests/vm/vm_flame" "$out/png" "$out/flame"
name=050
. "$(dirname "$0")/lib.sh"
check firmware-names-the-controller fake_firmware
udevd_start
check cameras-come uvc_start /out/flame 8

# What the cameras sent came out of the backend or is counted as missing, but for what was on its way at the end.
sums() { # word, of all cameras
    uvc_order stats && grep '^camera ' "$dir/uvccams.log" | tail -n 8 | sed "s/.* $1 \([0-9]*\).*/\1/" | awk '{ s += $1 } END { print s }'
}
accounted() { # sent, log
    local come; come=$(awk '/^camera / { s += $4 + $6 } END { print s }' "$2")
    [ "$come" -le "$1" ] && [ $(($1 - come)) -le $((8 * 8)) ] || { echo "  sent $1, received or missing $come"; grep ^camera "$2"; return 1; }
}
load() { # backend, format, rate, frames
    local before busy; before=$(sums sent) busy=$(sums busy)
    program vm_views "$1" 8 /out/flame "$2" "$3" "$4" > "$dir/load"
    grep -E '^(PASS|FAIL) ' "$dir/load" | sed "s/vm_views.c:/$name:$1-$2-$3Hz-/"
    grep -vE '^(PASS|camera )' "$dir/load"
    echo "figures   not sent because the host had not taken the frame before: $(($(sums busy) - busy)); missing: $(awk '/^camera / { s += $6 } END { print s }' "$dir/load")"
    check "$1-$2-$3Hz-every-frame-is-there-or-counted" accounted $(($(sums sent) - before)) "$dir/load"
}
load v4l2 Mono8 5 20
load v4l2 Mono8 30 90
load v4l2 JPEG 30 90
load v4l2 YUV422_8 15 45
load libcamera JPEG 30 90 # the cameras' own rate: libcamera cannot ask for one
exit $rc
