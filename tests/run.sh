#!/bin/bash
# Run the tests of build folder $1 and close with "N passed, N failed, N skipped".
#   run.sh BUILD [--no-system] [FILTER]
# Every program prints PASS/FAIL/SKIP lines; a program that dies without one is a failure by itself.  The limits
# end what hangs; no test comes near on a machine however busy.
# Two lanes at a time: tests/sim, which mostly wait for cameras, then those system tests that say "# offline" (no camera, no
# socket of anybody else's) in their second line; and all others.
set -u
cd "$(dirname "$0")/.."
b=$1; shift
system=1; filter=
for a in "$@"; do case $a in --no-system) system=0;; *) filter=$a;; esac; done
export PYROVOX_BUILD=$PWD/$b
export ASAN_OPTIONS=${ASAN_OPTIONS:-detect_leaks=1} LSAN_OPTIONS=${LSAN_OPTIONS:-suppressions=$PWD/tests/lsan.supp:print_suppressions=0}
export UBSAN_OPTIONS=${UBSAN_OPTIONS:-print_stacktrace=1:halt_on_error=1}
export TSAN_OPTIONS=${TSAN_OPTIONS:-halt_on_error=1:suppressions=$PWD/tests/tsan.supp}
log=$b/test.log
rm -f "$b"/test.*.log "$b"/test.*.sums
one() { # name, timeout, command...
    local name=$1 limit=$2; shift 2
    [ -n "$filter" ] && [[ $name != *"$filter"* ]] && return
    local out rc t0=$SECONDS
    out=$(timeout -k 10 "$limit" "$@" 2>&1 < /dev/null); rc=$?
    printf '=== %s (exit %d, %d s)\n%s\n' "$name" $rc $((SECONDS - t0)) "$out" >> "$b/test.$lane.log"
    local p f s
    p=$(grep -c '^PASS ' <<< "$out"); f=$(grep -c '^FAIL ' <<< "$out"); s=$(grep -c '^SKIP ' <<< "$out")
    if [ $rc -eq 77 ] && [ $((p + f + s)) -eq 0 ]; then s=1; out="SKIP $name ($(tail -n 1 <<< "$out"))"; fi
    if [ $rc -ne 0 ] && [ $rc -ne 77 ] && [ "$f" -eq 0 ]; then
        f=1; out+=$'\n'"FAIL $name: exit $rc$([ $rc -eq 124 ] && echo " (timed out after $limit s)")"
    elif [ $((p + f + s)) -eq 0 ]; then
        if [ $rc -eq 0 ]; then p=1; out="PASS $name"; fi
    fi
    echo "$p $f $s" >> "$b/test.$lane.sums"
    if [ "$f" -gt 0 ]; then printf '%s\n' "$out" | tail -n 60; else grep -E '^(PASS|SKIP) ' <<< "$out"; fi
}
programs() { # folder
    local t
    for t in "$b/tests/$1"/test_*; do
        [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
        one "${t#"$b"/tests/}" 1200 "$t"
    done
}
scripts() { # yes or no: those that are offline
    local t at
    for t in tests/system/[0-9]*.sh; do
        at=no; sed -n 2p "$t" | grep -q '^# offline' && at=yes
        [ $at != "$1" ] || one "system/$(basename "$t")" 1200 bash "$t"
    done
}
( lane=sim; programs sim; [ $system = 0 ] || scripts yes; true ) &
sim=$!
lane=others
programs unit; programs check
for t in "$b"/tests/fuzz/fuzz_*; do
    [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
    n=${t##*/fuzz_}
    found=$(mktemp -d)
    [ ! -f "tests/fuzz/found/$n.tar.gz" ] || tar -xzf "tests/fuzz/found/$n.tar.gz" -C "$found"
    one "fuzz/$n" 1200 "$t" tests/fuzz/corpus/"$n" --once "$found"
    rm -rf "$found"
done
[ $system = 0 ] || scripts no
wait $sim; ended=$?
cat "$b"/test.*.log > "$log" 2> /dev/null
read -r pass fail skip < <(cat "$b"/test.*.sums 2> /dev/null | awk '{ p += $1; f += $2; k += $3 } END { print p + 0, f + 0, k + 0 }')
rm -f "$b"/test.*.log "$b"/test.*.sums
[ $ended = 0 ] || { echo "FAIL the lane of tests/sim: exit $ended"; fail=$((fail + 1)); }
echo
echo "full output: $log"
echo "$pass passed, $fail failed, $skip skipped"
[ "$fail" -eq 0 ]
