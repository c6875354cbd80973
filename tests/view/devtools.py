"""A browser over the DevTools pipe (--remote-debugging-pipe), with the standard library alone."""
import base64
import json
import os
import select
import subprocess
import tempfile
import time

BROWSER = "/usr/bin/chromium-headless-shell"


class Browser:
    def __init__(self, *flags):
        to_r, self.to = os.pipe()
        self.fr, fr_w = os.pipe()
        self.dir = tempfile.TemporaryDirectory(prefix="pyrovox-browser-", ignore_cleanup_errors=True)
        self.n, self.rest, self.events = 0, b"", []

        def place():
            # the pipe is handles 3 and 4; they may be among ours already
            a, b = os.dup2(to_r, 100), os.dup2(fr_w, 101)
            os.dup2(a, 3)
            os.dup2(b, 4)

        self.p = subprocess.Popen(
            [BROWSER, "--remote-debugging-pipe", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--hide-scrollbars", "--ignore-certificate-errors", f"--user-data-dir={self.dir.name}", *flags, "about:blank"],
            preexec_fn=place, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_r)
        os.close(fr_w)

    def read(self, patience):
        end = time.monotonic() + patience
        while b"\0" not in self.rest:
            if not select.select([self.fr], [], [], max(0, end - time.monotonic()))[0]:
                return None
            got = os.read(self.fr, 1 << 20)
            if not got:
                raise EOFError("the browser has ended")
            self.rest += got
        one, self.rest = self.rest.split(b"\0", 1)
        return json.loads(one)

    def send(self, method, session=None, patience=120, **params):
        self.n += 1
        m = {"id": self.n, "method": method, "params": params}
        if session:
            m["sessionId"] = session
        os.write(self.to, json.dumps(m).encode() + b"\0")
        while True:
            got = self.read(patience)
            if got is None:
                raise TimeoutError(method)
            if got.get("id") == m["id"]:
                if "error" in got:
                    raise RuntimeError(f"{method}: {got['error']}")
                return got["result"]
            if "method" in got:
                self.events.append(got)

    def page(self, url="about:blank", width=1280, height=800, touch=False):
        target = self.send("Target.createTarget", url="about:blank", width=width, height=height)["targetId"]
        return Page(self, target, url, width, height, touch)

    def close(self):
        try:
            self.send("Browser.close", patience=10)
        except (TimeoutError, EOFError, OSError):
            pass
        try:
            self.p.wait(20)
        except subprocess.TimeoutExpired:
            self.p.kill()
            self.p.wait()
        self.dir.cleanup()


class Page:
    def __init__(self, browser, target, url, width, height, touch):
        self.b, self.target = browser, target
        self.s = browser.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.do(f"{domain}.enable")
        self.size(width, height, touch)
        if url != "about:blank":
            self.do("Page.navigate", url=url)

    def do(self, method, **params):
        return self.b.send(method, self.s, **params)

    def size(self, width, height, touch=False, scale=1):
        self.do("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=touch)
        self.do("Emulation.setTouchEmulationEnabled", enabled=touch)

    def eval(self, js):
        r = self.do("Runtime.evaluate", expression=js, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in r:
            raise RuntimeError(f"{js[:200]}: {r['exceptionDetails'].get('exception', {}).get('description', r['exceptionDetails'])}")
        return r["result"].get("value")

    def until(self, js, patience=90):
        """Patience is for a machine that is busy; what never comes fails with what the page says."""
        end = time.monotonic() + patience
        while True:
            try:
                v = self.eval(js)
            except RuntimeError:
                v = None  # the page may still be on its way
            if v:
                return v
            if time.monotonic() > end:
                raise AssertionError(f"never came: {js}; the page says: {self.eval('document.body.innerText')[:600]!r}; {self.troubles()}")
            time.sleep(0.05)

    def troubles(self):
        """What the console was told of errors."""
        out = []
        for e in self.b.events:
            if e.get("sessionId") != self.s:
                continue
            if e["method"] == "Runtime.exceptionThrown":
                out.append(e["params"]["exceptionDetails"].get("exception", {}).get("description", str(e["params"])))
            elif e["method"] == "Log.entryAdded" and e["params"]["entry"]["level"] == "error":
                out.append(e["params"]["entry"]["text"])
        return out

    def shot(self, path):
        data = self.do("Page.captureScreenshot", format="png")["data"]
        with open(path, "wb") as f:
            f.write(base64.b64decode(data))

    def key(self, key, text=None, modifiers=0):
        codes = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Home": 36, "Tab": 9, " ": 32, "Enter": 13}
        k = {"key": key, "windowsVirtualKeyCode": codes.get(key, ord(key.upper()[0])), "modifiers": modifiers}
        if text:
            k["text"] = text
        self.do("Input.dispatchKeyEvent", type="keyDown", **k)
        self.do("Input.dispatchKeyEvent", type="keyUp", **k)

    def mouse(self, kind, x, y, **more):
        self.do("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, x, y, to_x, to_y, button="left"):
        bit = {"left": 1, "right": 2, "middle": 4}[button]
        self.mouse("mousePressed", x, y, button=button, buttons=bit, clickCount=1)
        for i in range(1, 6):
            self.mouse("mouseMoved", x + (to_x - x) * i / 5, y + (to_y - y) * i / 5, button=button, buttons=bit)
        self.mouse("mouseReleased", to_x, to_y, button=button, buttons=0, clickCount=1)

    def touch(self, kind, *points):
        self.do("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)])

    def close(self):
        self.b.send("Target.closeTarget", targetId=self.target)
