"""The page in a browser: view.py BUILD [CHECK].  Each check is a line; what it looks at is in build/view/."""
import base64
import http.server
import json
import os
import re
import signal
import sys
import threading
import time

import h5py
import numpy as np

from bed import Bed, blobs, sooty, spectral
from devtools import Browser

bed = Bed(sys.argv[1])
only = sys.argv[2] if len(sys.argv) > 2 else ""
browser = Browser()
FOV, W, H = 40, 320, 240
EYES = [(2.0, -1.4, 0.9), (-0.3, 2.2, 0.2), (0.35, 0.1, 3.4)]


def pixels(page, eye, target, exposure, w=W, h=H, count=0, fov=FOV):
    data = page.eval(f"pyrovox.picture({w}, {h}, {list(eye)}, {list(target)}, {fov}, {exposure}, 'grey', {count})")
    return np.frombuffer(base64.b64decode(data), np.uint8).reshape(h, w, 4)[..., :3]


def shown(page, url):
    page.until("window.pyrovox && pyrovox.view.set >= 0 && pyrovox.view.drawn > 0")


def exact(volume, eye, target, exposure, fov=FOV):
    """What pyrovox render makes of it, as sRGB."""
    out = f"{bed.dir}/picture.npy"
    number = ",".join
    bed.run(f"{bed.bin}/pyrovox", "render", "--quiet", "--sub", "1", "--eye=" + number(map(str, eye)), "--look-at=" + number(map(str, target)), "--fov", str(fov),
            "--size", f"{W}x{H}", volume, out)
    p = np.load(out).astype(float)
    p = p.reshape(H, W, -1) * exposure
    p = np.clip(p, 0, 1)
    return 255 * np.where(p < 0.0031308, 12.92 * p, 1.055 * np.maximum(p, 0) ** (1 / 2.4) - 0.055)


def golden():
    for basis in ("box", "trilinear"):
        for channels in (1, 3):
            v = blobs((21, 17, 30), channels, 5 + channels)
            folder = bed.recording(f"golden-{basis}-{channels}", [v], basis)
            bridge, url = bed.view(folder)
            page = browser.page(url)
            shown(page, url)
            for eye, fov in [(e, FOV) for e in EYES] + [((20.0, -14.0, 9.0), 4)]:  # the last from far away
                got, want = pixels(page, eye, (0, 0, 0.7), 1.2, fov=fov), exact(f"{folder}/000000.npy", eye, (0, 0, 0.7), 1.2, fov)
                diff = np.abs(got - want)
                print(f"  {basis} {channels} {eye}: mean {diff.mean():.3f}, largest {diff.max():.1f}, brightest {want.max():.0f}, lit {(want > 5).mean():.2f}")
                assert want.max() > 100 and (want > 5).mean() > 0.05, "there is nothing to compare"
                assert diff.max() <= 10 and diff.mean() <= 2 and diff[np.broadcast_to(want > 5, diff.shape)].mean() <= 2, diff.mean()
            assert not page.troubles(), page.troubles()
            page.close()
            bed.end(bridge)


def ghosts():
    """Bricks that left are dark again: every volume of a recording looks as it does alone."""
    n = (40, 40, 40)
    volumes = []
    for i in range(6):
        v = np.zeros((40, 40, 40, 1), np.float32)
        if i != 3:
            v[4 + 5 * i:9 + 5 * i, 3:9 + 4 * i, 30 - 4 * i:36] = 1 + i / 4
        volumes.append(v)
    folder = bed.recording("ghosts", volumes, "trilinear")
    bridge, url = bed.view(folder)
    page = browser.page(url)
    shown(page, url)
    for i in (0, 4, 1, 5, 3, 2, 5, 0):
        page.eval(f"pyrovox.link.say({{play: false, seek: {i}}})")
        page.until(f"pyrovox.view.set === {i}")
        got, want = pixels(page, EYES[0], (0, 0, 0.7), 0.8), exact(f"{folder}/{i:06d}.npy", EYES[0], (0, 0, 0.7), 0.8)
        assert np.abs(got - want).max() <= 6, (i, np.abs(got - want).max())
        assert (want.max() > 50) == (i != 3)
    page.close()
    bed.end(bridge)


