#!/bin/bash
# What a daemon says beside its volumes: the rig to newcomers, events, previews on an endpoint of their own, which are
# made while somebody looks.
name=087
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy, zmq' 2>/dev/null || { echo "no python3 with numpy and zmq"; exit 77; }
export PYTHONPATH=proto/clients
config a.yaml << E2
cameras: "sim:"
fps: 20
record: {path: "$dir/take-%s.h5"}
E2
start daemon.log "$pyrovoxd" --config "$dir/a.yaml"
daemon=$started
check runs wait_for published 3
check no-previews-for-nobody field "s['previews'] == {'subscribers': 0, 'made': 0}"

previews() {
    "$py" - "$volumes.previews" "$dir/preview" <<'PY'
import sys
import pyrovox_sub as pvx
n, kinds, bad = 0, set(), 0
with pvx.Subscriber(sys.argv[1], 120000) as sub:
    for m in sub:
        kinds.add(m["type"])
        if m["type"] != "preview":
            continue
        for c in m["cameras"]:
            jpeg = c["jpeg"]
            # the picture is as large as is said, by the JPEG's own frame header
            at = next(i for i in range(len(jpeg)) if jpeg[i] == 0xFF and jpeg[i + 1] in (0xC0, 0xC2))
            size = int.from_bytes(jpeg[at + 7:at + 9], "big"), int.from_bytes(jpeg[at + 5:at + 7], "big")
            bad += jpeg[:2] != b"\xff\xd8" or size != (c["width"], c["height"]) or max(size) > 320
            bad += c["lit"] != c["silhouette"].sum() or not 0 < c["lit"] < c["silhouette"].size
        for i, c in enumerate(m["cameras"]):
            open(f"{sys.argv[2]}{i}.jpg", "wb").write(c["jpeg"])
        n += 1
        if n >= 5 and "rig" in kinds:
            break
print(n, kinds, bad)
sys.exit(bad > 0 or sub.malformed > 0 or [c["name"] for c in m["cameras"]] != ["cam0", "cam1", "cam2", "cam3"])
PY
}
check previews previews
decoded() { # by another's decoder; a flame of some colour is seen
    "$py" -c 'import sys
try: import cv2
except ImportError: sys.exit(0)
import glob
for f in glob.glob(sys.argv[1] + "*.jpg"):
    a = cv2.imread(f)
    if a is None or a.max() < 30: sys.exit(f)' "$dir/preview"
}
check jpegs-decode decoded
check they-were-made field "s['previews']['made'] >= 5"
check nobody-looks wait_for field "s['previews']['subscribers'] == 0"
made() { status | "$py" -c 'import json, sys; print(json.load(sys.stdin)["previews"]["made"])'; }
n=$(made); # one may have been asked for
m=$(sets); wait_for published $((m + 20))
check and-no-more-are-made [ "$(made)" -le $((n + 1)) ]

start heard.log listen
check hears-the-rig wait_for heard '^rig '
check rig-after-start [ "$(head -n 1 "$dir/heard.log" | cut -d ' ' -f 1)" = start ]
"$pyrovox" record --control "$control" --raw start > "$dir/said" 2>&1
check recording-begun wait_for heard "^event .*'recording_begun', 'path': '$dir/take-"
"$pyrovox" record --control "$control" --raw stop > "$dir/said" 2>&1
check recording-ended wait_for heard "^event .*'recording_ended'"
kill -TERM "$daemon"
check ends ended "$daemon" 0
# more sets than can be solved: what was dropped is told, and how many in all
config b.yaml <<< $'cameras: "sim:"\nfps: 1000\nthreads: 1'
start b.log "$pyrovoxd" --config "$dir/b.yaml"
daemon=$started
start heard.log listen
check drops-are-told wait_for heard "^event .*'kind': 'drops', 'sets': [1-9]"
kill -TERM "$daemon"
check b-ends ended "$daemon" 0

# the same by TCP, with an address of IPv6 and with localhost
free_ports 4
read -r port control_port more_port metrics_port <<< "${ports[*]}"
reads() { # host
    run "$pyrovox" record --endpoint "$volumes" --volumes 2 --quiet --out "$dir/by-$1"; says 0 || return 1
    run "$pyrovox" record --endpoint "tcp://$1:$more_port" --volumes 2 --quiet --out "$dir/all-$1"; says 0 || return 1
    run "$py" proto/clients/pyrovox_sub.py "$volumes" --frames 2 --timeout "$patience"; says 0 '2 volumes' || return 1
    start page.log "$pyrovox" view --endpoint "$volumes" --control="$control" --listen "$1:0"
    wait_for grep -q '#' "$dir/page.log" || return 1
    "$py" -c 'import sys, urllib.request
for url in sys.argv[1:]: urllib.request.urlopen(url)' "$(grep -om 1 'http://[^/]*/' "$dir/page.log")" "http://$1:$metrics_port/metrics" || return 1
    kill -INT "$started"; ended "$started" 130
}
reaches() { # host
    local volumes=tcp://$1:$port control=tcp://$1:$control_port r
    { echo "{rig: $PWD/tests/data/rig4.yaml, cameras: \"sim:\", fps: 20, insecure: true,"
      echo "publish: {endpoints: [\"$volumes\", \"tcp://*:$more_port\"]}, control: {endpoint: \"$control\"}, metrics: {endpoint: \"$1:$metrics_port\"}}"; } > "$dir/tcp.yaml"
    start tcp.log "$pyrovoxd" --config "$dir/tcp.yaml"
    local daemon=$started
    wait_for published 2 && reads "$1"; r=$?
    kill -TERM "$daemon"; ended "$daemon" 0 && [ $r = 0 ]
}
check localhost reaches localhost
if "$py" -c 'import socket; socket.socket(socket.AF_INET6).bind(("::1", 0))' 2> /dev/null; then
    check ipv6 reaches '[::1]'
    check ipv6-in-the-page grep -q 'http://\[::1\]:' "$dir/page.log"
else
    echo "SKIP $name:ipv6 (this host has no ::1)"
fi
exit $rc
