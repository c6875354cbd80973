#!/bin/bash
# pyrovox matrix: builds, caches, verifies; says what is wrong with a rig or a file; Ctrl-C leaves nothing.
name=015
. "$(dirname "$0")/lib.sh"
rig=$dir/rig.yaml
cat > "$rig" <<'YAML'
version: 1
volume: { min: [-0.5,-0.5,0], max: [0.5,0.5,1], voxels: [16,16,16], basis: box }
cameras:
  - { name: left, size: [80,60], K: [60,60,39.5,29.5], distortion: [-0.05,0.01,0,0], R: [0,1,0, 0,0,-1, -1,0,0], t: [0,0.5,2] }
  - { name: right, size: [80,60], K: [60,60,39.5,29.5], R: [-1,0,0, 0,0,-1, 0,-1,0], t: [0,0.5,2] }
YAML

builds() {
    run "$pyrovox" matrix --rig "$rig" --threads 2
    says 0 'left' 'right' '16 x 16 x 16 = 4096, box' 'bytes per entry' 'levels' 'built in' 'saved in' '100 %' &&
        [ "$(ls "$dir"/cache | grep -c '^sysmat-[0-9a-f]*\.pvxm$')" = 1 ]
}
cached() {
    run "$pyrovox" matrix --rig "$rig"
    says 0 'cached, opened in' && ! grep -q 'built in' <<< "$out"
}
basis_not_said() {
    sed 's/, basis: box//' "$rig" > "$dir/silent.yaml"
    run "$pyrovox" matrix --rig "$dir/silent.yaml" --out "$dir/silent.pvxm"
    says 0 '16 x 16 x 16 = 4096, trilinear' || return 1
    run "$pyrovox" matrix --rig "$dir/silent.yaml" --basis box --out "$dir/box.pvxm"
    says 0 '16 x 16 x 16 = 4096, box'
}
# Cameras with 30 pixels to the metre: 36^3 unknowns for 3/2 2 30^2 values; in bins of 2x2 15 / 0.7 voxels.
grid_auto() {
    run "$pyrovox" matrix --rig "$rig" --grid auto --out "$dir/auto.pvxm"
    says 0 '36 x 36 x 36 = 46656' 'binning 1,' || return 1
    run "$pyrovox" matrix --rig "$rig" --grid auto --binning 2 --out "$dir/auto2.pvxm"
    says 0 '21 x 21 x 21' || return 1
    run "$pyrovox" matrix --rig "$rig" --grid auto --cameras left --out "$dir/auto1.pvxm"
    says 0 '30 x 30 x 30' || return 1
    sed 's/max: \[0.5,0.5,1\]/max: [9.5,9.5,1]/' "$rig" > "$dir/behind.yaml"
    run "$pyrovox" matrix --rig "$dir/behind.yaml" --grid auto
    says 1 'left, right: it stands inside the volume' '--grid auto: no camera has the middle of the volume in front of it'
}
another_grid_another_file() {
    run "$pyrovox" matrix --rig "$rig" --grid 8,9,10 --basis trilinear --cameras right --binning 4 --rays 3
    says 0 '8 x 9 x 10 = 720, trilinear' 'binning 4, 3 x 3 rays' || return 1
    ! grep -q left <<< "$out" && [ "$(ls "$dir"/cache | wc -l)" = 2 ]
}
check_sound() {
    run "$pyrovox" matrix --rig "$rig" --out "$dir/m.pvxm"; says 0 'built' || return 1
    run "$pyrovox" matrix --check "$dir/m.pvxm"; says 0 'm.pvxm: sound' '16 x 16 x 16'
}
check_damaged() {
    head -c 20000 "$dir/m.pvxm" > "$dir/short.pvxm"
    run "$pyrovox" matrix --check "$dir/short.pvxm"; says 1 'short.pvxm: damaged' 'delete it' || return 1
    cp "$dir/m.pvxm" "$dir/flip.pvxm"
    printf '\xff' | dd of="$dir/flip.pvxm" bs=1 seek=30000 conv=notrunc status=none
    run "$pyrovox" matrix --check "$dir/flip.pvxm"; says 1 'flip.pvxm: damaged (level 0' || return 1
    run "$pyrovox" matrix --check "$rig"; says 1 'rig.yaml: not a Pyrovox matrix' || return 1
    run "$pyrovox" matrix --check "$dir/absent"; says 1 'absent: cannot open'
}
damaged_cache_is_rebuilt() {
    local f
    for f in "$dir"/cache/*; do printf 'x' | dd of="$f" bs=1 seek=5000 conv=notrunc status=none; done
    run "$pyrovox" matrix --rig "$rig"; says 0 'building the system matrix anew' 'damaged' 'built' || return 1
    run "$pyrovox" matrix --rig "$rig"; says 0 'cached, opened in'
}
bad_rig() {
    sed 's/R: \[0,1,0/R: [0,2,0/' "$rig" > "$dir/bad.yaml"
    run "$pyrovox" matrix --rig "$dir/bad.yaml"
    says 1 'bad.yaml:4: cameras[0].R: is not a rotation' || return 1
    sed 's/basis: box/base: box/' "$rig" > "$dir/bad.yaml"
    run "$pyrovox" matrix --rig "$dir/bad.yaml"; says 1 'bad.yaml:2: base: unknown key' || return 1
    run "$pyrovox" matrix --rig "$dir/nowhere.yaml"; says 1 'nowhere.yaml' 'No such file'
}
bad_arguments() {
    run "$pyrovox" matrix; says 1 '--rig FILE' || return 1
    run "$pyrovox" matrix --rig "$rig" --grid 16x16; says 2 '--grid 16x16' || return 1
    run "$pyrovox" matrix --rig "$rig" --grid automatic; says 2 'should be auto, N or NX,NY,NZ' || return 1
    run "$pyrovox" matrix --rig "$rig" --grid 16,auto,16; says 2 'should be auto, N or NX,NY,NZ' || return 1
    run "$pyrovox" matrix --rig "$rig" --basis cubic; says 2 'box, trilinear' || return 1
    run "$pyrovox" matrix --rig "$rig" --binning 7; says 1 'binning 7 does not divide the 80 x 60 image of camera left' || return 1
    run "$pyrovox" matrix --rig "$rig" --cameras left,middle; says 1 "no camera 'middle' in the rig; it has: left right" || return 1
    run "$pyrovox" matrix --rig "$rig" --out "$rig"; says 1 'left alone' || return 1
    run "$pyrovox" matrix --rig "$rig" --out "$dir/no/such/m"; says 1 'does not exist or is not writable' || return 1
    run "$pyrovox" matrix --help; says 0 'Examples:' '--binning'
}
catches_term() { # bit 14; of the program: the shell that becomes it catches it, too
    [ "/proc/$1/exe" -ef "$pyrovox" ] || return 1
    local caught; caught=$(sed -n 's/^SigCgt:\s*//p' "/proc/$1/status" 2>/dev/null)
    [ $((0x${caught:-0} & 0x4000)) -ne 0 ]
}
# Large enough to be in the middle of it when the signal comes: 88 million rays.
interrupted() {
    sed 's/size: \[80,60\]/size: [7680,5760]/; s/K: \[60,60,39.5,29.5\]/K: [5760,5760,3840,2880]/' "$rig" > "$dir/big.yaml"
    "$pyrovox" matrix --rig "$dir/big.yaml" --grid 64 --binning 1 --out "$dir/big.pvxm" > "$dir/int.log" 2>&1 &
    local pid=$!
    wait_for catches_term $pid
    kill -TERM $pid
    wait $pid; code=$?
    out=$(cat "$dir/int.log")
    says 130 'stopped; nothing was written' && ! ls "$dir"/big.pvxm* > /dev/null 2>&1
}
for t in builds cached basis_not_said grid_auto another_grid_another_file check_sound check_damaged damaged_cache_is_rebuilt bad_rig bad_arguments interrupted; do
    check $t $t
done
exit $rc
