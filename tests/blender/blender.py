"""The add-on in Blender: blender.py BUILD [CHECK].  Each check is a line; what it looks at is in build/blender/."""
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np
import pyopenvdb

sys.path.insert(1, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../view"))
from bed import Bed, blobs  # noqa: E402

bed = Bed(sys.argv[1], "blender")
only = sys.argv[2] if len(sys.argv) > 2 else ""
shots = f"{bed.build}/blender"
LO, HI = (-0.5, -0.4, 0.1), (0.5, 0.4, 1.3)
FOV, W, H, AT = 40, 160, 120, (0, 0, 0.7)
EYES = ((2.0, -1.4, 0.9), (-0.3, 2.2, 0.2), (0.35, 0.1, 3.4))


def blender(what, *more, screen=False, patience=600):
    """Runs inside.py; what it found.  Its settings, add-ons and temporary files are its own."""
    home = tempfile.mkdtemp(dir=bed.dir)
    found = f"{home}/found.json"
    command = ["xvfb-run", "-a", "-s", "-screen 0 800x600x24"] if screen else []
    command += ["blender"] + ([] if screen else ["--background"]) + ["--factory-startup", "--python-exit-code", "3", "--python", "tests/blender/inside.py", "--",
                what, home, f"{bed.build}/pyrovox-blender.zip", *more]
    os.mkdir(f"{home}/tmp")
    p = bed.start(*command, log="blender.log", env={"BLENDER_USER_CONFIG": f"{home}/config", "BLENDER_USER_SCRIPTS": f"{home}/scripts", "TMPDIR": f"{home}/tmp",
                                                    "HOME": home, "LIBGL_ALWAYS_SOFTWARE": "1"})
    return p, home, found


def ended(p, found, patience=600):
    try:
        code = p.wait(patience)
    finally:
        bed.end(p)
    m = {"failed": f"Blender ended with {code}"}
    if os.path.exists(found):
        with open(found) as f:
            m = json.load(f)
    if code != 0 or "failed" in m:
        with open(f"{bed.dir}/blender.log", errors="replace") as f:
            print(f.read()[-4000:])
        raise AssertionError(m.get("failed", code))
    return m


def background(what, *more):
    p, home, found = blender(what, *more)
    return ended(p, found), home


def converted(folder):
    out = f"{folder}-vdb"
    bed.run(f"{bed.bin}/pyrovox", "convert", "--split", "--format", "vdb", folder, out)
    return out


def vdbs(folder):
    return sorted(f"{folder}/{n}" for n in os.listdir(folder) if n.endswith(".vdb"))


def same_grids(a, b):
    """Two files: names, classes, places, halves, and every voxel; one that has none of a colour may be off there."""
    a, b = pyopenvdb.readAll(a)[0], pyopenvdb.readAll(b)[0]
    assert [g.name for g in a] == [g.name for g in b], ([g.name for g in a], [g.name for g in b])
    for g, h in zip(a, b):
        assert (g.gridClass, g.saveFloatAsHalf, g.valueTypeName, g.background) == (h.gridClass, h.saveFloatAsHalf, h.valueTypeName, h.background)
        for ijk in ((0, 0, 0), (7, 3, 11)):
            assert np.allclose(g.transform.indexToWorld(ijk), h.transform.indexToWorld(ijk), rtol=0, atol=1e-9), g.name
        if g.name == "density":
            assert g.activeVoxelCount() == h.activeVoxelCount() and g.evalActiveVoxelBoundingBox() == h.evalActiveVoxelBoundingBox(), (g.activeVoxelCount(), h.activeVoxelCount())
        assert g.activeLeafVoxelCount() == g.activeVoxelCount(), "tiles"
        p, q = np.zeros((80, 80, 80), np.float32), np.zeros((80, 80, 80), np.float32)
        g.copyToArray(p, (-8, -8, -8))
        h.copyToArray(q, (-8, -8, -8))
        assert q.any() and np.abs(p - q).max() <= 2 ** -11 * np.abs(q).max(), (g.name, np.abs(p - q).max())  # density: a sum rounded in another order
        if g.name != "density":
            assert np.array_equal(p, q), g.name


def files():
    """A recording that a bridge plays, recorded by the add-on's own modules, is that of pyrovox convert, voxel by voxel."""
    for channels in (1, 3):
        volumes = [blobs((21, 17, 30), channels, 9 + i) for i in range(3)]
        volumes[1][8:16, 0:8, 8:16] = 0.5  # a brick of one value
        folder = bed.recording(f"files-{channels}", volumes, "trilinear", LO, HI)
        want = vdbs(converted(folder))
        bridge, url = bed.view(folder)
        script = f"""
import sys, time
sys.path.insert(0, "{bed.build}/addon")
import types
sys.modules["pyrovox_blender"] = p = types.ModuleType("pyrovox_blender")
p.__path__ = ["{bed.build}/addon/pyrovox_blender"]
from pyrovox_blender import stream, vdb, websocket
s = stream.Stream(websocket.Address.read("{url}"), vdb.Shelf("{bed.dir}"), vdb.library())
s.record(vdb.Take("{bed.dir}/take-{channels}"))
s.start()
while len(s.recording().entries) < 8: time.sleep(0.01)
s.stop()
s.shelf.close()
print(" ".join(f"{{e.set}}:{{e.path}}" for e in s.recording().entries))
"""
        got = dict(w.split(":", 1) for w in bed.run("/usr/bin/python3", "-c", script).split())
        assert set(got) == {"0", "1", "2"}, got
        for i, path in enumerate(want):
            same_grids(got[str(i)], path)
        bed.end(bridge)


def sequences():
    folder = converted(bed.recording("sequence", [blobs((21, 17, 30), 3, 20 + i) for i in range(4)], "trilinear", LO, HI))
    m, _ = background("sequence", folder)
    assert m["volume"] == [True, 5, 4, 0, "CLIP"], m["volume"]
    shown = {f: name for f, name, _, _ in m["frames"]}
    assert [shown[5 + i] for i in range(4)] == m["files"] and len(m["files"]) == 4, m["frames"]
    step = [(h - lo) / n for h, lo, n in zip(HI, LO, (21, 17, 30))]
    for f, name, error, grids in m["frames"]:
        if not 5 <= f < 9:
            continue
        assert not error and set(grids) == {"density", "red", "green", "blue"}, (error, grids)
        for kind, channels, matrix in grids.values():
            want = np.diag([*step, 1.0])
            want[:3, 3] = [lo + s / 2 for lo, s in zip(LO, step)]
            assert kind == "FLOAT" and channels == 1 and np.allclose(matrix, want, atol=1e-6), matrix


def pictures():
    """Cycles' picture is pyrovox render's, in linear values: of the trilinear basis to 0.5 %, of the box basis, which Cycles smooths, in sum."""
    jobs, want = [], []
    for basis in ("trilinear", "box"):
        for channels in (1, 3):
            folder = bed.recording(f"picture-{basis}-{channels}", [blobs((21, 17, 30), channels, 5 + channels)], basis, LO, HI)
            vdb = vdbs(converted(folder))[0]
            for eye in EYES if channels == 3 else EYES[:1]:
                jobs.append({"vdb": vdb, "channels": channels, "spacing": [(h - lo) / n for h, lo, n in zip(HI, LO, (21, 17, 30))], "eye": eye, "at": AT, "fov": FOV,
                             "size": (W, H), "out": f"{bed.dir}/cycles-{len(jobs)}.npy"})
                ref = f"{bed.dir}/render-{len(jobs)}.npy"
                bed.run(f"{bed.bin}/pyrovox", "render", "--quiet", "--sub", "4", "--eye=" + ",".join(map(str, eye)), "--look-at=" + ",".join(map(str, AT)),
                        "--fov", str(FOV), "--size", f"{W}x{H}", f"{folder}/000000.npy", ref)
                want.append((basis, np.load(ref).reshape(H, W, -1) * np.ones(3)))
    background("picture", json.dumps(jobs))
    for job, (basis, b) in zip(jobs, want):
        a = np.load(job["out"])
        total, mean = a.sum() / b.sum(), np.abs(a - b).sum() / b.sum()
        print(f"  {basis} {job['channels']} {job['eye']}: sum {total:.5f} of the renderer's, mean difference {100 * mean:.2f} %, largest {np.abs(a - b).max():.4f} of {b.max():.3f}")
        lit = b.sum(-1) > 0.1 * b.sum(-1).max()
        assert 0.02 < lit.mean() < 0.6 and a[lit].mean() > 20 * a[b.sum(-1) == 0].mean(), "not brighter where the flame is"
        assert abs(total - 1) <= 0.002, total
        assert mean <= (0.005 if basis == "trilinear" else 0.12), mean


def refusals():
    full = f"{bed.dir}/full"
    os.mkdir(full)
    bridge, url = bed.view(bed.recording("refusals", [blobs((48, 48, 48), 3, i) for i in range(3)], "box", LO, HI))
    bed.run("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=bed", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", f"{bed.dir}/tls.key", "-out", f"{bed.dir}/tls.pem")
    os.chmod(f"{bed.dir}/tls.key", 0o600)
    secure, https = bed.view("--cert", f"{bed.dir}/tls.pem", "--cert-key", f"{bed.dir}/tls.key", bed.recording("secure", [blobs((10, 9, 8), 1, i) for i in range(3)], "box", LO, HI))
    # a disk of 4 MB in a mount namespace of Blender's own
    path = os.environ["PATH"]
    wrapper = f"{bed.dir}/bin"
    os.mkdir(wrapper)
    with open(f"{wrapper}/blender", "w") as f:
        f.write(f"#!/bin/sh\nPATH={path}; export PATH\nexec unshare -rm sh -c 'mount -t tmpfs -o size=4m none {full} && exec blender \"$@\"' blender \"$@\"\n")
    os.chmod(f"{wrapper}/blender", 0o755)
    os.environ["PATH"] = f"{wrapper}:{path}"
    try:
        m, home = background("refusals", url, full, https, f"{bed.dir}/tls.pem")
    finally:
        os.environ["PATH"] = path
        bed.end(bridge)
        bed.end(secure)
    for key, part in {"nothing typed": "paste the address", "no address": "not an address as pyrovox view prints it", "no token": "has no token", "pause": "not connected", "record": "not connected",
                      "bake": "nothing came yet", "no openvdb": "apt-get install python3-openvdb", "temporary folder": "no folder can be made", "wrong token": "paste the address that pyrovox view printed last",
                      "nobody there": "nobody listens at 127.0.0.1:1", "no such host": "no name of a host", "https": "an address with http://", "certificate": "choose its file as Certificate", "no certificate": "not a certificate", "tls": "",
                      "unsaved": "save the .blend first",
                      "folder": "choose another folder", "full": "recording has ended after", "temporary folder full": "is full: make room there"}.items():
        print(f"  {key}: {m[key]}")
        assert part in m[key] and "\n" not in m[key], (key, m[key])
    assert m["left in it"] == [] and m["tls"] == "" and m["then"] == "" and m["saved"] and not m["token saved"] and not m["reprs"], m
    assert os.listdir(f"{home}/tmp") == [] or not any(n.startswith("pyrovox-") for _, d, _ in os.walk(f"{home}/tmp") for n in d)
    with open(f"{bed.dir}/blender.log", errors="replace") as f:
        assert "Traceback" not in f.read()


def follows():
    token = f"{bed.dir}/token"
    with open(token, "w") as f:
        f.write("0123456789abcdef" * 2 + "\n")
    os.chmod(token, 0o600)
    daemon, at = bed.daemon(bed.rig(48))
    bridge, url = bed.view("--endpoint", at, "--token-file", token)
    port = url.split("/#")[0].rsplit(":", 1)[1]
    p, home, found = blender("follow", url, screen=True)

    def asked(name):
        end = time.monotonic() + 500
        while not os.path.exists(f"{home}/do-{name}"):
            assert p.poll() is None and time.monotonic() < end, name
            time.sleep(0.05)

    def did(name):
        open(f"{home}/did-{name}", "w").close()
    try:
        asked("kill-bridge")
        bed.end(bridge, signal.SIGKILL)
        time.sleep(3)
        bridge, _ = bed.view("--endpoint", at, "--token-file", token, "--listen", f"127.0.0.1:{port}")
        did("kill-bridge")
        asked("other-grid")
        bed.end(daemon)
        daemon, _ = bed.daemon(bed.rig(32))
        did("other-grid")
        asked("new-token")
        bed.end(bridge)
        bridge, url = bed.view("--endpoint", at, "--listen", f"127.0.0.1:{port}")
        with open(f"{home}/address", "w") as f:
            f.write(url)
        did("new-token")
    except AssertionError:
        pass  # Blender says why
    m = ended(p, found)
    shutil.copy(f"{home}/live.png", f"{shots}/live.png")
    for q in (bridge, daemon):
        bed.end(q)
    sessions = {}
    for number, session, _ in m["all"]:
        assert sessions.get(session, -1) < number, "an older volume"
        sessions[session] = number
    first = m["first"]
    ages = sorted(a for _, _, a in first)
    print(f"  100 volumes, sets {first[0][0]} to {first[99][0]}; since published: median {ages[50]:.0f} ms, 95 % {ages[95]:.0f} ms; memory {m['rss'][0]:.0f}, {m['rss'][1]:.0f} MB; {m['words'][0]}")
    assert len(first) >= 100 and len(sessions) == 2 and m["words"][1] == ""
    assert m["files"] <= 22, m["files"]
    assert m["rss"][1] - m["rss"][0] < 100, m["rss"]  # 70 volumes of 48^3, four grids each, are 125 MB
    assert m["while paused"] == 0, m["while paused"]
    sets = [n for n, _, _ in m["recorded"]]
    assert len(sets) >= 15 and sets == sorted(set(sets)) and all(there for _, _, there in m["recorded"])
    assert m["names"] == [f"flame_{i + 1:04d}.vdb" for i in range(len(sets))], m["names"]
    sequence, start, frames, name, count, fps, hidden, paused = m["baked"]
    seconds = (m["recorded"][-1][1] - m["recorded"][0][1]) / 1e9
    assert sequence and start == 1 and name == "flame_0001.vdb" and count == frames == int(seconds * fps + 1e-3) + 1 and hidden == [True] and paused, (m["baked"], seconds)
    for key, part in {"bridge gone": ("nobody listens", "went away"), "deleted": ("Connect makes it anew",), "new token": ("printed last",)}.items():
        print(f"  {key}: {m[key]}")
        assert any(w in m[key] for w in part), (key, m[key])
    spacing, shift = m["spacing"]
    assert np.allclose(spacing, 1 / 32) and np.allclose(shift, [[-1 / 64] * 3]), m["spacing"]
    assert m["disabled"] == [False, False, False], m["disabled"]
    assert not os.path.exists(m["shelf"]) and not [n for _, d, _ in os.walk(f"{home}/tmp") for n in d if n.startswith("pyrovox-")], "left behind after File > Quit"
    with open(f"{bed.dir}/blender.log", errors="replace") as f:
        assert "Traceback" not in f.read()


def cameras():
    """Cameras of Blender imported as a rig, and a rig's cameras in Blender, against Blender's own projection: 0.01 px."""
    points = np.random.default_rng(3).uniform((-0.3, -0.3, 0.7), (0.3, 0.3, 1.3), (30, 3))
    pyrovox = f"{bed.bin}/pyrovox"

    def rig(path):
        """rig.yaml: each camera's pixels of the points, from the centre of the first pixel; its lens has no distortion."""
        out, one = {}, {}
        with open(path) as f:
            for line in f:
                key, _, value = line.split(" #")[0].strip().removeprefix("- ").partition(": ")
                if key == "name":
                    one = out[value] = {}
                elif value.startswith("["):
                    one[key] = json.loads(value)
        pixels = {}
        for name, c in out.items():
            X = points @ np.reshape(c["R"], (3, 3)).T + c["t"]
            pixels[name] = X[:, :2] / X[:, 2:] * c["K"][:2] + c["K"][2:]
        return pixels
    names = [f"cam{i}" for i in range(4)]
    bed.run(pyrovox, "simcams", "--cameras", "4", "--size", "640x480", "--ring", "1", "--write-rig", f"{bed.dir}/ring.yaml", "--write-frames", f"{bed.dir}/frames")
    with open(f"{bed.dir}/ring.yaml") as f:
        flat = [line for line in f if "distortion:" not in line]
    with open(f"{bed.dir}/ring.yaml", "w") as f:
        f.writelines(flat)
    bed.run(pyrovox, "calibrate", "export", "--rig", f"{bed.dir}/ring.yaml", "--to", "blender", "--out", f"{bed.dir}/ring.json")
    m, _ = background("cameras", json.dumps(points.tolist()), bed.dir, f"{bed.dir}/ring.json")
    worst = 0
    for kind in range(2):
        bed.run(pyrovox, "calibrate", "import", f"{bed.dir}/scene-{kind}.json", "--volume=-0.3,-0.3,0.7,0.3,0.3,1.3", "--out", f"{bed.dir}/scene-{kind}.yaml")
        got = rig(f"{bed.dir}/scene-{kind}.yaml")
        assert sorted(got) == ["cam_AUTO", "cam_HORIZONTAL", "cam_VERTICAL"], got.keys()
        for name, want in m[f"scene-{kind}"].items():
            worst = max(worst, np.abs(got[name.replace(" ", "_")] + 0.5 - want).max())
    got = rig(f"{bed.dir}/ring.yaml")
    assert sorted(m["rig"]) == names
    worst = max(worst, *(np.abs(got[name] + 0.5 - m["rig"][name]).max() for name in names))
    print(f"  10 cameras, largest difference {worst:.5f} px")
    assert worst < 0.01, worst
    assert "no camera" in m["none"] and "is not of pyrovox calibrate export" in m["not one"], m


def room():
    """The picture of README, small: brighter where the flame is, dark behind the pillar; and what it says to bad input."""
    folder = converted(bed.recording("room", [blobs((32, 32, 32), 3, 3)], "trilinear", (-0.5, -0.5, 0), (0.5, 0.5, 1)))

    def run(*words):
        return subprocess.run(["blender", "--background", "--factory-startup", "--python", "proto/clients/blender/room.py", "--", *words], capture_output=True, text=True, timeout=600)
    r = run(folder, "--out", f"{shots}/room.png", "--samples", "4", "--size", "180x120")
    assert r.returncode == 0 and os.path.getsize(f"{shots}/room.png") > 5000, r.stderr + r.stdout
    for words, part in (((f"{bed.dir}/nowhere",), "is not there"), ((folder, "--frame", "7"), "has 1 to 1"), ((bed.dir,), "pyrovox convert --split"), ((folder, "--size", "big"), "should be as 960x640"),
                        ((folder, "--out", f"{bed.dir}/no/where.png"), "its folder is not there")):
        r = run(*words)
        assert r.returncode != 0 and part in r.stderr and "Traceback" not in r.stderr + r.stdout, (words, r.returncode, r.stderr)
    r = run("--help")
    assert r.returncode == 0 and "--samples" in r.stdout, r.stdout


checks = {"files-are-those-of-convert": files, "a-sequence": sequences, "picture-is-the-renderers": pictures, "refusals": refusals, "cameras-in-and-out": cameras, "follows-a-live-daemon": follows, "room": room}
try:
    for name, what in checks.items():
        if only in name:
            bed.check(name, what)
finally:
    bed.close()
print(f"{bed.passed} passed, {bed.failed} failed, 0 skipped")
sys.exit(1 if bed.failed or not bed.passed else 0)
