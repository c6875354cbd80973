#!/bin/bash
# run.sh [-k MODULE-AND-OPTIONS]... [-s CPUS] [-M MIB] [-o DIR] [-v] -- COMMAND [ARGUMENT]...
# Run COMMAND as root in a small virtual machine: Debian's kernel, this machine's root filesystem below a
# scratch layer (what COMMAND writes is gone afterwards, except in /out), the current folder.  Its output
# comes out here, its exit status is this script's.
#   -k "vivid n_devs=2"   modprobe this before COMMAND; repeatable
#   -o DIR                folder of this machine that the guest sees as /out
#   -v                    the kernel's messages to standard error at the end
# 125: the machine failed before COMMAND ended; 124: it hung for an hour; 77: there can be no such machine
# here (one line on standard error says why).  VM_DIR holds the kernel (default: build/vm).
# In the guest VM_SLOW is how many times slower than a quiet machine this one is, at least 1.
set -u
root=$(cd "$(dirname "$0")/../.." && pwd)
usage() { sed -n '2,/^set/s/^# \?//p' "$0"; exit "$1"; }
cpus=2 memory=1536 out='' verbose='' modules=()
while getopts k:s:M:o:vh f; do case $f in
    k) modules+=("$OPTARG");; s) cpus=$OPTARG;; M) memory=$OPTARG;;
    o) out=$OPTARG;; v) verbose=1;; h) usage 0;; *) usage 2 >&2;; esac; done
