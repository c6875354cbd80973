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
# voxels, cameras, their width and height, sets, whole too, how much wider than the flame's the box is, options
CASES = [(128, 8, 640, 480, 6, True, 1, []), (256, 8, 1280, 960, 6, True, 1, []), (384, 8, 1280, 960, 6, False, 1, []),
         (512, 16, 2048, 2048, 2, False, 1.3, ["--binning", "4"])]


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


def widen(by):
    """rig.yaml's box about its middle, 1 m wide as simcams writes it."""
    more = 0.5 * (by - 1)
    text = Path("rig.yaml").read_text()
    for was, now in (("min: [-0.5, -0.5, 0]", (-0.5 - more, -0.5 - more, -more)),
                     ("max: [0.5, 0.5, 1]", (0.5 + more, 0.5 + more, 1 + more))):
        if was not in text:
            sys.exit("FAIL large: no '%s' in rig.yaml" % was)
        text = text.replace(was, "%s [%g, %g, %g]" % (was[:4], *now))
    Path("rig.yaml").write_text(text)


def case(voxels, cameras, width, height, count, whole, wider, options, rows):
    take = ["--rig", "rig.yaml", "--frames", "take", "--black", "0.02", "--grid", str(voxels), "--threads", "2", "--quiet", *options]
    run("simcams", "--cameras", str(cameras), "--size", "%dx%d" % (width, height), "--ring", str(count), "--noise", "1",
        "--max-memory", "4096", "--write-rig", "rig.yaml", "--write-frames", "take")
    widen(wider)
    plan, seconds, cpu, _ = run("reconstruct", *take, "--plan", "--memory", "0", "--out", "planned")
    planned = sum(float(v) * n for line in plan.splitlines() if line.startswith(" " * 14)
                  for v, n in zip(line.split(), (1, count)))
    print("%d^3 from %d x %dx%d, planned in %.0f s:\n%s" % (voxels, cameras, width, height, seconds, plan))
    for way, memory in (("part", "0"), ("whole", "64")):
        if way == "whole" and not whole:
            continue
        out, seconds, cpu, peak = run("reconstruct", *take, "--memory", memory, "--out", way, "--matrix-cache", "m.pvxm", "--save-report",
                                      way + ".json")
        part = way == "part"
        bound = said(out, "memory: at most ") if part else 0
        share = said(out, "active part: ", " %") if part else 100
        rows.append([voxels, cameras, width, height, way, count, "%.1f" % share, "%.0f" % seconds, "%.0f" % cpu,
                     "%.0f" % planned if part else "", "%.2f" % (peak * 1e-9), "%.2f" % bound if part else "",
                     "%.2f" % volumes_per_s(way + ".json")])
        print("%-5s %5.1f %% of the voxels, %.0f s (processors %.0f s), %.2f GB%s, %.2f sets/s" %
              (way, share, seconds, cpu, peak * 1e-9, " of at most %.2f" % bound if part else "",
               volumes_per_s(way + ".json")))
        if part and not peak <= bound * 1e9:
            sys.exit("FAIL large: more memory than was said")
    if whole:
        for i in range(count):
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
    w.writerow(["voxels", "cameras", "width", "height", "matrix", "sets", "active", "s", "cpu s", "planned s", "GB", "said GB", "sets/s"])
    w.writerows(rows)
