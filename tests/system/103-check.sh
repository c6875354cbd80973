#!/bin/bash
# Do pictures and rig belong together, asked while the daemon runs: the same cameras with their rig, and with a rig in
# which two of them have each other's pose.
name=103
. "$(dirname "$0")/lib.sh"
needs_private_net
"$pyrovox" simcams --cameras 6 --size 160x120 --write-rig "$dir/rig.yaml" > "$dir/rig.log" 2>&1
sed 's/name: cam1$/name: cam9/; s/name: cam2$/name: cam1/; s/name: cam9$/name: cam2/' "$dir/rig.yaml" > "$dir/swapped.yaml"
live() { # rig: cameras and a daemon
    { echo "rig: $dir/$1.yaml"
      echo "cameras: {cam0: 'aravis:127.0.0.2', cam1: 'aravis:127.0.0.3', cam2: 'aravis:127.0.0.4', cam3: 'aravis:127.0.0.5', cam4: 'aravis:127.0.0.6', cam5: 'aravis:127.0.0.7'}"
      echo "publish: {endpoints: ['$volumes']}"
      echo "control: {endpoint: '$control'}"
      echo "fps: 5"
      echo "photometry: {black: 0.02}"
      echo "pixel_format: RGB8"
      echo "shared_clock: true"
    } > "$dir/$1-daemon.yaml"
    start "$1.log" "$pyrovox" simcams --private-net --rig "$dir/rig.yaml" --fps 5 --ring 40 -- "$pyrovoxd" --config "$dir/$1-daemon.yaml"
    cameras=$started
    check "$1-runs" wait_for published 5
}
verdict() { # exit code, text
    run "$pyrovox" ctl --control "$control" check
    says "$1" "$2"
}
last() { "$pyrovox" status --endpoint "$control" | tail -n 1 | grep -q -- "$1"; }
stop() {
    check "$1-stops" "$pyrovox" status --endpoint "$control" --stop
    check "$1-ends" ended "$cameras" 0
}

live rig
check healthy-is-good verdict 0 'good: residual '
check and-says-what-is-outside verdict 0 '% of the light outside the volume, left-out pictures are missed by '
check status-is-good wait_for last '^good: residual .* 6 cameras agree, '
check in-the-status field "s['belong']['good'] and s['belong']['judged'] > 0 and s['last']['noise'] > 0"
check record "$pyrovox" record --endpoint "$volumes" --volumes 60 --out "$dir/rec" > "$dir/record.log" 2>&1
check record-ends-with-it grep -qE '^(good|fair|bad): ' "$dir/record.log"
stop rig

live swapped
check swapped-is-named verdict 1 'bad: left-out pictures are missed by '
check with-its-cameras says 1 'the pictures of cam2 and cam1 are swapped; next: exchange what rig.yaml says of '
check status-names-them wait_for last 'the pictures of cam2 and cam1 are swapped; next: '
check and-which-cameras field "s['belong']['cause'] == 'swapped' and s['belong']['cameras'] == ['cam2', 'cam1']"
run "$pyrovox" status --endpoint "$control" --exit-code
check status-exits-with-1 says 1 'are swapped'
stop swapped
exit $rc
