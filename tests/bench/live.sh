#!/bin/bash
# The live bench: 8 simulated GigE Vision cameras, 640x480 RGB, 64^3 voxels, measured against the target.
#   live.sh BUILD        LIVE_SECONDS=120 LIVE_FPS=20
set -u
cd "$(dirname "$0")/../.."
b=${1:-build}
seconds=${LIVE_SECONDS:-120} fps=${LIVE_FPS:-20}
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
"$b/bin/pyrovox" demo --seconds "$seconds" --fps "$fps" --out "$out" > "$out/log" || { tail -n 5 "$out/log"; exit 1; }
line=$(grep '^result: ' "$out/log" | tail -n 1)
get() { sed -n "s/.*\"$1\":\([0-9.]*\).*/\1/p" <<< "$line"; }
limit=$(awk "BEGIN { print 2000 / $fps }")
echo "| live, 8 x 640x480 RGB8 over GigE Vision, 64^3, $seconds s at $fps Hz | measured | target |"
echo "|---|---|---|"
printf '| volumes per second | %s | >= 15 |\n' "$(get sets_per_s)"
printf '| sets lost, of %s | %s | 0 |\n' "$(get sets)" "$(get lost)"
printf '| latency p50, last frame received to sent | %s ms | |\n' "$(get latency_ms_p50)"
printf '| latency p99 | %s ms | < %s ms (two periods) |\n' "$(get latency_ms_p99)" "$limit"
printf '| error against the known flame, relative L2 | %s | |\n' "$(get rel_error)"
