#!/bin/bash
# offline: One recording solved by several processes: the same bits as by one; what dies is gone on with; what is missing is said.
name=100
. "$(dirname "$0")/lib.sh"
cd "$dir" || exit 1
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
here=$OLDPWD
solve() { run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --grid 24 --quiet "$@"; }
bits() { # recordings: the same sets, the same bits, and light in them
    "$py" - "$@" <<'P'
import sys, h5py, numpy as np
first = h5py.File(sys.argv[1], "r")
e = first["emission"][:]
assert len(e) > 1 and (e > 0).any(axis=(1, 2, 3, 4)).all()
for f in sys.argv[2:]:
    f = h5py.File(f, "r")
    assert np.array_equal(e.view("u4"), f["emission"][:].view("u4")), f
    assert np.array_equal(first["sets/number"][:], f["sets/number"][:]), f
P
}
recording() {
    run "$pyrovox" simcams --cameras 4 --size 96x72 --ring 12 --write-rig rig.yaml --write-frames take
    says 0 '12 frame sets in take'
}
check recording recording

one_file() { # the volumes of a folder; .hdf5 is .h5
    solve --out vol && says 0 && solve --out one.hdf5 && says 0 && [ -f one.hdf5 ] && mv one.hdf5 one.h5 || return 1
    "$py" - <<'P'
import glob, h5py, numpy as np
e = h5py.File("one.h5", "r")["emission"]
files = sorted(glob.glob("vol/*.npy"))
assert len(files) == 12 == len(e)
assert all(np.array_equal(np.load(f), v) for f, v in zip(files, e)), "not those of the folder"
P
}
check one_file one_file
not_over() { # nor found out when all is solved
    solve --out one.h5; says 1 'one.h5: is there already' || return 1
    solve --out one.h5 --array 1/2; says 1 'one.h5: is there already, and not made of parts' && [ ! -e one.h5.parts ]
}
check nothing_is_written_over not_over
planned() { # nothing of it stays where the recording is to be, nor is one in its way
    solve --out plan.h5 --plan; says 0 'memory:' 'disk: at most' && [ -z "$(ls -d plan.h5* 2> /dev/null)" ] || return 1
    solve --out one.h5 --plan; says 0 'memory:' && [ "$(ls -d one.h5*)" = one.h5 ]
}
check a_plan_leaves_nothing planned

