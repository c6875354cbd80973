"""results.py BENCH_DIR SECONDS: tests/bench/RESULTS.md from the tables of a run of all benchmarks."""
import csv
import datetime
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

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


cpu = next((l.split(":")[1].strip() for l in open("/proc/cpuinfo") if l.startswith("model name")), "unknown")
load = os.getloadavg()[1]  # the benches themselves make 1 to 2
log = (folder / "bench.txt").read_text().splitlines()
say("# What it reaches", "",
    "Written by `make bench` on %s, commit %s, %s CPUs of %s; the run took %d minutes," %
    (datetime.date.today(), shell("git", "describe", "--always", "--dirty"), shell("nproc"), cpu,
     round(int(sys.argv[2]) / 60)),
    "load average %.1f at its end.%s" % (load, " **The machine had other work: all times below are too long, "
                                         "errors are what they are.**" if load > 3 else ""), "",
    "Error is relative L2 of the volume against a truth that never saw the system matrix; unless a table says otherwise",
    "voxels are 1/64 m, eight cameras have 160x120 pixels, and two threads work. What a figure may be used for:", "",
    "- **fitted**: constants in the code were fitted on this flame (`make fit`); its figures are in-sample",
    "- **seen**: nothing was fitted on it, but it stood in the benches while defaults were chosen",
    "- **held out**: nothing was fitted or chosen on it; these are the figures to believe", "",
    "`tests/bench/flames.h` is the one list of them; [NUMERICS.md](../../recon/NUMERICS.md) says why they are what",
    "they are.")
missing = sorted({l for l in log if l.startswith(("NOT RUN", "FAIL"))})
if missing:
    say("", "Not in this run:", "", *["- " + l for l in missing])

best = table("best")
section("Error of the default solver", "best",
        "As it stops by itself; in brackets the paper's literal iteration (`cgls-paper`) at the best iterate that it ever "
        "has, which it cannot know", ["flame", "use", "basis", "noise 0", "1 %", "5 %", "ms at 1 %"],
        lambda: [[s, u, b] + ["%.3f (%.3f)" % (float(r["own"]), float(r["paper"])) for r in pick(best, scene=s, basis=b)] +
                 ["%.1f (%.1f)" % (float(r["own_ms"]), float(r["paper_ms"]))
                  for r in pick(best, scene=s, basis=b, noise="1 %")] for s, u, b in unique(best, "scene", "use", "basis")])

targets = table("targets")
WHAT = {"volume": "volume error at the moment of cgls-paper's best, over its error",
        "view": "error of the unseen view at the same moment, over its error",
        "time": "time to cgls-paper's best error, over its time",
        "late": "error after 1000 iterations, over that at the automatic stop"}


