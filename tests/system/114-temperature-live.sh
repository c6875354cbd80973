#!/bin/bash
# temperature-live: publish.temperature on the daemon with simulated GigE cameras that see soot of 1900 K: kelvin with bars over ZeroMQ, for a
# reader, on disk and in status; none for light that is not soot's; what cannot be is refused at the start.
name=114
. "$(dirname "$0")/lib.sh"
needs_private_net
kelvin=ipc://$dir/kelvin
export PYTHONPATH=tests/view:proto/clients:proto/clients/python

rigs() { # one that knows its colours, and one for which this light has far too little green
    "$pyrovox" simcams --size 128x96 --cameras 6 --voxels 24 --ring 1 --write-rig "$dir/plain.yaml" --write-frames "$dir/frames" > "$dir/rig.log" 2>&1 &&
        "$py" - "$dir" << 'END'
import sys
import bed
d = sys.argv[1]
plain = open(f"{d}/plain.yaml").read()
open(f"{d}/soot.yaml", "w").write(plain + bed.spectral())
open(f"{d}/other.yaml", "w").write(plain + bed.spectral(bed.CONSTANT * [1, 4, 1]))
END
}
check rigs-that-know-their-colours rigs

made() { # file, rig, model.error_bars, pixel format
    printf 'rig: "%s"\ncameras: "aravis:127.0.0.2+"\nfps: 5\npixel_format: %s\nshared_clock: true\nphotometry: {black: 0.02}\nmodel: {error_bars: %s}\n' \
        "$dir/$2" "$4" "$3"
    printf 'publish: {endpoints: ["%s"], temperature: "%s"}\ncontrol: {endpoint: "%s"}\n' "$volumes" "$kelvin" "$control"
}
cannot() { # file, then what must be said
    local file=$1; shift
    run "$pyrovoxd" --config "$dir/$file" --check-config; says 1 'publish.temperature' "$@" || return 1
    run "$pyrovoxd" --config "$dir/$file"; says 1 'publish.temperature' "$@"
}
made x plain.yaml true RGB8 > "$dir/blind.yaml"
made x soot.yaml false RGB8 > "$dir/barless.yaml"
made x soot.yaml true Mono8 > "$dir/grey.yaml"
sed '/^  green:\|^  blue:/d; s/^  red: \(.*\)/  red: \1\n  green: \1\n  blue: \1/' "$dir/soot.yaml" > "$dir/alike.rig"
made x alike.rig true RGB8 > "$dir/alike.yaml"
check a-rig-without-colours-is-refused cannot blind.yaml 'plain.yaml has no `spectral:`' 'pyrovox calibrate spectral'
check no-bars-are-refused cannot barless.yaml 'model.error_bars: true'
check one-channel-is-refused cannot grey.yaml 'three channels' 'pixel_format'
check channels-alike-are-refused cannot alike.yaml 'alike.rig' 'see nearly the same wavelengths'
everywhere() {
    sed 's|temperature: "[^"]*"|temperature: "tcp://*:5599"|' "$dir/blind.yaml" > "$dir/open.yaml"
    run "$pyrovoxd" --config "$dir/open.yaml"; says 1 'publish.temperature: tcp://*:5599 lets everybody in' 'pyrovox keygen'
}
check an-open-address-is-refused everywhere

made x soot.yaml true RGB8 > "$dir/a.yaml"
run_pair() { # log, configuration: cameras of soot and their daemon; $sim
    "$pyrovox" simcams --private-net --rig "$dir/soot.yaml" --kelvin 1900 --noise 0.3 --fps 5 --ring 10 -- \
        "$pyrovoxd" --config "$dir/$2" > "$dir/$1.log" 2>&1 &
    sim=$!
    pids+=("$sim")
}
run_pair a a.yaml
check it-runs wait_for published 3
check nothing-is-made-for-nobody field "s['temperature'] == {'subscribers': 0, 'made': 0, 'left_out': 0, 'without_bars': 0}"

