# lib.sh - shared by the daemon's system tests: a scratch folder, a daemon in it, waiting with a limit.
# Sourced; the test sets `name` before.  Everything started here is ended by its id on exit.
set -u
programs=$(grep -oE '\$b/tests/[a-z0-9_./]+' "$0" | sort -u)
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
b=${PYROVOX_BUILD:-$PWD/build}
pyrovox=$b/bin/pyrovox pyrovoxd=$b/bin/pyrovoxd
for p in $programs; do # one that is not built would be waited for
    [ -x "$b/${p#\$b/}" ] || { echo "FAIL $name: $b/${p#\$b/} is not there: make test builds it"; exit 1; }
done
py=/usr/bin/python3; [ -x "$py" ] || py=python3
dir=$(mktemp -d /tmp/pyrovox-test-XXXXXX)
export PYROVOX_CACHE=$dir/cache PYTHONDONTWRITEBYTECODE=1
control=ipc://$dir/control volumes=ipc://$dir/volumes
pids=() rc=0
export patience=600 # s; a wait is for an event, and this only ends what hangs

finish() {
    for p in "${pids[@]:+${pids[@]}}"; do kill "$p" 2>/dev/null; done
    for p in "${pids[@]:+${pids[@]}}"; do wait "$p" 2>/dev/null; done
    [ $rc = 0 ] || for l in "$dir"/*.log; do [ -f "$l" ] && { echo "--- ${l##*/}"; tail -n 25 "$l"; }; done
    rm -rf "$dir"
}
trap finish EXIT
trap 'exit 1' INT TERM

check() { # what, command...
    local what=$1 from=$EPOCHREALTIME spent; shift
    note_spent; spent=$all_spent
    if "$@"; then echo "PASS $name:$what"; else echo "FAIL $name:$what"; rc=1; fi
    note_spent
    [ -z "${T_TIMES:-}" ] || awk "BEGIN { printf \"%.2f %.2f $name:$what\n\", $EPOCHREALTIME - $from, $all_spent - ($spent) }" >> "$T_TIMES"
}
all_spent=0
note_spent() { # seconds of a processor, of this shell and of what it started and has ended, as a sum
    [ -n "${T_TIMES:-}" ] || return 0
    times > "$T_TIMES.$$"
    all_spent=$(tr -s ' \n' '+' < "$T_TIMES.$$" | sed 's/\([0-9]*\)m/60*\1+/g; s/[s]//g; s/+$//')
}
run() { out=$(timeout "$patience" "$@" 2>&1); code=$?; } # both streams and the exit code, for says
says() { # code, text that must be there...
    if [ "$code" != "$1" ]; then printf '  exit %s, want %s: %s\n' "$code" "$1" "$out"; return 1; fi
    shift
    local t
    for t in "$@"; do
        if ! grep -qF -- "$t" <<< "$out"; then printf '  no "%s" in: %s\n' "$t" "$out"; return 1; fi
    done
}
wait_for() { # command...: until it succeeds
    local end=$((SECONDS + patience)) waiting=1
    until "$@"; do [ $SECONDS -lt $end ] || return 1; sleep 0.1; done
}
config() { # file [more keys of publish], then lines on standard input
    { echo "rig: $PWD/tests/data/rig4.yaml"
      echo "publish: {endpoints: [\"$volumes\"], sample: f32${2:+, $2}}"
      echo "control: {endpoint: \"$control\"}"
      cat; } > "$dir/$1"
}
start() { # log, command...: in the background; its id is $started
    local log=$1; shift
    : > "$dir/$log" # or what another left in it is read before the child has emptied it
    "$@" > "$dir/$log" 2>&1 &
    started=$!
    pids+=("$started")
}
free_ports() { # n: so many free TCP ports in the array ports, held until the end
    start ports.log "$py" -c 'import socket, sys, time
held = [socket.socket() for _ in range(int(sys.argv[1]))]
for s in held: s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1); s.bind(("", 0))
print(*(s.getsockname()[1] for s in held), flush=True); time.sleep(3000)' "$1"
    wait_for test -s "$dir/ports.log" && read -ra ports < "$dir/ports.log"
}
needs_private_net() { # where there is none, the test is skipped
    timeout "$patience" "$pyrovox" simcams --private-net --rig tests/data/rig4.yaml --ring 1 -- true > "$dir/try.log" 2>&1 ||
        { echo "no private network here: $(grep pyrovox "$dir/try.log" | tail -n 1)"; exit 77; }
}
status() { "$pyrovox" status --endpoint "$control" --timeout "$patience" --json 2>/dev/null; }
field() { # expression on the status s; under wait_for one process asks for some seconds, as two a question cost more than the daemon
    "$py" - "$control" "$1" "${waiting:+5}" <<'PY'
import json, sys, time, zmq
control, expression, some = sys.argv[1:]
end = time.monotonic() + float(some or 600)
socket = zmq.Context().socket(zmq.REQ)
socket.linger, socket.ipv6 = 0, "[" in control
socket.connect(control)
while True:
    socket.send(b'{"cmd":"status"}')
    if not socket.poll(max(1000 * (end - time.monotonic()), 0)):
        sys.exit(1)
    s = json.loads(socket.recv())
    try:
        if eval(expression):
            sys.exit(0)
    except (KeyError, IndexError):
        pass
    if not some or time.monotonic() > end:
        sys.exit(1)
    time.sleep(0.1)
PY
}
says_soon() { # text, command...: it runs until it has said that, and ends with 0 when it is interrupted
    local text=$1; shift
    start soon.log "$@"
    wait_for grep -qE -- "$text" "$dir/soon.log"; local r=$?
    kill -INT "$started"
    ended "$started" 0 && [ $r = 0 ]
}
sets() { status | "$py" -c 'import json, sys; print(json.load(sys.stdin)["sets"]["published"])'; }
published() { field "s['sets']['published'] >= $1"; }
ended() { # id, expected exit code
    wait "$1"; local got=$?
    [ $got = "$2" ] || { echo "  exit $got, want $2"; return 1; }
}
gone() { ! kill -0 "$1" 2>/dev/null; }
listen() { # [endpoint]: what a subscriber hears, a line each, until it is ended
    PYTHONPATH=proto/clients exec "$py" -u - "${1:-$volumes}" <<'PY'
import sys
import pyrovox_sub as pvx
with pvx.Subscriber(sys.argv[1]) as sub:
    for m in sub:
        print(m["type"], m.get("event") or m.get("rig", "")[:40].replace("\n", " "))
PY
}
heard() { grep -q -- "$1" "$dir/heard.log"; }
valid_nvdb() { # nanovdb_validate exits with 0 also where a grid has "failed", and says nothing of a good one
    nanovdb_validate "$1" > "$dir/nvdb.log" 2>&1 && ! grep -q failed "$dir/nvdb.log" || { cat "$dir/nvdb.log"; return 1; }
}
