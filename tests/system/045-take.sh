#!/bin/bash
# Raw frames recorded beside a live solve; played back they give the same sets and the same volumes, bit
# for bit; what is in a take is told, exported and read by h5py; a killed daemon's take is whole.
name=045
source "$(dirname "$0")/lib.sh"
take=$dir/take.h5

live_config() { # more lines on standard input
    config live.yaml "wait_subscriber: true" < <(
        echo 'cameras: "sim:"'
        echo 'fps: 25'
        echo 'photometry: { black: 0.02 }'
        echo 'solver: { warm_start: off, deadline_ms: 0 }'
        cat)
}
recorded() { field "s['record']['sets'] >= $1"; }

live() { # from the configuration, beside volumes that are recorded too
    echo "record: { mode: raw, path: \"$take\", queue: 64 }" | live_config
    start live.log "$pyrovoxd" -c "$dir/live.yaml"; local d=$started
    start vol-live.log "$pyrovox" record --endpoint "$volumes" --out "$dir/live" --quiet; local r=$started
    wait_for published 30 || return 1
    kill -INT "$d"
    ended "$d" 0 && ended "$r" 0 || return 1
    grep -q '0 sets and 0 frames could not be recorded' "$dir/live.log"
}
check live_and_recorded live

info() {
    "$pyrovox" replay --info "$take" > "$dir/info.log" || return 1
    grep -q 'closed in order' "$dir/info.log" && grep -Eq '^cam0 +RGB8 +80x60 +[0-9]+' "$dir/info.log" &&
        grep -q 'could not be recorded: 0 frames' "$dir/info.log"
}
check info_tells info

same() { # every volume of folder $1 is in $2 with the same bytes, at least $3 of them; times too
    "$py" - "$dir/$1" "$dir/$2" "$3" <<'PY'
import glob, json, os, sys
import numpy as np
a, b, least = sys.argv[1], sys.argv[2], int(sys.argv[3])
n = bad = lit = 0
for p in sorted(glob.glob(a + "/*.npy")):
    q = os.path.join(b, os.path.basename(p))
    if not os.path.exists(q):
        continue
    n += 1
    x, y = np.load(p), np.load(q)
    j, k = (json.load(open(f[:-3] + "json")) for f in (p, q))
    lit += bool(x.any())
    keys = "set t_exposure_ns spread_ns cameras_present camera_mask rig_hash".split()
    if x.tobytes() != y.tobytes() or any(j[i] != k[i] for i in keys) or j["report"]["iterations"] != k["report"]["iterations"]:
        bad += 1; print("  differs:", p)
if n < least or bad or lit < n // 2:
    print(f"  {n} volumes in both, {bad} differ, {lit} not empty"); sys.exit(1)
PY
}
replayed() { # folder, options...
    local out=$1; shift
    start "$out-daemon.log" "$pyrovox" replay "$@" --set publish.wait_subscriber=true "$take"; local d=$started
    start "$out-vol.log" "$pyrovox" record --endpoint "$volumes" --out "$dir/$out" --quiet; local r=$started
    ended "$r" 0 && ended "$d" 0
}
check replay_lossless replayed lossless --lossless
check volumes_are_the_same_bits same live lossless 25
again() { replayed again --lossless && same lossless again 25; }
check and_again again
everything() { # lossless: each set of the take became a volume
    local sets; sets=$(sed -n 's/^sets *\([0-9]*\),.*/\1/p' "$dir/info.log")
    [ "$(ls "$dir/lossless"/*.npy | wc -l)" = "$sets" ] || { echo "  $(ls "$dir/lossless"/*.npy | wc -l) of $sets"; return 1; }
}
check replay_leaves_nothing_out everything
at_speed() { # sets that come out are the recorded ones; slowly, a busy machine has to keep up
    replayed fast --speed 0.5 --set solver.warm_start=off --set solver.deadline_ms=0 && same fast live 10
}
check replay_at_speed at_speed
other_settings() { # --set is heeded
    replayed other --lossless --set grid=12 && "$py" - "$dir/other" <<'PY'
import glob, sys, numpy as np
p = sorted(glob.glob(sys.argv[1] + "/*.npy")); sys.exit(len(p) < 10 or np.load(p[0]).shape[0] != 12)
PY
}
check replay_with_other_settings other_settings
refuses() {
    "$pyrovox" replay --lossless --set solver.nmae=osem "$take" > "$dir/refuse.log" 2>&1; [ $? = 1 ] &&
        grep -q 'solver.nmae' "$dir/refuse.log" || return 1
    "$pyrovox" replay /etc/passwd > "$dir/refuse.log" 2>&1; [ $? = 1 ] && grep -q 'not a take' "$dir/refuse.log" || return 1
    "$pyrovox" replay > /dev/null 2>&1; [ $? = 2 ]
}
check refusals refuses

