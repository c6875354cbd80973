#!/bin/bash
# Recordings of volumes: recorded, converted, played again, and read by programs that are not ours.
name=032
. "$(dirname "$0")/lib.sh"
publish() { "$b/tests/unit/test_pub" --publish "$volumes" "$1" 0 & pub=$!; pids+=("$pub"); }
record() { # arguments: from the publisher of 12 volumes of 8 x 9 x 10 x 3
    publish 12
    timeout "$patience" "$pyrovox" record --endpoint "$volumes" --quiet "$@" > "$dir/log" 2>&1 || { cat "$dir/log"; return 1; }
    wait "$pub"
    grep -q '^12 volumes in .*, 0 messages lost$' "$dir/log" || { cat "$dir/log"; return 1; }
}

formats() {
    record --out "$dir/npy" && record --out "$dir/v.h5" && record --format vdb --out "$dir/vdb" && record --format nvdb --out "$dir/nvdb" || return 1
    [ "$(ls "$dir"/vdb/*.vdb | wc -l)" = 12 ] && [ "$(ls "$dir"/nvdb/*.nvdb | wc -l)" = 12 ]
}
check records_every_format formats

h5() { # h5dump and h5py: values, places, times, NeXus, ids, dimension scales, ASCII for Octave
    h5dump -d /sets/number "$dir/v.h5" | grep -q '(0): 0, 1, 2, 3' && h5dump -H "$dir/v.h5" > "$dir/h5.log" || return 1
    "$py" - "$dir" <<'PY'
import json, sys, h5py, numpy as np
d = sys.argv[1]
f = h5py.File(f"{d}/v.h5", "r")
text = lambda at, name: at.attrs[name].decode() if isinstance(at.attrs[name], bytes) else at.attrs[name]
assert text(f, "format") == "pyrovox volumes" and f.attrs["closed"] == 1
for s in range(12):
    a, j = np.load(f"{d}/npy/{s:06d}.npy"), json.load(open(f"{d}/npy/{s:06d}.json"))
    assert a.any() and np.array_equal(f["emission"][s], a), s
    assert f["sets/t_exposure_ns"][s] == j["t_exposure_ns"] and f["sets/number"][s] == j["set"]
    for axis, n in enumerate("xyz"):
        want = j["origin"][axis] + (np.arange(len(f[n])) + 0.5) * j["spacing"][axis]
        assert np.allclose(f[n][:], want, rtol=0, atol=1e-12), n
assert abs(f["sets/time"][3] - 3 * 0.066666667) < 1e-9
for entry, signal, rank in ("entry", "emission", 5), (text(f, "default"), "red", 4): # the last: shown by itself, y against x
    data = f[entry]
    data = data[text(data, "default")]
    axes = [a.decode() for a in data.attrs["axes"]]
    assert text(data, "NX_class") == "NXdata" and text(data, "signal") == signal and data[signal].ndim == rank
    assert axes == ["time", "z", "y", "x", "channel"][:rank] and all(len(data[a]) == data[signal].shape[k] for k, a in enumerate(axes)), axes
    assert [d[0] == f[a] for d, a in zip(data[signal].dims, axes)] == [True] * rank
for c, colour in enumerate(("red", "green", "blue")):
    assert np.array_equal(f["flame/data"][colour][:], f["emission"][..., c]), colour
for id in "session", "rig_hash":
    assert f[id][()].decode() == str(f.attrs[id]), id
assert f["config"].id.get_type().get_cset() == h5py.h5t.CSET_ASCII == f.attrs.get_id("format").get_type().get_cset()
PY
    command -v ncdump > /dev/null || { echo "SKIP $name:ncdump (apt-get install netcdf-bin)"; return 0; }
    ncdump -h "$dir/v.h5" | grep -q 'float emission(time, z, y, x, channel)' && ncdump -v session "$dir/v.h5" | grep -q 'session = '
}
check h5py_and_h5dump_read_it h5

