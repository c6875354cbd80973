#!/bin/bash
# libFuzzer on every target for $2 seconds each; new inputs go to a scratch folder, not the corpus.
set -u
cd "$(dirname "$0")/../.."
rc=0
for t in "$1"/tests/fuzz/fuzz_*; do
    [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
    n=${t##*/fuzz_}
    scratch=$(mktemp -d)
    echo "== $n"
    "$t" -max_total_time="$2" -max_len=65536 -print_final_stats=1 -artifact_prefix="$scratch/" "$scratch" "tests/fuzz/corpus/$n" 2>&1 | tail -n 8 || rc=1
    [ "${PIPESTATUS[0]}" = 0 ] || rc=1
done
exit $rc
