"""The add-on's modules that know nothing of Blender: addon.py WHAT."""
import base64
import glob
import hashlib
import json
import os
import random
import resource
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import types

import numpy as np

here = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../proto/clients/blender/pyrovox_blender")
sys.modules["pyrovox_blender"] = package = types.ModuleType("pyrovox_blender")  # __init__ wants Blender
package.__path__ = [here]
from pyrovox_blender import _page, stream, vdb, websocket  # noqa: E402
from pyrovox_blender.websocket import Address, BadAddress, Broken, Closed, Frames, Refused, WebSocket  # noqa: E402

TOKEN = "0123456789abcdef" * 2


def raises(error, call):
    try:
        call()
    except error as e:
        return e
    raise AssertionError(f"no {error.__name__}")


def addresses():
    for text, want in ((f"http://127.0.0.1:8737/#{TOKEN}", ("127.0.0.1", 8737, False)), (f" https://lab.example:443/#{TOKEN}\n", ("lab.example", 443, True)),
                       (f"http://[::1]:9/#{TOKEN}", ("::1", 9, False)), (f"127.0.0.1:8737/#{TOKEN}", ("127.0.0.1", 8737, False)), (f"http://lab/#{TOKEN}", ("lab", 80, False))):
        a = Address.read(text)
        assert (a.host, a.port, a.tls) == want and a.token == TOKEN and TOKEN not in f"{a} {a!r} {a.name}", a
    assert Address.read("http://127.0.0.1:8737/").token == ""
    for bad in ("", "/", "ftp://lab/#x", "http:///#" + TOKEN, "http://lab:99999/", "http://lab/#" + TOKEN[:-1], "http://lab/#" + TOKEN + "0", "http://lab/#" + TOKEN.upper(), "http://[::1/"):
        assert "\n" not in str(raises(BadAddress, lambda: Address.read(bad)))


def server_frame(opcode, data=b"", fin=True, mask=0, rsv=0):
    n = len(data)
    size = bytes([mask | n]) if n < 126 else struct.pack(">BH", mask | 126, n) if n < 65536 else struct.pack(">BQ", mask | 127, n)
    return bytes([(0x80 if fin else 0) | rsv | opcode]) + size + data


def taken(data, most=1 << 20):
    f, out = Frames(most), []
    f.feed(data)
    while (m := f.take()) is not None:
        out.append(m)
    return out


def frames():
    big = os.urandom(70000)
    assert taken(server_frame(2, b"abc") + server_frame(1, big[:300]) + server_frame(2, big)) == [(2, b"abc"), (1, big[:300]), (2, big)]
    assert taken(server_frame(2, b"a", False) + server_frame(9, b"?") + server_frame(0, b"b", False) + server_frame(0, b"c")) == [(9, b"?"), (2, b"abc")]
    for bad in (server_frame(2, b"a", mask=0x80), server_frame(2, b"a", rsv=0x40), server_frame(3, b""), server_frame(11), server_frame(0, b"a"), server_frame(9, b"x", False),
                server_frame(2, b"a", False) + server_frame(2, b"b"), bytes([0x89, 126, 0, 200]) + bytes(200), bytes([0x82, 127]) + b"\xff" * 8,
                bytes([0x82, 127]) + struct.pack(">Q", (1 << 20) + 1), server_frame(2, bytes(1 << 19), False) * 1 + server_frame(0, bytes((1 << 19) + 1))):
        raises(Broken, lambda: taken(bad))


def split():
    """Whatever way the bytes are cut."""
    messages = [(random.choice((1, 2)), os.urandom(random.choice((0, 1, 125, 126, 127, 65535, 65536, 100000)))) for _ in range(40)]
    data = b"".join(server_frame(k, m) for k, m in messages)
    f, at, out = Frames(1 << 20), 0, []
    while at < len(data):
        n = random.choice((1, 2, 3, 1000, 70000))
        f.feed(data[at:at + n])
        at += n
        while (m := f.take()) is not None:
            out.append(m)
    assert out == messages


