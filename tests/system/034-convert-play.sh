#!/bin/bash
# Recordings of volumes made into each other and played: voxels that are no cubes, every layout, floats, parts,
# Ctrl-C, keys; and what cannot be converted or played, with its sentence.
name=034
. "$(dirname "$0")/lib.sh"
convert() { timeout "$patience" "$pyrovox" convert "$@" > "$dir/convert.log" 2>&1 || { cat "$dir/convert.log"; return 1; }; }
"$b/tests/unit/test_pub" --publish "$volumes" 12 0 & pub=$!; pids+=("$pub")
timeout "$patience" "$pyrovox" record --endpoint "$volumes" --quiet --out "$dir/pub" > "$dir/record.log" 2>&1; wait "$pub"
# the same with voxels that are no cubes, and values that no half holds
"$py" - "$dir/pub" "$dir/made" <<'PY'
import glob, json, os, shutil, sys, numpy as np
src, out = sys.argv[1:]
shutil.copytree(src, out)
for n in glob.glob(f"{out}/0*.json"):
    j = json.load(open(n))
    j.update(origin=[-0.3, 0.2, 1.1], spacing=[0.08, 0.05, 0.11], sample="float32")
    json.dump(j, open(n, "w"))
    a = n[:-4] + "npy"
    np.save(a, (np.load(a) * np.float32(1.0001)).astype(np.float32))
PY

played() { # floats and places arrive as they are, through the real recorder
    timeout "$patience" "$pyrovox" play "$dir/made" --speed 0 --quiet --endpoint "$volumes" & local p=$!
    timeout "$patience" "$pyrovox" record --endpoint "$volumes" --quiet --out "$dir/src.h5" > "$dir/record.log" 2>&1 || { cat "$dir/record.log"; return 1; }
    ended "$p" 0 && convert "$dir/src.h5" "$dir/src" --format npy && same 0 "$dir/made" "$dir/src"
}
same() { # relative difference, two folders of .npy: values, sets, times, places
    "$py" - "$@" <<'PY'
import glob, json, os, sys, numpy as np
rel, a, b = float(sys.argv[1]), *sys.argv[2:]
names = sorted(os.path.basename(n) for n in glob.glob(f"{a}/0*.npy"))
assert names and names == sorted(os.path.basename(n) for n in glob.glob(f"{b}/0*.npy")), (a, b)
for n in names:
    x, y = np.load(f"{a}/{n}"), np.load(f"{b}/{n}")
    assert x.any() and np.allclose(x, y, rtol=rel, atol=0), n
    i, j = (json.load(open(f"{d}/{n[:-3]}json")) for d in (a, b))
    for k in "set", "t_exposure_ns", "cameras_present", "camera_mask", "basis", "units":
        assert i[k] == j[k], (k, i[k], j[k])
    assert i["report"]["solver"] == j["report"]["solver"] and i["report"]["iterations"] == j["report"]["iterations"]
    assert np.allclose(i["origin"], j["origin"], atol=1e-9) and np.allclose(i["spacing"], j["spacing"], rtol=1e-9)
PY
}
check floats_are_played played

circle() { # each into each; what went through a .vdb is a half
    convert "$dir/src.h5" "$dir/c1.nvdb" && convert "$dir/c1.nvdb" "$dir/c2" --format npy && same 0 "$dir/made" "$dir/c2" &&
        convert "$dir/c1.nvdb" "$dir/c3.h5" && convert "$dir/c3.h5" "$dir/c4" --format npy && same 0 "$dir/made" "$dir/c4" &&
        convert "$dir/c1.nvdb" "$dir/c5.vdb" && convert "$dir/c5.vdb" "$dir/c6" --format npy && same 5e-4 "$dir/made" "$dir/c6" &&
        convert "$dir/c5.vdb" "$dir/c7.nvdb" && convert "$dir/c7.nvdb" "$dir/c8" --format npy && same 0 "$dir/c6" "$dir/c8"
}
check each_into_each circle

