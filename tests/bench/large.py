"""large.py BUILD BENCH_DIR: grids whose matrix is large: whole, its active part, and what `reconstruct --plan` says of it."""
import csv
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

pyrovox, folder = str(Path(sys.argv[1]).resolve() / "bin/pyrovox"), Path(sys.argv[2]).resolve()
SETS = 6
# voxels, cameras' width and height, whole too
CASES = [(128, 640, 480, True), (256, 1280, 960, True), (384, 1280, 960, False)]


def run(*command):
    """Its output, seconds, processor seconds and the most memory that it had, bytes."""
    t = time.monotonic()
    p = subprocess.Popen([pyrovox, *command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    out = p.stdout.read()
    _, status, use = os.wait4(p.pid, 0)
    if status != 0:
        sys.exit("FAIL large: %s\n%s" % (" ".join(command), out))
    return out, time.monotonic() - t, use.ru_utime + use.ru_stime, use.ru_maxrss * 1024


def said(out, before, after=" GB"):
    return float(out.split(before)[1].split(after)[0])


def volumes_per_s(report):
    sets = json.loads(Path(report).read_text())["frames"]
    return len(sets) / sum(s["ms"]["total"] * 1e-3 for s in sets)


def case(voxels, width, height, whole, rows):
    take = ["--rig", "rig.yaml", "--frames", "take", "--black", "0.02", "--grid", str(voxels), "--threads", "2", "--quiet"]
    run("simcams", "--cameras", "8", "--size", "%dx%d" % (width, height), "--ring", str(SETS), "--noise", "1", "--write-rig",
        "rig.yaml", "--write-frames", "take")
    plan, seconds, cpu, _ = run("reconstruct", *take, "--plan", "--memory", "0", "--out", "planned")
    planned = sum(float(v) * n for line in plan.splitlines() if line.startswith(" " * 14)
                  for v, n in zip(line.split(), (1, SETS)))
    print("%d^3 from 8 x %dx%d, planned in %.0f s:\n%s" % (voxels, width, height, seconds, plan))
    for way, options in (("part", ["--memory", "0"]), ("whole", ["--memory", "64"])):
        if way == "whole" and not whole:
            continue
        out, seconds, cpu, peak = run("reconstruct", *take, *options, "--out", way, "--matrix-cache", "m.pvxm", "--save-report",
                                      way + ".json")
        part = way == "part"
        bound = said(out, "memory: at most ") if part else 0
        share = said(out, "active part: ", " %") if part else 100
        rows.append([voxels, width, height, way, SETS, "%.1f" % share, "%.0f" % seconds, "%.0f" % cpu,
                     "%.0f" % planned if part else "", "%.2f" % (peak * 1e-9), "%.2f" % bound if part else "",
                     "%.2f" % volumes_per_s(way + ".json")])
        print("%-5s %5.1f %% of the voxels, %.0f s (processors %.0f s), %.2f GB%s, %.2f sets/s" %
              (way, share, seconds, cpu, peak * 1e-9, " of at most %.2f" % bound if part else "",
               volumes_per_s(way + ".json")))
        if part and not peak <= bound * 1e9:
            sys.exit("FAIL large: more memory than was said")
    if whole:
        for i in range(SETS):
            if Path("part/%06d.npy" % i).read_bytes() != Path("whole/%06d.npy" % i).read_bytes():
                sys.exit("FAIL large: volume %d of the part is not that of the whole" % i)
    subprocess.run(["rm", "-rf", "take", "part", "whole", "planned", "m.pvxm"])


resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
here, rows = tempfile.mkdtemp(), []
os.chdir(here)
try:
    for c in CASES:
        case(*c, rows)
finally:
    os.chdir("/")
    subprocess.run(["rm", "-rf", here])
with open(folder / "large.csv", "w", newline="") as f:
    w = csv.writer(f)
    w.writerow(["voxels", "width", "height", "matrix", "sets", "active", "s", "cpu s", "planned s", "GB", "said GB", "sets/s"])
    w.writerows(rows)
