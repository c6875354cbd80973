# lib.sh - shared by the scripts that run inside the virtual machine; sourced after `name` was set.
# What tests/system/lib.sh has (check, wait_for, config, start, status, field, ended), and what a guest alone needs.
. "$(dirname "${BASH_SOURCE[0]}")/../../system/lib.sh"
[ -n "${VM_SLOW:-}" ] || { echo "runs inside the virtual machine: tests/vm/run.sh -- $0"; exit 77; }
vm=$b/tests/vm # the programs of tests/vm/vm_*.c
export PYROVOX_LIBDIR=$b/lib/pyrovox

# Relay the PASS/FAIL/SKIP lines of a test program, and its exit status.
program() { # name, arguments...
    local t=$1; shift
    timeout -k 5 "$patience" "$vm/$t" "$@"
    local got=$?
    [ $got = 0 ] || { rc=1; [ $got = 1 ] || echo "FAIL $name:$t: exit $got"; }
}

# ---- libcamera ----------------------------------------------------------------------------------------------
# Debian's udevd, unpacked beside the kernel: libcamera lists devices that it has initialised and learns from it
# what is plugged and pulled.  No rules: they would name links and modes that nothing here needs.
udevd_start() {
    local u=$b/vm/udev
    export LD_LIBRARY_PATH=$u/usr/lib/x86_64-linux-gnu/systemd:$u/lib/x86_64-linux-gnu/systemd
    mkdir -p /run/udev "$dir/no-rules"
    mount --bind "$dir/no-rules" /lib/udev/rules.d 2> "$dir/mount.log"
    cp "$u/bin/udevadm" "$dir/systemd-udevd"
    start udevd.log "$dir/systemd-udevd" --children-max=4
    wait_for test -S /run/udev/control
    "$u/bin/udevadm" trigger --subsystem-match=video4linux --subsystem-match=media --action=add > "$dir/trigger.log" 2>&1
    unset LD_LIBRARY_PATH
}
# libcamera's handler of USB cameras names them after the first ancestor that firmware knows; the virtual
# controller has none, so the root of /sys gets a name (an overlay of mounts: sysfs itself cannot be written).
fake_firmware() {
    local d sys=/run/fake-sys # not below $dir, which is removed at the end
    mkdir -p "$sys" && mount -t tmpfs sys "$sys" || return 1
    for d in /sys/*; do mkdir "$sys/${d##*/}" && mount --rbind "$d" "$sys/${d##*/}" || return 1; done
    mkdir "$sys/firmware_node" && echo '\_SB_.VHCI' > "$sys/firmware_node/path" && mount --rbind "$sys" /sys
}

# ---- virtual USB cameras (vm_uvccams); the script needs "# vm-modprobe: vhci-hcd" and "... uvcvideo" ----------
uvc_pictures() { # folder, cameras: 4 pictures of 160x120 grey bytes for each, .npy, all different
    "$py" - "$1" "$2" << 'PY'
import os, sys
head = b"{'descr': '|u1', 'fortran_order': False, 'shape': (120, 160), }"
for cam in range(int(sys.argv[2])):
    os.makedirs('%s/cam%d' % (sys.argv[1], cam))
    for k in range(4):
        with open('%s/cam%d/%06d.npy' % (sys.argv[1], cam, k), 'wb') as f:
            f.write(b'\x93NUMPY\1\0\x76\0' + head.ljust(117) + b'\n' + bytes((x * (cam + 2) + y * (k + 1)) & 255 for y in range(120) for x in range(160)))
PY
}
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
    "$vm/vm_uvccams" "$@" "$images" < "$dir/orders" > "$dir/uvccams.log" 2>&1 &
    uvc=$!
    pids+=("$uvc")
    exec 8> "$dir/orders"
    wait_for uvc_there "$n" || { cat "$dir/uvccams.log"; return 1; }
}
uvc_order() { # an order to the cameras, until it is answered
    local before; before=$(grep -cE '^(ok|no)' "$dir/uvccams.log")
    echo "$*" >&8
    answered() { [ "$(grep -cE '^(ok|no)' "$dir/uvccams.log")" -gt "$before" ]; }
    wait_for answered && [ "$(grep -E '^(ok|no)' "$dir/uvccams.log" | tail -n 1)" = ok ]
}
uvc_stat() { # camera, word: its number in the statistics
    uvc_order stats && grep "^camera $1 " "$dir/uvccams.log" | tail -n 1 | sed "s/.* $2 \([0-9-]*\).*/\1/"
}
uvc_stop() { exec 8>&-; wait "$uvc"; }