exported() {
    "$pyrovox" replay --export "$dir/frames" "$take" > "$dir/export.log" || return 1
    "$pyrovox" reconstruct --rig "$dir/frames/rig.yaml" --frames "$dir/frames" --black 0.02 --out "$dir/offline" --last 3 > "$dir/offline.log" 2>&1 || return 1
    "$pyrovox" reconstruct --rig "$dir/frames/rig.yaml" --frames "$take" --black 0.02 --out "$dir/direct" --last 3 >> "$dir/offline.log" 2>&1 || return 1
    local v n=0
    for v in "$dir/offline"/*.npy; do n=$((n + 1)); cmp "$v" "$dir/direct/${v##*/}" || return 1; done
    [ "$n" -gt 0 ]
}
check export_and_reconstruct exported

if "$py" -c 'import h5py' 2>/dev/null; then
    h5py() { # TAKE.md's example, and that the exported pictures are the take's pixels
        "$py" - "$take" "$dir/frames" <<'PY'
import re, sys
import h5py, numpy as np
code = re.search(r"```python\n(.*?)```", open("daemon/TAKE.md").read(), re.S).group(1)
space = {}
exec(code.replace('"take.h5"', repr(sys.argv[1])), space)
f, images = space["f"], space["images"]
ok = sorted(images) == ["cam0", "cam1", "cam2", "cam3"] and all(i.shape == (60, 80, 3) and i.dtype == np.uint8 and i.max() > 10 for i in images.values())
ok &= f.attrs["closed"] == 1 and f.attrs["n_sets"] == len(f["sets"]) == len(f["members"])
idx, sets = f["cameras/cam2/index"][:], f["sets"][:]
m = f["members"][:, f["cameras/cam2"].attrs["number"]]
ok &= (idx["set"][m] == sets["number"]).all() and (np.abs(idx["t_exposure_ns"][m] - sets["t_exposure_ns"]) < 20_000_000).all()
ok &= b"cam0" in f["rig"][()] and b"warm_start: off" in f["config"][()]
sys.exit(not ok)
PY
    }
    check h5py_reads_it h5py
else
    echo "SKIP $name:h5py_reads_it (no python3-h5py)"
fi
if command -v h5dump > /dev/null; then
    check h5dump_reads_it bash -c "h5dump -d /sets -s 0 -c 2 '$take' | grep -q t_exposure_ns"
else
    echo "SKIP $name:h5dump_reads_it (no hdf5-tools)"
fi

