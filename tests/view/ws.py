"""A WebSocket client of the standard library alone, strict about what it is answered; for tests."""
import base64
import hashlib
import json
import os
import socket
import ssl
import struct
import time

GUID = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"


class Refused(Exception):
    """The answer to the request was not 101."""

    def __init__(self, status, body):
        super().__init__(f"{status}: {body}")
        self.status, self.body = status, body


class Closed(Exception):
    def __init__(self, code, why):
        super().__init__(f"closed {code}: {why}")
        self.code, self.why = code, why


def request(address, text, tls=None, patience=30):
    """Bytes as they are to a port; all that comes back until it is closed."""
    s = connect(address, tls, patience)
    s.sendall(text if isinstance(text, bytes) else text.encode())
    out = b""
    while True:
        try:
            got = s.recv(65536)
        except ConnectionResetError:
            break
        if not got:
            break
        out += got
    s.close()
    return out


def connect(address, tls=None, patience=30):
    s = socket.create_connection(address, patience)
    if tls:
        context = ssl.create_default_context(cafile=tls)
        s = context.wrap_socket(s, server_hostname="localhost")
    return s


class WebSocket:
    def __init__(self, address, host=None, origin=None, path="/live", protocol="pyrovox.1", tls=None, patience=30, receive_buffer=0):
        key = base64.b64encode(os.urandom(16)).decode()
        if receive_buffer:
            self.s = socket.socket(socket.AF_INET)
            self.s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
            self.s.settimeout(patience)
            self.s.connect(address)
        else:
            self.s = connect(address, tls, patience)
        lines = [f"GET {path} HTTP/1.1", f"Host: {host or '%s:%d' % address}", "Connection: Upgrade", "Upgrade: websocket",
                 "Sec-WebSocket-Version: 13", f"Sec-WebSocket-Key: {key}", f"Sec-WebSocket-Protocol: {protocol}"]
        if origin:
            lines.append(f"Origin: {origin}")
        self.s.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        self.rest = b""
        while b"\r\n\r\n" not in self.rest:
            got = self.s.recv(4096)
            if not got:
                raise Refused(0, "closed")
            self.rest += got
        head, self.rest = self.rest.split(b"\r\n\r\n", 1)
        status = int(head.split()[1])
        if status != 101:
            raise Refused(status, self.rest.decode(errors="replace"))
        want = base64.b64encode(hashlib.sha1((key + GUID).encode()).digest())
        headers = dict(line.lower().split(b": ", 1) for line in head.split(b"\r\n")[1:])
        assert headers[b"sec-websocket-accept"] == want.lower(), "another key's answer"
        assert headers[b"sec-websocket-protocol"] == b"pyrovox.1"

    def bytes(self, n):
        while len(self.rest) < n:
            got = self.s.recv(max(65536, n - len(self.rest)))
            if not got:
                raise Closed(1006, "the connection ended")
            self.rest += got
        out, self.rest = self.rest[:n], self.rest[n:]
        return out

    def frame(self, opcode, data=b"", fin=True):
        mask, n = os.urandom(4), len(data)
        head = bytes([(0x80 if fin else 0) | opcode])
        head += bytes([0x80 | n]) if n < 126 else bytes([0xFE]) + struct.pack(">H", n) if n < 65536 else bytes([0xFF]) + struct.pack(">Q", n)
        self.s.sendall(head + mask + bytes(b ^ mask[i & 3] for i, b in enumerate(data)))

    def say(self, **words):
        self.frame(1, json.dumps(words).encode())

    def next(self, patience=30):
        """("text", object) or ("binary", bytes); pings are answered."""
        self.s.settimeout(patience)
        whole, kind = b"", 0
        while True:
            a, b = self.bytes(2)
            assert not b & 0x80, "a server does not mask"
            n = b & 127
            if n == 126:
                n = struct.unpack(">H", self.bytes(2))[0]
            elif n == 127:
                n = struct.unpack(">Q", self.bytes(8))[0]
            data, opcode = self.bytes(n), a & 15
            if opcode == 8:
                raise Closed(struct.unpack(">H", data[:2])[0] if len(data) >= 2 else 1005, data[2:].decode())
            if opcode == 9:
                self.frame(10, data)
                continue
            if opcode == 10:
                continue
            whole += data
            kind = opcode or kind
            if a & 0x80:
                return ("text", json.loads(whole)) if kind == 1 else ("binary", whole)

    def until(self, wanted, patience=60):
        """The first message for which wanted(kind, message) is true."""
        end = time.monotonic() + patience
        while True:
            kind, m = self.next(max(0.01, end - time.monotonic()))
            if wanted(kind, m):
                return m

    def volume(self, patience=60):
        return self.until(lambda k, m: k == "binary" and type_of(m) == 200, patience)

    def close(self):
        self.s.close()


def type_of(message):
    assert message[:4] == b"PVX1"
    return struct.unpack_from("<H", message, 4)[0]


def set_of(message):
    return struct.unpack_from("<Q", message, 48 + 16)[0]
