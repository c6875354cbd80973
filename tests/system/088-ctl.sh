#!/bin/bash
# pyrovox ctl on a running daemon: options read and changed between sets without a loss, a compression that subscribers
# see, takes by name, over the network with a key, and what is refused.
name=088
. "$(dirname "$0")/lib.sh"
config a.yaml <<< $'cameras: "sim:"\nfps: 20\nshared_clock: true\nlossless: true\nrecord: {path: takes/%Y.h5, volumes_path: seen/run, keep_free_gb: 0}'
start a.log "$pyrovoxd" --config "$dir/a.yaml"
daemon=$started
ctl() { run "$pyrovox" ctl --control "$control" "$@"; }
does() { local code=$1 text=$2; shift 2; ctl "$@"; says "$code" "$text"; }
check runs wait_for published 5
check ping does 0 pong ping
check get does 0 'solver.lambda' get solver.lambda
check get-says-default does 0 'default -1' get solver.lambda
check get-says-restart does 0 'needs a restart' get fps
check get-all does 0 'sim.period_s' get
check restart does 1 'fps needs a restart' set fps 30
check method-too does 1 'solver.name needs a restart' set solver.name cgls
check nearest does 1 'the nearest is solver.lambda' set solver.lamda 1
check bad-value does 1 'solver.lambda' set solver.lambda -x
check nothing-changed does 0 'solver.lambda              -1' get solver.lambda
check no-such-command does 2 "no command 'fly'" fly
check too-many-words does 2 'usage: pyrovox ctl get [KEY]' get fps 3

check set-iterations does 0 'before 0' set solver.iterations 3
check set-stop does 0 'value iterations' set solver.stop iterations
check it-is-done wait_for field "s['last']['iterations'] == 3"
check set-back does 0 'value 7' set solver.iterations 7
check it-is-done-again wait_for field "s['last']['iterations'] == 7"
for v in off on auto; do check "warm-$v" does 0 "value $v" set solver.warm_start $v; done
check deadline does 0 'value 500' set solver.deadline_ms 500
check threshold does 0 'value 0.9' set photometry.threshold 0.9
check less-flame wait_for field "s['last']['active_voxels'] < 200"
check threshold-back does 0 'value -1' set photometry.threshold -1
check flame-again wait_for field "s['last']['active_voxels'] > 200"

check flame-is-back wait_for field "s['last']['bytes'] > 10000"
bytes_before=$(status | "$py" -c 'import json,sys; print(json.load(sys.stdin)["last"]["bytes"])')
check compress does 0 'value zstd' set publish.compress zstd
check smaller wait_for field "s['last']['bytes'] < 0.97 * $bytes_before"
check read-by-a-client "$pyrovox" record --quiet --endpoint "$volumes" --volumes 3 --out "$dir/zstd"
check compress-lz4 does 0 'before zstd' set publish.compress lz4
check read-by-a-client-again "$pyrovox" record --quiet --endpoint "$volumes" --volumes 3 --out "$dir/lz4"
check compress-none does 0 'before lz4' set publish.compress none
check none-was-dropped field "s['sets']['dropped'] == 0 and s['sets']['displaced'] == 0"

start sub.log "$pyrovox" top --endpoint "$volumes"
check subscriber-is-counted wait_for field "s['subscribers'] == 1"
kill "$started"
check and-not-when-gone wait_for field "s['subscribers'] == 0"
check take-by-name does 0 "$dir/takes/mine.h5" record start mine.h5
n=$(sets); check goes-on wait_for published $((n + 5))
check take-ends does 0 "$dir/takes/mine.h5" record stop
check take-is-there [ -s "$dir/takes/mine.h5" ]
check take-elsewhere does 0 "$dir/other.h5" record start "$dir/other.h5"
check take-elsewhere-ends does 0 other.h5 record stop
check take-by-kind does 0 "$dir/takes/kind.h5" record start raw kind.h5
check one-at-a-time does 1 'is being recorded' record start raw
check take-by-kind-ends does 0 "$dir/takes/kind.h5" record stop raw
check two-names does 2 'usage: pyrovox ctl record' record start a.h5 b.h5
check too-many-for-record does 2 'usage: pyrovox ctl record' record start raw a.h5 b.h5
check volumes-have-no-name does 1 'leave path and name out' record start volumes a.h5
check no-volumes-yet does 1 'no volumes are being recorded' record stop volumes
check volumes does 0 "$dir/seen/run-" record start volumes
check volumes-are-written wait_for field "s['record_volumes']['running'] and s['record_volumes']['written'] >= 5"
check volumes-one-at-a-time does 1 'volumes are being recorded to' record start volumes
check both-kinds-at-once does 0 "$dir/takes/both.h5" record start both.h5
check volumes-end does 0 "$dir/seen/run-" record stop volumes
check only-they-end wait_for field "not s['record_volumes']['running'] and s['record']['state'] == 'recording'"
check take-ends-too does 0 "$dir/takes/both.h5" record stop
check volumes-again does 0 -2.h5 record start volumes
check volumes-are-written-again wait_for field "s['record_volumes']['written'] >= 1"
check volumes-end-again does 0 -2.h5 record stop volumes
readable() { local f; for f in "$dir"/seen/run-*.h5; do h5dump -a /closed "$f" | grep -q '(0): 1' || return 1; done; [ "$(ls "$dir"/seen | wc -l)" = 2 ]; }
check volumes-are-closed readable
check bad-name does 1 'name should be' record start ../a.h5
check no-keys does 1 'no keys to read again' reload-keys
check background does 0 'state none' background
check json does 0 '"version":' --json ping
stops() { run "$pyrovox" status --endpoint "$control" --stop; says 0 "the daemon is stopping"; }
check stop stops
check ends ended "$daemon" 0
check nobody does 1 'is pyrovoxd running' ping
exit $rc
