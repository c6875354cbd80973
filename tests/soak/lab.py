"""A built daemon, its simulated cameras and its disk, for hours: what is asked of it, what can go wrong there."""
import os, random, resource, socket, threading, time
import zmq
import pyrovox_sub, ws

ctx = zmq.Context()
control = volumes = orders = disk = sim = page_at = token = None
cameras = []
wrong = [] # what no fault explains
threading.excepthook = lambda a: wrong.append("%s: %s: %s" % (a.thread.name.split(" ")[-1], a.exc_type.__name__, a.exc_value))

def begin(control_, volumes_, orders_, disk_, sim_, url, n):
    """Endpoints; the cameras' standard input, a folder that is a disk of its own, the process id of `pyrovox simcams`, what
    `pyrovox view` has printed."""
    global control, volumes, orders, disk, sim, page_at, token
    control, volumes, orders, disk, sim = control_, volumes_, open(orders_, "w"), disk_, sim_
    host, token = url.split("//")[1].split("/#")
    page_at = (host.rsplit(":", 1)[0], int(host.rsplit(":", 1)[1]))
    cameras[:] = ["cam%d" % i for i in range(n)]

def order(text):
    orders.write(text + "\n"); orders.flush()

def ask(**what):
    s = ctx.socket(zmq.REQ); s.linger = 0; s.rcvtimeo = 600000; s.connect(control)
    try:
        s.send_json(what); return s.recv_json()
    finally:
        s.close()

def daemon():
    """Its process id: the one child of simcams."""
    return int(open("/proc/%s/task/%s/children" % (sim, sim)).read().split()[0])

STACK = resource.getrlimit(resource.RLIMIT_STACK)[0] // 1024
def used(pid):
    """In KiB memory but for reserved areas, these, and what of them is touched; threads, handles.  An area has a size from the
    start (daemon/base/mem.h) and no name.  It is touched as far as the largest set until now needs it.  Stacks of threads are
    no areas: libc keeps some of those that ended."""
    memory = areas = touched = 0
    for line in open("/proc/%d/smaps" % pid):
        what, value = line.split(maxsplit=1)
        if what[-1] != ":": unnamed = len(value.split()) == 4
        elif what == "Size:" and unnamed:
            if int(value.split()[0]) != STACK: areas += int(value.split()[0])
        elif what == "Rss:" and unnamed: touched += int(value.split()[0])
        elif what == "Rss:": memory += int(value.split()[0])
    return memory, areas, touched, len(os.listdir("/proc/%d/task" % pid)), len(os.listdir("/proc/%d/fd" % pid))

def least_used(pid, seconds):
    """Cameras that were let go while they were silent take Aravis some seconds more: the least of a while is looked at."""
    least, t0 = used(pid), time.monotonic()
    while time.monotonic() - t0 < seconds:
        least = tuple(map(min, least, used(pid))); time.sleep(0.1)
    return least

# ---- faults: each begins and returns what ends it, or None ------------------------------------------

def share(what, value, back=0):
    def begin(cam):
        order("%s %s %g" % (what, cam, value)); return lambda: order("%s %s %g" % (what, cam, back))
    return begin

def switched(what):
    def begin(cam):
        order("%s %s on" % (what, cam)); return lambda: order("%s %s off" % (what, cam))
    return begin

def cable(cam):
    order("kill " + cam); return lambda: order("revive " + cam)

def restart(cam):
    order("reboot %s %.1f" % (cam, random.uniform(0.1, 2)))

def jump(cam): # forward: these clocks count from the start, and stamps below zero are no clock's
    order("jump %s %.3f" % (cam, 10 ** random.uniform(-2, 3)))

def switch(_):
    order("switch %.1f" % random.choice([0.2, 0.5, 1, 4]))

def bandwidth(_):
    order("link 5 16"); return lambda: order("link 0")

def full_disk(_): # recordings end in order; room is made again later
    with open(disk + "/filler", "wb") as f:
        try:
            while True: os.write(f.fileno(), bytes(1 << 16))
        except OSError: pass
    return lambda: os.unlink(disk + "/filler")

def listen(stop, heard):
    """As a subscriber does, until told to stop: heard(volume) for each; their sets must ascend."""
    with pyrovox_sub.Subscriber(volumes, timeout_ms=100) as sub:
        last = -1
        while not stop.is_set():
            for m in sub:
                if stop.is_set(): break
                if m["type"] != "volume": continue
                if m["set"] <= last: wrong.append("a subscriber got set %d after %d" % (m["set"], last))
                last = m["set"]
                heard(m)

