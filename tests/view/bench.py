"""What the page and its bridge take: bench.py BUILD.  `make bench ONLY=view`; no test, as it wants a quiet machine.

Volumes are soft balls in three colours with 10 % of noise, a recording that the bridge plays: it packs each volume itself, from the stamp of
publishing on, so no daemon shares the cores and one way by ipc is not in it.  Times end with the page's acknowledgement.  Graphics are software GL on the same processor."""
import json
import os
import re
import sys
import threading
import time

import numpy as np

from bed import Bed, flame
from devtools import BROWSER, Browser
from ws import WebSocket, set_of, type_of

bed = Bed(os.path.realpath(sys.argv[1]))


def recording(n):
    return bed.recording(f"flame-{n}", [flame(n, 0.3 * i) for i in range(10)], "trilinear", (-0.5, -0.5, 0), (0.5, 0.5, 1))


def connect(url):
    at, token = url.split("//")[1].split("/#")
    host, port = at.split(":")
    return (host, int(port)), token


def rss(p):
    with open(f"/proc/{p.pid}/status") as f:
        return int(re.search(r"VmRSS:\s+(\d+)", f.read()).group(1)) / 1024


def page(n):
    bridge, url = bed.view(recording(n))
    browser = Browser()
    g = browser.page(url, 640, 480)
    g.until("window.pyrovox && pyrovox.view.words && pyrovox.view.words.volumes_drawn > 150", 120)
    w = json.loads(g.eval("JSON.stringify(pyrovox.view.words)"))
    size = float(re.search(r"([\d.]+) MB", g.eval("document.getElementById('what').textContent")).group(1))
    bricks = int(re.search(r"(\d+) bricks", g.eval("document.getElementById('what').textContent")).group(1))
    print(f"| published to texture complete, {n}^3, {size:.2f} MB a volume, {100 * bricks / (n / 8) ** 3:.0f} % of the bricks: p50, p95 | {w['held_ms'][0]:.0f}, {w['held_ms'][1]:.0f} ms | {20 if n == 64 else 60} ms |")
    print(f"| ... to drawn, page of 640x480 | {w['whole_ms'][0]:.0f}, {w['whole_ms'][1]:.0f} ms | |")
    g.eval("pyrovox.link.say({play: false}); 0")
    time.sleep(1)
    ms = g.eval("(() => { const t = []; for (let i = 0; i < 12; i++) { const t0 = performance.now(); "
                "pyrovox.picture(320, 240, [2, -1.4 + i / 50, 0.9], [0, 0, 0.5], 40, 1); t.push(performance.now() - t0); } return t.sort((a, b) => a - b)[6]; })()")
    print(f"| ray march at 320x240, {n}^3, reading it back included | {1000 / ms:.0f} frames/s | 10 at 64^3 |")
    browser.close()
    bed.end(bridge)


def throttled(n=128, mbit=20, seconds=20):
    """A reader that takes 20 Mbit/s beside one that takes all."""
    bridge, url = bed.view(f"{bed.dir}/flame-{n}")
    address, token = connect(url)
    ws, other = WebSocket(address, receive_buffer=65536), WebSocket(address)
    other.say(token=token, credits=1)
    ws.say(token=token, credits=1)

    def fast():
        try:
            while True:
                kind, m = other.next()
                if kind == "binary" and type_of(m) == 200:
                    other.say(credits=1, drawn=set_of(m))
        except Exception:
            pass
    threading.Thread(target=fast, daemon=True).start()
    # no more than 20 Mbit/s is taken from the socket
    began, taken, real = time.monotonic(), 0, ws.s.recv

    class Slow:
        def recv(self, size):
            nonlocal taken
            wait = taken * 8 / (mbit * 1e6) - (time.monotonic() - began)
            if wait > 0:
                time.sleep(wait)
            got = real(min(size, 16384))
            taken += len(got)
            return got

        def __getattr__(self, name):
            return getattr(plain, name)
    plain, ws.s = ws.s, Slow()
    ages, memory, last, size = [], [], None, 0
    while time.monotonic() - began < seconds:
        kind, m = ws.next()
        if kind != "binary" or type_of(m) != 200:
            continue
        now, size = time.time_ns(), len(m)
        if last is not None:
            ages.append((now - last) / 1e6)  # what is on the screen until this one takes its place
        last = int.from_bytes(m[48 + 32:48 + 40], "little")
        ws.say(credits=1, drawn=set_of(m))
        memory.append(rss(bridge))
    ages.sort()
    print(f"| one reader throttled to {mbit} Mbit/s, {n}^3, {size / 1e6:.2f} MB: age of what it shows when the next one comes, p50, p95 "
          f"| {ages[len(ages) // 2]:.0f}, {ages[int(len(ages) * 0.95)]:.0f} ms | 400 ms |")
    print(f"| the bridge's memory meanwhile, first and last fifth | {np.mean(memory[:max(1, len(memory) // 5)]):.1f}, {np.mean(memory[-max(1, len(memory) // 5):]):.1f} MB | flat |")
    bed.end(bridge)


def daemon():
    """Latency inside the daemon, none and four readers in turns."""
    cameras, at = bed.daemon(bed.rig(48), fps=15)

    import zmq
    sub = zmq.Context.instance().socket(zmq.SUB)
    sub.setsockopt(zmq.SUBSCRIBE, b"PVX1\xc8\x00")
    sub.connect(at)
    assert sub.poll(120000), "no volume came"
    bridge, url = bed.view("--endpoint", at)
    address, token = connect(url)
    figures = {0: [], 4: []}

    def latency(seconds):
        """Median over the volumes of so many seconds, as they say it themselves, ms."""
        while sub.poll(0):
            sub.recv()
        ns, end = [], time.monotonic() + seconds
        while time.monotonic() < end:
            if sub.poll(100):
                ns.append(int.from_bytes(sub.recv()[96:104], "little"))
        return float(np.median(ns)) * 1e-6
    for turn in range(6):
        n, stop, threads = 4 * (turn % 2), threading.Event(), []

        def reader():
            ws = WebSocket(address)
            ws.say(token=token, credits=1)
            while not stop.is_set():
                kind, m = ws.next()
                if kind == "binary" and type_of(m) == 200:
                    ws.say(credits=1, drawn=set_of(m))
            ws.close()
        for _ in range(n):
            threads.append(threading.Thread(target=reader))
            threads[-1].start()
        time.sleep(1)
        figures[n].append(latency(8))
        stop.set()
        for t in threads:
            t.join()
    p = {n: sorted(v) for n, v in figures.items()}
    print(f"| the daemon's latency with four readers over none, medians of three turns of 8 s, 48^3 at 15 Hz, cameras, bridge and readers on the same cores "
          f"| {p[4][1]:.2f} / {p[0][1]:.2f} ms = {p[4][1] / p[0][1]:.2f} ({p[0][0]:.2f} to {p[0][2]:.2f} without) | 1.05 |")
    for q in (bridge, cameras):
        bed.end(q)


if not os.path.exists(BROWSER):
    print("NOT RUN view: chromium-headless-shell is not installed (make test-view does that)")
    sys.exit(77)
try:
    print("| what, two cores, software GL | measured | wanted |\n|---|---|---|")
    page(64)
    page(128)
    throttled()
    daemon()
finally:
    bed.close()