layouts() { # other programs find each voxel where the .npy has it
    local f o
    for f in vdb nvdb; do
        for o in "" "--split" "--up y --unit cm" "--split --up y" "--unit cm"; do
            # shellcheck disable=SC2086
            convert "$dir/src.h5" "$dir/$f${o// /}" --format $f $o && convert "$dir/$f${o// /}" "$dir/$f${o// /}-back" --format npy || return 1
            same 5e-4 "$dir/made" "$dir/$f${o// /}-back" || return 1
        done
    done
    for f in "$dir"/nvdb*/*.nvdb; do valid_nvdb "$f" || return 1; done
    "$py" - "$dir" <<'PY'
import glob, json, sys, numpy as np
import pyopenvdb as vdb
d = sys.argv[1]
a, j = np.load(f"{d}/made/000002.npy"), json.load(open(f"{d}/made/000002.json"))
centre = lambda v: [j["origin"][k] + (v[k] + 0.5) * j["spacing"][k] for k in range(3)] # x, y, z in metres
for o in "", "--split", "--upy--unitcm", "--split--upy", "--unitcm":
    names = sorted(glob.glob(f"{d}/vdb{o}/*.vdb"))
    assert len(names) == 12, o
    assert vdb.readAllGridMetadata(names[2])[0].name == "density", o # what a program shows by itself
    every, meta = vdb.readAll(names[2])
    vdb.write(f"{d}/again{o}.vdb", every, meta) # numbers that fit become int32
    vdb.write(f"{d}/bare.vdb", every)
    grids = {g.name: g for g in every}
    assert set(grids) == {"density"} | ({"red", "green", "blue"} if "split" in o else {"emission"}), o
    unit, up = 100 if "cm" in o else 1, "upy" in o
    where = {}
    for z, y, x in np.argwhere(a.any(axis=3)):
        p = np.array(centre((x, y, z))) * unit
        where[tuple(np.round((p[0], p[2], -p[1]) if up else p, 6))] = a[z, y, x]
    for c, name in enumerate(["red", "green", "blue"] if "split" in o else ["emission"]):
        seen = 0
        for item in grids[name].iterOnValues():
            at = tuple(np.round(grids[name].transform.indexToWorld(item.min), 6))
            want = where[at][c] if "split" in o else where[at]
            assert np.allclose(item.value, want, rtol=5e-4), (o, at, item.value, want)
            seen += 1
        assert seen == len(where), (o, name, seen)
PY
    mkdir "$dir/one" && cp "$dir"/made/000002.* "$dir/one"
    for o in "" --split --upy--unitcm --split--upy --unitcm; do
        convert "$dir/again$o.vdb" "$dir/again$o" --format npy && same 5e-4 "$dir/one" "$dir/again$o" || return 1
    done
    run "$pyrovox" convert "$dir/bare.vdb" "$dir/bare" --format npy; says 1 bare.vdb "metadata are missing" "copy-file-metadata"
}
check other_programs_find_each_voxel layouts

changed() { # by another program, so that a voxel is not where, or not what, the metadata say
    "$py" - "$dir" <<'PY' || return 1
import sys, pyopenvdb as vdb
def changed(name, change):
    grids, meta = vdb.readAll(f"{sys.argv[1]}/again.vdb")
    emission = next(g for g in grids if g.name == "emission")
    vdb.write(f"{sys.argv[1]}/{name}.vdb", grids + (change(emission) or []), meta)
def another(grid):
    other = vdb.Vec3SGrid()
    other.name = grid.name
    return [other]
changed("moved", lambda g: g.transform.translate((0.02, 0, 0)))
changed("scaled", lambda g: g.transform.scale(1.01))
changed("turned", lambda g: g.transform.rotate(0.1))
changed("filled", lambda g: setattr(g, "background", (1, 1, 1)))
changed("twofold", another)
PY
    local f
    for f in moved scaled turned; do
        run "$pyrovox" convert "$dir/$f.vdb" "$dir/$f" --format npy; says 1 "$f.vdb: its grid is not where" || return 1
    done
    run "$pyrovox" convert "$dir/filled.vdb" "$dir/filled" --format npy; says 1 "filled.vdb: its background is not 0" || return 1
    run "$pyrovox" convert "$dir/twofold.vdb" "$dir/twofold" --format npy; says 1 "twofold.vdb: has several grids of one name"
}
check changed_grids_are_refused changed

validates() { # the check above can fail
    cp "$dir"/nvdb/nvdb_0003.nvdb "$dir/bad.nvdb"
    "$py" - "$dir/bad.nvdb" <<'PY'
import sys
f = open(sys.argv[1], "r+b"); f.seek(16 + 176 * 2 + 8 + 9 + 300); f.write(b"\xff" * 64)
PY
    ! valid_nvdb "$dir/bad.nvdb" > /dev/null
}
check a_bad_nvdb_is_not_validated validates

clamped() { # beyond what a half holds, and files without times
    mkdir "$dir/bright" && "$py" - "$dir/made" "$dir/bright" <<'PY' || return 1
import json, sys, numpy as np
for s in 1, 2:
    j = json.load(open(f"{sys.argv[1]}/00000{s}.json"))
    json.dump({**j, "t_exposure_ns": 0}, open(f"{sys.argv[2]}/00000{s}.json", "w"))
    np.save(f"{sys.argv[2]}/00000{s}.npy", np.load(f"{sys.argv[1]}/00000{s}.npy") * np.float32(1e9 if s == 2 else 1))
PY
    run "$pyrovox" convert "$dir/bright" "$dir/bright.vdb"; says 0 "1 volumes have values beyond 65504" || return 1
    convert "$dir/bright.vdb" "$dir/bright-back" --format npy && grep -q '"clamped":true' "$dir/bright-back/000002.json" && grep -q '"clamped":false' "$dir/bright-back/000001.json" || return 1
    run "$pyrovox" convert "$dir/bright" "$dir/bright.nvdb"; says 0 && [[ $out != *65504* ]] || return 1
    run "$pyrovox" convert "$dir/bright" "$dir/timed.vdb" --fps 15; says 1 bright "no times" && [ ! -e "$dir/timed.vdb" ]
}
check clamped_values_and_missing_times_are_said clamped

twice() { # a set that comes again has no file of its own
    mkdir "$dir/twice" && cp "$dir/made/000002.npy" "$dir/twice/a.npy" && cp "$dir/made/000002.json" "$dir/twice/a.json" &&
        cp "$dir/twice/a.npy" "$dir/twice/b.npy" && cp "$dir/twice/a.json" "$dir/twice/b.json" || return 1
    run "$pyrovox" convert "$dir/twice" "$dir/twice.vdb"; says 0 "1 volumes in" "1 volumes are left out" || return 1
    run "$pyrovox" convert "$dir/twice" "$dir/twice.h5"; says 0 "2 volumes in"
}
check sets_that_come_again_are_said twice

rate() { # 15 sets a second as 30 and as 5 files; which set each shows is listed
    convert "$dir/src.h5" "$dir/fast" --format vdb --fps 30 && convert "$dir/src.h5" "$dir/slow" --format nvdb --fps 5 || return 1
    "$py" - "$dir" <<'PY'
import glob, json, sys
for name, fps, end in ("fast", 30, "vdb"), ("slow", 5, "nvdb"):
    j = json.load(open(f"{sys.argv[1]}/{name}/{name}.json"))
    assert j["closed"] and j["resampled"] and j["fps"] == fps and j["frames"] == len(glob.glob(f"{sys.argv[1]}/{name}/*.{end}")), j
    assert abs(j["frames"] - (1 + 11 / 15 * fps)) < 1.5, j["frames"]
    for s in j["shown"]:
        assert s["t_exposure_ns"] == 1767225600000000000 + s["set"] * 66666667, s
PY
}
check files_a_second rate

parts() { # one .npy, some sets
    convert "$dir/made/000004.npy" "$dir/one.h5" && convert "$dir/src.h5" "$dir/part" --format npy --from 3 --to 5 || return 1
    run "$pyrovox" convert "$dir/src.h5" "$dir/none.h5" --from 900 --to 907
    says 1 "src.h5: none of its sets, 0 to 11, is one from --from to --to" && [ ! -e "$dir/none.h5" ] || return 1
    [ "$(ls "$dir"/part/*.npy | xargs -n1 basename | tr '\n' ' ')" = "000003.npy 000004.npy 000005.npy " ] || return 1
    "$py" -c 'import sys, h5py, numpy as np; f = h5py.File(sys.argv[1], "r"); assert f["sets/number"][:].tolist() == [4] and np.array_equal(f["emission"][0], np.load(sys.argv[2]))' "$dir/one.h5" "$dir/made/000004.npy"
}
check parts_of_a_recording parts

"$py" - "$dir/made" "$dir/long" <<'PY'
import json, os, shutil, sys
src, out = sys.argv[1:]
os.mkdir(out)
j = json.load(open(f"{src}/000003.json"))
shutil.copy(f"{src}/000003.npy", f"{out}/first")
for s in range(4000):
    j["set"] = s
    os.link(f"{out}/first", f"{out}/{s:06d}.npy")
    json.dump(j, open(f"{out}/{s:06d}.json", "w"))
os.unlink(f"{out}/first")
PY
stopped() { # Ctrl-C: what is finished is whole, and closed
    local f=$1 to=$dir/stopped.$1 n
    [ "$f" = hdf5 ] && to=$dir/stopped.h5
    rm -f "$dir/stopped.log" # the format before has one, which must not be taken for this one's
    start stopped.log "$pyrovox" convert "$dir/long" "$to" --format "$f"
    wait_for grep -q 'converting: [1-9]' "$dir/stopped.log" || return 1
    kill -INT "$started"; ended "$started" 130 || return 1
    n=$(sed -n 's/^\([0-9]*\) volumes in .*/\1/p' "$dir/stopped.log")
    [ "${n:-0}" -gt 0 ] && [ "$n" -lt 4000 ] || { cat "$dir/stopped.log"; return 1; }
    run "$pyrovox" convert "$to" "$dir/stopped-$f-back" --format npy --to 0
    says 0 "volumes in" && ! grep -q "cut off" <<< "$out" || return 1
    run "$pyrovox" repair "$to"; says 0 "$n " "nothing to repair"
}
stopped_all() { local f; for f in npy hdf5 vdb nvdb; do stopped $f || { echo "  $f"; return 1; }; done; }
check interrupted_is_whole stopped_all

