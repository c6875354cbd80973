#!/bin/bash
# The paper's experiments (`make paper`): on a recording like the paper's own, simulated, then on the fires on which
# nothing was ever fitted, then on a real plume.  Each goes on where it was stopped.
#   paper.sh BUILD          BUILD/paper/report.html, BUILD/paper/fires/NAME/report.html, BUILD/paper/plume/report.html,
#                           the same as .pdf
set -u
b=$1 at=$1/paper
mkdir -p "$at/fires" "$at/plume" || exit 1
PYROVOX_LIBDIR=$(realpath "$b")/lib/pyrovox # videos are read by a module that lies there
export PYROVOX_LIBDIR
once() { # name, command...: not again after it succeeded; 77: what there is (record.c)
    local name=$1 r; shift
    [ -e "$at/$name" ] && return
    "$@"; r=$?
    [ $r = 0 ] || [ $r = 77 ] || exit $r
    touch "$at/$name"
}
# Eight cameras on a ring, 15 Hz, high gain: most of the noise is in blue.
once recorded "$b/bin/pyrovox" simcams --cameras 8 --size 640x480 --fps 15 --ring 100 --noise 1,1,4 --write-frames "$at/take" --write-rig "$at/rig.yaml"
"$b/bin/pyrovox" experiment "$at/take" --rig "$at/rig.yaml" --basis box --black 0.02 --out "$at" || exit $?
once fires/recorded "$b/tests/bench/record" "$at/fires"
for fire in "$at"/fires/*", held out, 64^3"; do
    [ -e "$fire/rig.yaml" ] || { echo "no fires: PYROVOX_DATA is the folder that has them" >&2; break; }
    name=${fire##*/}
    echo "${name%%,*}, held out" >&2
    "$b/bin/pyrovox" experiment "$fire/frames" --rig "$fire/rig.yaml" --frames-max 1 --out "$at/fires/${name%%,*}" || exit $?
done
# Its calibration is off by several pixels (recon/NUMERICS.md, section 10): by the plume itself, before anything is compared.
plume() { [ -e "$at/plume/rig.yaml" ]; } # written last
plume || "$b/tests/bench/record" "$at/plume" plume || [ $? = 77 ] || exit 1
if plume; then
    echo "plume, real" >&2
    once plume/refined "$b/bin/pyrovox" calibrate refine --rig "$at/plume/rig.yaml" --frames "$at/plume/frames" --force --out "$at/plume/refined.yaml"
    "$b/bin/pyrovox" experiment "$at/plume/frames" --rig "$at/plume/refined.yaml" --out "$at/plume" || exit $?
else
    echo "no plume: PYROVOX_DATA is the folder that has it" >&2
fi
