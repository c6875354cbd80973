"""judge.py BENCH_DIR: the table of bench_judge and bench_scalarflow, the default against the best of all others.

The best other is picked per case and per column with the truth known, over both bases: nobody can use it, so 1 is
what cannot be had by choosing another solver.  results.py puts the same lines on its page."""
import csv
import math
import sys
from pathlib import Path

DEFAULT, PAPER = "pcg", "cgls-paper"
BASES = ["trilinear", "box"]  # the default one first
USES = ["fitted", "seen", "held out", "real"]


def read(path):
    return list(csv.DictReader(open(path, newline=""))) if path.exists() else []


def cases(folder):
    """Case -> (use, {(basis, solver): (volume error or None, view error)}), in the order of USES."""
    found = {}
    for r in read(folder / "judge.csv"):
        wrong = "" if r["wrong"] == "exact" else ", " + r["wrong"]
        size = "" if r["voxels"] == "64" else ", %s^3" % r["voxels"]
        case = "%s, %s, %s%s%s" % (r["scene"], r["rig"], r["noise"], wrong, size)
        found.setdefault(case, (r["use"], {}))[1][r["basis"], r["solver"]] = float(r["volume"]), float(r["view"])
    for r in read(folder / "scalarflow.csv"):
        case = "plume, %s left out" % r["left_out"]
        found.setdefault(case, ("real", {}))[1][r["basis"], r["solver"]] = None, float(r["view"])
    return dict(sorted(found.items(), key=lambda c: USES.index(c[1][0])))


def over(errors, basis, others, what):
    """The default's error in a basis over the least of the others'; None where there is none."""
    mine, least = errors[basis, DEFAULT][what], [e[what] for k, e in errors.items() if k in others]
    return None if mine is None else mine / min(least)


def show(v, digits=2):
    return "-" if v is None else "%.*f" % (digits, v)


def rows(found):
    """Head, and what makes a row for each case and basis."""
    solvers = list(dict.fromkeys(s for _, errors in found.values() for _, s in errors))
    lines = []
    for case, (use, errors) in found.items():
        for basis in (b for b in reversed(BASES) if (b, DEFAULT) in errors):
            best = [k for k in errors if k[1] != DEFAULT]
            lines.append([case, use, basis] +
                         ["%s / %s" % (show(errors[basis, s][0], 3), show(errors[basis, s][1], 1 if use != "real" else 2))
                          for s in solvers] +
                         ["%s / %s" % tuple(show(over(errors, basis, best, what)) for what in (0, 1))])
    return ["case", "use", "basis"] + solvers + ["%s over the best other" % DEFAULT], lambda: lines


def summary(found):
    """For every use and basis: mean and worst case of the default over the best other, mean over the paper's."""
    for use in USES:
        for basis in BASES:
            mine = {c: e for c, (u, e) in found.items() if u == use and (basis, DEFAULT) in e}
            for what, name in ((0, "volume"), (1, "unseen view")):
                best = {c: over(e, basis, [k for k in e if k[1] != DEFAULT], what) for c, e in mine.items()}
                if not best or None in best.values():
                    continue
                paper = [over(e, basis, [(basis, PAPER)], what) for e in mine.values()]
                worst = max(best, key=best.get)
                yield [use, basis, name, "%.2f" % (sum(best.values()) / len(best)), "%.2f: %s" % (best[worst], worst),
                       "%.2f" % (sum(paper) / len(paper)), "%d" % len(best)]


SUMMARY = ["use", "basis", "error of", "%s over the best other, mean" % DEFAULT, "worst", "over %s, mean" % PAPER, "cases"]


LABS = ["wrong", "use", "error over the exact rig's", "%s over the best other: volume" % DEFAULT, "worst", "unseen view", "worst", "flames"]


def labs(found, rig="8 on a ring, 1 %", basis=BASES[0]):
    """For every way to be wrong and use: the default's volume error over that of the exact rig, and over the best other,
    geometric means over the flames that have both."""
    of = {}
    for case, (use, errors) in found.items():
        scene, _, wrong = case.partition(", " + rig)
        if _ and "^3" not in wrong and (basis, DEFAULT) in errors:
            of.setdefault((wrong[2:] or "exact", use), {})[scene] = {k: e for k, e in errors.items() if k[0] == basis}
    full = {scene for (wrong, use), flames in of.items() if wrong != "exact" for scene in flames}
    for (wrong, use), flames in of.items():
        flames = {s: e for s, e in flames.items() if s in full and s in of.get(("exact", use), {})}
        best = [[over(e, basis, [k for k in e if k[1] != DEFAULT], what) for e in flames.values()] for what in (0, 1)]
        exact = [e[basis, DEFAULT][0] / of["exact", use][s][basis, DEFAULT][0] for s, e in flames.items()]
        if flames and all(len(e) > 1 for e in flames.values()):
            yield [wrong, use] + ["%.2f" % v for v in (mean(exact), mean(best[0]), max(best[0]), mean(best[1]), max(best[1]))] + [
                "%d" % len(flames)]


def mean(ratios):
    return math.exp(sum(map(math.log, ratios)) / len(ratios))


def markdown(head, lines):
    return ["| " + " | ".join(r) + " |" for r in [head, ["---"] * len(head)] + lines]


if __name__ == "__main__":
    judged = cases(Path(sys.argv[1]))
    print("\nvolume error / unseen view of 255, each solver as it stops by itself\n")
    head, lines = rows(judged)
    print("\n".join(markdown(head, lines()) + [""] + markdown(SUMMARY, list(summary(judged))) + [""] +
                    markdown(LABS, list(labs(judged)))))
    sys.exit(0 if judged else 77)
