#!/bin/bash
# pyrovox cameras and pyrovox cameras test: sim: cameras, and GigE Vision ones on a private network.
name=081
. "$(dirname "$0")/lib.sh"
json() { # file, expression on r
    "$py" -c 'import json, sys
r = json.load(open(sys.argv[1]))
sys.exit(0 if eval(sys.argv[2]) else 1)' "$1" "$2"
}

"$pyrovox" cameras > "$dir/list.log" 2> "$dir/list.err"
"$pyrovox" cameras --json > "$dir/list.json" 2> "$dir/json.err"
check every-backend-speaks json "$dir/list.json" "{'aravis','sim','files'} <= {b['scheme'] for b in r['backends']}"
check none-without-a-reason json "$dir/list.json" "all(b['cameras'] or b['why'] for b in r['backends'] if b['lists'])"
"$pyrovox" cameras nosuch > "$dir/no.log" 2>&1; code=$?
check unknown-backend [ $code = 2 ]
check backends-are-named grep -q aravis "$dir/no.log"

"$pyrovox" cameras test --seconds 2 --size 64x48 --fps 25 --json --save "$dir/look" sim: sim:drop=0.2 sim:absent > "$dir/sim.json" 2> "$dir/sim.err"; code=$?
check trouble-is-an-exit-status [ $code = 1 ]
check good-one-is-good json "$dir/sim.json" "r['cameras'][0]['frames'] > 3 and abs(r['cameras'][0]['hz'] - 25) < 0.1 and r['cameras'][0]['pixel_format'] == 'RGB8'"
check lost-ones-by-cause json "$dir/sim.json" "r['cameras'][1]['verdict'] == 'FAIL' and r['cameras'][1]['counts']['id_gap'] > 0"
check absent-one-says-so json "$dir/sim.json" "r['cameras'][2]['verdict'] == 'FAIL' and 'absent' in r['cameras'][2]['error'] and r['cameras'][2]['frames'] == 0"
check pictures-were-written "$py" -c 'import sys; [open(sys.argv[1] + f, "rb").read(4) == b"\x89PNG" or sys.exit(1) for f in ("/cam0.png", "/cam1.png")]' "$dir/look"
"$pyrovox" cameras test --seconds 1 --json sim: > "$dir/one.json" 2> "$dir/one.err"
check one-camera-alone json "$dir/one.json" "len(r['cameras']) == 1 and r['cameras'][0]['frames'] > 3"
check none-of-the-absent test ! -e "$dir/look/cam2.png"

"$pyrovox" cameras test --seconds 30 sim: sim: > "$dir/int.log" 2> "$dir/int.err" & p=$!
pids+=($p)
watching() { grep -q watching "$dir/int.err"; }
check progress-is-shown wait_for watching
kill -INT $p; wait $p; code=$?
check interrupt-is-said [ $code = 130 ]
check and-reports-all-the-same grep -qE '^cam1 +20\.0' "$dir/int.log"
check with-the-word grep -q '(interrupted)' "$dir/int.log"
"$pyrovox" cameras test --trigger sometimes sim: > "$dir/bad.log" 2>&1; code=$?
check wrong-trigger-is-refused [ $code = 1 ]
check with-the-choices grep -q 'free-run' "$dir/bad.log"
"$pyrovox" cameras test --config x.yaml sim: > "$dir/both.log" 2>&1; code=$?
check config-or-sources [ $code = 2 ]
config a.yaml <<< $'cameras: "sim:"\nfps: 30\nshared_clock: true'
"$pyrovox" cameras test --config "$dir/a.yaml" --seconds 1 --json > "$dir/cfg.json" 2> "$dir/cfg.err"
check cameras-of-the-configuration json "$dir/cfg.json" "len(r['cameras']) == 4 and r['fps'] == 30 and r['sets']['spread_max_ms'] < 0.1"

simcams() { timeout "$patience" "$pyrovox" simcams --private-net --cameras 3 --size 64x48 --ring 3 --fps 20 "$@"; }
if ! simcams -- true > "$dir/try.log" 2>&1; then
    echo "SKIP $name:gige (no private network here: $(grep pyrovox "$dir/try.log" | tail -n 1))"; exit $rc