vtk() { # ParaView's reader, on one volume; it gives the voxels' centres
    timeout "$patience" "$pyrovox" convert "$dir/v.h5" "$dir/one.h5" --from 5 --to 5 > "$dir/log" 2>&1 || { cat "$dir/log"; return 1; }
    "$py" - "$dir" <<'PY'
import sys, json, numpy as np
from vtkmodules.vtkIOHDF import vtkHDFReader
from vtkmodules.util.numpy_support import vtk_to_numpy
d = sys.argv[1]
r = vtkHDFReader()
r.SetFileName(f"{d}/one.h5")
r.Update()
o, a, j = r.GetOutput(), np.load(f"{d}/npy/000005.npy"), json.load(open(f"{d}/npy/000005.json"))
assert o.GetDimensions() == a.shape[2::-1], o.GetDimensions()
got = vtk_to_numpy(o.GetPointData().GetArray("emission")).reshape(a.shape)
assert np.array_equal(got, a)
assert np.allclose(o.GetOrigin(), np.array(j["origin"]) + np.array(j["spacing"]) / 2)
assert np.allclose(o.GetSpacing(), j["spacing"])
PY
}
check paraview_reads_one_volume vtk

vdb() { # vdb_print, python's openvdb, nanovdb_validate
    vdb_print "$dir/vdb/vdb_0003.vdb" > "$dir/vdb.log" 2>&1 && grep -q density "$dir/vdb.log" && grep -q emission "$dir/vdb.log" || { cat "$dir/vdb.log"; return 1; }
    valid_nvdb "$dir/nvdb/nvdb_0003.nvdb" || return 1
    "$py" - "$dir" <<'PY'
import json, sys, numpy as np
import pyopenvdb as vdb
d = sys.argv[1]
a, j = np.load(f"{d}/npy/000002.npy"), json.load(open(f"{d}/npy/000002.json"))
grids = {g.name: g for g in vdb.readAll(f"{d}/vdb/vdb_0003.vdb")[0]}
g = grids["emission"]
seen = 0
for item in g.iterOnValues():
    x, y, z = item.min
    assert np.allclose(item.value, a[z, y, x], rtol=1e-3), (item.min, item.value, a[z, y, x])
    seen += 1
assert seen == np.count_nonzero(a.any(axis=3)), seen
at = g.transform.indexToWorld((1, 2, 3))
assert np.allclose(at, [j["origin"][k] + (i + 0.5) * j["spacing"][k] for k, i in enumerate((1, 2, 3))], atol=1e-6), at
assert grids["density"].saveFloatAsHalf
PY
}
check others_read_vdb_and_nvdb vdb

oracle() { # what nanovdb_convert makes of the .vdb of a volume: every node of ours byte for byte, and a head that says the same
    "$b/tests/unit/test_vdb" --write "$dir/made" > /dev/null || return 1
    local k
    for k in $(seq 0 15); do
        nanovdb_convert -f -c none -s all "$dir/made/v$k/v${k}_0001.vdb" "$dir/oracle.nvdb" > /dev/null || return 1
        "$py" - "$dir/made/n$k/n${k}_0001.nvdb" "$dir/oracle.nvdb" "$k" <<'PY' || return 1
import struct, sys
def grids(path): # heads and names of several, then they themselves; as often as there are such parts
    b, at, out = open(path, "rb").read(), 0, {}
    while at < len(b):
        n, at, heads = struct.unpack_from("<H", b, at + 12)[0], at + 16, []
        for _ in range(n):
            size, name = struct.unpack_from("<Q", b, at)[0], struct.unpack_from("<I", b, at + 136)[0]
            heads.append((b[at + 176:at + 175 + name].decode(), size))
            at += 176 + name
        for name, size in heads:
            out[name] = b[at:at + size]
            at += size
    return out
ours, theirs = grids(sys.argv[1]), grids(sys.argv[2])
grey, split = int(sys.argv[3]) & 8, int(sys.argv[3]) & 2
assert set(ours) == set(theirs) == {"density"} | (set() if grey else {"red", "green", "blue"} if split else {"emission"}), (set(ours), set(theirs))
for name, a in ours.items():
    b = theirs[name]
    assert a[16:32] == b[16:32] and a[40:296] == b[40:296] and a[632:640] == b[632:640], name # version, flags, number, name, class, type
    for form, at, n in (("f", 296, 22), ("d", 384, 22), ("d", 560, 9)): # map, box, size of a voxel
        for x, y in zip(struct.unpack_from(f"<{n}{form}", a, at), struct.unpack_from(f"<{n}{form}", b, at)):
            assert abs(x - y) <= (1e-6 if form == "f" else 1e-12) * max(1, abs(y)), (name, at, x, y)
    if grey or name != "density": # the luminance of a .vdb was rounded to half
        assert a[672:len(b)] == b[672:], (name, [i for i in range(672, len(b)) if a[i] != b[i]][:9])
PY
    done
}
check nvdb_is_what_nanovdb_makes_of_the_vdb oracle

