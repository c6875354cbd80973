#!/bin/bash
# What campaigns in BUILD found, as few inputs as reach as much, into tests/fuzz/found/NAME.tar.gz; the same bits for the same inputs.
#   keep.sh BUILD [FILTER]
set -eu
cd "$(dirname "$0")/../.."
b=$1 filter=${2:-}
mkdir -p tests/fuzz/found
for t in "$b"/tests/fuzz/fuzz_*; do
    [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
    n=${t##*/fuzz_}
    [[ $n =~ $filter ]] && [ -d "$b/fuzz/$n" ] || continue
    few=$(mktemp -d)
    longest=$({ echo 4096; find "tests/fuzz/corpus/$n" -type f -printf '%s\n'; } | sort -n | tail -n 1)
    ASAN_OPTIONS=detect_leaks=0 "$t" -merge=1 -max_len="$longest" "$few" "tests/fuzz/corpus/$n" "$b/fuzz/$n" > "$b/fuzz/$n.merge.log" 2>&1
    (cd "$few" && find . -type f -printf '%f\n' | LC_ALL=C sort | tar -c --mtime=@0 --owner=0 --group=0 --numeric-owner --mode=0644 -T - | gzip -9n) > "tests/fuzz/found/$n.tar.gz"
    echo "$n: $(find "$few" -type f | wc -l) inputs, $(stat -c %s "tests/fuzz/found/$n.tar.gz") bytes"
    rm -rf "$few"
done
