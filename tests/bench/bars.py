"""bars.py BENCH_DIR [PAGE]: the tables of bench_bars from BENCH_DIR/bars.csv, flames chosen on and judged apart.

With PAGE, their section replaces the one of that page, or is added at its end.  Nothing else of the page changes."""
import csv
import re
import sys
from pathlib import Path

TITLE = "## Error bars"
TEXT = """Of how many voxels above 2 % of the brightest the truth lies within 1.96 standard deviations, in percent, and
in the classes `rim`, `core`, `thin` and `few`. `boxes`: the same of sums over 300 random boxes. `view`: mean square of what an unseen view
misses, over its predicted variance. `total`: error of the whole light over its bar, root mean square. `sd / error`: root mean squares. `time`: of a set with bars over that without.
Means over flames. 8 cameras, 1 %, 48^3, 120x90, trilinear and K = 16 unless named. Wanted: 93 to 97 in
`all` and `boxes`, 88 to 99 in each class, 0.8 to 1.25 in `view`. `tests/bench/bars_scenes.h` lists flames and rigs
([NUMERICS.md](../../recon/NUMERICS.md), 21). `make bench ONLY=bench_bars`, then `tests/bench/bars.py build/bench
tests/bench/RESULTS.md`, make this section."""
COLUMNS = {"all": "all", "rim": "rim", "core": "core", "thin": "thin", "few": "few", "boxes": "boxes", "view": "view",
           "total": "total", "sd / error": "sd", "time": "cost"}
USES = {"chosen on": "Flames on which constants were chosen, with all rigs but `gains` and `7 cameras`:", "judged": "Flames on which nothing was chosen:"}


def read(folder):
    path = Path(folder) / "bars.csv"
    return list(csv.DictReader(open(path, newline=""))) if path.exists() else []


def table(head, rows):
    return ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"] + ["| " + " | ".join(r) + " |" for r in rows]


def lines(rows):
    out = [TITLE, "", *TEXT.split("\n")]
    for use, what in USES.items():
        of = [r for r in rows if r["flame"] == "mean" and r["use"] == use]
        out += ["", what, "", *table(["case", *COLUMNS], [[r["case"], *(r[c] for c in COLUMNS.values())] for r in of])]
    worst = [r for r in rows if r["flame"] not in ("mean", "plume") and float(r["all"]) < 93]
    short = {}
    for r in worst:
        short.setdefault(r["flame"], []).append("%s %s" % (r["case"], r["all"]))
    out += ["", "Flames and cases below 93 in `all`:", "", *table(["flame", "cases"], [[k, ", ".join(v)] for k, v in short.items()])]
    real = [r for r in rows if r["flame"] == "plume"]
    out += ["", "A real capture, ScalarFlow's plume: four views in, the fifth judges, over the pixels whose rays meet the hull and after its "
            "gain.", "`outside`: percent of its light whose rays meet no voxel.", "",
            *table(["view left out", "view", "sd / error", "outside"],
                   [[r[c] for c in ("case", "view", "sd", "outside")] for r in real])]
    return out


def main(folder, page=None):
    text = "\n".join(lines(read(folder)))
    if page is None:
        print(text)
        return
    old = Path(page).read_text()
    section = re.compile(r"^%s$.*?(?=^## |\Z)" % re.escape(TITLE), re.M | re.S)
    new = section.sub(lambda m: text + "\n\n", old) if section.search(old) else old.rstrip("\n") + "\n\n" + text + "\n"
    Path(page).write_text(new.rstrip("\n") + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
