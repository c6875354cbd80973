#!/bin/bash
# highspeed: Recordings of high-speed cameras, from their files to volumes: the same to the bit as of the same pictures in .npy.
name=106
. "$(dirname "$0")/lib.sh"
convert="$py $PWD/tests/lib/highspeed.py"
cd "$dir" || exit 1
solve() { # frames, out, more...
    run "$pyrovox" reconstruct --rig rig.yaml --frames "$1" --out "$2" --black 0.02 --quiet "${@:3}"
}
same() { # folder, volumes, of the volumes in npy from...
    local k
    for ((k = 0; k < $2; k++)); do cmp "$(printf npy/%06d.npy $((k + ${3:-0})))" "$(printf '%s/%06d.npy' "$1" $k)" || return 1; done
}
recording() {
    run "$pyrovox" simcams --cameras 4 --size 80x60 --ring 4 --voxels 24 --write-rig rig.yaml --write-frames take
    says 0 '4 frame sets in take' || return 1
    $convert take npy as_npy && $convert take cine12 cine12 && $convert take cine16 cine16 && $convert take mraw12 mraw12
    solve as_npy npy --pixel-format Mono12; says 0
}
equal_to_the_bit() {
    local kind
    for kind in cine12 cine16 mraw12; do
        solve $kind v_$kind; says 0 || return 1
        same v_$kind 4 || return 1
    done
}
# Two makes, named one by one: their triggers are one.
two_makes() {
    solve cam0=cine12/cam0.cine,cam1=mraw12/cam1.mraw,cam2=mraw12/cam2.cih,cam3=cine16/cam3.cine v_mixed; says 0 || return 1
    same v_mixed 4
}
# A camera that began later: frames of one instant, not of one place in the file.
one_began_later() {
    cp -r cine12 late && $convert take cine12 late 1 9 cam2
    solve late v_late; says 0 'cam2 has no frame in 1 of 4 sets' || return 1
    cmp npy/000002.npy v_late/000002.npy && cmp npy/000003.npy v_late/000003.npy
}
cut() {
    cp -r cine12 cut
    truncate -s -100 cut/cam1.cine
    solve cut v_cut; says 0 '1 of its 4 images are not whole' 'cam1 has no frame in 1 of 4 sets'
}
refused() {
    solve cam0=cine12/cam0.cine,cam9=cine12/cam1.cine v_bad; says 1 'there is no camera cam9 in the rig' || return 1
    solve cam0=cine12/cam0.cine,cam0=cine12/cam1.cine v_bad; says 1 'camera cam0 has cine12/cam0.cine and cine12/cam1.cine' || return 1
    solve cam0=cine12/cam7.cine v_bad; says 1 'cine12/cam7.cine' || return 1
    solve cine12/cam0.cine v_bad; says 1 'is one film' 'CAMERA=FILE' || return 1
    rm mraw12/cam3.cih
    solve mraw12 v_bad; says 1 'without the .cih or .cihx' || return 1
    [ ! -e v_bad/000000.npy ]
}
plan() {
    run "$pyrovox" reconstruct --rig rig.yaml --frames cine12 --black 0.02 --plan --quiet
    says 0 '4 frame sets of 4 cameras' 'memory: ' 'disk: '
}
check recording recording
check equal_to_the_bit equal_to_the_bit
check two_makes two_makes
check one_began_later one_began_later
check cut cut
check refused refused
check plan plan
exit $rc
