#!/usr/bin/env python3
"""Read a Pyrovox daemon's volumes: pyzmq and numpy, nothing else (PROTOCOL.md is the format).

    python3 pyrovox_sub.py ipc:///run/pyrovox/volumes [--frames N] [--save DIR]

    with Subscriber("tcp://127.0.0.1:5555") as sub:  # memory=BYTES that a volume may need
        for m in sub:
            if m["type"] == "volume":
                m["dense"]      # float32 [nz][ny][nx][channels]
                m["sd"]         # one standard deviation of each, None: the daemon sends no error bars
        print(sub.lost)         # messages that did not reach us
"""
import argparse, ctypes, ctypes.util, functools, json, os, socket as sockets, struct, sys, time
import numpy as np
try:
    import zmq
    from zmq.utils.monitor import parse_monitor_message
except ImportError:  # messages that come by another way can be read without (Blender has none)
    zmq = None

HEADER = struct.Struct("<4s4HI4Q")
START = struct.Struct("<3I3I6dQd32s32s")
VOLUME = struct.Struct("<4IQ4qQI3I2I6d2I16sd2IQ5q2I2Q")
RIG = struct.Struct("<Q2I")
PREVIEW = struct.Struct("<2IQq2I")
CAMERA = struct.Struct("<64sI4H7I")
TYPES = {100: "start", 200: "volume", 300: "status", 400: "end", 500: "rig", 600: "event", 700: "preview", 800: "bars"}
DOUBTS = ("poor-fit", "few-cameras", "fine-detail", "late", "blurred")  # why error bars may be too small, by bit
MEMORY = 1 << 30  # bytes: a volume as floats, 645^3 voxels of one colour, 447^3 of three
BROKEN_OFF = 3  # handshakes in a row that the other end breaks off, before it is no accident
MISMATCH = 0x11000002  # libzmq's PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH: one end has keys, the other none
TIMES = ("photometry_ns", "hull_ns", "restrict_ns", "solve_ns", "total_ns")


class BadMessage(ValueError):
    pass


class TooLarge(BadMessage):
    pass


class Refused(ConnectionError):
    pass


def text(b):
    return b.split(b"\0")[0].decode()


@functools.lru_cache  # looking for one takes longer than what it does for a volume
def library(name):
    found = ctypes.util.find_library(name)
    return ctypes.CDLL(found) if found else None


