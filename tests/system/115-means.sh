#!/bin/bash
# Temperatures with bars of a recording of soot: a mean has its own bar, curves that are not the cameras' show in the whole of the light, a
# folder of volumes keeps its rig, what fails leaves nothing, and --plan knows what error bars take.
name=115
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy, h5py' 2> /dev/null || { echo "no python3 with numpy and h5py (apt-get install python3-numpy python3-h5py)"; exit 77; }
cd "$dir" || exit 1
cat > soot.py <<'PY'
"""Soot of 1500 to 1900 K in numpy alone, as volumes, lamps and pictures.  argv: what."""
import glob, os, sys
import numpy as np
H, C, K = 6.62607015e-34, 299792458.0, 1.380649e-23
nm = np.arange(400, 720.5, 0.5)
l = nm * 1e-9
cameras = {  # tests/lib/curves.h, every 40 nm, the second and the third of its cameras
    "right": [[400, 0, 0, 0], [440, .04, .16, .81], [480, .04, .43, .82], [520, .09, .94, .22], [560, .04, .67, .03], [600, .68, .18, .01],
              [640, .29, .03, 0], [680, .03, .01, 0], [720, 0, 0, 0]],
    "wrong": [[400, 0, .01, .03], [440, .01, .10, .76], [480, .04, .59, .82], [520, .13, .94, .31], [560, .27, .74, .12],
              [600, .51, .29, .06], [640, .27, .05, .02], [680, .06, .02, .01], [720, 0, 0, 0]]}
curves = np.array(cameras["right"])
S = np.array([np.interp(nm, curves[:, 0], curves[:, 1 + q]) for q in range(3)])
constant = np.array([3e-5, 4e-5, 6e-5]) * 60
planck = lambda T: 2 * H * C**2 / l**5 / np.expm1(H * C / K / (l * T))
seen = lambda spectrum: constant * np.trapz(S * spectrum, l)
soot = lambda T, f: f * seen(6 * np.pi * 0.26 / l * planck(T))
truth = lambda n: 1500 + 400 * np.arange(n)[:, None, None] / n
if sys.argv[1] == "inputs":
    for name, rows in cameras.items():
        np.savetxt(name + ".csv", np.array(rows), "%g", ",", header="wavelength,red,green,blue", comments="")
    light = seen(0.43 * planck(2350)) / 20
    rng = np.random.default_rng(1)
    for c in range(8):
        os.makedirs(f"lamp/cam{c}")
        for k in range(4):
            picture = np.zeros((60, 80, 3))
            picture[20:40, 30:50] = light
            np.save(f"lamp/cam{c}/{k:06d}.npy", (picture + 2e-4 * rng.standard_normal(picture.shape)).astype(np.float32))
    table = np.arange(1400, 2001, 1.0)
    e = np.array([soot(t, 1) for t in table])
    os.makedirs("burning")
    for f in sorted(glob.glob("vol/*.npy")):
        green = np.load(f)[..., 1]
        T = np.broadcast_to(truth(len(green)), green.shape)
        v = (2e-6 * green / green.max())[..., None] * np.stack([np.interp(T, table, e[:, q]) for q in range(3)], -1)
        np.save("burning/" + os.path.basename(f), v.astype(np.float32))
        open("burning/" + os.path.basename(f)[:-3] + "json", "w").write(open(f[:-3] + "json").read())
elif sys.argv[1] == "noise":  # pictures of the cameras: the brightest pixel at 0.8, noise of 0.05 %
    files = sorted(glob.glob("shot/*/*.npy"))
    top = 0.8 / max(np.load(f).max() for f in files)
    rng = np.random.default_rng(2)
    for f in files:
        p = np.load(f) * top
        to = f.replace("shot/", "frames/")
        os.makedirs(os.path.dirname(to), exist_ok=True)
        np.save(to, (p + 5e-4 * rng.standard_normal(p.shape)).astype(np.float32))
    print(20 / top)
PY
flame() {
    "$pyrovox" simcams --size 80x60 --cameras 8 --voxels 24 --ring 3 --write-rig rig.yaml --write-frames take > log 2>&1 &&
        "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --quiet --out vol > log 2>&1 && "$py" soot.py inputs || { cat log; return 1; }
    local c k
    for c in 0 1 2 3 4 5 6 7; do
        mkdir -p "shot/cam$c"
        for k in 0 1 2; do "$pyrovox" render --rig rig.yaml --camera "cam$c" "burning/00000$k.npy" "shot/cam$c/00000$k.npy" > log 2>&1 || { cat log; return 1; }; done
    done
    "$py" soot.py noise > brighter && "$pyrovox" reconstruct --rig rig.yaml --frames frames --black 0.004 --quiet --error-bars=8 --out flame.h5 > log 2>&1 || { cat log; return 1; }
    for k in right wrong; do
        run "$pyrovox" calibrate spectral --rig rig.yaml --response "$k.csv" --region 32,22,16,16 --emissivity 0.43 --frames lamp --exposure 2 --kelvin 2350 --out "$k.yaml"
        says 0 'known to' || return 1
    done
}
check a_flame_of_soot flame