circle() { # npy -> hdf5 -> vdb -> npy
    for step in "npy c.h5" "c.h5 c.vdb --format vdb" "c.vdb back --format npy"; do
        set -- $step
        timeout "$patience" "$pyrovox" convert "$dir/$1" "$dir/$2" ${3:+$3 $4} > "$dir/log" 2>&1 || { cat "$dir/log"; return 1; }
    done
    "$py" - "$dir" <<'PY'
import sys, glob, json, numpy as np
d = sys.argv[1]
names = sorted(glob.glob(f"{d}/npy/0*.npy"))
assert len(names) == 12 == len(glob.glob(f"{d}/back/0*.npy"))
for n in names:
    m = n.replace("/npy/", "/back/")
    assert np.array_equal(np.load(n), np.load(m)), n
    a, b = (json.load(open(x.replace(".npy", ".json"))) for x in (n, m))
    assert a["t_exposure_ns"] == b["t_exposure_ns"] and a["report"]["solver"] == b["report"]["solver"]
    assert np.allclose(a["origin"], b["origin"], atol=1e-9) and np.allclose(a["spacing"], b["spacing"], rtol=1e-9)
PY
}
check converted_there_and_back circle

again() { # played, and recorded once more
    "$pyrovox" play "$dir/v.h5" --speed 0 --endpoint "$volumes" > "$dir/play.log" 2>&1 & local p=$!; pids+=("$p")
    timeout "$patience" "$pyrovox" record --endpoint "$volumes" --quiet --out "$dir/copy.h5" > "$dir/log" 2>&1 || { cat "$dir/log" "$dir/play.log"; return 1; }
    wait "$p" || { cat "$dir/play.log"; return 1; }
    "$py" - "$dir" <<'PY'
import sys, h5py, numpy as np
a, b = (h5py.File(f"{sys.argv[1]}/{n}.h5", "r") for n in ("v", "copy"))
assert np.array_equal(a["emission"][:], b["emission"][:]) and a["emission"].shape[0] == 12
for c in a["sets"]:
    if c not in ("t_publish_ns", "latency_ns", "check"):
        assert np.array_equal(a["sets"][c][:], b["sets"][c][:]), c
PY
}
check played_and_recorded_again again

repaired() { # killed in mid-recording: h5py reads it when it is finished, and the original is kept
    "$b/tests/unit/test_pub" --publish "$volumes" 12 0 no-end & local p=$!; pids+=("$p")
    "$pyrovox" record --endpoint "$volumes" --quiet --out "$dir/cut.h5" > "$dir/log" 2>&1 & local rec=$!; pids+=("$rec")
    # the reader of a file that is being written
    wait_for "$py" -c 'import sys, h5py; sys.exit(h5py.File(sys.argv[1], "r", libver="latest", swmr=True, locking=False)["sets/number"].shape[0] < 12)' "$dir/cut.h5" 2> /dev/null || return 1
    kill -KILL "$rec"; wait "$rec" 2>/dev/null; kill "$p" 2>/dev/null
    run "$pyrovox" repair "$dir/cut.h5"; says 0 "12 volumes, finished" "cut.h5.cut-off" || return 1
    [ -s "$dir/cut.h5.cut-off" ] && "$py" -c 'import sys, h5py; a, b = (h5py.File(n, "r")["emission"][:] for n in sys.argv[1:]); assert (a == b).all() and a.any()' "$dir/cut.h5" "$dir/v.h5" || return 1
    run "$pyrovox" repair "$dir/cut.h5"; says 0 "nothing to repair"
}
check repaired_after_a_kill repaired