skipped() { # sets that are not there, or not solved, are gaps of who records what is played
    cp -r "$dir/made" "$dir/holes" && rm "$dir"/holes/00000[347].* || return 1
    timeout "$patience" "$pyrovox" play "$dir/holes" --speed 0 --quiet --endpoint "$volumes" & local p=$!
    run "$pyrovox" record --endpoint "$volumes" --quiet --out "$dir/holes.h5"; says 0 "9 volumes in" " 0 messages lost" && ended "$p" 0 || return 1
    convert "$dir/holes.h5" "$dir/late.h5" --from 4 || return 1 # in the middle of a gap
    "$py" -c 'import sys, h5py
for name, first in zip(sys.argv[1:], (3, 4)):
    g = h5py.File(name, "r")["gaps"]
    g = [[int(x) for x in g[k]] for k in ("why", "set_first", "set_last", "volumes")]
    assert g == [[0, 0], [first, 7], [4, 7], [0, 0]], (name, g)' "$dir/holes.h5" "$dir/late.h5"
}
check gaps_are_played skipped

unsolved() { # sets that the recording knows to be unsolved are not lost for the reader of what is played
    "$py" - "$dir/holes" <<'PY' || return 1
import glob, json, sys
for n in glob.glob(sys.argv[1] + "/*.json"):
    j = json.load(open(n))
    if "gaps" in j or "closed" in j:
        j["gaps"] = [{"why": "unsolved", "set_first": 4, "set_last": 4, "volumes": 1}, {"why": "unsolved", "set_first": 7, "set_last": 7, "volumes": 1},
                     {"why": "unsolved", "set_first": 12, "set_last": 15, "volumes": 3}]
        json.dump(j, open(n, "w")); break
else: sys.exit("  no list of the recording's gaps")
PY
    timeout "$patience" "$pyrovox" play "$dir/holes" --speed 0 --quiet --endpoint "$volumes" & local p=$!
    run "$pyrovox" record --endpoint "$volumes" --quiet --out "$dir/unsolved.h5"; says 0 "9 volumes in" " 0 messages lost" && ended "$p" 0 || return 1
    "$py" -c 'import sys, h5py
g = h5py.File(sys.argv[1], "r")["gaps"]
g = [[int(x) for x in g[k]] for k in ("why", "set_first", "set_last", "volumes")]
assert g == [[0, 3, 3, 3], [3, 4, 7, 12], [3, 4, 7, 15], [0, 1, 1, 3]], g' "$dir/unsolved.h5"
}
check unsolved_sets_are_not_lost unsolved