at_run_time() { # begun and ended over the control socket, twice; the second is killed
    live_config < /dev/null
    start run.log "$pyrovoxd" -c "$dir/live.yaml"; local d=$started
    start run-vol.log "$pyrovox" record --endpoint "$volumes" --out "$dir/run" --quiet; local r=$started
    wait_for published 3 || return 1
    "$pyrovox" record --raw stop --control "$control" > "$dir/raw.log" 2>&1 && return 1
    grep -q 'nothing is being recorded' "$dir/raw.log" || return 1
    "$pyrovox" record --raw start --control "$control" --out "$dir/one.h5" || return 1
    wait_for recorded 10 || return 1
    "$pyrovox" record --raw start --control "$control" --out "$dir/two.h5" > "$dir/raw.log" 2>&1 && return 1
    grep -q 'is being recorded' "$dir/raw.log" || return 1
    "$pyrovox" record --raw stop --control "$control" | grep -q "recorded $dir/one.h5" || return 1
    "$pyrovox" replay --info "$dir/one.h5" | grep -q 'closed in order' || return 1
    "$pyrovox" record --raw start --control "$control" --out "$dir/one.h5" > "$dir/raw.log" 2>&1 && return 1
    grep -q 'is there already' "$dir/raw.log" || return 1
    "$pyrovox" record --raw start --control "$control" --out "$dir/two.h5" || return 1
    wait_for recorded 10 || return 1
    "$pyrovox" status --endpoint "$control" | grep -q "raw *recording: $dir/two.h5" || return 1
    kill -9 "$d"; wait "$d" 2> /dev/null
    kill "$r"; wait "$r"
    "$pyrovox" replay --info "$dir/two.h5" > "$dir/killed.log" || return 1
    grep -q 'cut off' "$dir/killed.log" && [ "$(sed -n 's/^sets *\([0-9]*\),.*/\1/p' "$dir/killed.log")" -ge 10 ] &&
        grep -Eq '; [01] more are not complete' "$dir/killed.log"
}
check start_stop_and_kill at_run_time
take=$dir/two.h5
check killed_take_is_played replayed killed --lossless

packed() { # formats that no image file has: exported they give the volumes that the take gives
    local fmt=$1 as=$2 t=$dir/$1.h5
    printf '%s\n' "pixel_format: $fmt" "record: { mode: raw, path: \"$t\" }" | live_config
    start "$fmt.log" "$pyrovoxd" -c "$dir/live.yaml"; local d=$started
    start "$fmt-vol.log" "$pyrovox" record --endpoint "$volumes" --out "$dir/$fmt" --quiet
    wait_for recorded 5 && wait_for published 5 || return 1
    kill -INT "$d"; ended "$d" 0 || return 1
    "$pyrovox" replay --export "$dir/$fmt-frames" "$t" > "$dir/$fmt-export.log" || return 1
    [ -z "$as" ] || grep -q -- "--pixel-format $as" "$dir/$fmt-export.log" || return 1
    "$pyrovox" reconstruct --rig "$dir/frames/rig.yaml" --frames "$t" --black 0.02 --out "$dir/$fmt-a" --first 1 --last 3 > "$dir/$fmt-a.log" 2>&1 || return 1
    "$pyrovox" reconstruct --rig "$dir/frames/rig.yaml" --frames "$dir/$fmt-frames" ${as:+--pixel-format $as} --black 0.02 --out "$dir/$fmt-b" --first 1 --last 3 > "$dir/$fmt-b.log" 2>&1 || return 1
    local v n=0
    for v in "$dir/$fmt-a"/*.npy; do n=$((n + 1)); cmp "$v" "$dir/$fmt-b/${v##*/}" || return 1; done
    [ "$n" -gt 0 ]
}
check export_12_bits_packed packed BayerRG12p BayerRG12
check export_10_bits packed Mono10 Mono10
check export_blue_green_red packed BGR8 ""

limited() { # a take that has reached its limit ends, the daemon does not
    echo "record: { mode: raw, path: \"$dir/small-%H.h5\", limit_gb: 0.001 }" | live_config
    start small.log "$pyrovoxd" -c "$dir/live.yaml"; local d=$started
    start small-vol.log "$pyrovox" record --endpoint "$volumes" --out "$dir/small" --quiet
    wait_for field "s['record']['state'] == 'ended'" && wait_for published 40 || return 1
    field "'limit' in s['record']['error'] and s['record']['bytes'] <= 1e6" || return 1
    kill -INT "$d"; ended "$d" 0 && "$pyrovox" replay --info "$dir"/small-*.h5 | grep -q 'closed in order'
}
check limit_ends_the_take_only limited
exit $rc
