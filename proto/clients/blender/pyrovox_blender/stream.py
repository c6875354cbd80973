"""Follows one bridge in a thread: messages in, .vdb files out.  No Blender in it.

The bridge sends a volume for a credit, the newest at that moment.  The next credit goes out when the last volume was
shown, or waited to be for REFRESH, or, in a recording, when it was written: who is slow gets fewer, never older ones.
"""
from __future__ import annotations

import os
import socket
import ssl
import struct
import threading
import time
from collections import deque
from typing import Any, Optional

import numpy as np

from . import _page, vdb
from .websocket import Address, Broken, Closed, Refused, WebSocket

AGAIN = (0.5, 1.0, 2.0, 5.0)  # s between attempts
REFRESH = 0.2  # s that a volume waits for a Blender that is busy, before a newer one takes its place
SILENT = 15.0  # s without a word of the bridge, which says something each second
CONNECT = 10.0  # s
REMEDY = {
    4401: "the token is not this bridge's (it makes a new one when it starts): paste the address that pyrovox view printed last",
    4408: "the bridge heard no token in 5 s: connect again",
    4400: "the bridge does not understand this add-on: take both from the same version of Pyrovox",
}
STATUS = {
    403: "the bridge takes this for a page of another site",
    421: "the bridge is not known by this name: use the address that it prints, or start it with --host NAME",
    400: "the bridge does not speak pyrovox.1: take both from the same version of Pyrovox",
    404: "a web server, but no pyrovox view: correct the address",
}


class Hopeless(Exception):
    """Trying again cannot help; the text says what does."""


def trouble(e: BaseException, address: Address) -> str:
    """One sentence with its remedy."""
    if isinstance(e, Closed):
        if e.code == 4503:
            return "all 16 places of the bridge are taken: close a page; trying again"
        return REMEDY.get(e.code, f"{address.name} went away ({e.why or e.code}): waiting for it")
    if isinstance(e, Refused):
        return STATUS.get(e.status, f"{address.name} answers, but is no pyrovox view{' of this kind (http or https?)' if e.status == 0 else ''}: correct the address")
    if isinstance(e, ssl.SSLCertVerificationError):
        return f"the certificate of {address.name} is not one that is trusted here ({e.verify_message}): choose its file as Certificate"
    if isinstance(e, ssl.SSLError):
        return f"{address.name} does not speak TLS: an address with http://?"
    if isinstance(e, ConnectionRefusedError):
        return f"nobody listens at {address.name}: start pyrovox view there, or correct the address; trying again"
    if isinstance(e, socket.gaierror):
        return f"{address.host} is no name of a host: correct the address"
    if isinstance(e, TimeoutError):
        return f"{address.name} does not answer: trying again"
    if isinstance(e, Broken):
        return f"{address.name}: {e}: correct the address, or take both from the same version of Pyrovox"
    return f"{address.name}: {getattr(e, 'strerror', None) or e}: trying again"


