#!/bin/bash
# The daemon with simulated cameras over the real GigE Vision protocol; one of them dies and comes back.
name=050
. "$(dirname "$0")/lib.sh"
needs_private_net
config a.yaml <<< $'cameras: "aravis:127.0.0.2+"\nfps: 15\npixel_format: RGB8\nshared_clock: true\nsync: {policy: partial, min_cameras: 3}\nphotometry: {black: 0.02}'
mkfifo "$dir/orders"
"$pyrovox" simcams --private-net --rig tests/data/rig4.yaml --fps 15 --ring 15 --control -- \
    "$pyrovoxd" --config "$dir/a.yaml" > "$dir/sim.log" 2>&1 < "$dir/orders" &
sim=$!
pids+=("$sim")
exec 9> "$dir/orders"

check volumes-are-published wait_for published 20
check all-cameras-run wait_for field "all(c['state'] == 'running' and c['fps'] > 5 for c in s['cameras'])"
check sets-are-whole wait_for field "s['last']['cameras'] == 4 and s['last']['active_voxels'] > 50"
check top-knows-the-truth says_soon 'error 0\.[0-4]' "$pyrovox" top --endpoint "$volumes" --truth 1,1,15

echo "kill cam2" >&9
check lost-camera-is-named wait_for field "s['cameras'][2]['state'] != 'running' and s['cameras'][2]['error'] != ''"
n=$(sets)
check others-go-on wait_for published $((n + 20))
check with-three-cameras field "s['last']['cameras'] == 3"
echo "revive cam2" >&9
check comes-back wait_for field "s['cameras'][2]['state'] == 'running' and s['last']['cameras'] == 4"
check consistent field "s['sets']['produced'] == s['sets']['published'] + s['sets']['dropped'] + s['sets']['inside']"
check stop-command "$pyrovox" status --endpoint "$control" --stop
check both-end ended "$sim" 0
exec 9>&-
exit $rc
