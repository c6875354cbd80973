#!/bin/bash
# What comes after days, months, years: the built programs across it.  Uptimes, the cameras' clocks and their frame
# numbers go past the places where counters of 32, 53, 63 bits end, 2038 comes, the time of day is set, certificates
# and keys run out.  The kernel shows a namespace of its own another uptime (unshare -T), libfaketime another date, simcams
# serves the rest; nothing is mocked.  What each camera said and when it exposed is read from the take that is made.
#   LAPSE_S=n: n seconds (4) past each, for the accuracies that it prints
name=058
. "$(dirname "$0")/lib.sh"
if ! why=$(timeout "$patience" unshare -rT --monotonic 1000 --boottime 1000 true 2>&1); then
    echo "no time namespaces here: $why"; exit 77
fi
needs_private_net
"$py" -c 'import h5py, numpy' 2> "$dir/null" || { echo "no python3-h5py"; exit 77; }
# another date for who is told it by a file, "+SECONDS"; the other clocks stay what they are
faketime=$(faketime -m -f +0 env 2> "$dir/null" | sed -n 's/^LD_PRELOAD=//p')
dated() { # file, command...
    local file=$1; shift
    exec env "LD_PRELOAD=$faketime" FAKETIME_CACHE_DURATION=1 FAKETIME_DONT_FAKE_MONOTONIC=1 "FAKETIME_TIMESTAMP_FILE=$file" "$@"
}
date_is() { echo "$2" > "$1.new" && mv "$1.new" "$1"; }

cat > "$dir/lapse.py" <<'PY'
"""One case: lapse.py DIR CASE UPTIME TICK_HZ CLOCK FIRST WIDE DATE SET; UPTIME, CLOCK, DATE [s], FIRST: what is crossed, 0:
nothing; SET [s]: the time of day is set by so much, and back."""
import json, os, subprocess, sys, time
import h5py
import numpy as np

dir, case, *numbers = sys.argv[1:]
UPTIME, TICK_HZ, CLOCK, FIRST, WIDE, DATE, SET = (float(n) for n in numbers)
PYROVOX, PYROVOXD, FAKETIME = (os.environ[k] for k in ("pyrovox", "pyrovoxd", "faketime"))
MORE_S, PATIENCE_S, FPS, SETS = float(os.environ.get("LAPSE_S", 4)), int(os.environ["patience"]), 10, 30
PPM = [80, -60, 0, 200]
at = f"{dir}/{case}"
ask = [PYROVOX, "status", "--endpoint", f"ipc://{at}-control", "--timeout", os.environ["patience"]]
failed = False

def check(what, ok, more=""):
    global failed
    failed |= not ok
    print("PASS" if ok else "FAIL", f"058:{case}-{what}", "" if ok else more, flush=True)
    return ok

def status():
    out = subprocess.run(ask + ["--json"], capture_output=True).stdout
    return json.loads(out) if out else None

def until(true):
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        s = status()
        if s and "sets" in s and true(s): return s
        time.sleep(0.2)
    return None

def date(seconds):
    with open(f"{at}.date.new", "w") as f: f.write("+%d\n" % seconds)
    os.replace(f"{at}.date.new", f"{at}.date")

def record(what, *more):
    return subprocess.run([PYROVOX, "record", "--raw", what, "--control", f"ipc://{at}-control", *more], capture_output=True).returncode == 0