def mutated():
    """Frames with bytes changed: messages, or Broken, and no more memory than was allowed."""
    resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
    random.seed(15)
    broken = whole = 0
    for _ in range(20000):
        data = bytearray(b"".join(server_frame(random.choice((0, 1, 2, 9)), os.urandom(random.randrange(300)), random.random() < 0.7) for _ in range(3)))
        for _ in range(random.choice((0, 1, 4))):
            data[random.randrange(min(len(data), 12))] = random.randrange(256)
        try:
            whole += len(taken(bytes(data), 1 << 16))
        except Broken:
            broken += 1
    assert broken > 1000 and whole > 1000, (broken, whole)


def golden():
    """The protocol's vectors, through the add-on's own way from a message to a box of voxels."""
    n = 0
    for name in sorted(glob.glob("proto/vectors/volume*.bin")):
        with open(name, "rb") as f, open(name[:-4] + ".json") as g:
            raw, want = f.read(), json.load(g)
        head, body = _page.decode_header(raw)
        m = _page.decode_bricks(body, 1 << 24, None)
        values, first = vdb.dense(m)
        nx, ny, nz = want["n"]
        truth = np.zeros((nz * ny * nx, want["channels"]), np.float32)
        for index, *value in want["voxels"]:
            truth[index] = value
        truth = truth.reshape(nz, ny, nx, -1).transpose(2, 1, 0, 3)
        room = np.zeros([8 * ((k + 7) // 8) for k in (nx, ny, nz)] + [want["channels"]], np.float32)
        if values.size:
            room[tuple(slice(a, a + s) for a, s in zip(first, values.shape))] = values
        assert np.array_equal(room[:nx, :ny, :nz], truth) and not room[nx:].any() and not room[:, ny:].any() and not room[:, :, nz:].any(), name
        assert np.allclose(vdb.spacing(m), (np.array(want["max"]) - want["min"]) / want["n"])
        n += 1
    assert n >= 5


def without_zmq():
    """Blender has no pyzmq, and may have no liblz4."""
    code = """
import sys
sys.modules["zmq"] = None
sys.path.insert(0, "proto/clients")
import pyrovox_sub as p
p.library = lambda name: None
for name in ("volume-f16-lz4", "volume-f32-raw"):
    import glob
    for path in glob.glob(f"proto/vectors/{name}*.bin") or sys.exit(f"no {name}"):
        assert p.decode(open(path, "rb").read())["dense"].any()
try: p.Subscriber("ipc:///tmp/nobody")
except ImportError as e: assert "python3-zmq" in str(e)
else: sys.exit("a Subscriber without zmq")
"""
    subprocess.run([sys.executable, "-c", code], check=True)


class Server:
    """A port where one function after the other answers who connects, the last one to all others."""

    def __init__(self, *turns):
        self.s = socket.create_server(("127.0.0.1", 0))
        self.port, self.turns, self.heard = self.s.getsockname()[1], list(turns), []
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        while True:
            c, _ = self.s.accept()
            turn = self.turns.pop(0) if len(self.turns) > 1 else self.turns[0]
            try:
                turn(self, c)
            except OSError:
                pass
            c.close()

    def upgrade(self, c, protocol="pyrovox.1", key=None):
        head = b""
        while b"\r\n\r\n" not in head:
            head += c.recv(4096)
        assert TOKEN.encode() not in head, "the token is in the request"
        sent = next(line.split(": ")[1] for line in head.decode().split("\r\n") if line.startswith("Sec-WebSocket-Key"))
        accept = base64.b64encode(hashlib.sha1(((key or sent) + websocket.GUID).encode()).digest()).decode()
        c.sendall(f"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\nSec-WebSocket-Protocol: {protocol}\r\n\r\n".encode())

    def words(self, c):
        """One text of the client."""
        a, n = c.recv(2, socket.MSG_WAITALL)
        mask, data = c.recv(4, socket.MSG_WAITALL), c.recv(n & 127, socket.MSG_WAITALL)
        text = bytes(b ^ mask[i & 3] for i, b in enumerate(data))
        self.heard.append((a & 15, text))
        return text


def answers():
    """To the request: each another error."""
    def says(text):
        return lambda self, c: (c.recv(4096), c.sendall(text))
    cases = [(says(b"HTTP/1.1 503 Busy\r\n\r\nfull"), Refused), (says(b"HTTP/1.1 421 Other\r\n\r\n"), Refused), (says(b"SSH-2.0-OpenSSH\r\n\r\n"), Refused), (says(b""), Refused),
             (says(b"x" * 100000), Refused), (lambda self, c: self.upgrade(c, "chat"), Broken), (lambda self, c: self.upgrade(c, key="another"), Broken)]
    for turn, error in cases:
        e = raises(error, lambda: WebSocket(("127.0.0.1", Server(turn).port)))
        text = stream.trouble(e, Address.read(f"http://127.0.0.1:8737/#{TOKEN}"))
        assert text and "\n" not in text and TOKEN not in text, text
    assert "16 places" in stream.trouble(Closed(4503, ""), Address.read("http://lab/"))

    def pings(self, c):
        self.upgrade(c)
        c.sendall(server_frame(9, b"there?") + server_frame(1, b'{"link": {}}'))
        self.words(c)
        c.sendall(server_frame(8, struct.pack(">H", 4401) + b"no"))
        c.recv(10)
    server = Server(pings)
    ws = WebSocket(("127.0.0.1", server.port))
    assert ws.next() == ("text", {"link": {}})
    assert raises(Closed, ws.next).code == 4401 and server.heard == [(10, b"there?")]
    for bad in (b"\xff\xfe", b"{", b"[" * 100000):
        ws = WebSocket(("127.0.0.1", Server(lambda self, c, bad=bad: (self.upgrade(c), c.sendall(server_frame(1, bad)), c.recv(1))).port))
        raises(Broken, ws.next)


class Disk:
    """In place of openvdb: what a file would be made of."""


def followed(*turns, until, seconds=60, memory=_page.MEMORY, consume=True):
    """A Stream at a Server, its files written by nobody, until a condition; the server and the stream."""
    server = Server(*turns)
    written = vdb.write
    vdb.write = lambda library, path, m: (open(path, "w").close(), 100)[1]
    with tempfile.TemporaryDirectory() as folder:
        s = stream.Stream(Address.read(f"http://127.0.0.1:{server.port}/#{TOKEN}"), vdb.Shelf(folder, files=5), Disk(), memory=memory)
        s.entries = []
        s.start()
        end = time.monotonic() + seconds
        while not until(s) and time.monotonic() < end:
            e = s.newest() if consume else None
            if e is not None:
                assert os.path.exists(e.path)
                s.shelf.hold(e.path)
                s.entries.append(e)
                s.shown(e)
            time.sleep(0.001)
        s.stop()
        assert not s._thread.is_alive() and until(s), (s.state, s.error, s.received)
        assert len(os.listdir(s.shelf.folder)) <= 5
        s.shelf.close()
        assert os.listdir(folder) == []
    vdb.write = written
    return server, s


def volume(number, nth, session=7, sequence=0, exposure=0):
    with open("proto/vectors/volume-f32-raw.bin", "rb") as f:
        raw = bytearray(f.read())
    struct.pack_into("<QQQ", raw, 16, sequence, nth, session)
    struct.pack_into("<Qq", raw, 48 + 16, number, exposure)
    return bytes(raw)


def hostile():
    """Messages that are damaged are counted, one that is too large ends it with a remedy, what ends is tried again."""
    with open("proto/vectors/start.bin", "rb") as f:
        start = f.read()
    good, next_one = volume(3, 3), volume(4, 4)
    bad = [b"", b"PVX1", good[:-1], good[:60], good[:48] + b"\xff" * (len(good) - 48), b"x" * 500, start[:80]]

    def turn(self, c):
        self.upgrade(c)
        assert json.loads(self.words(c))["token"] == TOKEN
        for m in bad:
            c.sendall(server_frame(2, m))
            assert json.loads(self.words(c)) == {"credits": 1}, "a damaged volume's credit is lost"
        c.sendall(server_frame(2, next_one))
        self.words(c)
    # and the connection is dropped each time
    server, s = followed(turn, until=lambda s: len(s.entries) >= 3)
    assert s.malformed >= 3 * len(bad) and s.received >= 3

    def vast(self, c):
        self.upgrade(c)
        self.words(c)
        c.sendall(server_frame(2, good))
        c.recv(1000)
    _, s = followed(vast, until=lambda s: s.state == "failed", memory=10)
    assert "preferences" in s.error, s.error

    def token(self, c):
        self.upgrade(c)
        self.words(c)
        c.sendall(server_frame(8, struct.pack(">H", 4401) + b"no"))
        c.recv(100)
    _, s = followed(token, until=lambda s: s.state == "failed")
    assert "printed last" in s.error


def order():
    """Never an older volume; one that another message overtook is no repetition; a busy Blender gets the newest."""
    def turn(self, c):
        self.upgrade(c)
        self.words(c)
        with open("proto/vectors/status.bin", "rb") as f:
            status = bytearray(f.read())
        struct.pack_into("<QQQ", status, 16, 1000, 0, 7)
        for nth, number in ((0, 5), (1, 6), (1, 6), (0, 5), (2, 9), (3, 11)):
            c.sendall(server_frame(2, bytes(status)) + server_frame(2, volume(number, nth, sequence=nth)))
            while "credits" not in json.loads(self.words(c)):
                pass
        c.sendall(server_frame(2, volume(1, 0, session=8)))
        time.sleep(60)
    _, s = followed(turn, until=lambda s: len(s.entries) == 5)
    assert [e.set for e in s.entries] == [5, 6, 9, 11, 1] and s.sessions == 2 and s.malformed == 0, s.entries
    # nobody shows anything: a volume that waited is replaced by a newer one
    _, s = followed(turn, until=lambda s: s.passed >= 3, consume=False)
    assert s.newest().set >= 9

    entries = [vdb.Entry("", i, 7, t, t, 3, (1, 1, 1), 1) for i, t in enumerate((0, 100_000_000, 200_000_000, 3_600_000_000_000, 3_600_100_000_000))]
    made = [e.set for e in vdb.frames(entries, 10)]
    assert made[:3] == [0, 1, 2] and made[-1] == 4 and len(made) == 104 and made == sorted(made), made
    assert [e.set for e in vdb.frames(entries, 0)] == [0, 1, 2, 3, 4]
    again = entries[:3] + [vdb.Entry("", 0, 7, 0, 0, 3, (1, 1, 1), 1), vdb.Entry("", 1, 7, 100, 0, 3, (1, 1, 1), 1)]
    assert [e.set for e in vdb.last_run(again)] == [0, 1]


def stops():
    """A server that says nothing, and one that cannot be reached, do not hold who disconnects."""
    for turn in (lambda self, c: time.sleep(60), lambda self, c: (self.upgrade(c), time.sleep(60))):
        server = Server(turn)
        with tempfile.TemporaryDirectory() as folder:
            s = stream.Stream(Address.read(f"http://127.0.0.1:{server.port}/#{TOKEN}"), vdb.Shelf(folder), Disk())
            s.start()
            time.sleep(0.2)
            s.pause(True)
            s.stop()
            s.shelf.close()
            assert s.newest() is None


{f.__name__: f for f in (addresses, frames, split, mutated, golden, without_zmq, answers, hostile, order, stops)}[sys.argv[1]]()
