#!/bin/bash
# A rig that is wrong on a Tuesday: the built daemon before six cameras of the real GigE Vision protocol, one of which
# is capped, bumped, flooded, late and so on, by hand while it runs.  Whatever it is, sets go on, the figures of
# the solve say that something is wrong, and all is as before once it was taken back.
name=056
. "$(dirname "$0")/lib.sh"
sim() { timeout 300 "$pyrovox" simcams --private-net --cameras 6 --size 80x60 --voxels 24 --fps 20 --ring 20 "$@"; }
if ! sim --write-rig "$dir/rig.yaml" -- true > "$dir/try.txt" 2>&1; then
    echo "no private network here: $(grep pyrovox "$dir/try.txt" | tail -n 1)"; exit 77
fi
{ echo "rig: $dir/rig.yaml"
  echo "publish: {endpoints: [\"$volumes\"], sample: f32}"
  echo "control: {endpoint: \"$control\"}"
  echo $'cameras: "aravis:127.0.0.2+"\nfps: 20\npixel_format: RGB8\nshared_clock: true\nphotometry: {black: 0.02}'
} > "$dir/run.yaml"

# What is wrong (recon/vote/wrong.h), the orders that make it so, and those that take it back.
tuesday() {
    wrong dark      'cap cam3 on'        'cap cam3 off'
    wrong moved     'shift cam3 8:0'     'shift cam3 0:0'
    wrong gain      'gain cam3 0.5'      'gain cam3 1'
    wrong flooded   'flood cam3 on'      'flood cam3 off'
    wrong late      'late cam3 3'        'late cam3 0'
    wrong late      'still cam3 on'      'still cam3 off'
    wrong mirrored  'mirrored cam3 on'   'mirrored cam3 off'
    wrong blurred   'blur cam3 4'        'blur cam3 0'
}
order() { echo "$1" >&5; }
residual() { status | "$py" -c 'import json, sys; print(json.load(sys.stdin)["last"]["rel_residual"])'; }
worst_residual() { # of three periods of the ring
    local n; n=$(sets)
    until published $((n + 60)); do residual; done | sort -g | tail -n 1
}
amiss() { field "s['last']['status'] == 'empty' or s['last']['saturated'] > 0 or s['last']['rel_residual'] > 1.2 * $healthy"; }
well() { field "s['last']['status'] == 'converged' and s['last']['cameras'] == 6 and s['last']['saturated'] == 0 and 0 < s['last']['rel_residual'] < 1.1 * $healthy"; }
more() { published $((at + 20)); }
wrong() { # what, order, order that takes it back
    order "$2"
    check "$1: the figures say so ($2)" wait_for amiss
    at=$(sets)
    check "$1: sets go on ($2)" wait_for more
    check "$1: and are finite" field "s['last']['not_finite'] == 0"
    order "$3"
    check "$1: as before ($3)" wait_for well
}

mkfifo "$dir/orders"
"$pyrovox" simcams --private-net --rig "$dir/rig.yaml" --fps 20 --ring 20 --control -- \
    "$pyrovoxd" --config "$dir/run.yaml" > "$dir/run.log" 2>&1 < "$dir/orders" &
daemon=$!
pids+=("$daemon")
exec 5> "$dir/orders"
check starts wait_for field "s['sets']['published'] >= 20 and s['last']['cameras'] == 6"
healthy=$(worst_residual)
tuesday
check one_life field "all(c['state'] == 'running' and c['counts']['lost_camera'] == 0 for c in s['cameras'])"
"$pyrovox" status --endpoint "$control" --stop > "$dir/null"
check ends ended "$daemon" 0
exit $rc
