#!/bin/bash
# The v4l2: backend on eight cameras of the kernel's vivid driver, the last one multi-planar.
# vm-modprobe: vivid n_devs=8 node_types=1,1,1,1,1,1,1,1 num_inputs=1,1,1,1,1,1,1,1 input_types=0,0,0,0,0,0,0,0 multiplanar=1,1,1,1,1,1,1,2
# vm-quick
name=100
. "$(dirname "$0")/lib.sh"
program vm_v4l2
exit $rc
