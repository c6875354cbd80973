"""What 096-view.sh asks of a running bridge: bridge.py WHAT HOST:PORT TOKEN [more]"""
import os
import socket
import struct
import subprocess
import sys
import time

from ws import Closed, Refused, WebSocket, request, set_of, type_of

what, at, token, *more = sys.argv[1:]
host, port = at.rsplit(":", 1)
address = (host, int(port))
patience = float(os.environ["patience"])  # s; of tests/system/lib.sh


def get(path, method="GET", **headers):
    lines = [f"{method} {path} HTTP/1.1"] + [f"{k.replace('_', '-')}: {v}" for k, v in {"Host": at, **headers}.items()]
    out = request(address, "\r\n".join(lines) + "\r\n\r\n")
    head, _, body = out.partition(b"\r\n\r\n")
    return int(head.split()[1]), head.decode().lower(), body


def page(**how):
    ws = WebSocket(address, **how)
    ws.say(token=token)
    return ws


def refused(status, **how):
    try:
        WebSocket(address, **how)
    except Refused as e:
        assert e.status == status, e
    else:
        raise AssertionError(f"let in: {how}")


def closed(ws, code, patience=60):
    try:
        while True:
            ws.next(patience)
    except Closed as e:
        assert e.code == code, e


def files():
    code, head, body = get("/")
    assert code == 200 and b"<title>Pyrovox" in body and token.encode() not in body
    for line in ("default-src 'none'", "frame-ancestors 'none'", "nosniff", "no-referrer", "connection: close"):
        assert line in head, (line, head)
    assert get("/main.js")[1].find("text/javascript") > 0 and get("/style.css")[0] == 200
    for path in ("/../etc/passwd", "/..%2f..%2fetc/passwd", "/%2e%2e/main.js", "//main.js", "/page/main.js", "/main.js/", "/index.html/.."):
        assert get(path)[0] == 404, path
    assert get("/", "POST")[0] == 405 and get("/", "DELETE")[0] == 405
    assert get("/live")[0] == 426
    assert get("/", X="x" * 20000)[0] in (413, 431)
    assert request(address, b"\x16\x03\x01" + bytes(300))[:12] in (b"", b"HTTP/1.1 400")
    total = sum(len(get(p)[2]) for p in ("/", "/style.css", "/icon.svg", *("/" + n for n in body_scripts())))
    assert 40000 < total < 150000, total


def body_scripts():
    """The modules, by following what each one names."""
    seen, todo = set(), ["main.js", "worker.js"]
    while todo:
        n = todo.pop()
        if n in seen:
            continue
        seen.add(n)
        for part in get("/" + n)[2].decode().split('from "./')[1:]:
            todo.append(part.split('"')[0])
    return seen


def hosts():
    good = [at, f"localhost:{port}", "localhost", "127.0.0.1", f"LOCALHOST:{port}", "localhost:9"]
    bad = ["evil.test", f"127.0.0.1.evil.test:{port}", "127.0.0.1.evil.test", "localhost.evil.test", "127.0.0.2", "0x7f.1", "2130706433",
           "[::1]", "127.0.0.1:", "127.0.0.1:80:80", "127.0.0.1:x", "", "127.0.0.1@evil.test", "0.0.0.0"]
    for h in good:
        assert get("/", Host=h)[0] == 200, h
    for h in bad:
        assert get("/", Host=h)[0] in (400, 421), h
        refused(421 if h else 421, host=h or "evil.test")
    assert b" 400" in request(address, b"GET / HTTP/1.1\r\n\r\n")[:14] or b" 421" in request(address, b"GET / HTTP/1.1\r\n\r\n")[:14]


def origins():
    for o in ("http://evil.test", f"http://127.0.0.1.evil.test:{port}", "null", f"https://{at}", f"http://localhost:{port}", f"http://{host}",
              f"http://{host}:1", f"http://{at}.evil.test", "file://", f"http://user@{at}", f"http://{at}/"):
        refused(403, origin=o)
    WebSocket(address, origin=f"http://{at}").close()
    WebSocket(address, host=f"localhost:{port}", origin=f"http://localhost:{port}").close()


