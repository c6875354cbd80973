"""A WebSocket to `pyrovox view`, of the standard library alone (RFC 6455; PROTOCOL.md, Over a WebSocket)."""
from __future__ import annotations

import base64
import hashlib
import json
import os
import selectors
import socket
import ssl
import struct
import time
from dataclasses import dataclass, field
from typing import Any, Optional, Tuple, Union
from urllib.parse import urlsplit

GUID = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
PROTOCOL = "pyrovox.1"
MOST = 1 << 30  # bytes of a message
HEAD = 16384  # bytes of the answer to the request
CONTINUED, TEXT, BINARY, CLOSE, PING, PONG = 0, 1, 2, 8, 9, 10
Message = Tuple[str, Any]  # "text" and an object, "binary" and bytes


class BadAddress(ValueError):
    """Not what `pyrovox view` prints; the text says what should be there."""


class Refused(ConnectionError):
    """The answer to the request was not 101."""

    def __init__(self, status: int, body: str):
        super().__init__(f"{status}: {body}")
        self.status, self.body = status, body


class Closed(ConnectionError):
    """The other end closed, or the connection ended (1006)."""

    def __init__(self, code: int, why: str):
        super().__init__(f"closed {code}: {why}")
        self.code, self.why = code, why


class Broken(ConnectionError):
    """What came is not RFC 6455."""


