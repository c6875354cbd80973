#!/bin/bash
# Recordings of eight high-speed cameras, 1024x1024 pixels of 12 packed bits, from disk to volumes: the share of the time in
# which the solver waited for frames.  The files are not in memory when it begins.  Fails from 5 % on.
#   highspeed.sh BUILD
set -u -o pipefail
b=$(realpath "$1")
at=$(mktemp -d "${TMPDIR:-/tmp}/pyrovox-bench-XXXXXX") || exit 1
trap 'rm -rf "$at"' EXIT
export PYROVOX_CACHE=$at/cache
"$b/bin/pyrovox" simcams --size 1024x1024 --ring 40 --voxels 64 --write-rig "$at/rig.yaml" --write-frames "$at/take" > /dev/null 2>&1 || exit 1
/usr/bin/python3 tests/lib/highspeed.py "$at/take" cine12 "$at/rec" || exit 1
rm -rf "$at/take"
sync
for f in "$at"/rec/*; do dd if="$f" iflag=nocache count=0 status=none; done
"$b/bin/pyrovox" reconstruct --rig "$at/rig.yaml" --frames "$at/rec" --black 0.02 --binning 4 --out "$at/vol.h5" --save-report "$at/report.json" \
    --quiet 2> "$at/log" || { cat "$at/log"; exit 1; }
/usr/bin/python3 - "$at/report.json" << 'PY'
import json, sys
r = json.load(open(sys.argv[1]))
ms = [f["ms"] for f in r["frames"]]
mean = {k: sum(m[k] for m in ms) / len(ms) for k in ("photometry", "restrict", "solve")}
print("high-speed: %d sets of 8 x 1024x1024 x 12 bits, the solver waited %.1f %% of the time; ms a set: %s" % (
    len(ms), 100 * r["solver_waited"], ", ".join("%s %.1f" % (k, v) for k, v in mean.items())))
sys.exit(r["solver_waited"] >= 0.05)
PY
