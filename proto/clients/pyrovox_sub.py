#!/usr/bin/env python3
"""Read a Pyrovox daemon's volumes: pyzmq and numpy, nothing else (PROTOCOL.md is the format).

    python3 pyrovox_sub.py ipc:///run/pyrovox/volumes [--frames N] [--save DIR]

    with Subscriber("tcp://127.0.0.1:5555") as sub:
        for m in sub:
            if m["type"] == "volume":
                m["dense"]      # float32 [nz][ny][nx][channels]
        print(sub.lost)         # messages that did not reach us
"""
import argparse, ctypes, ctypes.util, json, os, struct, sys
import numpy as np
import zmq

HEADER = struct.Struct("<4s4HI4Q")
START = struct.Struct("<3I3I6dQd32s32s")
VOLUME = struct.Struct("<4IQ4qQI3I2I6d2I16sd2IQ5q2I2Q")
TYPES = {100: "start", 200: "volume", 300: "status", 400: "end"}
TIMES = ("photometry_ns", "hull_ns", "restrict_ns", "solve_ns", "total_ns")


class BadMessage(ValueError):
    pass


def text(b):
    return b.split(b"\0")[0].decode()


def library(name):
    found = ctypes.util.find_library(name)
    if not found:
        raise RuntimeError(f"this message is compressed with {name}, and lib{name} is not installed")
    return ctypes.CDLL(found)


def decompress(how, data, size):
    """`size` was checked against the grid, so a message cannot ask for more than its volume."""
    out = ctypes.create_string_buffer(size)
    if how == 1:
        n = library("lz4").LZ4_decompress_safe(data, out, len(data), size)
    else:
        f = library("zstd").ZSTD_decompress
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


def decode_volume(body):
    f = VOLUME.unpack_from(body)
    size, sample, how, side = f[:4]
    nxyz, (basis, channels), report = f[11:14], f[14:16], f[22:34]
    n_bricks, raw, stored = f[34], f[36], f[37]
    if sample not in (1, 2) or how not in (0, 1, 2) or side != 8 or channels not in (1, 3):
        raise BadMessage("a volume in a format that this client does not know")
    if not all(1 <= n <= 1024 for n in nxyz) or size < VOLUME.size:
        raise BadMessage("grid out of range")
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
        "cameras_present": f[10], "n": list(nxyz), "basis": basis, "channels": channels,
        "min": list(f[16:19]), "max": list(f[19:22]), "bricks": n_bricks,
        "report": {"status": report[0], "iterations": report[1], "solver": text(report[2]),
                   "rel_residual": report[3], "active_voxels": report[4],
                   "active_rays": report[5], "entries": report[6], **dict(zip(TIMES, report[7:]))},
        "dense": unpack(nxyz, channels, ids, bricks),
    }


def decode(msg):
    """One message -> dict.  Raises BadMessage; an unknown type gives only the header's fields."""
    try:
        magic, kind, head, major, _, flags, sequence, nth, session, size = HEADER.unpack_from(msg)
        if magic != b"PVX1" or major != 1 or flags >> 16:
            raise BadMessage("not a message of wire version 1")
        if head < HEADER.size or head + size != len(msg):
            raise BadMessage("length")
        m = {"type": TYPES.get(kind, kind), "sequence": sequence, "type_sequence": nth,
             "session": session}
        body = msg[head:]
        if kind == 100:
            f = START.unpack_from(body)
            m.update(n=list(f[:3]), basis=f[3], channels=f[4], n_cameras=f[5], min=list(f[6:9]),
                     max=list(f[9:12]), rig_hash=f[12], fps=f[13], units=text(f[14]),
                     software=text(f[15]))
        elif kind == 200:
            m.update(decode_volume(body), clamped=bool(flags & 1))
        elif kind == 300:
            m["status"] = json.loads(body)
        elif kind == 400:
            m["reason"] = text(body[:64])
        return m
    except (struct.error, UnicodeDecodeError, ValueError) as e:
        raise BadMessage(str(e)) from None


class Subscriber:
    """Iterate over decoded messages; volumes only after their session's start.  `lost` counts gaps."""

    def __init__(self, endpoint, timeout_ms=-1):
        self.socket = zmq.Context.instance().socket(zmq.SUB)
        self.socket.setsockopt(zmq.RCVHWM, 16)
        self.socket.setsockopt(zmq.SUBSCRIBE, b"PVX1")
        self.socket.connect(endpoint)
        self.timeout_ms = timeout_ms
        self.start, self.session, self.next = None, None, 0
        self.received = self.lost = self.malformed = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close(0)

    def __iter__(self):
        return self

    def __next__(self):
        while True:
            if not self.socket.poll(self.timeout_ms):
                raise StopIteration
            try:
                m = decode(self.socket.recv())
            except BadMessage:
                self.malformed += 1
                continue
            if m["session"] != self.session:
                self.session, self.next, self.start = m["session"], m["sequence"], None
            if m["sequence"] < self.next:
                continue  # a repetition
            self.lost += m["sequence"] - self.next
            self.next = m["sequence"] + 1
            self.received += 1
            if m["type"] == "start":
                self.start = m
            if m["type"] in TYPES.values() and (m["type"] != "volume" or self.start):
                return m


def main():
    p = argparse.ArgumentParser(description="Print, and save as .npy, the volumes of a daemon.")
    p.add_argument("endpoint", help="ipc:///run/pyrovox/volumes or tcp://HOST:5555")
    p.add_argument("--frames", type=int, default=0, help="stop after so many volumes")
    p.add_argument("--save", metavar="DIR", help="write each volume to DIR/SET.npy")
    p.add_argument("--timeout", type=float, help="stop when nothing comes for so many seconds")
    a = p.parse_args()
    if a.save:
        os.makedirs(a.save, exist_ok=True)
    n = 0
    with Subscriber(a.endpoint, -1 if a.timeout is None else int(a.timeout * 1000)) as sub:
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
