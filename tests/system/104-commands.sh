#!/bin/bash
# Every command of README, of the guide and of each --help, as pasted (commands.py), in a small world: eight cameras of
# 80x60 that speak the real protocol, a daemon, and the files that the commands name.  T_LONG: those of full size too.
name=104
. "$(dirname "$0")/lib.sh"
needs_private_net
if [ -z "${ORDERS:-}" ]; then # once more, in a network of its own, with a way to tell the cameras something
    export ORDERS=$dir/orders; mkfifo "$ORDERS"
    timeout 3000 "$pyrovox" simcams --size 80x60 --voxels 16 --fps 20 --ring 20 --write-rig "$dir/rig.yaml" \
        --private-net --control -- bash "$0" 0<> "$ORDERS"
    rc=$?; exit $rc
fi
world=$dir/world; mkdir -p "$world" "$dir/run"; cp "${ORDERS%/*}/rig.yaml" "$world"
export RUNTIME_DIRECTORY=$dir/run # where a daemon and its clients meet
order() { printf '%s\n' "$@" > "$ORDERS"; }
take() { # name, sets, orders...: the cameras' raw frames while it is so
    local file=$world/$1 sets=$2; shift 2
    order "$@"; sleep 0.5
    "$pyrovox" record --raw start --out "$file" > "$dir/take.log" && wait_for field "s['record']['sets'] >= $sets" &&
        "$pyrovox" record --raw stop > "$dir/take.log"
}
world() {
    cd "$world" || return 1
    "$pyrovox" simcams --rig rig.yaml --ring 12 --write-frames frames > "$dir/frames.log" 2>&1 && cp -r frames take || return 1
    "$pyrovox" simcams --rig rig.yaml --ring 3 --format mono8 --write-frames raw > "$dir/frames.log" 2>&1 || return 1
    if [ -n "${T_LONG:-}" ]; then
        "$pyrovox" simcams --cameras 4 --size 960x720 --radius 1.6 --height 0.9 --ring 1 --write-rig far.yaml --write-frames none > "$dir/frames.log" 2>&1 || return 1
        perl -pe 's/-?[\d.]+(e-?\d+)?/$& * 0.4/ge if /^ +(t|min|max):/' far.yaml > near.yaml # where a board of this size is large
        "$pyrovox" simcams --rig near.yaml --board charuco:8x11:0.03:0.022:two-sided --poses 12 --write-frames pictures > "$dir/frames.log" 2>&1 || return 1
    fi
    (echo frame,phase; for i in 0 1 2 3 4 5 6 7 8 9 10 11; do echo "$i,0.$((i % 4 * 25))"; done) > phase.csv
    printf 'rig: rig.yaml\ncameras: "aravis:127.0.0.2+"\nfps: 10\npixel_format: RGB8\nphotometry: { black: 0.02 }\n' > my.yaml
    cp my.yaml pyrovoxd.yaml; { cat my.yaml; echo 'trigger: line'; } > line.yaml
    { sed "s,^fps: .*,fps: 20," my.yaml; echo 'record: { ring: { seconds: 3, memory: 100MB } }'; } > live.yaml
    cd - > "$dir/null" || return 1
    start daemon.log "$pyrovoxd" -c "$world/live.yaml"
    control=ipc://$dir/run/control
    wait_for published 1 || return 1
    "$pyrovox" record --volumes 120 --out "$world/flame.h5" > "$dir/record.log" 2>&1 & local recorder=$!
    take take.h5 30 'gain all 1' && take night.h5 101 'gain all 1' && take darks.h5 17 'cap all on' || return 1
    take empty.h5 8 'cap all off' 'empty all on' || return 1
    local i=0 l
    for l in a:0.096 b:0.19 c:0.29 d:0.58 e:0.96 f:1.92; do # of what is half of full scale
        "$pyrovox" simcams --rig "$world/rig.yaml" --ring 3 --set 'flat all 1' --set "exposure all ${l#*:}" --write-frames "$world/${l%:*}" > "$dir/frames.log" 2>&1
    done
    for l in a b c d; do i=$((i + 1)); take $l.h5 3 "flat all $i" || return 1; done
    for l in dim:0.25 half:0.8 bright:1.6; do take "${l%:*}.h5" 8 "exposure all ${l#*:}" || return 1; done
    cp "$world/half.h5" "$world/source.h5"
    order 'exposure all 1' 'flat all 0' 'empty all off'
    "$pyrovox" reconstruct --rig "$world/rig.yaml" --frames "$world/take" --black 0.02 --out "$world/vol" --quiet || return 1
    wait $recorder && cp "$world/flame.h5" "$world/recording.h5"
    (echo nm,red,green,blue; for i in 0 1 2 3 4 5 6; do
        echo "$((400 + 50 * i)),$(cut -d' ' -f$((i + 1)) <<< '.01 .02 .1 .2 .9 .7 .1'),$(cut -d' ' -f$((i + 1)) <<< '.02 .1 .9 1 .3 .1 .02'),$(cut -d' ' -f$((i + 1)) <<< '.9 1 .3 .1 .02 .01 0')"
    done) > "$world/camera.csv"
    cp "$world/half.h5" "$world/lamp.h5"
    "$pyrovox" calibrate spectral --rig "$world/rig.yaml" --response "$world/camera.csv" --frames "$world/lamp.h5" --kelvin 2350 --out "$world/spectral.yaml" > "$dir/spectral.log" 2>&1
}
check world world
set +u; . "$b/env"; set -u
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1 OMPI_MCA_oob_tcp_if_include=lo
mkdir "$dir/bin"; for c in xdg-open less; do ln -s "$(command -v true)" "$dir/bin/$c"; done; PATH=$dir/bin:$PATH
[ $rc = 0 ] && { "$py" tests/system/commands.py "$PWD" "$b" "$world"; rc=$?; }
exit $rc
