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

# ---- virtual USB cameras (vm_uvccams); the script needs "# vm-modprobe: vhci-hcd" and "... uvcvideo" ----------
uvc_nodes() { # /dev/video of camera 0, 1, ... that are there; a camera's second node has no pictures
    local v
    for v in /sys/class/video4linux/video*; do
        [ "$(cat "$v/index" 2>/dev/null)" = 0 ] && echo "$(cat "$v/device/../serial") /dev/${v##*/}"
    done 2>/dev/null | sort | sed 's/.* //'
}
uvc_there() { [ "$(uvc_nodes | wc -l)" = "$1" ]; }
uvc_start() { # folder of images, number of cameras, options...: until they can be opened
    local images=$1 n=$2; shift 2
    rm -f "$dir/orders"; mkfifo "$dir/orders"
    PYROVOX_LIBDIR=$b/lib "$vm/vm_uvccams" "$@" "$images" < "$dir/orders" > "$dir/uvccams.log" 2>&1 &
    uvc=$!
    pids+=("$uvc")
    exec 8> "$dir/orders"
    wait_for 60 uvc_there "$n" || { cat "$dir/uvccams.log"; return 1; }
}
uvc_order() { # an order to the cameras, until it is answered
    local before; before=$(grep -cE '^(ok|no)' "$dir/uvccams.log")
    echo "$*" >&8
    answered() { [ "$(grep -cE '^(ok|no)' "$dir/uvccams.log")" -gt "$before" ]; }
    wait_for 20 answered && [ "$(grep -E '^(ok|no)' "$dir/uvccams.log" | tail -n 1)" = ok ]
}
uvc_stat() { # camera, word: its number in the statistics
    uvc_order stats && grep "^camera $1 " "$dir/uvccams.log" | tail -n 1 | sed "s/.* $2 \([0-9-]*\).*/\1/"
}
uvc_stop() { exec 8>&-; wait "$uvc"; }