fi
inside() { # output, arguments of `cameras test`: what simcams says itself goes elsewhere
    local out=$1; shift
    sh -c 'out=$1; shift; exec "$@" > "$out"' - "$out" "$pyrovox" cameras test "$@"
}
export -f inside; export pyrovox
simcams -- bash -c 'inside "$@"' - "$dir/gige.json" --seconds 3 --json > "$dir/gige.log" 2>&1
check gige-all-found json "$dir/gige.json" "[c['uri'] for c in r['cameras']] == ['aravis:127.0.0.%d' % i for i in (2, 3, 4)]"
check gige-together json "$dir/gige.json" "all(c['frames'] > 3 for c in r['cameras']) and r['sets']['whole'] > 3"
check gige-clocks-are-read json "$dir/gige.json" "all(c['clock_delay_us'] is not None for c in r['cameras'])"
check gige-says-how-it-is json "$dir/gige.json" "all(c['temperature_c'] and c['link_mbps'] == 1000 and 0 < c['link_share'] < 1 for c in r['cameras'])"
simcams --set "loss cam1 0.5" -- bash -c 'inside "$@"' - "$dir/loss.json" --seconds 3 --fps 20 --size 64x48 --json aravis:127.0.0.2 aravis:127.0.0.3 > "$dir/loss.log" 2>&1
check lost-packets-are-named json "$dir/loss.json" "r['cameras'][1]['counts']['incomplete'] > 0 and 'doctor' in r['cameras'][1]['remedy']"


# Blacks without a pedestal: the camera is named with the level that it lacks; pyrovox doctor says the same.
config b.yaml <<< $'cameras: "aravis:127.0.0.2+"\nfps: 20\npixel_format: Mono8'
blacks() { timeout "$patience" "$pyrovox" simcams --private-net --rig tests/data/rig4.yaml --fps 20 --ring 3 --set "pedestal cam1 0" "$@"; }
blacks -- bash -c 'inside "$@"' - "$dir/black.json" --config "$dir/b.yaml" --seconds 1 --json > "$dir/black.log" 2>&1
check clipped-one-is-named json "$dir/black.json" "['clipped' in c['what'] and 'black level by' in c['remedy'] for c in r['cameras']] == [False, True, False, False]"
blacks -- "$pyrovox" doctor --sample 0 --config "$dir/b.yaml" --cameras --all > "$dir/doctor.log" 2>&1
check doctor-names-it grep -qE '^WARN +cam1: black is clipped' "$dir/doctor.log"
check and-no-other [ "$(grep -c 'does not clip its blacks' "$dir/doctor.log")" = 3 ]
"$pyrovox" doctor --cameras > "$dir/none.log" 2>&1; code=$?
check cameras-of-what [ $code = 3 ]

# The daemon says the same of its cameras while it runs.
config d.yaml <<< $'cameras: "aravis:127.0.0.2+"\nfps: 15\npixel_format: RGB8\ntrigger: action\nptp: true\naction: {lead_ms: 20}'
start sim.log "$pyrovox" simcams --private-net --rig tests/data/rig4.yaml --fps 15 --ring 5 --ptp-ms 300 -- "$pyrovoxd" --config "$dir/d.yaml"
check action-commands-are-counted wait_for field "s['action']['sent'] > 20 and all(c['action']['acknowledged'] > 5 for c in s['cameras'])"
check health-is-in-the-status wait_for field "all(c['health']['ptp'] == 'Slave' and c['health']['temperature_c'] > 20 and c['health']['link_mbps'] > 0 for c in s['cameras'])"
"$pyrovox" status --endpoint "$control" > "$dir/status.log"
check for-people-too grep -qE '^cam0 +[0-9]+ +[0-9]+ +Slave ' "$dir/status.log"
check and-the-commands grep -qE '^action commands: [0-9]+ sent, ' "$dir/status.log"
"$pyrovox" status --endpoint "$control" --stop > "$dir/stop.log"
check both-end ended "$started" 0
exit $rc
