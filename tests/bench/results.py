"""results.py BENCH_DIR SECONDS: tests/bench/RESULTS.md from the tables of a run of all benchmarks."""
import csv
import datetime
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import bars
import judge

folder, here = Path(sys.argv[1]), Path(__file__).parent
out = []


def say(*lines):
    out.extend(lines)


def table(name):
    path = folder / (name + ".csv")
    return list(csv.DictReader(open(path, newline=""))) if path.exists() else []


def section(title, name, text, head, rows):
    """A table; `rows` is a function, so that one without data says so."""
    say("", "## " + title, "", textwrap.fill("%s (`%s.csv`)." % (text, name), 118))
    lines = [["%s" % c for c in r] for r in rows()] if table(name) else []
    if not lines:
        say("", "Not run.")
        return
    say("", "| " + " | ".join(head) + " |", "|---" * len(head) + "|")
    say(*["| " + " | ".join(r) + " |" for r in lines])


def unique(rows, *keys):
    return list(dict.fromkeys(tuple(r[k] for k in keys) for r in rows))


def pick(rows, **want):
    return [r for r in rows if all(r[k] == v for k, v in want.items())]


def shell(*command):
    return subprocess.run(command, capture_output=True, text=True).stdout.strip()


INTRO = """Error is relative L2 of the volume against a truth that never used the system matrix. Unless a table says otherwise,
voxels are 1/64 m, eight cameras have 160x120 pixels, and two threads work. A figure may be used for the following:

- **fitted**: constants in the code were fitted on this flame (`make fit`). Its figures are in-sample.
- **seen**: nothing was fitted on it, but it was in the benches while defaults were chosen.
- **held out**: nothing was fitted or chosen on it. Believe these figures.

The constants of the automatic weight were fitted on three flames: `ring` of the simulated cameras, Blender's `campfire`, and for one
exponent ScalarFlow's real plume. Nothing was fitted to or chosen on `jet`, `hollow`, `candles` (three more of Blender's fires),
`sheets`, `wall`, `shell` and `pool` (closed forms). They were looked at six times:

- when the limits of `--grid auto` were chosen, which the tables of solvers do not use
- four of them when the weight was made lighter for sharp flames. The other four decided by how much
- all of them once, to choose between two ways to renew the weight that the others could not tell apart
- jet and shell, when the box was left without cells in the preconditioner, which else was chosen on the flames above and on `ragged`
- jet and hollow, to set what a gain must explain of a misfit before the vote keeps the camera
- jet, to set the misfit from which on a larger volume is tried (NUMERICS, 18)

`tests/bench/flames.h` lists all flames. [NUMERICS.md](../../recon/NUMERICS.md) explains the figures.
[MEASURED.md](MEASURED.md) has the results of earlier benches."""

cpu = next((l.split(":")[1].strip() for l in open("/proc/cpuinfo") if l.startswith("model name")), "unknown")
load = os.getloadavg()[1]  # the benches themselves make 1 to 2
log = (folder / "bench.txt").read_text().splitlines()
say("# What it reaches", "",
    "Written by `make bench` on %s, commit %s, %s CPUs of %s; the run took %d minutes," %
    (datetime.date.today(), shell("git", "describe", "--always", "--dirty"), shell("nproc"), cpu,
     round(int(sys.argv[2]) / 60)),
    "load average %.1f at its end.%s" % (load, " **The machine had other work: all times below are too long, "
                                         "errors are not affected.**" if load > 3 else ""), "",
    *INTRO.split("\n"))
missing = sorted({l for l in log if l.startswith(("NOT RUN", "FAIL"))})
if missing:
    say("", "Not in this run:", "", *["- " + l for l in missing])

judged = judge.cases(folder)
section("Judged from outside", "judge", "Every solver stops by itself. The first figure is the volume error, the second the mean error of the "
        "unseen view's flame pixels, 0..255. There is one truth for both bases. The volume is compared as the "
        "field of emission that its basis makes of it, at 2x2x2 points of every voxel. So errors are larger here "
        "than where the truth is a coefficient of the basis. The last columns are the default over the best of all "
        "others in either basis, picked for each case and figure with the truth known. In the last one the others "
        "also see the pictures as the default corrected them, by a gain and a shift of each camera. Real is ScalarFlow's "
        "plume: four views in, and the error of the whole fifth picture. The misfit's exponent was chosen on it",
        *judge.rows(judged))
section("Judged from outside, in short", "judge", "From the table above", judge.SUMMARY, lambda: judge.summary(judged))
section("Exact rigs and wrong ones", "judge", "From the table above: trilinear, 1 % noise, geometric means over flames and draws of noise and "
        "faults. The best other is of the same basis. What is wrong: tests/bench/wrong.h", judge.LABS, lambda: judge.labs(judged))

