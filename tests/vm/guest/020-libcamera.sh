#!/bin/bash
# libcamera: - eight virtual USB cameras behind libcamera's own handler: the list, every picture byte for byte.
# vm-modprobe: vhci-hcd
# vm-modprobe: uvcvideo
name=020
. "$(dirname "$0")/lib.sh"
check images-are-made uvc_pictures "$dir/take" 8
check firmware-names-the-controller fake_firmware
udevd_start
check cameras-come uvc_start "$dir/take" 8 --rate 5
program vm_views libcamera 8 "$dir/take"
program vm_views v4l2 8 "$dir/take"
# raw Bayer: 8 bits, 16 bits, and 10 in MIPI's packing
for f in BayerRG8 BayerRG16 BayerRG10csi; do
    program vm_views libcamera 8 "$dir/take" $f
done
program vm_views v4l2 8 "$dir/take" BayerRG10csi
exit $rc
