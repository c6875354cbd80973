#!/bin/bash
# A grid whose whole matrix is not to be built: the same volumes from its active part, within the memory that was said
# before; and what it would take, without doing it.
name=071
. "$(dirname "$0")/lib.sh"
cd "$dir" || exit 1
frames="--rig rig.yaml --frames take --black 0.02"
peak() { # command...: as run does, and the most memory that it had, bytes, in $peak
    out=$("$py" - "$@" 2>&1 << 'PY'
import resource, subprocess, sys
p = subprocess.run(sys.argv[1:], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
sys.stdout.write(p.stdout.decode(errors="replace"))
print("\npeak %d" % (resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024))
sys.exit(p.returncode)
PY
    )
    code=$?
    peak=$(sed -n 's/^peak //p' <<< "$out")
}
said() { sed -n 's/.*memory: at most \([0-9.]*\) GB.*/\1/p' <<< "$out" | head -n 1; }
below() { # bytes, GB: and not so far below that it says nothing
    "$py" -c 'import sys; a, b = float(sys.argv[1]), 1e9 * float(sys.argv[2]); sys.exit(not b / 6 < a <= b)' "$1" "$2" ||
        { echo "  $1 bytes of at most $2 GB"; return 1; }
}
recording() {
    run "$pyrovox" simcams --cameras 8 --size 640x480 --ring 4 --voxels 72 --write-rig rig.yaml --write-frames take
    sed -i 's/basis: trilinear/basis: box/' rig.yaml # half the time
    says 0 '4 frame sets in take'
}
# shellcheck disable=SC2086
same_volumes() {
    run "$pyrovox" reconstruct $frames --out whole --matrix-cache whole.pvxm --quiet; says 0 || return 1
    peak "$pyrovox" reconstruct $frames --out part --memory 0 --save-report part.json --quiet
    says 0 'only its part where these 4 frame sets have flame' || return 1
    [ ! -e "$dir/cache" ] || { echo "  a part was cached"; return 1; }
    for i in 0 1 2 3; do cmp whole/00000$i.npy part/00000$i.npy || return 1; done
    most=$(said)
}
# shellcheck disable=SC2086
not_enough() {
    run "$pyrovox" reconstruct $frames --out none --memory 0.1 --quiet
    says 1 'GB are needed, 0.1 GB are free' '--grid' && [ -z "$(ls none 2> /dev/null)" ]
}
# shellcheck disable=SC2086
no_flame() {
    run "$pyrovox" reconstruct $frames --out none --memory 0 --threshold 0.99 --quiet; says 1 'no flame in any of the 4 frame sets'
}
# shellcheck disable=SC2086
plan() {
    run "$pyrovox" reconstruct $frames --plan=0.5 --memory 0 --out planned --quiet
    says 0 '4 frame sets of 8 cameras, 72x72x72 voxels' 'active part, not cached' 'system matrix' 'solve' 'in 0.5 h: 1 machine' 'disk: 0.0179 GB' &&
        [ -z "$(ls planned 2> /dev/null)" ] && [ "$(said)" = "$most" ] || return 1
    run "$pyrovox" reconstruct $frames --plan=0.01 --out planned --quiet; says 0 'matrix: whole, cached' || return 1
    run "$pyrovox" reconstruct $frames --plan=0 --quiet; says 2 '--plan'
}
for t in recording same_volumes not_enough no_flame plan; do check $t $t; done
if grep -q __asan_init "$pyrovox"; then
    echo "SKIP $name:memory (built with a sanitizer, which takes more)"
else
    check memory below "$peak" "$most"
fi
exit $rc