section("What correcting cameras costs", "selfcal", "Processor time of a frame set, one thread, least of 15 with and without in turns, 8 cameras, 1 % "
        "noise, trilinear. Closed: an exact rig. Open: gains off by 10 %, poses by 0.5 px. Wanted: 1.02 closed, 1.25 open",
        ["flame", "use", "voxels", "gate", "without, ms", "with, ms", "set over without", "solve over without", "iterations without", "with"],
        lambda: [[r["flame"], r["use"], r["voxels"] + "^3", r["gate"], r["off ms"], r["on ms"], r["set over off"], r["solve over off"],
                  r["iterations off"], r["iterations on"]] for r in table("selfcal")])

offline = table("offline")


def rates():
    keys = "voxels", "width", "height", "basis", "rays", "threads"
    for size in unique(offline, *keys):
        rows = pick(offline, **dict(zip(keys, size)))
        yield ["%s^3 from 8 x %sx%s" % size[:3], size[3], size[4] + "x" + size[4], size[5], "%.1f" % float(rows[0]["sets_per_s"])] + [
            "%.2f (%.0f)" % (float(r["ms"]), float(r["ms"]) / float(r["bound_ms"])) for r in rows]


section("Offline, raw pixels to volume", "offline", "Ring, RGB8. Wanted on two threads: 170 sets/s at 64^3 (trilinear 120), 30 at 128^3 (20). Stages are in "
        "ms. In brackets: the time over that of moving their bytes",
        ["size", "basis", "rays", "threads", "sets/s"] + [s for s, in unique(offline, "stage")], rates)

say("", "## The paper's Figure 5", "", "100 frames of 7 simulated cameras, 640x480 in bins of 2x2, grids of 32 to 96, compared with an eighth",
    "camera. Run by `make bench ONLY=figure5`:", "", *["- " + l for l in log if l.startswith("figure 5, ")])

products = table("products")
section("One A and one A^T", "products", "The time over that to stream their entries. Wanted: 2",
        ["size", "basis", "channels", "threads", "kernels", "ms", "ratio"],
        lambda: [[r["voxels"] + "^3", r["basis"], r["channels"], r["threads"], r["kernels"], "%.2f" % float(r["pair_ms"]),
                  "%.1f" % float(r["ratio"])] for r in products if r["kernels"] != "ref"])

pixels = table("pixels")
section("Pixels to floats, one core", "pixels", "GB/s of raw bytes without binning, and the time over that of copying as many bytes",
        ["format", "GB/s", "over a copy"],
        lambda: [[r["format"], "%.1f" % (1e-3 * float(r["raw_mb_per_s"])), r["time_over_copy"] or "-"]
                 for r in pick(pixels, binning="1")])

section("On the wire", "proto_encode", "One core. *lit*: share of the voxels. *bound*: the bytes read and written over the bandwidth. Wanted at "
        "128^3 in f16: 3 ms, and 6 ms with the default compression. Reconstructed flames have the solver's own "
        "noise",
        ["flame", "voxels", "lit", "", "", "ms", "bound ms", "MB/s of floats", "MB", "ratio", "unpack ms", "volumes/s on 1 GbE"],
        lambda: [[r["flame"], r["voxels"] + "^3", "%.0f %%" % (100 * float(r["lit share"])), r["sample"], r["compress"], r["ms"],
                  r["bound ms"], r["MB/s"], r["MB"], r["ratio"], r["unpack ms"], r["most/s on 1 GbE"]] for r in table("proto_encode")])
section("In shared memory", "share", "One core, from the message (f16, LZ4) to NanoVDB that a renderer maps: unpacked, then made in place. "
        "*bound*: the grids' bytes over the bandwidth. Wanted at 128^3: 5 ms. *vectors*: density and emission. "
        "*split*: density, red, green, blue. *one*: of a grey rig",
        ["flame", "voxels", "grids", "bricks", "MB", "unpack ms", "make ms", "both ms", "99 %", "bound ms", "make over bound"],
        lambda: [[r["flame"], r["voxels"] + "^3", r["grids"], r["bricks"], r["MB"], r["unpack ms"], r["make ms"], r["both ms"],
                  r["both p99 ms"], r["bound ms"], r["make over bound"]] for r in table("share")])


say("", "## Live", "", "Simulated GigE cameras, daemon and subscriber on the same processors (`live.sh`).", "")
live = folder / "live.md"
say(live.read_text().strip() if live.exists() else "Not run.")
take = [l.rstrip() for l in log if l.startswith(("plain write", "take", "reading back", "best of 3", "-- raw"))]
say("", "## Raw recording", "", "```", *take, "```")
say("", *bars.lines(bars.read(folder)))
(here / "RESULTS.md").write_text("\n".join(out) + "\n")
print("written: %s" % (here / "RESULTS.md"))
