"""plot.py BENCH_DIR: error against time from curves.csv as error-time.png.

A row of panels per basis, a panel per flame, a curve per solver: every point is a whole solve with
another iteration budget; dotted: the default solver stopped by a deadline.  The star is what the
solver returns by itself.  fitted: the solver's constants were fitted on this flame; held out: nothing was."""
import csv
import sys
from collections import defaultdict

try:
    import matplotlib
except ImportError:
    print("NOT RUN: picture, needs python3-matplotlib")
    sys.exit(77)
matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

COLOURS = ["#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2", "#7f7f7f"]

folder = sys.argv[1]
curves, late, stops = defaultdict(list), defaultdict(list), {}
solvers, scenes, bases, noise = [], [], [], None
with open(folder + "/curves.csv", newline="") as f:
    for row in csv.DictReader(f):
        scene = row["scene"] + " (" + row["use"] + ")"
        key = scene, row["basis"], row["solver"]
        point = float(row["ms"]), float(row["volume"])
        noise = row["noise"]
        for name, known in ((row["solver"], solvers), (scene, scenes), (row["basis"], bases)):
            if name not in known:
                known.append(name)
        if row["stop"] == "auto":
            stops[key] = point
        else:
            (late if row["stop"] == "deadline" else curves)[key].append(point)

fig, axes = plt.subplots(len(bases), len(scenes), figsize=(5.2 * len(scenes), 4.2 * len(bases) + 0.6),
                         sharey="col", squeeze=False)
plain = FuncFormatter(lambda v, _: "%g" % v)
for r, basis in enumerate(bases):
    for c, scene in enumerate(scenes):
        ax = axes[r][c]
        # the default solver is the first one and lies on top of the others
        for i, solver in reversed(list(enumerate(solvers))):
            points = curves[scene, basis, solver]
            if not points:
                continue
            colour = COLOURS[i % len(COLOURS)]
            ax.plot(*zip(*points), color=colour, marker="o", markersize=2.5, linewidth=2.2 if i == 0 else 1.2,
                    zorder=3 if i == 0 else 2, label=solver + (" (default)" if i == 0 else ""))
            if late[scene, basis, solver]:
                ax.plot(*zip(*sorted(late[scene, basis, solver])), color=colour, linestyle=":", linewidth=1.5,
                        zorder=3, label=solver + " by deadline")
            if (scene, basis, solver) in stops:
                ax.plot(*stops[scene, basis, solver], marker="*", markersize=14, color=colour,
                        markeredgecolor="black", markeredgewidth=0.6, linestyle="none", zorder=4)
        ax.set_title("%s, %s" % (scene, basis), fontsize=11)
        ax.set_xscale("log")
        ax.set_yscale("log")
        lowest = min(e for (s, _, _), p in curves.items() if s == scene for _, e in p)
        ax.set_ylim(0.85 * lowest, 1.05)
        ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        ax.xaxis.set_major_formatter(plain)
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
        ax.yaxis.set_major_formatter(plain)
        ax.yaxis.set_minor_formatter(NullFormatter())
        ax.grid(alpha=0.3, which="both", linewidth=0.5)
        if r == len(bases) - 1:
            ax.set_xlabel("time of the whole solve, ms")
        if c == 0:
            ax.set_ylabel("volume error, relative L2")
handles, labels = axes[0][0].get_legend_handles_labels()
star = plt.Line2D([], [], marker="*", markersize=12, color="white", markeredgecolor="black", linestyle="none")
fig.suptitle("Error against time, 8 views of 160x120, voxels 1/64, noise %s, 2 threads" % noise, fontsize=13)
fig.tight_layout(rect=(0, 0.05, 1, 0.98))
fig.legend(handles[::-1] + [star], labels[::-1] + ["automatic stop"], loc="lower center",
           ncol=min(8, len(labels) + 1), frameon=False, fontsize=10)
fig.savefig(folder + "/error-time.png", dpi=100)
print("picture: %s/error-time.png" % folder)
