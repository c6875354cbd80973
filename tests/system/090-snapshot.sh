#!/bin/bash
# pyrovox ctl snapshot: a folder with a volume, the frames that it was made of and the status, which other commands read;
# the frames, reconstructed, give the volume again; nothing is lost by it; what cannot be is said.
name=090
. "$(dirname "$0")/lib.sh"
config a.yaml <<< $'cameras: "sim:"\nfps: 20\nlossless: true\nphotometry: {black: 0.02}
solver: {warm_start: off, deadline_ms: 0}\nrecord: {path: takes/%Y.h5, keep_free_gb: 0}'
start a.log "$pyrovoxd" --config "$dir/a.yaml"
daemon=$started
ctl() { run "$pyrovox" ctl --control "$control" "$@"; }
does() { local code=$1 text=$2; shift 2; ctl "$@"; says "$code" "$text"; }
check runs wait_for published 5
check by-name does 0 "$dir/takes/one" snapshot one
check by-path does 0 "$dir/far/away/two" snapshot "$dir/far/away/two"
check by-time does 0 "$dir/takes/snapshot-2" snapshot
none_lost() { local n; n=$(sets); wait_for published $((n + 5)) && field "s['sets']['dropped'] == 0 and s['sets']['displaced'] == 0"; }
check no-set-was-lost none_lost
two() { ls "$1"/[0-9]*.npy | wc -l | grep -qx 1 && ls "$1"/{recording.json,rig.yaml,config.yaml,status.json,raw.h5} > /dev/null; }
check holds-all two "$dir/takes/one"
check no-part-is-left [ -z "$(find "$dir" -name '*.part')" ]
again() { # the same volume out of the frames, of the same set
    local at=$1 v; v=$(basename "$at"/[0-9]*.npy .npy)
    run "$pyrovox" reconstruct --quiet --rig "$at/rig.yaml" --frames "$at/raw.h5" --black 0.02 --out "$at-again"
    says 0 || return 1
    "$py" - "$at" "$at-again" "$v" <<'PY'
import glob, json, os, sys
import numpy as np
a, b, v = sys.argv[1:]
assert [os.path.basename(p) for p in glob.glob(b + "/*.npy")] == [v + ".npy"], os.listdir(b)
x, y = np.load(f"{a}/{v}.npy"), np.load(f"{b}/{v}.npy")
assert x.shape == y.shape and x.any() and x.tobytes() == y.tobytes(), np.abs(x - y).max()
about, status = json.load(open(f"{a}/{v}.json")), json.load(open(f"{a}/status.json"))
assert about["set"] == int(v) and about["cameras_present"] == 4 and about["sample"] == "float32", about
assert status["last"]["set"] >= about["set"], status["last"]
PY
}
check frames-give-the-volume-again again "$dir/takes/one"
check and-the-other-too again "$dir/far/away/two"
reads() { run "$pyrovox" "$@"; says 0; }
check convert-reads-it reads convert "$dir/takes/one" "$dir/one.h5"
info() { run "$pyrovox" replay --info "$dir/takes/one/raw.h5"; says 0 'closed in order'; }
check replay-reads-it info
check config-is-in-effect grep -q 'warm_start: off' "$dir/takes/one/config.yaml"

check there-already does 1 'is there already' snapshot one
check bad-name does 1 'name should be' snapshot ../one
touch "$dir/file"
check no-folder does 1 "$dir/file" snapshot "$dir/file/one"
mkdir "$dir/three.part"
check left-over does 1 'was cut off; remove it' snapshot "$dir/three"
many() { local i; for i in 1 2 3 4 5 6 7 8 9 10; do ctl snapshot "many$i"; says 0 "many$i" || return 1; done; }
check ten-more many
check still-no-set-was-lost none_lost
while-recording() { ctl record start mine.h5 && ctl snapshot both && says 0 both && ctl record stop && says 0 mine.h5; }
check beside-a-take while-recording
kill -TERM "$daemon"
check ends ended "$daemon" 0

config b.yaml "wait_subscriber: true" <<< $'cameras: "sim:"\nfps: 20\nrecord: {path: takes/%Y.h5, keep_free_gb: 1000000}'
start b.log "$pyrovoxd" --config "$dir/b.yaml"
daemon=$started
check waits wait_for field "s['uptime_s'] > 0"
check no-set-comes does 1 'no frame set came for 5 s' snapshot never
start top.log "$pyrovox" record --endpoint "$volumes" --out "$dir/sub" --quiet
check flows wait_for published 3
check disk-full does 1 'the disk is full' snapshot never
check nothing-is-left [ ! -e "$dir/takes/never" -a ! -e "$dir/takes/never.part" ]
kill -TERM "$daemon"
check ends-again ended "$daemon" 0

config c.yaml <<< $'cameras: "sim:"\nfps: 20\nrecord: {queue: 0}'
start c.log "$pyrovoxd" --config "$dir/c.yaml"
daemon=$started
check runs-without-a-queue wait_for published 3
check cannot does 1 'record.queue is 0' snapshot one
kill -TERM "$daemon"
check ends-that-too ended "$daemon" 0
# where sets are dropped between the stages: one that was not, and its own volume
config d.yaml <<< $'cameras: "sim:"\nfps: 1000\nrecord: {path: takes/%Y.h5, keep_free_gb: 0}'
start d.log "$pyrovoxd" --config "$dir/d.yaml"
daemon=$started
check drops wait_for field "s['sets']['dropped'] > 20"
check one-that-was-not-dropped does 0 takes/live snapshot live
of_one_set() {
    "$pyrovox" reconstruct --quiet --rig "$dir/takes/live/rig.yaml" --frames "$dir/takes/live/raw.h5" --out "$dir/live" &&
        [ "$(basename "$dir"/live/*.npy)" = "$(basename "$dir"/takes/live/*.npy)" ]
}
check of-one-set of_one_set
kill -TERM "$daemon"
check ends-after-all ended "$daemon" 0
exit $rc
