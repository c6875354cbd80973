#!/bin/bash
# Eight simulated GigE Vision cameras, 640x480 RGB8 at 30 Hz, for long: first as they should be, then with drifting clocks,
# late deliveries and dropped frames.  Truth is in the images.
#   soak.sh BUILD [SECONDS]      SOAK_FPS=30 SOAK_CAMERAS=8
set -u
cd "$(dirname "$0")/../.."
b=$(realpath "${1:-build}") seconds=${2:-600} fps=${SOAK_FPS:-30} n=${SOAK_CAMERAS:-8}
export PYROVOX_LIBDIR=$b/lib/pyrovox
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
rc=0
run() { # TITLE SIMCAMS-OPTIONS... -- SOAK-OPTIONS...
    local title=$1 sim=()
    shift
    while [ "$1" != -- ]; do sim+=("$1"); shift; done
    shift
    echo
    echo "## $title"
    "$b/bin/pyrovox" simcams --private-net --cameras "$n" --fps "$fps" --ring 30 "${sim[@]}" -- \
        "$b/tests/soak/soak" --fps "$fps" --cameras "$n" "$@" "$dir/frames" || rc=1
}
echo "machine: $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1), $(nproc) CPUs"
"$b/bin/pyrovox" simcams --cameras "$n" --fps "$fps" --ring 30 --write-frames "$dir/frames" > /dev/null || exit 1
run "$n x 640x480 RGB8 at $fps Hz, $seconds s" -- --seconds "$seconds"
drift=()
for ((c = 0; c < n; c++)); do
    drift+=(--set "drift cam$c $(((c * 200 / (n > 1 ? n - 1 : 1)) - 100))")
done
half=$(awk "BEGIN { print $seconds / 2 }")
run "the same with 1 ms jitter, clocks 100 ppm fast to 100 ppm slow, 5 % of the frames dropped, $half s" \
    --set "jitter all 1" "${drift[@]}" --set "drop all 0.05" -- --seconds "$half" --drops
exit $rc
