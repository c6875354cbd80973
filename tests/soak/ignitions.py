"""ignitions.py BUILD DIR N PERIOD PRE POST JOBS SLOW_MBS - see ignitions.sh."""
import glob
import json
import os
import signal
import subprocess
import sys
import threading
import time

import zmq

import pyrovox_sub
import ring

build, folder = sys.argv[1:3]
n_all, period, pre, post, jobs, slow = (float(x) for x in sys.argv[3:])
jobs = int(jobs)
FPS = 60
MARGIN = 2.0  # s of ring beyond pre, for the disk
FAULTS = [  # of the cameras of a daemon
    ["", "", "", ""],
    ["incomplete=0.02", "drop=0.02", "", "jitter_us=3000"],
    ["", "die_after=900", "silent_after=1100", ""],
    ["short_every=97", "wide_every=131", "skew_us=300", "drift_ppm=50,incomplete=0.01"],
]


def ignites(seed, k):
    """As daemon/pipeline/scene.c."""
    m = (1 << 64) - 1
    x = (k * 0x9E3779B97F4A7C15 + seed) & m
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9 & m
    x = (x ^ x >> 27) * 0x94D049BB133111EB & m
    u = ((x ^ x >> 31) >> 11) * 2.0**-53
    p = int(period * 1e9)
    return k * p + int((0.1 + 0.5 * u) * p)


class Job(threading.Thread):
    def __init__(self, number, n):
        super().__init__()
        self.number, self.n, self.seed = number, n, 100 + number
        self.dir = os.path.join(folder, str(number))
        self.events, self.wrong, self.memory = [], [], 0
        os.makedirs(self.dir)

    def status(self):
        s = zmq.Context.instance().socket(zmq.REQ)
        s.linger = 0
        s.connect(f"ipc://{self.dir}/control")
        s.send(b'{"cmd":"status"}')
        got = json.loads(s.recv()) if s.poll(20000) else {}
        s.close()
        return got

    def listen(self):
        with pyrovox_sub.Subscriber(f"ipc://{self.dir}/volumes") as sub:
            for m in sub:
                e = m.get("event")
                if m["type"] == "event" and e["kind"] == "trigger":
                    self.events.append((e, time.time_ns()))
                if m["type"] == "end":
                    return

    def run(self):
        faults = FAULTS[self.number % len(FAULTS)]
        cameras = ", ".join(f'cam{i}: "sim:{f + "," if f else ""}seed={i}"' for i, f in enumerate(faults))
        with open(f"{self.dir}/run.yaml", "w", encoding="utf8") as f:
            f.write(f"""rig: {os.getcwd()}/tests/data/rig4.yaml
cameras: {{{cameras}}}
fps: {FPS}
grid: 12
threads: 1
shared_clock: true
pixel_format: Mono8
sync: {{ policy: partial }}
publish: {{ endpoints: ["ipc://{self.dir}/volumes"] }}
control: {{ endpoint: "ipc://{self.dir}/control" }}
record: {{ path: takes/%Y.h5, keep_free_gb: 0, sync_s: 0.5, ring: {{ seconds: {pre + MARGIN}, memory: 20MB }} }}
sim: {{ ignite_s: {period}, seed: {self.seed} }}
triggers:
  - {{ name: ignition, when: appears, pre: {pre}, post: {post}, hold_off: 0.3, agree: 2 }}
""")
        env = dict(os.environ, LD_PRELOAD=f"{build}/tests/power/slow.so", PYROVOX_SLOW_MBS=str(slow), PYROVOX_CACHE=f"{self.dir}/cache")
        with open(f"{self.dir}/log", "w", encoding="utf8") as log:
            p = subprocess.Popen([f"{build}/bin/pyrovoxd", "-c", f"{self.dir}/run.yaml"], env=env, stdout=log, stderr=log)
            threading.Thread(target=self.listen, daemon=True).start()
            while not self.status().get("sets", {}).get("published"):
                if p.poll() is not None:
                    self.wrong.append("the daemon ended")
                    return
                time.sleep(0.1)
            self.begin = time.time_ns()
            while time.time_ns() < self.begin + int((self.n * period + pre + post + 1) * 1e9):
                r = self.status().get("ring", {})
                if r.get("bytes_most", 0) > r.get("bytes_max", 1):
                    self.wrong.append("more memory than its bound")
                with open(f"/proc/{p.pid}/status", encoding="utf8") as f:
                    self.memory = max(self.memory, *(int(x.split()[1]) for x in f if x.startswith("VmRSS")))
                time.sleep(0.5)
            self.end = time.time_ns()
            self.last = self.status()
            p.send_signal(signal.SIGINT)
            if p.wait() != 0:
                self.wrong.append(f"the daemon ended with {p.returncode}")

    def account(self):
        windows, frames, lost = [], 0, {}
        takes = sorted(glob.glob(f"{self.dir}/takes/*T*.h5"))
        for path in takes:
            wrong, n, why = ring.account(path)
            self.wrong += [f"{os.path.basename(path)}: {w}" for w in wrong]
            frames += n
            for k, v in why.items():
                lost[k] = lost.get(k, 0) + v
            windows.append(ring.window(path))
        k, n, missed = self.begin // int(period * 1e9), 0, []
        while True:
            t = ignites(self.seed, k)
            k += 1
            if t < self.begin + int(pre * 1e9):
                continue
            if t > self.end - int((post + 1) * 1e9):
                break
            n += 1
            if not any(0 <= e["t_ns"] - t < 500e6 for e, _ in self.events):
                missed.append(t)
            if not any(a <= t - pre * 1e9 + 0.5e9 and b >= t + post * 1e9 for a, b in windows):
                self.wrong.append(f"the ignition at {t} is in no take")
        self.wrong += [f"no event for the ignition at {t}" for t in missed]
        return n, len(takes), frames, lost


def main():
    all_jobs = [Job(i, -(-n_all // jobs) + 1) for i in range(jobs)]
    for j in all_jobs:
        j.start()
    for j in all_jobs:
        j.join()
    total, latency, bad = 0, [], 0
    for j in all_jobs:
        n, takes, frames, lost = j.account() if hasattr(j, "end") else (0, 0, 0, {})
        total += n
        latency += [(t - e["t_ns"]) * 1e-6 for e, t in j.events]
        r = j.last["ring"] if hasattr(j, "last") else {}
        print(f"daemon {j.number} ({', '.join(filter(None, FAULTS[j.number % len(FAULTS)])) or 'no faults'}): {n} ignitions, {len(j.events)} events, "
              f"{takes} takes ({r.get('extended')} orders made one longer), {frames} frames, lost {lost or 'none'}; ring at most "
              f"{r.get('bytes_most', 0) * 1e-6:.1f} of {r.get('bytes_max', 0) * 1e-6:.0f} MB, process {j.memory / 1024:.0f} MiB")
        for w in j.wrong[:20]:
            print("  WRONG", w)
        if j.wrong:
            bad += 1
            with open(f"{j.dir}/log", encoding="utf8") as f:
                print(f.read()[-3000:])
    latency.sort()
    if latency:
        print(f"{total} ignitions; latency from exposure to the event at a subscriber: p50 {latency[len(latency) // 2]:.1f} ms, "
              f"p99 {latency[min(len(latency) - 1, int(0.99 * len(latency)))]:.1f} ms, max {latency[-1]:.1f} ms over {len(latency)} events")
    sys.exit(1 if bad or total < n_all else 0)


main()
