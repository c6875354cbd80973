#!/bin/bash
# Error bars on their way: HDF5, .npy, .vdb and .nvdb, played and recorded, and what Python and value make of them; readers that
# know nothing of bars go on as before; damage and cuts lose no more than they must.
name=109
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy, h5py' 2> /dev/null || { echo "no python3 with numpy and h5py (apt-get install python3-numpy python3-h5py)"; exit 77; }
export PYTHONPATH=$PWD/proto/clients/python:$PWD/proto/clients
for c in 1 3; do "$b/tests/unit/test_bars" --write "$dir/$c.h5" 5 $c 3 || exit 1; done
cd "$dir" || exit 1

nexus() { # as NeXus has errors, with what the modes are
    "$py" - << 'END'
import h5py, numpy as np
for name in "1.h5", "3.h5":
    with h5py.File(name, "r") as f:
        data, sd, modes, doubt = f["entry/data"], f["emission_sd"][:], f["emission_modes"][:], f["sets/bars_doubt"][:]
        assert data.attrs["signal"] in ("emission", b"emission") and np.array_equal(data["emission_errors"][:], sd)
        assert sd.shape == data["emission"].shape and sd.dtype == np.float32 and f["emission_sd"].attrs["units"] in ("1/m", b"1/m")
        assert [s for s in f["emission_sd"].attrs["DIMENSION_LIST"]] and modes.shape == (5, 3) + sd.shape[1:]
        assert doubt.tolist() == [0, 2, 0xffffffff, 0, 0] and f["sets/modes"][:].tolist() == [3, 3, 0, 3, 3]
        assert not sd[2].any() and (sd[0] > 0).sum() > 1000 and (sd >= np.sqrt((modes**2).sum(1)) * (1 - 1e-6)).all()
        flame = f["flame/data"]
        for c, colour in enumerate(["red", "green", "blue"] if name == "3.h5" else ["density"]):
            assert np.array_equal(flame[colour + "_errors"][:], sd[..., c]), colour
END
}
check nexus_finds_the_errors nexus

formats() { # what each format holds of them, there and back
    "$pyrovox" convert 3.h5 again.h5 > /dev/null 2>&1 && "$pyrovox" convert 3.h5 npy --format npy > /dev/null 2>&1 &&
        "$pyrovox" convert npy back.h5 > /dev/null 2>&1 || return 1
    [ "$(ls npy/sd/*.npy | wc -l)" = 4 ] || return 1
    "$py" - << 'END'
import h5py, numpy as np
one, again, back = (h5py.File(n, "r") for n in ("3.h5", "again.h5", "back.h5"))
for what in "emission", "emission_sd", "emission_modes", "sets/bars_doubt", "sets/modes", "sets/bars_check", "sets/modes_check":
    assert np.array_equal(one[what][:], again[what][:]), what
assert np.array_equal(one["emission_sd"][:], back["emission_sd"][:]) and "emission_modes" not in back
assert back["sets/bars_doubt"][:].tolist() == [0, 2, 0xffffffff, 0, 0]
END
}
check formats_and_back formats

before() { # a recording without bars is as it was, and one with bars is read by who knows nothing of them
    "$pyrovox" convert 3.h5 bare.h5 --from 2 --to 2 > /dev/null 2>&1 || return 1
    "$py" - << 'END'
import h5py, numpy as np
with h5py.File("bare.h5", "r") as f:
    assert "emission_sd" not in f and "bars_doubt" not in f["sets"] and "emission_errors" not in f["entry/data"], list(f)
    assert f["emission"].shape[0] == 1
with h5py.File("3.h5", "r") as f:
    assert f.attrs["version"] == 1 and f["emission"][:].any(axis=(1, 2, 3, 4)).all()
END
}
check others_read_as_before before

