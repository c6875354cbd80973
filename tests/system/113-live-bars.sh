#!/bin/bash
# live-bars: `model.error_bars: true` on the daemon with simulated GigE cameras: bars come over ZeroMQ with their volumes, late at first
# and then not, again after a lost camera; they are recorded and read; status and metrics count; what cannot be is refused.
name=113
. "$(dirname "$0")/lib.sh"
needs_private_net
bars() { field "s['error_bars']$1"; }

config mlem.yaml <<< $'cameras: "sim:"\nmodel: {error_bars: true}\nsolver: {name: mlem}'
refused() {
    run "$pyrovoxd" --config "$dir/mlem.yaml"; says 1 'model.error_bars' 'solver.name: mlem cannot make them' 'say pcg' || return 1
    run "$pyrovoxd" --config "$dir/mlem.yaml" --check-config; says 1 'model.error_bars'
}
check another-solver-is-refused refused

config a.yaml <<< $'cameras: "aravis:127.0.0.2+"\nfps: 10\npixel_format: RGB8\nshared_clock: true\nsync: {policy: partial, min_cameras: 3}
photometry: {black: 0.02}\nmodel: {error_bars: true}\nmetrics: {endpoint: "127.0.0.1:0"}'
mkfifo "$dir/orders"
"$pyrovox" simcams --private-net --rig tests/data/rig4.yaml --fps 10 --ring 15 --control -- \
    "$pyrovoxd" --config "$dir/a.yaml" > "$dir/sim.log" 2>&1 < "$dir/orders" &
sim=$!
pids+=("$sim")
exec 9> "$dir/orders"

# Every bars message belongs to the volume that follows; in doubt as `late`, and then not.
clients() {
    PYTHONPATH=proto/clients:proto/clients/python timeout "$patience" "$py" - "$volumes" << 'END'
import sys
import numpy as np
import pyrovox_sub as pvx
late = clear = 0
with pvx.Subscriber(sys.argv[1]) as sub:
    for m in sub:
        if m["type"] != "volume":
            continue
        sd = m.get("sd")
        if sd is None:
            assert clear == 0, "bars were gone again"
            continue
        assert sd.shape == m["dense"].shape and np.isfinite(sd).all() and (sd >= 0).all()
        assert (sd[m["dense"] > 0] > 0).mean() > 0.95, "lit voxels without a bar"
        lit = m["dense"] > 0.1 * m["dense"].max()
        assert 0 < np.sqrt((sd[lit]**2).mean()) < m["dense"].max()
        if "late" in m["doubts"]:
            late += 1
        else:
            clear += 1
        assert "few-cameras" in m["doubts"] # there are four
        if clear >= 5:
            break
assert late > 0 or int(m["set"]) > 40, (late, m["set"])
END
}
check bars-come-with-the-volumes clients
check status-says-so wait_for bars "['sent'] and s['error_bars']['solves'] >= 12 and s['error_bars']['in_average'] >= 12 and 'few-cameras' in s['error_bars']['doubts']"
prints() { run "$pyrovox" status --endpoint "$control"; says 0 'bars      of the last volume' 'sets solved once more' 'in doubt: few-cameras'; }
check status-prints-it prints
# each set that was solved is one of these; some may be under way
counts() { field "s['error_bars']['solves'] + sum(c['value'] for c in s['error_bars']['left_out']) <= s['sets']['produced'] and s['error_bars']['solves'] + sum(c['value'] for c in s['error_bars']['left_out']) >= s['sets']['published'] - 3"; }
check each-set-counts-once counts
cannot_be_set() { run "$pyrovox" ctl set model.error_bars false --control "$control"; says 1 'model.error_bars' 'restart'; }
check not-at-run-time cannot_be_set

recorded() {
    run "$pyrovox" record --endpoint "$volumes" --quiet --volumes 6 --format hdf5 --out "$dir/live.h5"; says 0 || return 1
    run "$pyrovox" value "$dir/live.h5" --quiet; says 0 'set ' 'of single voxels alone' 'reconstruct --error-bars'
}
check recorded-and-read recorded

echo "kill cam2" >&9
lost() { field "s['last']['cameras'] == 3 and 'late' in s['error_bars']['doubts']"; }
check in-doubt-when-a-camera-is-lost wait_for lost
check and-then-not wait_for field "s['last']['cameras'] == 3 and s['error_bars']['sent'] and 'late' not in s['error_bars']['doubts']"
echo "revive cam2" >&9
check volumes-go-on wait_for field "s['last']['cameras'] == 4"
check stop-command "$pyrovox" status --endpoint "$control" --stop
check both-end ended "$sim" 0
exec 9>&-

# Replay, nothing dropped: the bars of `reconstruct`, with each volume from the first on.
replayed() {
    "$py" - "$dir/frames" << 'END' || return 1
import os, sys
import numpy as np
y, x = np.mgrid[0:60, 0:80].astype(np.float32)
rng = np.random.default_rng(1)
for c in range(4):
    os.makedirs(f"{sys.argv[1]}/cam{c}")
    for f in range(6):
        blob = np.exp(-((x - 40 - 5 * np.cos(0.3 * f)) ** 2 + (y - 30) ** 2) / 60)
        img = blob[..., None] * np.float32([0.8, 0.5, 0.2]) + rng.normal(0, 0.002, (60, 80, 3))
        np.save(f"{sys.argv[1]}/cam{c}/{f:06d}.npy", img.astype(np.float32))
END
    config files.yaml 'wait_subscriber: true, hwm: 1000' <<< "cameras: \"files:$dir/frames/{name}/%06d.npy\""$'\nlossless: true\nmodel: {error_bars: true}'
    start replay.log "$pyrovoxd" --config "$dir/files.yaml"
    PYTHONPATH=proto/clients timeout "$patience" "$py" - "$volumes" << 'END'
import sys
import pyrovox_sub as pvx
n = 0
with pvx.Subscriber(sys.argv[1]) as sub:
    for m in sub:
        if m["type"] == "volume":
            assert m.get("sd") is not None and "late" not in m["doubts"]
            n += 1
        if m["type"] == "end":
            break
assert n == 6, n
END
    local r=$?
    ended "$started" 0 && [ $r = 0 ]
}
check lossless-has-bars-of-each-set replayed
exit $rc