def tokens():
    for t in ("", "0" * 32, token[:-1], token + "0", token[:-1] + ("0" if token[-1] != "0" else "1"), token.upper() if token.upper() != token else "x"):
        ws = WebSocket(address)
        ws.say(token=t)
        closed(ws, 4400 if len(t) > 32 else 4401)
    ws = WebSocket(address)
    ws.say(credits=5)  # nothing before the token
    closed(ws, 4401)
    closed(WebSocket(address), 4408)
    refused(400, protocol="pyrovox.2")


def volume():
    ws = page()
    ws.say(credits=1)
    m = ws.volume()
    assert len(m) > 296 and set_of(m) >= 0 and struct.unpack_from("<I", m, 48 + 8)[0] in (0, 1)


def credits():
    ws = page()
    ws.say(credits=10 ** 6)
    n, end = 0, time.monotonic() + 3
    while time.monotonic() < end:
        try:
            kind, m = ws.next(max(0.01, end - time.monotonic()))
        except TimeoutError:
            break
        n += kind == "binary" and type_of(m) == 200
    assert 1 <= n <= 8, n  # what is left was not sent: the grants end at 8
    ws.say(credits=1)
    ws.volume()


def words():
    for bad in (b"", b"{", b"[]", b"7", b'{"credits":-1}', b'{"credits":"1"}', b'{"hidden":1}', b'{"seek":1.5}', b'{"speed":1e9}', b"\xff\xfe",
                b'{"token":7}', b'{"seek":1e300}'):
        ws = page()
        ws.frame(1, bad)
        closed(ws, 1007 if bad == b"\xff\xfe" else 4400)
    ws = page()
    ws.say(later="unknown", credits=1)
    ws.volume()
    ws = page()
    ws.frame(2, b"PVX1")
    closed(ws, 4400)


def frames():
    ws = page()
    ws.frame(1, b" " * 2000)
    closed(ws, 1009)
    ws = page()
    ws.s.sendall(bytes([0x81, 0xFF]) + struct.pack(">Q", 1 << 62) + bytes(20))
    closed(ws, 1009)
    ws = page()
    ws.s.sendall(bytes([0x81, 0x05]) + b"hello")  # not masked
    closed(ws, 1002)
    ws = page()
    ws.s.sendall(bytes([0xF1, 0x80]) + bytes(4))  # bits that nobody asked for
    closed(ws, 1002)
    ws = page()
    ws.frame(1, b'{"cred', fin=False)
    ws.frame(9, b"there?")
    ws.frame(0, b'its":1}')
    ws.volume()
    ws = page()
    ws.s.settimeout(2)
    try:
        for _ in range(200000):
            ws.frame(9, b"x" * 100)  # and none of the answers is read: the bridge reads no more either
        raise AssertionError("20 MB of pings were taken from who reads no answer")
    except TimeoutError:
        pass
    other = page()
    other.say(credits=1)
    other.volume()
    ws.close()
    for _ in range(20):  # gone in the middle of a volume
        w = page()
        w.say(credits=8)
        w.close()


def film():
    ws = page()
    f = ws.until(lambda k, m: k == "text" and "film" in m)["film"]
    assert f["count"] == 40 and f["playing"] is True
    ws.say(play=False, seek=7)
    f = ws.until(lambda k, m: k == "text" and "film" in m and m["film"]["at"] == 7)["film"]
    assert f["playing"] is False
    ws.say(credits=1)
    one = ws.volume()
    ws.say(credits=1, seek=7)
    two = ws.volume()
    while set_of(one) != set_of(two):  # the one before may have been on its way
        ws.say(credits=1, seek=7)
        one, two = two, ws.volume()
    ws.say(seek=10 ** 9)
    ws.until(lambda k, m: k == "text" and "film" in m and m["film"]["at"] == 39)
    ws.say(play=True, speed=100)
    a = ws.until(lambda k, m: k == "text" and "film" in m and m["film"]["playing"])
    assert a["film"]["speed"] == 100
    ws.say(speed=1)


