# parts.sh - runs commands as parts of a whole; .ci/run and tests/all.sh source it.
#   part NAME COMMAND...    its output, NAME before each line; a part that fails lets the others run
#   parts_end N             what failed, together: of a long log often the end alone is kept; then the time, and
#                           "N passed, N failed, N skipped" over all N parts.  False when anything failed.
# A part that prints no such line itself counts as one test.  Parts may run beside each other.
set -u
results=$(mktemp -d)
trap 'rm -rf "$results"' EXIT
part() { # name, command...
    local name=$1 log=$results/$1.log rc t0=$SECONDS p f k sums; shift
    echo "---- $name begins"
    "$@" 2>&1 < /dev/null | tee "$log" | sed -u "s/^/$name: /"; rc=${PIPESTATUS[0]}
    {
        grep -E -B6 '^ *FAIL|: error: |ERROR: [A-Z][a-z]*Sanitizer|^SUMMARY: ' "$log" | head -n 120
        [ "$rc" = 0 ] || tail -n 30 "$log"
    } | sed "s/^/$name: /" >> "$results/failures"
    sums=$(grep -E '^[0-9]+ passed, [0-9]+ failed, [0-9]+ skipped$' "$log")
    read -r p f k < <(awk '{ p += $1; f += $3; k += $5 } END { print p + 0, f + 0, k + 0 }' <<< "$sums")
    if [ "$rc" != 0 ] && [ "$f" = 0 ]; then f=1; fi
    if [ "$rc" = 0 ] && [ -z "$sums" ]; then p=1; fi
    echo "$p $f $k" >> "$results/sums"
    echo "---- $name: exit $rc, $((SECONDS - t0)) s: $p passed, $f failed, $k skipped" | tee -a "$results/ends"
}
parts_end() { # how many parts there are
    local pass fail skip ended
    read -r pass fail skip ended < <(awk '{ p += $1; f += $2; k += $3 } END { print p + 0, f + 0, k + 0, NR }' "$results/sums")
    [ "$ended" = "$1" ] || { echo "of $1 parts $ended ended" >> "$results/failures"; fail=$((fail + 1)); }
    cat "$results/ends"
    [ "$fail" = 0 ] || { echo "---- what failed"; cat "$results/failures"; }
    echo "all parts: $SECONDS s"
    echo "$pass passed, $fail failed, $skip skipped"
    [ "$fail" = 0 ]
}