parts() {
    local i
    for i in 3 1; do solve --out three.h5 --array $i/3; says 0 || return 1; done
    run "$pyrovox" reconstruct --out three.h5 --join
    says 1 'not begun' 'three.h5: 8 of 12 sets, 2 of 3 parts' 'missing: 4 sets' || return 1
    "$py" - <<'P' || return 1
import h5py, numpy as np
f = h5py.File("three.h5", "r")
e, dark = f["emission"], np.isnan(f["emission"][:]).all(axis=(1, 2, 3, 4))
assert list(np.flatnonzero(dark)) == [4, 5, 6, 7], dark
assert list(np.flatnonzero(f["sets/status"][:] == 0xffffffff)) == [4, 5, 6, 7]
P
    solve --out three.h5 --array 2/3
    says 0 'three.h5: 12 of 12 sets, 3 of 3 parts, in ' || return 1
    local table=$out
    run "$pyrovox" repair three.h5; says 0 'three.h5: 12 volumes, nothing to repair' || return 1
    # a process of this number on another node
    run bash -c 'mkdir three.h5.tmp.$$; exec "$0" reconstruct --out three.h5 --join' "$pyrovox"; says 0 || return 1
    out=$table
    [ -z "$(find . -maxdepth 1 -name 'three.h5.tmp*' -type f)" ] && bits one.h5 three.h5 || return 1
    if grep -q 'kernels\|running parts' <<< "$out"; then echo "$out"; return 1; fi
    [ "$(grep -cE '^ +[1-3]  done +4 of 4 +[0-9.]+ +[0-9.e+-]+ (s|min|h)  ' <<< "$out")" = 3 ] || { echo "$out"; return 1; }
}
check parts_are_one_recording parts
read_by_all() {
    run "$pyrovox" convert --format npy three.h5 back; says 0 || return 1
    "$py" - <<'P' || return 1
import glob, numpy as np
a, b = sorted(glob.glob("vol/*.npy")), sorted(glob.glob("back/*.npy"))
assert len(a) == len(b) == 12 and all(np.array_equal(np.load(x), np.load(y)) for x, y in zip(a, b))
P
    run env PYTHONPATH="$here/proto/clients/python:$here/proto/clients" "$py" -c '
import pyrovox
r = pyrovox.open("three.h5")
assert len(r) == 12 and not r.gaps, (len(r), r.gaps)'
    says 0
}
check read_by_all read_by_all
python_sees_what_is_missing() {
    mv three.h5.parts/part-0002-of-0003.h5 aside.h5
    # since it was joined
    run env PYTHONPATH="$here/proto/clients/python:$here/proto/clients" "$py" -c '
import pyrovox
try: pyrovox.open("three.h5")[5].dense
except pyrovox.BadRecording as e: print(e)'
    says 0 'set 5 is not there: its part, in three.h5.parts, is gone' || return 1
    run "$pyrovox" convert --format npy three.h5 eight; says 0 '4 of its sets are not solved, or their part is not there' '8 volumes in eight' || return 1
    start play.log "$pyrovox" play three.h5 --speed 0 --endpoint "$volumes"
    wait_for grep -q '4 of its sets are not solved, or their part is not there, and are skipped' play.log || return 1
    kill -INT "$started"; wait "$started"
    run "$pyrovox" reconstruct --out three.h5 --join
    says 1 '8 of 12 sets' || return 1
    run env PYTHONPATH="$here/proto/clients/python:$here/proto/clients" "$py" -c '
import pyrovox
r = pyrovox.open("three.h5")
g, = r.gaps
assert len(r) == 8 and g.why == "unsolved" and g.volumes == 4, (len(r), r.gaps)
assert [float(v.dense.max()) > 0 for v in r] == [True] * 8'
    says 0 || return 1
    run "$pyrovox" repair three.h5; says 1 'made of parts' || return 1
    mv aside.h5 three.h5.parts/part-0002-of-0003.h5
    run "$pyrovox" reconstruct --out three.h5 --join; says 0 && bits one.h5 three.h5
}
check what_is_missing_is_not_dark python_sees_what_is_missing

ranks() {
    run mpirun --oversubscribe -n 2 "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --grid 24 --quiet --out ranks.h5
    says 0 'ranks.h5: 12 of 12 sets, 2 of 2 parts' && bits one.h5 ranks.h5 || return 1
    run mpirun --oversubscribe -n 2 "$pyrovox" reconstruct --rig rig.yaml --frames nowhere --out x.h5 --quiet
    [ "$code" != 0 ] && grep -q nowhere <<< "$out" && ! grep -q 'x.h5.parts' <<< "$out"
}
check ranks_of_mpirun ranks