# Bars directly before their volumes; in every set, two bars hold the 1900 K in more than 90 of 100 voxels, and the mean is near.
right() {
    timeout "$patience" "$py" - "$kelvin" "$volumes" << 'END'
import sys
import numpy as np
import pyrovox
import pyrovox_sub as pvx
good, same, v = 0, 0, None
with pvx.Subscriber(sys.argv[2]) as flame, pvx.Subscriber(sys.argv[1]) as sub:
    for m in sub:
        if m["type"] == "start":
            assert m["units"] == "K" and m["channels"] == 1 and m["basis"] == 0, m
        assert m["type"] in ("start", "rig", "bars", "volume"), m["type"]
        if m["type"] != "volume":
            continue
        T, sd = m["dense"][..., 0], m["sd"][..., 0]
        known = T > 0
        assert np.array_equal(known, sd > 0), (known.sum(), (sd > 0).sum())
        assert not known.any() or (800 < T[known].min() and T[known].max() < 3200 and (sd[known] / T[known]).max() <= 0.1001)
        if "late" in m["doubts"] or known.sum() < 40:
            continue
        hold = (np.abs(T - 1900) < 2 * sd)[known].mean()
        print(m["set"], known.sum(), T[known].mean(), sd[known].mean(), hold)
        assert hold > 0.9 and abs(T[known].mean() / 1900 - 1) < 0.03, (m["set"], hold, T[known].mean())
        # of the set and the time of a volume, which came before, and only where that has light
        while v is None or v["set"] < m["set"]:
            v = next(f for f in flame if f["type"] == "volume")
        if v["set"] == m["set"]:
            assert v["t_exposure_ns"] == m["t_exposure_ns"] and flame.session == sub.session and (v["dense"][known] > 0).any(-1).all()
            same += 1
        good += 1
        if good >= 6 and same > 0:
            break
for v in pyrovox.subscribe(sys.argv[1]):
    assert v.units == "K" and v.dense.shape[3] == 1
    if v.sd is not None and (v.dense > 0).any():
        break
END
}
check temperatures-are-right-within-their-bars right
check status-counts-them field "s['temperature']['made'] >= 9 and s['temperature']['made'] + s['temperature']['left_out'] + s['temperature']['without_bars'] <= s['sets']['published']"
says_it() { run "$pyrovox" status --endpoint "$control"; says 0 'kelvin    ' 'sets sent' 'without error bars'; }
check status-says-it says_it
recorded() {
    run "$pyrovox" record --endpoint "$kelvin" --quiet --volumes 4 --format hdf5 --out "$dir/k.h5"; says 0 || return 1
    run "$pyrovox" value "$dir/k.h5" --quiet --csv "$dir/k.csv"; says 0 'hottest K' 'means have none' || return 1
    "$py" -c 'import csv, sys
rows = list(csv.DictReader(open(sys.argv[1])))
assert len(rows) == 4
some = [r for r in rows if r["mean_K"]]
assert some
for r in some:
    assert abs(float(r["mean_K"]) / 1900 - 1) < 0.03 and float(r["hottest_sd"]) > 0 and r["soot_ppm"] == "" and float(r["volume_m3"]) > 0, r' "$dir/k.csv" || return 1
    run "$pyrovox" value "$dir/k.h5" --above 3; says 1 'k.h5: has temperatures' || return 1
    run "$pyrovox" temperature "$dir/k.h5" --rig "$dir/soot.yaml" --out "$dir/no.h5"; says 1 'k.h5: has temperatures [K], and emission [1/m] is needed' || return 1
    run "$pyrovox" report "$dir/k.h5" --rig "$dir/soot.yaml" --out "$dir/page"; says 1 'k.h5: has temperatures [K]' || return 1
    run "$pyrovox" convert "$dir/k.h5" "$dir/copy" --format npy; says 0 '4 volumes' || return 1
    run "$pyrovox" value "$dir/copy" --quiet --csv "$dir/copy.csv"; says 0 && cmp "$dir/k.csv" "$dir/copy.csv" && [ ! -e "$dir/no.h5" ]
}
check a-recording-is-one-of-temperatures recorded
vdb() {
    run "$pyrovox" convert "$dir/k.h5" "$dir/nano" --format nvdb; says 1 'temperatures are not written as .nvdb' || return 1
    [ ! -e "$dir/nano" ] || return 1
    "$py" -c 'import pyopenvdb' 2> /dev/null || { echo "SKIP $name:vdb (apt-get install python3-openvdb)"; return 0; }
    run "$pyrovox" convert "$dir/k.h5" "$dir/vdb" --format vdb; says 0 '4 volumes' || return 1
    "$py" - "$dir" << 'END'
import glob, sys, h5py, numpy as np, pyopenvdb as vdb
f = h5py.File(sys.argv[1] + "/k.h5")
most = (f["emission"][:] > 0).sum((1, 2, 3, 4)).argmax()
T, frame = f["emission"][most, ..., 0], f["sets/number"][most] - f["sets/number"][0]
grids = {g.name: g for g in vdb.readAll(sorted(glob.glob(sys.argv[1] + "/vdb/*.vdb"))[int(frame)])[0]}
assert set(grids) == {"density", "temperature"}, grids
for name, want in ("temperature", T), ("density", (T > 0) * 1.0):
    a = np.zeros(T.shape[::-1], np.float32)
    grids[name].copyToArray(a)
    assert grids[name].activeVoxelCount() == (T > 0).sum() > 20 and np.allclose(a.T, want, 1e-6), name
END
}
check as-blender-reads-it vdb
played() { # published again, and the same
    start play.log "$pyrovox" play "$dir/k.h5" --endpoint "ipc://$dir/again" --speed 0
    run "$pyrovox" record --endpoint "ipc://$dir/again" --quiet --format hdf5 --out "$dir/again.h5"; says 0 || return 1
    "$py" -c 'import sys, h5py, numpy as np
a, b = (h5py.File(f) for f in sys.argv[1:])
assert b.attrs["units"] in (b"K", "K") and len(a["emission"]) == len(b["emission"]) == 4
assert all(np.array_equal(a[k][:], b[k][:]) for k in ("emission", "emission_sd", "sets/number"))' "$dir/k.h5" "$dir/again.h5"
}
check play-gives-it-back played
check readers-have-left wait_for field "s['temperature']['subscribers'] == 0"
check stop-command "$pyrovox" status --endpoint "$control" --stop
check both-end ended "$sim" 0

made x other.yaml true RGB8 > "$dir/b.yaml"
run_pair b b.yaml
none() { # of a flame that is not as green as soot
    timeout "$patience" "$py" - "$kelvin" "$volumes" << 'END'
import sys
import pyrovox_sub as pvx
seen = 0
with pvx.Subscriber(sys.argv[1]) as sub:
    for m in sub:
        if m["type"] == "volume" and "late" not in m["doubts"]:
            assert not (m["dense"] > 0).any(), (m["set"], (m["dense"] > 0).sum())
            seen += 1
        if seen == 5:
            break
with pvx.Subscriber(sys.argv[2]) as sub:
    assert next(m for m in sub if m["type"] == "volume")["dense"].max() > 0.1
END
}
check light-that-is-not-soots-has-none none
check stop-again "$pyrovox" status --endpoint "$control" --stop
check end-again ended "$sim" 0
exit $rc
