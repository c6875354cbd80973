#!/bin/bash
# offline: What a scene needs beyond the paper's model: a flame that absorbs its own light, offline and live.
name=095
. "$(dirname "$0")/lib.sh"
cd "$dir" || exit 1
deep=4 # c, 1 over pixel value
# A slab of flame, deep from two sides: its volume, and what every camera sees of it, thin and absorbing.
recording() {
    run "$pyrovox" simcams --cameras 8 --size 160x120 --ring 3 --voxels 32 --write-rig rig.yaml --write-frames take
    sed -i 's/basis: trilinear/basis: box/' rig.yaml # half the time
    says 0 '3 frame sets in take' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out vol --quiet; says 0 || return 1
    "$py" - <<'P' || return 1
import glob, numpy as np
for f in glob.glob("vol/*.npy"):
    v = np.load(f)
    x = (np.arange(v.shape[2]) + 0.5) / v.shape[2] - 0.5
    np.save(f, (1.5 * v * np.exp(-(x / 0.08) ** 2)[None, None, :, None]).astype(np.float32))
P
    for c in 0 1 2 3 4 5 6 7; do
        run "$pyrovox" render --rig rig.yaml --camera cam$c --format npy vol thin/cam$c; says 0 || return 1
    done
    "$py" - "$deep" <<'P'
import glob, os, sys, numpy as np
c, r = float(sys.argv[1]), np.random.default_rng(1)
for f in sorted(glob.glob("thin/*/*.npy")):
    e = np.load(f)
    m = e.mean(axis=2, keepdims=True)
    t = np.where(c * m > 1e-6, -np.expm1(-c * m) / np.maximum(c * m, 1e-9), 1)
    to = f.replace("thin", "deep")
    os.makedirs(os.path.dirname(to), exist_ok=True)
    noise = 0.003 * r.standard_normal(e.shape)
    np.save(to, (e * t + noise).astype(np.float32))
    np.save(f, (e + noise).astype(np.float32))
P
}
# A camera of gain 0.85 is corrected in the solve, and said; without the correction it costs more.
corrected() {
    cp -r thin dim || return 1
    "$py" - <<'P' || return 1
import glob, numpy as np
for f in glob.glob("dim/cam3/*.npy"):
    np.save(f, (0.85 * np.load(f)).astype(np.float32))
P
    run "$pyrovox" reconstruct --rig rig.yaml --frames thin --out exact --save-report e.json --quiet; says 0 || return 1
    [[ $out != *"corrected while solving"* ]] || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames dim --out kept --selfcal off --quiet; says 0 || return 1
    [[ $out != *"corrected while solving"* ]] || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames dim --out mended --save-report m.json --quiet
    says 0 'cameras were corrected while solving: gains by up to 1.1' '(cam3)' || return 1
    echo "errors: exact $(error exact), as given $(error kept), corrected $(error mended)"
    below "$(error mended)" "$(error kept)" || return 1
    "$py" - <<'P' || return 1
import json
for name, on in (("e.json", False), ("m.json", True)):
    for f in json.load(open(name))["frames"]:
        c = f["selfcal"]
        assert c["gain"] == on, (name, c)
        assert len(c["cameras"]) == 8
        g = [k["gain"] for k in c["cameras"]]
        assert not on or abs(g[3] / (sum(g[:3] + g[4:]) / 7) * 0.85 - 1) < 0.03, g
P
    run "$pyrovox" reconstruct --rig rig.yaml --frames dim --out x --selfcal both; says 2 'selfcal'
}
# Six sets are enough for a mean that corrects all of them, whichever process solves them; a right rig keeps every byte.
together() {
    "$py" - <<'P' || return 1
import glob, os, numpy as np
r = np.random.default_rng(2)
for frames in "thin", "dim":
    for f in sorted(glob.glob(frames + "/*/*.npy")):
        e = np.load(f)
        for k in 0, 3:
            to = os.path.join("many", f[:-10], "%06d.npy" % (int(f[-10:-4]) + k))
            os.makedirs(os.path.dirname(to), exist_ok=True)
            np.save(to, (e + 0.003 * r.standard_normal(e.shape)).astype(np.float32))
P
    local i
    run "$pyrovox" reconstruct --rig rig.yaml --frames many/dim --out m.h5 --save-report m.json
    says 0 'cameras: corrected by gain, the mean of 5 sets' ' gain 1.1' || return 1
    for i in 1 2; do
        run "$pyrovox" reconstruct --rig rig.yaml --frames many/dim --out p.h5 --array $i/2 --threads $i --quiet; says 0 || return 1
    done
    run "$pyrovox" reconstruct --rig rig.yaml --frames many/thin --out e --save-report e.json
    says 0 'cameras: 5 sets agree with the rig, nothing is corrected' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames many/thin --out e0 --selfcal off --quiet; says 0 || return 1
    for i in 0 1 2 3 4 5; do cmp e/00000$i.npy e0/00000$i.npy || return 1; done
    "$py" - <<'P'
import json, h5py
for name, on in (("e.json", False), ("m.json", True)):
    r = json.load(open(name))
    assert (r["selfcal"]["sets"], r["selfcal"]["gain"], r["selfcal"]["shift"]) == (5, on, False), r["selfcal"]
    assert all(f["selfcal"] == r["selfcal"] for f in r["frames"])
with h5py.File("m.h5") as m, h5py.File("p.h5") as p:
    assert m["emission"].shape[0] == 6 and (m["emission"][:] == p["emission"][:]).all()
P
}
# The daemon learns from set to set that cam3 is dim.  Then somebody opens the iris of cam5: said once, and learnt anew.
learns() {
    "$py" - <<'P' || return 1
import os
for c in range(8):
    os.makedirs(f"long/cam{c}")
    for k in range(224):
        os.symlink(f"{os.getcwd()}/many/dim/cam{c}/{k % 6:06d}.npy", f"long/cam{c}/{k:06d}.npy")
import numpy as np
for k in range(6):
    np.save(f"open{k}.npy", (1.3 * np.load(f"many/dim/cam5/{k:06d}.npy")).astype(np.float32))
for k in range(128, 224):
    os.unlink(f"long/cam5/{k:06d}.npy")
    os.symlink(f"{os.getcwd()}/open{k % 6}.npy", f"long/cam5/{k:06d}.npy")
P
    cat > l.yaml <<Y
rig: $dir/rig.yaml
cameras: "files:$dir/long/{name}/%06d.npy"
lossless: true
publish: { endpoints: ["$volumes"], sample: f32, wait_subscriber: true }
control: { endpoint: "$control" }
Y
    start learns.log "$pyrovoxd" -c l.yaml
    run "$pyrovox" record --endpoint "$volumes" --volumes 224 --out learns.h5; says 0 || return 1
    ended "$started" 0 || return 1
    out=$(cat learns.log) code=0
    says 0 'cameras are corrected, by the mean of 64 sets' 'camera cam5 was touched' || return 1
    [ "$(grep -c 'was touched' learns.log)" = 1 ] && [ "$(grep -c 'cameras are corrected' learns.log)" = 1 ]
}
# What is known of each camera, in the status and for Prometheus.
tells() {
    local port; port=$("$py" -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
    cat > s.yaml <<Y
rig: $dir/rig.yaml
cameras: "sim:"
fps: 10
shared_clock: true
photometry: { black: 0.02 }
publish: { endpoints: ["$volumes"] }
control: { endpoint: "$control" }
metrics: { endpoint: "127.0.0.1:$port" }
Y
    start tells.log "$pyrovoxd" -c s.yaml
    wait_for field "min(c['selfcal']['sets'] for c in s['cameras']) >= 64" || return 1
    status > s.json
    "$py" - "$port" <<'P'
import json, re, sys, urllib.request
text = urllib.request.urlopen(f"http://127.0.0.1:{sys.argv[1]}/metrics", timeout=60).read().decode()
for k in "gain", "aim":
    assert re.search("^pyrovox_cameras_%s_corrected [01]$" % k, text, re.M), k
cameras = [c for c in json.load(open("s.json"))["cameras"] if c["selfcal"]["gain"] is not None]
assert len(cameras) >= 4, cameras
for c in cameras:
    own = c["selfcal"]
    assert 0.8 < own["gain"] < 1.25 and own["gain_error"] > 0, own
    for k in "gain", "gain_error", "right_px", "right_error_px", "down_px", "down_error_px":
        v = re.search(r'^pyrovox_camera_%s\{camera="%s"\} (\S+)$' % (k, c["name"]), text, re.M)
        assert abs(float(v[1]) - own[k]) < 0.2, (k, own, v) # some sets later
P
    local r=$?
    kill -INT "$started"
    ended "$started" 0 && [ $r = 0 ]
}
# Relative L2 error of folder $1's volumes.
error() {
    "$py" - "$1" <<'P'
import glob, sys, numpy as np
n = d = 0
for f in sorted(glob.glob("vol/*.npy")):
    t, v = np.load(f), np.load(f.replace("vol", sys.argv[1]))
    n += ((v - t) ** 2).sum()
    d += (t ** 2).sum()
assert d > 0
print((n / d) ** 0.5)
P
}
below() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a > 0 && a < b) }'; }
absorbs() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames deep --out off --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames deep --out known --absorption $deep --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames deep --out found --absorption auto --save-report r.json
    says 0 'absorption: c ' 'optical depth' || return 1
    local c; c=$(sed -n 's/^absorption: c \([0-9.]*\),.*/\1/p' <<< "$out")
    echo "errors: off $(error off), c known $(error known), found ($c) $(error found)"
    below "$c" "$(awk "BEGIN { print 1.15 * $deep }")" && below "$(awk "BEGIN { print 0.85 * $deep }")" "$c" || return 1
    below "$(error known)" "$(awk "BEGIN { print 0.7 * $(error off) }")" || return 1
    below "$(error found)" "$(awk "BEGIN { print 0.75 * $(error off) }")" || return 1
    grep -q '"absorption":' r.json
}
nothing_absorbs() { # then it is off, and the volumes are the same bytes
    run "$pyrovox" reconstruct --rig rig.yaml --frames thin --out plain --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames thin --out looked --absorption auto
    says 0 'absorption: none' || return 1
    local f
    for f in plain/*.npy; do cmp "$f" "looked/${f#*/}" || return 1; done
}
# The daemon has it from its configuration: what it makes of these pictures is what reconstruct makes.
live() {
    cat > m.yaml <<Y
rig: $dir/rig.yaml
cameras: "files:$dir/deep/{name}/%06d.npy"
lossless: true
model: { absorption: $deep }
publish: { endpoints: ["$volumes"], sample: f32, wait_subscriber: true }
control: { endpoint: "$control" }
Y
    start live.log "$pyrovoxd" -c m.yaml
    run "$pyrovox" record --endpoint "$volumes" --volumes 3 --out live; says 0 || return 1
    ended "$started" 0 || return 1 # the next daemon has the same endpoints
    "$py" - <<'P'
import glob, sys, numpy as np
live, known = sorted(glob.glob("live/*.npy")), sorted(glob.glob("known/*.npy"))
assert len(live) == len(known) == 3, (live, known)
for a, b in zip(live, known):
    a, b = np.load(a), np.load(b)
    assert np.abs(b).max() > 0
    assert np.linalg.norm(a - b) < 1e-3 * np.linalg.norm(b), np.linalg.norm(a - b) / np.linalg.norm(b)
P
}
refuses() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames deep --out x --absorption much; says 2 "absorption" || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames deep --out x --absorption=-1; says 2 "absorption" || return 1
    mkdir -p dark; local c
    for c in 0 1 2 3 4 5 6 7; do
        mkdir -p dark/cam$c
        "$py" -c 'import sys, numpy as np; np.save(sys.argv[1], np.zeros((120, 160, 3), np.float32))' dark/cam$c/000000.npy
    done
    run "$pyrovox" reconstruct --rig rig.yaml --frames dark --out x --absorption auto; says 1 'has a flame in 3 cameras'
}
# The volume before as what is expected, in the daemon and offline: no worse than each set by itself.
temporal() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames thin --out alone --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames thin --out before --temporal --quiet; says 0 || return 1
    below "$(error before)" "$(awk "BEGIN { print 1.02 * $(error alone) }")" || return 1
    cat > t.yaml <<Y
