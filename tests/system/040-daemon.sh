#!/bin/bash
# The daemon on sim: cameras: status, volumes, control requests, a second daemon, a subscriber that never
# reads, and a clean end.
name=040
. "$(dirname "$0")/lib.sh"
config a.yaml <<< $'cameras: "sim:"\nfps: 40\nshared_clock: true'
start a.log "$pyrovoxd" --config "$dir/a.yaml"
daemon=$started

check volumes-are-published wait_for published 20
check status-is-consistent field \
    "s['sets']['produced'] == s['sets']['published'] + s['sets']['dropped'] + s['sets']['inside']"
check status-names-cameras wait_for field \
    "[c['name'] for c in s['cameras']] == ['cam0','cam1','cam2','cam3'] and all(c['state'] == 'running' for c in s['cameras'])"
check status-has-skews wait_for field \
    "len(s['skew']['edges_us']) == 28 and all(c['skew']['n'] > 5 and sum(c['skew']['bins']) == c['skew']['n'] and c['troubles'] == [] or c['troubles'] for c in s['cameras'])"
check skews-for-people grep -q '^spread of a set .*|.*|$' <("$pyrovox" status --endpoint "$control")
check status-for-people grep -q '^latency' <("$pyrovox" status --endpoint "$control")
says_good() { # and without cameras that run, bad
    "$pyrovox" status --endpoint "$control" --exit-code > "$dir/good.txt" && tail -n 1 "$dir/good.txt" | grep -qE '^good: (residual [0-9.]+ % \(noise allows [0-9.]+ %\), 4 cameras agree|4 cameras agree)'
}
check status-ends-with-a-verdict wait_for says_good
check top-prints-lines says_soon sets/s "$pyrovox" top --endpoint "$volumes" --truth 1,2
check record "$pyrovox" record --quiet --endpoint "$volumes" --volumes 5 --out "$dir/rec"
check recorded-files [ "$(ls "$dir"/rec/*.npy 2>/dev/null | wc -l)" = 5 ]

second() {
    timeout "$patience" "$pyrovoxd" --config "$dir/a.yaml" > "$dir/second.log" 2>&1
    [ $? = 1 ] && grep -q "in use" "$dir/second.log"
}
check second-daemon-is-refused second
n=$(sets)
check first-goes-on wait_for published $((n + 10))

requests() {
    timeout "$patience" "$py" - "$control" <<'PY'
import json, sys, zmq
ctx = zmq.Context()
def ask(raw, parts=False):
    s = ctx.socket(zmq.REQ); s.linger = 0; s.rcvtimeo = 600000; s.connect(sys.argv[1])
    s.send_multipart(raw) if parts else s.send(raw)
    r = json.loads(s.recv()); s.close(); return r
assert ask(b'{"cmd":"ping"}')["ok"] is True
for bad in (b"", b"{", b"\xff" * 100, b"[]", b'{"cmd":"nothing"}', b'{"cmd":1}', b" " * 5000, b"[" * 4000):
    assert "error" in ask(bad), bad
assert "error" in ask([b"[", b"]"], True)
s = ctx.socket(zmq.REQ); s.linger = 0; s.rcvtimeo = 500; s.connect(sys.argv[1]); s.send(b" " * (1 << 20))
try: s.recv(); assert False, "a request of a megabyte was answered"
except zmq.Again: pass
assert ask(b'{"cmd":"log-level","level":"debug"}')["ok"] is True
assert ask(b'{"cmd":"ping"}')["ok"] is True
PY
}
if "$py" -c 'import zmq' 2>/dev/null; then
    check control-survives-anything requests
    # a subscriber that never reads: it loses, the daemon does not
    start lazy.log "$py" -c 'import sys, time, zmq
s = zmq.Context().socket(zmq.SUB); s.rcvhwm = 1; s.subscribe(b""); s.connect(sys.argv[1]); time.sleep(3000)' "$volumes"
    lazy=$started
    n=$(sets)
    check lazy-subscriber-does-not-hold-up wait_for published $((n + 100))
    kill "$lazy"
else
    echo "SKIP $name:control-survives-anything (no python3-zmq)"
fi

check stop-command "$pyrovox" status --endpoint "$control" --stop
check ends-with-0 ended "$daemon" 0
check summary grep -q 'published, ' "$dir/a.log"
check sockets-are-removed [ -z "$(ls "$dir" | grep -E '^(volumes|control)')" ]

start b.log "$pyrovoxd" --config "$dir/a.yaml"
daemon=$started
check starts-again wait_for published 5
kill -TERM "$daemon"
check sigterm-ends-with-0 ended "$daemon" 0
check no-daemon-no-status bash -c "! '$pyrovox' status --endpoint '$control' --timeout 0.3 2>/dev/null"
exit $rc