vdb() { # the deviation of what is shown: luminance's as the weights add it, or of each colour
    "$py" -c 'import pyopenvdb' 2> /dev/null || { echo "SKIP $name:vdb (apt-get install python3-openvdb)"; return 0; }
    "$pyrovox" convert 3.h5 vdb --format vdb > vdb.log 2>&1 || { grep -q "not installed" vdb.log && return 0; cat vdb.log; return 1; }
    "$pyrovox" convert 3.h5 split --format vdb --split > /dev/null 2>&1 && "$pyrovox" convert 1.h5 grey --format vdb > /dev/null 2>&1 &&
        "$pyrovox" convert 3.h5 nano --format nvdb > /dev/null 2>&1 || return 1
    "$py" - << 'END'
import glob, h5py, numpy as np, pyopenvdb as vdb
sd = {n: h5py.File(f"{n}.h5", "r")["emission_sd"][0] for n in (1, 3)}
light = np.array([0.2126, 0.7152, 0.0722])
for where, n, grids in ("vdb", 3, {"emission_sd": sd[3] @ light}), ("grey", 1, {"emission_sd": sd[1][..., 0]}), \
        ("split", 3, {c + "_sd": sd[3][..., k] for k, c in enumerate(("red", "green", "blue"))}):
    names = sorted(glob.glob(f"{where}/*.vdb"))
    have = {g.name: g for g in vdb.readAll(names[0])[0]}
    for name, want in grids.items():
        got = np.zeros(want.shape)
        for item in have[name].iterOnValues():
            x, y, z = item.min
            got[z, y, x] = item.value
        assert np.allclose(got, want, rtol=1e-3, atol=1e-6) and (got > 0).sum() == (want > 0).sum(), (where, name)
    without = {g.name for g in vdb.readAll(names[2])[0]}
    assert not any(g.endswith("_sd") for g in without) and "density" in without, without
END
    [ $? = 0 ] || return 1
    local what
    for what in vdb split grey nano; do run "$pyrovox" convert $what of-$what.h5; says 0 "5 volumes in" || return 1; done
    run "$pyrovox" convert 3.h5 again-nano --format nvdb; says 0 "has no bars of sums" || return 1
    run "$pyrovox" convert nano nano-npy --format npy; says 0 "5 volumes in" && [ "$(ls nano-npy/sd | wc -l)" = 4 ] || return 1
    case $out in *"bars of sums"*) return 1 ;; esac
    run "$pyrovox" value nano --quiet --csv nano.csv; says 0 "±" "of single voxels alone" || return 1
    "$py" - << 'END' || return 1
import h5py, numpy as np
for name, of, exact in ("vdb", 3, False), ("split", 3, False), ("grey", 1, False), ("nano", 3, True):
    one, back = h5py.File(f"{of}.h5", "r"), h5py.File(f"of-{name}.h5", "r")
    assert back["sets/bars_doubt"][:].tolist() == [0, 2, 0xffffffff, 0, 0] and "emission_modes" not in back
    for what in "emission", "emission_sd":
        a, b = one[what][:], back[what][:]
        assert np.array_equal(a, b) if exact else np.allclose(a, b, rtol=1e-3, atol=1e-7), (name, what)
END
    if command -v nanovdb_print > /dev/null; then nanovdb_print "$(ls nano/*.nvdb | head -n 1)" > nano.log 2>&1 && grep -q emission_sd nano.log || { cat nano.log; return 1; }; fi
}
check vdb_and_nvdb vdb

shared() { # in shared memory beside the volume
    [ -d of-nano.h5 ] || [ -e of-nano.h5 ] || return 0 # no OpenVDB here
    local shm=pyrovox-bars-$$
    start share.log "$pyrovox" share "$shm" 3.h5 --quiet; local p=$started
    barred() { grep -q rgb_sd "/dev/shm/$shm" 2> /dev/null && grep -q emission_sd "/dev/shm/$shm"; }
    wait_for barred || { kill "$p"; cat share.log; return 1; }
    kill -INT "$p"; ended "$p" 130 && [ ! -e "/dev/shm/$shm" ]
}
check shared_with_them shared

travels() { # played, recorded: deviations, doubts, no modes
    "$py" -c 'import zmq' 2> /dev/null || { echo "SKIP $name:travels (apt-get install python3-zmq)"; return 0; }
    timeout "$patience" "$pyrovox" play 1.h5 --speed 0 --quiet --endpoint "$volumes" & local p=$!
    run "$pyrovox" record --endpoint "$volumes" --quiet --out live.h5; says 0 "5 volumes in" " 0 messages lost" && ended "$p" 0 || return 1
    "$py" - << 'END' || return 1
import h5py, numpy as np
one, live = h5py.File("1.h5", "r"), h5py.File("live.h5", "r")
for what in "emission", "emission_sd", "sets/bars_doubt":
    assert np.array_equal(one[what][:], live[what][:]), what
assert "emission_modes" not in live
END
    timeout "$patience" "$pyrovox" play 3.h5 --speed 0 --quiet --endpoint "$volumes" & p=$!
    timeout "$patience" "$py" - "$volumes" << 'END' || return 1
import sys, numpy as np, pyrovox
want = list(pyrovox.open("3.h5"))
got = list(pyrovox.subscribe(sys.argv[1]))
assert len(got) == 5
for a, b in zip(want, got):
    assert a.set == b.set and a.doubts == b.doubts and (a.sd is None) == (b.sd is None) == (a.set == 2)
    assert a.sd is None or np.array_equal(a.sd, b.sd) and b.modes is None
END
    ended "$p" 0 || return 1
    timeout "$patience" "$pyrovox" play 1.h5 --speed 0 --quiet --endpoint "$volumes" & p=$!
    timeout "$patience" "$py" - "$volumes" << 'END' || return 1
import sys, numpy as np, pyrovox, pyrovox_sub
want = [v.sd for v in pyrovox.open("1.h5")]
with pyrovox_sub.Subscriber(sys.argv[1]) as sub:
    got = []
    for m in sub:
        assert m["type"] != "bars"
        if m["type"] == "volume":
            got.append((m["sd"], m["doubts"]))
        if m["type"] == "end":
            break
assert [d for _, d in got] == [[], ["few-cameras"], [], [], []]
assert all((a is None) == (w is None) and (w is None or np.array_equal(a, w)) for (a, _), w in zip(got, want))
assert sub.lost == sub.malformed == 0
END
    ended "$p" 0
}
check played_and_recorded travels

