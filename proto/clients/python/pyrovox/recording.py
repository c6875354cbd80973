"""Recordings of volumes."""
from __future__ import annotations

import datetime
import operator
import os
import time as clock
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Iterator, Optional, Protocol, Union, overload

import numpy as np
import numpy.typing as npt

from . import _page
from .volume import Grid, Volume

Time = Union[np.datetime64, datetime.datetime]
POLL = 0.1  # s between two looks at a file that is followed


class BadRecording(ValueError):
    """Not a recording, damaged, of a later version, of two grids, or not finite; the text names the file."""


class CutOff(BadRecording):
    """A recording that was followed has no end, and nothing more came."""


@dataclass(frozen=True)
class Gap:
    """Sets that are missing: `why` is lost (on the way), queue (the writer was slower), unreadable, or unsolved (of a
    recording in parts: not solved yet).

    >>> Gap("lost", 10, 12, 3).volumes       # how many are known to be missing
    3
    """

    why: str
    set_first: int
    set_last: int
    volumes: int


class Source(Protocol):
    """A format: what a Recording needs of it."""

    grid: Grid
    session: int
    rig_hash: int
    fps: float
    units: str
    rig: str
    config: str
    closed: bool
    gaps: list[Gap]
    sets: npt.NDArray[np.uint64]
    t_exposure_ns: npt.NDArray[np.int64]

    def volume(self, k: int) -> Volume: ...
    def refresh(self) -> None: ...
    def close(self) -> None: ...


