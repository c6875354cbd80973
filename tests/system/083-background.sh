#!/bin/bash
# A background taken by the running daemon: what stands still before the cameras leaves the volumes, comes back when
# the background goes, and a flame is refused as one.  And from pictures, for reconstruct.
name=083
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy' 2>/dev/null || { echo "no python3 with numpy"; exit 77; }
"$py" - "$dir" <<'PY'
import os, sys
import numpy as np
y, x = np.mgrid[0:60, 0:80].astype(np.float32)
rng = np.random.default_rng(1)
blob = np.exp(-((x - 40) ** 2 + (y - 30) ** 2) / 60)[..., None] * np.float32([0.5, 0.4, 0.3])
for c in range(4):
    for kind in "still", "moving":
        os.makedirs(f"{sys.argv[1]}/{kind}/cam{c}")
        for f in range(30):
            img = blob * (1 if kind == "still" else 1 + 0.3 * np.sin(f)) + rng.normal(0, 0.002, (60, 80, 3))
            np.save(f"{sys.argv[1]}/{kind}/cam{c}/{f:06d}.npy", img.astype(np.float32))
PY
brightest() { # folder of volumes, expression of the greatest value b
    "$py" - "$dir/$1" "$2" <<'PY'
import glob, sys
import numpy as np
b = max(float(np.load(f).max()) for f in glob.glob(sys.argv[1] + "/*.npy"))
print(f"  brightest voxel {b:.4f}")
sys.exit(0 if eval(sys.argv[2]) else 1)
PY
}
volumes_of() { "$pyrovox" record --quiet --endpoint "$volumes" --volumes 5 --out "$dir/$1"; }
background() { run "$pyrovox" calibrate background --live --control "$control" "$@"; }

config a.yaml <<< "cameras: \"files:$dir/still/{name}/%06d.npy\"
loop: true
fps: 40"
start a.log "$pyrovoxd" --config "$dir/a.yaml"
daemon=$started
check runs wait_for published 5
check before volumes_of before
check something-stands-there brightest before "b > 0.3"
taken() { background --sets 30; says 0 'the mean of 30 sets is subtracted from now on'; }
check taken taken
n=$(sets); wait_for published $((n + 5))
check after volumes_of after
check it-is-gone brightest after "b < 0.05"
none() { background --sets 0; says 0 'the background is removed'; }
check none-any-more none
n=$(sets); wait_for published $((n + 5))
check again volumes_of again
check it-is-back brightest again "b > 0.3"
# others are served while one is being taken, which takes these cameras minutes
"$pyrovox" calibrate background --live --control "$control" --sets 9000 > "$dir/away" 2>&1 & away=$!
pids+=("$away")
check long-one wait_for grep -q 'taking a background of 9000 sets' "$dir/a.log"
one_at_a_time() { background --sets 30; says 1 'is being taken already' && ! gone "$away"; }
check one-at-a-time one_at_a_time
served() { status > "$dir/served" && ! gone "$away" && grep -q published "$dir/served"; }
check status-is-answered served
given_up() { background --sets 0; says 0 'the background is removed' && ended "$away" 1; }
check and-it-can-be-ended given_up
one() { background --sets 1; says 1 'sets should be 2 to'; }
check one-set-is-none one
kill -INT "$daemon"; wait "$daemon"
nobody() { background --sets 4; says 1 'pyrovoxd'; }
check nobody-there nobody

config b.yaml <<< "cameras: \"files:$dir/moving/{name}/%06d.npy\"
loop: true
fps: 40"
start b.log "$pyrovoxd" --config "$dir/b.yaml"
check flame-runs wait_for published 5
refused() { background --sets 30; says 1 'something moves in the background' 'put the flame out first'; }
check a-flame-is-refused refused
check and-nothing-is-subtracted volumes_of flame
check flame-is-there brightest flame "b > 0.3"

offline() {
    run "$pyrovox" calibrate background --rig tests/data/rig4.yaml --frames "$dir/moving" --out "$dir/no"
    says 1 'something moves in' 'column' && [ ! -e "$dir/no" ] || return 1
    run "$pyrovox" calibrate background --rig tests/data/rig4.yaml --frames "$dir/still" --out "$dir/bg"
    says 0 'backgrounds of 4 cameras' || return 1
    run "$pyrovox" reconstruct --quiet --rig tests/data/rig4.yaml --frames "$dir/still" --last 2 --background "$dir/bg" --out "$dir/rec"
    says 0
}
check from-pictures offline
check reconstructed-without-it brightest rec "b < 0.05"
exit $rc