def run(lead):
    """The take, across UPTIME, CLOCK, FIRST and DATE `lead` seconds after the start; None: too late for it."""
    take = f"{at}-{lead}.h5"
    more = 'features: {GevGVSPExtendedIDMode: "On"}' if WIDE else ""
    open(f"{at}.yaml", "w").write(f"""rig: {os.getcwd()}/tests/data/rig4.yaml
cameras: "aravis:127.0.0.2+"
fps: {FPS}
pixel_format: RGB8
photometry: {{black: 0.02}}
publish: {{endpoints: ["ipc://{at}-volumes"]}}
control: {{endpoint: "ipc://{at}-control"}}
record: {{keep_free_gb: 0}}
{more}
""")
    now = time.monotonic()
    away = int(UPTIME - lead - now) if UPTIME else 2 - int(now)  # or as if it had booted just now
    crossed = now + lead + 1
    daemon = [PYROVOXD, "--config", f"{at}.yaml"]
    if DATE or SET:
        daemon = ["env", "LD_PRELOAD=" + FAKETIME, "FAKETIME_CACHE_DURATION=1", "FAKETIME_DONT_FAKE_MONOTONIC=1", f"FAKETIME_TIMESTAMP_FILE={at}.date", *daemon]
        date(DATE - lead - time.time() if DATE else 0)
    command = ["unshare", "-rT", "--monotonic", str(away), "--boottime", str(away), PYROVOX, "simcams", "--private-net",
               "--rig", "tests/data/rig4.yaml", "--fps", str(FPS), "--ring", str(FPS), "--boot-clock", "--tick-hz", str(TICK_HZ),
               "--control"]
    for c, p in enumerate(PPM): command += ["--set", f"drift cam{c} {p}"]
    if CLOCK: command += ["--set", f"skew all {int((CLOCK - lead) * 1e6)}"]
    if FIRST: command += ["--at", f"0:ids all {int(FIRST) - FPS * lead}"]
    sim = subprocess.Popen(command + ["--"] + daemon, stdin=subprocess.PIPE, stdout=open(f"{at}.log", "w"), stderr=subprocess.STDOUT)
    try:
        s = until(lambda s: s["sets"]["complete"] >= 5)
        if not check("begins", s is not None and record("start", "--out", take), str(s)): return None
        time.sleep(max(0, max(crossed, time.monotonic() + lead + 1 if FIRST else 0) - time.monotonic()))
        for k, step in enumerate((SET, 0) if SET else ()):
            date(step)
            since = status()["sets"]["published"]
            found = until(lambda s: s["host_clock"]["steps"] > k and s["sets"]["published"] >= since + SETS)
            if not check("is found and goes on", found and abs(abs(found["host_clock"]["last_step_s"]) - SET) < 60, str(found and found["host_clock"])): return None
        at_it = status()["sets"]["published"]
        time.sleep(MORE_S)
        s = until(lambda s: s["sets"]["published"] >= at_it + SETS and s["sets"]["complete"] >= 2 * SETS)
        if not check("goes on past it", s is not None and record("stop"), str(status() and status()["sets"])): return None
        sim.stdin.write(b"stats\n"); sim.stdin.flush()
        check("ends", subprocess.run(ask + ["--stop"], capture_output=True).returncode == 0 and sim.wait(PATIENCE_S) == 0)
        return judge(take, s)
    finally:
        sim.terminate(); sim.wait()

