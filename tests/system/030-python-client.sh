#!/bin/bash
# The Python client reads the golden messages and a live publisher as the C side wrote them.
name=030
. "$(dirname "$0")/lib.sh"
"$py" -c 'import numpy, zmq' 2>/dev/null || { echo "no python3 with numpy and zmq (apt-get install python3-numpy python3-zmq)"; exit 77; }
export PYTHONPATH=proto/clients

golden() {
    "$py" - <<'PY'
import glob, json, sys
import numpy as np
import pyrovox_sub as pvx
bad, names = 0, sorted(glob.glob("proto/vectors/*.bin"))
for name in names:
    raw = open(name, "rb").read()
    got, want = pvx.decode(raw), json.load(open(name[:-4] + ".json"))
    if want["type"] in ("volume", "bars"):
        nx, ny, nz = want["n"]
        dense = np.zeros((nz * ny * nx, want["channels"]), np.float32)
        for index, *value in want.pop("voxels"):
            dense[index] = value
        dense = dense.reshape(nz, ny, nx, -1)
        have = got.pop("dense" if want["type"] == "volume" else "sd")
        if have.dtype != np.float32 or have.shape != dense.shape or not np.array_equal(have, dense):
            print(f"{name}: voxels differ"); bad += 1
    for camera in got.get("cameras", ()):
        camera["jpeg"], camera["silhouette"] = camera["jpeg"].hex(), camera["silhouette"].astype(int).tolist()
    for key in want:
        if got.get(key) != want[key]:
            print(f"{name}: {key} = {got.get(key)!r}, want {want[key]!r}"); bad += 1
    for cut in range(0, len(raw), 7):  # cut short: refused, whatever is missing
        try:
            pvx.decode(raw[:cut]); print(f"{name}: {cut} bytes were taken"); bad += 1
        except pvx.BadMessage:
            pass
sys.exit(bad > 0 or len(names) < 13)
PY
}
check golden_messages golden

documented() { # the example in PROTOCOL.md is the golden message
    "$py" - <<'PY'
import re, sys
lines = re.findall(r"^([0-9a-f]{4})  ((?:[0-9a-f]{2} ){7,16})", open("proto/PROTOCOL.md").read(), re.M)
data = bytes.fromhex("".join(x for _, x in lines))
want = open("proto/vectors/volume-f16-clamped.bin", "rb").read()
sys.exit(len(data) != 312 or data != want[:312] or [int(a, 16) for a, _ in lines] != list(range(0, 312, 16)))
PY
}
check protocol_example documented

claims() { # a few bytes that say 1024^3 voxels, another grid than the start's: nothing is asked for
    "$py" - <<'PY'
import resource, struct, sys
import pyrovox_sub as pvx
resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
at, bad = pvx.HEADER.size + struct.calcsize("<4IQ4qQI"), 0
volume = open("proto/vectors/volume-f16-clamped.bin", "rb").read()
vast = volume[:at] + struct.pack("<3I", 1024, 1024, 1024) + volume[at + 12:]
small = pvx.decode(volume)
for name, how in ("vast", (vast,)), ("limit", (volume, 4 * 12 - 1)), \
                 ("other", (volume, 1 << 20, {**small, "n": [3, 2, 3]})), \
                 ("moved", (volume, 1 << 20, {**small, "min": [0, 0, 9.0]})):
    try:
        pvx.decode(*how); print(f"{name} was taken"); bad += 1
    except pvx.BadMessage:
        pass
pvx.decode(volume, 4 * 12, small)
sys.exit(bad)
PY
}
check claims_of_room claims

