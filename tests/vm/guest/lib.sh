# lib.sh - shared by the scripts that run inside the virtual machine; sourced after `name` was set.
# What tests/system/lib.sh has (check, wait_for, config, start, status, field, ended), with limits that
# grow with VM_SLOW, and what a guest alone needs.
. "$(dirname "${BASH_SOURCE[0]}")/../../system/lib.sh"
[ -n "${VM_SLOW:-}" ] || { echo "runs inside the virtual machine: tests/vm/run.sh -- $0"; exit 77; }
vm=$b/tests/vm # the programs of tests/vm/vm_*.c

# Emulated, everything takes several times as long as outside; on a busy machine VM_SLOW times that.
patient() { awk -v s="$1" -v f="$VM_SLOW" 'BEGIN { printf "%d\n", s * f + 0.999 }'; }
wait_for() { # seconds on a quiet machine, command...: until it succeeds
    local end=$((SECONDS + $(patient "$1") * 3)); shift
    until "$@"; do [ $SECONDS -lt $end ] || return 1; sleep 0.2; done
}
# Relay the PASS/FAIL/SKIP lines of a test program, and its exit status.
program() { # seconds, name, arguments...
    local limit; limit=$(patient "$1"); shift
    local t=$1; shift
    timeout -k 5 $((limit * 3)) "$vm/$t" "$@"
    local got=$?
    [ $got = 0 ] || { rc=1; [ $got = 1 ] || echo "FAIL $name:$t: exit $got"; }
}
