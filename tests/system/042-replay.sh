#!/bin/bash
# A lossless replay of recorded frames loses nothing and gives the volumes that `pyrovox reconstruct` gives.
name=042
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy' 2>/dev/null || { echo "no python3 with numpy"; exit 77; }
frames=150
"$py" - "$dir/frames" $frames <<'PY'
import os, sys
import numpy as np
y, x = np.mgrid[0:60, 0:80].astype(np.float32)
rng = np.random.default_rng(1)
for c in range(4):
    os.makedirs(f"{sys.argv[1]}/cam{c}")
    for f in range(int(sys.argv[2])):
        u, v = 40 + 5 * np.cos(0.1 * f + c), 30 + 6 * np.sin(0.07 * f)
        blob = np.exp(-((x - u) ** 2 + (y - v) ** 2) / 60)
        img = blob[..., None] * np.float32([0.8, 0.5, 0.2]) + rng.normal(0, 0.002, (60, 80, 3))
        np.save(f"{sys.argv[1]}/cam{c}/{f:06d}.npy", img.astype(np.float32))
PY
config a.yaml "wait_subscriber: true" <<< "cameras: \"files:$dir/frames/{name}/%06d.npy\"
lossless: true
matrix_cache: $dir/m"
start rec.log "$pyrovox" record --quiet --endpoint "$volumes" --out "$dir/live"
recorder=$started
start a.log "$pyrovoxd" --config "$dir/a.yaml"
check replay-ends-by-itself ended "$started" 0
check nothing-is-lost grep -q "$frames sets from the cameras, $frames published, 0 dropped" "$dir/a.log"
check recorder-sees-the-end ended "$recorder" 0
check reconstruct "$pyrovox" reconstruct --quiet --rig tests/data/rig4.yaml --frames "$dir/frames" --out "$dir/offline"
same() {
    "$py" - "$dir" <<'PY'
import glob, os, sys
import numpy as np
live = sorted(glob.glob(sys.argv[1] + "/live/*.npy"))
worst, top = 0, 0
for f in live:
    a, b = np.load(f), np.load(sys.argv[1] + "/offline/" + os.path.basename(f))
    worst, top = max(worst, float(abs(a - b).max())), max(top, float(b.max()))
print(f"  {len(live)} volumes, worst difference {worst:g} of {top:g}")
sys.exit(0 if len(live) == 150 and top > 0.1 and worst <= 1e-6 * top else 1)
PY
}
check same-volumes-as-reconstruct same

# a damaged cache is rebuilt, and said
size=$(stat -c %s "$dir/m")
truncate -s $((size / 2)) "$dir/m"
config b.yaml <<< "cameras: \"files:$dir/frames/{name}/%06d.npy\"
lossless: true
matrix_cache: $dir/m"
start c.log "$pyrovoxd" --config "$dir/b.yaml"
check runs-with-damaged-cache ended "$started" 0
check damage-is-said grep -qE "matrix|m:" <(grep -i warn "$dir/c.log")
check cache-is-whole-again [ "$(stat -c %s "$dir/m")" = "$size" ]
start d.log "$pyrovoxd" --config "$dir/b.yaml"
check next-start-reads-it ended "$started" 0
check read-not-built grep -q "entries, read in" "$dir/d.log"
exit $rc
