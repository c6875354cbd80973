"""Volumes as .vdb files, the grids as `pyrovox convert` writes them, and the folders that they lie in."""
from __future__ import annotations

import os
import shutil
import tempfile
import threading
import time
from dataclasses import dataclass
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from . import _page

MISSING = ("Blender's Python has no openvdb module, so no volume can be written: Debian's Blender takes it from "
           "apt-get install python3-openvdb; builds of blender.org since 4.4 have it")
LUMINANCE = np.array((0.2126, 0.7152, 0.0722), np.float32)  # Rec. 709
MOST_HALF = 65504.0
ROOM = 1 << 20  # bytes that stay free on a disk
GAP_NS = 10 * 10**9
KEEP_FILES, KEEP_BYTES = 100, 256 << 20  # of what is only shown


class NoRoom(OSError):
    """A folder is full, or cannot be written; the text names it and says the remedy."""


def library() -> Optional[Any]:
    """The openvdb module, whatever it is called here; None: there is none."""
    for name in ("openvdb", "pyopenvdb"):
        try:
            return __import__(name)
        except ImportError:
            continue
    return None


@dataclass(frozen=True)
class Entry:
    """A volume as a file."""

    path: str
    set: int
    session: int
    t_exposure_ns: int
    t_publish_ns: int
    channels: int
    spacing: tuple[float, float, float]  # m
    size: int


