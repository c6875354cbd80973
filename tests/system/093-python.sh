#!/bin/bash
# The Python package: as it is installed, what it makes of messages right and wrong, of a live daemon, of recordings.
name=093
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy, zmq' 2> /dev/null || { echo "no python3 with numpy and zmq (apt-get install python3-numpy python3-zmq)"; exit 77; }
has() { "$py" -c "import $1" 2> /dev/null; }
package=$PWD/proto/clients/python

pip_installs() { # offline, alone: the page is in it as a file
    has pip && has setuptools && has wheel || { echo "SKIP $name:pip (apt-get install python3-pip python3-setuptools python3-wheel)"; return 0; }
    mkdir -p "$dir/tree/clients" && cp -r "$package" proto/clients/pyrovox_sub.py "$dir/tree/clients/" || return 1
    (cd "$dir" && "$py" -m pip install -q --no-index --no-deps --no-build-isolation --target site ./tree/clients/python > pip.log 2>&1 &&
        PYTHONPATH=$dir/site "$py" -c 'import pyrovox, sys; sys.exit("/site/" not in pyrovox.__file__)' &&
        [ -f site/pyrovox/_page.py ] && ! [ -L site/pyrovox/_page.py ] && [ -f site/pyrovox/py.typed ])
}
check pip_installs pip_installs

installed() { # make install puts it beside the page
    systemd/install.sh "$b" "$dir/root" /usr && (cd "$dir" && PYTHONPATH=$dir/root/usr/lib/python3/dist-packages "$py" -c \
        'import pyrovox, pyrovox_sub, sys; sys.exit("/root/" not in pyrovox.__file__)') || return 1
    diff -r -x __pycache__ "$dir/root/usr/lib/python3/dist-packages/pyrovox" "$package/pyrovox" || return 1 # all of it
    systemd/install.sh --remove "$dir/root" /usr && ! [ -e "$dir/root/usr/lib/python3/dist-packages/pyrovox" ]
}
check installed installed
export PYTHONPATH=$package:$PWD/tests/lib

types() { (cd "$package" && "$py" -m mypy --strict --cache-dir "$dir/mypy" -p pyrovox > "$dir/mypy.log" 2>&1); }
if has mypy; then check types types; else echo "SKIP $name:types (apt-get install python3-mypy)"; fi

