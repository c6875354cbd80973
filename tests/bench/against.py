"""against.py NEW OLD: two build folders of pyrovox side by side in one run.

Reconstructs every recording that record.c makes with both, in turns, and prints error against the truth
and the time of every stage, of the one over that of the other (the least of all rounds)."""
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

ROUNDS = 3
STAGES = ["photometry", "hull", "restrict", "solve"]
builds = {"new": Path(sys.argv[1]).resolve(), "old": Path(sys.argv[2]).resolve()}
recordings = builds["new"] / "bench/recordings"


def run(name, recording, basis):
    """Mean error of the frames, ms from volume to volume, least ms of each stage."""
    out = recording / (name + "-out")
    shutil.rmtree(out, ignore_errors=True)
    report = out.with_suffix(".json")
    subprocess.run([builds[name] / "bin/pyrovox", "reconstruct", "--quiet", "--rig", recording / "rig.yaml", "--frames",
                    recording / "frames", "--basis", basis, "--out", out, "--save-report", report,
                    "--matrix-cache", out.with_suffix("." + basis)] + ([] if colour(recording) else ["--grey"]),
                   check=True, stdout=subprocess.DEVNULL)
    truth = np.load(recording / "truth.npy").astype(float)
    volumes = sorted(out.glob("*.npy"))
    error = [np.linalg.norm(np.load(f).reshape(truth.shape) - truth) / np.linalg.norm(truth) for f in volumes]
    frames = json.loads(report.read_text())["frames"]
    apart = 1e-6 * (volumes[-1].stat().st_mtime_ns - volumes[0].stat().st_mtime_ns) / (len(volumes) - 1)
    return np.mean(error), [apart] + [min(f["ms"][s] for f in frames) for s in STAGES]


def colour(recording):
    return np.load(recording / "truth.npy", mmap_mode="r").ndim == 4


recordings.mkdir(parents=True, exist_ok=True)
recorded = subprocess.run([builds["new"] / "tests/bench/record", recordings]).returncode
if recorded not in (0, 77):
    sys.exit(recorded)
print("\nthis build over %s, default solver, least of %d turns: error; ms from one volume to the next; ms of each stage.\n"
      "Stages of different frames run at the same time where a build does so: the first column is what a user waits for." %
      (builds["old"].parent, ROUNDS))
print("\n| flame | basis | error | ratio | " + " | ".join(s + " ms | ratio" for s in ["frame"] + STAGES) + " |")
print("|---" * (6 + 2 * len(STAGES)) + "|")
ratios = []
for recording in sorted(p for p in recordings.iterdir() if (p / "rig.yaml").exists()):
    for basis in ("box", "trilinear"):
        best, error = {}, {}
        for turn in range(ROUNDS):
            for name in ("new", "old") if turn % 2 else ("old", "new"):
                error[name], ms = run(name, recording, basis)
                best[name] = np.minimum(best.get(name, np.inf), ms)
        times = best["new"] / best["old"]
        ratios.append([error["new"] / error["old"], *times])
        print("| %s | %s | %.4f | %.4f | " % (recording.name, basis, error["new"], ratios[-1][0]) +
              " | ".join("%.2f | %.2f" % v for v in zip(best["new"], times)) + " |", flush=True)
median = np.median(ratios, axis=0)
print("| median of the ratios | | | %.4f | " % median[0] + " | ".join("| %.2f" % v for v in median[1:]) + " |")
sys.exit(recorded)
