#!/bin/bash
# Run the tests of build folder $1 and close with "N passed, N failed, N skipped".
#   run.sh BUILD [--no-system] [FILTER]
# Every program prints PASS/FAIL/SKIP lines.  A program that dies without one is a failure by itself.  The limits
# end what hangs; no test comes near them on a machine however busy.
# Two lanes run beside each other.  Programs that compute have the lowest priority, TEST_JOBS at a time (one for each
# processor).  Programs that mostly wait run twice as many at a time: system tests, except those that say "# offline", and
# programs with cameras ($waits).  So the processors always have work, a camera gets one at once, and the daemon's checks
# of the rig, which have the lowest priority too, get their share.
set -u
cd "$(dirname "$0")/.."
b=$1; shift
system=1; filter=
for a in "$@"; do case $a in --no-system) system=0;; *) filter=$a;; esac; done
jobs=${TEST_JOBS:-$(nproc)}
waits='sim/test_(aravis|capture|cli_live|faults|gvcam|missing|pipeline|v4l2|view)'
export PYROVOX_BUILD=$PWD/$b
export ASAN_OPTIONS=${ASAN_OPTIONS:-detect_leaks=1} LSAN_OPTIONS=${LSAN_OPTIONS:-suppressions=$PWD/tests/lsan.supp:print_suppressions=0}
export UBSAN_OPTIONS=${UBSAN_OPTIONS:-print_stacktrace=1:halt_on_error=1}
export TSAN_OPTIONS=${TSAN_OPTIONS:-halt_on_error=1:suppressions=$PWD/tests/tsan.supp}
export PYROVOX_OPENCL_PATIENCE=600 # a busy machine is no device that hangs
export OPENCV_OPENCL_DEVICE=disabled # it would start the threads of pocl, which the tests of recon/opencl need
log=$b/test.log notes=$(mktemp -d)
trap 'rm -rf "$notes"' EXIT
# t.h: seconds, processor seconds and name of each case.  lib/main.c: the name of each program at each thread it starts.
export T_TIMES=$notes/cases T_THREADS=$notes/threads
: > "$T_TIMES"; : > "$T_THREADS"
# Of a program's output: each PASS and SKIP, each FAIL with the 60 lines before it that are neither, and after a FAIL the
# 60 last ones.
shown='function say(from) { for (from = n > 60 ? n - 60 : 0; from < n; from++) print said[from]; n = 0 }
       /^(PASS|SKIP) / { print; n = 0; next }
       { said[n++] = $0 }
       /^FAIL / { say(); failed = 1 }
       END { if (failed) say() }'
one() { # number, name, timeout, command...
    local n=$notes/$1 name=$2 limit=$3 out rc spent p f s; shift 3
    TIMEFORMAT='%R %U %S'
    { time timeout -k 10 "$limit" "$@" > "$n.out" 2>&1 < /dev/null; } 2> "$n.time"; rc=$?
    out=$(tr -d '\0' < "$n.out"); rm "$n.out"
    spent=$(awk 'END { printf "%.1f %.1f", $1, $2 + $3 }' "$n.time")
    echo "$spent $name" > "$n.spent"
    printf '=== %s (exit %d, %s s, %s s of a processor)\n%s\n' "$name" $rc "${spent% *}" "${spent#* }" "$out" > "$n.log"
    p=$(grep -c '^PASS ' <<< "$out"); f=$(grep -c '^FAIL ' <<< "$out"); s=$(grep -c '^SKIP ' <<< "$out")
    if [ $rc -eq 77 ] && [ $((p + f + s)) -eq 0 ]; then s=1; out="SKIP $name ($(tail -n 1 <<< "$out"))"; fi
    if [ $rc -ne 0 ] && [ $rc -ne 77 ] && [ "$f" -eq 0 ]; then
        f=1; out+=$'\n'"FAIL $name: exit $rc$([ $rc -eq 124 ] && echo " (timed out after $limit s)")"
    elif [ $((p + f + s)) -eq 0 ]; then
        if [ $rc -eq 0 ]; then p=1; out="PASS $name"; fi
    fi
    flock "$notes" awk "$shown" <<< "$out"
    echo "$p $f $s" > "$n.sums"
}
started=0
queue() { # lane, name, command...
    [ -n "$filter" ] && [[ $2 != *"$filter"* ]] && return
    started=$((started + 1))
    { printf '%04d' $started; printf ' %q' "${@:2}"; echo; } >> "$notes/lane-$1"
}
lane() { # name, programs at a time, command that runs each
    local n name command
    [ -e "$notes/lane-$1" ] || return
    while read -r n name command; do
        while [ "$(jobs -rp | wc -l)" -ge "$2" ]; do wait -n; done
        eval "one $n $name 3600 ${3:-} $command" &
    done < "$notes/lane-$1"
    wait
}
programs() { # folder
    local t l
    for t in "$b/tests/$1"/test_*; do
        [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
        l=computes; [[ $1/${t##*/} =~ ^$waits ]] && l=waits
        queue $l "$1/${t##*/}" "$t"
    done
}
corpus() { # fuzz target
    local n=${1##*/fuzz_}
    mkdir "$notes/found-$n"
    [ ! -f "tests/fuzz/found/$n.tar.gz" ] || tar -xzf "tests/fuzz/found/$n.tar.gz" -C "$notes/found-$n"
    queue computes "fuzz/$n" "$1" tests/fuzz/corpus/"$n" --once "$notes/found-$n"
}
longest() { # what, lines of seconds, processor seconds, name
    echo; echo "the 25 longest $1: seconds, of a processor:"
    sort -rn | head -n 25 | awk '{ s = $1; c = $2; sub(/^[^ ]+ [^ ]+ /, ""); printf "  %7.1f %7s  %s\n", s, c, $0 }'
}
if [ $system = 1 ]; then
    for t in tests/system/[0-9]*.sh; do
        l=waits; grep -q '^# offline' "$t" && l=computes
        queue $l "system/$(basename "$t")" bash "$t"
    done
fi
programs sim; programs unit; programs check
for t in "$b"/tests/fuzz/fuzz_*; do
    [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
    corpus "$t"
done
lane waits $((2 * jobs)) & lane computes "$jobs" "nice -n 19" &
wait
cat "$notes"/*.log > "$log" 2> /dev/null
cat "$notes"/*.spent 2> /dev/null | longest programs
longest cases < "$T_TIMES"
read -r pass fail skip < <(cat "$notes"/*.sums 2> /dev/null | awk '{ p += $1; f += $2; k += $3 } END { print p + 0, f + 0, k + 0 }')
ended=$(find "$notes" -name '*.sums' | wc -l)
for t in $(sort -u "$T_THREADS" | comm -12 - <(grep '^[a-z0-9_]*$' tests/not-under-tsan.txt | sort)); do
    echo "FAIL run.sh: $t starts threads: take it out of tests/not-under-tsan.txt"; fail=$((fail + 1))
done
[ "$ended" = $started ] || { echo "FAIL run.sh: of $started programs $ended ended"; fail=$((fail + 1)); }
echo
echo "full output: $log"
echo "all programs together: $(cat "$notes"/*.spent 2> /dev/null | awk '{ c += $2 } END { printf "%.0f", c }') s of a processor"
echo "$pass passed, $fail failed, $skip skipped"
[ "$fail" -eq 0 ]
