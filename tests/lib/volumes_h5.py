"""A recording of volumes in HDF5, written by h5py as daemon/VOLUMES.md says: for tests of readers.

    volumes_h5.py FILE [SETS]       write it, sets 100, 101, ... without 103
    volumes_h5.py FILE SETS follow  the same by SWMR, a set for each line on standard input, then closed: opened anew
                                    with HDF5's lock, which fails while a reader holds one

Voxel (i,j,k), channel c of set s is value(s, i, j, k, c) inside the ball, 0 outside.
"""
import sys
import h5py
import numpy as np

N, C = (40, 24, 33), 3  # voxels along x, y, z; channels
ORIGIN, SPACING = np.array([-0.5, -0.25, 0.0]), np.array([0.025, 0.025, 0.03])
T0, PERIOD = 1767225600_000000000, 50_000_000  # ns
SESSION, RIG_HASH = 0x1122334455667788, 0xFEDCBA9876543210
CHUNK = 16
COLUMNS = {"number": "<u8", "time": "<f8", "t_exposure_ns": "<i8", "t_publish_ns": "<i8", "spread_ns": "<i8",
           "latency_ns": "<i8", "camera_mask": "<u8", "cameras_present": "<u4", "clamped": "u1", "status": "<u4",
           "iterations": "<u4", "rel_residual": "<f8", "active_voxels": "<u4", "active_rays": "<u4", "entries": "<u8",
           "solver": "S16", "photometry_ns": "<i8", "hull_ns": "<i8", "restrict_ns": "<i8", "solve_ns": "<i8",
           "total_ns": "<i8", "bricks": "<u4"}


def dense(s):
    """[z][y][x][c] of set s: a ball in one corner, so that most chunks are empty."""
    z, y, x = np.meshgrid(*(np.arange(n) for n in N[::-1]), indexing="ij")
    inside = (x - 8) ** 2 + (y - 8) ** 2 + (z - 8) ** 2 <= 36
    values = (s % 64 + (x % 8) / 8 + (z % 4) / 64)[..., None] + 64 * np.arange(1, C + 1)
    return np.where(inside[..., None], values, 0).astype(np.float32)


def create(path, origin=ORIGIN, spacing=SPACING, version=1, n=N):
    f = h5py.File(path, "w", libver=("v110", "v110"))
    a = f.attrs
    a["format"], a["version"], a["closed"] = np.bytes_("pyrovox volumes"), np.int64(version), np.int64(0)
    a["t_created_ns"], a["t_closed_ns"] = np.int64(T0), np.int64(0)
    a["session"], a["rig_hash"] = np.uint64(SESSION), np.uint64(RIG_HASH)
    for name, value in ("units", "1/m"), ("software", "pyrovoxd 0.1.0"), ("host", "test"), ("basis", "trilinear"), ("default", "entry"):
        a[name] = np.bytes_(value)
    a["fps"], a["n_cameras"], a["origin"], a["spacing"] = 20.0, np.int64(4), origin, spacing
    shape = (*n[::-1], C)
    f.create_dataset("emission", (0, *shape), "<f4", maxshape=(None, *shape), chunks=(1, CHUNK, CHUNK, CHUNK, C),
                     shuffle=True, compression="gzip", compression_opts=1)
    for axis, name in enumerate("xyz"):
        f[name] = origin[axis] + (np.arange(N[axis]) + 0.5) * spacing[axis]
    f["rig"], f["config"] = np.bytes_("version: 1\n"), np.bytes_("\0")
    for name, kind in COLUMNS.items():
        f.create_dataset("sets/" + name, (0,), kind, maxshape=(None,), chunks=(1024,))
    for name in "why", "set_first", "set_last", "volumes":
        f.create_dataset("gaps/" + name, (0,), "<u4" if name == "why" else "<u8", maxshape=(None,), chunks=(64,))
    return f


def put(f, s, values=None):
    """Only chunks with something in them are written; the row of columns comes after them."""
    e, k = f["emission"], f["sets/number"].shape[0]
    d = dense(s) if values is None else values
    e.resize(k + 1, 0)
    for z in range(0, d.shape[0], CHUNK):
        for y in range(0, d.shape[1], CHUNK):
            for x in range(0, d.shape[2], CHUNK):
                part = d[z : z + CHUNK, y : y + CHUNK, x : x + CHUNK]
                if part.any():
                    e[k, z : z + CHUNK, y : y + CHUNK, x : x + CHUNK] = part
    t = T0 + (s - 100) * PERIOD
    row = {"number": s, "time": (t - T0) * 1e-9, "t_exposure_ns": t, "t_publish_ns": t + 40_000_000, "spread_ns": 1000,
           "latency_ns": 17_000_000, "camera_mask": 0b1011, "cameras_present": 3, "clamped": s % 2, "iterations": 11,
           "rel_residual": 0.0625, "solver": b"pcg", "total_ns": 10}
    for name in COLUMNS:
        c = f["sets"][name]
        c.resize(k + 1, 0)
        c[k] = row.get(name, 0)
    f.flush()


def gap(f, why, first, last, volumes):
    for name, value in ("why", why), ("set_first", first), ("set_last", last), ("volumes", volumes):
        c = f["gaps"][name]
        c.resize(c.shape[0] + 1, 0)
        c[-1] = value


def write(path, sets=8, closed=True):
    with create(path) as f:
        for s in range(100, 100 + sets):
            if s != 103:
                put(f, s)
        gap(f, 0, 103, 103, 1)
        f.attrs["closed"], f.attrs["t_closed_ns"] = np.int64(closed), np.int64(T0)


def main():
    path, sets = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 8
    if len(sys.argv) < 4:
        return write(path, sets)
    f = create(path)
    f.swmr_mode = True
    for s in range(100, 100 + sets):
        put(f, s)
        print(s, flush=True)
        sys.stdin.readline()
    f.close()
    with h5py.File(path, "r+") as f:
        f.attrs["closed"] = np.int64(1)


if __name__ == "__main__":
    main()
