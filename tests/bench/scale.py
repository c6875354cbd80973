"""scale.py BUILD: one recording by 1 and 2 ranks of mpirun; what a night of it would take 1 to 1000 of them.

Every term is measured here, each run several times in turns, medians; what is assumed stands beside it.  8 cameras of 640x480,
a take of raw frames, 64^3 trilinear, a thread and a processor a rank.  The model:
T(R) = start + opening(N) + ceil(N / R) set + joining(N), but not less than N bytes / file server.
"""
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

SETS, MANY, TURNS = 120, 4000, 5
NIGHT = 10 * 3600 * 30  # sets of ten hours at 30 Hz
SERVER = 1.2e9  # bytes a second of a file server behind 10 Gbit/s: assumed
build = Path(sys.argv[1]).resolve()
pyrovox = str(build / "bin/pyrovox")
if not shutil.which("mpirun") or not (build / "lib/pyrovox/pyrovox-mpi.so").exists():
    print("NOT RUN: no mpirun, or no module pyrovox-mpi: packages openmpi-bin, libopenmpi-dev")
    sys.exit(77)
processors = sorted(os.sched_getaffinity(0))
if len(processors) < 2:
    print("NOT RUN: two ranks need two processors")
    sys.exit(77)
env = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")


def timed(*command, pin=True):
    """Seconds; on one processor, as a rank has: what reads, solves and writes is several threads."""
    t0 = time.monotonic()
    done = subprocess.run([str(c) for c in command], env=env, capture_output=True, text=True,
                          preexec_fn=(lambda: os.sched_setaffinity(0, processors[:1])) if pin else None)
    if done.returncode != 0:
        sys.exit("%s: %s" % (command[0], done.stderr[-500:]))
    return time.monotonic() - t0


def recorded(name, *what):
    """NAME.h5, a take of simulated frames."""
    timed(pyrovox, "simcams", *what, "--write-rig", at / (name + ".yaml"), "--write-frames", at / name, pin=False)
    (at / "d.yaml").write_text("""rig: %s.yaml
cameras: "files:%s/{name}/%%06d.png"
lossless: true
publish: { endpoints: ["ipc://%s/volumes"] }
control: { endpoint: "ipc://%s/control" }
record: { mode: raw, path: "%s.h5", keep_free_gb: 0 }
""" % (at / name, at / name, at, at, at / name))
    timed(build / "bin/pyrovoxd", "-c", at / "d.yaml", pin=False)
    shutil.rmtree(at / name)
    return reads(name)


def reads(name, rig=None):
    return (pyrovox, "reconstruct", "--rig", at / ((rig or name) + ".yaml"), "--frames", at / (name + ".h5"), "--black", "0.02", "--quiet",
            "--threads", "1")


def size(folder, pattern):
    return sum(f.stat().st_size for f in Path(folder).glob(pattern))


def spread(t):
    return "%.2f s (%.2f to %.2f)" % (statistics.median(t), min(t), max(t))


with tempfile.TemporaryDirectory() as at:
    env["PYROVOX_CACHE"] = at + "/cache"
    at = Path(at)
    solve = recorded("take", "--cameras", "8", "--size", "640x480", "--ring", SETS)
    matrix = timed(*solve, "--out", at / "first.h5", "--last", "0")
    # the same frames, packed: less to read, more to do
    timed("h5repack", "-f", "SHUF", "-f", "GZIP=1", at / "take.h5", at / "packed.h5", pin=False)
    timed(*solve, "--out", at / "free.h5", pin=False) # its stages do not take the processor from each other
    runs = {k: [] for k in ("one", "start", "two", "join", "packed", "long", "opened", "few")}
    for k in range(TURNS):
        runs["start"].append(timed(*solve, "--out", at / ("s%d.h5" % k), "--array", "1/1", "--last", "0"))
        runs["one"].append(timed(*solve, "--out", at / ("a%d.h5" % k), "--array", "1/1"))
        runs["two"].append(timed("mpirun", "-n", "2", "--bind-to", "core", *solve, "--out", at / ("b%d.h5" % k), pin=False))
        runs["packed"].append(timed(*reads("packed", "take"), "--out", at / ("c%d.h5" % k), "--array", "1/1"))
        runs["join"].append(timed(pyrovox, "reconstruct", "--out", at / ("b%d.h5" % k), "--join"))
    # what a set more costs the opening and the joining: many small ones
    many, few = (recorded("small%d" % n, "--cameras", "8", "--size", "32x24", "--voxels", "8", "--ring", n) for n in (MANY, SETS))
    timed(*many, "--out", at / "m.h5", "--array", "1/1", pin=False)
    for k in range(TURNS):
        runs["long"].append(timed(pyrovox, "reconstruct", "--out", at / "m.h5", "--join"))
        runs["opened"].append(timed(*many, "--out", at / ("o%d.h5" % k), "--array", "1/1", "--last", "0"))
        runs["few"].append(timed(*few, "--out", at / ("p%d.h5" % k), "--array", "1/1", "--last", "0"))
    whole, parts = (h5py.File(at / f, "r") for f in ("a0.h5", "b0.h5"))
    same = np.array_equal(whole["emission"][:].view("u4"), parts["emission"][:].view("u4"))
    free = h5py.File(at / "free.h5", "r")["sets"]
    stage = {s: float(np.median(free[s + "_ns"][:])) * 1e-6 for s in ("photometry", "hull", "restrict", "solve")}
    read, less, written = size(at, "take.h5") / SETS, size(at, "packed.h5") / SETS, size(at / "a0.h5.parts", "*.h5") / SETS
    system = size(at / "cache", "*")

