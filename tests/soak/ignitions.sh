#!/bin/bash
# Random ignitions before simulated cameras at 60 Hz, with faults of the cameras and a slow disk: every raw frame from pre
# before to post after each is in a take, or named as lost with its cause.  Prints the latency from exposure to event.
#   ignitions.sh BUILD [N]       PERIOD=8 (s), PRE=2, POST=3, JOBS=4 (daemons at a time), SLOW=8 (MB/s)
set -u
cd "$(dirname "$0")/../.."
b=$(realpath "${1:-build}")
dir=$(mktemp -d)
py=/usr/bin/python3; [ -x "$py" ] || py=python3
trap 'rm -rf "$dir"' EXIT
echo "machine: $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1), $(nproc) CPUs"
PYTHONPATH=proto/clients:tests/system "$py" tests/soak/ignitions.py "$b" "$dir" "${2:-200}" "${PERIOD:-8}" "${PRE:-2}" "${POST:-3}" "${JOBS:-4}" "${SLOW:-8}"