def nanoseconds(t: Time) -> int:
    """Since 1970, UTC."""
    if isinstance(t, np.datetime64):
        if np.isnat(t):
            raise ValueError("not a time")
        return int(t.astype("datetime64[ns]").astype(np.int64))
    if t.tzinfo is None:
        t = t.replace(tzinfo=datetime.timezone.utc)
    since = t - datetime.datetime(1970, 1, 1, tzinfo=datetime.timezone.utc)
    return (since // datetime.timedelta(microseconds=1)) * 1000


class Recording:
    """What open() returns: volumes in the order of the recording, read when they are asked for.

        len(r), for v in r          how many, each
        r[0], r[-1]                 the first, the last
        r[np.datetime64(...)]       the nearest in time; also datetime (without a zone: UTC)
        r[10:20], r[t0:t1:10]       a list; every tenth from t0, before t1; r[-5:]
        r.set(1200)                 the one of frame set 1200
        r.sets, r.times             of all: numbers; np.datetime64 [ns]
        r.grid, r.session, r.rig_hash, r.fps, r.units, r.rig, r.config, r.gaps
        r.closed                    False: cut off, or still being written

    >>> with pyrovox.open("volumes.h5") as r:                    # doctest: +SKIP
    ...     r[r.times[0] + np.timedelta64(2, "s")].to_xarray()
    """

    def __init__(self, path: str, source: Source, follow: bool, timeout: float):
        self.path, self._source, self._follow, self._timeout = path, source, follow, timeout

    def __repr__(self) -> str:
        end = "" if self.closed else ", cut off or still being written"
        return f"<Recording {self.path}: {len(self)} volumes of {'x'.join(map(str, self.grid.n))}{end}>"

    @property
    def grid(self) -> Grid:
        """Box and voxels."""
        return self._source.grid

    @property
    def session(self) -> int:
        """Number of the daemon's run."""
        return self._source.session

    @property
    def rig_hash(self) -> int:
        """Changes when calibration or grid change."""
        return self._source.rig_hash

    @property
    def fps(self) -> float:
        """Nominal rate, 1/s; 0 unknown."""
        return self._source.fps

    @property
    def units(self) -> str:
        """Of the values: 1/m."""
        return self._source.units

    @property
    def rig(self) -> str:
        """Text of the rig.yaml in effect, "" unknown."""
        return self._source.rig

    @property
    def config(self) -> str:
        """All keys of pyrovoxd.yaml, "" unknown."""
        return self._source.config

    @property
    def gaps(self) -> list[Gap]:
        """Sets that are missing."""
        return self._source.gaps

    @property
    def closed(self) -> bool:
        """False: cut off, or still being written."""
        return self._source.closed

    @property
    def sets(self) -> npt.NDArray[np.uint64]:
        """Numbers of the sets [n]."""
        return self._source.sets

    @property
    def times(self) -> npt.NDArray[np.datetime64]:
        """Exposures, np.datetime64 [ns] [n]."""
        return self._source.t_exposure_ns.astype("datetime64[ns]")

    def __len__(self) -> int:
        return len(self._source.sets)

    def set(self, number: int) -> Volume:
        """The volume of a frame set, by its number; KeyError says why there is none.

        >>> r.set(1200).dense               # doctest: +SKIP
        """
        found = np.flatnonzero(self._source.sets == number)
        if len(found) == 0:
            why = [g.why for g in self.gaps if g.set_first <= number <= g.set_last]
            raise KeyError(f"{self.path}: has no set {number}" + (f" ({why[0]})" if why else ""))
        return self[int(found[0])]

    def _nearest(self, time: Time) -> int:
        if len(self) == 0:
            raise KeyError(f"{self.path}: is empty")
        t = nanoseconds(time)
        return int(np.argmin(np.abs(self._source.t_exposure_ns.astype(np.float64) - t)
                             if abs(t) > 1 << 62 else np.abs(self._source.t_exposure_ns - t)))

    def _from(self, bound: Union[int, Time]) -> npt.NDArray[np.bool_]:
        """Which volumes are not before a slice's bound."""
        if isinstance(bound, (np.datetime64, datetime.datetime)):
            return np.asarray(self._source.t_exposure_ns >= nanoseconds(bound))
        return np.arange(len(self)) >= bound + (len(self) if bound < 0 else 0)

    @overload
    def __getitem__(self, key: slice) -> list[Volume]: ...
    @overload
    def __getitem__(self, key: Union[int, Time]) -> Volume: ...
    def __getitem__(self, key: Union[int, Time, slice]) -> Union[Volume, list[Volume]]:
        n = len(self)
        if not isinstance(key, slice):
            k = self._nearest(key) if isinstance(key, (np.datetime64, datetime.datetime)) else operator.index(key)
            if not -n <= k < n:
                raise IndexError(f"{self.path}: has {n} volumes, none is number {k}; r.set({k}) is the one of set {k}")
            v = self._source.volume(k % n)
            v.lost = sum(g.volumes for g in self.gaps if g.set_first < v.set)
            return v
        which = np.ones(n, bool) if key.start is None else self._from(key.start)
        if key.stop is not None:
            which &= ~self._from(key.stop)
        return [self[int(k)] for k in np.flatnonzero(which)[:: key.step]]

    def __iter__(self) -> Iterator[Volume]:
        """All volumes; with `follow` also those that are still to come, until the recording is closed."""
        k, since = 0, clock.monotonic()
        while True:
            while k < len(self):
                yield self[k]
                k, since = k + 1, clock.monotonic()
            if not self._follow or self.closed:
                return
            if clock.monotonic() - since > self._timeout:
                raise CutOff(f"{self.path}: nothing more came in {self._timeout:g} s and it was not closed: cut off "
                             "after " f"{k} volumes, pyrovox repair finishes it; or its daemon makes none (timeout=)")
            clock.sleep(POLL)
            try:
                self._source.refresh()
            except BadRecording:  # at the moment in which it is closed it cannot be opened
                if clock.monotonic() - since > self._timeout:
                    raise

    def close(self) -> None:
        """Volumes that were not read yet cannot be read any more.

        >>> r.close()                       # doctest: +SKIP
        """
        self._source.close()

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, kind: Optional[type[BaseException]], e: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()


def open(path: Union[str, "os.PathLike[str]"], *, memory: int = _page.MEMORY, follow: bool = False,
         timeout: float = 10.0) -> Recording:
    """A recording of `pyrovox record`: an HDF5 file (needs h5py), or a folder of .npy.

    memory   bytes that a volume may need as floats; more is TooLarge
    follow   iterate on while it is still being written; CutOff when nothing comes for `timeout` seconds

    Raises BadRecording (a ValueError) with one sentence; a recording that is cut off is read as far as it
    is whole, `closed` says so.

    >>> for v in pyrovox.open("volumes.h5"):         # doctest: +SKIP
    ...     print(v.set, v.time, v.dense.max())
    """
    name = os.fspath(path)
    source: Any
    if os.path.isdir(name):
        from . import _npy
        source = _npy.Folder(name, memory)
    elif not os.path.exists(name):
        raise FileNotFoundError(f"{name}: no such recording")
    else:
        from . import _hdf5
        source = _hdf5.File(name, memory)
    return Recording(name, source, follow, timeout)
