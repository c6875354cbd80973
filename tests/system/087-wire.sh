#!/bin/bash
# What a daemon says beside its volumes: the rig to newcomers, events, previews on an endpoint of their own, which are
# made while somebody looks; a reader of protocol 1.0 reads it all and misses nothing.
name=087
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy, zmq' 2>/dev/null || { echo "no python3 with numpy and zmq"; exit 77; }
export PYTHONPATH=proto/clients:tests/lib
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

old() { # the reader of 1.0, as it was
    "$py" -u - "$volumes" <<'PY'
import sys
import pyrovox_sub_1_0 as pvx
n = 0
with pvx.Subscriber(sys.argv[1], 120000) as sub:
    for m in sub:
        n += m["type"] == "volume"
        if m["type"] == "end":
            break
print(f"{n} volumes, {sub.lost} lost, {sub.malformed} malformed, {sub.received} messages")
PY
}
start old.log old
old=$started
start heard.log listen
check hears-the-rig wait_for heard '^rig '
check rig-after-start [ "$(head -n 1 "$dir/heard.log" | cut -d ' ' -f 1)" = start ]
"$pyrovox" record --control "$control" --raw start > "$dir/said" 2>&1
check recording-begun wait_for heard "^event .*'recording_begun', 'path': '$dir/take-"
"$pyrovox" record --control "$control" --raw stop > "$dir/said" 2>&1
check recording-ended wait_for heard "^event .*'recording_ended'"
kill -TERM "$daemon"
check ends ended "$daemon" 0
wait "$old"
check reads-as-1.0 grep -q ' volumes, 0 lost, 0 malformed' "$dir/old.log"
# more sets than can be solved: what was dropped is told, and how many in all
config b.yaml <<< $'cameras: "sim:"\nfps: 1000\nthreads: 1'
start b.log "$pyrovoxd" --config "$dir/b.yaml"
daemon=$started
start heard.log listen
check drops-are-told wait_for heard "^event .*'kind': 'drops', 'sets': [1-9]"
kill -TERM "$daemon"
check b-ends ended "$daemon" 0
exit $rc
