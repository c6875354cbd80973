"""Volumes of a running daemon."""
from __future__ import annotations

import asyncio
import os
import struct
import time
from collections import deque
from types import TracebackType
from typing import Any, AsyncIterator, Iterator, Optional, Union

import zmq

from . import _page
from .volume import Grid, Volume, bars_of, grid_of, volume_of

Raw = tuple[dict[str, Any], bytes]  # header and body of a message


class Refused(ConnectionError):
    """The daemon does not let us in, or is not the one that the key is for; the text says the remedy."""


class Subscription:
    """What subscribe() returns: iterate over it, `for` or `async for`; close it, or use `with`.

    It ends when the daemon says that it ends: then `reason` says why.

        grid       of this session, a Grid; None before the first `start`
        lost       messages that did not reach us, in all;  skipped: volumes passed over by `newest`
        received, malformed
        status     the daemon's counters, as `pyrovox status --json` gives them, as they came last
        rig        text of the rig.yaml in effect, "" where the daemon does not say it
        events     what happened lately, the last 100, dicts as the daemon says them (PROTOCOL.md)
    """

    def __init__(self, endpoint: str, key: Optional[Union[str, "os.PathLike[str]"]] = None, newest: bool = False,
                 timeout: Optional[float] = None, memory: int = _page.MEMORY):
        self.endpoint, self.key, self.newest, self.memory = endpoint, os.fspath(key or ""), newest, memory
        self.timeout = timeout
        self.grid: Optional[Grid] = None
        self.lost = self.skipped = self.received = self.malformed = 0
        self.status: dict[str, Any] = {}
        self.rig = self.reason = ""
        self.events: deque[dict[str, Any]] = deque(maxlen=100)
        self._start: Optional[dict[str, Any]] = None
        self._session: Optional[int] = None
        self._next = 0
        self._waiting: Optional[tuple[dict[str, Any], bytes, Optional[Raw]]] = None  # the newest volume so far, its bars
        self._bars: Optional[Raw] = None  # the newest
        self._ended = False
        self._refusal = ""
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.SUB)
        self._door: Optional[_page.Door] = None
        try:
            self._connect()
        except BaseException:
            self.close()
            raise

    def _connect(self) -> None:
        s = self._socket
        s.setsockopt(zmq.LINGER, 0)
        s.setsockopt(zmq.RCVHWM, 16)
        s.setsockopt(zmq.MAXMSGSIZE, 2 * self.memory + (1 << 20))
        s.setsockopt(zmq.SUBSCRIBE, b"PVX1")
        if self.key:
            try:
                _page.use_key(s, self.key)
            except (zmq.ZMQError, UnicodeDecodeError):
                raise ValueError(f"{self.key}: is not a key file; make one with pyrovox keygen --server") from None
        self._door = _page.Door(s, self.endpoint, self.key)
        try:
            s.connect(self.endpoint)
        except zmq.ZMQError as e:
            raise ValueError(f"{self.endpoint}: is no endpoint ({e.strerror}); "
                             "ipc:///run/pyrovox/volumes or tcp://HOST:5555") from None

    def __repr__(self) -> str:
        state = "closed" if self._socket.closed else "ended" if self._ended else "open"
        return f"<Subscription {self.endpoint}, {state}: {self.received} messages, {self.lost} lost>"

    def close(self) -> None:
        """Ends it; what came and was not asked for is dropped.

        >>> sub.close()                     # doctest: +SKIP
        """
        if self._door is not None:
            self._door.close()
        self._socket.close(0)

    def __enter__(self) -> "Subscription":
        return self

    def __exit__(self, kind: Optional[type[BaseException]], e: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()

    def __iter__(self) -> Iterator[Volume]:
        return self

    def __next__(self) -> Volume:
        until = self._until()
        while True:
            v = self._take()
            if v is not None:
                return v
            if self._ended or self._socket.closed:
                raise StopIteration
            poller = zmq.Poller()
            for s in self._sockets():
                poller.register(s, zmq.POLLIN)
            poller.poll(self._left(until))

    def __aiter__(self) -> AsyncIterator[Volume]:
        return self

    async def __anext__(self) -> Volume:
        until = self._until()
        while True:
            v = self._take()
            if v is not None:
                await asyncio.sleep(0)  # others may run, however fast volumes come
                return v
            if self._ended or self._socket.closed:
                raise StopAsyncIteration
            await self._wait(self._left(until))

    async def _wait(self, left: Optional[int]) -> None:
        """Until one of the sockets, of which all was taken, may have more."""
        loop = asyncio.get_running_loop()
        more = asyncio.Event()
        handles = [int(s.getsockopt(zmq.FD)) for s in self._sockets()]
        for fd in handles:
            loop.add_reader(fd, more.set)
        try:
            await asyncio.wait_for(more.wait(), None if left is None else left / 1000)
        except asyncio.TimeoutError:
            pass  # _left says so
        finally:
            for fd in handles:
                loop.remove_reader(fd)

    def _sockets(self) -> list["zmq.Socket[bytes]"]:
        return [self._socket] + ([self._door.news] if self._door is not None else [])

    def _until(self) -> Optional[float]:
        return None if self.timeout is None else time.monotonic() + self.timeout

    def _left(self, until: Optional[float]) -> Optional[int]:
        """Milliseconds; raises TimeoutError."""
        if until is None:
            return None
        left = until - time.monotonic()
        if left <= 0:
            raise TimeoutError(f"{self.endpoint}: no volume in {self.timeout:g} s")
        return int(left * 1000) + 1

    def _take(self) -> Optional[Volume]:
        """The next volume of what is there already; None: nothing more is."""
        self._look()
        for _ in range(1000):  # who sends faster than this reads does not keep us for ever
            if self._ended or self._socket.closed:
                break
            try:
                message = self._socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                break
            v = self._message(message)
            if v is not None:
                return v
        waiting, self._waiting = self._waiting, None
        return self._volume(*waiting) if waiting else None

    def _look(self) -> None:
        """Raises Refused where the daemon does not let us in."""
        if not self._refusal and self._door is not None:
            self._refusal = self._door.look()
        if self._refusal:
            raise Refused(f"{self.endpoint}: {self._refusal}")

    def _message(self, message: bytes) -> Optional[Volume]:
        try:
            m, body = _page.decode_header(message)
        except _page.BadMessage:
            self.malformed += 1
            return None
        if m["session"] != self._session:
            self._session, self._next = m["session"], m["sequence"]
            self._start = self.grid = self._bars = None
        if m["sequence"] < self._next:
            return None  # a repetition
        self.lost += m["sequence"] - self._next
        self._next = m["sequence"] + 1
        self.received += 1
        if m["type"] == "bars":
            self._bars = m, body
        elif m["type"] != "volume":
            self._note(m["type"], body)
        elif self._start is not None:
            bars, self._bars = self._bars, None
            if not self.newest:
                return self._volume(m, body, bars)
            self.skipped += self._waiting is not None
            self._waiting = m, body, bars
        return None

    def _note(self, kind: Any, body: bytes) -> None:
        """What is not a volume.  A daemon of a later version may say more than this knows."""
        if kind == "start":
            self._start = self.grid = None  # until it was read
        if kind not in ("start", "end", "status", "rig", "event"):
            return
        try:
            m = _page.decode_body(kind, body, self.memory, None)
            if kind == "start":
                self.grid = grid_of(m)
                self._start = m
        except _page.TooLarge as e:
            raise _page.TooLarge(f"{e}; memory=BYTES allows more") from None
        except (struct.error, ValueError, RecursionError):
            self.malformed += 1
            return
        if kind == "end":
            self._ended, self.reason = True, m.get("reason", "")
        elif kind == "status":
            self.status = m.get("status", {})
        elif kind == "rig":
            self.rig = m.get("rig", "")
        elif kind == "event":
            self.events.append(m.get("event", {}))

    def _volume(self, m: dict[str, Any], body: bytes, bars: Optional[Raw]) -> Optional[Volume]:
        try:
            v = volume_of(m, body, self.memory, self._start)
        except _page.BadMessage:
            self.malformed += 1
            return None
        if bars is not None:  # a volume is worth more than its bars
            self.malformed += not bars_of(v, *bars, self.memory, self._start)
        v.lost = self.lost
        return v


def endpoint_here() -> str:
    """As `pyrovox status` finds it: the service that this process is of, a daemon of this user, the installed one."""
    run = os.environ.get("RUNTIME_DIRECTORY", "").split(":")[0]
    own, installed = f"/tmp/pyrovox-{os.geteuid()}/volumes", "/run/pyrovox/volumes"
    if 0 < len(run) < 128 and run[0] == "/":
        return f"ipc://{run}/volumes"
    return f"ipc://{installed if os.path.exists(installed) and not os.path.exists(own) else own}"


def subscribe(endpoint: Optional[str] = None, *, key: Optional[Union[str, "os.PathLike[str]"]] = None, newest: bool = False,
              timeout: Optional[float] = None, memory: int = _page.MEMORY) -> Subscription:
    """Volumes of the daemon at `endpoint`; it need not run yet, and may be started anew.

    endpoint  ipc:///run/pyrovox/volumes or tcp://HOST:5555; None: the daemon of this user, or of this host
    key       your .key file, for a daemon that asks for one (pyrovox keygen --server)
    newest    only the newest volume that is there, each time one is asked for
    timeout   seconds without a volume after which TimeoutError is raised; None: never
    memory    bytes that a volume may need as floats

    Raises Refused when the daemon does not let us in or is another one, TooLarge when its volumes need
    more memory; what is damaged is left out and counted.  Ctrl-C works while it waits.

    >>> for v in pyrovox.subscribe("tcp://lab:5555", key="me.key", newest=True):     # doctest: +SKIP
    ...     print(v.set, v.time, v.dense.max(), v.lost)

    >>> async for v in pyrovox.subscribe("tcp://lab:5555"):                          # doctest: +SKIP
    ...     await show(v)
    """
    return Subscription(endpoint or endpoint_here(), key, newest, timeout, memory)
