#!/bin/bash
# Run the tests of build folder $1 and close with "N passed, N failed, N skipped".
#   run.sh BUILD [--no-system] [FILTER]
# Every program prints PASS/FAIL/SKIP lines; a program that dies without one is a failure by itself.  The limits
# end what hangs; no test comes near on a machine however busy.
set -u
cd "$(dirname "$0")/.."
b=$1; shift
system=1; filter=
for a in "$@"; do case $a in --no-system) system=0;; *) filter=$a;; esac; done
export PYROVOX_BUILD=$PWD/$b
export ASAN_OPTIONS=${ASAN_OPTIONS:-detect_leaks=1} UBSAN_OPTIONS=${UBSAN_OPTIONS:-print_stacktrace=1:halt_on_error=1}
export TSAN_OPTIONS=${TSAN_OPTIONS:-halt_on_error=1:suppressions=$PWD/tests/tsan.supp}
log=$b/test.log; : > "$log"
pass=0 fail=0 skip=0
one() { # name, timeout, command...
    local name=$1 limit=$2; shift 2
    [ -n "$filter" ] && [[ $name != *"$filter"* ]] && return
    local out rc t0=$SECONDS
    out=$(timeout -k 10 "$limit" "$@" 2>&1); rc=$?
    printf '=== %s (exit %d, %d s)\n%s\n' "$name" $rc $((SECONDS - t0)) "$out" >> "$log"
    local p f s
    p=$(grep -c '^PASS ' <<< "$out"); f=$(grep -c '^FAIL ' <<< "$out"); s=$(grep -c '^SKIP ' <<< "$out")
    if [ $rc -eq 77 ] && [ $((p + f + s)) -eq 0 ]; then s=1; out="SKIP $name ($(tail -n 1 <<< "$out"))"; fi
    if [ $rc -ne 0 ] && [ $rc -ne 77 ] && [ "$f" -eq 0 ]; then
        f=1; out+=$'\n'"FAIL $name: exit $rc$([ $rc -eq 124 ] && echo " (timed out after $limit s)")"
    elif [ $((p + f + s)) -eq 0 ]; then
        if [ $rc -eq 0 ]; then p=1; out="PASS $name"; fi
    fi
    pass=$((pass + p)); fail=$((fail + f)); skip=$((skip + s))
    if [ "$f" -gt 0 ]; then printf '%s\n' "$out" | tail -n 60; else grep -E '^(PASS|SKIP) ' <<< "$out"; fi
}
for t in "$b"/tests/{unit,check,sim}/test_*; do
    [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
    one "${t#"$b"/tests/}" 1200 "$t"
done
for t in "$b"/tests/fuzz/fuzz_*; do
    [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
    n=${t##*/fuzz_}
    one "fuzz/$n" 1200 "$t" tests/fuzz/corpus/"$n"
done
if [ $system = 1 ]; then
    for t in tests/system/[0-9]*.sh; do
        [ -f "$t" ] || continue
        one "system/$(basename "$t")" 1200 bash "$t"
    done
fi
echo
echo "full output: $log"
echo "$pass passed, $fail failed, $skip skipped"
[ $fail -eq 0 ]