def samples():
    """Empty space is stepped over: samples against a march through the whole box, half a voxel a step."""
    v = np.zeros((64, 64, 64, 3), np.float32)
    z, y, x = np.mgrid[0:64, 0:64, 0:64]
    v[((x - 32) ** 2 + (y - 30) ** 2) * 9 + (z - 30) ** 2 < 800] = 1
    folder = bed.recording("samples", [v], "trilinear", (-0.5, -0.5, 0), (0.5, 0.5, 1))
    bridge, url = bed.view(folder)
    page = browser.page(url)
    shown(page, url)
    red = pixels(page, EYES[0], (0, 0, 0.5), 1, count=1)[..., 0].astype(float) * 1024 / 255
    eye, target = np.array(EYES[0]), np.array((0, 0, 0.5))
    f = (target - eye) / np.linalg.norm(target - eye)
    r = np.cross(f, (0, 0, 1))
    r /= np.linalg.norm(r)
    u, t = np.cross(r, f), np.tan(np.radians(FOV) / 2)
    py, px = np.mgrid[0:H, 0:W]
    d = f + ((px + 0.5) / W * 2 - 1)[..., None] * t * W / H * r - ((py + 0.5) / H * 2 - 1)[..., None] * t * u
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    with np.errstate(divide="ignore"):
        a, b = (np.array((-0.5, -0.5, 0)) - eye) / d, (np.array((0.5, 0.5, 1)) - eye) / d
    long = np.maximum(np.minimum(np.maximum(a, b).min(-1) - np.minimum(a, b).max(-1), 9), 0)
    dense = (long * 64 * 2).sum()
    print(f"  {red.sum():.0f} samples, dense march {dense:.0f}: {red.sum() / dense:.3f}")
    assert 0.005 < red.sum() / dense < 1 / 3
    page.close()
    bed.end(bridge)


def clicks(page, id):
    page.eval(f"document.getElementById('{id}').click()")


def live():
    """A daemon with simulated cameras: the flame moves; narrow and wide; mouse, touch, keyboard; killed and back."""
    daemon, at = bed.daemon(bed.rig(24))
    bridge, url = bed.view("--endpoint", at)
    page = browser.page(url)
    page.until("window.pyrovox && pyrovox.view.volumes > 20 && document.getElementById('state').textContent === 'live'")
    page.eval("for (const d of document.querySelectorAll('details')) d.open = true; 0")
    clicks(page, "frusta")
    page.until("document.querySelectorAll('.camera img[src^=blob]').length === 4")
    page.until("[...document.querySelectorAll('.camera p')].every((p) => p.textContent.includes('good'))")
    page.until("document.querySelectorAll('.camera canvas').length === 4 && [...document.querySelectorAll('.camera canvas')].every((c) => c.width > 1)")
    page.until("pyrovox.overlay.rig.length === 4")
    page.until("/^good: residual .*4 cameras agree/.test(document.getElementById('verdict').textContent)")
    page.until("pyrovox.view.words.volumes_drawn > 10 && pyrovox.view.words.whole_ms[0] > 0")
    page.shot(f"{bed.shots}/wide.png")
    w = json.loads(page.eval("JSON.stringify(pyrovox.view.words)"))
    print(f"  held {w['held_ms']} ms, drawn {w['whole_ms']} ms from published [p50, p95]")

    def view():
        return page.eval("JSON.stringify([pyrovox.orbit.azimuth, pyrovox.orbit.elevation, pyrovox.orbit.distance, pyrovox.orbit.target])")

    def moves(what):
        was = view()
        what()
        end = time.monotonic() + 60
        while view() == was:
            assert time.monotonic() < end, what
            time.sleep(0.02)
    moves(lambda: page.drag(400, 400, 500, 430))
    moves(lambda: page.drag(400, 400, 450, 430, "right"))
    moves(lambda: page.mouse("mouseWheel", 400, 400, deltaX=0, deltaY=-120))
    clicks(page, "reset")
    # the keyboard alone: Tab reaches the flame and everything else that can be used
    seen = set()
    for _ in range(60):
        page.key("Tab")
        seen.add(page.eval("document.activeElement.id || document.activeElement.tagName"))
    assert {"flame", "reset", "turn", "full", "shot", "exposure", "auto", "box", "frusta", "slices", "SUMMARY"} <= seen, seen
    page.eval("document.getElementById('flame').focus(); 0")
    for k in ("ArrowLeft", "ArrowUp", "+", "-"):
        moves(lambda: page.key(k))
    moves(lambda: page.key("ArrowRight", modifiers=8))
    page.key("Home")
    page.key("t")
    page.until("document.getElementById('turn').getAttribute('aria-pressed') === 'true'")
    page.key("t")
    page.size(360, 740, touch=True)
    page.until("document.documentElement.scrollWidth <= 360 && document.getElementById('flame').clientWidth === 360")
    moves(lambda: (page.touch("touchStart", (150, 200)), page.touch("touchMove", (180, 220)), page.touch("touchMove", (210, 230)), page.touch("touchEnd")))
    was = float(page.eval("pyrovox.orbit.distance"))
    page.touch("touchStart", (120, 200), (240, 200))
    for i in range(1, 6):
        page.touch("touchMove", (120 - 8 * i, 200), (240 + 8 * i, 200))
    page.touch("touchEnd")
    page.until(f"pyrovox.orbit.distance < {was} * 0.95")
    page.eval("pyrovox.orbit.reset()")
    time.sleep(0.5)
    page.shot(f"{bed.shots}/narrow.png")
    page.size(1280, 800)

    # a page that is hidden gets none, a stalled one few, and both the newest when they are back
    page.eval("pyrovox.link.say({hidden: true}); 0")
    page.until("pyrovox.view.words.hidden > 5")
    page.eval("pyrovox.link.say({hidden: false}); 0")
    n = page.eval("pyrovox.view.volumes")
    page.until(f"pyrovox.view.volumes > {n} + 3")
    lost = page.eval("pyrovox.view.words.superseded")
    page.eval("{ const end = performance.now() + 1500; while (performance.now() < end); } 0")
    page.until(f"pyrovox.view.words.superseded > {lost}")
    page.until("[...document.querySelectorAll('#lost tr')].some((r) => r.textContent.includes('newer came first'))")
    page.until("/here [0-9,]+ of [0-9,]+$/.test(document.getElementById('lost-sum').textContent)")

    # the daemon is killed, and comes back with another session
    session = page.eval("pyrovox.view.start.session")
    bed.end(daemon, signal.SIGKILL)
    page.until("/nothing comes from the daemon|has ended/.test(document.getElementById('state').textContent)")
    page.shot(f"{bed.shots}/gone.png")
    daemon, _ = bed.daemon(bed.rig(24, "trilinear"))
    page.until(f"pyrovox.view.start && pyrovox.view.start.session !== '{session}' && pyrovox.view.volumes > 3 && document.getElementById('state').textContent === 'live'", 180)
    assert page.eval("pyrovox.view.start.grid.basis") == 1
    # a bridge that stands still does not close: it is noticed, and is back when it goes on
    os.kill(bridge.pid, signal.SIGSTOP)
    page.until("/does not answer|reconnecting/.test(document.getElementById('state').textContent)")
    os.kill(bridge.pid, signal.SIGCONT)
    n = page.eval("pyrovox.view.volumes")
    page.until(f"pyrovox.view.volumes > {n} + 3 && document.getElementById('state').textContent === 'live'")
    # the bridge is killed: it says so; its token is an old one for the next
    bed.end(bridge, signal.SIGKILL)
    page.until("/bridge is gone|reconnecting/.test(document.getElementById('state').textContent)")
    assert [t for t in page.troubles() if "WebSocket" not in t] == [], page.troubles()
    page.close()
    bed.end(daemon)


