#!/bin/bash
# record.ring: raw frames in memory, and takes that ignitions, blow-offs, orders and times make of them.  Every frame of
# each asked time is in the take or named as lost, also with faulty cameras (ring.py; make ignitions has a slow disk too); the event comes
# before the take is closed.
name=105
. "$(dirname "$0")/lib.sh"
ring() { # the ring of the configuration, more of record
    config r.yaml <<EOF
cameras: {$cameras}
fps: 60
shared_clock: true
pixel_format: Mono8
sync: { policy: partial }
solver: { deadline_ms: 0 }
record: { path: takes/%Y.h5, keep_free_gb: 0, ring: { $1, pre: 0.5, post: 0.5 }${2:+, $2} }
sim: { ignite_s: 4, seed: 7 }
triggers:
  - { name: ignition, when: appears, pre: 0.6, post: 0.4, hold_off: 0.2 }
  - { name: out, when: vanishes, pre: 0.2, post: 0.3, hold_off: 0.2 }
  - { name: mine, pre: 0.1, post: 0.1 }
EOF
}
cameras='cam0: "sim:", cam1: "sim:", cam2: "sim:", cam3: "sim:"'
ctl() { run "$pyrovox" ctl --control "$control" "$@"; }
does() { local code=$1; shift; local text=$1; shift; ctl "$@"; says "$code" "$text"; }

ring "seconds: 3, memory: 100MB"
start d.log "$pyrovoxd" --config "$dir/r.yaml"; daemon=$started
check runs wait_for published 5
check says-what-it-holds grep -q 'record.ring: the last 181 frames of each of 4 cameras, 3.02 s at 60 Hz' "$dir/d.log"
start heard.log listen
check ignites wait_for field "any(t['name'] == 'ignition' and t['fired'] >= 2 for t in s['triggers'])"
check blows-off wait_for field "any(t['name'] == 'out' and t['fired'] >= 1 for t in s['triggers'])"
check is-published wait_for heard "'name': 'ignition'"
check named-order does 0 'instant 20' trigger mine
check unknown does 1 'no trigger '\''nope'\''; `triggers` has ignition, out, mine' trigger nope
check order does 0 'instant 20' trigger
check two-words does 2 'usage: pyrovox ctl trigger' trigger mine 5
check all-written wait_for field "s['ring']['takes'] + s['ring']['extended'] == s['ring']['triggers'] and not s['ring']['writing'] and s['ring']['triggers'] >= 5"
# a busy machine may make cameras lose frames, which are then id_gap
check nothing-lost field "not {'ring', 'before', 'disk', 'unknown'} & set(s['ring']['lost']) and s['ring']['failed'] == 0"
check in-bounds field "0 < s['ring']['bytes_most'] <= s['ring']['bytes_max'] and s['ring']['frames'] <= 181"
words() { run "$pyrovox" status --endpoint "$control"; says 0 'ring      ' 'trigger   ignition: appears ' 'trigger   mine: by order, fired 1 times'; }
check in-words words
check beside-a-recording does 0 all.h5 record start all.h5
check another does 0 instant trigger mine
check the-recording-ends does 0 all.h5 record stop
kill -INT "$daemon"
check ends ended "$daemon" 0
check account "$py" tests/system/ring.py "$dir"/takes/*T*.h5
info() { run "$pyrovox" replay --info "$(ls "$dir"/takes/ignition-*.h5 | head -n 1)"; says 0 'trigger   ignition at 20' 'from 0.600 s before to 0.400 s after' 'lost      '; }
check info info
advises() { # ten dark sets, then ten with a flame
    local c i
    run "$pyrovox" simcams --rig tests/data/rig4.yaml --ring 10 --write-frames "$dir/lit"; says 0 || return 1
    run "$pyrovox" simcams --rig tests/data/rig4.yaml --ring 10 --set 'empty all on' --write-frames "$dir/ignites"; says 0 || return 1
    for c in 0 1 2 3; do for i in 0 1 2 3 4 5 6 7 8 9; do mv "$dir/lit/cam$c/00000$i.png" "$dir/ignites/cam$c/00001$i.png"; done; done
    run "$pyrovox" advise --quiet --rig tests/data/rig4.yaml --black 0.02 --frames "$dir/ignites"
    says 0 'triggers     ignition   10 of 20 sets are dark' '#   - { name: ignition, when: light, above: 0.001'
}
check advises-levels advises
again() { run "$pyrovox" reconstruct --rig tests/data/rig4.yaml --frames "$(ls "$dir"/takes/ignition-*.h5 | tail -n 1)" --grid 12 --quiet --out "$dir/again"; says 0 && [ "$(ls "$dir"/again/*.npy | wc -l)" -ge 1 ]; }
check is-a-take again

# cameras that lose frames, come late, come back
rm -rf "$dir/takes"
cameras='cam0: "sim:incomplete=0.02,seed=1", cam1: "sim:drop=0.03,seed=2", cam2: "sim:jitter_us=9000,seed=3", cam3: "sim:die_after=300,seed=4"'
ring "seconds: 2, memory: 30MB"
start f.log "$pyrovoxd" --config "$dir/r.yaml"; daemon=$started
check faulty-ignites wait_for field "any(t['name'] == 'ignition' and t['fired'] >= 3 for t in s['triggers'])"
check faulty-in-bounds field "s['ring']['bytes_most'] <= s['ring']['bytes_max']"
check loses-named wait_for field "s['ring']['lost']['incomplete'] > 0 and s['ring']['lost']['id_gap'] > 0"
kill -INT "$daemon"
check faulty-ends ended "$daemon" 0
check faulty-account "$py" tests/system/ring.py "$dir"/takes/*T*.h5

refused() { # text, ring, record
    ring "$2" "${3:-}"
    run "$pyrovoxd" --config "$dir/r.yaml" --check-config
    says 1 "$1"
}
check too-small refused 'record.ring: memory: 0.1 MB holds 0.00 s of 4 cameras, ignition needs 0.6 s before it (pre): raise memory to' "seconds: 3, memory: 100kB"
check too-short refused 'record.ring: seconds: 0.3 is less than the 0.6 s before ignition (pre)' "seconds: 0.3, memory: 100MB"
check no-queue refused 'record.queue: 0, so record.ring' "seconds: 3, memory: 100MB" "queue: 0"
none() {
    config n.yaml <<< $'cameras: "sim:"\ntriggers: [{name: a}]'
    run "$pyrovoxd" --config "$dir/n.yaml" --check-config
    says 1 'triggers: need frames in memory'
}
check no-ring none
exit $rc