# ---- what dies, is stopped, or does not belong -------------------------------------------------------------------
# A set whose picture is a pipe is read when the test hands it over: a solve stands at it, however fast the machine is.
solving() { start slow.log "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --grid 24 --threads 1 --out slow.h5 --array "$1/2" --quiet "${@:2}"; }
hold() { local n; for n; do mv take/cam0/$n.png kept-$n.png && mkfifo take/cam0/$n.png || return 1; done; }
hand_over() { timeout "$patience" sh -c "{ sleep 1.1; cat kept-$1.png; } > take/cam0/$1.png"; } # waits for its reader first
let_go() { local n; for n; do mv kept-$n.png take/cam0/$n.png; done; }
how() { "$py" -c 'import json, sys
s = json.load(open("slow.h5.parts/part-000%s-of-0002.json" % sys.argv[1])); print(s["state"], s["done"])' "$1" 2> how.err; }
under_way() { [[ $(how "$1") =~ ^running\ [1-9] ]]; }
solving_half() { # part, the set it waits at first, the one it stands at
    hold "$2" "$3" && solving "$1" && hand_over "$2" && wait_for under_way "$1" && return # its state is said once a second
    kill -9 "$started"; let_go "$2" "$3"; return 1
}
dies() {
    solving_half 1 000002 000004 || return 1
    solve --out slow.h5 --array 1/2
    says 1 "part 1 of 2 is being solved by process $started on" || return 1
    run "$pyrovox" reconstruct --out slow.h5 --join
    grep -qE '^running parts: 1, .* sets/s; the ([6-9]|1[01]) sets that are left take them [0-9.e+]+ (s|min|h)$' <<< "$out" || { echo "$out"; return 1; }
    kill -9 "$started"; wait "$started" 2> /dev/null
    let_go 000002 000004
    run "$pyrovox" reconstruct --out slow.h5 --join; [ "$code" = 1 ] && grep -q " died .* process $started" <<< "$out" || { echo "$out"; return 1; }
    solving 1; ended "$started" 1 && grep -q 'exists already (died.*--resume continues' slow.log || { cat slow.log; return 1; }
    solving 1 --resume; ended "$started" 0 && grep -qE 'earlier try: [1-4] of 6 sets are there' slow.log || { cat slow.log; return 1; }
    [ "$(how 1)" = 'done 6' ]
}
check killed_and_gone_on_with dies
stops() { # by Ctrl-C, or what a scheduler sends: the set that it reads is read, and no more
    solving_half 2 000008 000010 || return 1
    kill -TERM "$started"; hand_over 000010; let_go 000008 000010
    ended "$started" 130 || return 1
    [[ $(how 2) =~ ^stopped\ [1-5]$ ]] || { how 2; return 1; }
    solving 2 --resume; ended "$started" 0 && grep -q 'slow.h5: 12 of 12 sets, 2 of 2 parts' slow.log || { cat slow.log; return 1; }
    bits one.h5 slow.h5
}
check stopped_and_gone_on_with stops
damaged() { # a power cut, or a file server, took back what was done
    truncate -s 100k slow.h5.parts/part-0002-of-0002.h5
    run "$pyrovox" reconstruct --out slow.h5 --join; says 1 'changed since it was done' 'missing: ' || return 1
    solving 2 --resume; ended "$started" 0 && bits one.h5 slow.h5
}
check damaged_and_gone_on_with damaged
nothing_to_do() {
    local before; before=$(stat -c '%i %Y' slow.h5.parts/part-*.h5)
    solving 1 --resume; ended "$started" 0 && [ "$before" = "$(stat -c '%i %Y' slow.h5.parts/part-*.h5)" ]
}
check what_is_done_stays nothing_to_do

refused() {
    solve --out three.h5 --array 1/3 --resume --lambda 3; says 1 "begun with other options (then 'nothing', now '--lambda 3')" || return 1
    cp three.h5.parts/job.json job && sed -i 's/"pyrovox [0-9.]*"/"pyrovox 0.0.7"/' three.h5.parts/job.json
    solve --out three.h5 --array 1/3 --resume; says 1 'was begun by pyrovox 0.0.7, this is pyrovox' || return 1
    cp job three.h5.parts/job.json
    solve --out three.h5 --array 1/4 --resume; says 1 'begun in 3 parts, not in 4' || return 1
    solve --out three.h5 --array 1/3 --resume --last 9; says 1 'begun with other options' || return 1
    sed 's/gain: \[1/gain: [1.001/; t; s/^version: 1/version: 1 #/' rig.yaml > r && cp rig.yaml kept && sed 's/min: \[-0.5/min: [-0.501/' kept > rig.yaml
    cmp -s rig.yaml kept && { echo "the rig is the same"; return 1; }
    solve --out three.h5 --array 1/3 --resume; says 1 'begun with another rig.yaml' || return 1
    cp kept rig.yaml
    cp -r take other
    run "$pyrovox" reconstruct --rig ./rig.yaml --frames other --black 0.02 --grid 24 --out three.h5 --array 1/3 --resume
    says 1 "(then '--frames take', now '--frames other')" || return 1
    run "$pyrovox" reconstruct --grid=24 --rig ./rig.yaml --frames ../"${dir##*/}"/take --black 0.02 --out three.h5 --array 1/3 --resume; says 0 || return 1
    mkdir -p more && mv take/*/000011.* more/ 2> /dev/null || rm -f take/*/000011.*
    solve --out three.h5 --array 1/3 --resume; says 1 'begun with 12 frame sets, now there are 11'
}
check another_job_is_refused refused
drawn_anew() { # what options and rig.yaml only name
    local two=(run "$pyrovox" reconstruct --rig masked.yaml --frames drawn --black 0.02 --grid 24 --quiet --background empty --out drawn.h5 --array)
    masks() { "$py" -c 'import sys, numpy as np; a = np.full((72, 96), 255, "u1"); a[:, :int(sys.argv[1])] = 0; np.save("mask.npy", a)' "$1"; }
    run "$pyrovox" simcams --rig rig.yaml --ring 4 --write-frames drawn; says 0 || return 1
    sed '0,/^    t: .*/s//&\n    photometry: { mask: mask.npy }/' rig.yaml > masked.yaml && masks 1 || return 1
    "$py" -c 'import os, numpy as np
os.mkdir("empty")
for c in range(4): np.save("empty/cam%d.npy" % c, np.zeros((72, 96, 3), "u1"))' || return 1
    "${two[@]}" 1/2; says 0 || return 1
    masks 40; "${two[@]}" 2/2; says 1 "then 'in the masks: " || return 1
    masks 1; "$py" -c 'import numpy as np; np.save("empty/cam2.npy", np.full((72, 96, 3), 9, "u1"))'
    "${two[@]}" 2/2; says 1 "then 'in --background: "
}
check what_is_drawn_anew_is_refused drawn_anew
wrong() {
    local i
    solve --out folder --array 1/2; says 2 '--out FILE.h5' || return 1
    solve --out x.h5 --array 3/2; says 2 'part I, from 1, of N' || return 1
    solve --out x.h5 --array 1/40; says 1 '40 parts, but there are only' || return 1
    run "$pyrovox" reconstruct --out nothing.h5 --join; says 1 nothing.h5.parts/job.json || return 1
    run "$pyrovox" reconstruct --out one.h5 --join; says 1 'one.h5: was not made in parts' || return 1
    for i in --array=1/2 --resume --plan --slurm=2 --sbatch=-x --save-report=r; do
        run "$pyrovox" reconstruct --out three.h5 --join $i; says 2 '--join needs --out and no other option' || return 1
    done
    for i in --array=1/2 --resume --slurm=2; do solve --out x.h5 --plan $i; says 2 '--plan looks at all frame sets' || return 1; done
    solve --out x.h5 --resume; says 1 'use --array I/N' && [ ! -e x.h5 ] || return 1
    solve --out x.h5 --slurm 1.5; says 2 '--slurm 1.5: should be a whole number' || return 1
    solve --out x --margin 0.5; says 2 '--margin 0.5: should be a whole number' || return 1
    run "$pyrovox" render one.h5 x.png --angle 0; says 1 'pyrovox convert'
}
check wrong_use_is_told wrong

# A scheduler that keeps its words, a line each, and refuses while there is a file "full".
mkdir bin && cat > bin/sbatch <<'S'
#!/bin/sh
[ ! -e full ] || { echo "sbatch: error: no room"; exit 1; }
printf '%s\n' "$@" > "words$(ls words* 2> /dev/null | wc -l)"
echo 17
S
chmod +x bin/sbatch
slurm() { rm -f words*; run env PATH="$dir/bin:$PATH" "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --grid 24 --out job.h5 --slurm "$@"; }
handed_out() {
    local many; many=$(printf -- '--x=%d ' {1..80})
    slurm 2 --sbatch "--comment=\"flame of tuesday\" --cpus-per-task=16 $many"
    says 0 'job 17: parts 1-2 of 2' 'joins them into job.h5' || return 1
    grep -qx -- '--comment=flame of tuesday' words0 && grep -qx -- '--x=80' words0 && grep -qx 'job.h5.parts/job.sh' words0 || { cat words0; return 1; }
    [ "$(grep -e --cpus words0)" = --cpus-per-task=16 ] && [ "$(grep -e --cpus words1 | tail -n 1)" = --cpus-per-task=1 ] || return 1
    slurm 2; says 1 'job.h5.parts: exists already: --resume' && [ ! -e words0 ] || return 1
    slurm 2 --resume; says 0 'parts 1-2 of 2' && rm -r job.h5.parts
}
check handed_to_slurm handed_out
not_handed_out() { # what nobody has can be begun in another number of parts
    slurm 2 --sbatch "--comment='flame"; says 1 'a quote is not closed' && [ ! -e job.h5.parts ] || return 1
    slurm 2 --sbatch '--time=$nothing'; says 1 'variable' && slurm 2 --sbatch '$(touch ran)'; says 1 'would run a command' && [ ! -e ran ] || return 1
    touch full; slurm 2; rm full; says 1 'sbatch refuses: sbatch: error: no room' && [ ! -e job.h5.parts ] || return 1
    run env PATH="$dir/none" "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --grid 24 --out job.h5 --slurm 3
    says 1 'slurm-client' && [ ! -e job.h5.parts ] || return 1
    run "$pyrovox" reconstruct --rig rig.yaml --frames take --black 0.02 --grid 24 --out job.h5 --array 1/4 --quiet; says 0 || return 1
    touch full; slurm 4 --resume; rm full; says 1 'no room' && [ -e job.h5.parts/job.json ] || return 1
    slurm 4; says 1 'job.h5.parts: exists already: --resume' && slurm 4 --resume; says 0 'parts 2-4 of 4'
}
check what_slurm_refuses_is_not_begun not_handed_out

said_twice() { # of an option the last counts, in whatever order
    solve --out twice.h5 --array 1/2 --lambda 0.1 --lambda 0.001; says 0 || return 1
    solve --out twice.h5 --array 2/2 --lambda 0.001 --lambda 0.1; says 1 "(then '--lambda 0.001', now '--lambda 0.1')" || return 1
    solve --out twice.h5 --array 2/2 --lam 7 --lambda 0.001; says 0
}
check said_twice said_twice
two_kernels() { # as on two kinds of processor
    PYROVOX_CPU=ref solve --out mixed.h5 --array 1/2; says 0 || return 1
    solve --out mixed.h5 --array 2/2; says 0 'solved by different kernels (ref, '
}
if [ "$("$py" -c 'import json; print(json.load(open("three.h5.parts/part-0001-of-0003.json"))["kernels"])')" != ref ]; then check two_kernels two_kernels
else echo "SKIP $name:two_kernels (this processor has but one)"; fi

seams() { # what leans on the set before begins early, and the overlap is compared
    local i
    for i in 1 2; do solve --out lean.h5 --temporal --array $i/2; says 0 || return 1; done
    grep -qE 'at the seams volumes differ by [0-9.]+ % at most' <<< "$out" || { echo "$out"; return 1; }
    "$py" - <<'P'
import h5py
seam = h5py.File("lean.h5.parts/part-0002-of-0002.seam.h5", "r")
part = h5py.File("lean.h5.parts/part-0001-of-0002.h5", "r")
assert list(seam["sets/number"]) == [part["sets/number"][-1]]
P
}
check seams_overlap seams

growing() { # a take that is not closed has no last set yet
    (cd "$here" && config d.yaml <<< $'cameras: "sim:"\nfps: 20')
    start d.log "$pyrovoxd" -c d.yaml; local d=$started
    wait_for published 1 || return 1
    run "$pyrovox" record --raw start --control "$control" --out "$dir/live.h5"; says 0 || return 1
    local n; n=$(sets); wait_for published $((n + 10)) || return 1
    run "$pyrovox" reconstruct --rig "$here/tests/data/rig4.yaml" --frames live.h5 --grid 16 --out g.h5 --array 1/2 --quiet
    says 1 'still being written' '--last' || return 1
    kill -INT "$d"; ended "$d" 0
}
check growing_take growing
exit $rc