without_liblz4() { # what the library makes of a block, whole or damaged, the page makes by itself
    "$py" - <<'PY'
import resource, sys
import pyrovox_sub as pvx
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
found, tried, bad = pvx.library, 0, 0
def outcome(library, data, size):
    pvx.library = library
    try:
        return pvx.decompress(1, data, size)
    except pvx.BadMessage:
        return None
def compare(data, size, zeroed=False):
    global tried, bad
    want, got = outcome(found, data, size), outcome(lambda name: None, data, size)
    tried += want is not None
    if zeroed and got is None:  # a distance of 0 is none, and liblz4 lets it pass
        return
    bad += got != want
raw = open("proto/vectors/volume-f16-lz4-rgb.bin", "rb").read()
want = pvx.decode(raw)["dense"]
pvx.library = lambda name: None
bad += (pvx.decode(raw)["dense"] != want).any()
fields = pvx.VOLUME.unpack_from(raw, 48)
data, size = raw[48 + fields[0] + 4 * fields[-4]:], fields[-2]
assert len(data) == fields[-1] < size
for at in range(len(data)):
    compare(data[:at], size)
    for value in 0, 1, 15, 16, 240, 255, data[at] ^ 1, data[at] ^ 128:
        compare(data[:at] + bytes([value]) + data[at + 1:], size, value == 0)
compare(b"\x1fA\x01\x00" + b"\xff" * 4000 + b"\x00\x50abcde", 4000 * 255 + 25)  # runs, and one that claims too much
compare(b"\x1fA\x01\x00" + b"\xff" * 10_000_000 + b"\x00\x50abcde", 1000)
print(f"{tried} blocks alike, {bad} not")
sys.exit(bad > 0 or tried < 500)
PY
}
check without_liblz4 without_liblz4

live() { # volumes, every n-th left out
    "$b/tests/unit/test_pub" --publish "$volumes" "$1" "$2" & pub=$!; pids+=("$pub")
    timeout "$patience" "$py" - "$volumes" "$1" "$2" <<'PY'
import sys
import numpy as np
import pyrovox_sub as pvx
endpoint, volumes, skip = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
sets, bad = [], 0
with pvx.Subscriber(endpoint, 20000) as sub:
    for m in sub:
        if m["type"] == "volume":
            i, s = np.arange(720), m["set"]
            want = (s % 64 + (i % 8) / 8)[:, None] + 64 * np.arange(3)[None, :]
            want[i % 3 != s % 3] = 0
            bad += not np.array_equal(m["dense"], want.reshape(8, 9, 10, 3))
            sets.append(s)
        if m["type"] == "end":
            break
want = [s for s in range(volumes) if not skip or (s + 1) % skip]
if sets != want or bad or sub.malformed or sub.lost != volumes - len(want):
    print(f"{len(sets)} volumes of {len(want)}, {bad} wrong, lost {sub.lost}"); sys.exit(1)
PY
    local r=$?
    wait "$pub" || r=1
    return $r
}
check live_values live 40 0
check live_gaps live 40 5

saved() {
    "$b/tests/unit/test_pub" --publish "$volumes" 6 0 & pub=$!; pids+=("$pub")
    timeout "$patience" "$py" proto/clients/pyrovox_sub.py "$volumes" --frames 3 --save "$dir/out" > "$dir/log" || { cat "$dir/log"; return 1; }
    wait "$pub"
    tail -n 1 "$dir/log" | grep -q '^3 volumes, 0 messages lost' || { cat "$dir/log"; return 1; }
    "$py" -c 'import numpy,sys; a=numpy.load(sys.argv[1]); sys.exit(a.shape != (8,9,10,3))' "$dir/out/000002.npy"
}
check program_saves saved

refused() { # more than the client allows: one sentence, nothing of it is read
    "$b/tests/unit/test_pub" --publish "$volumes" 6 0 no-end & pub=$!; pids+=("$pub")
    timeout "$patience" "$py" proto/clients/pyrovox_sub.py "$volumes" --memory 0 > "$dir/log" 2>&1
    local r=$?
    kill "$pub" 2> /dev/null; wait "$pub"
    [ $r = 1 ] && grep -q '^pyrovox_sub.py: .* --memory MIB allows more$' "$dir/log" || { cat "$dir/log"; return 1; }
}
check too_large_is_refused refused
exit $rc