def context_lost():
    folder = bed.recording("context", [blobs((24, 24, 24), 3, 3)] * 2, "trilinear")
    bridge, url = bed.view(folder)
    page = browser.page(url)
    shown(page, url)
    want = pixels(page, EYES[0], (0, 0, 0.7), 1)
    page.until("pyrovox.view.volumes > 5")
    page.eval("window.taken = pyrovox.flame().gl.getExtension('WEBGL_lose_context'); taken.loseContext(); 0")
    page.until("!document.getElementById('notice').hidden")
    page.shot(f"{bed.shots}/context-lost.png")
    page.eval("taken.restoreContext(); 0")
    page.until("document.getElementById('notice').hidden && pyrovox.flame().grid")
    time.sleep(0.5)
    got = pixels(page, EYES[0], (0, 0, 0.7), 1)
    assert want.max() > 100 and np.array_equal(got, want)
    n, drawn = page.eval("pyrovox.view.volumes"), page.eval("pyrovox.view.drawn")
    page.until(f"pyrovox.view.volumes > {n} + 5 && pyrovox.view.drawn > {drawn} + 5")  # and it goes on
    page.close()
    bed.end(bridge)


def grey():
    """One channel: colours and their bar; slices; clipping; exposure in stops."""
    folder = bed.recording("grey", [blobs((40, 40, 48), 1, 8 + i) for i in range(5)], "box")
    bridge, url = bed.view(folder)
    page = browser.page(url)
    shown(page, url)
    page.until("!document.getElementById('legend').hidden && Number(document.getElementById('map-high').textContent) > 0")
    page.eval("document.getElementById('colours').value = 'viridis'; document.getElementById('colours').dispatchEvent(new Event('input')); 0")
    page.until("pyrovox.flame().look.colours === 'viridis'")
    page.shot(f"{bed.shots}/grey.png")
    # the bar is even in the value: where it stands for a quarter of the range, it has the colour of that
    bar = page.eval("JSON.stringify([...document.getElementById('map').getContext('2d').getImageData(64, 0, 1, 1).data])")
    want = page.eval("import('./colours.js').then((m) => JSON.stringify([...m.table('viridis').slice(4 * Math.round(255 * (1.055 * (64 / 255) ** (1 / 2.4) - 0.055)))].slice(0, 4)))")
    assert bar == want, (bar, want)
    page.size(360, 740, touch=True)
    page.until("document.documentElement.scrollWidth <= 360")
    boxes = json.loads(page.eval("JSON.stringify(['film', 'legend', 'tools'].map((i) => document.getElementById(i).getBoundingClientRect()))"))
    assert all(b["left"] >= 0 and b["right"] <= 360 for b in boxes), boxes
    assert boxes[1]["bottom"] <= boxes[0]["top"] or boxes[1]["top"] >= boxes[0]["bottom"], boxes
    page.shot(f"{bed.shots}/narrow-grey.png")
    page.size(1280, 800)
    page.eval("document.querySelectorAll('details')[1].open = true; 0")
    clicks(page, "slices")
    page.until("document.getElementById('map-unit').textContent === '1/m'")
    metres = page.eval("[...document.querySelectorAll('#slice-rows output')].map((o) => o.textContent).join()")
    assert metres == "0.000 m,0.000 m,0.700 m", metres
    time.sleep(0.4)
    page.shot(f"{bed.shots}/slices.png")
    clicks(page, "slices")
    page.eval("{ const r = document.querySelectorAll('#clip-rows input')[0]; r.value = 0.5; r.dispatchEvent(new Event('input')); } 0")
    page.until("pyrovox.flame().look.clip[0] === 0.5")
    clicks(page, "unclip")
    page.until("pyrovox.flame().look.clip[0] === 0")
    page.eval("{ const r = document.getElementById('exposure'); r.value = 3; r.dispatchEvent(new Event('input')); } 0")
    page.until("pyrovox.flame().look.exposure === 8 && document.getElementById('stops').textContent === '+3.0 stops' && !document.getElementById('auto').checked")
    # the recording's bar: pause, go to a volume, a step by the keyboard
    page.eval("document.querySelector('[data-film=play]').click(); 0")
    page.until("document.querySelector('[data-film=play]').textContent === 'Play'")
    page.eval("{ const r = document.querySelector('[data-film=bar]'); r.value = 2; r.dispatchEvent(new Event('input')); } 0")
    page.until("pyrovox.view.set === 2")
    page.eval("document.getElementById('flame').focus(); 0")
    page.key(".")
    page.until("pyrovox.view.set === 3 && document.querySelector('[data-film=at]').textContent === '4 of 5'")
    assert not page.troubles(), page.troubles()
    page.close()
    bed.end(bridge)


