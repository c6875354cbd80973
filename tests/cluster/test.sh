#!/bin/bash
# test.sh BUILD [FILTER]: a recording solved by Debian's Slurm and by Open MPI on a cluster of two nodes that is made
# for this alone (bed.sh), while tasks and nodes die, disks fill and the file server stalls.
# Closes with "N passed, N failed, N skipped".
# Nothing here hangs on how fast the machine is: frames come from a file server that is slow where something has to
# happen in the middle, and each event is waited for.
set -u
cd "$(dirname "$0")/../.." || exit
. tests/cluster/bed.sh
if [ "${1:-}" != --in ]; then
    b=$PWD/$1 bed='' as_root=()
    [ "$(id -u)" = 0 ] || as_root=(sudo)
    rm -rf "$b/cluster"; mkdir -p "$b/cluster"
    # The first process of the bed hears no signal; with it all others end.
    trap '[ -z "$bed" ] || "${as_root[@]}" kill -9 "$bed" 2> /dev/null' EXIT
    trap 'exit 130' INT TERM
    if ! said=$("${as_root[@]}" bash -c '. tests/cluster/bed.sh; bed_enter test -w /dev/fuse' 2>&1); then
        echo "SKIP cluster (no namespaces or no /dev/fuse for $(id -un) here: $said)"
        echo; echo "0 passed, 0 failed, 1 skipped"; exit
    fi
    "${as_root[@]}" bash "$0" --in "$b" "$(id -u):$(id -g)" "${2:-}" & bed=$!
    wait "$bed"; rc=$?; bed=
    exit $rc
fi
[ "${5:-}" = in ] || { bed_enter bash "$0" "$@" in; }
b=$2 owner=$3 filter=$4
export PYROVOX_CACHE=$dir/local TMPDIR=$dir/local PYTHONDONTWRITEBYTECODE=1
# Ranks of a bed talk over its only device.
export OMPI_MCA_oob_tcp_if_include=lo OMPI_MCA_btl_tcp_if_include=lo OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
pyrovox=$b/bin/pyrovox py=/usr/bin/python3 log=$b/cluster/test.log sets=60
pass=0 fail=0 skip=0

# ---- what cases are made of --------------------------------------------------------------------------------
# The disk of the file server is $disk; everybody sees it as $share.
disk=$dir/disk share=$dir/share take=$dir/take
plain=(--frames "$take" --rig "$dir/rig.yaml" --black 0.02 --threads 1 --quiet)
serve() { # folder, mount point, options...
    bindfs -f --multithreaded -o attr_timeout=0,entry_timeout=0 "${@:3}" "$1" "$2" &
    server=$!
    wait_for mountpoint -q "$2"
}
slow() { serve "$take" "$take" --read-rate=24k; } # about a frame set a second for each of two tasks
fast() { ! mountpoint -q "$take" || umount -l "$take"; }


