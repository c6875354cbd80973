#!/bin/bash
# record.volumes: the recorder beside the daemon ends with it, comes back when it is killed, goes when the daemon
# is killed, rolls, and is begun and ended by a request; what does not fit is refused at the start.  Raw frames that
# rolled over are read as one recording.
name=047
source "$(dirname "$0")/lib.sh"
run_daemon() { # lines of record
    config v.yaml < <(echo 'cameras: "sim:"'; echo 'fps: 25'; echo "record: { $1 }")
    start v.log "$pyrovoxd" -c "$dir/v.yaml"; d=$started
    wait_for field "s['sets']['published'] >= 5"
}
child() { pgrep -P "$d" -x pyrovox; }
count() { h5dump -H -d /sets/number "$1" | grep -c 'DATASPACE  SIMPLE { ( [1-9]'; }

beside() { # killed: a new one, in a file of its own; the daemon's end closes it
    run_daemon "volumes: hdf5" || return 1
    wait_for child > /dev/null || return 1
    local first; first=$(child)
    sleep 1
    kill -KILL "$first"
    wait_for field "s['record_volumes']['deaths'] == 1 and s['record_volumes']['running']" || return 1
    sleep 1
    kill -INT "$d"; ended "$d" 0 || return 1
    [ "$(ls "$dir"/takes/*-volumes-*.h5 | wc -l)" = 2 ] && h5dump -a /closed "$dir"/takes/*-2.h5 | grep -q '(0): 1' && count "$dir"/takes/*-2.h5 > /dev/null
}
check comes_back_and_is_closed beside
configured() { h5dump -d /config "$dir"/takes/*-2.h5 | grep -q "fps: 25"; }
check has_the_configuration configured

folders() { # the same of numbered files: the first is finished by repair, the second was closed
    rm -rf "$dir/takes"
    run_daemon "volumes: $1" || return 1
    wait_for eval '[ "$(ls "$dir"/takes/*-volumes-*/*.'"$1"' 2> /dev/null | wc -l)" -ge 3 ]' || return 1
    kill -KILL "$(child)"
    wait_for field "s['record_volumes']['deaths'] == 1 and s['record_volumes']['running']" || return 1
    wait_for eval '[ "$(ls -d "$dir"/takes/*-volumes-* | wc -l)" = 2 ] && [ "$(ls "$dir"/takes/*-2/*.'"$1"' 2> /dev/null | wc -l)" -ge 1 ]' || return 1
    kill -INT "$d"; ended "$d" 0 || return 1
    local first second; first=$(ls -d "$dir"/takes/*-volumes-* | head -n 1) second=$(ls -d "$dir"/takes/*-volumes-* | tail -n 1)
    [ "${#first}" -le "${#second}" ] || { local t=$first; first=$second second=$t; }
    run "$pyrovox" repair "$second"; says 0 "nothing to repair" || return 1
    run "$pyrovox" repair "$first"; says 0 "finished; 0 damaged" || return 1
    run "$pyrovox" convert "$first" "$dir/first-$1.h5"; says 0 "volumes in" && ! grep -q "cut off" <<< "$out"
}
check numbered_files_of_a_killed_recorder folders vdb 2> /dev/null
check nanovdb_of_a_killed_recorder folders nvdb 2> /dev/null

orphan() {
    run_daemon "volumes: npy" || return 1
    wait_for child > /dev/null || return 1
    local c; c=$(child)
    kill -KILL "$d"; wait "$d" 2> /dev/null
    wait_for gone "$c"
}
check goes_when_the_daemon_is_killed orphan 2> /dev/null

rolls() { # raw frames and volumes go on in other files: every set is in one of them, or told to be missing
    rm -rf "$dir/takes"
    run_daemon "mode: raw, volumes: hdf5, roll_s: 1, keep_free_gb: 0, path: takes/raw.h5" || return 1
    wait_for eval '[ -e "$dir/takes/raw-0003.h5" ] && [ "$(ls "$dir"/takes/*-volumes-*-0003.h5 2> /dev/null | wc -l)" = 1 ]' || return 1
    field "s['record']['takes'] >= 3 and s['record']['path'].endswith('.h5')" || return 1
    kill -INT "$d"; ended "$d" 0 || return 1
    "$py" - "$dir/takes" <<'P'
import glob, h5py, sys
def series(first, numbers, gaps):
    stem, n, out, there = first[:-3], 1, [], first
    while glob.glob(there):
        with h5py.File(there, "r") as f:
            assert f.attrs["closed"] == 1 and len(numbers(f)) > 0, there
            out += list(numbers(f)) + [k for a, b in gaps(f) for k in range(int(a), int(b) + 1)]
        n += 1
        there = "%s-%04d.h5" % (stem, n)
    assert n > 3 and len(glob.glob(stem + "*.h5")) == n - 1, (stem, n)
    assert sorted(set(out)) == list(range(int(min(out)), int(max(out)) + 1)), "a set is missing"
    assert len(out) == len(set(out)), "a set is in two files"
    return out
raw = series(sys.argv[1] + "/raw.h5", lambda f: f["sets"]["number"], lambda f: [(g["set_first"], g["set_last"]) for g in f["gaps"][:] if g["camera"] == 0])
first = min(glob.glob(sys.argv[1] + "/*-volumes-*.h5"), key=len)
volumes = series(first, lambda f: f["sets/number"], lambda f: zip(f["gaps/set_first"], f["gaps/set_last"]))
assert set(volumes) <= set(raw) and len(volumes) > 10
P
}
check goes_on_in_other_files rolls

take=$dir/takes/raw.h5
solve() { run "$pyrovox" reconstruct --rig tests/data/rig4.yaml --black 0.02 --grid 12 --start cold --quiet "$@"; }
one() { # the volumes of NAME.h5 are those of its files, each alone
    local f v n=0 all=0
    solve --frames "$take" --out "$dir/one" && says 0 || return 1
    mkdir "$dir/alone"
    for f in "$dir"/takes/raw*.h5; do
        n=$((n + 1))
        ln "$f" "$dir/alone/$n.h5"
        solve --frames "$dir/alone/$n.h5" --out "$dir/alone/$n" && says 0 || return 1
        for v in "$dir/alone/$n"/*.npy; do cmp "$v" "$dir/one/${v##*/}" || return 1; all=$((all + 1)); done
    done
    [ "$n" -ge 3 ] && [ "$all" = "$(ls "$dir"/one/*.npy | wc -l)" ]
}
check is_read_as_one one
told() { # how many files, and what the first one alone lacks
    local first; for first in "$dir"/alone/*.h5; do cmp -s "$first" "$take" && break; done
    run "$pyrovox" replay --info "$take"
    says 0 'closed in order' "files     $(ls "$dir"/takes/raw*.h5 | wc -l)" "raw-0002.h5: sets " "; 0 more are not complete" || return 1
    run "$pyrovox" replay --info "$first"
    says 0 'cut off, or still being recorded' '-0002.h5: is missing, in which the recording went on'
}
check files_are_told told
parts() {
    local i
    for i in 2 1; do solve --frames "$take" --out "$dir/parts.h5" --array $i/2; says 0 || return 1; done
    "$py" - "$dir" <<'P'
import glob, h5py, numpy as np, sys
f = h5py.File(sys.argv[1] + "/parts.h5", "r")
files = sorted(glob.glob(sys.argv[1] + "/one/*.npy"))
assert len(files) == len(f["emission"]) > 50
assert all(np.array_equal(np.load(a), b) for a, b in zip(files, f["emission"]))
P
}
check is_solved_in_parts parts
job() { # all files are of the job: without one it is another, and what lacks its end is not dealt out
    mkdir "$dir/some"; ln "$dir"/takes/raw*.h5 "$dir/some"
    solve --frames "$dir/some/raw.h5" --out "$dir/some.h5" --array 1/2; says 0 || return 1
    mv "$dir/some/raw-0002.h5" "$dir/aside.h5"
    solve --frames "$dir/some/raw.h5" --out "$dir/some.h5" --array 2/2
    says 1 'some/raw-0002.h5: is missing' ', before it, are lost' 'was begun with' || return 1
    mv "$dir/aside.h5" "$dir/some/raw-0002.h5"
    rm "$(ls "$dir"/some/raw-*.h5 | tail -n 1)"
    solve --frames "$dir/some/raw.h5" --out "$dir/new.h5" --array 1/2
    says 1 'is missing, in which the recording went on' 'is still being written, or was cut off'
}
check all_files_are_of_the_job job
replayed() { # each set of all files comes once more
    start replay.log "$pyrovox" replay --lossless --set publish.wait_subscriber=true --set record.volumes=none "$take"; local d=$started
    start again.log "$pyrovox" record --endpoint "$volumes" --out "$dir/again" --quiet; local r=$started
    ended "$r" 0 && ended "$d" 0 || return 1
    diff <(cd "$dir/one" && ls -- *.npy) <(cd "$dir/again" && ls -- *.npy)
}
check all_is_replayed replayed
full() {
    config f.yaml < <(echo 'cameras: "sim:"'; echo "record: { mode: raw, keep_free_gb: 1000000 }")
    run "$pyrovoxd" -c "$dir/f.yaml"
    says 1 "too full to record" "record.keep_free_gb"
}
check full_disk_is_refused full

open() {
    run "$pyrovoxd" -c <(echo "{rig: $PWD/tests/data/rig4.yaml, cameras: \"sim:\", insecure: true, publish: {endpoints: [\"tcp://*:5599\"]}, record: {volumes: hdf5}}") --check-config
    says 1 "record.volumes: needs an ipc://"
}
check needs_an_endpoint open
exit $rc
