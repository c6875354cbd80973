#!/bin/bash
# The v4l2: backend on the kernel's uvcvideo: webcams by serial number, controls that reach the camera, a cable
# pulled while frames of it are in use.
# vm-modprobe: vhci-hcd
# vm-modprobe: uvcvideo
name=110
. "$(dirname "$0")/lib.sh"
check images-are-made uvc_pictures "$dir/take" 3
check cameras-come uvc_start "$dir/take" 3
listed() {
    "$pyrovox" cameras v4l2 > "$dir/list" 2>&1 &&
    [ "$(grep -oE '"v4l2:[^"]*"' "$dir/list" | tr '\n' ' ')" = '"v4l2:usb-FLAME000" "v4l2:usb-FLAME001" "v4l2:usb-FLAME002" ' ] || { cat "$dir/list"; false; }
}
check listed-by-serial-number listed
said() { grep -qx "$1" "$dir/words" 2>/dev/null; }
cable() { wait_for said running && uvc_order unplug 1 && wait_for said lost && uvc_order plug 1; }
cable & hand=$!
program vm_v4l2_uvc "$dir/words" v4l2:usb-FLAME000 v4l2:usb-FLAME001 v4l2:usb-FLAME002
check the-cable-was-pulled wait $hand
check exposure-reached-the-camera [ "$(uvc_stat 1 exposure)" = 250 ]
check gain-reached-the-camera [ "$(uvc_stat 1 gain)" = 33 ]
check not-the-others [ "$(uvc_stat 0 gain)" = 10 ]
taken() { # the list works while somebody streams; who streams is named
    v4l2-ctl -d "$(uvc_nodes | head -n 1)" --set-fmt-video=width=160,height=120,pixelformat=GREY --stream-mmap --stream-count=10000 > "$dir/taken.log" 2>&1 & local reader=$!
    pids+=("$reader")
    busy() { "$pyrovox" cameras test --seconds 1 --size 160x120 --pixel-format JPEG v4l2:usb-FLAME000 > "$dir/busy" 2>&1; tr -s " \n" " " < "$dir/busy" | grep -q "in use by v4l2-ctl (pid $reader)"; }
    wait_for busy && listed || { sed "s/^/  /" "$dir/busy"; false; }
}
check a-busy-camera-names-its-user taken
exit $rc
