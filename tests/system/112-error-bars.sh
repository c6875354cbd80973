#!/bin/bash
# error-bars: `pyrovox reconstruct --error-bars` from pictures to figures: the volume stays what it is, bars are the same for
# any number of threads and processes, and those of sums are the ones that the file's modes give; what it cannot do is refused.
name=112
. "$(dirname "$0")/lib.sh"
cd "$dir" || exit 1
made() {
    "$pyrovox" simcams --cameras 6 --size 96x72 --ring 4 --voxels 24 --write-rig rig.yaml --write-frames take > log 2>&1 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out plain.h5 --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out bars.h5 --error-bars=8 --threads 1 --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out two.h5 --error-bars=8 --threads 3 --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out vol --error-bars=8 --quiet; says 0 && [ -e vol/sd/000003.npy ] || return 1
    for i in 1 2; do
        run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out parts.h5 --error-bars=8 --array $i/2 --quiet; says 0 || return 1
    done
    [ -e parts.h5 ]
}
same() {
    run "$pyrovox" value bars.h5 --quiet --csv bars.csv; says 0 ' ± ' && ! grep -q 'has no error bars' <<< "$out" || return 1
    "$py" -c 'import h5py' || { echo "SKIP $name:same (apt-get install python3-h5py)"; return 0; }
    "$py" - << 'END'
import csv, glob, h5py, numpy as np
plain, bars, two, parts = (h5py.File(n + ".h5", "r") for n in ("plain", "bars", "two", "parts"))
assert "emission_sd" not in plain and bars["emission"][:].any()
assert np.array_equal(plain["emission"][:], bars["emission"][:])
assert b"--error-bars 8" in bars["config"][()] and b"--black 0.02" in parts["config"][()]
for other in two, parts:
    for k in "emission", "emission_sd", "emission_modes":
        assert np.array_equal(bars[k][:], other[k][:]), (other.filename, k)
rows = list(csv.DictReader(open("bars.csv")))
assert len(rows) == 4
for i, r in enumerate(rows):
    x, sd, modes = (bars[k][i].astype(float) for k in ("emission", "emission_sd", "emission_modes"))
    lit = sd > 0
    assert lit.sum() > 300 and not x[~lit].any() and len(modes) >= 8
    sums = (modes**2).sum(0)
    assert (sums <= sd**2 * 1.0001 + 1e-12).all()
    V = np.prod(bars.attrs["spacing"])
    t = np.sqrt(np.maximum(sd**2 - sums, 0)).mean(-1)
    right = V * np.sqrt((modes.mean(-1).sum((1, 2, 3))**2).sum() + (t**2).sum())
    assert np.isclose(float(r["light_sd"]), right, rtol=1e-4), (r["light_sd"], right)
    assert 0 < right < 0.2 * float(r["light_m2"])
    assert np.allclose(np.load(sorted(glob.glob("vol/sd/0*.npy"))[i]), sd, atol=1e-6 * sd.max())
END
}
refused() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --out no.h5 --error-bars=3; says 2 '4 to 64' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --out no.h5 --error-bars --solver mlem; says 2 '--error-bars needs the solver pcg' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out parts.h5 --error-bars=9 --array 1/2 --quiet; says 1 '--error-bars 9' || return 1
    run "$pyrovox" value vol --quiet; says 0 'of single voxels alone' '--error-bars --out FILE.h5' || return 1
    # three cameras are too few to leave one out, which the bars say
    run "$pyrovox" reconstruct --rig rig.yaml --cameras cam0,cam2,cam4 --frames take --black 0.02 --out few.h5 --error-bars=8 --last 0 --quiet; says 0 || return 1
    run "$pyrovox" value few.h5 --quiet; says 0 'bars in doubt' 'fewer than five cameras' && [ ! -e no.h5 ]
}
check a_recording_with_bars made
check the_same_volume_and_the_same_bars same
check refused_or_in_doubt refused
