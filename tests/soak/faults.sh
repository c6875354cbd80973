#!/bin/bash
# N faults in random order before the built daemon, on a machine whose processors are busy: cameras, their
# clocks and packets, the switch, the disk and the subscribers.  It must live and not grow, and know
# what became of every set.
#   faults.sh BUILD [N]      SEED=n
set -u
export PYROVOX_BUILD; PYROVOX_BUILD=$(realpath "${1:-build}")
# a disk of its own that can be full
[ -n "${PYROVOX_SOAK_DISK:-}" ] || PYROVOX_SOAK_DISK=$(mktemp -d) exec unshare -rm "$0" "$@"
trap 'rmdir "$PYROVOX_SOAK_DISK"' EXIT
mount -t tmpfs -o size=64m none "$PYROVOX_SOAK_DISK" || exit 77
trap 'umount "$PYROVOX_SOAK_DISK"; rmdir "$PYROVOX_SOAK_DISK"' EXIT
name=faults
n=${2:-1000} seed=${SEED:-$RANDOM} disk=$PYROVOX_SOAK_DISK
. "$(dirname "$0")/../system/lib.sh"
trap 'finish; umount "$disk"; rmdir "$disk"' EXIT
config run.yaml <<< "cameras: \"aravis:127.0.0.2+\"
fps: 20
pixel_format: RGB8
sync: {policy: solve-with-what-is-there, min_cameras: 1}
gige: {packet_size: 1400}
photometry: {black: 0.02}
record: {keep_free_gb: 0, sync_s: 0.2}"
mkfifo "$dir/orders"
"$pyrovox" simcams --private-net --rig tests/data/rig4.yaml --fps 20 --ring 20 --boot-clock --control -- \
    "$pyrovoxd" --config "$dir/run.yaml" > "$dir/daemon.log" 2>&1 < "$dir/orders" &
sim=$!
pids+=("$sim")
for ((i = 0; i < $(nproc); i++)); do start "load$i" bash -c 'while :; do :; done'; done
echo "machine: $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1), $(nproc) CPUs, all busy; $n faults, seed $seed"
"$py" tests/soak/faults.py "$control" "$volumes" "$dir/orders" "$disk" "$sim" "$n" "$seed" || rc=1
"$pyrovox" status --endpoint "$control" --stop > /dev/null
check ends ended "$sim" 0
exit $rc