shift $((OPTIND - 1))
[ $# -gt 0 ] || usage 2 >&2
no() { echo "$*" >&2; exit 77; }
for need in qemu-system-x86_64:qemu-system-x86 busybox:busybox-static depmod:kmod cpio:cpio; do
    command -v "${need%:*}" > /dev/null || PATH=$PATH:/usr/sbin:/sbin command -v "${need%:*}" > /dev/null ||
        no "no ${need%:*} here: apt-get install ${need#*:}"
done
export PATH=$PATH:/usr/sbin:/sbin
cache=${VM_DIR:-$root/build/vm}
version=$("$root/tests/vm/kernel.sh" "$cache") || exit 77
modroot=$cache/modules

w=$(mktemp -d "${TMPDIR:-/tmp}/pyrovox-vm-XXXXXX") || exit 125
qemu='' relay=''
end() { [ -n "$qemu" ] && kill -9 "$qemu" 2>/dev/null; [ -n "$relay" ] && kill "$relay" 2>/dev/null; wait 2>/dev/null; rm -rf "$w"; }
trap end EXIT
trap 'exit 130' INT; trap 'exit 143' TERM HUP
mkdir "$w/ctl"
[ -n "$out" ] || out=$w/out
mkdir -p "$out"

# ---- initramfs: busybox and the modules that lead to the root filesystem; made once ----------------------
initramfs=$cache/initramfs-$version.cpio
if [ ! -s "$initramfs" ] || [ "$0" -nt "$initramfs" ]; then
    r=$w/initramfs
    mkdir -p "$r"/{bin,mod,proc,sys,dev,lower,scratch,root}
    cp "$(command -v busybox)" "$r/bin/busybox"
    for m in virtio_pci virtio_console 9pnet_virtio 9p overlay; do
        modprobe -d "$modroot" -S "$version" --show-depends "$m" 2>/dev/null || echo "builtin $m"
    done | awk '$1 == "insmod" && !seen[$2]++ { print $2 }' > "$w/modules"
    while read -r f; do cp "$f" "$r/mod/" && basename "$f" >> "$r/mod/order"; done < "$w/modules"
    cat > "$r/init" << 'INIT'
#!/bin/busybox sh
b=/bin/busybox
$b mount -t proc proc /proc; $b mount -t sysfs sys /sys; $b mount -t devtmpfs dev /dev
fail() { echo "initramfs: $* failed"; $b poweroff -f; }
while read -r m; do $b insmod "/mod/$m" || fail insmod "$m"; done < /mod/order
share() { $b mount -t 9p -o "trans=virtio,version=9p2000.L,msize=1048576,$2" "$1" "$3"; }
share root ro,cache=loose /lower || fail mounting the root
$b mount -t tmpfs -o size=75% scratch /scratch; $b mkdir /scratch/upper /scratch/work
$b mount -t overlay -o lowerdir=/lower,upperdir=/scratch/upper,workdir=/scratch/work root /root || fail overlay
$b mkdir -p /root/vmctl /root/out /root/lib/modules
share ctl cache=none /root/vmctl || fail mounting vmctl
share out cache=none /root/out || fail mounting out
share modules ro,cache=loose /root/lib/modules || fail mounting modules
for d in proc sys dev; do $b mount --move /$d /root/$d; done
$b mount -t tmpfs run /root/run; $b mkdir -p /root/run/lock /root/dev/pts /root/dev/shm
$b mount -t devpts pts /root/dev/pts; $b mount -t tmpfs shm /root/dev/shm
exec $b switch_root /root /bin/bash /vmctl/stage2
INIT
    chmod +x "$r/init"
    (cd "$r" && find . | cpio -o -H newc --quiet) > "$initramfs.$$" && mv "$initramfs.$$" "$initramfs"
fi

# ---- what runs in the guest ------------------------------------------------------------------------------
{
    echo 'export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8'
    echo 'ip link set lo up; hostname vm'
    for v in PYROVOX_BUILD T_SEED; do [ -n "${!v:-}" ] && printf 'export %s=%q\n' "$v" "${!v}"; done
    echo 'port=/dev/vport0p1; for i in 1 2 3 4 5 6 7 8 9 10; do [ -e $port ] && break; sleep 0.1; done; [ -e $port ] || port=/dev/console'
    echo 'touch /vmctl/up; until [ -s /vmctl/slow ]; do sleep 0.05; done; export VM_SLOW=$(cat /vmctl/slow)'
    echo '('
    for m in "${modules[@]+"${modules[@]}"}"; do printf 'modprobe %s || { echo %q; exit 125; }\n' "$m" "modprobe $m failed"; done
    printf 'cd %q || exit 125\n' "$PWD"
    printf '%q ' "$@"
    echo; echo ') > $port 2>&1 < /dev/null'
    echo 'echo $? > /vmctl/rc; sync; /bin/busybox poweroff -f'
} > "$w/ctl/stage2"

# ---- boot ------------------------------------------------------------------------------------------------
# A /dev/kvm without vmx or svm is nested by software and cannot run a kernel of Debian's.
accel=tcg cpu=max
if [ -w /dev/kvm ] && grep -qwE 'vmx|svm' /proc/cpuinfo; then accel=kvm:tcg; fi
# A host that is busy stops the machine's clocks for a while: at boot that is no broken timer, later no lock-up.
patient="no_timer_check watchdog_thresh=60"
share() { echo -fsdev "local,id=$1,path=$2,security_model=none,multidevs=remap${3:-}" -device "virtio-9p-pci,fsdev=$1,mount_tag=$1"; }
mkfifo "$w/port"
cat "$w/port" & relay=$!
t0=${EPOCHREALTIME/[.,]/}
# shellcheck disable=SC2046 # share prints several words
qemu-system-x86_64 -M q35,accel=$accel -cpu $cpu -smp "$cpus" -m "$memory" -nodefaults -no-user-config -display none -no-reboot \
    -kernel "$cache/vmlinux" -initrd "$initramfs" -append "console=ttyS0 loglevel=6 panic=-1 mitigations=off random.trust_cpu=on $patient" \
    -serial "file:$w/kernel.log" -chardev "file,id=port,path=$w/port,append=on" -device virtio-serial-pci -device virtserialport,chardev=port,name=out \
    $(share root / ,readonly=on) $(share modules "$modroot/lib/modules" ,readonly=on) $(share ctl "$w/ctl") $(share out "$out") \
    < /dev/null 2> "$w/qemu.err" &
qemu=$!
us() { echo $((${EPOCHREALTIME/[.,]/} - t0)); }
wait_until() { # file: it appears, the machine ends, or it hangs (1)
    until [ -e "$1" ] || ! kill -0 $qemu 2>/dev/null; do
        [ "$(us)" -lt 3600000000 ] || return 1
        sleep 0.05
    done
}
quiet_boot=3500000 # us; measured with nothing else running on 2 cores without KVM
why=
wait_until "$w/ctl/up" || why="no userland after an hour"
boot=$(us)
if [ -z "$why" ]; then
    slow=$(((boot * 10 + quiet_boot - 1) / quiet_boot)) # in tenths, rounded up
    [ $slow -ge 10 ] || slow=10
    echo "$((slow / 10)).$((slow % 10))" > "$w/ctl/slow.new" && mv "$w/ctl/slow.new" "$w/ctl/slow"
    wait_until "$w/nothing" || why="no end after an hour"
fi
[ -z "$why" ] || kill -9 $qemu 2>/dev/null
wait $qemu 2>/dev/null; status=$?; qemu=
wait $relay; relay=
[ "$out" = "$w/out" ] || cp "$w/kernel.log" "$out/kernel.log"
[ -z "$verbose" ] || { cat "$w/kernel.log"; echo "userland after $((boot / 1000)) ms, end after $(($(us) / 1000)) ms"; } >&2
if [ -s "$w/ctl/rc" ]; then exit "$(cat "$w/ctl/rc")"; fi
{ tail -n 30 "$w/kernel.log"; tail -n 5 "$w/qemu.err"; echo "run.sh: ${why:-no exit status from the machine (QEMU: $status)}"; } >&2
[ -n "$why" ] && [ -e "$w/ctl/up" ] && exit 124
exit 125