looped() { # each time a session of its own, until Ctrl-C, which subscribers are told; at speed 0 none misses the end
    start play.log "$pyrovox" play "$dir/src.h5" --loop --speed 0 --endpoint "$volumes"
    local p=$started
    start record.log "$pyrovox" record --endpoint "$volumes" --out "$dir/loop.h5"
    local rec=$started
    wait_for grep -q 'the daemon \(restarted\|ended\)' "$dir/record.log" || return 1
    [ "$(grep -c 'daemon ended: end of the recording' "$dir/record.log")" -ge 1 ] && ended "$rec" 0 || return 1
    start record.log "$pyrovox" record --endpoint "$volumes" --out "$dir/loop2.h5"
    rec=$started
    wait_for grep -q '^recording ' "$dir/record.log" || return 1
    kill -INT "$p"; ended "$p" 130 && ended "$rec" 0 && grep -qE 'daemon ended: (stopped|end of the recording)' "$dir/record.log"
}
check plays_again_and_again looped

free_ports 1 && port=${ports[0]}
keyed() { # other hosts reach it: refused without keys, and nobody without a key gets a volume
    run "$pyrovox" play "$dir/src.h5" --endpoint "tcp://*:$port"; says 1 keygen || return 1
    mkdir "$dir/keys"
    "$pyrovox" keygen "$dir/keys/lab" > /dev/null && "$pyrovox" keygen "$dir/keys/anna" --server "$dir/keys/lab.pub" > /dev/null || return 1
    "$pyrovox" keygen "$dir/keys/eve" --server "$dir/keys/lab.pub" > /dev/null || return 1
    start play.log "$pyrovox" play "$dir/src.h5" --loop --speed 20 --endpoint "tcp://*:$port" --key "$dir/keys/lab.key" --clients "$dir/keys/anna.pub"
    local p=$started
    timeout "$patience" "$pyrovox" record --endpoint "tcp://127.0.0.1:$port" --key "$dir/keys/anna.key" --volumes 3 --quiet --out "$dir/keyed" > "$dir/record.log" 2>&1 || { cat "$dir/record.log"; return 1; }
    run "$pyrovox" record --endpoint "tcp://127.0.0.1:$port" --key "$dir/keys/eve.key" --volumes 1 --quiet --out "$dir/eve"
    says 1 "refuses this key" || return 1
    run "$pyrovox" record --endpoint "tcp://127.0.0.1:$port" --volumes 1 --quiet --out "$dir/nobody"
    says 1 "asks for a key" || return 1
    kill -INT "$p"; ended "$p" 130 && [ "$(ls "$dir"/keyed/*.npy | wc -l)" = 3 ] && ! ls "$dir"/eve/*.npy "$dir"/nobody/*.npy 2> /dev/null
}
check played_to_those_with_a_key keyed

refused() {
    cp "$dir/src.h5" "$dir/later.h5"
    "$py" -c 'import sys, h5py; h5py.File(sys.argv[1], "r+").attrs.modify("version", 9)' "$dir/later.h5"
    run "$pyrovox" convert "$dir/later.h5" "$dir/x.h5"; says 1 later.h5 "version 9" "update it" || return 1
    cp -r "$dir/made" "$dir/nan"
    "$py" -c 'import sys, numpy as np; a = np.load(sys.argv[1]); a[3, 3, 3, 0] = np.nan; np.save(sys.argv[1], a)' "$dir/nan/000005.npy"
    run "$pyrovox" convert "$dir/nan" "$dir/x1.h5"; says 1 nan/000005.npy "not finite" || return 1
    cp -r "$dir/made" "$dir/other"
    "$py" -c 'import sys, numpy as np; np.save(sys.argv[1], np.load(sys.argv[1])[:4])' "$dir/other/000005.npy"
    run "$pyrovox" convert "$dir/other" "$dir/x2.h5"; says 1 000005.json "does not describe the .npy beside it" || return 1
    cp -r "$dir/made" "$dir/flat" && sed -i -z 's/"spacing":[^]]*]/"spacing": [1e-300, 1e-300, 1e-300]/' "$dir"/flat/*.json
    run "$pyrovox" convert "$dir/flat" "$dir/x5.h5"; says 1 "does not describe the .npy beside it" || return 1
    mkdir "$dir/bin" && cp "$pyrovox" "$dir/bin/" # without its modules
    run "$dir/bin/pyrovox" record --format vdb --out "$dir/x3"; says 1 libopenvdb10.0 "npy and hdf5 work without" || return 1
    run "$dir/bin/pyrovox" convert "$dir/vdb" "$dir/x4.h5"; says 1 libopenvdb10.0
}
check refuses_with_a_sentence refused
exit $rc
