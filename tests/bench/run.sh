#!/bin/bash
# Run every benchmark of build folder $1: tables here, CSV and a picture in $1/bench.
#   run.sh BUILD [FILTER]
set -u -o pipefail
cd "$(dirname "$0")/../.."
b=$1 filter=${2:-}
out=$b/bench
mkdir -p "$out"
PYROVOX_LIBDIR=$(realpath "$b")/lib # videos are read by a module that lies there
export PYROVOX_LIBDIR
rc=0
{
    echo "machine: $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1), $(nproc) CPUs"
    echo "commit:  $(git describe --always --dirty 2>/dev/null || echo unknown)"
    for t in "$b"/tests/bench/bench_*; do
        [[ $t == *.o || $t == *.d || ! -x $t || $t != *"$filter"* ]] && continue
        "$t" "$out" || { echo "FAIL ${t##*/}: exit $?"; rc=1; }
    done
    # end to end, with simulated cameras
    if [ -f tests/bench/live.sh ] && [[ live == *"$filter"* ]]; then
        LIVE_SECONDS=${LIVE_SECONDS:-60} bash tests/bench/live.sh "$b" || { echo "FAIL live.sh: exit $?"; rc=1; }
    fi
    if [ -f "$out/curves.csv" ]; then
        /usr/bin/python3 tests/bench/plot.py "$out" || rc=1
    fi
    echo "CSV: $out"
    exit $rc
} 2>&1 | tee "$out/bench.txt"