def judge(take, s):
    """None: what was to be crossed was crossed before it was recorded."""
    with h5py.File(take) as f:
        frames = [f[f"cameras/cam{c}/index"][:] for c in range(4)]
    frames = [r[np.argsort(r["t_device_ns"])] for r in frames] # those that made no set may come later
    past = [(field, to) for field, to in (("t_arrival_mono_ns", UPTIME * 1e9), ("t_device_ns", CLOCK * 1e9), ("id", FIRST), ("t_arrival_ns", DATE * 1e9)) if to]
    if any(r[field][0] >= to for field, to in past for r in frames): return None
    for field, to in past:
        check(f"{field} goes past it", all(r[field][-1] > to for r in frames), str([(r[field][0], r[field][-1]) for r in frames]))
    period = 10**9 // FPS
    odd, off = [], []
    for c, r in enumerate(frames):
        step, by_number = np.diff(r["t_device_ns"]) * (1 - PPM[c] * 1e-6) / period, np.diff(r["id"])
        odd += [(c, int(r["id"][i]), int(r["id"][i + 1]), step[i]) for i in np.flatnonzero((np.rint(step) != by_number) & (step < FPS / 2))] # longer: it was opened anew
        # the cameras' exposures are at whole periods of the host's time of day
        t = r["t_exposure_ns"][r["t_arrival_mono_ns"] > r["t_arrival_mono_ns"][0] + 5 * 10**9]
        off.append((t + period // 2) % period - period // 2)
    check("numbers and stamps agree", not odd, str(odd[:4]))
    off_us = [float(np.median(np.abs(o))) * 1e-3 for o in off]
    spread = np.percentile(np.abs(np.concatenate(off)), [50, 99]) * 1e-3
    check("exposures are where they were", max(off_us) < 5000, str(off_us))
    drift = [c["drift_ppm"] + p for c, p in zip(s["cameras"], PPM)]
    check("clocks are known", all(abs(d) < 20 for d in drift), str(drift))
    # what a busy machine cannot do
    counts = {k: sum(c["counts"][k] for c in s["cameras"]) for k in ("bad_stamp", "clock_stuck", "clock_jump", "slip")}
    check("nothing odd is counted", not any(counts.values()) and s["host_clock"]["steps"] == (2 if SET else 0), f"{counts} {s['host_clock']}")
    check("sums", s["sets"]["produced"] == s["sets"]["published"] + s["sets"]["dropped"] + s["sets"]["inside"], str(s["sets"]))
    print("#    %-12s exposures off by %6.1f us (median), %6.1f (99 %%); drifts by %s ppm; sets %d" %
          (case, *spread, " ".join("%.2f" % d for d in drift), s["sets"]["complete"]), flush=True)
    return True

for lead in (15, 60, 240):
    done = run(lead)
    if done or failed: break
if not done and not failed: check("was crossed while frames came", False)
sys.exit(failed)
PY

# name, uptime [s], ticks of the cameras' clocks a second, what these cross [s], frame number that is crossed, 64 bit?, date,
# by how much the time of day is set
cases() {
    lapse 2^32-us  4294.967296      1e6  4294.967296          65536            0 2147483648 0
    lapse 2^32-ms  4294967.296      1e9  2147483.648          65536            1 0          31536000
    lapse 68-years 2147483648       1e10 922337203.6854775808 9007199254740000 1 0          0
    [ -n "${T_LONG:-}" ] || return 0
    lapse boot     0                1e9  0                    0                0 0          0
    lapse 2^53-ns  9007199.25474099 1e9  9007199.25474099     4294967296       1 0          0
}
lapse() {
    local what=$1; shift
    [ "$6 $7" = "0 0" ] || [ -n "$faketime" ] || { echo "SKIP $name:$what-its-date (no faketime)"; set -- "${@:1:5}" 0 0; }
    pyrovox=$pyrovox pyrovoxd=$pyrovoxd faketime=$faketime timeout 1100 "$py" "$dir/lapse.py" "$dir" "$what" "$@" > "$dir/$what.out" 2>&1 &
    pids+=($!) all+=("$what")
}
all=() first=${#pids[@]}
cases
for k in "${!all[@]}"; do
    wait "${pids[first + k]}" || { rc=1; mv "$dir/${all[k]}.out" "$dir/${all[k]}-said.log"; cat "$dir/${all[k]}-said.log"; continue; }
    cat "$dir/${all[k]}.out"
done

# ---- set numbers and times that come after years: of a recording, over the wire, into another ---------------------------

film() {
    start film.log timeout "$patience" "$pyrovox" record --endpoint "$volumes" --out "$dir/film.h5" --format hdf5
    "$b/tests/unit/test_pub" --publish "$volumes" 40 0 > "$dir/pub.log" 2>&1
    ended "$started" 0 && "$pyrovox" convert --format npy "$dir/film.h5" "$dir/film" > "$dir/convert.log" 2>&1
}
check film film
after() { # first set, seconds since 1970
    "$py" - "$dir/film" "$1" "$2" <<'PY' || return 1
import glob, json, os, sys
files = sorted(glob.glob(sys.argv[1] + "/*[0-9].json"))
rows = [json.load(open(f)) for f in files]
by, ns = int(sys.argv[2]) - rows[0]["set"], int(sys.argv[3]) * 10**9 - rows[0]["t_exposure_ns"]
for f, r in reversed([*zip(files, rows)]): # named after the set
    at = "%s/%06d" % (sys.argv[1], r["set"] + by)
    json.dump({**r, "set": r["set"] + by, "t_exposure_ns": r["t_exposure_ns"] + ns}, open(f, "w"))
    os.rename(f, at + ".json"); os.rename(f[:-4] + "npy", at + ".npy")
PY
    rm -f "$dir/again.h5"
    start play.log timeout "$patience" "$pyrovox" play "$dir/film" --speed 0 --endpoint "$volumes"
    timeout "$patience" "$pyrovox" record --endpoint "$volumes" --out "$dir/again.h5" --format hdf5 > "$dir/record.log" 2>&1
    ended "$started" 0 || return 1
    PYTHONPATH=proto/clients/python "$py" - "$dir/film" "$dir/again.h5" <<'PY'
import sys
import pyrovox
was, now = (list(pyrovox.open(f)) for f in sys.argv[1:])
def of(all): return [(v.set, v.t_exposure_ns) for v in all]
if of(was) != of(now) or len(was) < 30: sys.exit("  %s\n  %s" % (of(was)[:3], of(now)[:3]))
PY
}
check sets-past-2^32 after 4294967280 2147483640
check sets-past-2^53 after 9007199254740980 4102444800

# ---- a certificate that is renewed, or not as it should ------------------------------------------------------------------

papers() { # name, days from now that it begins
    faketime -f "+$2d" openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 60 -subj /CN=localhost \
        -addext subjectAltName=DNS:localhost -keyout "$dir/$1.key" -out "$dir/$1.pem" 2> "$dir/null"
}
put() { cp "$dir/$1" "$dir/new" && mv "$dir/new" "$dir/$2"; }
meets() { # the certificate that who comes is shown
    "$py" -c 'import ssl, sys
sys.exit(ssl.get_server_certificate(("127.0.0.1", int(sys.argv[1]))).split() != open(sys.argv[2]).read().split())' "$port" "$dir/$1.pem"
}
said() { grep -qF -- "$1" "$dir/view.log"; }
certificate() {
    date_is "$dir/date" +0d
    papers first 0 && papers second 65 && papers third 65 && put first.pem cert.pem && put first.key cert.key || return 1
    start view.log dated "$dir/date" "$pyrovox" view --listen 127.0.0.1:0 --host localhost "$dir/film.h5" \
        --cert "$dir/cert.pem" --cert-key "$dir/cert.key"
    wait_for grep -q '#' "$dir/view.log" || return 1
    local url; url=$(grep -m1 '#' "$dir/view.log")
    port=${url%%/#*} port=${port##*:}
    check first-certificate meets first
    # a page that stays open
    start page.log env PYTHONPATH=tests/view "$py" -u -c 'import sys
from ws import WebSocket
ws = WebSocket(("localhost", int(sys.argv[1])), host="localhost:" + sys.argv[1], tls=sys.argv[2])
ws.say(token=sys.argv[3])
while True: ws.say(credits=1); ws.volume(600); print("lives")' "$port" "$dir/first.pem" "${url#*#}"
    check a-page-is-open wait_for grep -q lives "$dir/page.log"
    # the next one before its time, as by a clock that is wrong
    put second.pem cert.pem && put second.key cert.key
    check not-before-its-time meets first
    check and-why said 'the certificate is valid from'
    date_is "$dir/date" +70d # when the first has run out
    check renewed wait_for meets second
    check and-said said "cert.pem is used from now on"
    # the certificate is there, its key is not yet
    put third.pem cert.pem
    check goes-on-without-its-key meets second
    check and-again meets second
    check why-not said 'not the key of'
    put third.key cert.key
    check with-its-key meets third
    : > "$dir/page.log"
    check the-page-lives-on wait_for grep -q lives "$dir/page.log"
    check said-once [ "$(grep -c 'not the key of' "$dir/view.log")" = 1 ]
}
if [ -n "$faketime" ] && command -v openssl > "$dir/null"; then check certificate certificate
else echo "SKIP $name:certificate (no faketime or no openssl)"; fi

# ---- another key of the daemon, while it runs, takes and is read ----------------------------------------------------------

keys() {
    start port.log "$py" -c 'import socket, time
s = socket.socket(); s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1); s.bind(("", 0))
print(s.getsockname()[1], flush=True); time.sleep(3000)' # who holds it without listening lets the daemon have it
    wait_for test -s "$dir/port.log" || return 1
    local port; port=$(cat "$dir/port.log")
    net=tcp://127.0.0.1:$port
    for k in lab next; do "$pyrovox" keygen "$dir/$k" > "$dir/said" || return 1; done
    "$pyrovox" keygen "$dir/anna" --server "$dir/lab.pub" > "$dir/said" && cp "$dir/anna.pub" "$dir/clients.keys" || return 1
    { echo "rig: $PWD/tests/data/rig4.yaml"
      echo "publish: {endpoints: [\"tcp://*:$port\"]}"
      echo "control: {endpoint: \"$control\"}"
      echo $'cameras: "sim:"\nfps: 10\nkeys: {server: lab.key, clients: clients.keys}\nrecord: {path: "'"$dir"'/keys.h5", mode: raw, keep_free_gb: 0}'
    } > "$dir/keys.yaml"
    start keys.log "$pyrovoxd" --config "$dir/keys.yaml"
    daemon=$started
    wait_for published 5 || return 1
    start anna.log "$pyrovox" record --endpoint "$net" --key "$dir/anna.key" --out "$dir/out" --format npy
    anna=$started
    check reads wait_for have 3
    { cat "$dir/next.key" > "$dir/new" && chmod 600 "$dir/new" && mv "$dir/new" "$dir/lab.key"; } || return 1
    kill -HUP "$daemon"
    check read-again wait_for grep -q 'keys: read again, clients listed: 1' "$dir/keys.log"
    check the-old-one-is-put-out wait_for gone "$anna"
    kill "$anna" 2> "$dir/null"
    check and-has-failed ended "$anna" 1
    check and-told grep -q 'another key than' "$dir/anna.log"
    check it-goes-on wait_for published $(($(sets) + 5))
    { grep -v '^server ' "$dir/anna.key"; sed -n 's/^public /server /p' "$dir/next.key"; } > "$dir/new" &&
        cat "$dir/new" > "$dir/anna.key" || return 1
    check with-the-new-one anna_reads
    echo nonsense > "$dir/lab.key"; : > "$dir/clients.keys"
    kill -HUP "$daemon"
    check not-read wait_for grep -q 'keys stay as they were: .*lab.key' "$dir/keys.log"
    check both-stay anna_reads
    "$pyrovox" status --endpoint "$control" --stop > "$dir/said"
    check keys-end ended "$daemon" 0
    check one-take grep -q '; 0 sets and 0 frames could not be recorded' "$dir/keys.log"
}
have() { [ "$(find "$dir/out" -name '*.npy' 2> "$dir/null" | wc -l)" -ge "$1" ]; }
anna_reads() { timeout "$patience" "$pyrovox" record --endpoint "$net" --key "$dir/anna.key" --volumes 3 --out "$dir/out-$RANDOM" -q > "$dir/said" 2>&1; }
check keys keys
exit $rc
