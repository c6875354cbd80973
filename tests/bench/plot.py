"""plot.py BENCH_DIR: error against time per solver, from curves.csv, as error-time.png."""
import csv
import sys
from collections import defaultdict

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

folder = sys.argv[1]
curves = defaultdict(list)
with open(folder + "/curves.csv", newline="") as f:
    for row in csv.DictReader(f):
        panel = (row["scene"], row["basis"], float(row["noise"]))
        curves[panel, row["solver"]].append((float(row["ms"]), float(row["volume"])))
panels = sorted({panel for panel, _ in curves}, key=lambda p: (p[0] != "flame", p[1], p[2]))
columns = 3
rows = (len(panels) + columns - 1) // columns
fig, axes = plt.subplots(rows, columns, figsize=(4 * columns, 3 * rows), squeeze=False)
for ax in axes.flat[len(panels):]:
    ax.axis("off")
for ax, panel in zip(axes.flat, panels):
    for (p, solver), points in sorted(curves.items()):
        if p == panel:
            ax.plot(*zip(*points), marker=".", markersize=3, linewidth=1, label=solver)
    ax.set_title("%s, %s, noise %g %%" % (panel[0], panel[1], 100 * panel[2]), fontsize=9)
    ax.set_xscale("log")
    ax.set_ylim(0, 1)
    ax.set_xlabel("solver time, ms", fontsize=8)
    ax.set_ylabel("volume error", fontsize=8)
    ax.grid(alpha=0.3)
axes[0][0].legend(fontsize=8)
fig.tight_layout()
fig.savefig(folder + "/error-time.png", dpi=110)
print("picture: %s/error-time.png" % folder)
