#!/bin/bash
# offline: From nothing to a film, offline, as a new user does it: a simulated recording, the box of its flame,
# volumes, pictures; Ctrl-C in the middle of both; the CPU's kernels.
name=070
. "$(dirname "$0")/lib.sh"
cd "$dir" || exit 1
recording() {
    run "$pyrovox" simcams --cameras 6 --size 160x120 --ring 6 --voxels 32 --write-rig rig.yaml --write-frames take
    sed -i 's/basis: trilinear/basis: box/' rig.yaml # half the time
    says 0 '6 frame sets in take' '--black 0.02' && [ "$(find take -name '00000?.png' | wc -l)" = 36 ] || return 1
    run "$pyrovox" simcams --cameras 2 --size 16x12 --ring 2 --format bayerrg8 --write-frames raw
    says 1 'take mono8 or rgb8'
}
forgotten_black_level() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --out dark --last 0
    says 1 'of the pictures counts as flame' 'next: --black 0.0' && [ -z "$(ls dark)" ]
}
# What is odd about all volumes is said, and how it is mended.
odd_volumes() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out dark --last 1 --threshold 0.99 --quiet
    says 0 'no volume of 2 has any light' '--threshold, --black' || return 1
    sed -E 's/K: \[([^,]*), ([^,]*), ([^,]*), ([^]]*)\]/K: [\1, \3, \2, \4]/' rig.yaml > order.yaml
    run "$pyrovox" reconstruct --rig order.yaml --frames take --black 0.02 --out order --last 0 --quiet
    says 1 'if K is in the order fx, cx, fy, cy (give fx, fy, cx, cy)' 'cam0 has K: [' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out near --last 0
    says 0 && ! grep -q 'any light' <<< "$out" || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --out near --last 1 # volumes of two runs are not mixed
    says 1 'near: holds volumes already' && [ ! -e near/000001.npy ]
}
fits() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --fit-volume --save-rig tight.yaml
    says 0 'volume fitted: x ' 'from 6 of 6 frame sets' && [ ! -e vol ] || return 1
    run "$pyrovox" reconstruct --rig tight.yaml --frames take --black 0.02 --out vol --save-report report.json
    says 0 '6 volumes in vol' && [ "$(find vol -name '*.npy' | wc -l)" = 6 ] || return 1
    PYTHONPATH=$OLDPWD/proto/clients/python "$py" -c 'import pyrovox; r = pyrovox.open("vol"); assert len(r) == 6 and r[3].dense.any() and r[3].report.solver' || return 1
    run "$pyrovox" matrix --rig tight.yaml
    says 0 'cached, opened in'
}
# The frames that were not looked at reach further: said, not hidden.
grows_out_of_the_box() {
    mkdir -p grow
    for c in 0 1 2 3 4 5; do
        mkdir -p grow/cam$c
        cp take/cam$c/000000.png grow/cam$c/000000.png
    done
    run "$pyrovox" reconstruct --rig rig.yaml --frames grow --black 0.02 --fit-volume=0 --save-rig one.yaml --quiet; says 0 || return 1
    cp -r take grow2
    for c in 0 1 2 3 4 5; do
        for f in 0 1 2 3 4 5; do cp grow/cam$c/000000.png grow2/cam$c/00000$f.png; done
        cp take/cam$c/000003.png grow2/cam$c/000001.png
        cp take/cam$c/000004.png grow2/cam$c/000002.png
    done
    run "$pyrovox" reconstruct --rig rig.yaml --frames grow2 --black 0.02 --fit-volume=0 --fit-frames 2 --out out --quiet
    says 0 'reaches a side of the fitted box' '--fit-frames all'
}
# Means of phases are the volumes of mean pictures, which numpy makes here.
means() {
    "$py" -c 'import numpy' || { echo "SKIP $name:means (apt-get install python3-numpy)"; return 0; }
    "$py" - << 'END' || return 1
import numpy as np, os, random
from PIL import Image
random.seed(35)
os.makedirs("cycles")
for c in range(6):
    os.makedirs(f"cycles/cam{c}"); os.makedirs(f"want/cam{c}")
order = [i % 3 for i in range(9)]           # three cycles of three phases
random.shuffle(order)
total = {}
for i, k in enumerate(order):
    for c in range(6):
        px = np.asarray(Image.open(f"take/cam{c}/{k:06d}.png")).astype(float)
        px = np.clip(px + np.random.default_rng(100 * i + c).normal(0, 3, px.shape), 0, 254).round()
        if (i, c) != (4, 2):                # one picture is missing
            Image.fromarray(px.astype(np.uint8)).save(f"cycles/cam{c}/{100 + i:06d}.png")
            total.setdefault((k, c), []).append(px / 255)
for (k, c), px in total.items():
    np.save(f"want/cam{c}/{k:06d}.npy", np.mean(px, 0).astype(np.float32))
with open("phase.csv", "w") as f:
    f.write("frame,degrees\n" + "".join(f"{100 + i},{120 * k + 60}\n" for i, k in enumerate(order)))
END
    run "$pyrovox" reconstruct --rig rig.yaml --frames cycles --black 0.02 --phase phase.csv --phases 3 --out phases --selfcal off
    says 0 '3 means of 3 sets each' '3 volumes in phases' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames want --black 0.02 --out wanted --quiet --selfcal off; says 0 || return 1
    "$py" -c '
import numpy as np
for k in range(3):
    a, b = (np.load(f"{d}/{k:06d}.npy") for d in ("phases", "wanted"))
    e = np.linalg.norm(a - b) / np.linalg.norm(b)
    assert b.max() > 0 and e < 0.02, (k, e)' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames cycles --black 0.02 --average all --out all; says 0 '1 mean of 9 sets' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames cycles --black 0.02 --average 4.5 --array 1/2 --out means.h5; says 0 '4 means of 2 to 3 sets each' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames cycles --black 0.02 --average 4.5 --array 2/2 --out means.h5; says 0 || return 1
    run "$py" -c 'import h5py; f = h5py.File("means.h5"); print(f["emission"].shape)'; says 0 '(4, ' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames cycles --black 0.02 --average 12ms --out no; says 1 'times of these pictures are not known' || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames cycles --black 0.02 --average 0.5 --out no; says 1 "'0.5' should be all" || return 1
    sed -i '5s/.*/104,turn/' phase.csv
    run "$pyrovox" reconstruct --rig rig.yaml --frames cycles --black 0.02 --phase phase.csv --out no; says 1 "phase.csv:5: '104,turn' should be" && [ ! -e no ]
}
film() {
    run "$pyrovox" render --rig rig.yaml --camera cam1 vol film
    says 0 '6 pictures in film' 'as a product' && [ "$(find film -name '*.png' | wc -l)" = 6 ] || return 1
    run "$pyrovox" render --orbit 5 vol turn.gif
    says 1 'turn.gif: a picture is a .png, a film an .apng' && [ ! -e turn.gif ] || return 1
    run "$pyrovox" render --orbit 5 --rounds 1 --size 48x64 vol turn
    says 0 '5 pictures in turn' && [ "$(find turn -name '*.png' | wc -l)" = 5 ]
}
one_file() { # an animated PNG: whole after Ctrl-C too, with the pictures until then
    run "$pyrovox" render --orbit 2 --rounds 1 --size 48x36 --sub 1 --fps 10 vol turned.apng
    says 0 '2 pictures in turned.apng' || return 1
    : > int.log # or what another case left in it is read before the child has emptied it
    "$pyrovox" render --orbit 5000 --size 48x64 vol cut.apng > int.log 2>&1 &
    local pid=$!
    wait_for grep -q 'render: ' int.log
    kill -INT $pid; wait $pid; code=$?
    out=$(cat int.log)
    says 130 'in cut.apng' 'stopped' && [ -z "$(find . -name '*.tmp*')" ] || return 1
    "$py" - turned.apng cut.apng <<'PY' || return 1
import struct, sys
for name in sys.argv[1:]:
    b, at, frames, told, plays = open(name, "rb").read(), 8, 0, 0, 1
    while at < len(b):
        n, what = struct.unpack(">I4s", b[at:at + 8])
        frames += what == b"fcTL"
        told, plays = struct.unpack(">II", b[at + 8:at + 16]) if what == b"acTL" else (told, plays)
        at += 12 + n
    assert at == len(b) and what == b"IEND" and frames == told < 5000 and plays == 0, (name, frames, told, plays)
    assert name == "cut.apng" or frames == 2, frames
PY
    run "$pyrovox" render --orbit 4 --format npy vol x.apng; says 2 'need a folder' || return 1
    run "$pyrovox" render --strip 0,90,3 vol/000000.npy x.apng; says 1 '--strip is one picture'
}
videos() { # and tone, depth; a turntable that goes round again keeps its rays
    run "$pyrovox" render --orbit 4 --rounds 3 --size 48x64 --format both vol again
    says 0 '12 pictures in again' 'as a product' || return 1
    run "$pyrovox" render --orbit 4 --rounds 3 --anew --size 48x64 --format npy vol anew; says 0 'traced anew' || return 1
    run "$pyrovox" render --orbit 4 --size 48x64 vol turn4; says 0 '8 pictures in turn4' || return 1 # all six were shown
    run "$pyrovox" render --eye 2,-1,0.8 --size 64x48 --exposure 1 --gamma 1 --depth 16 vol/000000.npy deep.png; says 0 || return 1
    run "$pyrovox" render --eye 2,-1,0.8 --size 64x48 vol/000000.npy deep.npy; says 0 || return 1
    run "$pyrovox" render --orbit 4 --size 49x65 --tone filmic --fps 10 vol turn.mp4; says 0 '8 pictures in turn.mp4' || return 1
    run "$pyrovox" render --orbit 4 --tone negative vol x.mp4; says 2 'clip, reinhard, filmic' || return 1
    run "$pyrovox" render --orbit 4 --depth 16 vol x.mp4; says 2 'a film has 8 bits' || return 1
    run env PATH=/nowhere "$pyrovox" render --orbit 4 vol x.mp4; says 1 'apt install ffmpeg' || return 1
    : > int.log
    "$pyrovox" render --orbit 5000 --size 48x64 vol cut.mp4 > int.log 2>&1 &
    local pid=$!
    wait_for grep -q 'render: ' int.log
    kill -INT $pid; wait $pid; code=$?
    out=$(cat int.log)
    says 130 'in cut.mp4' 'stopped' && [ -z "$(find . -name '*.tmp*')" ] || return 1
    # a reader of another make counts the pictures
    frames() { ffprobe -v error -count_frames -show_entries stream=nb_read_frames -of csv=p=0 "$1"; }
    [ "$(frames turn.mp4)" = 8 ] && [ "$(frames cut.mp4)" = "$(sed -n 's/^\([0-9]*\) pictures in cut.mp4.*/\1/p' int.log)" ] || return 1
    "$py" - <<'PY'
import glob, numpy as np
kept, anew = (sorted(glob.glob(f"{d}/*.npy")) for d in ("again", "anew"))
assert len(kept) == len(anew) == 12 == len(glob.glob("again/*.png"))
for a, b in zip(kept, anew):
    a, b = np.load(a), np.load(b)
    assert b.max() > 0.1 and abs(a - b).max() <= 1e-5 * b.max(), abs(a - b).max()
import struct
png = open("deep.png", "rb").read()
assert png[24] == 16 and struct.unpack(">II", png[16:24]) == (64, 48)
PY
}
stops() { # what was written before is whole
    "$pyrovox" render --orbit 20000 --size 48x64 --format npy vol long > int.log 2>&1 &
    local pid=$!
    wait_for test -e long/000002.npy
    kill -INT $pid; wait $pid; code=$?
    out=$(cat int.log)
    says 130 'pictures in long' 'stopped' && [ -z "$(find long -name '*.tmp*')" ] || return 1
    local sizes; sizes=$(stat -c %s long/*.npy | sort -u | wc -l)
    [ "$sizes" = 1 ]
}
reconstruct_stops() { # what was solved is whole, and in the report
    run "$pyrovox" simcams --cameras 3 --size 64x48 --ring 400 --voxels 24 --write-rig small.yaml --write-frames many
    "$pyrovox" reconstruct --rig small.yaml --frames many --black 0.02 --out cut --save-report cut.json --quiet \
        --solver mlem --iterations 1000 > int.log 2>&1 &
    local pid=$! n
    wait_for test -e cut/000002.npy
    kill -INT $pid; wait $pid; code=$?
    out=$(cat int.log)
    says 130 'stopped' && [ -z "$(find cut -name '*.tmp*')" ] || return 1
    n=$(find cut -name '*.npy' | wc -l)
    [ "$n" -ge 3 ] && [ "$n" -lt 400 ] && [ "$(grep -c '"frame":' cut.json)" = "$n" ] &&
        [ "$(stat -c %s cut/*.npy | sort -u | wc -l)" = 1 ]
}
light_in_check() { # what the rig says of a camera's pedestal and hot pixels counts where a flame is held against it
    local wrong=(--set "pedestal cam2 0.2" --set "hot cam4 0.01" --size 160x120 --ring "$([ -n "${T_LONG:-}" ] && echo 8 || echo 4)") out code
    run "$pyrovox" simcams "${wrong[@]}" --write-rig bare.yaml --write-frames flame; says 0 || return 1
    run "$pyrovox" simcams "${wrong[@]}" --set "empty all on" --write-rig bare2.yaml --write-frames dark; says 0 || return 1
    run "$pyrovox" calibrate check --rig bare.yaml --frames flame --black 0.02 --quiet; says 1 'cam2 flooded' '2 of 8 cameras are wrong' || return 1
    run "$pyrovox" calibrate dark --rig bare.yaml --frames dark --out lit.yaml; says 0 || return 1
    run "$pyrovox" calibrate check --rig lit.yaml --frames flame --quiet; says 0 'the flame agrees with the rig in all 8 cameras' || return 1
    [ -n "${T_LONG:-}" ] || return 0
    # refined, it says of light what it said
    sed '/name: cam3/,/name: cam4/ s/t: \[-*0, /t: [0.03, /' lit.yaml > off.yaml
    cmp -s lit.yaml off.yaml && { echo "no camera was moved"; return 1; }
    run "$pyrovox" calibrate refine --rig off.yaml --frames flame --out refined.yaml --quiet; says 0 'unseen views of held-out frames' || return 1
    [ "$(grep -A 2 photometry: lit.yaml)" = "$(grep -A 2 photometry: refined.yaml)" ]
}
one_grey_in_check() {
    run "$pyrovox" simcams --cameras 5 --size 160x120 --ring 4 --write-rig g.yaml --write-frames colour; says 0 || return 1
    run "$pyrovox" simcams --cameras 5 --size 160x120 --ring 4 --format mono8 --write-frames grey; says 0 || return 1
    run "$pyrovox" calibrate check --rig g.yaml --frames grey --black 0.02 --quiet; says 0 'the flame agrees with the rig' || return 1
    [[ $out != *"it is grey"* ]] || return 1
    rm -r colour/cam3 && mv grey/cam3 colour/ || return 1
    run "$pyrovox" calibrate check --rig g.yaml --frames colour --black 0.02 --quiet
    says 0 'the flame agrees with the rig in all 5 cameras; of cam3 only the brightness was compared, it is grey'
}
cpu() {
    run "$pyrovox" cpu; says 0 'kernels' 'ref' || return 1
    run "$pyrovox" --cpu ref cpu; says 0 'kernels   ref' || return 1
    run "$pyrovox" --cpu abacus cpu; says 2 'no such kernels' || return 1
    run "$pyrovox" --cpu ref reconstruct --rig tight.yaml --frames take --black 0.02 --out vol2 --last 0 --quiet; says 0
}
for t in recording forgotten_black_level odd_volumes fits grows_out_of_the_box means film videos one_file stops reconstruct_stops light_in_check one_grey_in_check cpu; do check $t $t; done
exit $rc