rig: $dir/rig.yaml
cameras: "files:$dir/thin/{name}/%06d.npy"
lossless: true
model: { temporal: on }
publish: { endpoints: ["$volumes"], sample: f32, wait_subscriber: true }
control: { endpoint: "$control" }
Y
    start temporal.log "$pyrovoxd" -c t.yaml
    run "$pyrovox" record --endpoint "$volumes" --volumes 3 --out lt; says 0 || return 1
    ended "$started" 0 || return 1
    "$py" - <<'P' || return 1
import glob, numpy as np
live, off = sorted(glob.glob("lt/*.npy")), sorted(glob.glob("before/*.npy"))
assert len(live) == len(off) == 3, (live, off)
for a, b in zip(live, off):
    a, b = np.load(a), np.load(b)
    assert np.linalg.norm(a - b) < 1e-3 * np.linalg.norm(b), np.linalg.norm(a - b) / np.linalg.norm(b)
P
    run "$pyrovox" reconstruct --rig rig.yaml --frames thin --out x --temporal --solver mlem; says 2 'temporal'
}
# Pictures with noise of 10 %: volumes depend on the one before, and are no worse for it.
noisy() {
    "$py" - <<'P' || return 1
import glob, os, numpy as np
r = np.random.default_rng(3)
for f in glob.glob("thin/*/000000.npy"):
    e = np.load(f)
    for k in range(6):
        to = "noisy/%s/%06d.npy" % (f.split("/")[1], k)
        os.makedirs(os.path.dirname(to), exist_ok=True)
        np.save(to, (e + 0.1 * e.max() * r.standard_normal(e.shape)).astype(np.float32))
P
    run "$pyrovox" reconstruct --rig rig.yaml --frames noisy --out single --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames noisy --out lean --temporal --quiet; says 0 || return 1
    "$py" - <<'P'
import numpy as np
at = lambda d, k: np.load("%s/%06d.npy" % (d, k))
true = np.load("vol/000000.npy")
off = {d: sum(np.linalg.norm(at(d, k) - true) for k in range(1, 6)) for d in ("single", "lean")}
for k in range(6): # nothing is before the first
    assert np.array_equal(at("single", k), at("lean", k)) == (k == 0), k
assert off["lean"] < 1.01 * off["single"], off
P
}
# Nothing in these pictures is saturated: the term changes no bit.
saturated() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out out --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out least --saturated at-least --quiet; says 0 || return 1
    local f
    for f in out/*.npy; do cmp "$f" "least/${f#*/}" || return 1; done
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --out x --saturated maybe; says 2 'left-out'
}
# Something black before two of the lenses, in the middle of what they see: told to be there, they help all the same.
masks() {
    "$py" - <<'P' || return 1
import glob, os, re, struct, zlib, numpy as np
def png(name, a):
    part = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + row.tobytes() for row in a)
    open(name, "wb").write(b"\x89PNG\r\n\x1a\n" + part(b"IHDR", struct.pack(">IIBBBBB", a.shape[1], a.shape[0], 8, 0, 0, 0, 0)) +
                           part(b"IDAT", zlib.compress(rows)) + part(b"IEND", b""))