def full():
    pages = [page() for _ in range(16)]
    for p in pages:
        p.say(credits=1)
        p.volume()
    closed(page(), 4503)
    # those who show no token take nobody's place, however many
    strangers = [WebSocket(address) for _ in range(40)]
    closed(page(), 4503)
    for p in pages[:8]:
        p.close()
    end = time.monotonic() + patience
    while True:
        try:
            p = page()
            p.say(credits=1)
            p.volume()
            break
        except Closed:
            assert time.monotonic() < end
    for p in pages[8:]:
        p.say(credits=1)
    for s in strangers:
        s.close()


def cut():
    """A recording that was cut off says so, and shows what is whole."""
    ws = page()
    ws.say(credits=1)
    ws.volume()
    assert ws.until(lambda k, m: k == "text" and "film" in m)["film"]["cut"]


def names():
    """--host lab.example --host 203.0.113.7 --host [2001:db8::7]"""
    for h in ("lab.example", f"LAB.example:{port}", "203.0.113.7", f"203.0.113.7:{port}", "[2001:db8::7]", f"[2001:db8:0::7]:{port}", at):
        assert get("/", Host=h)[0] == 200, h
    for h in ("203.0.113.8", "203.0.113.7.lab.example", "lab.example.evil.test", "[2001:db8::8]", "2001:db8::7", "lab.example:x"):
        assert get("/", Host=h)[0] in (400, 421), h


def slow():
    """Headers a byte at a time: closed after a while, however many bytes come; and others are served meanwhile."""
    s = socket.create_connection(address)
    text = f"GET / HTTP/1.1\r\nHost: {at}\r\nX: ".encode()
    s.sendall(text)
    s.settimeout(0.5)
    end = time.monotonic() + patience
    while time.monotonic() < end:
        try:
            s.sendall(b"x")
            if not s.recv(10):
                return
        except TimeoutError:
            assert get("/icon.svg")[0] == 200
        except (ConnectionResetError, BrokenPipeError):
            return
    raise AssertionError("still open")


