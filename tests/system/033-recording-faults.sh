#!/bin/bash
# Recordings of volumes in every format, and what happens to them: the recorder is killed, the disk is full, the
# folder goes, the clock is set back, the daemon comes anew.  What is there afterwards is read again, value by value.
name=033
. "$(dirname "$0")/lib.sh"
formats="npy hdf5 vdb nvdb"
publish() { "$b/tests/unit/test_pub" --publish "$volumes" "$@" & pub=$!; pids+=("$pub"); }
unpublish() { kill -KILL "$pub" 2> /dev/null; wait "$pub" 2> /dev/null || true; }
place() { [ "$2" = hdf5 ] && echo "$dir/$1.h5" || echo "$dir/$1-$2"; } # name, format
record() { timeout "$patience" "$pyrovox" record --endpoint "$volumes" --quiet --format "$@"; }
begin() { # format, path: in the background, until there is something of it
    "$pyrovox" record --endpoint "$volumes" --quiet --format "$1" --out "$2" > "$dir/record.log" 2>&1 & rec=$!
    pids+=("$rec")
}
# how many volumes another process finds in a recording that is being written; h5py takes long to start, so it looks for some seconds
holds() { # path, at least
    if [ -d "$1" ]; then [ "$(find "$1" -maxdepth 1 -name '*.json' -o -maxdepth 1 -name '*.*vdb' | wc -l)" -gt "$2" ]
    elif [ "$1" = "${1%.h5}" ]; then return 1
    else "$py" - "$1" "$2" <<'PY'
import sys, time, h5py
end = time.monotonic() + 5
while time.monotonic() < end:
    try:
        if h5py.File(sys.argv[1], "r", libver="latest", swmr=True, locking=False)["sets/number"].shape[0] >= int(sys.argv[2]):
            sys.exit(0)
    except (OSError, KeyError):
        pass
    time.sleep(0.05)
sys.exit(1)
PY
    fi
}
whole() { # folders of .npy: sets 0 to the last of the publisher, one or more, with their values and times
    "$py" - "$@" <<'PY'
import glob, json, os, sys, numpy as np
for d in sys.argv[1:]:
    names = sorted(glob.glob(f"{d}/0*.npy"))
    assert names, d
    for s, n in enumerate(names):
        assert os.path.basename(n) == f"{s:06d}.npy", n
        i = np.arange(720)
        want = (s % 64 + (i % 8) / 8)[:, None] + 64 * np.arange(3)[None, :]
        want[i % 3 != s % 3] = 0
        assert np.array_equal(np.load(n), want.reshape(8, 9, 10, 3)), n
        j = json.load(open(n[:-3] + "json"))
        assert j["t_exposure_ns"] == 1767225600000000000 + s * 66666667 and j["report"]["solver"] == "mrnsd", j
PY
}
to_npy() { "$pyrovox" convert "$1" "$2" --format npy > "$dir/convert.log" 2>&1 || { cat "$dir/convert.log"; return 1; }; }
each() { local f; for f in $formats; do "$1" "$f" || { echo "  $f"; return 1; }; done; }

kills=4; [ -z "${T_LONG:-}" ] || kills=20
killed() { # at some moments: what is there is read, and is finished by repair
    local i p had cut=0 # had: whole files in a folder before; the last may be the one at hand
    for ((i = 1; i <= kills; i++)); do
        p=$(place "kill$i" "$1")
        publish 300 0 no-end
        begin "$1" "$p"
        wait_for test -e "$p" && wait_for holds "$p" $((i % 4)) || return 1
        sleep "0.0$((RANDOM % 10))$((RANDOM % 10))"
        had=0; [ -d "$p" ] && had=$(find "$p" -maxdepth 1 -name "*.$1" | wc -l)
        kill -KILL "$rec"; wait "$rec" 2> /dev/null
        unpublish
        "$pyrovox" convert "$p" "$dir/back-$i-$1" --format npy > "$dir/convert.log" 2>&1
        if [ $? != 0 ]; then # so early that there is no volume yet
            [ "$had" -le 1 ] || { echo "  $had volumes before, none after"; return 1; }
            grep -qE 'no volume|not a recording|written by pyrovox|cut off|No such' "$dir/convert.log" || { cat "$dir/convert.log"; return 1; }
            continue
        fi
        grep -q "cut off, or is being written" "$dir/convert.log" || { cat "$dir/convert.log"; return 1; }
        cut=$((cut + 1))
        [ "$(find "$dir/back-$i-$1" -name '*.npy' | wc -l)" -ge $((had - 1)) ] || { echo "  of $had volumes more than one is lost"; return 1; }
        run "$pyrovox" repair "$p"; says 0 finished || return 1
        run "$pyrovox" repair "$p"; says 0 "nothing to repair" || return 1
        to_npy "$p" "$dir/mended-$i-$1" && [ "$(ls "$dir/mended-$i-$1" | wc -l)" = "$(ls "$dir/back-$i-$1" | wc -l)" ] || return 1
    done
    [ $cut -ge $((kills / 2)) ] || { echo "  $cut of the kills came while volumes were written"; return 1; }
    whole "$dir"/back-*-"$1" "$dir"/mended-*-"$1"
}
check killed_at_any_moment each killed 2> /dev/null

