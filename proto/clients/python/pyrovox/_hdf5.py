"""A recording in HDF5, layout version 1 (daemon/VOLUMES.md)."""
from __future__ import annotations

import contextlib
import ctypes
import os
from typing import Any, Iterator, Optional

import numpy as np
import numpy.typing as npt

from . import _page
from .recording import BadRecording, Gap
from .volume import Floats, Grid, Planes, Report, Volume, status_name

try:
    import h5py
except ImportError:
    raise ImportError("recordings in HDF5 need h5py: apt-get install python3-h5py, "
                      "or pip install 'pyrovox[hdf5]'") from None

FORMAT, VERSION = "pyrovox volumes", 1
WHY = ("lost", "queue", "unreadable", "unsolved")
UNSOLVED = 0xffffffff  # status of a set that no part of a joined recording has yet
ATTEMPTS = 22  # to read something that a writer is changing; each waits twice as long, all together 8 ms
CACHE = 8 << 20  # bytes: a layer of chunks
TEXT = 8 << 20  # bytes
ROWS = 256  # of the columns that are read together
# what HDF5 says of a file that this process has open with other properties
ELSEWHERE = ("already open", "locking flag values don't match", "close degree doesn't match")
REPORT = ("iterations", "rel_residual", "active_voxels", "active_rays", "entries", "photometry_ns",
          "hull_ns", "restrict_ns", "solve_ns", "total_ns")
VALUES = ("t_publish_ns", "spread_ns", "latency_ns", "camera_mask", "cameras_present")
NO_BARS = 0xFFFFFFFF  # of /sets/bars_doubt
COLUMNS = ("number", "t_exposure_ns", "clamped", "status", "solver", *VALUES, *REPORT)


def text(where: Any, name: str) -> str:
    """An attribute or a dataset; "" where it is not there.  Of fixed length, as the format has it: HDF5 follows a
    damaged pointer to text of any length wherever it leads."""
    if name not in where:
        return ""
    kind = (where.get_id(name) if hasattr(where, "get_id") else where[name]).dtype
    if kind.kind != "S" or kind.itemsize > TEXT:
        raise ValueError(f"{name} is not text of fixed length")
    value = where[name] if hasattr(where, "get_id") else where[name][()]
    return bytes(value).decode(errors="replace").split("\0")[0]


@contextlib.contextmanager
def reading(path: str) -> Iterator[None]:
    """Whatever h5py says about a damaged file becomes a BadRecording."""
    try:
        yield
    except (BadRecording, _page.TooLarge):
        raise
    except OSError as e:
        if any(text in str(e) for text in ELSEWHERE):
            raise BadRecording(f"{path}: is open elsewhere in this process, in another way: close it there first") from None
        raise BadRecording(f"{path}: is damaged, or not a recording of volumes ({str(e)[:200]})") from None
    except (KeyError, RuntimeError, ValueError, TypeError, AttributeError, IndexError,
            OverflowError, MemoryError) as e:
        raise BadRecording(f"{path}: is damaged, or not a recording of volumes ({str(e)[:200]})") from None


def open_file(path: str, flags: int) -> Any:
    """As HDF5 opens it, but that a reader is in nobody's way: HDF5 by itself locks the file, and doubles its wait at a
    damaged place a hundred times when it follows a writer."""
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)
    access.set_cache(0, 521, CACHE, 0.75)
    access.set_file_locking(False, True)  # a reader's lock would keep the writer from closing its file
    if flags & h5py.h5f.ACC_SWMR_READ:
        limit = ctypes.CDLL(h5py.h5p.__file__).H5Pset_metadata_read_attempts
        limit.argtypes, limit.restype = [ctypes.c_int64, ctypes.c_uint], ctypes.c_int
        limit(access.id, ATTEMPTS)
    return h5py.File(h5py.h5f.open(os.fsencode(path), flags, fapl=access))


class Bars:
    """Error bars of one set: /emission_sd and, where they are, /emission_modes."""

    def __init__(self, file: "File", at: int, n_modes: int):
        self.file, self.at, self.n_modes = file, at, n_modes

    def sd(self) -> Floats:
        return self.file.values("emission_sd", self.at)

    def modes(self) -> Optional[Floats]:
        return self.file.values("emission_modes", self.at, slice(0, self.n_modes)) if self.n_modes else None