# shellcheck disable=SC2120 # or nothing
solve() { timeout -k 10 900 "$pyrovox" reconstruct "${how[@]}" --out "$out" "$@" < /dev/null; }
run() { text=$("$@" 2>&1); code=$?; }
says() { # code, pattern...
    [ "$code" = "$1" ] || { printf '  exit %s, want %s: %s\n' "$code" "$1" "$text"; return 1; }
    local t
    for t in "${@:2}"; do grep -qE -- "$t" <<< "$text" || { printf '  no "%s" in: %s\n' "$t" "$text"; return 1; }; done
}
refuses() { # pattern..., of what run has run: in one line
    [ "$code" != 0 ] && [ "$code" -lt 124 ] && [ "$(grep -c . <<< "$text")" = 1 ] || { printf '  exit %s, not refused in one line: %s\n' "$code" "$text"; return 1; }
    says "$code" "$@"
}
part() { printf '%s.parts/part-%04d-of-%04d' "$out" "$1" "${2:-2}"; } # I [N]
status() { # I KEY [N]: of part I's status file, on the disk of the server
    "$py" -c 'import json, sys; print(json.load(open(sys.argv[1])).get(sys.argv[2], ""))' "$(part "$1" "${3:-2}" | sed "s|^$share/|$disk/|").json" "$2" 2> /dev/null
}
solved() { local n; n=$(status "$1" 'done' "${3:-2}") && [ "$n" -ge "$2" ]; } # I, at least this many sets [N]
complete() { local s; s=$(status "$1" state "${2:-2}"); [ "$s" = "done" ] || { echo "  part $1 is $s"; return 1; }; } # I [N]
in_middle() { solved 1 3 && solved 2 3; } # both parts are
begun() { wait_for in_middle_or_over && in_middle; }
in_middle_or_over() { queue_empty || in_middle; }
gone() { ! kill -0 "$1" 2> /dev/null; }
queue_empty() { [ -z "$(squeue -h 2>&1)" ]; }
settled() { wait_for queue_empty; }
next_job() { scontrol show config | awk '/^NEXT_JOB_ID/ { print $3 }'; }
array_tasks() { # first job id: which tasks of arrays were submitted since
    scontrol -o show jobs | sed -n 's/.*ArrayJobId=\([0-9]*\) ArrayTaskId=\([0-9]*\).*/\1 \2/p' | awk -v j="$1" '$1 >= j { print $2 }' | sort -nu | tr '\n' ' '
}
same() { # [FILE]: the volumes of $out are those of one process, bit for bit, and so is what is said of them
    (cd / && "$py" - "${1:-$dir/one/volumes.h5}" "$out" "$sets") <<'PY'
import sys, h5py, numpy as np
one, out = (h5py.File(p, "r") for p in sys.argv[1:3])
n, bad = int(sys.argv[3]), []
x, y = one["emission"][:], out["emission"][:]
if x.shape[0] != n or x.reshape(n, -1).any(1).sum() < n // 2: bad.append(f"one process: {x.shape}, {x.reshape(len(x), -1).any(1).sum()} not empty")
if x.shape != y.shape: bad.append(f"{y.shape}, want {x.shape}")
elif x.tobytes() != y.tobytes(): bad.append(f"emission differs in sets {[i for i in range(n) if x[i].tobytes() != y[i].tobytes()]}")
for c in "number", "t_exposure_ns", "camera_mask", "cameras_present", "status", "iterations", "rel_residual", "active_voxels":
    if one["sets/" + c][:].tobytes() != out["sets/" + c][:].tobytes(): bad.append(f"sets/{c} differs")
if out["gaps/why"].shape[0]: bad.append("it has gaps")
if bad: print("  " + "; ".join(bad)); sys.exit(1)
PY
}
kept() { find "$out.parts" -maxdepth 1 -name "$1" -printf '%f %i %T@ %s\n' | sort; } # pattern: nobody has touched them
rows() { "$py" -c 'import h5py, sys
s = h5py.File(sys.argv[1], "r", libver="latest", swmr=True)["sets"]
for r in zip(s["number"], s["total_ns"]): print(*r)' "$1"; } # set and what it took: another one if it is solved again
gone_on() { # I, rows that were there: they are, and all of its others after them
    [ "$(rows "$(part "$1").h5" | head -n "$(grep -c . <<< "$2")")" = "$2" ] || { echo "  what was solved was not kept"; return 1; }
    [ "$(sets_in "$(part "$1").h5")" = $((sets / 2)) ]
}
sets_in() { "$py" -c 'import h5py, sys; print(h5py.File(sys.argv[1], "r", libver="latest", swmr=True)["sets/number"].shape[0])' "$1"; }

# ---- cases -------------------------------------------------------------------------------------------------
case_whole_job() {
    run solve --slurm=2; says 0 '[0-9]' || return
    settled && complete 1 && complete 2 && same || return
    # both nodes had their share, and Pyrovox' own readers see one recording
    [ "$(status 1 host)" != "$(status 2 host)" ] || { echo "  one node did all"; return 1; }
    run "$pyrovox" convert "$out" "$dir/share/whole_job/npy" --format npy; says 0 || return
    run "$pyrovox" convert "$dir/one/volumes.h5" "$dir/share/whole_job/one" --format npy; says 0 || return
    local f n=0
    for f in "$dir"/share/whole_job/one/*.npy; do cmp "$f" "$dir/share/whole_job/npy/${f##*/}" || return; n=$((n + 1)); done
    [ $n = "$sets" ] || return
    "$pyrovox" play "$out" --speed 0 --quiet --endpoint "ipc://$dir/volumes" & local p=$!
    run timeout 600 "$pyrovox" record --endpoint "ipc://$dir/volumes" --out "$dir/share/whole_job/played.h5"; says 0 || { kill $p; return 1; }
    wait $p && [ "$(sets_in "$dir/share/whole_job/played.h5")" = "$sets" ] || return
    run solve --join; says 0 || return
    # and again: nothing to do, nothing done
    local before; before=$(kept 'part-*')
    run solve --array 1/2 --resume; says 0 && [ "$(kept 'part-*')" = "$before" ]
}
case_killed_task() {
    slow; run solve --slurm=2; says 0 || return
    begun || return
    local host; host=$(status 1 host)
    on_node "${host#node}" kill -9 "$(status 1 pid)" || return
    fast; settled || return
    complete 2 || return
    local had two was; had=$(sets_in "$(part 1).h5") two=$(kept 'part-0002-*') was=$(rows "$(part 1).h5")
    [ "$had" -ge 3 ] && [ "$had" -lt $((sets / 2)) ] || { echo "  $had sets were solved"; return 1; }
    run solve --join; says 1 "^ +1 +died +$had of 30 .* $host, process" '^ +2 +done' "missing: $((sets / 2)) sets" || return
    not_dark || return
    local job; job=$(next_job)
    run solve --slurm=2 --resume; says 0 || return
    settled && complete 1 && same && gone_on 1 "$was" || return
    [ "$(array_tasks "$job")" = "1 " ] || { echo "  submitted: $(array_tasks "$job")"; return 1; }
    [ "$(kept 'part-0002-*')" = "$two" ] || { echo "  part 2 was touched"; return 1; }
}
not_dark() { # part 1, which is not done: NaN, for Pyrovox a gap
    (cd / && "$py" - "$dir/one/volumes.h5" "$out" "$sets") <<'PY' || return
import sys, h5py, numpy as np
one, out = (h5py.File(p, "r")["emission"][:] for p in sys.argv[1:3])
n = int(sys.argv[3])
assert out.shape == one.shape, out.shape
assert np.isnan(out[: n // 2]).all() and out[n // 2 :].tobytes() == one[n // 2 :].tobytes()
PY
    run "$pyrovox" convert "$out" "$out-npy" --format npy; says 0 || return
    [ "$(find "$out-npy" -name '*.npy' | wc -l)" = $((sets / 2)) ] || { echo "  $(find "$out-npy" -name '*.npy' | wc -l) volumes, want $((sets / 2))"; return 1; }
}
case_killed_node() {
    slow; run solve --slurm=2; says 0 || return
    begun || return
    local host; host=$(status 1 host)
    node_kill "${host#node}"; fast
    local was; was=$(rows "$(part 1).h5")
    wait_for node_is "${host#node}" down && settled && complete 1 && same && gone_on 1 "$was" || return
    [ "$(status 1 host)" != "$host" ] || { echo "  by whom?"; return 1; }
}
# Volumes that fill a disk with room for one part and a half; then there is room.
case_full_disk() {
    how+=(--no-hull --grid 48)
    out=$dir/disk/full_disk/one.h5; run solve; says 0 || return
    local one=$out a b n
    small 24m; run solve --slurm=2; says 0 || return
    settled || return
    n=$(grep -l '"failed"' "$out.parts"/part-*.json | wc -l); [ "$n" -ge 1 ] || { cat "$out.parts"/part-*.json; return 1; }
    run solve --join; says 1 "failed .*: $out\.parts/part-000.-of-0002\.h5: .*full: .* MB are left, .* are needed" || return
    a=$(rows "$(part 1).h5") b=$(rows "$(part 2).h5")
    [ "$(grep -c . <<< "$a")" -ge 3 ] && [ "$(grep -c . <<< "$b")" -ge 3 ] || { echo "  hardly anything was solved"; return 1; }
    mount -o remount,size=100m "$dir/small"
    run solve --slurm=2 --resume; says 0 || return
    settled && complete 1 && complete 2 && same "$one" && gone_on 1 "$a" && gone_on 2 "$b"
}
case_full_disk_from_the_start() {
    small 2m; run solve --slurm=2; says 0 || return
    settled || return
    run solve --join; says 1 "^ +1 +failed .*: $out\.parts/part-0001-of-0002\.h5: .*full: .* MB are left, .* are needed" "^ +2 +failed " || return
    mount -o remount,size=100m "$dir/small"
    run solve --slurm=2 --resume; says 0 && settled && complete 1 && complete 2 && same
}
small() { # size of the disk that volumes go to now, for all
    mkdir -p "$dir/small" && mount -t tmpfs -o "size=$1" tmpfs "$dir/small"
    disk=$dir/small share=$dir/small out=$dir/small/volumes.h5
}
# One node has no room of its own: its cache, its shared memory.
case_full_node() {
    node_kill 1; node_start 1 64k; node_up 1 || return
    run solve --slurm=2; says 0 || return
    settled || return
    local n; n=$(cat "$out.parts"/part-*.json | grep -c '"host".*node1')
    [ "$n" -ge 1 ] || { echo "  node1 did nothing"; return 1; }
    cat "$out.parts"/*.json
    same && return # it does without
    run solve --join; says 1 'failed' 'node1' 'No space left|full' || return
    node_kill 1; node_start 1; node_up 1 || return
    run solve --slurm=2 --resume; says 0 && settled && same
}
# Reads and writes of everybody wait; the locks are held on.
case_stalled_server() {
    local stalled=$server
    slow; run solve --slurm=2; says 0 || return
    begun || return
    kill -STOP "$stalled"; fast
    local one; one=$(status 1 'done')
    timeout -k 10 600 "$pyrovox" reconstruct --out "$out" --join > "$dir/join.log" 2>&1 & local j=$!
    "$pyrovox" reconstruct --out "$out" --join > "$dir/join2.log" 2>&1 & local k=$!
    # Long enough for a heartbeat that Slurm or anybody might miss; how long it is decides nothing.
    sleep 30
    [ "$(status 1 'done')" -le $((one + 1)) ] || { kill -CONT "$stalled"; echo "  it did not stall"; return 1; }
    kill -TERM $k; wait_for gone $k || { kill -CONT "$stalled"; return 1; } # who waits for it can be ended
    kill -CONT "$stalled"
    wait $j; local rc=$?
    [ $rc -lt 2 ] || { echo "  --join: exit $rc"; cat "$dir/join.log"; return 1; }
    settled && complete 1 && complete 2 && same
}
case_two_tasks() {
    slow
    on_node 1 "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 1/2 > "$dir/first.log" 2>&1 & local first=$!
    wait_for solved 1 3 || return
    run on_node 2 "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 1/2 --resume
    refuses node1 "\b$(status 1 pid)\b" || return
    run on_node 2 "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 1/2
    refuses || return
    fast; wait $first || { cat "$dir/first.log"; return 1; }
    run solve --array 2/2; says 0 && same
}
# Before it has a volume a task may be busy for long with the matrix: here with a file server that stalls.
case_two_tasks_before_the_first_set() {
    local one=$out; out=$disk/two_tasks_before_the_first_set/volumes.h5
    kill -STOP "$the_server"
    on_node 1 "$pyrovox" reconstruct "${how[@]}" --matrix-cache "${one%/*}/matrix" --out "$out" --array 1/2 > "$dir/first.log" 2>&1 & local first=$!
    wait_for begun_by node1 || { ls "$out.parts"; return 1; }
    run on_node 2 "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 1/2 --resume
    refuses node1 "\b$(status 1 pid)\b" || return
    [ ! -e "$(part 1).h5" ] || { echo "  the matrix did not wait"; return 1; }
    kill -CONT "$the_server"; wait $first
}
begun_by() { [ "$(status 1 state) $(status 1 host)" = "running $1" ]; }
case_other_clocks() { # one node is ten minutes behind, the other a day ahead
    slow
    on_node 1 faketime -f -10m "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 1/2 > "$dir/first.log" 2>&1 & local first=$!
    on_node 2 faketime -f +1d "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 2/2 > "$dir/second.log" 2>&1 & local second=$!
    wait_for in_middle || { cat "$dir/first.log" "$dir/second.log"; return 1; }
    run solve --join; says 1 '^ +1 +running' '^ +2 +running' || return
    run on_node 2 faketime -f +1d "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 1/2 --resume
    refuses node1 || return
    on_node 2 kill -9 "$(status 2 pid)"; wait $second 2> /dev/null; fast
    wait $first || { cat "$dir/first.log"; return 1; }
    run solve --join; says 1 '^ +1 +done' '^ +2 +died' || return
    run on_node 1 faketime -f -10m "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 2/2 --resume; says 0 && same
}
case_damaged_part() { # cut off after it was done, as where a file server has lost its power
    run solve --slurm=2; says 0 && settled && same || return
    local whole; whole=$(stat -c %s "$(part 1).h5")
    truncate -s $((whole / 2)) "$(part 1).h5"
    run solve --join; says 1 '^ +1 +[^d ]' '^ +2 +done' || return # it does not say done
    run solve --slurm=2 --resume; says 0 && settled && same
}
case_without_resume() { # what was solved is not solved over by mistake
    run solve --array 1/2; says 0 || return
    local before; before=$(kept 'part-*.h5')
    run solve --array 1/2; refuses '[-]-resume continues it' && [ "$(kept 'part-*.h5')" = "$before" ]
}
case_other_rig() { # a file of the same name that is another one on one of the nodes; another version of Pyrovox there
    other_rig_on_2; how+=(--rig "$dir/local/rig.yaml")
    run on_node 1 "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 1/2; says 0 || return
    run on_node 2 "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 2/2; refuses 'another rig' || return
    sed -i 's/"pyrovox [^"]*"/"pyrovox 0.0.7"/' "$out.parts/job.json"
    run on_node 1 "$pyrovox" reconstruct "${how[@]}" --out "$out" --array 2/2; refuses '0\.0\.7'
}
other_rig_on_2() {
    on_node 1 cp "$dir/rig.yaml" "$dir/local/rig.yaml" && on_node 2 cp "$dir/rig.yaml" "$dir/local/rig.yaml" &&
        on_node 2 sed -i 's/^  min: \[-0.5,/  min: [-0.51,/' "$dir/local/rig.yaml" && ! on_node 2 cmp -s "$dir/rig.yaml" "$dir/local/rig.yaml"
}
case_other_options() {
    run solve --array 1/2; says 0 || return
    run solve --array 2/2 --binning 2; refuses binning || return
    run solve --array 1/2 --resume --iterations 5; refuses iterations || return
    run solve --array 2/3; refuses 'in 2 parts, not in 3' || return
    run solve --array 2/2 --threads 2; says 0 && same # how many threads is not what is solved
}
case_growing_take() {
    run solve --array 1/2; says 0 || return
    local c
    for c in "$take"/*/; do cp "$c/000000.png" "$c/000060.png" || return; done
    run solve --array 2/2; rm "$take"/*/000060.png
    refuses '60 frame sets, now there are 61' || return
    run solve --array 2/2; says 0 && same
}
case_bad_arrays() {
    local a
    for a in 0/2 3/2 1/0 x/2 1/ 1/2x -1/2 1/99999999999; do run solve --array "$a"; says 2 'part I, from 1, of N' || return; done
    run solve --array 61/1000; refuses '1000 parts.* 60' || return
    run "$pyrovox" reconstruct --join --out "$dir/share/nothing.h5"; [ "$code" != 0 ] && says "$code" 'nothing\.h5'
}
case_mpi() {
    command -v mpirun > /dev/null && [ -f "$b/lib/pyrovox/pyrovox-mpi.so" ] || return 77
    run timeout -k 10 900 mpirun --oversubscribe -n 2 "$pyrovox" reconstruct "${how[@]}" --out "$out"; says 0 && same
}
case_mpi_other_rig() { # ranks that see different rigs
    command -v mpirun > /dev/null && [ -f "$b/lib/pyrovox/pyrovox-mpi.so" ] || return 77
    other_rig_on_2 || return
    run timeout -k 10 900 srun --mpi=pmix -N2 -n2 "$pyrovox" reconstruct "${how[@]}" --rig "$dir/local/rig.yaml" --out "$out"
    [ "$code" != 0 ] && says "$code" 'another rig' && [ ! -e "$out" ]
}
case_mpi_by_slurm() { # a rank on each node
    command -v mpirun > /dev/null && [ -f "$b/lib/pyrovox/pyrovox-mpi.so" ] || return 77
    run sbatch --wait -N2 -n2 -o "$dir/mpi.log" --wrap "mpirun $pyrovox reconstruct ${how[*]} --out $out"
    says 0 && same && [ "$(status 1 host) $(status 2 host)" = "node1 node2" ] || { cat "$dir/mpi.log"; return 1; }
    rm -r "$out"* && run srun --mpi=pmix -N2 -n2 "$pyrovox" reconstruct "${how[@]}" --out "$out"; says 0 && same
}
case_mpi_killed_rank() {
    command -v mpirun > /dev/null && [ -f "$b/lib/pyrovox/pyrovox-mpi.so" ] || return 77
    slow
    timeout -k 10 900 mpirun --oversubscribe -n 2 "$pyrovox" reconstruct "${how[@]}" --out "$out" > "$dir/mpi.log" 2>&1 & local m=$!
    wait_for in_middle || { cat "$dir/mpi.log"; return 1; }
    kill -9 "$(status 2 pid)"; fast
    wait $m && { echo "  mpirun is content"; return 1; }
    local was; was=$(rows "$(part 2).h5")
    run timeout -k 10 900 mpirun --oversubscribe -n 2 "$pyrovox" reconstruct "${how[@]}" --out "$out" --resume; says 0 && same && gone_on 2 "$was"
}

# ---- the run -----------------------------------------------------------------------------------------------
tell() { printf '%s\n' "$1"; printf '%s\n' "$1" >> "$log"; }
finish() {
    tell ""
    tell "full output: ${log#"$PWD"/}"
    tell "$pass passed, $fail failed, $skip skipped"
    cp -r "$dir/slurm/log" "$b/cluster/slurm"
    chown -R "$owner" "$b/cluster"
    [ $fail = 0 ]; exit
}
one() { # case
    local name=cluster:$1 rc n t0=$SECONDS
    [[ $name == *"$filter"* ]] || return
    disk=$dir/disk share=$dir/share out=$share/$1/volumes.h5 server=$the_server
    how=("${plain[@]}")
    mkdir -p "$disk/$1"
    "case_$1" > "$dir/said" 2>&1; rc=$?
    kill -CONT "$the_server"; fast
    scancel -u root; settled
    for n in 1 2; do [ $rc = 0 ] && node_is $n idle || { node_kill $n; node_start $n; node_up $n; }; done
    { echo "=== $name (exit $rc, $((SECONDS - t0)) s)"; cat "$dir/said"; } >> "$log"
    case $rc in
        0) pass=$((pass + 1)); tell "PASS $name";;
        77) skip=$((skip + 1)); tell "SKIP $name ($(tail -n 1 "$dir/said"))";;
        *) fail=$((fail + 1)); cat "$dir/said"
           tail -n 20 "$out.parts"/*.json "$out.parts"/*.out "$out.parts"/*.log 2> /dev/null | tee -a "$log"; tell ""; tell "FAIL $name";;
    esac
    ! mountpoint -q "$dir/small" || umount -l "$dir/small"
}
: > "$log"
mkdir -p "$disk" "$share" "$dir/one"
serve "$disk" "$share" >> "$log" 2>&1 || { cat "$log"; fail=1; tell "FAIL cluster:file_server"; finish; }
the_server=$server
bed_start >> "$log" 2>&1 || { cat "$log"; fail=1; tell "FAIL cluster:bed"; finish; }
pass=1; tell "PASS cluster:bed"
"$pyrovox" simcams --cameras 4 --size 96x72 --voxels 32 --format mono8 --fps 30 --ring $sets --write-rig "$dir/rig.yaml" --write-frames "$take" >> "$log" 2>&1 &&
    how=("${plain[@]}") out=$dir/one/volumes.h5 && solve >> "$log" 2>&1 || { tail -n 20 "$log"; fail=1; tell "FAIL cluster:one_process"; finish; }
for c in $(declare -F | sed -n 's/^declare -f case_//p'); do one "$c"; done
finish