repacked() { # h5repack writes the chunks without flame too, as zeros, and may lay the volumes out anew
    "$py" - "$dir/sparse" <<'PY' || return 1
import json, os, sys, numpy as np
os.makedirs(d := sys.argv[1])
for s in 998, 999999, 1000000:
    a = np.zeros((50, 40, 34, 3), np.float32)
    a[20:30, 18:30, 3:9] = np.random.default_rng(s).random((10, 12, 6, 3))
    np.save(f"{d}/{s:06d}.npy", a)
    json.dump({"set": s, "shape": a.shape, "origin": [0, 0, 0], "spacing": [.1, .1, .2], "basis": "box", "units": "1/m"}, open(f"{d}/{s:06d}.json", "w"))
PY
    "$pyrovox" convert "$dir/sparse" "$dir/sparse.h5" > "$dir/log" 2>&1 || { cat "$dir/log"; return 1; }
    [ "$(h5dump -d /sets/number "$dir/sparse.h5" | grep '(0)')" = "   (0): 998, 999999, 1000000" ] || return 1
    local how n
    for how in "-f GZIP=1" "-f SHUF -f GZIP=6" "-f NONE" "-l emission:CHUNK=2x8x8x8x3" "-l emission:CONTI -f NONE"; do
        # shellcheck disable=SC2086
        h5repack $how "$dir/sparse.h5" "$dir/r.h5" && "$pyrovox" convert "$dir/r.h5" "$dir/r" --format npy > "$dir/log" 2>&1 || { echo "  $how"; cat "$dir/log"; return 1; }
        for n in "$dir"/sparse/*.npy; do cmp -s <(tail -c 816000 "$n") <(tail -c 816000 "$dir/r/${n##*/}") || { echo "  $how: ${n##*/}"; return 1; }; done
        run "$pyrovox" repair "$dir/r.h5"; says 0 "3 volumes, nothing to repair" || return 1
        rm -r "$dir/r.h5" "$dir/r"
    done
}
check read_after_h5repack repacked

filtered() { # by a filter that only h5py has: named, and not taken for a file that was cut
    "$py" - "$dir/sparse.h5" "$dir/lzf.h5" <<'PY' || return 1
import sys, h5py
with h5py.File(sys.argv[1], "r") as a, h5py.File(sys.argv[2], "w") as b:
    for k in a:
        if k != "emission": a.copy(k, b)
    for k, v in a.attrs.items(): b.attrs[k] = v
    b.create_dataset("emission", data=a["emission"][:], compression="lzf", chunks=True)
PY
    run "$pyrovox" convert "$dir/lzf.h5" "$dir/lzf" --format npy
    says 1 "lzf.h5: is compressed by HDF5 filter 32000"
}
check unknown_filters_are_named filtered

damaged() { # one of a recording that was closed: convert names it, and repair leaves it out
    cp "$dir/sparse.h5" "$dir/spoiled.h5"
    "$py" -c 'import sys, h5py; h5py.File(sys.argv[1], "r+")["emission"][1, 20, 20, 4, 0] += 1' "$dir/spoiled.h5"
    run "$pyrovox" convert "$dir/spoiled.h5" "$dir/x.h5"; says 1 "spoiled.h5: volume 1 is damaged" || return 1
    run "$pyrovox" repair "$dir/spoiled.h5"; says 0 "2 volumes, finished; 1 damaged" || return 1
    run "$pyrovox" convert "$dir/spoiled.h5" "$dir/y.h5"; says 0 "2 volumes in"
}
check convert_and_repair_agree damaged

refused() {
    run "$pyrovox" convert "$dir/npy" "$dir/v.h5"; says 1 "v.h5" "already" || return 1
    run "$pyrovox" convert "$dir/nothing" "$dir/x.h5"; says 1 "nothing" || return 1
    run "$pyrovox" record --format foo; says 2 "npy, hdf5, vdb or nvdb" || return 1
    run "$pyrovox" record --out "$dir/v.h5"; says 1 "v.h5" "already" || return 1
    head -c 1000 "$dir/v.h5" > "$dir/short.h5"
    run "$pyrovox" play "$dir/short.h5" --endpoint "$volumes"; says 1 "short.h5"
}
check refuses_with_a_sentence refused
exit $rc