class Stream:
    """One bridge, from start() to stop().  All but the thread's own may be read and called by one other thread.

        state     "connecting", "live", "failed" (has ended by itself)
        error     a sentence with its remedy, "" if all is well
        notice    a recording that ended by itself
        reason    the daemon said that it ends, and why
        link      what the bridge says each second (PROTOCOL.md)
        received, written, malformed, sessions; passed: written, and a newer one came before it was shown
    """

    def __init__(self, address: Address, shelf: vdb.Shelf, library: Any, certificate: str = "", memory: int = _page.MEMORY):
        self.address, self.shelf, self.memory, self.certificate = address, shelf, memory, certificate
        self.state, self.error, self.notice, self.reason = "connecting", "", "", ""
        self.link: dict[str, Any] = {}
        self.received = self.written = self.malformed = self.sessions = self.passed = 0
        self.grid: Optional[dict[str, Any]] = None
        self._vdb = library
        self._take: Optional[vdb.Take] = None
        self._newest: Optional[vdb.Entry] = None
        self._session: Optional[int] = None
        self._next = 0
        self._owed = False  # a credit that goes out when what came was shown
        self._paused = self._stop = False
        self._stamps: deque[float] = deque(maxlen=30)
        self._lock = threading.Lock()
        self._say: deque[dict[str, Any]] = deque()
        self._woken, self._wake = socket.socketpair()
        self._woken.setblocking(False)
        self._wake.setblocking(False)
        self._thread = threading.Thread(target=self._run, name="pyrovox", daemon=True)

    # ---- for the other thread: none of these waits ------------------------------------------

    def start(self) -> None:
        self._thread.start()

    def stop(self, patience: float = 2) -> None:
        """Ends the thread; what it is writing is finished, a connection that is being made is not waited for."""
        self._stop = True
        self._poke()
        if self._thread.is_alive():
            self._thread.join(patience)

    def newest(self) -> Optional[vdb.Entry]:
        """The newest volume, once; shown() has to follow."""
        with self._lock:
            e, self._newest = self._newest, None
            return e

    def shown(self, e: vdb.Entry) -> None:
        """It is on the screen: the bridge hears that, and sends the next."""
        with self._lock:
            self._say.append({"held": e.set, "drawn": e.set, **({"credits": 1} if self._owed else {})})
            self._owed = False
        self._poke()

    def pause(self, on: bool) -> None:
        with self._lock:
            self._paused = on
            self._say.append({"hidden": on})
        self._poke()

    def record(self, take: Optional[vdb.Take]) -> None:
        """From now on all volumes go there; None: no longer."""
        with self._lock:
            self._take, self.notice = take, ""
            if self._owed and take is not None:  # nobody may be there to show it
                self._say.append({"credits": 1})
                self._owed = False
        self._poke()

    def recording(self) -> Optional[vdb.Take]:
        return self._take

    def rate(self) -> float:
        """Volumes a second, lately."""
        t = list(self._stamps)
        if len(t) < 2 or time.monotonic() - t[-1] > 3 + 2 * (t[-1] - t[-2]):
            return 0.0
        return (len(t) - 1) / max(t[-1] - t[0], 1e-6)

    def age_ms(self) -> float:
        """Since published, the median of late ones as the bridge knows it; where clocks do not agree, since sent."""
        whole, drawn = self.link.get("whole_ms", [None]), self.link.get("drawn_ms", [None])
        return float(whole[0] if whole[0] is not None else drawn[0] or 0)

    def drops(self) -> dict[str, int]:
        """Volumes that were not shown, by place."""
        return {"daemon to bridge": int(self.link.get("lost", 0)), "bridge": int(self.link.get("superseded", 0)), "Blender": self.passed, "damaged": self.malformed}

    def _poke(self) -> None:
        try:
            self._wake.send(b".")
        except OSError:
            pass  # enough of them wait, or it has ended

    # ---- the thread ------------------------------------------------------------------------

    def _run(self) -> None:
        attempt = 0
        while not self._stop:
            before = self.received
            try:
                self._follow()
            except Hopeless as e:
                self.error, self.state = str(e), "failed"
                break
            except (OSError, ValueError) as e:  # ValueError: a link that is not as the protocol says
                self.error = trouble(e, self.address)
                if isinstance(e, Closed) and e.code in REMEDY or isinstance(e, ssl.SSLCertVerificationError):
                    self.state = "failed"
                    break
            self.state = "connecting"
            attempt = 0 if self.received > before else min(attempt + 1, len(AGAIN) - 1)
            end = time.monotonic() + AGAIN[attempt]
            while not self._stop and time.monotonic() < end:
                time.sleep(0.05)
        self._wake.close()
        self._woken.close()

    def _tls(self) -> Optional[ssl.SSLContext]:
        if not self.address.tls:
            return None
        try:
            return ssl.create_default_context(cafile=self.certificate or None)
        except (OSError, ssl.SSLError) as e:
            raise Hopeless(f"{self.certificate}: not a certificate that can be read ({e.strerror or e})") from None

    def _follow(self) -> None:
        a = self.address
        ws = WebSocket((a.host, a.port), host=a.name, tls=self._tls(), patience=CONNECT, most=self.memory + (16 << 20))
        try:
            ws.watch(self._woken)
            with self._lock:
                self._say.clear()
                self._owed, self._newest = False, None
            self._next, self.grid, self._session = 0, None, None
            ws.say(token=a.token, credits=1, hidden=self._paused)
            heard = time.monotonic()
            while not self._stop:
                self._speak(ws)
                m = ws.take()
                if m is None:
                    if time.monotonic() - heard > SILENT:
                        raise TimeoutError
                    ws.wait(REFRESH if self._owed else 1)
                    if self._stale():
                        ws.say(credits=1)
                    continue
                heard = time.monotonic()
                if m[0] == "text":
                    self._hear(m[1])
                elif self._message(m[1]):
                    ws.say(credits=1)
        finally:
            ws.close()

    def _stale(self) -> bool:
        """A volume has waited long enough to be shown."""
        with self._lock:
            stale = self._owed and self._newest is not None and time.monotonic() - self._stamps[-1] > REFRESH
            self._owed = self._owed and not stale
            return stale

    def _speak(self, ws: WebSocket) -> None:
        try:
            while self._woken.recv(4096):
                pass
        except OSError:
            pass
        with self._lock:
            words = list(self._say)
            self._say.clear()
        for w in words:
            ws.say(**w)

    def _hear(self, m: Any) -> None:
        if isinstance(m, dict) and isinstance(m.get("link"), dict):
            self.link = m["link"]
            if self.state != "live":
                self.state, self.error = "live", ""

    def _message(self, raw: bytes) -> bool:
        """True: the next volume may come at once."""
        try:
            m, body = _page.decode_header(raw)
            if m["session"] != self._session:
                self._session, self._next, self.grid = m["session"], 0, None
                self.sessions += 1
                self.reason = ""
            self.state = "live"
            kind = m["type"]
            if kind == "start":
                self.grid = _page.decode_body(kind, body, self.memory, None)
                if self.grid["units"] == "K":
                    raise Hopeless("this bridge has temperatures, which are no light: bake them by `pyrovox convert` to .vdb")
            elif kind == "end":
                self.reason = str(_page.decode_body(kind, body, self.memory, None)["reason"])
            elif kind == "volume":
                if m["type_sequence"] < self._next:  # of volumes alone: messages of other types overtake them here
                    return True
                self._next = m["type_sequence"] + 1
                return self._volume(m, body)
        except _page.TooLarge as e:
            raise Hopeless(f"{e}: the add-on's preferences allow more") from None
        except (struct.error, ValueError, OverflowError):
            self.malformed += 1
            return True  # in place of one that was damaged
        return False

    def _volume(self, head: dict[str, Any], body: bytes) -> bool:
        self.received += 1
        m = _page.decode_bricks(body, self.memory, self.grid)
        if not np.isfinite(m["values"]).all() or not all(a < b for a, b in zip(m["min"], m["max"])):
            raise _page.BadMessage("not finite, or a box that is none")
        m["session"] = head["session"]
        with self._lock:
            take = self._take
        e = None
        if take is not None:
            try:
                if take.entries and (take.entries[-1].session, take.entries[-1].channels) != (m["session"], m["channels"]):
                    take = vdb.Take(os.path.dirname(take.folder))  # a sequence has one grid
                    with self._lock:
                        self._take = take if self._take is not None else None
                e = take.put(self._vdb, m)
            except vdb.NoRoom as x:
                self.notice = f"recording has ended after {len(take.entries)} volumes: {x}"
                with self._lock:
                    take = self._take = None
        if e is None:
            try:
                e = self.shelf.put(self._vdb, m)
            except vdb.NoRoom as x:
                self.error = str(x)
                return True  # the next is tried: somebody may make room
        self.error = ""
        self.written += 1
        self._stamps.append(time.monotonic())
        with self._lock:
            self.passed += self._newest is not None and take is None
            self._newest = e
            self._owed = take is None
        return take is not None
