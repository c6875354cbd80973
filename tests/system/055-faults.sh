#!/bin/bash
# The built daemon before four cameras of the real GigE Vision protocol that go wrong one way after the
# other while it runs: every fault is found, counted by its cause, told once, and over without a restart;
# cameras are used again after they are back.  What a test cannot do to a host it shares, sim: cameras do:
# their frames arrive as if its clock had been set, or find no buffer as if it were too slow.
name=055
. "$(dirname "$0")/lib.sh"
needs_private_net
"$py" -c 'import zmq' 2> "$dir/null" || { echo "no python3-zmq"; exit 77; }

# The cameras' clocks count from their start: the daemon has to map them.
config run.yaml <<< $'cameras: "aravis:127.0.0.2+"\nfps: 20\npixel_format: RGB8\nsync: {policy: solve-with-what-is-there, min_cameras: 1}\ngige: {resend: never, packet_size: 1400}\nphotometry: {black: 0.02}'
# On a trigger line, with PTP clocks.
config line.yaml <<< $'cameras: "aravis:127.0.0.2+"\nfps: 20\ntrigger: line\nptp: true\npixel_format: RGB8\nsync: {policy: solve-with-what-is-there, min_cameras: 1}\nphotometry: {black: 0.02}'

cat > "$dir/faults.py" <<'PY'
import json, os, sys, threading, time, zmq

control, log, what = sys.argv[1:4]
orders = open(sys.argv[4], "w") if what in ("run", "line") else None
ctx = zmq.Context()
failed = 0

def order(line):
    orders.write(line + "\n"); orders.flush()

def status():
    s = ctx.socket(zmq.REQ); s.linger = 0; s.rcvtimeo = 1000 * PATIENCE_S; s.connect(control)
    try:
        s.send(b'{"cmd":"status"}'); return json.loads(s.recv())
    finally:
        s.close()

PATIENCE_S = int(os.environ["patience"])

def until(true):
    """Seconds until true(status), or None."""
    t0 = time.monotonic()
    while time.monotonic() - t0 < PATIENCE_S:
        try:
            if true(status()): return time.monotonic() - t0
        except (zmq.Again, KeyError, IndexError): pass
        time.sleep(0.03)
    return None

def check(text, ok, more=""):
    global failed
    failed += not ok
    print(("PASS" if ok else "FAIL"), "055:" + text, more, flush=True)

def count(s, cam, cause):
    return sum(c["counts"][cause] for c in s["cameras"]) if cam is None else s["cameras"][cam]["counts"][cause]
def state(s): return [c["state"] for c in s["cameras"]]

def whole_again(before):
    """Complete sets come, and all cameras run."""
    return lambda s: s["sets"]["complete"] >= before + 3 and all(x == "running" for x in state(s))

def fault(text, cam, cause, begin, end, least=1):
    """Order `begin`; the count must rise; order `end`; whole sets must come again."""
    s = status(); n0 = count(s, cam, cause)
    order(begin)
    found = until(lambda s: count(s, cam, cause) >= n0 + least)
    if end: order(end)
    back = until(whole_again(status()["sets"]["complete"]))
    check(text, None not in (found, back), "(%s: found after %s s, whole sets %s s later)" % (cause, found and "%.2f" % found, back and "%.2f" % back))

def told(cam, text):
    """Once an episode: a busy machine may lose frames again after "no more"."""
    def lines(): return [l for l in open(log) if text in l and (cam is None or "camera %s " % cam in l)]
    def first(k, l): return " no more: " not in l and (k == 0 or " no more: " not in lines()[k - 1])
    until(lambda s: lines())
    once = sum(first(k, l) for k, l in enumerate(lines())) == 1
    check("told once: " + text + ("" if cam is None else " (%s)" % cam), once, "" if once else str(lines()))

def over(text):
    check("over: " + text, until(lambda s: any(text in l and " info " in l for l in open(log))) is not None)

def calm(*causes):
    ok = until(lambda s: not any(t["cause"] in causes for c in s["cameras"] for t in c["troubles"]))
    check("all troubles are over", ok is not None)

heard = []
def listen():
    """What the daemon says has happened."""
    s = ctx.socket(zmq.SUB); s.linger = 0; s.rcvhwm = 0
    s.subscribe(b"PVX1" + (600).to_bytes(2, "little"))
    s.connect(control[:-len("control")] + "volumes")
    while True:
        heard.append(json.loads(s.recv()[48:]))