kelvin() { # the lamp's light is a 20th, the flame's pictures are scaled: at this exposure both are one
    ms=$("$py" -c 'print(2 * 20 / float(open("brighter").read()) * 20)')
    run "$pyrovox" temperature flame.h5 --rig right.yaml --exposure "$ms" --noise 0.01 --quiet --out kelvin.h5
    says 0 'soot of 1' '--noise was not used for the 3 sets' || return 1
    case $out in *"does not fit"*) echo "$out"; return 1 ;; esac
    run "$pyrovox" value kelvin.h5 --quiet --csv all.csv; says 0 'bars hold noise and calibration' || return 1
    run "$pyrovox" value kelvin.h5 --quiet --box=-0.3,-0.3,0.2,0.3,0.3,0.5 --csv part.csv; says 0 ' ± ' || return 1
    "$py" - << 'END'
import csv, h5py, numpy as np
t = h5py.File("kelvin.h5", "r")
x, y, z = (t[a][:] for a in "xyz")
inside = ((z > 0.2) & (z < 0.5))[:, None, None] & ((y > -0.3) & (y < 0.3))[:, None] & ((x > -0.3) & (x < 0.3))
right = np.broadcast_to((1500 + 400 * np.arange(len(z)) / len(z))[:, None, None], inside.shape)
V = np.prod(t.attrs["spacing"])
assert (t["sets/modes"][:] >= 3 + 8).all() and t["temperature_modes"].shape[1] == t["sets/modes"][:].max()
far = []
for name, where in ("all", np.ones_like(inside)), ("part", inside):
    rows = list(csv.DictReader(open(name + ".csv")))
    assert len(rows) == 3
    for i, r in enumerate(rows):
        ok = np.isfinite(t["temperature"][i]) & where
        n = ok.sum()
        assert n > 60, n
        for key, field, unit in ("mean", "temperature", 1 / n), ("soot", "soot", 1 / n), ("soot_volume", "soot", V * 1e3):
            m, sd = (t[field + w][i].astype(float) for w in ("_modes", "_sd"))
            m = m[:, ok]
            own = np.maximum(sd[ok] ** 2 - (m**2).sum(0), 0)
            bar = unit * np.sqrt((m.sum(1) ** 2).sum() + own.sum())
            assert np.isclose(float(r[key + "_sd"]), bar, rtol=1e-4), (key, r[key + "_sd"], bar)
            # above what voxels have for themselves, below what they would have if all errors were one
            assert unit * np.sqrt(own.sum()) < bar < unit * sd[ok].sum(), key
            assert key != "mean" or bar > 1.5 * unit * np.sqrt((sd[ok] ** 2).sum())
        assert r["volume_sd"] == ""
        far.append((t["temperature"][i][ok].mean() - right[ok].mean()) / float(r["mean_sd"]))
assert np.abs(far).max() < 3, far
assert abs(t.attrs["misfit"]) < 4 * t.attrs["misfit_sd"] and 0 < t.attrs["misfit_sd"] < 0.05 and 0 < t.attrs["chi2_mean"] < 2
END
}
check means_have_their_bars kelvin

curves() { # of another camera, calibrated by the same lamp: most voxels fit, all together do not
    run "$pyrovox" temperature flame.h5 --rig wrong.yaml --exposure "$ms" --quiet --out wrong.h5
    says 0 'the light does not fit the response curves of wrong.yaml' 'green than soot gives' || return 1
    "$py" -c 'import h5py
t = h5py.File("wrong.h5", "r")
assert abs(t.attrs["misfit"]) > 4 * t.attrs["misfit_sd"]
assert (t["state"][:] == 1).sum() > (t["state"][:] == 2).sum()'
}
check other_curves_show_in_the_whole curves

folder() { # keeps the rig that it was made with; a rig.yaml of somebody else stays
    [ -s vol/rig.yaml ] && cmp -s <(sed -n '/^cameras/,$p' vol/rig.yaml | grep -c name:) <(grep -c name: rig.yaml) || return 1
    sed 's/name: cam3/name: left/' right.yaml > other.yaml
    run "$pyrovox" temperature vol --rig other.yaml --noise 0.01 --out no.h5; says 1 'it is the rig of another recording' && [ ! -e no.h5 ] || return 1
    mkdir mine && echo mine > mine/rig.yaml
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --quiet --out mine
    says 0 'mine/rig.yaml: was there before, so it is left' && [ "$(cat mine/rig.yaml)" = mine ]
}
check a_folder_keeps_its_rig folder

half() { # what fails midway leaves neither temperatures nor some of the .vdb files
    cp -r burning half && head -c 2000 burning/000002.npy > half/000002.npy
    run "$pyrovox" temperature half --rig right.yaml --noise 0.002 --exposure 40 --quiet --vdb vdb --out half.h5
    case $out in *"not installed"* | *"cannot be used"*) echo "SKIP $name:half (OpenVDB)"; return 0 ;; esac
    says 1 '000002' && [ ! -e half.h5 ] && [ ! -e vdb ]
}
check nothing_of_what_fails half

plan() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --plan --error-bars=8 --out plan.h5 --quiet
    says 0 'error bars' 'of volumes with their error bars' && [ ! -e plan.h5 ] || return 1
    local with; with=$(sed -n 's/^disk: at most \([0-9.e-]*\) GB.*/\1/p' <<< "$out")
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --plan --out plan.h5 --quiet; says 0 'GB of volumes (' || return 1
    case $out in *"error bars"*) return 1 ;; esac
    "$py" -c 'import sys; a, b = map(float, sys.argv[1:]); assert 9.5 < a / b < 14.5, (a, b)' "$with" "$(sed -n 's/^disk: at most \([0-9.e-]*\) GB.*/\1/p' <<< "$out")"
}
check plan_knows_them plan
exit $rc
