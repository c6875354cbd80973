#!/bin/bash
# A trigger by an input line of a camera, with cameras of the real GigE Vision protocol.  They expose only at pulses that
# this test orders, so it is known which frame is the first with the line high: its exposure is the instant.  Then pulses
# come at 20 Hz, and the take is whole (ring.py).
name=107
. "$(dirname "$0")/lib.sh"
needs_private_net
if [ -z "${ORDERS:-}" ]; then # once more, in a network of its own, with a way to tell the cameras something
    export ORDERS=$dir/orders; mkfifo "$ORDERS"
    timeout 3000 "$pyrovox" simcams --rig tests/data/rig4.yaml --ring 10 --fps 20 --private-net --control -- bash "$0" 0<> "$ORDERS" | tee "$dir/said"
    rc=${PIPESTATUS[0]}; exit $rc
fi
order() { printf '%s\n' "$@" > "$ORDERS"; }
line() { # camera
    config r.yaml <<EOT
cameras: {$1}
fps: 20
trigger: line
shared_clock: true
sync: { policy: partial }
solver: { deadline_ms: 0 }
record: { path: takes/%Y.h5, keep_free_gb: 0, ring: { seconds: 3, memory: 200MB } }
triggers: [{ name: spark, when: line, camera: cam2, line: 1, pre: 0.6, post: 0.4, hold_off: 0 }]
EOT
}
pulsed() { order pulse; "$@"; }
fired() { field "s['triggers'][0]['fired'] == $1"; }
level() { field "s['triggers'][0]['value'] == $1"; }
taken() { field "s['ring']['takes'] + s['ring']['extended'] == $1 and not s['ring']['writing'] and s['ring']['failed'] == 0"; }
obeyed() { order stats; wait_for grep -q '^stats' "${ORDERS%/*}/said"; } # the cameras have done all orders before this one

line 'cam0: "aravis:127.0.0.2", cam1: "aravis:127.0.0.3", cam2: "aravis:127.0.0.4", cam3: "aravis:127.0.0.5"'
start d.log "$pyrovoxd" --config "$dir/r.yaml"; daemon=$started
start heard.log listen
check low wait_for pulsed level 0
check runs wait_for pulsed heard volume
check pulses-are-over obeyed
before=$(date +%s%N)
order 'inputs cam2 2'
check fires wait_for pulsed fired 1
check level level 1
words() { run "$pyrovox" status --endpoint "$control"; says 0 'spark: line high, fired 1 times'; }
check in-words words
check is-published wait_for heard "'name': 'spark', 'when': 'line'"
check is-written wait_for pulsed taken 1
instant() { # of the only event: the exposure of the first frame of cam2 after it was told
    "$py" - "$before" "$dir/heard.log" "$dir"/takes/spark-*.h5 <<'PY'
import ast, sys, h5py
before, heard, take = sys.argv[1:]
event = [ast.literal_eval(x.split(" ", 1)[1]) for x in open(heard) if "'kind': 'trigger'" in x]
with h5py.File(take, "r") as f:
    t = f["cameras/cam2/index"]["t_exposure_ns"]
    row = f["triggers"][0]
    first = min(x for x in t if x > int(before))
    print(" ", event, int(first), t.min() < first, row)
    sys.exit(not (len(event) == 1 and event[0]["t_ns"] == first == row["t_ns"] and t.min() < first and row["latency_ns"] > 0
                  and event[0]["t_from_ns"] == first - 600000000 and event[0]["t_to_ns"] == first + 400000000))
PY
}
check instant-is-the-first-frame instant
order 'inputs cam2 0' 'inputs cam1 2' 'line 20' # the line of another camera
check falls wait_for level 0
check flows wait_for published $(($(sets) + 25))
check not-another-camera fired 1
rm -r "$dir/takes"
order 'inputs cam2 3' # beside another line
check fires-again wait_for fired 2
check all-written wait_for taken 2
kill -INT "$daemon"
check ends ended "$daemon" 0
check account "$py" tests/system/ring.py "$dir"/takes/spark-*.h5

refused() { # text, cameras
    line "$2"
    run "$pyrovoxd" --config "$dir/r.yaml" --check-config
    says 1 "$1"
}
check no-line refused "triggers: spark: cam2 is 'sim:', and only aravis: cameras" 'cam0: "sim:", cam1: "sim:", cam2: "sim:", cam3: "sim:"'
exit $rc
