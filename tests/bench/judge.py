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
    """Case -> (use, draws), a draw {(basis, solver, pictures): (volume error or None, view error)}, in the order of USES.
    """
    found = {}
    for r in read(folder / "judge.csv"):
        wrong = "" if r["wrong"] == "exact" else ", " + r["wrong"]
        size = "" if r["voxels"] == "64" else ", %s^3" % r["voxels"]
        case = "%s, %s, %s%s%s" % (r["scene"], r["rig"], r["noise"], wrong, size)
        draw = found.setdefault(case, (r["use"], {}))[1].setdefault(r["draw"], {})
        draw[r["basis"], r["solver"], r["pictures"]] = float(r["volume"]), float(r["view"])
    for r in read(folder / "scalarflow.csv"):
        case = "plume, %s left out" % r["left_out"]
        draw = found.setdefault(case, ("real", {}))[1].setdefault("1", {})
        draw[r["basis"], r["solver"], "given"] = None, float(r["view"])
    return {case: (use, list(draws.values())) for case, (use, draws) in
            sorted(found.items(), key=lambda c: USES.index(c[1][0]))}


def mean(ratios):
    return math.exp(sum(map(math.log, ratios)) / len(ratios))


def over(draws, basis, is_other, what):
    """The default's error in a basis over the least of the others', geometric mean over draws; None where there is none."""
    ratios = []
    for e in (d for d in draws if (basis, DEFAULT, "given") in d):  # later draws have one basis
        mine, others = e[basis, DEFAULT, "given"][what], [v[what] for k, v in e.items() if is_other(k)]
        if mine is None or not others:
            return None
        ratios.append(mine / min(others))
    return mean(ratios)


def given(key):
    return key[1] != DEFAULT and key[2] == "given"


def any_pictures(key):
    return key[1] != DEFAULT


def show(v, digits=2):
    return "-" if v is None else "%.*f" % (digits, v)


def average(draws, key, what):
    values = [e[key][what] for e in draws if key in e and e[key][what] is not None]
    return sum(values) / len(values) if values else None


def rows(found):
    """Head, and what makes a row for each case and basis."""
    solvers = list(dict.fromkeys(k[1] for _, draws in found.values() for e in draws for k in e))
    lines = []
    for case, (use, draws) in found.items():
        for basis in (b for b in reversed(BASES) if (b, DEFAULT, "given") in draws[0]):
            lines.append([case, use, basis] +
                         ["%s / %s" % (show(average(draws, (basis, s, "given"), 0), 3),
                                       show(average(draws, (basis, s, "given"), 1), 1 if use != "real" else 2)) for s in solvers] +
                         ["%s / %s" % tuple(show(over(draws, basis, other, what)) for what in (0, 1)) for other in (given, any_pictures)])
    return ["case", "use", "basis"] + solvers + ["%s over the best other" % DEFAULT, "with its pictures corrected too"], lambda: lines


def summary(found):
    """For every use and basis: mean and worst case of the default over the best other, mean over the paper's."""
    for use in USES:
        for basis in BASES:
            mine = {c: d for c, (u, d) in found.items() if u == use and (basis, DEFAULT, "given") in d[0]}
            for what, name in ((0, "volume"), (1, "unseen view")):
                best = {c: over(d, basis, given, what) for c, d in mine.items()}
                if not best or None in best.values():
                    continue
                corrected = {c: over(d, basis, any_pictures, what) for c, d in mine.items()}
                paper = [over(d, basis, lambda k, b=basis: k == (b, PAPER, "given"), what) for d in mine.values()]
                worst, last = max(best, key=best.get), max(corrected, key=corrected.get)
                yield [use, basis, name, "%.2f" % (sum(best.values()) / len(best)), "%.2f: %s" % (best[worst], worst),
                       "%.2f" % (sum(corrected.values()) / len(best)), "%.2f: %s" % (corrected[last], last),
                       "%.2f" % (sum(paper) / len(paper)) if None not in paper else "-", "%d" % len(best)]


SUMMARY = ["use", "basis", "error of", "%s over the best other, mean" % DEFAULT, "worst", "with its pictures corrected too, mean", "worst",
           "over %s, mean" % PAPER, "cases"]


LABS = ["cameras", "wrong", "use", "error over the exact rig's", "%s over the best other: volume" % DEFAULT, "worst", "unseen view", "worst",
        "with its pictures corrected too: volume", "worst", "unseen view", "worst", "flames", "draws"]
RIGS = ["8 on a ring", "5 on a ring", "6 on 150 deg", "12 on a ring"]


def labs(found, basis=BASES[0]):
    """For every rig, way to be wrong and use: the default's volume error over that of the exact rig of the same draw, and
    over the best other, geometric means over the flames that have both, and several draws."""
    for rig in RIGS:
        yield from lab(found, rig, basis)


def lab(found, rig, basis):
    of = {}
    for case, (use, draws) in found.items():
        scene, here, wrong = case.partition(", " + rig + ", 1 %")
        if here and "^3" not in wrong and len(draws) > 1 and (basis, DEFAULT, "given") in draws[0]:
            of.setdefault((wrong[2:] or "exact", use), {})[scene] = [{k: e for k, e in d.items() if k[0] == basis} for d in draws]
    full = {scene for (wrong, use), flames in of.items() if wrong != "exact" for scene in flames}
    for (wrong, use), flames in of.items():
        exact = of.get(("exact", use), {})
        flames = {s: d for s, d in flames.items() if s in full and s in exact}
        if not flames or any(len(e) < 2 for d in flames.values() for e in d):
            continue
        rise = [e[basis, DEFAULT, "given"][0] / x[basis, DEFAULT, "given"][0] for s, d in flames.items() for e, x in zip(d, exact[s])]
        best = [[over(d, basis, other, what) for d in flames.values()] for other in (given, any_pictures) for what in (0, 1)]
        yield [rig, wrong, use, "%.2f" % mean(rise)] + ["%.2f" % f(b) for b in best for f in (mean, max)] + [
            "%d" % len(flames), "%d" % min(len(d) for d in flames.values())]


def markdown(head, lines):
    return ["| " + " | ".join(r) + " |" for r in [head, ["---"] * len(head)] + lines]


if __name__ == "__main__":
    judged = cases(Path(sys.argv[1]))
    print("\nvolume error / unseen view of 255, each solver as it stops by itself\n")
    head, lines = rows(judged)
    print("\n".join(markdown(head, lines()) + [""] + markdown(SUMMARY, list(summary(judged))) + [""] +
                    markdown(LABS, list(labs(judged)))))
    sys.exit(0 if judged else 77)
