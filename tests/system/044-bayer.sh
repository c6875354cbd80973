#!/bin/bash
# Raw Bayer pictures: the daemon and `pyrovox reconstruct` make the same volume of them, pixels as they are by
# themselves, interpolated when asked; what cannot be is refused with the remedy.
name=044
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy' 2>/dev/null || { echo "no python3 with numpy"; exit 77; }
frames=12
"$py" - "$dir/raw" $frames <<'PY'
import os, sys
import numpy as np
y, x = np.mgrid[0:60, 0:80].astype(np.float32)
colour = np.where(y % 2 == 0, np.where(x % 2 == 0, 0, 1), np.where(x % 2 == 0, 1, 2))
level = np.float32([0.8, 0.5, 0.2])[colour]
rng = np.random.default_rng(1)
for c in range(4):
    os.makedirs(f"{sys.argv[1]}/cam{c}")
    for f in range(int(sys.argv[2])):
        u, v = 40 + 5 * np.cos(0.1 * f + c), 30 + 6 * np.sin(0.07 * f)
        img = np.exp(-((x - u) ** 2 + (y - v) ** 2) / 60) * level + rng.normal(0, 0.002, (60, 80))
        np.save(f"{sys.argv[1]}/cam{c}/{f:06d}.npy", np.clip(np.rint(img * 255), 0, 255).astype(np.uint8))
PY
live() { # name, more lines of the configuration: volumes to $dir/NAME
    config "$1.yaml" "wait_subscriber: true" <<< "cameras: \"files:$dir/raw/{name}/%06d.npy\"
pixel_format: BayerRG8
binning: 1
lossless: true
matrix_cache: $dir/m
$2"
    start "$1-record.log" "$pyrovox" record --quiet --endpoint "$volumes" --out "$dir/$1"
    local recorder=$started
    start "$1.log" "$pyrovoxd" --config "$dir/$1.yaml"
    ended "$started" 0 && ended "$recorder" 0 &&
        grep -q "$frames sets from the cameras, $frames published, 0 dropped" "$dir/$1.log"
}
offline() { # name, more arguments
    local out=$1; shift
    "$pyrovox" reconstruct --quiet --rig tests/data/rig4.yaml --frames "$dir/raw" --binning 1 \
        --pixel-format BayerRG8 --out "$dir/$out" "$@" > "$dir/$out.log" 2>&1
}
compare() { # a, b: largest difference over the largest value, on standard output; fails without volumes
    "$py" - "$dir/$1" "$dir/$2" $frames <<'PY'
import glob, os, sys
import numpy as np
files = sorted(glob.glob(sys.argv[1] + "/*.npy"))
worst = top = 0
for f in files:
    a, b = np.load(f), np.load(sys.argv[2] + "/" + os.path.basename(f))
    worst, top = max(worst, float(abs(a - b).max())), max(top, float(b.max()))
print(worst / top if top > 0.1 else 9)
sys.exit(0 if len(files) == int(sys.argv[3]) else 1)
PY
}
same() { local v; v=$(compare "$1" "$2") && awk -v v="$v" 'BEGIN{exit !(v <= 1e-6)}' || { echo "  differ: ${v:-no volumes}"; return 1; }; }
differ() { local v; v=$(compare "$1" "$2") && awk -v v="$v" 'BEGIN{exit !(v > 1e-3 && v < 5)}' || { echo "  alike: ${v:-no volumes}"; return 1; }; }
refused() { # exit code, words, command...
    local want=$1 words=$2 got; shift 2
    "$@" > "$dir/refused.txt" 2>&1; got=$?
    [ $got = "$want" ] && grep -q -- "$words" "$dir/refused.txt" || { echo "  exit $got"; cat "$dir/refused.txt"; return 1; }
}

check daemon-by-itself live auto ""
check reconstruct-by-itself offline auto-off
check same-volume same auto auto-off
check daemon-interpolating live demosaic "bayer: demosaic"
check reconstruct-interpolating offline demosaic-off --bayer demosaic
check same-volume-interpolated same demosaic demosaic-off
check rays-are-another-thing differ auto demosaic
check reconstruct-other-solver offline mlem --solver mlem

config no.yaml <<< "cameras: \"files:$dir/raw/{name}/%06d.npy\"
bayer: rays
solver: {name: mlem}"
check daemon-refuses-rays-without-solver refused 1 "bayer: rays needs solver.name: pcg" "$pyrovoxd" --config "$dir/no.yaml"
check reconstruct-refuses-rays refused 2 "--bayer rays needs" "$pyrovox" reconstruct --rig tests/data/rig4.yaml --frames "$dir/raw" --out "$dir/x" --bayer rays --solver mlem
check unknown-format-lists-them refused 2 "one of Mono8 .*BayerRG12csi" "$pyrovox" reconstruct --rig tests/data/rig4.yaml --frames "$dir/raw" --out "$dir/x" --pixel-format Bayer9
check wrong-format-names-the-file refused 1 "000000.npy: a Mono8 image cannot be read as BayerRG16" "$pyrovox" reconstruct --rig tests/data/rig4.yaml --frames "$dir/raw" --out "$dir/x" --pixel-format BayerRG16
exit $rc
