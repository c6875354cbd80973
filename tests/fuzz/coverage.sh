#!/bin/bash
# What the inputs in the tree reach of each parser: a table, lines and branches of its functions.
#   coverage.sh BUILD     built by make fuzz-coverage
set -eu
cd "$(dirname "$0")/../.."
b=$1
mkdir -p "$b/fuzz"
echo "| target | inputs | parser | lines | branches |"
echo "|---|---|---|---|---|"
for t in "$b"/tests/fuzz/fuzz_*; do
    [[ $t == *.o || $t == *.d || ! -x $t ]] && continue
    n=${t##*/fuzz_}
    found=$(mktemp -d)
    [ ! -f "tests/fuzz/found/$n.tar.gz" ] || tar -xzf "tests/fuzz/found/$n.tar.gz" -C "$found"
    rm -f "$b/fuzz/$n"-*.profraw
    LLVM_PROFILE_FILE=$b/fuzz/$n-%m.profraw "$t" "tests/fuzz/corpus/$n" --once "$found" > "$b/fuzz/$n.log"
    llvm-profdata-14 merge -sparse "$b/fuzz/$n"-*.profraw -o "$b/fuzz/$n.profdata"
    line=$(sed -n "s/^$n  *//p" tests/fuzz/parsers.txt)
    read -r -a files <<< "${line%% but *}"
    [ ${#files[@]} -gt 0 ] || { echo "tests/fuzz/parsers.txt: $n is missing" >&2; exit 1; }
    but='^$'
    [[ $line != *' but '* ]] || but="^(.*:)?(${line##* but })\$"
    llvm-cov-14 report "$t" -object "$b/lib/pyrovox/pyrovox-tiff.so" -object "$b/lib/pyrovox/pyrovox-films.so" -instr-profile="$b/fuzz/$n.profdata" -path-equivalence=.,"$PWD" -show-functions "${files[@]}" |
        awk -v n="$n" -v inputs="$(sed -n 's/.*(\([0-9]*\) inputs.*/\1/p' "$b/fuzz/$n.log")" -v files="${files[*]}" -v but="$but" '
            $4 ~ /%$/ && $1 != "TOTAL" && $1 !~ but { lines += $5; no_line += $6; branches += $8; no_branch += $9 }
            END { gsub(" ", "` `", files)
                  printf "| %s | %s | `%s` | %.1f %% | %.1f %% |\n", n, inputs, files, 100 * (1 - no_line / lines), 100 * (1 - no_branch / branches) }'
    rm -rf "$found"
done
