"""fit.py FIT.CSV [LAMBDA.C]: the exponents of the automatic weight, from the cases that fit.c made.

    log lambda = s + n log N + r log R + k log K + d log d

by least squares over the cases whose flame may be fitted on; lambda is that of least error (a parabola
through the lowest three of the sweep).  Beside them the exponents in the code, and what either choice
costs in error over the best weight, fitted-on and held-out cases apart."""
import csv
import re
import sys

import numpy as np

rows = list(csv.DictReader(open(sys.argv[1], newline="")))
source = open(sys.argv[2] if len(sys.argv) > 2 else "recon/solve/lambda.c").read()
names = ["SCALE", "ON_NOISE", "ON_ROUGHNESS", "ON_CHORD", "ON_DENSITY"]
code = np.array([float(re.search(r"#define %s +\(?(-?[\d.]+)" % n, source).group(1)) for n in names])
grid = [k for k in rows[0] if re.match(r"[\d.e-]+$", k)]
log_grid = np.log([float(k) for k in grid])
X = np.array([[1] + [np.log(float(r[k])) for k in "NRKd"] for r in rows])
error = np.array([[float(r[k]) for k in grid] for r in rows])
fitted = np.array([r["use"] == "fitted" for r in rows])


def best(e):
    """Logarithm of the weight of least error; nan where that is at an end of the sweep."""
    k = int(np.argmin(e))
    if k in (0, len(e) - 1):
        return np.nan
    a, b, _ = np.polyfit(log_grid[k - 1:k + 2], np.log(e[k - 1:k + 2]), 2)
    return -b / (2 * a)


target = np.array([best(e) for e in error])
least = error.min(axis=1)
use = fitted & np.isfinite(target)
if use.sum() <= len(names):
    sys.exit("%d cases tell something of the %d exponents, more are needed: make fit CASES=n" % (use.sum(), len(names)))
mine, *_ = np.linalg.lstsq(X[use], target[use], rcond=None)
spread = np.sqrt(np.sum((target[use] - X[use] @ mine) ** 2) / (use.sum() - len(mine)))
stderr = spread * np.sqrt(np.diag(np.linalg.inv(X[use].T @ X[use])))
agree = [abs(np.log(float(r["code"])) - np.clip(x @ code, log_grid[0], log_grid[-1])) for r, x in zip(rows, X)]

print("%d cases fitted on, %d of them with the best weight inside the sweep; %d held out" %
      (fitted.sum(), use.sum(), (~fitted).sum()))
print("the code's own weight and the one of its exponents here agree to %.1f %%\n" % (100 * np.expm1(max(agree))))
print("| | fitted here | standard error | in the code | apart by |\n|---|---|---|---|---|")
for n, m, s, c in zip(names, mine, stderr, code):
    print("| %s | %.2f | %.2f | %.2f | %.1f standard errors |" % (n, m, s, c, abs(m - c) / s))
print("\n| error over that of the best weight | cases | mean | 9 of 10 within | worst | weight right to a factor |")
print("|---|---|---|---|---|---|")
for what, mask in (("fitted on", fitted), ("held out", ~fitted)):
    for who, beta in (("fitted here", mine), ("in the code", code)):
        at = np.clip(X[mask] @ beta, log_grid[0], log_grid[-1])
        lost = np.array([np.exp(np.interp(a, log_grid, np.log(e))) for a, e in zip(at, error[mask])]) / least[mask] - 1
        known = np.isfinite(target[mask])
        factor = np.exp(np.sqrt(np.mean((at - target[mask])[known] ** 2)))
        print("| %s, exponents %s | %d | %.1f %% | %.1f %% | %.0f %% | %.1f |" %
              (what, who, mask.sum(), 100 * lost.mean(), 100 * np.quantile(lost, 0.9), 100 * lost.max(), factor))
    lost = np.array([float(r["auto"]) for r, m in zip(rows, mask) if m]) / least[mask] - 1
    print("| %s, as the solver does it (with the misfit) | %d | %.1f %% | %.1f %% | %.0f %% | |" %
          (what, mask.sum(), 100 * lost.mean(), 100 * np.quantile(lost, 0.9), 100 * lost.max()))
