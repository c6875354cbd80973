#!/bin/bash
# Eight GigE Vision cameras before the built daemon for hours, with faults in random order: cameras, their clocks and
# packets, the switch, a disk that fills and empties under recordings that roll over, subscribers that come and go.
# It must live and not grow, and know what became of every set.
#   hours.sh BUILD HOURS      SEED=n; BUSY=1: every processor of the machine is busy as well; FPS=n (10);
#                         FASTER=n: n times as many faults in a time, each shorter
set -u
export PYROVOX_BUILD; PYROVOX_BUILD=$(realpath "${1:-build}")
# a disk of its own that can be full
[ -n "${PYROVOX_SOAK_DISK:-}" ] || PYROVOX_SOAK_DISK=$(mktemp -d) exec unshare -rm "$0" "$@"
trap 'rmdir "$PYROVOX_SOAK_DISK"' EXIT
mount -t tmpfs -o size=512m none "$PYROVOX_SOAK_DISK" || exit 77
trap 'umount "$PYROVOX_SOAK_DISK"; rmdir "$PYROVOX_SOAK_DISK"' EXIT
name=soak
hours=${2:-24} seed=${SEED:-$RANDOM} fps=${FPS:-10} disk=$PYROVOX_SOAK_DISK
. "$(dirname "$0")/../system/lib.sh"
trap 'finish; umount "$disk"; rmdir "$disk"' EXIT
out=$PYROVOX_BUILD/soak; mkdir -p "$out"
out=$out/$(date +%Y%m%d-%H%M%S)
"$pyrovox" simcams --cameras 8 --size 160x120 --voxels 32 --ring 1 --write-rig "$dir/rig.yaml" --write-frames "$dir/frames" > /dev/null 2>&1 || exit 1
config run.yaml <<< "cameras: \"aravis:127.0.0.2+\"
fps: $fps
pixel_format: RGB8
sync: {policy: solve-with-what-is-there, min_cameras: 1}
gige: {packet_size: 1400}
photometry: {black: 0.02}
record: {mode: raw, volumes: hdf5, roll_s: 15, keep_free_gb: 0.03, sync_s: 0.2, path: \"$disk/raw-%H%M%S.h5\", volumes_path: \"$disk/volumes-%H%M%S\"}"
sed -i "s|^rig: .*|rig: $dir/rig.yaml|" "$dir/run.yaml"
mkfifo "$dir/orders"
"$pyrovox" simcams --private-net --rig "$dir/rig.yaml" --fps "$fps" --ring 20 --boot-clock --control -- \
    "$pyrovoxd" --config "$dir/run.yaml" > "$out.log" 2>&1 < "$dir/orders" &
sim=$!
pids+=("$sim")
for ((i = 0; i < ${BUSY:-0} * $(nproc); i++)); do start "load$i" bash -c 'while :; do :; done'; done
echo "machine: $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1), $(nproc) CPUs${BUSY:+, all busy}; $hours h, 8 x 160x120 RGB8 at $fps Hz, seed $seed; log $out.log"
start view.log "$pyrovox" view --endpoint "$volumes" --listen 127.0.0.1:0; view=$started
wait_for grep -q '#' "$dir/view.log" || exit 1
PYTHONPATH=proto/clients:tests/view "$py" tests/soak/hours.py "$control" "$volumes" "$dir/orders" "$disk" "$sim" "$view" "$(grep -m1 "#" "$dir/view.log")" "$hours" "$seed" "$out" || rc=1
"$pyrovox" status --endpoint "$control" --stop > /dev/null
check ends ended "$sim" 0
exit $rc
