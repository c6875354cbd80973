#!/bin/bash
# libFuzzer on every target: from its corpus, from what earlier campaigns found, and from what this build folder found before.
#   run.sh BUILD SECONDS [FILTER]     SECONDS each; inputs stay in BUILD/fuzz/NAME, those that broke something in BUILD/fuzz/broken
# keep.sh puts what is new into the tree.
set -u
cd "$(dirname "$0")/../.."
b=$1 seconds=$2 filter=${3:-}
rc=0 all=0
mkdir -p "$b/fuzz/broken"
printf '%-10s %14s %10s %8s %8s\n' target executions per_second edges inputs
for t in "$b"/tests/fuzz/fuzz_*; do
    [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
    n=${t##*/fuzz_}
    [[ $n =~ $filter ]] || continue
    work=$b/fuzz/$n
    mkdir -p "$work"
    longest=$({ echo 4096; find "tests/fuzz/corpus/$n" -type f -printf '%s\n'; } | sort -n | tail -n 1) # of longer ones it would only see the beginning
    [ ! -f "tests/fuzz/found/$n.tar.gz" ] || tar -xzf "tests/fuzz/found/$n.tar.gz" -C "$work"
    # a target's own leaks, and memory that a good input may ask for, are for its corpus in make test-sanitize; what is freed
    # is watched for longer than any input takes (the 256 MB that are usual halve the speed); an input of 20 s hangs
    UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 ASAN_OPTIONS=detect_leaks=0:quarantine_size_mb=8 "$t" -max_total_time="$seconds" -max_len="$longest" -rss_limit_mb=4096 -timeout=20 -print_final_stats=1 -artifact_prefix="$b/fuzz/broken/$n-" \
        "$work" "tests/fuzz/corpus/$n" > "$b/fuzz/$n.log" 2>&1
    r=$?
    get() { sed -n "s/^stat::$1: *//p" "$b/fuzz/$n.log"; }
    runs=$(get number_of_executed_units); all=$((all + ${runs:-0}))
    printf '%-10s %14s %10s %8s %8s\n' "$n" "${runs:-?}" "$(get average_exec_per_sec)" "$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$b/fuzz/$n.log" | tail -n 1)" "$(find "$work" -type f | wc -l)"
    [ $r = 0 ] || { rc=1; tail -n 25 "$b/fuzz/$n.log"; echo "FAIL $n: exit $r; its input is in $b/fuzz/broken"; }
done
echo "$all executions"
exit $rc
