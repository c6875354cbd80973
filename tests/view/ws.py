"""The WebSocket of the Blender add-on, and what only tests ask of it."""
import os
import struct
import sys
import time

sys.path.insert(1, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../proto/clients/blender/pyrovox_blender"))
import websocket
from websocket import Closed, Refused, connect  # noqa: F401


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


class WebSocket(websocket.WebSocket):
    def until(self, wanted, patience=60):
        """The first message for which wanted(kind, message) is true."""
        end = time.monotonic() + patience
        while True:
            kind, m = self.next(max(0.01, end - time.monotonic()))
            if wanted(kind, m):
                return m

    def volume(self, patience=60):
        return self.until(lambda k, m: k == "binary" and type_of(m) == 200, patience)


def type_of(message):
    assert message[:4] == b"PVX1"
    return struct.unpack_from("<H", message, 4)[0]


def set_of(message):
    return struct.unpack_from("<Q", message, 48 + 16)[0]
