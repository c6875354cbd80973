#!/bin/bash
# pyrovox record: what it writes, that it counts gaps, and what it does when the disk is full, when
# nobody publishes, when it is stopped.
name=031
. "$(dirname "$0")/lib.sh"
ep=$volumes
publish() { "$b/tests/unit/test_pub" --publish "$ep" "$1" "$2" & pub=$!; pids+=($pub); }
reap() { wait "$pub"; }
record() { timeout "$patience" "$pyrovox" record --endpoint "$ep" "$@"; }
# a volume of test_pub is 8 x 9 x 10 x 3 float32 and a header of 128 bytes
whole() { [ "$(stat -c %s "$1.npy")" = 8768 ] && grep -q '"set":' "$1.json" && [ "$(tail -c 2 "$1.json")" = '}' ]; }

values() {
    publish 12 0
    record --out "$dir/a" > "$dir/log" 2>&1 || { cat "$dir/log"; return 1; }
    reap
    grep -q '^12 volumes in .*, 0 messages lost$' "$dir/log" || { cat "$dir/log"; return 1; }
    for s in 000000 000011; do whole "$dir/a/$s" || { ls -l "$dir/a"; cat "$dir/a/$s.json"; return 1; }; done
    [ "$(ls "$dir/a" | wc -l)" = 25 ] # and recording.json
}
check writes_volumes values

numpy() {
    /usr/bin/python3 - "$dir/a" <<'PY'
import json, sys, numpy as np
for s in range(12):
    a = np.load(f"{sys.argv[1]}/{s:06d}.npy")
    j = json.load(open(f"{sys.argv[1]}/{s:06d}.json"))
    i = np.arange(720)
    want = (s % 64 + (i % 8) / 8)[:, None] + 64 * np.arange(3)[None, :]
    want[i % 3 != s % 3] = 0
    assert a.dtype == np.float32 and np.array_equal(a, want.reshape(8, 9, 10, 3)), s
    assert j["set"] == s and j["shape"] == [8, 9, 10, 3] and j["units"] == "1/m", j
    assert j["origin"] == [-0.5, -0.5, 0] and np.allclose(j["spacing"], 0.1), j
    assert j["basis"] == "box" and j["report"]["solver"] == "mrnsd", j
    assert j["t_exposure_ns"] == 1767225600000000000 + s * 66666667, j
PY
}
if /usr/bin/python3 -c 'import numpy' 2>/dev/null; then check numpy_reads_them numpy
else echo "SKIP 031:numpy_reads_them (no numpy)"; fi

gaps() {
    publish 20 4
    record --out "$dir/b" > "$dir/log" 2>&1; local r=$?
    reap
    [ $r = 0 ] && grep -q '^15 volumes in .*, 5 messages lost$' "$dir/log" && [ ! -e "$dir/b/000003.npy" ] || { cat "$dir/log"; return 1; }
}
check counts_gaps gaps

limit() {
    publish 20 0
    record --out "$dir/c" --volumes 4 --quiet > "$dir/log" 2> "$dir/err"; local r=$?
    reap
    [ $r = 0 ] && [ "$(ls "$dir/c"/*.npy | wc -l)" = 4 ] && [ ! -s "$dir/err" ] || { cat "$dir/log" "$dir/err"; return 1; }
}
check stops_after_volumes limit

again() { # an earlier recording is left alone
    ! record --out "$dir/c" > "$dir/log" 2>&1 && grep -q "earlier recording" "$dir/log"
}
check refuses_old_folder again

waits() { # nobody publishes: says so, and Ctrl-C ends it
    : > "$dir/log"
    "$pyrovox" record --endpoint "$ep" --out "$dir/d" > "$dir/log" 2>&1 & rec=$!; pids+=($rec)
    wait_for grep -q 'waiting for a daemon' "$dir/log"
    kill -TERM "$rec"; wait "$rec"; local r=$?; rec=
    [ $r = 130 ] && grep -q 'waiting for a daemon' "$dir/log" && grep -q '^0 volumes' "$dir/log" && [ ! -e "$dir/d" ] || { echo "exit $r"; cat "$dir/log"; return 1; }
}
check waits_and_stops waits

restart() { # the daemon is killed and comes back: its sets count anew, in a folder of their own
    "$b/tests/unit/test_pub" --publish "$ep" 3 0 no-end & pub=$!
    record --out "$dir/g" > "$dir/log" 2>&1 & rec=$!; pids+=($rec)
    wait_for test -e "$dir/g/000002.json"
    kill -KILL "$pub"; wait "$pub" 2>/dev/null
    publish 5 0
    wait "$rec"; local r=$?; rec=
    reap
    [ $r = 0 ] && grep -q '^8 volumes in .*, 0 messages lost$' "$dir/log" && [ "$(ls "$dir"/g/*.npy | wc -l)" = 3 ] &&
        [ "$(ls "$dir"/g/session-*/*.npy | wc -l)" = 5 ] || { cat "$dir/log"; ls -R "$dir/g"; return 1; }
}
check daemon_restarts restart 2>/dev/null

raw_waits() { # no daemon: says so
    : > "$dir/log"
    "$pyrovox" record --raw start --control "$control" > "$dir/log" 2>&1 & rec=$!; pids+=($rec)
    wait_for grep -qF "waiting for a daemon at $control" "$dir/log"; local r=$?
    kill -TERM "$rec"; wait "$rec"; rec=
    [ $r = 0 ] || { cat "$dir/log"; return 1; }
    run "$pyrovox" record --raw start --control "$control" --roll 60
    says 2 record.roll_s
} 2> /dev/null # "Terminated"
check raw_waits raw_waits

hdf5() {
    publish 3 0
    record --out "$dir/r.hdf5" > "$dir/log" 2>&1; local r=$?
    reap
    [ $r = 0 ] && [ -f "$dir/r.hdf5" ] || { cat "$dir/log"; return 1; }
}
check hdf5_by_its_name hdf5

usage() {
    "$pyrovox" record --volumes 0 > "$dir/log" 2>&1 && return 1
    "$pyrovox" record --endpoint nonsense --out "$dir/e" > "$dir/log" 2>&1 && return 1
    grep -q 'nonsense: not an endpoint' "$dir/log"
}
check bad_arguments usage

full() { # a disk of 100 KiB: about ten volumes fit
    mkdir -p "$dir/disk"
    publish 40 0
    unshare -rm bash -c '
        mount -t tmpfs -o size=100k none "$1/disk" || exit 99
        timeout "$patience" "$2/bin/pyrovox" record --endpoint "$3" --out "$1/disk/f" > "$1/log" 2>&1
        echo "exit $?" >> "$1/log"
        cp -r "$1/disk/f" "$1/f"' - "$dir" "$b" "$ep"
    reap
    grep -q '^exit 1$' "$dir/log" && grep -q 'No space left' "$dir/log" && grep -q 'recorded before are complete' "$dir/log" || { cat "$dir/log"; return 1; }
    local n; n=$(ls "$dir/f"/*.npy | wc -l)
    [ "$n" -ge 2 ] && [ "$(ls "$dir/f" | wc -l)" = $((2 * n + 1)) ] || { ls "$dir/f"; return 1; }
    for f in "$dir"/f/*.npy; do whole "${f%.npy}" || { ls -l "$dir/f"; return 1; }; done
}
if unshare -rm bash -c 'mount -t tmpfs -o size=100k none /mnt' 2>/dev/null; then check full_disk full
else echo "SKIP 031:full_disk (no user and mount namespaces here)"; fi
exit $rc
