#!/usr/bin/env python3
"""Pictures of a recording as high-speed cameras save them: highspeed.py FRAMES KIND OUT [FIRST [LAST [CAMERA...]]]

FRAMES/<camera>/<number>.png become OUT/<camera>.npy-folders (KIND npy), .cine (cine8, cine12, cine16) or .mraw with its
header (mraw8, mraw12, mraw16): grey, of 8 or 12 bits.  Image n is n / 1000 s after the trigger."""
import os
import struct
import subprocess
import sys

BITS = {"npy": 16, "npy8": 8, "cine8": 8, "cine12": 12, "cine16": 16, "mraw8": 8, "mraw12": 12, "mraw16": 16}


def pictures(folder):
    """(width, height, [samples of 16 bits, from the top left]) of all pictures of a camera."""
    first = os.path.join(folder, "%06d.png")
    size = subprocess.run(["ffprobe", "-v", "error", "-show_entries", "stream=width,height", "-of", "csv=p=0", "-i", first],
                          stdout=subprocess.PIPE, check=True, text=True).stdout.strip().split(",")
    w, h = int(size[0]), int(size[1])
    raw = subprocess.run(["ffmpeg", "-v", "error", "-i", first, "-f", "rawvideo", "-pix_fmt", "gray16le", "-"],
                         stdout=subprocess.PIPE, check=True).stdout
    n = w * h
    return w, h, [struct.unpack_from("<%dH" % n, raw, 2 * n * k) for k in range(len(raw) // (2 * n))]


def pack(samples, bits):
    if bits == 8:
        return bytes(samples)
    if bits == 16:
        return struct.pack("<%dH" % len(samples), *samples)
    out = bytearray()
    for a, b in zip(samples[::2], samples[1::2]):
        out += bytes((a >> 4, (a & 15) << 4 | b >> 8, b & 255))
    return bytes(out)


def rows_up(samples, w):
    return [v for y in range(len(samples) - w, -1, -w) for v in samples[y:y + w]]


def cine(path, w, h, images, bits, first):
    n = len(images)
    second = 1 << 32
    trigger = 1700000000 * second + 77777
    setup = bytearray(10408)
    setup[140:142] = b"ST"
    for at, form, value in ((142, "H", len(setup)), (768, "I", 1000), (896, "I", 8 if bits == 8 else 12), (10400, "d", 1000.0)):
        struct.pack_into("<" + form, setup, at, value)
    times = [trigger + (first + k) * second // 1000 for k in range(n)]
    tags = struct.pack("<IHH%dQ" % n, 8 + 8 * n, 1002, 0, *times)
    body = [pack(rows_up(s, w) if bits != 12 else s, bits) for s in images]
    lists = 44 + 40 + len(setup) + len(tags)
    at = lists + 8 * n
    with open(path, "wb") as f:
        f.write(struct.pack("<2sHHHiIiIIIIQ", b"CI", 44, 0, 1, first - 5, n + 9, first, n, 44, 84, lists, trigger))
        f.write(struct.pack("<IiiHHIIiiII", 40, w, h, 1, 8 if bits == 8 else 16, 1024 if bits == 12 else 0, len(body[0]), 0, 0, 0, 0))
        f.write(setup + tags + struct.pack("<%dQ" % n, *(at + k * (8 + len(body[0])) for k in range(n))))
        for b in body:
            f.write(struct.pack("<II", 8, len(b)) + b)


def mraw(path, w, h, images, bits, first):
    with open(path + ".mraw", "wb") as f:
        for s in images:
            f.write(pack(s, bits))
    with open(path + ".cih", "w") as f:
        f.write("#Camera Information Header\nRecord Rate(fps) : 1000\nTotal Frame : %d\nStart Frame : %d\nImage Width : %d\n"
                "Image Height : %d\nColor Type : Mono\nColor Bit : %d\nFile Format : MRaw\nEffectiveBit Depth : 12\n"
                "EffectiveBit Side : Lower\nEND\n" % (len(images), first, w, h, bits))


def npy(path, w, h, images, first):
    os.makedirs(path, exist_ok=True)
    for k, s in enumerate(images):
        head = "{'descr': '%s', 'fortran_order': False, 'shape': (%d, %d), }" % ("|u1" if bits_of_all == 8 else "<u2", h, w)
        head += " " * (117 - len(head)) + "\n"
        with open("%s/%06d.npy" % (path, k + first), "wb") as f:
            f.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + pack(s, bits_of_all))


frames, kind, out = sys.argv[1:4]
first = int(sys.argv[4]) if len(sys.argv) > 4 else 0
last = int(sys.argv[5]) if len(sys.argv) > 5 else 10**9
bits_of_all = BITS[kind]
os.makedirs(out, exist_ok=True)
for camera in sys.argv[6:] or sorted(os.listdir(frames)):
    w, h, images = pictures(os.path.join(frames, camera))
    depth = 8 if kind.endswith("8") else 12
    images = [[v >> (16 - depth) for v in s] for s in images[first:last + 1]]
    path = os.path.join(out, camera)
    start = first - 10
    if kind.startswith("npy"):
        npy(path, w, h, images, first)
    elif kind.startswith("cine"):
        cine(path + ".cine", w, h, images, bits_of_all, start)
    else:
        mraw(path, w, h, images, bits_of_all, start)