def is_said(kind, camera):
    said = until(lambda s: any(e["kind"] == kind and e.get("camera") == camera for e in heard))
    check("is said: " + kind, said is not None)

def run():
    threading.Thread(target=listen, daemon=True).start()
    check("starts", until(whole_again(20)) is not None)
    time.sleep(2.5) # clocks are known, the start is forgotten
    fault("packet loss", 1, "incomplete", "loss cam1 0.05", "loss cam1 0", 2)
    s = status(); n0 = [count(s, c, "incomplete") for c in range(4)]; done = s["sets"]["complete"]
    order("reorder cam0 0.3")
    until(lambda s: s["sets"]["complete"] >= done + 30)
    order("reorder cam0 0")
    s = status()
    check("reordered packets harm nothing", s["sets"]["complete"] >= done + 30 and count(s, 0, "incomplete") == n0[0])
    fault("freeze", 2, "clock_stuck", "freeze cam2 on", "freeze cam2 off")
    fault("wrong size", 0, "bad_size", "size cam0 0.5", "size cam0 0", 2)
    fault("lost frames", 3, "id_gap", "drop cam3 0.4", "drop cam3 0", 2)
    fault("clock jump", 0, "clock_jump", "jump cam0 500", None)
    fault("camera restarts", 3, "lost_camera", "reboot cam3 1.5", None)
    # a cable pulled and put back
    n0 = count(status(), 2, "lost_camera")
    order("kill cam2")
    found = until(lambda s: count(s, 2, "lost_camera") > n0)
    done = status()["sets"]["published"]
    on = until(lambda s: s["sets"]["published"] >= done + 20)
    order("revive cam2")
    back = until(lambda s: state(s)[2] == "running" and s["last"]["cameras"] == 4)
    check("cable pulled", None not in (found, on, back),
          "(found after %s s, back %s s after its return; the others went on: %s)" % (found and "%.2f" % found, back and "%.2f" % back, on is not None))
    is_said("camera_lost", "cam2"); is_said("camera_back", "cam2")
    fault("bandwidth limit", None, "bandwidth", "link 5 16", "link 0")
    # the switch reboots
    n0 = status()["all_gone"]
    order("switch 2.5")
    found = until(lambda s: s["all_gone"] > n0)
    back = until(lambda s: all(x == "running" for x in state(s)) and s["last"]["cameras"] == 4)
    check("switch reboots", None not in (found, back), "(found after %s s, all back %s s later)" % (found and "%.2f" % found, back and "%.2f" % back))
    fault("hostile packets", 1, "received", "hostile cam1 0.3", "hostile cam1 0", 20)
    calm("incomplete", "clock_stuck", "bad_size", "clock_jump", "bandwidth")
    told("cam2", "its time stamps do not change"); over("its time stamps do not change")
    told("cam0", "frames of another size"); over("frames of another size")
    told("cam0", "its clock jumped"); over("its clock jumped")
    told("cam3", "frames that it numbered never arrived")
    told(None, "cameras send incomplete frames at once"); over("several cameras send incomplete")
    told(None, "all 4 cameras are gone"); over("all 4 cameras are back")
    s = status()
    check("sums", all(c["counts"]["received"] >= c["counts"]["late"] + c["counts"]["unmatched"] + c["counts"]["overflow"] for c in s["cameras"]) and
          s["sets"]["produced"] == s["sets"]["published"] + s["sets"]["dropped"] + s["sets"]["inside"])
    check("one life", s["uptime_s"] > 20 and not any("stopping" in l for l in open(log)))

def line():
    check("starts on the line", until(whole_again(20)) is not None)
    time.sleep(2.5)
    fault("missed triggers", 2, "missed_trigger", "miss cam2 0.2", "miss cam2 0", 2)
    s = status()
    check("nobody else missed any", all(count(s, c, "missed_trigger") == 0 for c in (0, 1, 3)), str([count(s, c, "missed_trigger") for c in range(4)]))
    check("no slip is seen in it", all(count(s, c, "slip") == 0 for c in range(4)))
    fault("wrong trigger mode", 1, "trigger_mode", "trigger-mode cam1 0", None)
    s = status()
    check("and in one camera", [count(s, c, "trigger_mode") for c in range(4)] == [0, 1, 0, 0] and count(s, 1, "lost_camera") == 0)
    fault("two PTP masters", None, "ptp_masters", "ptp-master cam0 on\nptp-master cam3 on", "ptp-master all off", 2)
    s = status()
    check("and in two cameras", count(s, 1, "ptp_masters") == count(s, 2, "ptp_masters") == 0 and count(s, 0, "ptp_masters") > 0 < count(s, 3, "ptp_masters"))
    calm("trigger_mode", "ptp_masters", "missed_trigger")
    told("cam2", "it misses exposures")
    told("cam1", "its trigger mode is not the one that was set: TriggerMode is Off instead of On; it was set again")
    over("its trigger mode is not the one")
    told(None, "2 cameras are PTP masters at once"); over("several cameras are PTP masters at once")

