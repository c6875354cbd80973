"""Faults for hours, and rests in between at which everything is well again: what does the daemon hold then, how late are its
volumes, and do these grow?  One line of the table per rest; at the end the slopes with their errors, and a picture."""
import collections, csv, os, random, sys, threading, time
import numpy as np
import lab, recordings

view, url, hours, seed, out = int(sys.argv[6]), sys.argv[7], float(sys.argv[8]), sys.argv[9], sys.argv[10]
lab.begin(*sys.argv[1:6], url, 8)
random.seed(int(seed))
FAULTS_S, REST_S, LEAST = 60, 12, 8 # of a cycle; rests that a slope needs
FASTER = float(os.environ.get("FASTER", 1)) # so many times as many faults, each shorter by its root
# What must not grow; the slope that is too small to matter, per hour: 64 KiB are half a gigabyte a year.
COLUMNS = {"memory": ("KiB", 64), "areas": ("KiB", 64), "touched": ("KiB", None), "threads": ("", 0.01), "handles": ("", 0.01), "view": ("KiB", 64), "view areas": ("KiB", 64),
           "view handles": ("", 0.01), "recorder": ("KiB", None), "p50": ("ms", None), "p99": ("ms", None),
           "spread": ("ms", None), "cpu": ("%", None), "rate": ("sets/s", None), "disk": ("%", None)}

volumes = collections.deque(maxlen=1 << 18) # of the steady subscriber: set, latency, spread
def tend(all_of_them=False):
    for what in recordings.tend({v[0] for v in volumes.copy()}, all_of_them):
        lab.ask(cmd="record", what=what, action="start")

tended = 0
def meanwhile():
    global tended
    if time.monotonic() - tended > 2:
        tend(); tended = time.monotonic()

def busy_s(pid):
    f = open("/proc/%d/stat" % pid).read().rsplit(")", 1)[1].split()
    return (int(f[11]) + int(f[12])) / os.sysconf("SC_CLK_TCK")

def recorder_kib(pid):
    for task in os.listdir("/proc/%d/task" % pid):
        for child in open("/proc/%d/task/%s/children" % (pid, task)).read().split():
            if open("/proc/%s/comm" % child).read() == "pyrovox\n": return sum(lab.used(int(child))[0:3:2])
    return float("nan") # the disk was full a moment ago

def rest(pid):
    lab.faults_for(None, meanwhile)
    whole = lab.whole(120) is not None # no reason to fail: on a starved machine clocks are mapped slowly
    meanwhile()
    volumes_before, t0, cpu0 = len(volumes), time.monotonic(), busy_s(pid)
    first = volumes[-1][0] if volumes else -1
    memory, areas, touched, threads, handles = lab.least_used(pid, REST_S)
    view_memory, view_areas, _, _, view_handles = lab.used(view)
    took = time.monotonic() - t0
    late = np.array([v for v in volumes.copy() if v[0] > first] or [(0, np.nan, np.nan)], float) * 1e-6
    s = lab.ask(cmd="status")
    lab.accounts(s)
    return whole, dict(hours=(time.monotonic() - begun) / 3600, memory=memory, areas=areas, touched=touched, threads=threads, handles=handles, recorder=recorder_kib(pid),
                       **{"view": view_memory, "view areas": view_areas, "view handles": view_handles},
                       p50=np.median(late[:, 1]), p99=np.quantile(late[:, 1], 0.99), spread=np.quantile(late[:, 2], 0.99), cpu=100 * (busy_s(pid) - cpu0) / took,
                       rate=len(late) / took, disk=100 * (1 - recordings.share_free()))

def slope(x, y):
    """Least squares: per hour, and its standard error with what neighbouring rests have in common (their autocorrelation)."""
    ok = np.isfinite(y)
    x, y = x[ok], y[ok]
    if len(x) < LEAST: return float("nan"), float("nan")
    m = x - x.mean()
    b = (m * y).sum() / (m * m).sum()
    r = y - y.mean() - b * m
    error = np.sqrt((r * r).sum() / (len(x) - 2) / (m * m).sum())
    alike = np.clip((r[1:] * r[:-1]).sum() / max((r * r).sum(), 1e-300), 0, 0.9)
    return b, error * np.sqrt((1 + alike) / (1 - alike))