@dataclass(frozen=True)
class Address:
    """What `pyrovox view` prints: http://127.0.0.1:8737/#TOKEN, taken apart.

    >>> a = Address.read("http://127.0.0.1:8737/#" + 32 * "a")
    >>> str(a), a.tls                  # the token is in no text of it
    ('http://127.0.0.1:8737/', False)
    """

    host: str
    port: int
    tls: bool
    token: str = field(repr=False)

    @staticmethod
    def read(text: str) -> "Address":
        text = text.strip()
        try:
            u = urlsplit(text if "://" in text else "http://" + text)
            host, port = u.hostname, u.port
        except ValueError:
            host = None
        if not host or u.scheme not in ("http", "https"):
            raise BadAddress("not an address as pyrovox view prints it: http://127.0.0.1:8737/#... (all of it)")
        if u.fragment and (len(u.fragment) != 32 or not set(u.fragment) <= set("0123456789abcdef")):
            raise BadAddress("what stands behind '#' is not a token of 32 digits: copy the whole line that pyrovox view prints")
        return Address(host, port or (443 if u.scheme == "https" else 80), u.scheme == "https", u.fragment)

    @property
    def name(self) -> str:
        """HOST:PORT."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    def __str__(self) -> str:
        return f"http{'s' if self.tls else ''}://{self.name}/"


class Frames:
    """Bytes in, whole messages out: of a server, up to `most` bytes each.  No socket in it.

    >>> f = Frames(most=100)
    >>> f.feed(bytes([0x82, 3]) + b"ab")
    >>> f.take()                       # not yet whole: None
    >>> f.feed(b"c")
    >>> f.take()
    (2, b'abc')
    """

    def __init__(self, most: int):
        self.most = most
        self._in = bytearray()
        self._parts: list[bytes] = []
        self._size = self._kind = 0

    def feed(self, data: bytes) -> None:
        self._in += data

    def take(self) -> Optional[Tuple[int, bytes]]:
        """(opcode, payload) of a message or a control frame; None: more has to come.  Raises Broken."""
        while True:
            frame = self._frame()
            if frame is None:
                return None
            last, opcode, data = frame
            if opcode >= CLOSE:
                return opcode, data
            if (opcode == CONTINUED) != (self._kind != 0):
                raise Broken("a part of a message out of turn")
            self._kind = self._kind or opcode
            self._parts.append(data)
            self._size += len(data)
            if last:
                whole = data if len(self._parts) == 1 else b"".join(self._parts)
                kind, self._kind, self._size = self._kind, 0, 0
                self._parts.clear()
                return kind, whole

    def _frame(self) -> Optional[Tuple[bool, int, bytes]]:
        head = self._in
        if len(head) < 2:
            return None
        last, opcode, size, at = bool(head[0] & 0x80), head[0] & 15, head[1], 2
        if head[0] & 0x70 or opcode not in (CONTINUED, TEXT, BINARY, CLOSE, PING, PONG):
            raise Broken("a frame of a kind that nobody asked for")
        if size & 0x80:
            raise Broken("a server does not mask")
        if opcode >= CLOSE and (size > 125 or not last):
            raise Broken("a control frame too long or in parts")
        if size >= 126:
            at = 4 if size == 126 else 10
            if len(head) < at:
                return None
            size = int.from_bytes(head[2:at], "big")
        if size + (self._size if opcode < CLOSE else 0) > self.most:
            raise Broken(f"a message of more than {self.most >> 20} MiB")
        if len(head) < at + size:
            return None
        data = bytes(memoryview(head)[at : at + size])
        del self._in[: at + size]
        return last, opcode, data


def frame(opcode: int, data: bytes = b"", fin: bool = True) -> bytes:
    """As a client has to send it: masked."""
    mask, n = os.urandom(4), len(data)
    size = bytes([0x80 | n]) if n < 126 else struct.pack(">BH", 0xFE, n) if n < 65536 else struct.pack(">BQ", 0xFF, n)
    return bytes([(0x80 if fin else 0) | opcode]) + size + mask + bytes(b ^ mask[i & 3] for i, b in enumerate(data))


def connect(address: Tuple[str, int], tls: Union[ssl.SSLContext, str, None] = None, patience: float = 30, receive_buffer: int = 0) -> socket.socket:
    """A socket; `tls`: a context, or the file of the certificate that is to be believed."""
    if receive_buffer:  # has to be set before
        s = socket.socket(socket.AF_INET)
        s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        s.settimeout(patience)
        s.connect(address)
    else:
        s = socket.create_connection(address, patience)
    s.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if tls is not None:
        try:
            context = tls if isinstance(tls, ssl.SSLContext) else ssl.create_default_context(cafile=tls)
            return context.wrap_socket(s, server_hostname=address[0])
        except BaseException:
            s.close()
            raise
    return s


class WebSocket:
    """One connection, for one thread.  Raises Refused, Closed, Broken, OSError (TimeoutError among them).

    Nothing of the token is in the request: it is said first, on the open connection.
    """

    def __init__(self, address: Tuple[str, int], host: Optional[str] = None, origin: Optional[str] = None, path: str = "/live", protocol: str = PROTOCOL,
                 tls: Union[ssl.SSLContext, str, None] = None, patience: float = 30, receive_buffer: int = 0, most: int = MOST):
        self.frames = Frames(most)
        self.s = connect(address, tls, patience, receive_buffer)
        try:
            self._hello(host or "%s:%d" % address, origin, path, protocol)
        except BaseException:
            self.s.close()
            raise
        self._watch = selectors.DefaultSelector()
        self._watch.register(self.s, selectors.EVENT_READ)

    def _hello(self, host: str, origin: Optional[str], path: str, protocol: str) -> None:
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [f"GET {path} HTTP/1.1", f"Host: {host}", "Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13",
                 f"Sec-WebSocket-Key: {key}", f"Sec-WebSocket-Protocol: {protocol}"]
        if origin:
            lines.append(f"Origin: {origin}")
        self.s.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        answer = b""
        while b"\r\n\r\n" not in answer:
            got = self.s.recv(4096)
            if not got or len(answer) > HEAD:
                raise Refused(0, "closed before it answered" if not got else "an answer without an end")
            answer += got
        head, rest = answer.split(b"\r\n\r\n", 1)
        first, *others = head.decode("latin-1").split("\r\n")
        words = first.split()
        if len(words) < 2 or not words[0].startswith("HTTP/1.") or not words[1].isdigit():
            raise Refused(0, "not HTTP")
        if words[1] != "101":
            raise Refused(int(words[1]), rest.decode(errors="replace").strip()[:200])
        headers = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in others)}
        want = base64.b64encode(hashlib.sha1((key + GUID).encode()).digest()).decode()
        if headers.get("sec-websocket-accept") != want or headers.get("sec-websocket-protocol") != PROTOCOL:
            raise Broken("the answer is that of another protocol")
        self.frames.feed(rest)

    def frame(self, opcode: int, data: bytes = b"", fin: bool = True) -> None:
        self.s.sendall(frame(opcode, data, fin))

    def say(self, **words: Any) -> None:
        self.frame(TEXT, json.dumps(words).encode())

    def watch(self, other: socket.socket) -> None:
        """wait() ends when something comes there, too."""
        self._watch.register(other, selectors.EVENT_READ)

    def wait(self, patience: Optional[float]) -> None:
        """Until something may have come, here or at those watched, or patience (s) ends."""
        if not (isinstance(self.s, ssl.SSLSocket) and self.s.pending()):
            self._watch.select(patience)

    def take(self) -> Optional[Message]:
        """What has come whole, or None; never waits.  Pings are answered."""
        came = False
        while True:
            m = self.frames.take()
            if m is None:
                if came:
                    return None
                came = True
                data = self._come()
                if data == b"":
                    raise Closed(1006, "the connection ended")
                self.frames.feed(data or b"")
                continue
            opcode, payload = m
            if opcode == CLOSE:
                code = int.from_bytes(payload[:2], "big") if len(payload) >= 2 else 1005
                raise Closed(code, payload[2:].decode(errors="replace"))
            if opcode == PING:
                self.frame(PONG, payload)
            elif opcode == BINARY:
                return "binary", payload
            elif opcode == TEXT:
                try:
                    return "text", json.loads(payload.decode())
                except (ValueError, RecursionError):
                    raise Broken("a text that is not JSON") from None

    def _come(self) -> Optional[bytes]:
        """None: nothing."""
        before = self.s.gettimeout()
        self.s.settimeout(0)
        try:
            return self.s.recv(1 << 18)
        except (BlockingIOError, ssl.SSLWantReadError):
            return None
        finally:
            self.s.settimeout(before)

    def next(self, patience: float = 30) -> Message:
        """The next message; TimeoutError."""
        end = time.monotonic() + patience
        while True:
            m = self.take()
            if m is not None:
                return m
            left = end - time.monotonic()
            if left <= 0:
                raise TimeoutError(f"nothing came in {patience:g} s")
            self.wait(left)

    def close(self) -> None:
        self._watch.close()
        self.s.close()
