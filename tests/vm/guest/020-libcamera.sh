#!/bin/bash
# libcamera: - eight virtual USB cameras behind libcamera's own handler: the list, every picture byte for byte.
# vm-modprobe: vhci-hcd
# vm-modprobe: uvcvideo
# vm-seconds: 60
name=020
. "$(dirname "$0")/lib.sh"
check images-are-made uvc_pictures "$dir/take" 8
check firmware-names-the-controller fake_firmware
udevd_start
check cameras-come uvc_start "$dir/take" 8 --rate 5
program 30 vm_views libcamera 8 "$dir/take"
program 30 vm_views v4l2 8 "$dir/take"
exit $rc