def bars():
    """The switch shows deviations; a value under the pointer has its bar, in the slice and along the ray; without bars it has none."""
    h5 = f"{bed.dir}/bars.h5"
    bed.run(f"{bed.build}/tests/unit/test_bars", "--write", h5, "4", "1", "2")
    bare = f"{bed.dir}/bare"
    bed.run(f"{bed.bin}/pyrovox", "convert", h5, bare, "--format", "npy")
    bridge, url = bed.view(h5)
    page = browser.page(url)
    shown(page, url)
    page.eval("pyrovox.link.say({play: false, seek: 1})")
    page.until("pyrovox.view.set === 1 && !document.getElementById('bars-row').hidden")
    import glob
    v, sd = (np.load(f"{bare}/{where}000001.npy")[..., 0] for where in ("", "sd/"))

    def at(x, y):
        page.do("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    box = page.eval("(() => { const b = document.getElementById('flame').getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; })()")
    page.eval("pyrovox.orbit.azimuth = -Math.PI / 2; pyrovox.orbit.elevation = 0; pyrovox.orbit.turn(0, 0)")
    at(box[0] + box[2] / 2, box[1] + box[3] / 2)
    page.until("document.getElementById('value').innerText.includes('±')")
    text = page.eval("document.getElementById('value').innerText")
    page.shot(f"{bed.shots}/bars-pointer.png")
    print("  " + text.replace("\n", " | "))
    # along y through the middle, which is between two layers: the brightest voxel of the line of sight
    best = min((v[k, :, 11:13].max() for k in (15, 16)), key=lambda b: abs(b - float(text.split(" ")[0])))
    value, bar = text.split(" 1/m")[0].split(" ± ")
    assert "brightest along this line of sight" in text and abs(float(value) - best) <= 0.02 * best and 0.04 < float(bar) / float(value) < 0.15, (text, best)
    flame = pixels(page, (0, -2.0, 0.32), (0, 0, 0.32), 0.3)
    page.until("!document.getElementById('doubt').hidden")
    assert "fewer than five cameras" in page.eval("document.getElementById('doubt').innerText")
    clicks(page, "bars")
    page.until("document.getElementById('map-unit').innerText.includes('±')")
    page.until("pyrovox.view.bars.has")
    time.sleep(1)
    deviations = pixels(page, (0, -2.0, 0.32), (0, 0, 0.32), 3)
    page.shot(f"{bed.shots}/bars-shown.png")
    want = np.clip((sd.sum(1) * 0.02 * 3)[::-1], 0, 1).max()
    assert deviations.max() > 40 and np.abs(deviations.astype(int) - flame).max() > 20, (deviations.max(), want)
    clicks(page, "slices")
    page.until("document.getElementById('value').innerText.includes('in the slice')")
    page.shot(f"{bed.shots}/bars-slices.png")
    page.eval("pyrovox.link.say({seek: 2})")  # the set without bars
    page.until("pyrovox.view.set === 2 && document.getElementById('doubt').innerText.includes('no error bars')")
    page.shot(f"{bed.shots}/bars-none.png")
    page.eval("pyrovox.link.say({seek: 3})")
    page.until("pyrovox.view.set === 3 && pyrovox.view.bars.has")
    clicks(page, "bars")
    page.until("!document.getElementById('map-unit').innerText.includes('±')")
    clicks(page, "slices")
    time.sleep(1)
    again = pixels(page, (0, -2.0, 0.32), (0, 0, 0.32), 0.3)
    assert again.max() > 40
    assert not page.troubles(), page.troubles()
    page.close()
    bed.end(bridge)
    for name in glob.glob(f"{bare}/sd/*.npy"):
        os.unlink(name)
    bridge, url = bed.view(bare)
    page = browser.page(url)
    shown(page, url)
    at = lambda x, y: page.do("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    at(box[0] + box[2] / 2, box[1] + box[3] / 2)
    page.until("document.getElementById('value').innerText.includes('no error bar')")
    assert page.eval("document.getElementById('bars-row').hidden")
    page.close()
    bed.end(bridge)


def choose(page, id, value, event="change"):
    page.eval(f"{{ const e = document.getElementById('{id}'); e.value = '{value}'; e.dispatchEvent(new Event('{event}')); }} 0")


def kelvin():
    """Temperatures: a colour bar in kelvin, the value under the pointer with its bar, nothing where there is none; soot by a switch."""
    n = 32
    z, y, x = np.mgrid[0:n, 0:n, 0:n]
    ball = ((x - 15.5) ** 2 + (y - 15.5) ** 2 + (z - 15.5) ** 2) < 100
    truth = 1500.0 + 12 * z
    emission = sooty(truth, np.where(ball, 1.0, 0.0))
    folder = bed.recording("sooty", [emission, emission * 1.5], "box", (-0.5, -0.5, 0), (0.5, 0.5, 1))
    rig = bed.rig(n)
    with open(rig) as f:
        text = f.read()
    with open(f"{bed.dir}/spectral.yaml", "w") as f:
        f.write(text + spectral())
    h5 = f"{bed.dir}/kelvin.h5"
    bed.run(f"{bed.bin}/pyrovox", "temperature", folder, "--rig", f"{bed.dir}/spectral.yaml", "--noise", "0.01", "--quiet", "--out", h5)
    with h5py.File(h5) as f:
        temperature, deviation, soot = (f[k][0] for k in ("temperature", "temperature_sd", "soot"))
    known = np.isfinite(temperature)
    assert known.sum() > 3000 and np.array_equal(known, known & ball)
    bridge, url = bed.view(h5)
    page = browser.page(url)
    shown(page, url)
    page.eval("pyrovox.link.say({play: false, seek: 0})")
    page.until("pyrovox.view.set === 0 && !document.getElementById('legend').hidden")
    assert page.eval("document.getElementById('exposure-rows').hidden && !document.getElementById('scale-rows').hidden")

    def legend():
        ticks = page.eval("[...document.querySelectorAll('#map-ticks span')].map((s) => s.textContent).join()")
        return [float(t) for t in ticks.split(",")], page.eval("document.getElementById('map-unit').textContent"), json.loads(page.eval("JSON.stringify([pyrovox.scaled.scale.low, pyrovox.scaled.scale.high])"))

    def table(share):
        return json.loads(page.eval(f"import('./colours.js').then((m) => JSON.stringify([...m.table(pyrovox.flame().look.colours).slice(4 * Math.round(255 * {share}), 4 * Math.round(255 * {share}) + 3)]))"))
    ticks, title, (low, high) = legend()
    assert title.startswith("temperature, K · hottest along") and 3 <= len(ticks) <= 7, (title, ticks)
    assert all(t % 20 == 0 and low <= t <= high for t in ticks), ticks
    assert low <= np.nanpercentile(temperature, 0.5) and np.nanpercentile(temperature, 99.5) <= high and high - low < 2 * np.ptp(temperature[known]), (low, high)
    bar = json.loads(page.eval("JSON.stringify([...document.getElementById('map').getContext('2d').getImageData(64, 0, 1, 1).data])"))
    assert bar[:3] == table(64 / 255), (bar, table(64 / 255))  # even in the value

    # a look along y from far away: each pixel has the colour of the hottest voxel behind it, or is empty
    eye, fov, far = (0.001, -40.0, 0.501), 1.6, 40.0
    picture = lambda: np.frombuffer(base64.b64decode(page.eval(f"pyrovox.picture(200, 200, {list(eye)}, [0.001, 0, 0.501], {fov}, 1, pyrovox.flame().look.colours)")), np.uint8).reshape(200, 200, 4)[..., :3].astype(int)
    got, half = picture(), np.tan(np.radians(fov) / 2) * far
    hottest, colours = np.nanmax(np.where(known, temperature, 0), 1), np.array([table(i / 255) for i in range(256)])
    seen = empty = 0
    for j in range(10, 190, 6):
        for i in range(10, 190, 6):
            at = np.array((0.001 + (2 * (i + 0.5) / 200 - 1) * half + 0.5, 0.501 - (2 * (j + 0.5) / 200 - 1) * half)) * n
            if np.abs(at - np.round(at)).min() < 0.15 or not (0 < at).all() or not (at < n).all():
                continue  # the rays of a perspective picture are not quite parallel
            t = hottest[int(at[1]), int(at[0])]
            want = np.array((4, 5, 7)) if t == 0 else colours[round(255 * min(1, max(0, (t - low) / (high - low))))]
            assert np.abs(got[j, i] - want).max() <= (1 if t == 0 else 12), (i, j, t, got[j, i], want)
            seen, empty = seen + (t > 0), empty + (t == 0)
    assert seen > 100 and empty > 100, (seen, empty)

    box = json.loads(page.eval("JSON.stringify([...['x', 'y', 'width', 'height'].map((k) => document.getElementById('flame').getBoundingClientRect()[k])])"))
    at = lambda x, y: page.do("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def value(want):
        page.until(f"document.getElementById('value').innerText.includes('{want}') && document.getElementById('value').innerText.includes('±')")
        words = page.eval("document.getElementById('value').innerText")
        v, sd = map(float, re.match(r"([0-9.]+) ± ([0-9.]+) ", words).groups())
        where = [float(w) for w in re.search(r"x (\S+), y (\S+), z (\S+) m", words).groups()]
        i, j, k = (min(n - 1, int(f)) for f in ((where[0] + 0.5) * n, (where[1] + 0.5) * n, where[2] * n))
        return v, sd, (k, j, i), words
    at(box[0] + box[2] / 2, box[1] + box[3] / 2)
    v, sd, cell, words = value(" K")
    assert "hottest along this line of sight" in words and "no error bar" not in words, words
    assert abs(v - temperature[cell]) <= 1.01 and abs(sd / deviation[cell] - 1) < 0.05 and abs(v - truth[cell]) < 3 * sd, (words, temperature[cell], deviation[cell])
    page.shot(f"{bed.shots}/kelvin.png")
    at(box[0] + 300, box[1] + box[3] - 120)
    page.until("document.getElementById('value').hidden")  # beside the flame there is nothing
    at(box[0] + box[2] / 2, box[1] + box[3] / 2)
    # what is saved has the colour bar
    ink = "(() => { const c = pyrovox.saved(), d = c.getContext('2d').getImageData(0, 0, c.width, 70).data; let n = 0; for (let i = 0; i < d.length; i += 4) n += d[i] + d[i + 1] + d[i + 2] > 250; return n; })()"
    assert page.eval(ink) > 800
    # slices, and the bars in place of the values
    page.eval("document.querySelectorAll('details')[1].open = true; 0")
    clicks(page, "slices")
    page.until("document.getElementById('map-unit').textContent.endsWith('in the slices')")
    at(box[0] + box[2] / 2 + 1, box[1] + box[3] / 2)
    page.until("document.getElementById('value').innerText.includes('in the slice')")
    v, sd, cell, words = value(" K")
    assert abs(v - temperature[cell]) <= 1.01, words
    time.sleep(0.5)
    page.shot(f"{bed.shots}/kelvin-slices.png")
    clicks(page, "slices")
    page.until("!document.getElementById('bars-row').hidden && document.getElementById('bars-row').innerText.includes('instead of the temperature')")
    clicks(page, "bars")
    page.until("document.getElementById('map-unit').textContent.startsWith('error bar of temperature, K') && pyrovox.scaled.scale.known")
    ticks, _, (low, high) = legend()
    assert low == 0 and np.nanpercentile(deviation, 99) <= high < 3 * np.nanmax(deviation), (low, high)
    clicks(page, "bars")
    page.until("document.getElementById('map-unit').textContent.startsWith('temperature, K') && pyrovox.scaled.scale.low > 1000")
    # a range of one's own
    choose(page, "scale-low", 1600)
    choose(page, "scale-high", 1800)
    page.until("pyrovox.flame().look.range.join() === '1600,1800' && !document.getElementById('scale-auto').checked")
    assert legend()[0] == [1600, 1650, 1700, 1750, 1800], legend()
    choose(page, "scale-high", 1500)  # none
    assert page.eval("pyrovox.flame().look.range.join()") == "1600,1800"
    clicks(page, "scale-auto")
    page.until("pyrovox.flame().look.range[0] < 1600")
    # soot
    assert page.eval("!document.getElementById('soot-row').hidden")
    clicks(page, "soot")
    page.until("pyrovox.view.start?.units === 'ppm' && pyrovox.view.set >= 0 && document.getElementById('map-unit').textContent.startsWith('soot, ppm') && pyrovox.flame().look.colours === 'viridis'")
    page.eval("pyrovox.link.say({play: false, seek: 0})")
    page.until("pyrovox.view.set === 0")
    at(box[0] + box[2] / 2, box[1] + box[3] / 2)
    v, sd, cell, words = value(" ppm")
    assert abs(v / soot[cell] - 1) < 0.01 and abs(v - 1) < 3 * sd and "most soot along" in words, (words, soot[cell])
    page.shot(f"{bed.shots}/soot.png")
    clicks(page, "soot")
    page.until("pyrovox.view.start?.units === 'K' && pyrovox.view.set >= 0 && document.getElementById('map-unit').textContent.startsWith('temperature, K')")
    page.size(360, 740, touch=True)
    page.until("document.documentElement.scrollWidth <= 360")
    time.sleep(0.5)
    page.shot(f"{bed.shots}/narrow-kelvin.png")
    assert not page.troubles(), page.troubles()
    page.close()
    # without WebGL2 the largest values
    base, token = url.split("#")
    page = browser.page(base + "?flat#" + token)
    shown(page, url)
    page.eval("pyrovox.link.say({play: false, seek: 0})")
    page.until("pyrovox.view.set === 0 && pyrovox.flame().sums.length === 3 && !document.getElementById('legend').hidden")
    most = page.eval("pyrovox.flame().sums[0].v.reduce((a, b) => Math.max(a, b))")
    assert abs(most - np.nanmax(temperature)) <= 1, most
    page.shot(f"{bed.shots}/flat-kelvin.png")
    page.close()
    bed.end(bridge)


def orders():
    """A page of a bridge with --control records and takes a snapshot; one of a bridge without shows no such buttons."""
    daemon, at = bed.daemon(bed.rig(24), more=f'record:\n  volumes_path: "{bed.dir}/takes/v-%Y"\n  path: "{bed.dir}/takes/r-%Y.h5"\n')
    bridge, url = bed.view("--endpoint", at, f"--control=ipc://{bed.dir}/control")
    reader, plain = bed.view("--endpoint", at)
    page, other = browser.page(url), browser.page(plain)
    button = "document.querySelector('[data-order=record]')"
    page.until(f"window.pyrovox && pyrovox.view.volumes > 5 && !document.getElementById('orders').hidden && !{button}.disabled")
    page.eval(f"{button}.click(); 0")
    page.until(f"{button}.textContent === 'Stop recording' && document.querySelector('[data-order=now]').textContent.includes('/takes/v-')")
    page.until("document.querySelector('[data-order=said]').textContent.startsWith('record: ')")
    page.eval("document.querySelector('[data-order=snapshot]').click(); 0")
    page.until("document.querySelector('[data-order=said]').textContent.startsWith('snapshot: /')")
    page.shot(f"{bed.shots}/orders.png")
    page.eval(f"{button}.click(); 0")
    page.until(f"{button}.textContent === 'Record volumes' && document.querySelector('[data-order=said]').textContent.startsWith('stop: /')")
    path = page.eval("document.querySelector('[data-order=said]').textContent").split(": ", 1)[1]
    assert os.path.exists(path), path
    other.until("window.pyrovox && pyrovox.view.volumes > 5 && document.getElementById('orders').hidden")
    assert not page.troubles() and not other.troubles(), (page.troubles(), other.troubles())
    for p in (page, other):
        p.close()
    for p in (bridge, reader, daemon):
        bed.end(p)


def still():
    """A picture that does not change is drawn once at full resolution, and then no more."""
    folder = bed.recording("still", [blobs((24, 24, 24), 3, 1)], "box")
    bridge, url = bed.view(folder)
    page = browser.page(url)
    shown(page, url)
    page.eval("pyrovox.link.say({play: false}); 0")
    page.until("document.querySelector('[data-film=play]').textContent === 'Play'")
    time.sleep(2)
    n = page.eval("pyrovox.view.drawn")
    time.sleep(2)
    assert page.eval("pyrovox.view.drawn") - n <= 1, "it draws though nothing has changed"
    assert page.eval("document.getElementById('flame').width === document.getElementById('flame').clientWidth")
    page.close()
    bed.end(bridge)


def turning():
    """--turn: it turns by itself, until somebody takes hold of it, and not for who does not want motion."""
    folder = bed.recording("turning", [blobs((16, 16, 16), 1, 1)], "box")
    bridge, url = bed.view(folder, "--turn")
    page = browser.page(url)
    shown(page, url)
    was = page.eval("pyrovox.orbit.azimuth")
    page.until(f"pyrovox.orbit.azimuth > {was} + 0.05 && document.getElementById('turn').getAttribute('aria-pressed') === 'true'")
    page.drag(400, 400, 420, 400)
    page.until("document.getElementById('turn').getAttribute('aria-pressed') === 'false'")
    page.key("t")
    page.do("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
    page.until("pyrovox.orbit.still.matches && pyrovox.orbit.turning")  # they asked for it
    was = page.eval("pyrovox.orbit.azimuth")
    page.until(f"pyrovox.orbit.azimuth > {was} + 0.02")
    page.do("Page.reload")
    page.until("window.pyrovox && pyrovox.view.set >= 0 && pyrovox.orbit.still.matches && !pyrovox.orbit.turning")
    page.close()
    bed.end(bridge)


def flat():
    """Without WebGL2: three projections, and why; the same sums as the volume has."""
    v = blobs((24, 20, 28), 3, 2)
    folder = bed.recording("flat", [v], "box")
    bridge, url = bed.view(folder)
    base, token = url.split("#")
    page = browser.page(base + "?flat#" + token)
    shown(page, url)
    page.until("document.getElementById('notice').textContent.includes('WebGL2')")
    assert abs(page.eval("pyrovox.flame().sums[0].v.reduce((a, b) => a + b)") / (v.sum() * 0.8 / 20) - 1) < 1e-4
    assert page.eval("['slices-part', 'turn', 'reset'].every((i) => document.getElementById(i).offsetParent === null)")
    page.shot(f"{bed.shots}/flat.png")
    page.close()
    # a machine whose textures are too small
    page = browser.page(url)
    shown(page, url)
    page.eval("pyrovox.flame().misfit = () => 'this machine\\'s textures end at 16 voxels a side'; 0")
    page.until("document.getElementById('notice').textContent.includes('textures end') && pyrovox.flame().sums.length === 3")
    page.close()
    bed.end(bridge)


def turned_away():
    folder = bed.recording("away", [blobs((16, 16, 16), 1, 1)], "box")
    bridge, url = bed.view(folder)
    for bad, words in ((url.split("#")[0], "lacks its token"), (url[:-4] + "0000", "pyrovox view printed last")):
        page = browser.page(bad)
        page.until(f"document.getElementById('notice').textContent.includes('{words}')")
        assert page.eval("document.getElementById('state').textContent") == "turned away"
        page.shot(f"{bed.shots}/turned-away.png")
        page.close()
    bed.end(bridge)


def other_origin():
    """Another site's page cannot connect, even with the token, nor show this one in a frame."""
    folder = bed.recording("origin", [blobs((16, 16, 16), 1, 1)], "box")
    bridge, url = bed.view(folder)
    at, token = url.split("//")[1].split("/#")

    class Evil(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(f"""<iframe src="http://{at}/"></iframe><script>
const s = new WebSocket("ws://{at}/live", "pyrovox.1"); window.got = "";
s.onopen = () => {{ s.send('{{"token":"{token}","credits":1}}'); window.got = "open"; }};
s.onclose = (e) => {{ window.got = "closed " + e.code; }};
fetch("http://{at}/main.js").then(() => {{ window.read = "read"; }}, () => {{ window.read = "refused"; }});</script>""".encode())

        def log_message(self, *a):
            pass
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Evil)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    page = browser.page(f"http://127.0.0.1:{server.server_port}/")
    page.until("window.got.startsWith('closed')")
    page.until("window.read")
    assert page.eval("window.got") == "closed 1006" and page.eval("window.read") == "refused"
    tree = page.do("Page.getFrameTree")["frameTree"]["childFrames"]
    assert all(f["frame"].get("unreachableUrl") or "chrome-error" in f["frame"]["url"] for f in tree), tree
    server.shutdown()
    page.close()
    bed.end(bridge)


checks = {"picture-is-the-renderers": golden, "no-ghosts": ghosts, "samples": samples, "context-lost": context_lost, "grey-slices-film": grey,
          "draws-only-changes": still, "turning": turning, "without-webgl": flat, "turned-away": turned_away, "another-origin": other_origin, "error-bars": bars, "kelvin": kelvin, "orders": orders, "live": live}
try:
    for name, what in checks.items():
        if only in name:
            bed.check(name, what)
finally:
    browser.close()
    bed.close()
print(f"{bed.passed} passed, {bed.failed} failed, 0 skipped")
sys.exit(1 if bed.failed or not bed.passed else 0)