def unpack_lz4(data, size):
    """For where there is no liblz4; some times slower.  What comes of data that are damaged may be too short."""
    out, at = bytearray(), 0

    def length(n):  # 15 goes on in the bytes that follow
        nonlocal at
        more = 255 if n == 15 else 0
        while more == 255:
            more, at = data[at], at + 1
            n += more
        return n

    try:
        while at < len(data):
            token, at = data[at], at + 1
            n = length(token >> 4)
            out += data[at : at + n]
            at += n
            if at == len(data):  # the last sequence has literals only
                break
            back, at = data[at] | data[at + 1] << 8, at + 2
            n, begin = length(token & 15) + 4, len(out) - back
            if begin < 0 or back == 0 or len(out) + n > size:
                raise BadMessage("payload does not decompress")
            out += out[begin : begin + n] if n <= back else (out[begin:] * (n // back + 1))[:n]
    except IndexError:
        raise BadMessage("payload does not decompress")
    return out


def decompress(how, data, size):
    """`size` was checked against the grid, so a message cannot ask for more than its volume."""
    lib = library("lz4" if how == 1 else "zstd")
    if lib is None and how == 1:
        out = unpack_lz4(data, size)
        if len(out) != size:
            raise BadMessage("payload does not decompress")
        return bytes(out)
    if lib is None:
        raise RuntimeError("this message is compressed with zstd, and libzstd is not installed")
    out = ctypes.create_string_buffer(size)
    if how == 1:
        n = lib.LZ4_decompress_safe(data, out, len(data), size)
    else:
        f = lib.ZSTD_decompress
        f.restype, f.argtypes = ctypes.c_size_t, [ctypes.c_char_p, ctypes.c_size_t] * 2
        n = f(out, size, data, len(data))
    if n != size:
        raise BadMessage("payload does not decompress")
    return out.raw


def unpack(nxyz, channels, ids, bricks):
    """bricks [n][8][8][8][channels] -> dense [nz][ny][nx][channels]; what is not there is zero."""
    bx, by, bz = ((n + 7) // 8 for n in nxyz)
    dense = np.zeros((bz * by * bx, 8, 8, 8, channels), np.float32)
    dense[ids] = bricks
    dense = dense.reshape(bz, by, bx, 8, 8, 8, channels).transpose(0, 3, 1, 4, 2, 5, 6)
    dense = dense.reshape(bz * 8, by * 8, bx * 8, channels)
    return np.ascontiguousarray(dense[: nxyz[2], : nxyz[1], : nxyz[0]])


def check_grid(nxyz, channels, memory):
    if channels not in (1, 3) or not all(1 <= n <= 1024 for n in nxyz):
        raise BadMessage("grid out of range")
    need = 4 * channels * nxyz[0] * nxyz[1] * nxyz[2]
    if need > memory:
        raise TooLarge(f"the daemon's volumes of {nxyz[0]} x {nxyz[1]} x {nxyz[2]} voxels need "
                       f"{need >> 20} MiB, this client takes up to {memory >> 20} MiB")


def decode_volume(body, memory, start):
    m = decode_bricks(body, memory, start)
    m["dense"] = unpack(m["n"], m["channels"], m["ids"], m.pop("values"))
    return m


def decode_bars(body, memory, start):
    """Error bars: `sd` as a volume's `dense`, and the names of the doubts about them."""
    m = decode_bricks(body, memory, start)
    values = m.pop("values")
    if np.any(values < 0):
        raise BadMessage("a deviation below 0")
    return {**m, "sd": unpack(m["n"], m["channels"], m["ids"], values), "doubts": doubts(m["doubt"])}


def doubts(bits):
    return [DOUBTS[b] if b < len(DOUBTS) else f"bit {b}" for b in range(32) if bits >> b & 1]


def bars_of(bars, m, ids):
    """Add to the volume `m` what `bars`, which came before it, say: they may be None, or of another volume."""
    fit = bars and all(bars[k] == m[k] for k in ("session", "set", "n", "channels")) and np.array_equal(bars["ids"], ids)
    m.update({k: bars[k] if fit else none for k, none in (("sd", None), ("doubt", 0), ("doubts", []))})


def decode_bricks(body, memory, start):
    """ids [bricks] and values [bricks][8][8][8][channels], as they travelled."""
    f = VOLUME.unpack_from(body)
    size, sample, how, side = f[:4]
    nxyz, (basis, channels), report = f[11:14], f[14:16], f[22:34]
    n_bricks, raw, stored = f[34], f[36], f[37]
    if sample not in (1, 2) or how not in (0, 1, 2) or side != 8 or size < VOLUME.size:
        raise BadMessage("a volume in a format that this client does not know")
    check_grid(nxyz, channels, memory)
    grid = {"n": list(nxyz), "basis": basis, "channels": channels,
            "min": list(f[16:19]), "max": list(f[19:22])}
    if start and any(start[key] != grid[key] for key in grid):
        raise BadMessage("another grid than the session's start")
    ids = np.frombuffer(body, "<u4", n_bricks, size)
    total = int(np.prod([(n + 7) // 8 for n in nxyz]))
    if n_bricks and (ids[-1] >= total or np.any(ids[1:] <= ids[:-1])):
        raise BadMessage("brick ids are not ascending inside the grid")
    kind = np.dtype("<f4" if sample == 1 else "<f2")
    at = size + 4 * n_bricks
    if raw != n_bricks * 512 * channels * kind.itemsize or at + stored > len(body) or stored > raw:
        raise BadMessage("payload length")
    payload = body[at : at + stored]
    if how:
        payload = decompress(how, payload, raw)
    bricks = np.frombuffer(payload, kind).reshape(n_bricks, 8, 8, 8, channels)
    return {
        "sample": sample, "compression": how, "set": f[4], "t_exposure_ns": f[5],
        "t_publish_ns": f[6], "spread_ns": f[7], "latency_ns": f[8], "camera_mask": f[9],
        "cameras_present": f[10], **grid, "bricks": n_bricks,
        "report": {"status": report[0], "iterations": report[1], "solver": text(report[2]),
                   "rel_residual": report[3], "active_voxels": report[4],
                   "active_rays": report[5], "entries": report[6], **dict(zip(TIMES, report[7:]))},
        "ids": ids, "values": bricks, "doubt": f[35],
    }


def part(body, at, size):
    if at + size > len(body):
        raise BadMessage("cut short")
    return body[at : at + size]


def decode_preview(body):
    """What the cameras saw: JPEGs, silhouettes [down][across] of bool, counts of bins."""
    head, each, number, exposure, n, _ = PREVIEW.unpack_from(body)
    if n > 64 or head < PREVIEW.size or each < CAMERA.size:
        raise BadMessage("preview")
    cameras = []
    for c in range(n):
        f = CAMERA.unpack_from(body, head + c * each)
        across, down = f[4:6]
        row = (across + 7) // 8
        if f[11] != down * row or max(f[2:4]) > 320:
            raise BadMessage("preview")
        bits = np.frombuffer(part(body, f[10], f[11]), np.uint8).reshape(down, row)
        cameras.append({"name": text(f[0]), "left_out": bool(f[1] & 1), "width": f[2], "height": f[3],
                        "jpeg": part(body, f[8], f[9]), "lit": f[6], "saturated": f[7],
                        "silhouette": np.unpackbits(bits, axis=1)[:, :across].astype(bool)})
    return {"set": number, "t_exposure_ns": exposure, "cameras": cameras}


def decode_header(msg):
    """The fields of a message's header, and its body."""
    if len(msg) < HEADER.size:
        raise BadMessage("cut short")
    magic, kind, head, major, _, flags, sequence, nth, session, size = HEADER.unpack_from(msg)
    if magic != b"PVX1" or major != 1 or flags >> 16:
        raise BadMessage("not a message of wire version 1")
    if head < HEADER.size or head + size != len(msg):
        raise BadMessage("length")
    return {"type": TYPES.get(kind, kind), "sequence": sequence, "type_sequence": nth,
            "session": session, "flags": flags}, msg[head:]


def decode_body(kind, body, memory, start):
    if kind == "start":
        f = START.unpack_from(body)
        check_grid(f[:3], f[4], memory)
        return {"n": list(f[:3]), "basis": f[3], "channels": f[4], "n_cameras": f[5],
                "min": list(f[6:9]), "max": list(f[9:12]), "rig_hash": f[12], "fps": f[13],
                "units": text(f[14]), "software": text(f[15])}
    if kind == "volume":
        return decode_volume(body, memory, start)
    if kind == "bars":
        return decode_bars(body, memory, start)
    if kind == "status":
        return {"status": json.loads(body)}
    if kind == "event":
        return {"event": json.loads(body)}
    if kind == "rig":
        rig_hash, at, size = RIG.unpack_from(body)
        return {"rig_hash": rig_hash, "rig": part(body, at, size).decode()}
    if kind == "preview":
        return decode_preview(body)
    return {"reason": text(body[:64])} if kind == "end" else {}


def decode(msg, memory=MEMORY, start=None):
    """One message -> dict.  Raises BadMessage; an unknown type gives only the header's fields.

    A volume must fit `memory` bytes as floats, and have the grid of `start` where that is given.
    """
    m, body = decode_header(msg)
    flags = m.pop("flags")
    try:
        m.update(decode_body(m["type"], body, memory, start))
    except (struct.error, UnicodeDecodeError, ValueError) as e:
        raise e if isinstance(e, BadMessage) else BadMessage(str(e)) from None
    if m["type"] in ("volume", "bars"):
        m["clamped"] = bool(flags & 1)
    return m


def use_key(socket, path):
    """A .key file of `pyrovox keygen --server`, for a daemon that asks for one."""
    if os.stat(path).st_mode & 0o077:
        raise PermissionError(f"{path}: others may read this secret key; chmod 600 it")
    with open(path) as f:
        lines = (line.split() for line in f)
        key = {words[0]: words[1].encode() for words in lines if len(words) == 2}
    try:
        socket.curve_serverkey = key["server"]
        socket.curve_publickey, socket.curve_secretkey = key["public"], key["secret"]
    except KeyError as e:
        raise ValueError(f"{path}: has no {e.args[0]} key; make it with pyrovox keygen --server") from None


def attach(socket, endpoint):
    """Connect.  libzmq prefers IPv6 where it is told to know it: only for [ADDRESS] and a name without an IPv4 address."""
    host = endpoint[len("tcp://"):].rpartition(":")[0] if endpoint.startswith("tcp://") else ""
    try:
        families = {f for f, *_ in sockets.getaddrinfo(host.strip("[]"), None)} if host else set()
    except OSError:  # not known, perhaps later
        families = set()
    socket.setsockopt(zmq.IPV6, int(":" in host or families == {sockets.AF_INET6}))
    socket.connect(endpoint)


class Door:
    """Says why we are not let in: libzmq would try again for ever in silence, or not at all.

    Either end may be the first to notice that the other one has no keys, and the later one hears the same as of a key that is
    wrong: a second connection, which has none and says nothing, tells the two apart.
    """

    def __init__(self, socket, endpoint, key=None):
        self.socket, self.endpoint, self.key = socket, endpoint, key
        self.broken, self.keyless = 0, None
        at = f"inproc://pyrovox-{id(self)}-{time.monotonic_ns()}"
        socket.monitor(at, zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_HANDSHAKE_FAILED_AUTH |
                       zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL)
        self.news = zmq.Context.instance().socket(zmq.PAIR)
        self.news.setsockopt(zmq.LINGER, 0)
        self.news.connect(at)

    def close(self):
        self.stop_trying()
        if not self.socket.closed:
            self.socket.disable_monitor()
        self.news.close(0)

    def stop_trying(self):
        if self.keyless:
            self.keyless.close()
            self.keyless.socket.close(0)
        self.keyless = None

    def event(self):
        """The next one, its number and value; (0, 0): none."""
        try:
            e = parse_monitor_message(self.news.recv_multipart(zmq.NOBLOCK))
            return e["event"], e["value"]
        except zmq.Again:
            return 0, 0

    def without_key(self):
        """What became of the second connection: 0 while nothing did."""
        if not self.keyless:
            self.keyless = Door(zmq.Context.instance().socket(self.socket.getsockopt(zmq.TYPE)), self.endpoint)
            attach(self.keyless.socket, self.endpoint)
        return self.keyless.event()[0] if self.broken >= BROKEN_OFF else 0

    def look(self):
        """Why we are not let in, with the remedy; "" while nobody said no."""
        while not self.news.closed:
            event, value = self.event()
            if event == 0:
                break
            if event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                self.broken = 0
                self.stop_trying()
                continue
            self.broken += 1
            if event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                return (f"the daemon refuses the key in {self.key}: its list of clients (keys.clients) has to name it, "
                        "and no longer or not yet does")
            mismatch = event == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
            if mismatch and value != MISMATCH:
                return "what listens there is no pyrovoxd"
            if not self.key:
                if mismatch or self.broken >= BROKEN_OFF:
                    return ("the daemon asks for a key (--key FILE, key=FILE; pyrovox keygen NAME --server DAEMON.pub "
                            "makes one)")
                continue
            keyless = zmq.EVENT_HANDSHAKE_SUCCEEDED if mismatch else self.without_key()
            if keyless == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                return f"the daemon asks for no key: leave {self.key} out; nothing is encrypted there"
            if keyless:
                return (f"the daemon has another key than {self.key} says (its 'server' line): it was made anew, or this is "
                        "another daemon; ask who runs it for its .pub")
        return ""


class Subscriber:
    """Iterate over decoded messages; volumes only after their session's start.  `lost` counts gaps.

    Raises TooLarge when the daemon's volumes need more than `memory` bytes, Refused when it does not let us in.
    """

    def __init__(self, endpoint, timeout_ms=-1, memory=MEMORY, key=None):
        if zmq is None:
            raise ImportError("a Subscriber needs pyzmq: apt-get install python3-zmq, or pip install pyzmq")
        self.socket = zmq.Context.instance().socket(zmq.SUB)
        self.socket.setsockopt(zmq.RCVHWM, 16)
        self.socket.setsockopt(zmq.MAXMSGSIZE, 2 * memory + (1 << 20))
        self.socket.setsockopt(zmq.SUBSCRIBE, b"PVX1")
        if key:
            use_key(self.socket, key)
        self.door = Door(self.socket, endpoint, key)
        attach(self.socket, endpoint)
        self.endpoint = endpoint
        self.poller = zmq.Poller()
        self.poller.register(self.socket, zmq.POLLIN)
        self.poller.register(self.door.news, zmq.POLLIN)
        self.timeout_ms, self.memory = timeout_ms, memory
        self.start, self.session, self.next, self.bars = None, None, 0, None
        self.received = self.lost = self.malformed = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.door.close()
        self.socket.close(0)

    def __iter__(self):
        return self

    def __next__(self):
        while True:
            ready = dict(self.poller.poll(None if self.timeout_ms < 0 else self.timeout_ms))
            if not ready:
                raise StopIteration
            refusal = self.door.look()
            if refusal:
                raise Refused(f"{self.endpoint}: {refusal}")
            if self.socket not in ready:
                continue
            msg = self.socket.recv()
            try:
                m, _ = decode_header(msg)
            except BadMessage:
                self.malformed += 1
                continue
            if m["session"] != self.session:
                self.session, self.next, self.start, self.bars = m["session"], m["sequence"], None, None
            if m["sequence"] < self.next:
                continue  # a repetition
            self.lost += m["sequence"] - self.next
            self.next = m["sequence"] + 1
            self.received += 1
            if m["type"] not in TYPES.values() or (m["type"] in ("volume", "bars") and not self.start):
                continue
            if m["type"] == "start":
                self.start = None  # until it was read
            try:
                m = decode(msg, self.memory, self.start)
            except BadMessage as e:
                if m["type"] == "start" and isinstance(e, TooLarge):
                    raise
                self.malformed += 1
                continue
            if m["type"] == "start":
                self.start = m
            elif m["type"] == "bars":  # they wait for their volume
                self.bars = m
                continue
            elif m["type"] == "volume":
                bars_of(self.bars, m, m["ids"])
            return m


def main():
    p = argparse.ArgumentParser(description="Print, and save as .npy, the volumes of a daemon.")
    p.add_argument("endpoint", help="ipc:///run/pyrovox/volumes or tcp://HOST:5555")
    p.add_argument("--frames", type=int, default=0, help="stop after so many volumes")
    p.add_argument("--save", metavar="DIR", help="write each volume to DIR/SET.npy")
    p.add_argument("--timeout", type=float, help="stop when nothing comes for so many seconds")
    p.add_argument("--memory", type=int, default=MEMORY >> 20, metavar="MIB",
                   help="refuse volumes that need more (%(default)s)")
    p.add_argument("--key", metavar="FILE", help="your .key file, for a daemon that asks for one")
    a = p.parse_args()
    if a.save:
        os.makedirs(a.save, exist_ok=True)
    n = 0
    timeout_ms = -1 if a.timeout is None else int(a.timeout * 1000)
    with Subscriber(a.endpoint, timeout_ms, a.memory << 20, a.key) as sub:
        for m in sub:
            if m["type"] == "volume":
                d = m["dense"]
                print(f"set {m['set']}: {d.shape}, {m['bricks']} bricks, max {d.max():.4g}, "
                      f"{m['latency_ns'] / 1e6:.1f} ms, lost {sub.lost}", flush=True)
                if a.save:
                    np.save(os.path.join(a.save, f"{m['set']:06d}.npy"), d)
                n += 1
            elif m["type"] == "end":
                print(f"end: {m['reason']}", flush=True)
            if (a.frames and n >= a.frames) or m["type"] == "end":
                break
    print(f"{n} volumes, {sub.lost} messages lost, {sub.malformed} malformed")
    return 0 if n or not a.frames else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
    except TooLarge as e:
        sys.exit(f"pyrovox_sub.py: {e}; --memory MIB allows more")
    except (OSError, ValueError) as e:
        sys.exit(f"pyrovox_sub.py: {e}")