old_reader() { # written after version 1.1 of PROTOCOL.md: counts messages of a type that it does not know, and ignores them
    "$py" -c 'import zmq' 2> /dev/null || return 0
    timeout "$patience" "$pyrovox" play 1.h5 --speed 0 --quiet --endpoint "$volumes" & local p=$!
    timeout "$patience" "$py" - "$volumes" << 'END' || return 1
import struct, sys, zmq
s = zmq.Context().socket(zmq.SUB)
s.subscribe(b"PVX1")
s.connect(sys.argv[1])
following, unknown, sets = None, [], []
while True:
    m = s.recv()
    magic, kind, head, major, minor, flags, sequence, nth, session, body = struct.unpack_from("<4s4HI4Q", m)
    assert magic == b"PVX1" and major == 1 and flags >> 16 == 0 and head + body == len(m)
    assert following is None or sequence == following, (sequence, following)
    following = sequence + 1
    if kind == 200:
        size, sample, how, side, number = struct.unpack_from("<4IQ", m, head)
        assert (size, side) == (248, 8) and struct.unpack_from("<I", m, head + 228)[0] == 0  # reserved
        sets.append(number)
    elif kind == 400:
        break
    elif kind not in (100, 300, 500, 600, 700):
        unknown.append(kind)
assert sets == [0, 1, 2, 3, 4] and unknown == [800] * 4, (sets, unknown)
END
    ended "$p" 0
}
check readers_of_1_1 old_reader

python() { # the same from each format; a sum's bar by what the help says
    "$py" - << 'END'
import numpy as np, h5py, pyrovox
with h5py.File("3.h5", "r") as f:
    sd, modes = f["emission_sd"][:], f["emission_modes"][:]
for path in "3.h5", "npy":
    with pyrovox.open(path) as r:
        for k, v in enumerate(r):
            assert (v.sd is None) == (k == 2) and v.doubts == (("few-cameras",) if k == 1 else ())
            assert v.sd is None or (np.array_equal(v.sd, sd[k]) and v.sd.shape == v.dense.shape)
            assert (v.modes is None) == (k == 2 or path == "npy")
            assert v.modes is None or np.array_equal(v.modes, modes[k])
with pyrovox.open("bare.h5") as r:
    assert r[0].sd is None and r[0].modes is None and r[0].doubts == ()
END
}
check python_sd python