def sim(cause, found):
    """A fault of sim: cameras, between two times."""
    t0, t1 = float(sys.argv[4]), float(sys.argv[5])
    started = until(whole_again(10)) is not None
    if started and time.time() > t0 - 1: sys.exit(9) # the fault was there first: again, with more time
    check("starts", started)
    check("nothing is wrong yet", not found(status()))
    t = until(found)
    after = None if t is None else time.time() - t0
    time.sleep(max(0, t1 - time.time()))
    done = status()["sets"]["complete"]
    back = until(whole_again(done))
    check(what, None not in (after, back),
          "(%s: found after %s s, whole sets %s s after its end)" % (cause, after and "%.2f" % after, back and "%.2f" % back))

def host():
    sim("host_clock", lambda s: s["host_clock"]["steps"] > 0)
    check("set back", until(lambda s: s["host_clock"]["steps"] == 2 and abs(s["host_clock"]["last_step_s"] + 3600) < 1) is not None)
    told(None, "the host's clock was set by +3600.0"); told(None, "the host's clock was set by -3600.0")
    s = status()
    check("no camera is blamed", not any(count(s, None, k) for k in ("clock_jump", "slip", "out_of_step", "rate")))

def starved():
    sim("underrun", lambda s: count(s, 2, "underrun") > 0)
    calm("underrun")
    s = status()
    check("in one camera, which is not lost", all(count(s, c, "underrun") == 0 for c in (0, 1, 3)) and count(s, 2, "lost_camera") == 0)
    told("cam2", "no buffer was free for its frames"); over("no buffer was free for its frames")

{"run": run, "line": line, "host": host, "starved": starved}[what]()
if orders: order("")
sys.exit(failed > 0)
PY

play() { # what, options of simcams...
    local what=$1; shift
    mkfifo "$dir/orders-$what"
    "$pyrovox" simcams --private-net --rig tests/data/rig4.yaml --fps 20 --ring 20 --boot-clock --control "$@" -- \
        "$pyrovoxd" --config "$dir/$what.yaml" > "$dir/$what.log" 2>&1 < "$dir/orders-$what" &
    local sim=$!
    pids+=("$sim")
    timeout 900 "$py" "$dir/faults.py" "$control" "$dir/$what.log" "$what" "$dir/orders-$what" || rc=1
    "$pyrovox" status --endpoint "$control" --stop > "$dir/null"
    check "$what-ends" ended "$sim" 0
}
play_sim() { # what, options of the broken cameras, cameras...: they break for 3 s, when all has begun
    local what=$1 options=$2 lead t0 all c code; shift 2
    for lead in 8 30 100; do
        t0=$(($(date +%s) + lead)) all=""
        for c in cam0 cam1 cam2 cam3; do
            all+="$c: \"sim:skew_us=${c#cam}000000,drift_ppm=1${c#cam}"
            [[ " $* " != *" $c "* ]] || all+=",$options,from=$t0,to=$((t0 + 3))"
            all+="\", "
        done
        config "$what.yaml" <<< "cameras: {${all%, }}"$'\nfps: 20\nsync: {policy: solve-with-what-is-there, min_cameras: 1}'
        start "$what.log" "$pyrovoxd" --config "$dir/$what.yaml"
        timeout 900 "$py" "$dir/faults.py" "$control" "$dir/$what.log" "$what" "$t0" $((t0 + 3)); code=$?
        "$pyrovox" status --endpoint "$control" --stop > "$dir/null"
        check "$what-ends" ended "$started" 0
        [ $code = 9 ] || break
    done
    [ $code = 0 ] || rc=1
}
play run
play line --set "line 20" --ptp-ms 200
play_sim host host_step_s=3600 cam0 cam1 cam2 cam3
play_sim starved hold=64 cam2
exit $rc
