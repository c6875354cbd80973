#!/bin/bash
# The virtual machine is what the other scripts take it for.
# vm-modprobe: vivid n_devs=2 node_types=1,1 num_inputs=1,1 input_types=0,0
# vm-quick
name=000
. "$(dirname "$0")/lib.sh"
check is-root [ "$(id -u)" = 0 ]
check has-modules-with-their-options [ "$(ls -d /sys/class/video4linux/video* | wc -l)" = 2 ]
scratch() { echo x > tests/vm/guest/written-by-000 && [ -s tests/vm/guest/written-by-000 ]; }
check may-write-anywhere scratch
check sees-the-build "$pyrovox" --version
check out-is-shared touch /out/written-by-000
for m in sch_netem veth vhci_hcd uvcvideo; do check "kernel-has-$m" modprobe -n "$m"; done
exit $rc
