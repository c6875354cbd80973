"""scale.py BUILD: one recording by 1 and 2 ranks of mpirun; what a night of it would take 1 to 1000 of them.

Every term is measured here, each run several times in turns, medians; what is assumed stands beside it.  8 cameras of 640x480,
64^3 trilinear, a thread a rank.  The model: T(R) = start + ceil(N / R) set + joining(N), but not less than N bytes / file server.
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

SETS, MANY, TURNS = 40, 4000, 5
NIGHT = 10 * 3600 * 30  # sets of ten hours at 30 Hz
SERVER = 1.2e9  # bytes a second of a file server behind 10 Gbit/s: assumed
build = Path(sys.argv[1]).resolve()
pyrovox = str(build / "bin/pyrovox")
if not shutil.which("mpirun") or not (build / "lib/pyrovox/pyrovox-mpi.so").exists():
    print("NOT RUN: no mpirun, or no module pyrovox-mpi: packages openmpi-bin, libopenmpi-dev")
    sys.exit(77)
env = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")


def timed(*command):
    t0 = time.monotonic()
    done = subprocess.run([str(c) for c in command], env=env, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit("%s: %s" % (command[0], done.stderr[-500:]))
    return time.monotonic() - t0


def size(folder, pattern):
    return sum(f.stat().st_size for f in Path(folder).glob(pattern))


def spread(t):
    return "%.2f s (%.2f to %.2f)" % (statistics.median(t), min(t), max(t))


with tempfile.TemporaryDirectory() as at:
    env["PYROVOX_CACHE"] = at + "/cache"
    at = Path(at)
    timed(pyrovox, "simcams", "--cameras", "8", "--size", "640x480", "--ring", SETS, "--write-rig", at / "rig.yaml",
          "--write-frames", at / "take")
    solve = (pyrovox, "reconstruct", "--rig", at / "rig.yaml", "--frames", at / "take", "--black", "0.02", "--quiet", "--threads", "1")
    matrix = timed(*solve, "--out", at / "first.h5", "--last", "0")
    runs = {"one": [], "start": [], "two": [], "join": []}
    for k in range(TURNS):
        runs["start"].append(timed(*solve, "--out", at / ("s%d.h5" % k), "--array", "1/1", "--last", "0"))
        runs["one"].append(timed(*solve, "--out", at / ("a%d.h5" % k), "--array", "1/1"))
        runs["two"].append(timed("mpirun", "-n", "2", "--bind-to", "core", *solve, "--out", at / ("b%d.h5" % k)))
        runs["join"].append(timed(pyrovox, "reconstruct", "--out", at / ("b%d.h5" % k), "--join"))
    # what a set more costs the joining: many small ones
    many = ("--rig", at / "many.yaml", "--frames", at / "many", "--black", "0.02", "--quiet")
    timed(pyrovox, "simcams", "--cameras", "3", "--size", "32x24", "--ring", MANY, "--write-rig", at / "many.yaml", "--write-frames", at / "many")
    timed(pyrovox, "reconstruct", *many, "--grid", "8", "--out", at / "m.h5", "--array", "1/1")
    long = [timed(pyrovox, "reconstruct", "--out", at / "m.h5", "--join") for k in range(TURNS)]
    whole, parts = (h5py.File(at / f, "r") for f in ("a0.h5", "b0.h5"))
    same = np.array_equal(whole["emission"][:].view("u4"), parts["emission"][:].view("u4"))
    stage = {s: float(np.median(whole["sets/" + s + "_ns"][:])) * 1e-6 for s in ("photometry", "hull", "restrict", "solve")}
    read, written = size(at / "take", "*/*") / SETS, size(at / "a0.h5.parts", "*.h5") / SETS
    system = size(at / "cache", "*")

one, start, two, join = (statistics.median(runs[k]) for k in ("one", "start", "two", "join"))
join_set = max(0, statistics.median(long) - join) / (MANY - SETS)
a_set = (one - start) / (SETS - 1)
model = start + SETS / 2 * a_set
print("scale: %d sets, same bits: %s; 1 rank %s, 2 ranks %s: efficiency %.2f (%.2f without the start); the model says %.2f s, %.2f of what 2 took" %
      (SETS, "yes" if same else "NO", spread(runs["one"]), spread(runs["two"]), one / two / 2,
       (one - start) / (two - start) / 2, model, model / two))
print("scale: a set %.1f ms: photometry %.1f, hull %.1f, restrict %.1f, solve %.1f, the rest (read, decode, write) %.1f; start %.2f s, "
      "joining %.2f s and %.1f us a set; matrix %.0f MB a node, built once in %.1f s; read %.2f MB, written %.2f MB a set" %
      (1e3 * a_set, *stage.values(), 1e3 * a_set - sum(stage.values()), start, join, 1e6 * join_set, system * 1e-6, matrix, read * 1e-6, written * 1e-6))
slower = max(1, (two - start) / (SETS / 2 * a_set))  # what two ranks of one node take from each other
print("scale: assumed: nodes of two ranks that cost each other %.2f as here, a file server of %.1f GB/s for all, joining linear in sets; a night is %d sets, %.1f TB" %
      (slower, SERVER * 1e-9, NIGHT, NIGHT * read * 1e-12))
print("scale: | ranks | hours | efficiency | of it start | joining | file server's least | bound by |")
print("scale: |---|---|---|---|---|---|---|")
for ranks in (1, 2, 10, 100, 1000):
    work = -(-NIGHT // ranks) * a_set * (slower if ranks > 1 else 1)
    joining, server = join + NIGHT * join_set, NIGHT * (read + written) / SERVER
    total = max(matrix + work, server) + joining
    print("scale: | %d | %.2f | %.2f | %.4f | %.2f | %.2f | %s |" %
          (ranks, total / 3600, NIGHT * a_set / ranks / total, matrix / 3600, joining / 3600, server / 3600,
           "the file server" if server > matrix + work else "joining" if joining > work else "solving"))
sys.exit(0 if same else 1)
