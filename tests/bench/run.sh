#!/bin/bash
# Run every benchmark of build folder $1: tables here, CSV in $1/bench; a run of all of them
# writes tests/bench/RESULTS.md too.
#   run.sh BUILD [FILTER]        FILTER: a regular expression, bench_judge|pixels
#                                PYROVOX_DATA=DIR: the data that may not be shipped (../shared/data)
# Ends with 1 where a benchmark failed, with 77 where a part could not run: NOT RUN lines say which, and
# what it needs.
set -u -o pipefail
cd "$(dirname "$0")/../.."
b=$1 filter=${2:-}
out=$b/bench
mkdir -p "$out"
[ -z "$filter" ] && rm -f "$out"/*.csv "$out"/live.md
PYROVOX_LIBDIR=$(realpath "$b")/lib/pyrovox # videos are read by a module that lies there
export PYROVOX_LIBDIR
rc=0
run() { # name, command...
    local name=$1 r t0=$SECONDS; shift
    [[ $name =~ $filter ]] || return
    "$@"; r=$?
    echo "  ($name: $((SECONDS - t0)) s)"
    case $r in
        0) ;;
        77) [ $rc = 0 ] && rc=77;;
        *) echo "FAIL $name: exit $r"; rc=1;;
    esac
}
live() { # at the daemon's usual rate, and at three times that
    local fps r=0
    for fps in 20 60; do
        LIVE_FPS=$fps LIVE_SECONDS=${LIVE_SECONDS:-60} bash tests/bench/live.sh "$b" || { r=$?; break; }
        echo
    done > "$out/live.md"
    cat "$out/live.md"
    return $r
}
figure5() { # the paper's: 100 frames of 7 cameras, 640x480 in bins of 2x2, five grids from 32 to 96, in both bases
    local at basis r; at=$(mktemp -d) || return 1
    "$b/bin/pyrovox" simcams --cameras 8 --size 640x480 --ring 100 --noise 1,1,4 --write-rig "$at/rig.yaml" \
        --write-frames "$at/take" > /dev/null 2>&1; r=$?
    for basis in box trilinear; do
        [ $r = 0 ] && "$b/bin/pyrovox" experiment "$at/take" --rig "$at/rig.yaml" --basis $basis --black 0.02 --threads 2 \
            --out "$at/$basis" 2>&1 | tr '\r' '\n' | grep '^figure 5:' | sed "s/5:/5, $basis:/"; r=$?
    done
    rm -rf "$at"; return $r
}
{
    for t in "$b"/tests/bench/bench_*; do
        [[ $t == *.o || $t == *.d || ! -x $t ]] || run "${t##*/}" "$t" "$out"
    done
    run figure5 figure5
    run highspeed bash tests/bench/highspeed.sh "$b"
    run live live # end to end, with simulated cameras
    run live_bars bash tests/bench/live_bars.sh "$b" # with and without error bars
    run view /usr/bin/python3 tests/view/bench.py "$b" # the page and its bridge, in a headless browser
    run blender /usr/bin/python3 tests/blender/bench.py "$b" # the add-on
    run judge /usr/bin/python3 tests/bench/judge.py "$out"
    echo "CSV: $out"
    exit $rc
} 2>&1 | tee "$out/bench.txt"
rc=$?
[ -n "$filter" ] || /usr/bin/python3 tests/bench/results.py "$out" $SECONDS || rc=1
grep -h '^NOT RUN\|^FAIL' "$out/bench.txt" | sort -u
exit $rc