class File:
    def __init__(self, path: str, memory: int):
        self.path, self.memory = path, memory
        self.file: Any = None
        self.refresh()

    def refresh(self) -> None:
        """What was added meanwhile: a file that is open shows its attributes as they were."""
        self.close()
        with reading(self.path):
            try:
                self.file = open_file(self.path, h5py.h5f.ACC_RDONLY)
            except OSError as e:  # being written, or cut off
                if any(text in str(e) for text in ELSEWHERE[1:]):
                    raise
                self.file = open_file(self.path, h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ)
            try:
                self._head()
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        if self.file is not None:
            self.file.close()
            self.file = None

    def fail(self, why: str) -> BadRecording:
        return BadRecording(f"{self.path}: {why}")

    def _head(self) -> None:
        a = self.file.attrs
        if text(a, "format") != FORMAT:
            raise self.fail("is not a recording of volumes")
        if int(a["version"]) != VERSION:
            raise self.fail(f"is of version {int(a['version'])}, this package reads {VERSION}: install a newer one")
        self.emission = self.file["emission"]
        shape = self.emission.shape
        if len(shape) != 5 or self.emission.dtype != np.dtype("<f4"):
            raise self.fail("/emission is not [set][z][y][x][c] in f32")
        n = (int(shape[3]), int(shape[2]), int(shape[1]))
        try:
            _page.check_grid(n, shape[4], self.memory)
        except _page.TooLarge as e:
            raise _page.TooLarge(f"{self.path}: {e}; memory=BYTES allows more") from None
        except _page.BadMessage as e:
            raise self.fail(str(e)) from None
        origin, spacing = (np.array(a[k], np.float64).reshape(3) for k in ("origin", "spacing"))
        low, high = origin.tolist(), (origin + spacing * n).tolist()
        self.grid = Grid(n, (low[0], low[1], low[2]), (high[0], high[1], high[2]), text(a, "basis"), int(shape[4]))
        try:
            self.grid.check()
        except ValueError as e:
            raise self.fail(str(e)) from None
        for axis, name in enumerate("xyz"):
            have = self.file[name]
            if have.shape != (n[axis],) or not np.allclose(have[:], self.grid.centres(axis), rtol=0,
                                                           atol=1e-6 * spacing[axis]):
                raise self.fail(f"/{name} is of another grid than /emission")
        self.session, self.rig_hash = int(a["session"]), int(a["rig_hash"])
        self.fps, self.units, self.closed = float(a["fps"]), text(a, "units"), bool(a["closed"])
        self.rig, self.config = (text(self.file, k) for k in ("rig", "config"))
        self._sets(int(shape[0]))
        self._gaps()

    def _column(self, name: str, first: int, last: int) -> npt.NDArray[Any]:
        return np.asarray(self.file["sets"][name][first:last])

    def _sets(self, count: int) -> None:
        for name in COLUMNS:
            c = self.file["sets"][name]
            if c.ndim != 1 or c.dtype.kind not in ("S" if name == "solver" else "iuf"):
                raise self.fail(f"/sets/{name} is not a column")
            count = min(count, c.shape[0])
        if 16 * count > self.memory:
            raise _page.TooLarge(f"{self.path}: says that it has {count} sets; memory=BYTES allows more")
        self._at = np.flatnonzero(self._column("status", 0, count) != UNSOLVED)
        self._count = count
        self.sets = self._column("number", 0, count).astype(np.uint64)[self._at]
        self.t_exposure_ns = self._column("t_exposure_ns", 0, count).astype(np.int64)[self._at]
        self._first = -1
        self._rows: dict[str, Any] = {}

    def _gaps(self) -> None:
        g = self.file.get("gaps")
        columns = [g[k] for k in ("why", "set_first", "set_last", "volumes")] if g is not None else []
        n = min((c.shape[0] for c in columns), default=0)
        if 32 * n > self.memory:
            raise _page.TooLarge(f"{self.path}: says that it has {n} gaps")
        self.gaps = [Gap(WHY[w] if w < len(WHY) else "unknown", int(a), int(b), int(v))
                     for w, a, b, v in zip(*(c[:n] for c in columns))]

    def _row(self, k: int) -> dict[str, Any]:
        if self.file is None:
            raise ValueError(f"{self.path}: was closed")
        first = k - k % ROWS
        if first != self._first:
            with reading(self.path):
                self._rows = {c: self._column(c, first, min(first + ROWS, self._count)) for c in COLUMNS}
            self._first = first
        return {c: column[k - first] for c, column in self._rows.items()}

    def _bars(self, at: int) -> dict[str, Any]:
        """Of row `at`: nothing where it has no error bars."""
        if self.file is None:
            raise ValueError(f"{self.path}: was closed")
        with reading(self.path):
            if "emission_sd" not in self.file:
                return {}
            bits = int(self.file["sets/bars_doubt"][at])
            modes = int(self.file["sets/modes"][at]) if "emission_modes" in self.file else 0
        return {} if bits == NO_BARS else {"bars": Bars(self, at, modes), "doubts": tuple(_page.doubts(bits))}

    def values(self, name: str, at: int, *more: slice) -> Floats:
        """Of set `at` of a dataset of error bars, which has the shape of /emission behind the dimensions `more`."""
        if self.file is None:
            raise ValueError(f"{self.path}: was closed")
        with reading(self.path):
            d = self.file[name]
            if d.dtype != np.dtype("<f4") or d.shape[len(more) + 1 :] != self.grid.shape:
                raise self.fail(f"/{name} is not of the grid of /emission")
            v = np.asarray(d[(at, *more)], np.float32)
        if not np.isfinite(v).all():
            raise self.fail(f"/{name} has a value that is not finite")
        return v

    def volume(self, k: int) -> Volume:
        at = int(self._at[k])
        row = self._row(at)
        report = Report(status_name(int(row["status"])), row["solver"].decode(errors="replace"), **{c: row[c].item() for c in REPORT})

        more: dict[str, Any] = {c: int(row[c]) for c in VALUES}

        def read(z0: int, z1: int) -> Floats:
            if self.file is None:
                raise ValueError(f"{self.path}: was closed")
            with reading(self.path):
                planes = np.asarray(self.emission[at, z0:z1], np.float32)
                if self.emission.is_virtual and np.isnan(planes).all():
                    raise self.fail(f"set {int(row['number'])} is not there: its part, in {self.path}.parts, is gone or "
                                    "was written anew since they were joined")
                if not np.isfinite(planes).all():
                    raise self.fail(f"set {int(row['number'])} has a value that is not finite")
                return planes

        return Volume(grid=self.grid, set=int(row["number"]), session=self.session, report=report,
                      t_exposure_ns=int(row["t_exposure_ns"]), clamped=bool(row["clamped"]),
                      values=Planes(self.grid, read), units=self.units, rig_hash=self.rig_hash,
                      **more, **self._bars(at))
