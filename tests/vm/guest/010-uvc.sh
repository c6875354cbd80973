#!/bin/bash
# The virtual USB cameras, as the kernel's uvcvideo and v4l2-ctl see them: what they offer, what they send,
# controls, a cable pulled and plugged.  No code of Pyrovox reads the pictures here.
# vm-modprobe: vhci-hcd
# vm-modprobe: uvcvideo
# vm-quick
name=010
. "$(dirname "$0")/lib.sh"
check images-are-made uvc_pictures "$dir/take" 3
check cameras-come uvc_start "$dir/take" 3
v=$(uvc_nodes | sed -n 2p)
grab() { # format, file
    v4l2-ctl -d "$v" --set-fmt-video=width=160,height=120,pixelformat="$1" --set-parm=15 --stream-mmap --stream-count=8 --stream-to="$2" > "$dir/grab.log" 2>&1
}
formats() { v4l2-ctl -d "$v" --list-formats-ext | tr -d '\t' > "$dir/formats"; [ "$(grep -cE "'(MJPG|YUYV|GREY|RGGB|RG16|pRAA)'|Size: Discrete (160x120|80x60)|\((30|15|5)\.000 fps\)" "$dir/formats")" = 54 ]; }
check offers-formats formats
grey() { grab GREY "$dir/grey" && [ "$(stat -c %s "$dir/grey")" = $((8 * 160 * 120)) ]; }
check streams-grey grey
yuyv() { grab YUYV "$dir/yuyv" && [ "$(stat -c %s "$dir/yuyv")" = $((8 * 2 * 160 * 120)) ]; }
check streams-yuyv yuyv
mjpg() { grab MJPG "$dir/mjpg" && [ "$(head -c 3 "$dir/mjpg" | od -An -tx1 | tr -d ' ')" = ffd8ff ]; }
check streams-mjpg mjpg
# every picture is one of the four, in turn, byte for byte; a picture of another camera is none of them
content() {
    "$py" - "$dir/grey" "$dir/yuyv" "$dir/take" << 'PY'
import sys
grey, yuyv = open(sys.argv[1], 'rb').read(), open(sys.argv[2], 'rb').read()
cams = [[open('%s/cam%d/%06d.npy' % (sys.argv[3], c, k), 'rb').read()[128:] for k in range(4)] for c in range(3)]
n = len(cams[0][0])
order = [cams[1].index(grey[k * n:(k + 1) * n]) for k in range(8)]
assert not any(grey[:n] in c for c in (cams[0], cams[2]))
assert len(set(order)) > 1, order
luma = [bytes(round(16 + 219 * v / 255) for v in f) for f in cams[1]]
for k in range(8):
    f = yuyv[k * 2 * n:(k + 1) * 2 * n]
    assert f[0::2] in luma and set(f[1::2]) == {128}
PY
}
check pictures-are-right content
knobs() {
    v4l2-ctl -d "$v" --set-ctrl=gain=33,brightness=-5,auto_exposure=1 && v4l2-ctl -d "$v" --set-ctrl=exposure_time_absolute=250 &&
    [ "$(v4l2-ctl -d "$v" --get-ctrl=gain,exposure_time_absolute | tr '\n' ' ')" = "gain: 33 exposure_time_absolute: 250 " ] &&
    [ "$(uvc_stat 1 gain)" = 33 ] && [ "$(uvc_stat 1 exposure)" = 250 ] && [ "$(uvc_stat 1 brightness)" = -5 ] && [ "$(uvc_stat 0 gain)" = 10 ]
}
check controls-reach-the-camera knobs
# pulled while streaming: the reader gets an error, the node goes, the others stay; plugged again it streams
cable() {
    v4l2-ctl -d "$v" --stream-mmap --stream-count=10000 > "$dir/pulled.log" 2>&1 & local reader=$!
    started() { [ "$(uvc_stat 1 started)" -ge 4 ]; }
    wait_for started && uvc_order unplug 1 && wait_for uvc_there 2 && wait_for gone $reader || return 1
    uvc_order plug 1 && wait_for uvc_there 3 || return 1
    v=$(uvc_nodes | sed -n 2p)
    grab GREY "$dir/grey" && content
}
check cable-pulled-and-plugged cable
faults() { # a frame in two is cut: uvcvideo keeps those back, and their numbers are missing
    uvc_order cut 1 0.5 && grab GREY "$dir/grey" && content && [ "$(uvc_stat 1 cut)" -gt 0 ] && uvc_order cut 1 0
}
check short-frames-are-kept-back faults
check cameras-end uvc_stop
exit $rc