used = np.full((120, 160), 255, np.uint8)
used[:, 70:84] = 0
png("bar.png", used)
np.save("beam.npy", np.where(np.arange(120)[:, None] // 12 == 5, 0, 255).astype(np.uint8) * np.ones((1, 160), np.uint8))
mask = {"cam2": ("bar.png", used > 0), "cam5": ("beam.npy", np.load("beam.npy") > 0)}
noise = np.random.default_rng(2)
for f in sorted(glob.glob("thin/*/*.npy")):
    to, cam = f.replace("thin", "covered"), f.split("/")[1]
    os.makedirs(os.path.dirname(to), exist_ok=True)
    a = np.load(f)
    if cam in mask:
        a = np.where(mask[cam][1][..., None], a, 0.003 * noise.standard_normal(a.shape)).astype(np.float32)
    np.save(to, a)
rig = open("rig.yaml").read()
for cam, (name, _) in mask.items():
    rig = re.sub(rf"(  - name: {cam}\n)", rf"\1    photometry: {{ mask: {name} }}\n", rig)
assert rig.count("mask") == 2
open("masked.yaml", "w").write(rig)
P
    run "$pyrovox" reconstruct --rig rig.yaml --frames thin --out clean --trust-all --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames covered --out untold --trust-all --quiet; says 0 || return 1
    run "$pyrovox" reconstruct --rig masked.yaml --frames covered --out told --quiet; says 0 || return 1
    local others=cam0,cam1,cam3,cam4,cam6,cam7
    run "$pyrovox" reconstruct --rig rig.yaml --frames thin --cameras $others --out six --trust-all --quiet; says 0 || return 1
    echo "errors: clean $(error clean), covered $(error untold), with masks $(error told), without the two cameras $(error six)"
    below "$(error told)" "$(error six)" || return 1
    below "$(awk "BEGIN { print 2 * $(error clean) }")" "$(error untold)" || return 1
    mkdir -p else && run "$pyrovox" reconstruct --rig masked.yaml --frames covered --fit-volume --save-rig else/rig.yaml
    says 0 && grep -q 'mask: "../bar.png"' else/rig.yaml || return 1
    "$py" -c 'import numpy as np; np.save("small.npy", np.ones((60, 80), np.uint8)); np.save("none.npy", np.zeros((120, 160), np.uint8))'
    local bad
    for bad in small.npy:'80x60 pixels' none.npy:'covers all of it' gone.png:'gone.png'; do
        sed "s/bar.png/${bad%%:*}/" masked.yaml > bad.yaml
        run "$pyrovox" reconstruct --rig bad.yaml --frames covered --out x; says 1 'camera cam2' "${bad#*:}" || return 1
    done
    [ ! -e x ]
}
# What is needed is found in the pictures, and what is not is not.  In bins of 2 x 2, as the time goes with their number.
advises() {
    run "$pyrovox" advise --binning 2 --rig rig.yaml --frames deep --quiet
    says 0 'absorption   on' 'black        fine' 'saturated    left-out' 'model: { absorption: ' || return 1
    local c; c=$(sed -n 's/^model: { absorption: \([0-9.]*\),.*/\1/p' <<< "$out")
    below "$c" "$(awk "BEGIN { print 1.15 * $deep }")" && below "$(awk "BEGIN { print 0.85 * $deep }")" "$c" || return 1
    sed -n '/^rig:/,$p' <<< "$out" > advised.yaml # it is a configuration
    printf 'cameras: "files:%s/deep/{name}/%%06d.npy"\n' "$dir" >> advised.yaml
    run "$pyrovoxd" --check-config -c advised.yaml; says 0 || return 1
    run "$pyrovox" advise --binning 2 --rig rig.yaml --frames thin --quiet
    says 0 'absorption   off' 'absorption: 0,' 'gain         off' 'bodies       none' 'response     linear' 'rate ' 'detail ' || return 1
}
advises_the_volume_before() {
    run "$pyrovox" advise --binning 2 --rig rig.yaml --frames noisy --quiet; says 0 'temporal     on' 'temporal: on }' 'rate         fine'
}
advises_gain_and_light() {
    if [ -n "${T_LONG:-}" ]; then # sim/test_advise has a gain in its last scene
        run "$pyrovox" simcams --cameras 8 --size 160x120 --ring 3 --set "gain cam5 0.8" --write-frames dim; says 0 || return 1
        run "$pyrovox" advise --rig rig.yaml --frames dim --black 0.02 --quiet
        says 0 'gain         on' 'cam5 is furthest off' 'pyrovox calibrate gain' 'absorption   off' || return 1
    fi
    run "$pyrovox" simcams --cameras 8 --size 160x120 --ring 3 --set "gain all 3" --write-frames bright; says 0 || return 1
    run "$pyrovox" advise --binning 2 --rig rig.yaml --frames bright --black 0.02 --quiet; says 0 'exposure     lower' 'pixels are at full scale, the brightest of the others' 'model: { absorption: 0,' 'temporal: off }' 'saturated    at-least' 'saturated: at-least,' || return 1
    run "$pyrovox" advise --binning 2 --rig rig.yaml --cameras cam0,cam1,cam2 --frames thin --quiet; says 1 'it takes four' || return 1
    run "$pyrovox" advise --binning 2 --rig rig.yaml --frames dark --quiet; says 1 'flame'
}
# No term is recommended of a recording that does not belong to its rig.
advises_of_swapped_cameras() {
    cp -r deep swapped && mv swapped/cam1 swapped/x && mv swapped/cam2 swapped/cam1 && mv swapped/x swapped/cam2 || return 1
    run "$pyrovox" advise --binning 4 --rig rig.yaml --frames swapped --quiet
    says 0 'rig          doubtful' 'the pictures of cam1 and cam2 are swapped; next: exchange what rig.yaml says' \
        'model: { absorption: 0,' 'temporal: off }'
}
# sim/test_advise has a body and a black level in its first scene.
advises_bodies_and_black() {
    run "$pyrovox" advise --rig rig.yaml --frames covered --quiet # cam2's bar, columns 70 to 83, and cam5's beam, rows 60 to 71
    says 0 'bodies       found' 'cam2 stays dark in pixels' 'cam5 stays dark in pixels' '# bodies and masks' || return 1
    [ "$(grep -c 'stays dark in' <<< "$out")" = 2 ] || return 1
    awk '/cam2 stays dark/ { split($0, a, "pixels "); split(a[2], b, /\.\.|,/); exit !(b[1] >= 66 && b[2] <= 87) }' <<< "$out" || return 1
    run "$pyrovox" advise --rig masked.yaml --frames covered --quiet; says 0 'bodies       none' || return 1
    run "$pyrovox" advise --rig rig.yaml --frames take --quiet; says 0 'black        subtract' || return 1
    local level; level=$(sed -n 's/^photometry: { black: \([0-9.]*\) }/\1/p' <<< "$out")
    below 0.018 "$level" && below "$level" 0.023 || { echo "level $level"; return 1; }
}
for t in recording corrected together learns tells absorbs nothing_absorbs live masks temporal noisy saturated refuses advises advises_the_volume_before advises_gain_and_light; do check $t $t; done
[ -z "${T_LONG:-}" ] || for t in advises_bodies_and_black advises_of_swapped_cameras; do check $t $t; done
exit $rc