known() { # value's bars are those of the covariance, worked out here by numpy from what the file says
    run "$pyrovox" value 1.h5 --quiet --above 8 --csv all.csv; says 0 "±" "1 of 5 sets have no error bars" "bars in doubt" "fewer than five cameras" || return 1
    run "$pyrovox" value 3.h5 --quiet --above 8 --csv box.csv --channel green --box=-0.1,-0.1,0.05,0.1,0.06,0.3; says 0 "±" || return 1
    run "$pyrovox" value live.h5 --quiet --csv live.csv; says 0 "of single voxels alone" "pyrovox reconstruct --error-bars" || return 1
    "$py" - << 'END'
import csv, h5py, numpy as np
def rows(name):
    return {int(r["set"]): r for r in csv.DictReader(open(name))}
def height(x, z, dz):
    layers = x.sum((1, 2)).cumsum()
    k = int(np.searchsorted(layers, 0.98 * layers[-1]))
    before = layers[k - 1] if k else 0
    return z[k] + dz * (0.98 * layers[-1] - before) / (layers[k] - before) - dz / 2
for name, table, c, box in ("1.h5", "all.csv", 0, None), ("3.h5", "box.csv", 1, (-0.1, -0.1, 0.05, 0.1, 0.06, 0.3)):
    f, got = h5py.File(name, "r"), rows(table)
    x, y, z = (f[a][:] for a in "xyz")
    keep = np.ones((len(z), len(y), len(x)), bool)
    if box:
        keep = ((z[:, None, None] >= box[2]) & (z[:, None, None] <= box[5]) & (y[:, None] >= box[1]) & (y[:, None] <= box[4]) & (x >= box[0]) & (x <= box[3]))
    V = np.prod(f.attrs["spacing"])
    for k in range(5):
        r = got[k]
        if k == 2:
            assert r["light_sd"] == r["height_sd"] == "", r
            continue
        v, sd, d = (a.astype(float)[..., c] * keep for a in (f["emission"][k], f["emission_sd"][k], f["emission_modes"][k]))
        own = np.maximum(sd**2 - (d**2).sum(0), 0)
        light = V * np.sqrt((d.sum((1, 2, 3)) ** 2).sum() + own.sum())
        assert np.isclose(float(r["light_sd"]), light, rtol=1e-4), (k, r["light_sd"], light)
        assert np.isclose(float(r["mean_sd"]), light / V / keep.sum(), rtol=1e-4)
        assert light > 3 * V * np.sqrt((sd**2).sum())  # what voxels have in common counts for most of it
        tall = np.sqrt(sum(((height(v + m, z, f.attrs["spacing"][2]) - height(v - m, z, f.attrs["spacing"][2])) / 2) ** 2 for m in d))
        assert np.isclose(float(r["height_sd"]), tall, rtol=1e-3, atol=1e-7), (k, r["height_sd"], tall)
        big = V * np.sqrt(sum((((v + m > 8) & keep).sum() - 1.0 * ((v - m > 8) & keep).sum()) ** 2 / 4 for m in d))
        assert np.isclose(float(r["volume_sd"]), big, rtol=1e-6), (k, r["volume_sd"], big)
        assert np.isclose(float(r["most_sd"]), sd.flat[v.argmax()], rtol=1e-5)
        assert (r["doubt"] != "") == (k == 1), r
r = rows("live.csv")[0]
assert r["light_sd"] == "" and r["height_sd"] == "" and float(r["most_sd"]) > 0, r
END
}
check value_knows_the_bars known

damaged() { # cut off and spoilt: repair leaves out what is not whole, and says so
    local whole
    whole=$(stat -c %s 1.h5)
    head -c $((whole * 7 / 10)) 1.h5 > cut.h5
    run "$pyrovox" repair cut.h5; says 0 "finished" || return 1
    cp 1.h5 spoilt.h5 && "$py" - << 'END' || return 1
import h5py
with h5py.File("spoilt.h5", "r+") as f:
    f["emission_modes"][3, 1, 5, 10, 12, 0] += 1
END
    cp 1.h5 bare-last.h5 && "$py" - << 'END' || return 1
import h5py
with h5py.File("bare-last.h5", "r+") as f:
    f["emission_sd"][4, 5, 10, 12, 0] += 1
    f["emission_sd"][1, 5, 10, 12, 0] += 1
    f["emission"][3, 5, 10, 12, 0] += 1
END
    run "$pyrovox" value spoilt.h5 --quiet; says 1 "spoilt.h5: volume 3 is damaged" "pyrovox repair" || return 1
    run "$pyrovox" repair spoilt.h5; says 0 "5 volumes, finished; 0 damaged ones left out; of 1 only the error bars are damaged" || return 1
    run "$pyrovox" repair bare-last.h5; says 0 "4 volumes, finished; 1 damaged ones left out; of 2 only the error bars" || return 1
    "$py" - << 'END'
import h5py, numpy as np
with h5py.File("1.h5", "r") as f, h5py.File("spoilt.h5", "r") as s, h5py.File("cut.h5", "r") as c:
    assert s["sets/number"][:].tolist() == [0, 1, 2, 3, 4] and s["sets/modes"][:].tolist() == [3, 3, 0, 0, 3]
    for what in "emission", "emission_sd", "sets/bars_doubt":
        assert np.array_equal(s[what][:], f[what][:]), what
    assert np.array_equal(s["emission_modes"][:][[0, 1, 4]], f["emission_modes"][:][[0, 1, 4]])
    n = len(c["sets/number"])
    kept = c["sets/modes"][:]
    assert n >= 1 and c["sets/number"][:].tolist() == list(range(n)) and np.array_equal(c["emission"][:], f["emission"][:n])
    assert 0 < (kept == 3).sum() < 4, kept  # the cut took bars away
    for k in range(n):
        assert np.array_equal(c["emission_modes"][k], f["emission_modes"][k]) if kept[k] else not c["emission_modes"][k].any()
with h5py.File("1.h5", "r") as f, h5py.File("bare-last.h5", "r") as s:
    assert s["sets/number"][:].tolist() == [0, 1, 2, 4] and s["sets/bars_doubt"][:].tolist() == [0] + 3 * [0xffffffff]
    assert np.array_equal(s["emission"][:], f["emission"][:][[0, 1, 2, 4]])
END
}
check damage_and_cuts damaged
exit $rc
