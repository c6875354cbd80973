#!/bin/bash
# test.sh BUILD [--quick|FILTER]: run every tests/vm/guest/NNN-*.sh in a virtual machine of its own, and close with
# "N passed, N failed, N skipped".  --quick: those that say "# vm-quick".  README.md beside this says how a script
# is written.
set -u
cd "$(dirname "$0")/../.."
b=$1 filter=${2:-}
export PYROVOX_BUILD=$PWD/$b VM_DIR=$PWD/$b/vm
pass=0 fail=0 skip=0
scripts=()
for s in tests/vm/guest/[0-9]*.sh; do
    if [ "$filter" = --quick ]; then grep -q '^# vm-quick' "$s"; else [[ $s == *"$filter"* ]]; fi && scripts+=("$s")
done
finish() {
    echo
    [ ! -s "$VM_DIR/test.log" ] || echo "full output: ${VM_DIR#"$PWD"/}/test.log, kernel messages: ${VM_DIR#"$PWD"/}/out/*/kernel.log"
    echo "$pass passed, $fail failed, $skip skipped"
    [ $fail -eq 0 ]; exit
}
mkdir -p "$VM_DIR"; log=$VM_DIR/test.log; : > "$log"

# Can there be a machine?  Exit statuses and quoting have to come through, too.
said=$(tests/vm/run.sh -- sh -c 'test "$1" = "a  b" && exit 7' - 'a  b' 2>&1); rc=$?
case $rc in
    7) pass=1; echo "PASS vm/machine";;
    77) for s in "${scripts[@]}"; do skip=$((skip + 1)); echo "SKIP vm/$(basename "$s") (no virtual machine here: $(tail -n 1 <<< "$said"))"; done; finish;;
    *) fail=1; printf '%s\nFAIL vm/machine: exit %d, want 7\n' "$said" $rc; finish;;
esac

# A program that no script runs would be a test that looks like one.
for c in tests/vm/vm_*.c; do
    [ -f "$c" ] || continue
    n=$(basename "$c" .c)
    grep -qw "$n" tests/vm/guest/*.sh || { fail=$((fail + 1)); echo "FAIL vm/$n: no script in tests/vm/guest runs it"; }
done

one() { # script
    local s=$1 n out=$VM_DIR/out rc t0=$SECONDS text p f k m opts=()
    n=vm/$(basename "$s")
    while read -r m; do opts+=(-k "$m"); done < <(sed -n 's/^# vm-modprobe: *//p' "$s")
    out+=/$(basename "$s" .sh); rm -rf "$out"; mkdir -p "$out"
    # What takes long when emulated is done outside; the guest finds it in /out.
    local before; before=$(sed -n 's/^# vm-before: *//p' "$s")
    if [ -n "$before" ] && ! text=$(out=$out b=$PYROVOX_BUILD PYROVOX_LIBDIR=$PYROVOX_BUILD/lib/pyrovox bash -euc "$before" 2>&1); then
        fail=$((fail + 1)); printf '%s\nFAIL %s: before: %s\n' "$text" "$n" "$before" | tee -a "$log"; return
    fi
    text=$(tests/vm/run.sh "${opts[@]+"${opts[@]}"}" -M "$(sed -n 's/^# vm-memory: *//p' "$s" | grep . || echo 1536)" -o "$out" -- bash "$s" 2>&1); rc=$?
    printf '=== %s (exit %d, %d s)\n%s\n' "$n" $rc $((SECONDS - t0)) "$text" >> "$log"
    if grep -qE 'BUG:|Oops|general protection|Kernel panic|blocked for more than' "$out/kernel.log" 2>/dev/null; then
        text+=$'\n'$(grep -E -A 20 'BUG:|Oops|general protection|Kernel panic|blocked for more than' "$out/kernel.log" | head -n 40)$'\n'"FAIL $n: the kernel is unwell"
    fi
    p=$(grep -c '^PASS ' <<< "$text"); f=$(grep -c '^FAIL ' <<< "$text"); k=$(grep -c '^SKIP ' <<< "$text")
    if [ $rc -eq 77 ] && [ $((p + f + k)) -eq 0 ]; then
        k=1; text="SKIP $n ($(tail -n 1 <<< "$text"))"
    elif [ $rc -ne 0 ] && [ "$f" -eq 0 ]; then
        f=1; text+=$'\n'"FAIL $n: exit $rc"
    elif [ $((p + f + k)) -eq 0 ]; then
        f=1; text+=$'\n'"FAIL $n: says neither PASS nor FAIL nor SKIP"
    fi
    pass=$((pass + p)); fail=$((fail + f)); skip=$((skip + k))
    if [ "$f" -gt 0 ]; then tail -n 80 <<< "$text"; else grep -E '^(PASS|SKIP|figures) ' <<< "$text"; fi
    echo "     $n: $((SECONDS - t0)) s"
}
for s in "${scripts[@]}"; do one "$s"; done
finish