# ---- systemd ------------------------------------------------------------------------------------------------
# The first process of a PID namespace, for the machine's own is a shell; `in_it COMMAND` runs beside it.
systemd_start() {
    [ -x /lib/systemd/systemd ] || { echo "no systemd here: apt-get install systemd"; exit 77; }
    unset PYROVOX_LIBDIR PYROVOX_CACHE
    local units=/etc/systemd/system
    # nothing of this machine's own, nor what an emulated one takes minutes for (hardware database, ld.so.cache)
    mv $units /run/units && mkdir $units
    rm -rf /lib/systemd/system/{sysinit,local-fs,sockets,timers,multi-user}.target.wants
    printf '[Unit]\nRequires=systemd-journald.socket\nWants=systemd-journald.service\n' > $units/pyrovox-test.target
    mount -t cgroup2 cgroup2 /sys/fs/cgroup
    # Ends with the machine: unshare takes no signal.  Mounts are shared as systemd has them outside of containers:
    # that is how credentials get to their service.
    unshare --pid --fork --kill-child --propagation shared --mount-proc env -i PATH="$PATH" container=vm /lib/systemd/systemd --unit=pyrovox-test.target > "$dir/systemd.log" 2>&1 &
    outer=$!
    check systemd_runs wait_for booted || { cat "$dir/systemd.log"; exit 1; }
}
in_it() { timeout -k 5 "$patience" nsenter -t "$(pgrep -P "$outer")" -p -m "$@"; }
booted() { [ -S /run/systemd/private ] && in_it systemctl list-units > /dev/null; }

# ---- the packages of `make test-deb` --------------------------------------------------------------------------
packages_start() {
    [ -d "$b/deb-test/2" ] || { echo "no packages here: make test-deb"; exit 77; }
    export DEBIAN_FRONTEND=noninteractive
    rm -f /usr/sbin/policy-rc.d # containers have one that starts no service
    # dpkg would read the list of files of every package here, through an emulated machine: it is told what is installed, no more
    export DPKG_ADMINDIR=/var/lib/dpkg-test
    mkdir -p $DPKG_ADMINDIR/{info,updates,triggers} && cp /var/lib/dpkg/status $DPKG_ADMINDIR/
    systemd_start
}
packages() { # 1 or 2
    in_it dpkg --force-unsafe-io -i "$b/deb-test/$1"/pyrovox{,-view}_*.deb > "$dir/dpkg-$1.log" 2>&1 || { cat "$dir/dpkg-$1.log"; return 1; }
}
packaged_daemon() { # that records what simulated cameras see
    cp tests/data/rig4.yaml /etc/pyrovox/rig.yaml
    cat > /etc/pyrovox/pyrovoxd.yaml << 'Y'
rig: rig.yaml
cameras: "sim:"
fps: 5
record: { mode: raw, path: "/var/lib/pyrovox/%Y%m%d-%H%M%S.h5" }
Y
}
value() { in_it systemctl show -P "$1" "${2:-pyrovoxd}"; }
is() { [ "$(value "$1" "${3:-}")" = "$2" ]; }
takes() { find /var/lib/pyrovox -name '*.h5' | sort; }
first_take_is_closed() { pyrovox replay --info "$(takes | head -n 1)" | grep -q 'closed in order'; }
records() { in_it pyrovox status --json 2> /dev/null | "$py" -c 'import json, sys; sys.exit(json.load(sys.stdin)["record"]["sets"] < 5)' 2> /dev/null; }
ends() { in_it journalctl --no-pager -q -o cat -u pyrovoxd | grep -c 'stopping: terminated'; }