def passing_subscribers(_):
    stop = threading.Event()
    for _ in range(3): threading.Thread(target=listen, args=(stop, lambda m: None), daemon=True).start()
    return stop.set

def look(stop, silent):
    """As a page does: volumes as fast as it shows them, or, hidden, none."""
    page = ws.WebSocket(page_at)
    page.say(token=token)
    while not stop.is_set():
        if not silent: page.say(credits=1)
        try: page.volume(patience=0.5)
        except TimeoutError: pass
    page.close()

def passing_pages(_):
    stop = threading.Event()
    for i in range(3): threading.Thread(target=look, args=(stop, i == 2), daemon=True).start()
    return stop.set

def slow_subscribers(_):
    subs = [ctx.socket(zmq.SUB) for _ in range(8)]
    for s in subs: # they read nothing
        s.linger = 0; s.rcvhwm = 1; s.connect(volumes); s.subscribe(b"")
    return lambda: [s.close() for s in subs]

def rude_clients(_):
    lines = []
    for path in (volumes, control):
        for _ in range(4):
            s = socket.socket(socket.AF_UNIX)
            s.connect(path[len("ipc://"):]); s.sendall(random.randbytes(random.randint(0, 200)))
            lines.append(s)
    return lambda: [s.close() for s in lines]

# Name, what it is about (no two at once about the same), beginning.
FAULTS = [("switch reboots", "line", switch), ("bandwidth", "line", bandwidth), ("cable pulled", "power", cable),
          ("camera restarts", "power", restart), ("clock jumps", "jump", jump), ("clock stands", "clock", switched("stuck")),
          ("clock drifts", "drift", share("drift", 300)), ("camera freezes", "freeze", switched("freeze")),
          ("numbers anew", "ids", lambda cam: order("ids " + cam)), ("hostile packets", "hostile", share("hostile", 0.3)),
          ("packets lost", "loss", share("loss", 0.1)), ("packets garbled", "corrupt", share("corrupt", 0.3)),
          ("packets overtake", "reorder", share("reorder", 0.3)), ("packets twice", "duplicate", share("duplicate", 0.3)),
          ("frames lost", "drop", share("drop", 0.4)), ("frames late", "delay", share("delay", 80)),
          ("wrong size", "size", share("size", 0.5)), ("wrong trigger mode", "mode", lambda cam: order("trigger-mode %s 1" % cam)),
          ("full disk", "disk", full_disk), ("slow subscribers", "slow", slow_subscribers), ("passing subscribers", "pass", passing_subscribers), ("passing pages", "page", passing_pages), ("rude clients", "rude", rude_clients)]
COMMON = ("line", "disk", "slow", "pass", "page", "rude") # not of one camera

active = [] # when it ends, what it is about, camera, what ends it

def fault(least_s, most_s):
    """Begins one that lasts so long, about something that is well; its name."""
    while True:
        kind, about, what = random.choice(FAULTS)
        cam = None if about in COMMON else random.choice(cameras)
        if not any(a[1:3] == (about, cam) for a in active): break
    active.append((time.monotonic() + random.uniform(least_s, most_s), about, cam, what(cam)))
    return kind

def faults_for(seconds, meanwhile):
    """Ends those whose time has come; with None until none is left."""
    until = time.monotonic() + (seconds or 0)
    while time.monotonic() < until or seconds is None and active:
        for a in [a for a in active if a[0] <= time.monotonic()]:
            active.remove(a)
            if a[3]: a[3]()
        meanwhile()
        time.sleep(0.02)

def whole(seconds):
    """All cameras run and sets with all of them come."""
    t0, first = time.monotonic(), None
    while time.monotonic() - t0 < seconds:
        s = ask(cmd="status")
        if "sets" in s and all(c["state"] == "running" for c in s["cameras"]):
            if first is None: first = s["sets"]["complete"]
            if s["sets"]["complete"] >= first + 20: return s
        else: first = None
        time.sleep(0.1)
    return None

def first_sets():
    """Waits for a daemon that has just been started; its process id."""
    t0 = time.monotonic()
    while time.monotonic() - t0 < 120:
        try: whole(60); break
        except (zmq.ZMQError, KeyError): time.sleep(0.1)
    return daemon()

def accounts(s):
    """Every set is known."""
    sets = s["sets"]
    if sets["produced"] != sets["published"] + sets["dropped"] + sets["inside"]: wrong.append("pipeline's sets: %s" % sets)
    waiting = sets["complete"] + sets["partial"] - sets["displaced"] - sets["produced"]
    if not 0 <= waiting <= 8: wrong.append("capture's sets: %s" % sets)