full() { # closed in order, and what is there is valid
    local p; p=$(place full "$1")
    mkdir -p "$dir/disk"
    publish 12000 0
    unshare -rm bash -c '
        mount -t tmpfs -o size="$5" none "$1/disk" || exit 99
        timeout "$patience" "$2/bin/pyrovox" record --endpoint "$3" --format "$4" --quiet --out "$1/disk/${6##*/}" > "$1/log" 2>&1
        echo "exit $?" >> "$1/log"
        cp -r "$1/disk/${6##*/}" "$6"' - "$dir" "$b" "$volumes" "$1" "$2" "$p"
    unpublish
    grep -q '^exit 1$' "$dir/log" && grep -qE 'No space left|: the disk is full' "$dir/log" && grep -q 'recorded before are complete' "$dir/log" || { cat "$dir/log"; return 1; }
    to_npy "$p" "$dir/full-back-$1" && whole "$dir/full-back-$1" || return 1
    ! grep -q 'cut off' "$dir/convert.log" || { cat "$dir/convert.log"; return 1; }
}
full_all() { full npy 400k && full hdf5 8500k && full vdb 1m && full nvdb 8m; }
if unshare -rm bash -c 'mount -t tmpfs -o size=100k none /mnt' 2> /dev/null; then check full_disk full_all 2> /dev/null
else echo "SKIP 033:full_disk (no user and mount namespaces here)"; fi

removed() { # the folder goes while it is written
    mkdir "$dir/gone"
    local p=$dir/gone/v; [ "$1" = hdf5 ] && p=$p.h5
    publish -1 0 no-end # for as long as the recorder writes
    begin "$1" "$p"
    wait_for holds "$p" 2 || return 1
    mv "$dir/gone" "$dir/gone-$1" && rm -rf "$dir/gone-$1"
    wait_for gone "$rec" || { cat "$dir/record.log"; return 1; }
    ended "$rec" 1 && grep -q "$p.*removed or renamed" "$dir/record.log" || { cat "$dir/record.log"; return 1; }
    unpublish
}
check folder_goes each removed 2> /dev/null

publish 12 0
record npy --out "$dir/forth" > "$dir/log" 2>&1; wait "$pub"
cp -r "$dir/forth" "$dir/back"
"$py" - "$dir/back" <<'PY'
import glob, json, sys
for n in sorted(glob.glob(f"{sys.argv[1]}/0*.json"))[6:]: # an hour back, as when somebody sets the clock
    j = json.load(open(n))
    j["t_exposure_ns"] -= 3600_000_000_000
    json.dump(j, open(n, "w"))
PY
set_back() { # sets and times as they came
    local p; p=$(place clock "$1")
    timeout "$patience" "$pyrovox" play "$dir/back" --speed 0 --quiet --endpoint "$volumes" & local play=$!
    record "$1" --out "$p" > "$dir/log" 2>&1 || { cat "$dir/log"; return 1; }
    ended "$play" 0 && to_npy "$p" "$dir/clock-back-$1" || return 1
    "$py" - "$dir/back" "$dir/clock-back-$1" <<'PY'
import glob, json, sys, numpy as np
a, c = (sorted(glob.glob(f"{d}/0*.npy")) for d in sys.argv[1:])
assert len(a) == len(c) == 12, c
for x, y in zip(a, c):
    assert np.array_equal(np.load(x), np.load(y)), y
    i, k = (json.load(open(n[:-3] + "json")) for n in (x, y))
    assert i["set"] == k["set"] and i["t_exposure_ns"] == k["t_exposure_ns"], (i, k)
PY
}
check clock_set_back each set_back
paced() { # 5 pauses before and 5 after, of 0.33 s each
    local t0=$EPOCHREALTIME
    timeout "$patience" "$pyrovox" play "$dir/back" --speed 0.2 --quiet --endpoint "$volumes" & local play=$!
    record npy --out "$dir/paced" > "$dir/log" 2>&1 && ended "$play" 0 || { cat "$dir/log"; return 1; }
    "$py" -c 'import sys; t = float(sys.argv[2]) - float(sys.argv[1]); assert t > 3.2, t' "$t0" "$EPOCHREALTIME"
}
check clock_set_back_keeps_the_rate paced

anew() { # the daemon is killed and comes back: said, and both recordings are whole
    local p second; p=$(place anew "$1")
    publish 3 0 no-end
    begin "$1" "$p"
    wait_for holds "$p" 3 || return 1
    unpublish
    publish 5 0
    ended "$rec" 0 && wait "$pub" || { cat "$dir/record.log"; return 1; }
    grep -q "the daemon restarted; going on in $dir/anew.*session-" "$dir/record.log" && grep -q '^8 volumes in .*, 0 messages lost$' "$dir/record.log" || { cat "$dir/record.log"; return 1; }
    second=$(sed -n 's/.*going on in //p' "$dir/record.log")
    to_npy "$p" "$dir/anew-a-$1" && ! grep -q 'cut off' "$dir/convert.log" && to_npy "$second" "$dir/anew-b-$1" && ! grep -q 'cut off' "$dir/convert.log" || return 1
    [ "$(ls "$dir/anew-a-$1"/*.npy | wc -l)" = 3 ] && [ "$(ls "$dir/anew-b-$1"/*.npy | wc -l)" = 5 ] && whole "$dir/anew-a-$1" "$dir/anew-b-$1"
}
check daemon_comes_anew each anew 2> /dev/null
exit $rc