def dense(m: dict[str, Any]) -> tuple[npt.NDArray[np.float32], tuple[int, int, int]]:
    """Values [x][y][z][channels] of the box of bricks that came, and the voxel that it begins at."""
    bx, by = (m["n"][0] + 7) // 8, (m["n"][1] + 7) // 8
    ids = m["ids"].astype(np.int64)
    if len(ids) == 0:
        return np.zeros((0, 0, 0, m["channels"]), np.float32), (0, 0, 0)
    at = np.stack([ids % bx, ids // bx % by, ids // (bx * by)])
    low = at.min(1)
    n = at.max(1) + 1 - low
    x, y, z = at - low[:, None]
    box = _page.unpack([8 * int(k) for k in n], m["channels"], (z * n[1] + y) * n[0] + x, m["values"])
    return box.transpose(2, 1, 0, 3), (8 * int(low[0]), 8 * int(low[1]), 8 * int(low[2]))


def spacing(m: dict[str, Any]) -> list[float]:
    return [(b - a) / n for a, b, n in zip(m["min"], m["max"], m["n"])]


def grids(vdb: Any, m: dict[str, Any]) -> list[Any]:
    """As `pyrovox convert --split`: density, and of a coloured volume red, green, blue; metres, index (i, j, k) is the
    centre of voxel (i, j, k).

    Not one grid of vectors: Cycles divides those by how much of a sample lies in active voxels, so edges come out too bright.
    """
    values, first = dense(m)
    values = np.clip(values, -MOST_HALF, MOST_HALF)
    step, out = spacing(m), []
    matrix = np.diag([*step, 1.0])
    matrix[3, :3] = [a + s / 2 for a, s in zip(m["min"], step)]
    for name in ("density", "red", "green", "blue") if m["channels"] == 3 else ("density",):
        grid = vdb.FloatGrid()
        c = {"red": 0, "green": 1, "blue": 2}.get(name, 0)
        array = values @ LUMINANCE if name == "density" and m["channels"] == 3 else values[..., c]
        if array.size:
            grid.copyFromArray(np.ascontiguousarray(array), first)
            no_tiles(grid, m)
        grid.transform = vdb.createLinearTransform(matrix.tolist())
        grid.name, grid.gridClass = name, vdb.GridClass.FOG_VOLUME
        grid.creator, grid.saveFloatAsHalf = "pyrovox_blender", True
        out.append(grid)
    return out


def no_tiles(grid: Any, m: dict[str, Any]) -> None:
    """A brick of one value is a tile by now, which Cycles leaves out: made voxels again."""
    if grid.activeVoxelCount() == grid.activeLeafVoxelCount():
        return
    bx, by = (m["n"][0] + 7) // 8, (m["n"][1] + 7) // 8
    accessor = grid.getAccessor()
    for i in m["ids"].astype(np.int64).tolist():
        ijk = (8 * (i % bx), 8 * (i // bx % by), 8 * (i // (bx * by)))
        value = accessor.getValue(ijk)
        if value != 0 and accessor.getValueDepth(ijk) != grid.treeDepth - 1:
            accessor.setValueOn(ijk, 2 * value)
            accessor.setValueOn(ijk, value)


def write(vdb: Any, path: str, m: dict[str, Any]) -> int:
    """One volume, whole or not there at all; its bytes.  Raises NoRoom.

    The library does not see a full disk, so it is looked at before and after.
    """
    folder, name = os.path.split(path)
    part = os.path.join(folder, ".part-" + name)
    most = 2 * 2 * m["values"].size + 512 * len(m["ids"])  # halves, of one colour more, and tables
    try:
        if shutil.disk_usage(folder).free < ROOM + most:
            raise NoRoom(f"{folder} is full: make room there, or choose another folder")
        vdb.write(part, grids(vdb, m), {"set": m["set"], "t_exposure_ns": m["t_exposure_ns"], "units": "1/m"})
        size = os.stat(part).st_size
        if shutil.disk_usage(folder).free < ROOM // 2:
            raise NoRoom(f"{folder} is full: make room there, or choose another folder")
        os.replace(part, path)
        return size
    except NoRoom:
        _remove(part)
        raise
    except (OSError, RuntimeError) as e:  # openvdb.IoError is a RuntimeError in some versions
        _remove(part)
        raise NoRoom(f"{folder} cannot be written ({getattr(e, 'strerror', None) or e}): choose another folder") from None


def _remove(path: str) -> None:
    try:
        os.remove(path)
    except OSError:
        pass


class Shelf:
    """The temporary folder: the last volumes, a bounded number of files and bytes.

    One thread puts; hold() and close() may come from another.
    """

    def __init__(self, folder: Optional[str] = None, files: int = KEEP_FILES, most: int = KEEP_BYTES):
        try:
            self.folder = tempfile.mkdtemp(prefix="pyrovox-", dir=folder)
        except OSError as e:
            raise NoRoom(f"no folder can be made in {folder or tempfile.gettempdir()} ({e.strerror}): "
                         "Preferences > File Paths > Temporary Files names another") from None
        self.files, self.most, self.number = files, most, 0
        self.entries: list[Entry] = []
        self._held = ""
        self._lock = threading.Lock()

    def put(self, vdb: Any, m: dict[str, Any]) -> Entry:
        self.number += 1
        e = _entry(vdb, os.path.join(self.folder, f"flame_{self.number:06d}.vdb"), m)
        with self._lock:
            self.entries.append(e)
            self._tidy()
        return e

    def _tidy(self) -> None:
        size, i = sum(e.size for e in self.entries), 0
        while len(self.entries) - i > 2 and i < len(self.entries) - 2 and (len(self.entries) > self.files or size > self.most):
            if self.entries[i].path == self._held:
                i += 1
                continue
            old = self.entries.pop(i)
            size -= old.size
            _remove(old.path)

    def kept(self) -> list[Entry]:
        with self._lock:
            return list(self.entries)

    def hold(self, path: str) -> None:
        """That file is in use until another is."""
        with self._lock:
            self._held = path

    def close(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)


class Take:
    """A recording: FOLDER/take-DATE/flame_0001.vdb and on, a grid and a session each."""

    def __init__(self, folder: str):
        stem = os.path.join(folder, time.strftime("take-%Y%m%d-%H%M%S"))
        self.entries: list[Entry] = []
        for number in range(1000):
            self.folder = stem + (f"-{number}" if number else "")
            try:
                os.makedirs(self.folder)
                return
            except FileExistsError:
                continue
            except OSError as e:
                raise NoRoom(f"{folder} cannot be written ({e.strerror}): choose another folder") from None
        raise NoRoom(f"{folder} has a thousand takes of this second")

    def put(self, vdb: Any, m: dict[str, Any]) -> Entry:
        e = _entry(vdb, os.path.join(self.folder, f"flame_{len(self.entries) + 1:04d}.vdb"), m)
        self.entries.append(e)
        return e

    def discard(self) -> None:
        """Of a take without volumes."""
        try:
            os.rmdir(self.folder)
        except OSError:
            pass


def _entry(vdb: Any, path: str, m: dict[str, Any]) -> Entry:
    size = write(vdb, path, m)
    x, y, z = spacing(m)
    return Entry(path, m["set"], m["session"], m["t_exposure_ns"], m["t_publish_ns"], m["channels"], (x, y, z), size)


def last_run(entries: list[Entry]) -> list[Entry]:
    """Of volumes the last ones that are of one session, kind and way of time (a recording begins anew at its end)."""
    i = len(entries) - 1
    while i > 0 and (entries[i - 1].session, entries[i - 1].channels) == (entries[i].session, entries[i].channels) and (
            entries[i - 1].t_exposure_ns < entries[i].t_exposure_ns):
        i -= 1
    return entries[max(i, 0):]


def frames(entries: list[Entry], fps: float) -> list[Entry]:
    """For each picture of a film of so many a second the volume that burnt then; fps 0: each volume once.

    A pause, or a clock that was set, counts as ten seconds at most.
    """
    if fps <= 0 or len(entries) < 2:
        return list(entries)
    at = [0]
    for a, b in zip(entries, entries[1:]):
        at.append(at[-1] + min(max(b.t_exposure_ns - a.t_exposure_ns, 0), GAP_NS))
    out, i = [], 0
    for f in range(int(at[-1] * fps / 1e9 + 1e-3) + 1):
        now = f * 1e9 / fps + 1e6
        while i + 1 < len(entries) and at[i + 1] <= now:
            i += 1
        out.append(entries[i])
    return out


def bake(entries: list[Entry], folder: str, fps: float) -> list[str]:
    """The volumes of one grid as a sequence in a new folder, flame_0001.vdb and on; its files.  Raises NoRoom."""
    chosen = frames(last_run(entries), fps)
    take = Take(folder)
    files = []
    try:
        for i, e in enumerate(chosen):
            if shutil.disk_usage(take.folder).free < ROOM + e.size:
                raise NoRoom(f"{take.folder} is full: make room there, or choose another folder")
            path = os.path.join(take.folder, f"flame_{i + 1:04d}.vdb")
            try:
                os.link(e.path, path)
            except OSError:
                shutil.copyfile(e.path, path)
            files.append(path)
    except OSError as e:
        shutil.rmtree(take.folder, ignore_errors=True)
        raise e if isinstance(e, NoRoom) else NoRoom(f"{take.folder} cannot be written ({e.strerror}): choose another folder") from None
    return files