golden() {
    "$py" - <<'PY'
import glob, json, sys
import numpy as np
import pyrovox
bad, names = 0, sorted(glob.glob("proto/vectors/volume*.bin"))
for name in names:
    v, want = pyrovox.decode(open(name, "rb").read()), json.load(open(name[:-4] + ".json"))
    nx, ny, nz = want["n"]
    dense = np.zeros((nz * ny * nx, want["channels"]), np.float32)
    for index, *value in want["voxels"]:
        dense[index] = value
    dense = dense.reshape(nz, ny, nx, -1)
    again = np.zeros([8 * ((n + 7) // 8) for n in (nz, ny, nx)] + [want["channels"]], np.float32)
    bx, by = (nx + 7) // 8, (ny + 7) // 8
    for i, b in zip(v.ids, v.bricks):
        z, y, x = 8 * (i // bx // by), 8 * (i // bx % by), 8 * (i % bx)
        again[z : z + 8, y : y + 8, x : x + 8] = b
    r = want["report"]
    ok = (np.array_equal(v.dense, dense) and v.dense.dtype == v.bricks.dtype == np.float32 and
          np.array_equal(again[:nz, :ny, :nx], dense) and v.ids.dtype == np.uint32 and
          v.grid.shape == dense.shape and v.set == want["set"] and v.session == want["session"] and
          v.time == np.datetime64(want["t_exposure_ns"], "ns") and v.clamped == want["clamped"] and
          v.report.solver == r["solver"] and v.report.total_ns == r["total_ns"] and
          v.camera_mask == want["camera_mask"] and v.grid.min == tuple(want["min"]))
    if not ok:
        print(f"{name}: {v}"); bad += 1
sys.exit(bad > 0 or len(names) < 5)
PY
}
check golden_messages golden

others() { # messages that are no volumes, of this version and of a later one
    "$py" - <<'PY'
import json, os, sys
from pyrovox.live import Subscription
s, bad = Subscription("ipc:///tmp/pyrovox-nobody-is-here"), 0
def hear(kind, raw=None):
    s._next = 0
    s._message(raw or open(f"proto/vectors/{kind}.bin", "rb").read())
    return json.load(open(f"proto/vectors/{kind}.json"))
want = hear("start")
bad += s.grid is None or list(s.grid.n) != want["n"]
bad += hear("status")["status"] != s.status
for kind, has in ("rig", lambda m: s.rig == m["rig"] != ""), ("event", lambda m: list(s.events) == [m["event"]]):
    if os.path.exists(f"proto/vectors/{kind}.bin"):  # version 1.1
        bad += not has(hear(kind))
raw = bytearray(open("proto/vectors/end.bin", "rb").read())
raw[4:6] = (999).to_bytes(2, "little")
hear("end", bytes(raw))
bad += s._ended or s.malformed
bad += s.reason != "" or hear("end")["reason"] != s.reason or not s._ended
sys.exit(bad)
PY
}
check other_messages others

mutated() { # bytes changed, cut, repeated: a volume or a ValueError, and no more memory than was allowed
    "$py" - <<'PY'
import glob, random, resource, sys
import numpy as np
import pyrovox
from pyrovox.live import Subscription
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
random.seed(13)
read = refused = 0
messages = [open(n, "rb").read() for n in sorted(glob.glob("proto/vectors/*.bin"))]
sub = Subscription("ipc:///tmp/pyrovox-nobody-is-here", memory=1 << 24)
for _ in range(6000):
    b = bytearray(random.choice(messages))
    for _ in range(random.choice((1, 1, 2, 8))):
        at = random.randrange(random.choice((48, 300, len(b))) if len(b) > 300 else len(b))
        b[at] = random.choice((0, 1, 0x7F, 0x80, 0xFF, random.randrange(256)))
    if random.random() < 0.1:
        b = b[: random.randrange(len(b))]
    try:
        v = pyrovox.decode(bytes(b), memory=1 << 24)
        if v.dense.nbytes > 1 << 24 or not np.isfinite(v.dense).all() or v.bricks.shape[0] != len(v.ids):
            print("a volume that should not be", v); sys.exit(1)
        read += 1
    except ValueError:
        refused += 1
    try:  # and as the socket gives them
        sub._message(bytes(b))
    except ValueError:
        pass
    sub._next = 0
if read < 100 or refused < 1000 or sub.malformed < 1000:
    print(read, refused, sub); sys.exit(1)
PY
}
check mutated_messages mutated

claims() { # 1024^3, another grid than the session's, not finite
    "$py" - <<'PY'
import resource, struct, sys
import pyrovox
from pyrovox import volume, _page
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
raw = open("proto/vectors/volume-f16-clamped.bin", "rb").read()
at = _page.HEADER.size + struct.calcsize("<4IQ4qQI")
nan = raw[:316] + b"\x00\x7e" + raw[318:]
bad = 0
for what, error, call in (
        ("vast", pyrovox.TooLarge, lambda: pyrovox.decode(raw[:at] + struct.pack("<3I", 1024, 1024, 1024) + raw[at + 12:])),
        ("limit", pyrovox.TooLarge, lambda: pyrovox.decode(raw, memory=47)),
        ("nan", pyrovox.BadMessage, lambda: pyrovox.decode(nan)),
        ("start", pyrovox.BadMessage, lambda: pyrovox.decode(open("proto/vectors/start.bin", "rb").read()))):
    try:
        call(); print(what, "was taken"); bad += 1
    except error:
        pass
sys.exit(bad)
PY
}
check claims_of_room claims

publisher() { "$b/tests/unit/test_pub" --publish "$volumes" "$@" & pub=$!; pids+=("$pub"); }
live() { # every n-th left out; for, async for
    publisher 40 "$2"
    timeout "$patience" "$py" - "$volumes" "$1" "$2" <<'PY'
import asyncio, os, sys
import numpy as np
import pyrovox
endpoint, how, skip = sys.argv[1], sys.argv[2], int(sys.argv[3])
got = []
with pyrovox.subscribe(endpoint, timeout=int(os.environ["patience"])) as sub:
    if how == "for":
        got = list(sub)
    else:
        async def read():
            ticks = 0
            async def tick():
                nonlocal ticks
                while True:
                    ticks += 1
                    await asyncio.sleep(0)
            other = asyncio.create_task(tick())
            async for v in sub:
                got.append(v)
            other.cancel()
            return ticks
        if asyncio.run(read()) < len(got):
            sys.exit("nobody else ran")
bad = 0
for v in got:
    i = np.arange(720)
    want = (v.set % 64 + (i % 8) / 8)[:, None] + 64 * np.arange(3)[None, :]
    want[i % 3 != v.set % 3] = 0
    bad += not np.array_equal(v.dense, want.reshape(8, 9, 10, 3))
want = [s for s in range(40) if not skip or (s + 1) % skip]
ok = ([v.set for v in got] == want and not bad and sub.lost == 40 - len(want) == got[-1].lost + (skip > 0 and 40 % skip == 0)
      and sub.malformed == 0 and sub.reason and sub.grid == got[0].grid)
sys.exit(f"{len(got)} of {len(want)}, {bad} wrong, {sub}" if not ok else 0)
PY
    local r=$?
    wait "$pub" || r=1
    return $r
}
check live_values live for 0
check live_gaps live for 5
check live_async live async 5

newest() { # the last of what waits; what was passed over and what was lost are told apart
    publisher 10 0
    timeout "$patience" "$py" - "$volumes" <<'PY'
import os, sys
import pyrovox
with pyrovox.subscribe(sys.argv[1], newest=True, timeout=int(os.environ["patience"])) as sub:
    sub._socket.poll(600000)
    sets = [v.set for v in sub]  # all of it may have come, or some of it
    n = len(sets)
    ok = n and sets == sorted(set(sets)) and sets[-1] == 9 and n + sub.skipped == 10 and sub.lost == 0
    sys.exit(0 if ok else f"{sets}, {sub.skipped} skipped, {sub}")
PY
    local r=$?
    wait "$pub" || r=1
    return $r
}
check newest_only newest

interrupted() { # Ctrl-C while nothing comes
    cat > "$dir/wait.py" <<'PY'
import asyncio, signal, sys
import pyrovox
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background process ignores it
sub = pyrovox.subscribe(sys.argv[1])
try:
    print("waiting", flush=True)
    if sys.argv[2] == "for":
        for v in sub: pass
    else:
        async def read():
            async for v in sub: pass
        asyncio.run(read())
except KeyboardInterrupt:
    sub.close()
    sys.exit(42)
PY
    : > "$dir/wait.log"
    "$py" "$dir/wait.py" "ipc://$dir/nobody" "$1" > "$dir/wait.log" 2>&1 & local p=$!; pids+=("$p")
    wait_for grep -q waiting "$dir/wait.log" && sleep 0.3 && kill -INT "$p" && wait_for gone "$p"
    ended "$p" 42
}
check ctrl_c interrupted for
check ctrl_c_async interrupted async

late() { # says that nothing came
    run "$py" -c 'import pyrovox, sys; next(pyrovox.subscribe(sys.argv[1], timeout=0.2))' "ipc://$dir/nobody"
    says 1 "TimeoutError" "no volume in 0.2 s" || return 1
    run env RUNTIME_DIRECTORY="$dir/here:/else" "$py" -c 'import pyrovox; print(pyrovox.subscribe().endpoint)'
    says 0 "ipc://$dir/here/volumes" || return 1
    run "$py" -c 'import os, pyrovox; e = pyrovox.subscribe().endpoint; exit(e not in (f"ipc:///tmp/pyrovox-{os.geteuid()}/volumes", "ipc:///run/pyrovox/volumes"))'
    says 0 || return 1
    run "$py" -c 'import pyrovox; pyrovox.subscribe("nonsense")'
    says 1 "nonsense: is no endpoint"
}
check says_what_is_wrong late

recordings() {
    "$py" - "$dir" <<'PY'
import datetime, os, sys
import numpy as np
import h5py
import pyrovox
import volumes_h5 as w
dir, bad = sys.argv[1], 0
def must(what, ok):
    global bad
    if not ok:
        print("  ", what); bad += 1
def refuses(what, text, call, error=pyrovox.BadRecording):
    try:
        call(); must(what + " was taken", False)
    except error as e:
        must(f"{what}: {e}", text in str(e))
path = dir + "/a.h5"
w.write(path)
with pyrovox.open(path) as r:
    must("length", len(r) == 7 and r.sets.tolist() == [100, 101, 102, 104, 105, 106, 107] and r.closed)
    must("values", all(np.array_equal(v.dense, w.dense(v.set)) and v.dense.dtype == np.float32 for v in r))
    v = r.set(105)
    dense = np.zeros(tuple(8 * ((n + 7) // 8) for n in w.N[::-1]) + (3,), np.float32)
    bx, by = (w.N[0] + 7) // 8, (w.N[1] + 7) // 8
    for i, brick in zip(v.ids, v.bricks):
        z, y, x = 8 * (i // bx // by), 8 * (i // bx % by), 8 * (i % bx)
        dense[z : z + 8, y : y + 8, x : x + 8] = brick
    must("bricks", np.array_equal(dense[: w.N[2], : w.N[1], : w.N[0]], w.dense(105)) and 0 < len(v.ids) < 30 and
         (np.diff(v.ids.astype(int)) > 0).all())
    must("a row", v.set == 105 and v.session == w.SESSION and v.rig_hash == w.RIG_HASH and v.camera_mask == 0b1011 and
         v.clamped and v.report.solver == "pcg" and v.report.status == "converged" and v.report.rel_residual == 0.0625)
    must("lost", r.set(102).lost == 0 and v.lost == 1 and r.gaps == [pyrovox.Gap("lost", 103, 103, 1)])
    t = np.datetime64(w.T0 + 2 * w.PERIOD + 3_000_000, "ns")
    must("time", r[t].set == 102 and r[t + np.timedelta64(3600, "s")].set == 107 and r[np.datetime64("1970")].set == 100)
    must("datetime", r[datetime.datetime(2026, 1, 1, 0, 0, 0, 260000)].set == 105 and
         r[datetime.datetime(2026, 1, 1, 1, 0, 0, 260000, datetime.timezone(datetime.timedelta(hours=1)))].set == 105)
    sets = lambda some: [v.set for v in some]
    must("slices", sets(r[1:4]) == [101, 102, 104] and sets(r[-2:]) == [106, 107] and sets(r[:3]) == [100, 101, 102] and
         sets(r[::3]) == [100, 104, 107] and sets(r[np.datetime64(w.T0 + w.PERIOD, "ns"):np.datetime64(w.T0 + 4 * w.PERIOD, "ns")])
         == [101, 102] and sets(r[::-1])[0] == 107)
    must("from the end", r[-1].set == r[6].set == 107 and r[0].set == r[-7].set == 100)
    refuses("a set that is not there", "no set 103 (lost)", lambda: r.set(103), KeyError)
    refuses("a set for a place", "has 7 volumes, none is number 100; r.set(100) is", lambda: r[100], IndexError)
    must("grid", np.allclose(r.grid.x, w.ORIGIN[0] + (np.arange(40) + 0.5) * 0.025) and r.fps == 20 and r.rig == "version: 1\n")
    lazy = r.set(106)
refuses("closed", "was closed", lambda: lazy.dense, ValueError)

w.write(dir + "/cut.h5", closed=False)
with pyrovox.open(dir + "/cut.h5") as r:
    must("cut", not r.closed and len(list(r)) == 7 and "cut off" in repr(r))
with pyrovox.open(dir + "/cut.h5", follow=True, timeout=0.2) as r:
    refuses("cut, followed", "pyrovox repair", lambda: list(r), pyrovox.CutOff)

def made(name, **how):
    f = w.create(dir + name, **how)
    for s in 100, 101:
        w.put(f, s, np.zeros((33, 24, 40, 3), np.float32) if how.get("n", w.N) == w.N else np.zeros((1, 1, 1, 3)))
    return f
made("/later.h5", version=2).close()
refuses("a later version", "version 2", lambda: pyrovox.open(dir + "/later.h5"))
with made("/nan.h5") as f:
    f["emission"][1, 3, 3, 3, 0] = np.nan
with pyrovox.open(dir + "/nan.h5") as r:
    must("the other set", not r[0].dense.any())
    refuses("nan", "set 101 has a value that is not finite", lambda: r[1].dense)
    refuses("nan in bricks", "not finite", lambda: r[1].bricks)
w.create(dir + "/vast.h5", n=(1024, 1024, 1024)).close()
refuses("1024^3", "memory=BYTES", lambda: pyrovox.open(dir + "/vast.h5"), pyrovox.TooLarge)
refuses("a limit", "memory=BYTES", lambda: pyrovox.open(path, memory=1000), pyrovox.TooLarge)
w.create(dir + "/grid.h5", n=(40, 24, 32)).close()
refuses("another grid", "/z is of another grid", lambda: pyrovox.open(dir + "/grid.h5"))
with h5py.File(dir + "/else.h5", "w") as f:
    f["a"] = 1
with h5py.File(path, "r"):
    refuses("open twice", "open elsewhere in this process", lambda: pyrovox.open(path))
refuses("another file", "not a recording", lambda: pyrovox.open(dir + "/else.h5"))
refuses("text", "not a recording", lambda: pyrovox.open("Makefile"))
refuses("nothing", "no such recording", lambda: pyrovox.open(dir + "/none.h5"), FileNotFoundError)
# cut at any byte: what can be read is right, the rest is a sentence
raw = open(path, "rb").read()
for cut in range(0, len(raw), max(1, len(raw) // 60)):
    open(dir + "/bytes.h5", "wb").write(raw[:cut])
    try:
        with pyrovox.open(dir + "/bytes.h5") as r:
            must("cut bytes", all(np.array_equal(v.dense, w.dense(v.set)) for v in r))
    except ValueError:
        pass
# bytes changed: the same, and it ends
import random
random.seed(13)
refused = 0
for _ in range(150):
    b = bytearray(raw)
    for _ in range(random.choice((1, 8, 64))):
        b[random.randrange(len(b))] = random.randrange(256)
    open(dir + "/bytes.h5", "wb").write(b)
    try:
        with pyrovox.open(dir + "/bytes.h5", memory=1 << 26) as r:
            must("changed bytes", all(np.isfinite(v.dense).all() and v.bricks.nbytes < 1 << 26 for v in r))
    except ValueError:
        refused += 1
must(f"{refused} damaged ones refused", refused > 20)
sys.exit(bad > 0)
PY
}
if has h5py; then check recordings_in_hdf5 recordings; else echo "SKIP $name:recordings_in_hdf5 (apt-get install python3-h5py)"; fi

follows() { # a file that is being written, and then is closed | cut off
    rm -f "$dir/go"; mkfifo "$dir/go"
    : > "$dir/written"; : > "$dir/read.log"
    "$py" tests/lib/volumes_h5.py "$dir/$1.h5" 5 follow < "$dir/go" > "$dir/written" & local p=$!; pids+=("$p")
    exec 7> "$dir/go"
    wait_for grep -q 100 "$dir/written" || return 1
    timeout "$patience" "$py" - "$dir/$1.h5" "$1" > "$dir/read.log" 2>&1 <<'PY' & local reader=$!
import sys
import numpy as np
import pyrovox, volumes_h5
try:
    for v in pyrovox.open(sys.argv[1], follow=True, timeout=20 if sys.argv[2] == "cut" else 600):
        if not np.array_equal(v.dense, volumes_h5.dense(v.set)): sys.exit("wrong values")
        print("read", v.set, flush=True)
    print("closed")
except pyrovox.CutOff as e:
    print(e)
PY
    local s
    for s in 100 101 102 103; do
        wait_for grep -q "read $s" "$dir/read.log" || { cat "$dir/read.log"; return 1; }
        echo >&7
    done
    wait_for grep -q "read 104" "$dir/read.log" || return 1
    if [ "$1" = cut ]; then
        kill -9 "$p"
        wait "$p" 2> /dev/null
    else
        echo >&7
        wait "$p" || return 1
    fi
    exec 7>&-
    wait "$reader" && grep -q "$2" "$dir/read.log" || { cat "$dir/read.log"; return 1; }
}
if has h5py; then
    check follows_until_it_is_closed follows ended '^closed'
    check follows_until_it_is_cut_off follows cut 'cut off after 5 volumes'
fi

folder() { # of pyrovox record
    "$b/tests/unit/test_pub" --publish "$volumes" 6 0 & pub=$!; pids+=("$pub")
    "$pyrovox" record --endpoint "$volumes" --out "$dir/npy" --volumes 6 -q > "$dir/record.log" 2>&1 || return 1
    wait "$pub"
    "$py" - "$dir/npy" <<'PY'
import json, sys
import numpy as np
import pyrovox
r = pyrovox.open(sys.argv[1])
ok = len(r) == 6 and r[3].set == 3 and r[r.times[2]].t_exposure_ns == r[2].t_exposure_ns
for v in r:
    i = np.arange(720)
    want = (v.set % 64 + (i % 8) / 8)[:, None] + 64 * np.arange(3)[None, :]
    want[i % 3 != v.set % 3] = 0
    ok &= np.array_equal(v.dense, want.reshape(8, 9, 10, 3)) and len(v.ids) == (4 if v.set % 3 else 3)
    ok &= v.session == r.session != 0
if not ok: sys.exit(f"{r}")
# as `pyrovox reconstruct` describes volumes
for v in r:
    m = json.load(open(f"{sys.argv[1]}/{v.set:06d}.json"))
    m["frame"], m["time_ns"], m["clock"], m["solver"] = m.pop("set"), m.pop("t_exposure_ns"), "CLOCK_REALTIME", m.pop("report")
    m["frame"] += 999997
    import os
    os.makedirs(sys.argv[1] + "-frames", exist_ok=True)
    json.dump({**m, "units": "emission per metre"}, open(f"{sys.argv[1]}-frames/{v.set + 999997:06d}.json", "w"))
    np.save(f"{sys.argv[1]}-frames/{v.set + 999997:06d}.npy", v.dense)
for v, u in zip(r, f := pyrovox.open(sys.argv[1] + "-frames")):
    ok = (u.set == v.set + 999997 and u.t_exposure_ns == v.t_exposure_ns and np.array_equal(u.dense, v.dense) and
          u.report == v.report and u.units == "1/m")
    if not ok: sys.exit(f"{u} {v}")
if len(f) != 6: sys.exit("files of reconstruct")
np.save(sys.argv[1] + "-frames/0999999.npy", v.dense); json.dump(m, open(sys.argv[1] + "-frames/0999999.json", "w"))
try:
    pyrovox.open(sys.argv[1] + "-frames"); sys.exit("two of one number")
except ValueError as e:
    if "have one number" not in str(e): sys.exit(str(e))
import shutil
for s, change, text in (1, lambda to: os.remove(to), "000001.json: is missing"), \
                       (4, lambda to: shutil.copy(sys.argv[1] + "/000003.json", to), "000004.json: is of set 3"):
    part = f"{sys.argv[1]}-{s}"
    shutil.copytree(sys.argv[1], part)
    change(f"{part}/{s:06d}.json")
    try:
        pyrovox.open(part); sys.exit(f"{text} was not said")
    except ValueError as e:
        if text not in str(e): sys.exit(str(e))
a = np.load(sys.argv[1] + "/000002.npy"); a[0, 0, 0, 0] = np.inf; np.save(sys.argv[1] + "/000002.npy", a)
m = json.load(open(sys.argv[1] + "/000003.json")); m["shape"] = [1024, 1024, 1024, 3]
json.dump(m, open(sys.argv[1] + "/000003.json", "w"))
open(sys.argv[1] + "/000004.npy", "r+").truncate(200)
r = pyrovox.open(sys.argv[1])
for s, text in (2, "not finite"), (3, "memory=BYTES"), (4, "000004.npy"):
    try:
        r[s].dense; sys.exit(f"{s} was taken")
    except ValueError as e:
        if text not in str(e): sys.exit(str(e))
PY
}
check recordings_as_folders folder

recorded() { # pyrovox record's own file: followed while it is written, and read when it is closed
    "$b/tests/unit/test_pub" --publish "$volumes" 200 0 & pub=$!; pids+=("$pub")
    start recorded.log timeout "$patience" "$pyrovox" record --endpoint "$volumes" --out "$dir/rec.h5" -q
    wait_for test -e "$dir/rec.h5" || return 1
    "$py" - "$dir/rec.h5" <<'PY' || return 1
import os, sys, time
import numpy as np
import pyrovox
def right(v):
    i = np.arange(720)
    want = (v.set % 64 + (i % 8) / 8)[:, None] + 64 * np.arange(3)[None, :]
    want[i % 3 != v.set % 3] = 0
    return (np.array_equal(v.dense, want.reshape(8, 9, 10, 3)) and v.report.solver == "mrnsd" and
            v.t_exposure_ns == 1767225600000000000 + v.set * 66666667)
end = time.monotonic() + int(os.environ["patience"])
while True:
    try:
        r = pyrovox.open(sys.argv[1], follow=True, timeout=int(os.environ["patience"]))
        break
    except ValueError: # its head is not written yet
        if time.monotonic() > end:
            raise
        time.sleep(0.05)
followed = [v.set for v in r if right(v)]
if followed != list(range(200)): sys.exit(f"followed: {followed}")
r = pyrovox.open(sys.argv[1])
if not (r.closed and len(r) == 200 and all(right(v) for v in r) and np.allclose(r.grid.x, -0.5 + (np.arange(10) + 0.5) / 10)):
    sys.exit(f"{r}")
PY
    ended "$started" 0 && wait "$pub"
}
if has h5py; then check recorded_by_pyrovox recorded; else echo "SKIP $name:recorded_by_pyrovox (apt-get install python3-h5py)"; fi

to_xarray() {
    "$py" - <<'PY'
import sys
import numpy as np
import pyrovox
v = pyrovox.decode(open("proto/vectors/volume-f16-raw-rgb.bin", "rb").read())
a = v.to_xarray()
g = v.grid
h = [(b - c) / n for b, c, n in zip(g.max, g.min, g.n)]
ok = (a.dims == ("z", "y", "x", "c") and np.array_equal(a.values, v.dense) and a.attrs["units"] == "1/m" and
      np.allclose(a.x, [g.min[0] + (i + 0.5) * h[0] for i in range(g.n[0])]) and a.x.attrs["units"] == "m" and
      np.allclose(a.z, [g.min[2] + (i + 0.5) * h[2] for i in range(g.n[2])]) and len(a.y) == g.n[1] and
      list(a.c.values) == ["red", "green", "blue"] and a.time.values == np.datetime64(v.t_exposure_ns, "ns") and a.set == v.set)
sys.exit(0 if ok else str(a))
PY
}
if has xarray; then check xarray_coordinates to_xarray; else echo "SKIP $name:xarray_coordinates (apt-get install python3-xarray)"; fi

without() { # what is not installed is asked for by name
    run "$py" -c 'import sys; sys.modules["xarray"] = None
import pyrovox; pyrovox.decode(open("proto/vectors/volume-empty.bin", "rb").read()).to_xarray()'
    says 1 "ImportError" "apt-get install python3-xarray" || return 1
    run "$py" -c 'import sys; sys.modules["h5py"] = None
import pyrovox; pyrovox.open("Makefile")'
    says 1 "ImportError" "apt-get install python3-h5py"
}
check names_what_is_missing without

# keys: a daemon that is reached over TCP
free_ports 1 && port=${ports[0]} keys=$dir/keys
mkdir "$keys"
{ "$pyrovox" keygen "$keys/lab" && "$pyrovox" keygen "$keys/other" && "$pyrovox" keygen "$keys/anna" --server "$keys/lab.pub" &&
    "$pyrovox" keygen "$keys/bert" --server "$keys/lab.pub"; } > "$dir/keygen.log" || rc=1
cp "$keys/anna.pub" "$keys/clients.keys"
awk -v key="$(awk '{ print $NF }' "$keys/other.pub")" '{ print $1, $1 == "server" ? key : $2 }' "$keys/anna.key" > "$keys/wrong.key"
chmod 600 "$keys/wrong.key"
cat > "$dir/d.yaml" <<E2
rig: $PWD/tests/data/rig4.yaml
cameras: "sim:"
fps: 20
publish: {endpoints: ["tcp://*:$port", "$volumes"]}
control: {endpoint: "$control"}
keys: {server: keys/lab.key, clients: keys/clients.keys}
E2
start daemon.log "$pyrovoxd" --config "$dir/d.yaml"
daemon=$started
enter() { # key or None: one volume
    run "$py" -c 'import os, pyrovox, sys
try:
    with pyrovox.subscribe(sys.argv[1], key=sys.argv[2] or None, timeout=int(os.environ["patience"])) as s: print("set", next(s).set, s.grid.n)
except (ConnectionError, OSError, ValueError) as e: sys.exit(f"{type(e).__name__}: {e}")' "${2:-tcp://127.0.0.1:$port}" "${1:+$keys/$1.key}"
}
enters() { enter anna; says 0 "set "; }
check with_its_key wait_for enters
refused() { enter "$1"; says 1 "Refused" "$2"; }
check a_key_that_is_not_listed refused bert "refuses the key in $keys/bert.key"
check no_key refused "" "asks for a key"
check another_daemons_key refused wrong "another key than $keys/wrong.key says"
enter anna "$volumes"
check a_key_where_none_is_asked_for says 1 "Refused" "asks for no key: leave $keys/anna.key out"
enter none
check no_key_file says 1 "FileNotFoundError" "none.key"
head -c 60 "$keys/anna.key" > "$keys/cut.key"; chmod 600 "$keys/cut.key"
enter cut
check a_key_file_cut_short says 1 "ValueError" "cut.key"
cp "$keys/anna.key" "$keys/open.key"; chmod 644 "$keys/open.key"
enter open
check a_key_that_others_read says 1 "PermissionError" "chmod 600"
taken_back() { # while it reads: it hears so
    start anna.log "$py" -c 'import pyrovox, sys
try:
    for v in pyrovox.subscribe(sys.argv[1], key=sys.argv[2]): print("set", v.set, flush=True)
except pyrovox.Refused as e: sys.exit(f"refused: {e}")' "tcp://127.0.0.1:$port" "$keys/anna.key"
    local p=$started
    wait_for grep -q set "$dir/anna.log" && cp "$keys/bert.pub" "$keys/clients.keys" && kill -HUP "$daemon" &&
        wait_for grep -q 'refused: .*no longer' "$dir/anna.log" && ended "$p" 1
}
check a_key_that_is_taken_back taken_back
check ends eval 'kill -TERM "$daemon" && ended "$daemon" 0'
exit $rc