def tls():
    import ssl
    ws = WebSocket(address, host=f"localhost:{port}", tls=more[0])
    ws.say(token=token)
    sizes, real = [], ws.s.recv

    class Counting:
        def recv(self, n):
            got = real(n)
            sizes.append(len(got))
            return got

        def __getattr__(self, name):
            return getattr(plain, name)
    plain, ws.s = ws.s, Counting()
    for _ in range(3):
        ws.say(credits=1)
        ws.volume()
    assert max(sizes) > 500, sizes  # records are not crumbs; a volume here has a kilobyte
    out = request(("localhost", int(port)), f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n", tls=more[0])
    assert b"<title>Pyrovox" in out
    out = request(("localhost", int(port)), f"GET / HTTP/1.1\r\nHost: 127.0.0.1.evil.test:{port}\r\n\r\n", tls=more[0])
    assert b" 421 " in out.split(b"\r\n")[0], out[:80]
    assert b"<title>" not in request(address, f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n")
    for version in (ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1):
        old = ssl.create_default_context(cafile=more[0])
        old.set_ciphers("ALL:@SECLEVEL=0")
        old.minimum_version = old.maximum_version = version
        try:
            old.wrap_socket(socket.create_connection(address), server_hostname="localhost")
        except (ssl.SSLError, ConnectionResetError, OSError):
            continue
        raise AssertionError(f"{version} is let in")
    # many at a time, those that say nothing among them, and one that goes in the middle
    idle = [socket.create_connection(address) for _ in range(20)]
    many = [WebSocket(address, host=f"localhost:{port}", tls=more[0]) for _ in range(8)]
    for w in many:
        w.say(token=token, credits=1)
    for w in many:
        w.volume()
    many[0].s.close()
    for w in many[1:]:
        w.say(credits=1)
        w.volume()
        w.close()
    for s in idle:
        s.close()


def live():
    pub, endpoint = more
    ws = page()
    ws.say(credits=1)
    l = ws.until(lambda k, m: k == "text" and "link" in m)["link"]
    assert l["silent_s"] == -1 and l["volumes_sent"] == 0, l
    for _ in range(2):
        p = subprocess.Popen([pub, "--publish", endpoint, "300", "10"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        kinds, last = set(), -1
        while not kinds >= {100, 200, 400}:
            kind, m = ws.next(60)
            if kind != "binary":
                continue
            kinds.add(type_of(m))
            if type_of(m) == 100:
                last = -1
            if type_of(m) == 200:
                assert set_of(m) > last, "an older volume"
                last = set_of(m)
                ws.say(credits=1, held=last, drawn=last)
        p.kill()  # it would wait for the bridge to leave
        p.wait()
    l = ws.until(lambda k, m: k == "text" and "link" in m and m["link"]["lost"] >= 60)["link"]
    assert l["volumes_drawn"] > 0 and l["volumes_drawn"] <= l["volumes_sent"] and l["drawn_ms"][0] > 0 and l["whole_ms"] == [None, None], l  # published long ago by its clock: not believed


def needless_key(control):
    import zmq
    rep = zmq.Context.instance().socket(zmq.REP)
    rep.bind(control)
    ws = page()
    end, o = time.monotonic() + 120, {"said": ""}
    while "asks for no key" not in o["said"]:  # the connection takes a moment
        assert time.monotonic() < end, o
        ws.say(order="record")
        o = ws.until(lambda k, m: k == "text" and "orders" in m and m["orders"]["said"])["orders"]
    assert not o["good"] and not o["busy"], o


def orders():
    """With --control three words do three things, and nothing else of a page reaches the daemon; without it none does."""
    import json
    import zmq
    control, mode = more
    if mode == "keyed":  # by a bridge with a key, where none is asked for
        return needless_key(control)
    rep = zmq.Context.instance().socket(zmq.REP)
    ws = page()

    def said(wanted, **words):
        if words:
            ws.say(**words)
        return ws.until(lambda k, m: k == "text" and "orders" in m and wanted(m["orders"]))["orders"]
    if mode == "reads":
        rep.bind(control)
        ws.say(order="record", token=token)
        ws.until(lambda k, m: k == "text" and "link" in m)
        assert "orders" not in ws.until(lambda k, m: k == "text" and "link" in m)
        assert not rep.poll(1000), "a bridge without --control passed an order on"
        return
    o = said(lambda o: o["said"], order="record")
    assert not o["good"] and not o["busy"] and "no daemon takes orders" in o["said"], o
    rep.bind(control)
    wants = {"record": {"cmd": "record", "version": 1, "what": "volumes", "action": "start"}, "snapshot": {"cmd": "snapshot", "version": 1},
             "stop": {"cmd": "record", "version": 1, "what": "volumes", "action": "stop"}}
    for word, request in wants.items():
        end = time.monotonic() + patience
        while not rep.poll(0):  # a connection takes a moment
            assert time.monotonic() < end, word
            said(lambda o: o["said"].startswith(word), order=word)
            rep.poll(200)
        assert json.loads(rep.recv()) == request
        ws.say(order="stop" if word == "record" else "record")  # one at a time
        assert "one thing at a time" in said(lambda o: not o["good"])["said"]
        assert not rep.poll(300)
        if word == "stop":
            rep.send_json({"version": 1, "error": "nothing is \"recorded\"\n"})
            o = said(lambda o: not o["busy"])
            assert not o["good"] and o["said"] == "stop: nothing is \"recorded\"\n", o
        else:
            rep.send_json({"version": 1, "ok": True, "path": f"/data/{word}.h5"})
            o = said(lambda o: not o["busy"])
            assert o["good"] and o["said"] == f"{word}: /data/{word}.h5", o
    # words that are none close the page, and reach nobody
    for bad in ("halt", 7, {"cmd": "stop"}, None):
        ws = page()
        ws.say(order=bad)
        closed(ws, 4400)
    stranger = WebSocket(address)
    stranger.say(order="stop")
    assert not rep.poll(1000)


{"files": files, "host": hosts, "origin": origins, "token": tokens, "volume": volume, "credits": credits, "words": words, "frames": frames, "film": film,
 "full": full, "cut": cut, "names": names, "slow": slow, "orders": orders, "tls": tls, "live": live}[what]()