def summary():
    for key, what in WHAT.items():
        for use in ("fitted", "seen", "held out"):
            rows = pick(targets, target=key, use=use)
            v = sorted(float(r["measured"]) for r in rows)
            if v:
                yield [what, use, "%.2f" % v[0], "%.2f" % v[len(v) // 2], "%.2f" % v[-1], "%.2f" % float(rows[0]["reach"]),
                       "%d of %d" % (sum(r["met"] != "no" for r in rows), len(v))]


section("Against the paper's solver", "targets", "All flames, bases and noise to 5 %",
        ["what", "flames", "best", "median", "worst", "wanted at most", "met"], summary)

judged = judge.cases(folder)
section("Judged from outside", "judge", "Every solver as it stops by itself: volume error / mean error of the unseen view's "
        "flame pixels, 0..255. One truth for both bases: the volume as the field of emission that its basis makes of it, at "
        "2x2x2 points of every voxel; so errors are larger here than where the truth is a coefficient of the basis. The last "
        "column: the default over the best of all others in either basis, picked for each case and figure with the truth known. "
        "Real: ScalarFlow's plume, four views in, the error of the whole fifth picture; the misfit's exponent was chosen on it",
        *judge.rows(judged))
section("Judged from outside, in short", "judge", "From the table above", judge.SUMMARY, lambda: judge.summary(judged))
say("", "![error against time](../../daemon/man/error-time.png)")

motion = table("motion")
section("In motion", "motion", "1 % noise, automatic stop, mean over the frames: from nothing, and from the frame before",
        ["flame", "use", "basis", "cold: error", "ms", "warm: error", "ms"],
        lambda: [[s, u, b] + ["%.3f" % float(r["volume"]) if k else "%.1f" % float(r["ms"])
                              for r in pick(motion, scene=s, basis=b, stop="auto") for k in (1, 0)]
                 for s, u, b in unique(motion, "scene", "use", "basis")])

bayer = table("bayer")
section("Bayer pixels", "bayer", "12 bits, box basis: error with three sensors (rgb), with each pixel as a ray of its own "
        "colour (rays), demosaiced, and binned", ["flame", "use", "noise"] + [w for w, in unique(bayer, "way")],
        lambda: [[s, u, "%g %%" % (100 * float(n))] + ["%.3f" % float(r["volume"])
                                                      for r in pick(bayer, scene=s, noise=n, basis="box")]
                 for s, u, n in unique(bayer, "scene", "use", "noise")])

model = table("model")
section("Rays per pixel", "model", "1 % noise: error of the volume and of the unseen view (mean over all its pixels), million "
        "entries in all and on the hull, s of the build, ms of the solve",
        ["flame", "use", "basis", "pixels", "rays", "error", "view", "entries", "on the hull", "build", "ms"],
        lambda: [[r["scene"], r["use"], r["basis"], r["width"] + "x" + r["height"], r["rays"] + "x" + r["rays"],
                  "%.3f" % float(r["volume"]), "%.3f" % float(r["view"]), "%.1f M" % (1e-6 * float(r["nnz"])),
                  "%.2f M" % (1e-6 * float(r["entries"])), "%.2f" % float(r["build_s"]), "%.1f" % float(r["solve_ms"])]
                 for r in model])

grid = table("grid")


def finer():
    keys = "scene", "use", "rig", "noise", "pictures"
    for case in unique(grid, *keys):
        *fixed, auto = pick(grid, **dict(zip(keys, case)))
        yield [*case] + ["%.3f / %.1f" % (float(r["volume"]), float(r["view"])) for r in fixed + [auto]] + [
            "%.2f" % float(auto["pixels"]), auto["voxels"]]


section("How fine a grid", "grid", "Trilinear: error of the field at the same points whatever the grid / of the unseen view, on "
        "grids whose voxels have so many pixels in the pictures, and on that of `--grid auto`: its voxels, in pixels",
        ["flame", "use", "cameras", "noise", "pictures"] + ["%.1f px" % float(r["pixels"]) for r in grid[:5]] +
        ["auto", "px", "voxels"], finer)

cells = table("finer")
section("Cells of several sizes", "finer", "Error of the field, trilinear, 8 cameras of 320x240, 1 % noise; oracle and rule: every block of 8^3 from one of 32^3, "
        "64^3, 128^3, a quarter of 128^3's unknowns in all (NUMERICS 15); unknowns, entries, time: 80^3 over 128^3",
        ["flame", "use", "32^3", "64^3", "80^3", "128^3", "oracle", "rule", "unknowns", "entries", "time"],
        lambda: [[r["scene"], r["use"]] + ["%.3f" % float(r[k]) for k in
                  ("volume_32", "volume_64", "volume_80", "volume_128", "oracle", "rule")] +
                 ["%.2f" % float(r[k]) for k in ("unknowns_80", "entries_80", "time_80")] for r in cells])

hull = table("hull")
section("The visual hull", "hull", "Restricted over full solve, ring (fitted), 1 % noise; wanted 10 times faster, half the error",
        ["solver", "stop", "times faster", "volume error", "unseen view"],
        lambda: [[a["solver"], a["stop"], "%.0f" % (float(b["ms"]) / float(a["ms"])), "%.2f x" %
                  (float(a["volume"]) / float(b["volume"])), "%.2f x" % (float(a["view"]) / float(b["view"]))]
                 for a, b in zip(pick(hull, hull="1"), pick(hull, hull="0"))])

offline = table("offline")


def rates():
    keys = "voxels", "width", "height", "basis", "rays", "threads"
    for size in unique(offline, *keys):
        rows = pick(offline, **dict(zip(keys, size)))
        yield ["%s^3 from 8 x %sx%s" % size[:3], size[3], size[4] + "x" + size[4], size[5], "%.1f" % float(rows[0]["sets_per_s"])] + [
            "%.2f (%.0f)" % (float(r["ms"]), float(r["ms"]) / float(r["bound_ms"])) for r in rows]


section("Offline, raw pixels to volume", "offline", "Ring, RGB8. Wanted on two threads: 170 sets/s at 64^3 (trilinear 120), 30 at 128^3 (20). Stages in ms, in brackets over the time that moving their bytes takes",
        ["size", "basis", "rays", "threads", "sets/s"] + [s for s, in unique(offline, "stage")], rates)

say("", "## The paper's Figure 5", "", "100 frames of 7 simulated cameras, 640x480 in bins of 2x2, grids of 32 to 96, compared with an eighth;",
    "`make bench ONLY=figure5`:", "", *["- " + l for l in log if l.startswith("figure 5, ")])

scale = [l[7:] for l in log if l.startswith("scale: ")]
say("", "## One recording by many processes", "", "`mpirun pyrovox reconstruct`, and what a night would take; `make bench ONLY=scale`:", "",
    *["- " + l for l in scale if not l.startswith("|")], "", *[l for l in scale if l.startswith("|")])

products = table("products")
section("One A and one A^T", "products", "Over the time to stream their entries; wanted 2",
        ["size", "basis", "channels", "threads", "kernels", "ms", "ratio"],
        lambda: [[r["voxels"] + "^3", r["basis"], r["channels"], r["threads"], r["kernels"], "%.2f" % float(r["pair_ms"]),
                  "%.1f" % float(r["ratio"])] for r in products if r["kernels"] != "ref"])

pixels = table("pixels")
section("Pixels to floats, one core", "pixels", "GB/s of raw bytes without binning, and time over that of copying as many bytes",
        ["format", "GB/s", "over a copy"],
        lambda: [[r["format"], "%.1f" % (1e-3 * float(r["raw_mb_per_s"])), r["time_over_copy"] or "-"]
                 for r in pick(pixels, binning="1")])

section("On the wire", "proto_encode", "One core; lit: share of the voxels; bound: what is read and written over the bandwidth. Wanted at "
        "128^3 in f16: 3 ms, 6 ms with the default compression. Reconstructed flames have the solver's own noise",
        ["flame", "voxels", "lit", "", "", "ms", "bound ms", "MB/s of floats", "MB", "ratio", "unpack ms", "volumes/s on 1 GbE"],
        lambda: [[r["flame"], r["voxels"] + "^3", "%.0f %%" % (100 * float(r["lit share"])), r["sample"], r["compress"], r["ms"],
                  r["bound ms"], r["MB/s"], r["MB"], r["ratio"], r["unpack ms"], r["most/s on 1 GbE"]] for r in table("proto_encode")])
section("In shared memory", "share", "From the message (f16, LZ4) to NanoVDB that a renderer maps, one core: unpacked, made in place; bound: the grids' "
        "bytes over the bandwidth. Wanted at 128^3: 5 ms. Vectors: density and emission; split: density, red, green, blue; one: a grey rig's",
        ["flame", "voxels", "grids", "bricks", "MB", "unpack ms", "make ms", "both ms", "99 %", "bound ms", "make over bound"],
        lambda: [[r["flame"], r["voxels"] + "^3", r["grids"], r["bricks"], r["MB"], r["unpack ms"], r["make ms"], r["both ms"],
                  r["both p99 ms"], r["bound ms"], r["make over bound"]] for r in table("share")])
section("Subscribers", "proto_fanout", "64^3, f16, 60 volumes/s by ipc, processes that unpack each. Wanted with 16 and one that is stopped: "
        "all volumes, the publisher's memory bounded",
        ["subscribers", "", "publish ms", "99 %", "came", "latency ms", "99 %", "grown MiB"],
        lambda: [[r["healthy"], r["more"], r["publish p50"], r["publish p99"], "%.1f %%" % (100 * float(r["came share"])),
                  r["latency p50"], r["latency p99"], r["grown MiB"]] for r in table("proto_fanout")])
section("Keys", "proto_keys", "The same volumes, in turns. Wanted: CURVE under 2.5 ns a byte and subscriber, the time of a publish within 5 %. "
        "Sender, receiver: processor time a byte and subscriber; of these the keys; crypto_box: libsodium alone",
        ["subscribers", "by", "publish ms", "over ipc", "came", "sender ns", "of it keys", "receiver ns", "of it keys", "crypto_box ns"],
        lambda: [[r["subscribers"], r["way"], r["publish ms"], r["over ipc"], "%.1f %%" % (100 * float(r["came share"])), r["sender ns/B"],
                  r["keys ns/B"], r["receiver ns/B"], r["opening ns/B"], r["box ns/B"]] for r in table("proto_keys")])
section("A flame that absorbs its own light", "absorb", "64^3 trilinear, 8 views of 160x120; optical depth along the densest ray; error with nothing done about "
        "it, with the c that was and with the c found; over thin: the last over the flame's error without absorption (wanted 1.02, 1.1, 1.15, 1.3)",
        ["scene", "use", "noise", "depth", "off", "known c", "found c", "over thin", "c", "c found", "gain", "time"],
        lambda: [list(r.values()) for r in table("absorb")])
section("Saturated pixels", "saturated", "64^3 trilinear, 8 views, 1 % noise; error of pictures that had room, with saturated pixels left out, and as bounds (wanted: 1.1 of whole at 5 %)",
        ["scene", "use", "% saturated", "pixels", "whole", "left out", "at least", "left out over whole", "at least over whole", "time"],
        lambda: [list(r.values()) for r in table("saturated")])
section("Bodies in the flame", "bodies", "64^3, 8 cameras, 1 % noise; error in what two cameras see (wanted: known at most 1.1 of without)",
        ["scene", "use", "basis", "body", "rig", "judged", "volume", "of without", "columns", "entries", "build s", "solve ms"],
        lambda: [list(r.values()) for r in table("bodies")])
def advised():
    terms = ["black", "saturated", "absorption", "gain", "body", "response"]
    seen = [r["verdict"] for r in table("advise")]
    for k, term in enumerate(terms):
        v = [s[k] for s in seen]
        yield [term, sum(c in "+M" for c in v), "%.0f %%" % (100 * sum(c in "+." for c in v) / len(v)), v.count("M"), v.count("V")]


section("What a recording needs", "advise", "Random scenes whose needs are known, by `pyrovox advise`; wanted: right in 95 %, at most 5 % in vain",
        ["term", "needed", "right", "missed", "in vain"], lambda: list(advised()))
section("The volume before as what is expected", "temporal", "64^3, 8 views of 160x120 (wanted at 5 %: 0.8 of single frames in 1.5 of the time; at 1 %: 1.02); "
        "both: with the way back, offline, over single frames",
        ["scene", "use", "basis", "noise", "single", "temporal", "ratio", "ms", "time", "trust", "both"],
        lambda: [list(r.values()) for r in table("temporal")])
section("A flame in its room", "room", "The ring's flame: ms to light the room, once for a volume, and of a view of 640x480, 2 x 2 rays a pixel",
        ["side", "basis", "voxels with light", "light", "view"], lambda: [list(r.values()) for r in table("room")])
section("Previews", "previews", "The carve stage's ms a set with one subscriber to previews and with none, in turns, 20 sets/s of 8 cameras. "
        "Wanted: 1.05 of the mean", ["pictures", "previews/s", "none", "one", "ratio", "median: none", "one", "95 %: none", "one"],
        lambda: [[r["width"] + "x" + r["height"]] + list(r.values())[2:] for r in table("previews")])

section("Recording volumes, live", "record", "HDF5, 128^3 in three colours at 20 sets/s through the recorder's queue. Wanted: no gap. ms from a "
        "set's arrival to its last byte in the file; of one core: processor time, receiving included; bound: the same bytes onto "
        "the disk, or through zlib on all cores; file: over raw RGB8 frames of 8 cameras, and over dense floats",
        ["flame", "lit", "sets", "gaps", "ms", "99 %", "bound ms", "queue", "of one core", "MB a set", "of 8x320x240", "of 8x640x480",
         "of dense"],
        lambda: [[r["flame"], "%.0f %%" % (100 * float(r["lit share"])), r["sets"], r["gaps"], r["ms p50"], r["ms p99"], r["bound ms"],
                  r["queue MB"] + " MB", "%.0f %%" % (2000 * float(r["cpu s"])), r["set MB"], r["of raw 320"], r["of raw 640"],
                  r["of dense"]] for r in table("record")])
section("Recording volumes, as fast as it goes", "record_rate", "Wanted of VDB on one core: 40 volumes/s at 64^3, 15 at 128^3. Bound: "
        "the same bytes onto the disk, a file a volume but for HDF5; for HDF5 zlib's time where that is longer",
        ["flame", "voxels", "format", "cores", "volumes/s", "ms", "99 %", "bound ms", "processor ms", "MB"],
        lambda: [[r["flame"], r["voxels"] + "^3", r["format"], r["cores"], r["sets/s"], r["ms"], r["ms p99"], r["bound ms"], r["cpu ms"],
                  r["set MB"]] for r in table("record_rate")])

section("Large grids", "large", "Recordings of a few sets: the whole matrix, and its active part (the same bits); s: of "
        "all, silhouettes and matrix included; planned: by `reconstruct --plan`; GB: the most at any time, and what was said "
        "before; sets/s: from pixels to volume",
        ["grid", "pictures", "matrix", "sets", "active", "s", "processors, s", "planned, s", "GB", "said", "sets/s"],
        lambda: [[r["voxels"] + "^3", r["cameras"] + " x " + r["width"] + "x" + r["height"], r["matrix"], r["sets"], r["active"] + " %", r["s"],
                  r["cpu s"], r["planned s"], r["GB"], r["said GB"], r["sets/s"]] for r in table("large")])

section("A camera back", "replug", "Four simulated GigE cameras at 25 Hz, away for 1.5 s: seconds from the moment at which it could "
        "answer again to the first set with all of them", ["after", "runs", "median", "95 %", "worst"],
        lambda: [list(r.values()) for r in table("replug")])

say("", "## Live", "", "Simulated GigE cameras, daemon and subscriber on the same processors (`live.sh`).", "")
live = folder / "live.md"
say(live.read_text().strip() if live.exists() else "Not run.")
take = [l.rstrip() for l in log if l.startswith(("plain write", "take", "reading back", "best of 3", "-- raw"))]
say("", "## Raw recording", "", "```", *take, "```")
if (folder / "error-time.png").exists():
    shutil.copy(folder / "error-time.png", here / "../../daemon/man/error-time.png")
(here / "RESULTS.md").write_text("\n".join(out) + "\n")
print("written: %s" % (here / "RESULTS.md"))
