#!/bin/bash
# metrics.endpoint: Prometheus' text by the letter, the values of the status, what is refused, and clients that send nothing
# or rubbish.
name=089
. "$(dirname "$0")/lib.sh"
port=$("$py" -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
config a.yaml <<< "cameras: \"sim:\"
fps: 40
shared_clock: true
record: {keep_free_gb: 0, ring: {seconds: 3, memory: 500MB}}
triggers: [{name: a, when: light, above: 1e-4}, {name: b}]
metrics: {endpoint: \"127.0.0.1:$port\"}"
start a.log "$pyrovoxd" --config "$dir/a.yaml"
daemon=$started
check runs wait_for published 20
parsed() {
    status > "$dir/before.json"
    timeout "$patience" "$py" - "$port" "$dir/before.json" <<'PY'
import json, re, sys, urllib.request
r = urllib.request.urlopen(f"http://127.0.0.1:{sys.argv[1]}/metrics", timeout=60)
assert r.headers["Content-Type"].startswith("text/plain; version=0.0.4"), r.headers
text = r.read().decode()
assert text.endswith("\n")
helped, types, seen = set(), {}, {}
family = None
for line in text.split("\n")[:-1]:
    if line.startswith("# HELP "):
        family = line.split(" ", 3)[2]
        assert family not in helped, line
        helped.add(family)
    elif line.startswith("# TYPE "):
        _, _, n, t = line.split(" ")
        assert n == family and n not in types and t in ("counter", "gauge", "summary"), line
        assert (t == "counter") == n.endswith("_total"), line
        types[n] = t
    else:
        m = re.fullmatch(r'([a-zA-Z_:][a-zA-Z0-9_:]*)(\{(?:[a-zA-Z_]\w*="(?:[^"\\\n]|\\["\\n])*",?)*\})? (\S+)', line)
        assert m, line
        base = re.sub("_(count|sum)$", "", m[1]) if types.get(family) == "summary" else m[1]
        assert base == family and family in types, line
        assert (m[1], m[2]) not in seen, line
        seen[m[1], m[2]] = float(m[3])
before = json.load(open(sys.argv[2]))
assert seen["pyrovox_sets_published_total", None] >= before["sets"]["published"] >= 20
for d in before["drops"]:
    assert seen["pyrovox_sets_dropped_total", '{cause="%s"}' % d["name"]] >= d["value"], d
for c in before["cameras"]:
    for k, v in c["counts"].items():
        assert seen["pyrovox_camera_%s_total" % k, '{camera="%s"}' % c["name"]] >= v, (c["name"], k)
assert seen["pyrovox_latency_seconds", '{quantile="0.5"}'] > 0
n, total = (seen["pyrovox_latency_seconds_" + k, None] for k in ("count", "sum"))
assert n > 0 and 0 < total <= n * seen["pyrovox_latency_seconds", '{quantile="1"}'] * (1 + 1e-6), (n, total)
PY
}
check by-the-letter-and-true parsed
refuses() {
    timeout "$patience" "$py" - "$port" <<'PY'
import socket, sys, urllib.request, urllib.error
base = f"http://127.0.0.1:{sys.argv[1]}"
def code(path, method="GET"):
    try: return urllib.request.urlopen(urllib.request.Request(base + path, method=method), timeout=60).status
    except urllib.error.HTTPError as e: return e.code
assert code("/metrics") == 200 and code("/") == 404 and code("/metrics/x") == 404 and code("/metrics", "POST") == 405
idle = []
for i in range(200):
    s = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
    if i % 2: s.send(b"\x00\xff rubbish \r\n\r\n" * 3)
    idle.append(s)
PY
}
check refuses-the-rest refuses
held() { # with 200 connections held open, which send nothing: a scrape has to wait its turn, sets do not
    start idle.log "$py" -c 'import socket, sys, time
a = [socket.create_connection(("127.0.0.1", int(sys.argv[1]))) for _ in range(200)]
print("held", flush=True); time.sleep(3000)' "$port"
    wait_for grep -q held "$dir/idle.log" || return 1
    local n; n=$(sets)
    wait_for published $((n + 40)) && wait_for parsed 2> "$dir/turns.log"
    local r=$?
    kill "$started"; return $r
}
check two-hundred-that-send-nothing held
second() {
    sed "s#$control#$control-2#; s#$volumes#$volumes-2#" "$dir/a.yaml" > "$dir/b.yaml"
    run "$pyrovoxd" --config "$dir/b.yaml"; says 1 "127.0.0.1:$port is in use" 'a port of its own'
}
check in-use second
bad() { sed "s#127.0.0.1:$port#$1#; s#$control#$control-2#; s#$volumes#$volumes-2#" "$dir/a.yaml" > "$dir/c.yaml"; run "$pyrovoxd" --config "$dir/c.yaml"; says 1 "$2"; }
check all-hosts-are-refused bad 0.0.0.0:9464 'other hosts reach'
check no-port bad 127.0.0.1 'should be an address and a port'
check no-address bad somewhere:80 'should be an address and a port'
kill -TERM "$daemon"
check ends ended "$daemon" 0
exit $rc