one, start, two, join, packed, long, opened, few = (statistics.median(t) for t in runs.values())
join_set = max(0, long - join) / (MANY - SETS)
open_set = max(0, opened - few) / (MANY - SETS)
a_set = (one - start) / (SETS - 1)
model = start + SETS / 2 * a_set
print("scale: %d sets, same bits: %s; 1 rank %s, 2 ranks %s: efficiency %.2f (%.2f without the start); the model says %.2f s, %.2f of what 2 took" %
      (SETS, "yes" if same else "NO", spread(runs["one"]), spread(runs["two"]), one / two / 2,
       (one - start) / (two - start) / 2, model, model / two))
print("scale: a set %.1f ms: photometry %.1f, hull %.1f, restrict %.1f, solve %.1f, the rest (read, vote, compress, write) %.1f; start %.2f s, "
      "opening %.1f and joining %.1f us a set; matrix %.0f MB a node, built once in %.1f s; read %.2f MB, written %.2f MB a set" %
      (1e3 * a_set, *stage.values(), 1e3 * a_set - sum(stage.values()), start, 1e6 * open_set, 1e6 * join_set, system * 1e-6, matrix, read * 1e-6, written * 1e-6))
packed_set = (packed - start) / (SETS - 1)
print("scale: packed (h5repack -f SHUF -f GZIP=1) a set is %.2f MB to read and takes %.1f ms" % (less * 1e-6, 1e3 * packed_set))
slower = max(1, (two - start) / (SETS / 2 * a_set))  # what two ranks of one node take from each other
print("scale: assumed: nodes of two ranks that cost each other %.2f as here, a file server of %.1f GB/s for all, opening and joining linear in sets; a night is %d sets, %.1f TB" %
      (slower, SERVER * 1e-9, NIGHT, NIGHT * read * 1e-12))


def night(ranks, a_set, read):
    """Hours, and what takes most of them."""
    work = -(-NIGHT // ranks) * a_set * (slower if ranks > 1 else 1)
    opening, joining, server = NIGHT * open_set, join + NIGHT * join_set, NIGHT * (read + written) / SERVER
    alone = matrix + opening + work
    most = max((work, "solving"), (opening, "opening"), (joining, "joining"), (server if server > alone else 0, "the file server"))
    return (max(alone, server) + joining) / 3600, most[1]


print("scale: the file server's least %.2f h, packed %.2f; opening %.3f h, joining %.3f, the matrix %.4f" %
      (NIGHT * (read + written) / SERVER / 3600, NIGHT * (less + written) / SERVER / 3600, NIGHT * open_set / 3600,
       (join + NIGHT * join_set) / 3600, matrix / 3600))
print("scale: | ranks | hours | efficiency | bound by | packed: hours | bound by |")
print("scale: |---|---|---|---|---|---|")
for ranks in (1, 2, 10, 30, 100, 1000):
    (hours, most), (less_h, less_most) = night(ranks, a_set, read), night(ranks, packed_set, less)
    print("scale: | %d | %.2f | %.2f | %s | %.2f | %s |" % (ranks, hours, NIGHT * a_set / ranks / 3600 / hours, most, less_h, less_most))
sys.exit(0 if same else 1)
