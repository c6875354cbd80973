#!/bin/bash
# `pyrovox demo`, small: rates, error, picture, result line, and nobody left behind.
name=060
. "$(dirname "$0")/lib.sh"
needs_private_net
small="--cameras 4 --size 160x120 --grid 24 --fps 10"
export TMPDIR=$dir # run folders of the demo go there, so that what is left can be told by name
nobody() { ! grep -qs -- "$dir/pyrovox-demo" /proc/[0-9]*/cmdline; }

run() { timeout "$patience" "$pyrovox" demo $small --seconds 5 --out "$dir" > "$dir/demo.log" 2> "$dir/demo.err.log"; }
check runs run
right() {
    tail -n 1 "$dir/demo.log" | "$py" -c 'import json, sys
line = sys.stdin.read(); assert line.startswith("result: "), line
r = json.loads(line[8:]); print("  ", r)
assert list(r) == ["sets", "sets_per_s", "lost", "latency_ms_p50", "latency_ms_p99", "rel_error"]
assert r["sets"] > 0 and r["sets"] + r["lost"] > 20 and 0 < r["sets_per_s"] < 12 and 0 < r["latency_ms_p50"] <= r["latency_ms_p99"] and 0 < r["rel_error"] < 0.5'
}
check result-line right
check folder-is-removed [ -z "$(ls -d "$dir"/pyrovox-demo-* 2>/dev/null)" ]
check picture test -s "$dir/flame.png"
check lines-while-it-runs grep -q 'sets/s.*error' "$dir/demo.log"

page() { # beside it, as long as it runs
    start view.log "$pyrovox" demo $small --view --out "$dir/three"
    local demo=$started url
    wait_for grep -q '^page: http' "$dir/view.log" || return 1
    url=$(sed -n 's/^page: //p' "$dir/view.log"); url=${url#http://}
    timeout "$patience" "$py" tests/view/bridge.py volume "${url%%/*}" "${url#*#}" || return 1
    kill -INT "$demo"; ended "$demo" 0 && nobody
}
check page-beside-it page
start stop.log "$pyrovox" demo $small --out "$dir/two" --keep
demo=$started
wait_for grep -q 'sets/s' "$dir/stop.log"
kill -INT "$demo"
check ctrl-c-ends-it ended "$demo" 0
check with-a-result grep -q '^result: ' "$dir/stop.log"
check nobody-is-left nobody
check folder-is-kept-on-request bash -c "ls '$dir'/pyrovox-demo-*/rig.yaml > /dev/null"

start kill.log "$pyrovox" demo $small --out "$dir/three" --keep
demo=$started
wait_for grep -q 'sets/s' "$dir/kill.log"
kill -KILL "$demo"; wait "$demo" 2>/dev/null
check killed-takes-the-others-along wait_for nobody
exit $rc