def picture(x, rows, found, path):
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    figure, axes = plt.subplots(8, 2, figsize=(11, 17), sharex=True)
    for ax, (name, (unit, _)) in zip(axes.flat, COLUMNS.items()):
        y, (b, error) = np.array([r[name] for r in rows], float), found[name]
        ax.plot(x, y, ".", ms=4)
        ax.set_title("%s%s: %+.3g ± %.2g per hour" % (name, ", " + unit if unit else "", b, error), fontsize=9)
        late = x >= x[-1] / 4
        if np.isfinite(b):
            middle, t = np.nanmean(y[late]), x[late] - x[late].mean()
            ax.plot(x[late], middle + b * t, "k-", lw=1)
            ax.fill_between(x[late], middle + (b - 2 * error) * t, middle + (b + 2 * error) * t, color="k", alpha=0.15, lw=0)
        ax.margins(y=0.3)
        ax.ticklabel_format(axis="y", useOffset=False)
    for ax in axes[-1]: ax.set_xlabel("hours")
    figure.tight_layout()
    figure.savefig(path, dpi=90)

def conclude(rows, tally, whole, s):
    x = np.array([r["hours"] for r in rows])
    late = x >= x[-1] / 4 # the heap has found its size by then
    found = {k: slope(x[late], np.array([r[k] for r in rows], float)[late]) for k in COLUMNS}
    print("\n| at rest | at first | at the end | per hour | wrong if surely more than |\n|---|---|---|---|---|")
    for k, (unit, matters) in COLUMNS.items():
        b, error = found[k]
        print("| %s%s | %.4g | %.4g | %+.3g ± %.2g | %s |" % (k, ", " + unit if unit else "", rows[0][k], rows[-1][k], b, error, "" if matters is None else "%g" % matters))
        if matters is not None and b - 3 * error > matters: lab.wrong.append("%s: %+.3g ± %.2g per hour" % (k, b, error))
    if late.sum() < LEAST: lab.wrong.append("too short: %d rests in its last three quarters, slopes need %d" % (late.sum(), LEAST))
    print("\nfaults: " + ", ".join("%s %d" % kv for kv in sorted(tally.items())))
    counts = collections.Counter()
    for c in s["cameras"]: counts.update(c["counts"])
    print("counted: " + ", ".join("%s %d" % kv for kv in counts.items() if kv[1]))
    print("sets: " + ", ".join("%s %d" % kv for kv in s["sets"].items()))
    for k in recordings.files:
        print("recordings of %s: %d files, %d sets in them, %d told to be missing" % (k, recordings.files[k], recordings.checked[k], recordings.told[k]))
        if recordings.files[k] < 3: lab.wrong.append("%s: no recording rolled over" % k)
    picture(x, rows, found, out + ".png")
    print("result: %d faults in %.2f h, seed %s; whole again at %d of %d rests; %d sets, each published or dropped for a counted reason; %s.png, .csv" %
          (sum(tally.values()), x[-1], seed, whole, len(rows), s["sets"]["produced"], out))

begun = time.monotonic()
pid = lab.first_sets()
stop = threading.Event()
threading.Thread(target=lab.listen, args=(stop, lambda m: volumes.append((m["set"], m["latency_ns"], m["spread_ns"]))), daemon=True).start()
rows, tally, whole, s = [], collections.Counter(), 0, None
with open(out + ".csv", "w", newline="") as f:
    table = csv.DictWriter(f, ["hours"] + list(COLUMNS))
    table.writeheader()
    try:
        while time.monotonic() - begun < 3600 * hours or not rows:
            until = time.monotonic() + (FAULTS_S if rows else 0)
            while time.monotonic() < until:
                tally[lab.fault(0.2, 8 / FASTER ** 0.5)] += 1
                lab.faults_for(random.uniform(0.5, 4) / FASTER, meanwhile)
            ok, row = rest(pid)
            whole += ok
            rows.append(row)
            table.writerow(row); f.flush()
            print("%7.3f of %g h %6d faults " % (row["hours"], hours, sum(tally.values())) + " ".join("%s %.4g" % (k, row[k]) for k in COLUMNS) + ("" if ok else "  not whole"), flush=True)
    except KeyboardInterrupt: print("stopped: what there is until now")
    except (OSError, KeyError, lab.zmq.ZMQError) as e: # the daemon, or the page's server, is gone
        lab.wrong.append("%s: %s" % (type(e).__name__, e))
if os.path.exists("/proc/%d" % pid) and rows:
    lab.faults_for(None, meanwhile)
    for what in "raw", "volumes": lab.ask(cmd="record", what=what, action="stop")
    tend(True)
    s = lab.ask(cmd="status")
    lab.accounts(s)
    conclude(rows, tally, whole, s)
else: lab.wrong.append("it ended after %d faults" % sum(tally.values()))
stop.set()
for text in sorted(set(lab.wrong)): print("FAIL soak: %s%s" % (text, " (%d times)" % lab.wrong.count(text) if lab.wrong.count(text) > 1 else ""))
sys.exit(len(lab.wrong) > 0)
