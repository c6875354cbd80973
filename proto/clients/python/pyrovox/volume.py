"""One volume, wherever it came from."""
from __future__ import annotations

import struct
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Callable, Iterator, Optional, Protocol

import numpy as np
import numpy.typing as npt

from . import _page

Floats = npt.NDArray[np.float32]
Ids = npt.NDArray[np.uint32]
STATUS = ("converged", "max-iter", "deadline", "never used", "empty")  # PROTOCOL.md
BASIS = ("box", "trilinear")


@dataclass(frozen=True)
class Grid:
    """The box of voxels: `n` and all others along x, y, z; metres.

    >>> g = Grid((4, 2, 2), (0.0, 0.0, 0.0), (0.4, 0.2, 0.2), "box", 3)
    >>> g.shape                    # of `dense`
    (2, 2, 4, 3)
    >>> g.x.round(3).tolist()      # centres of voxels
    [0.05, 0.15, 0.25, 0.35]
    """

    n: tuple[int, int, int]
    min: tuple[float, float, float]
    max: tuple[float, float, float]
    basis: str
    channels: int

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """nz, ny, nx, channels."""
        return self.n[2], self.n[1], self.n[0], self.channels

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Sides of a voxel, m."""
        a, b, c = ((self.max[i] - self.min[i]) / self.n[i] for i in range(3))
        return a, b, c

    def centres(self, axis: int) -> npt.NDArray[np.float64]:
        """Centres of voxels along an axis (0 x, 1 y, 2 z), m."""
        return self.min[axis] + (np.arange(self.n[axis]) + 0.5) * self.spacing[axis]

    @property
    def x(self) -> npt.NDArray[np.float64]:
        """Centres of voxels along x, m."""
        return self.centres(0)

    @property
    def y(self) -> npt.NDArray[np.float64]:
        """Centres of voxels along y, m."""
        return self.centres(1)

    @property
    def z(self) -> npt.NDArray[np.float64]:
        """Centres of voxels along z, m."""
        return self.centres(2)

    def check(self) -> None:
        """Raises ValueError unless the box is one."""
        if not all(np.isfinite([*self.min, *self.max])) or not all(a < b for a, b in zip(self.min, self.max)):
            raise ValueError("the grid's box is empty or not finite")


@dataclass(frozen=True)
class Report:
    """What the solver says of a volume; times in ns.

    >>> Report(status="converged", solver="pcg").status     # or max-iter, deadline, empty
    'converged'
    """

    status: str = "unknown"
    solver: str = ""
    iterations: int = 0
    rel_residual: float = float("nan")
    active_voxels: int = 0
    active_rays: int = 0
    entries: int = 0
    photometry_ns: int = 0
    hull_ns: int = 0
    restrict_ns: int = 0
    solve_ns: int = 0
    total_ns: int = 0


def status_name(number: int) -> str:
    return STATUS[number] if 0 <= number < len(STATUS) else "unknown"


class Values(Protocol):
    """Where a volume's values are."""

    def bricks(self) -> tuple[Ids, Floats]: ...
    def dense(self) -> Floats: ...


class Deviations(Protocol):
    """Where a volume's error bars are."""

    def sd(self) -> Floats: ...
    def modes(self) -> Optional[Floats]: ...


@dataclass(eq=False)
class Volume:
    """One frame set's volume.  Values are made, or read from the disk, when they are asked for.

        v.dense          float32 [z][y][x][c], emission per metre; x fastest but for the colours
        v.sd             one standard deviation of each value of dense; None: there are no error bars
        v.doubts         why these may be too small, names of PROTOCOL.md; empty: no reason is known
        v.bricks, v.ids  the same as bricks [n][8][8][8][c] and their numbers: only those with flame
        v.set, v.time    number of the frame set; middle of its exposure, np.datetime64 [ns], UTC
        v.grid           box and voxels;  v.report: of the solver;  v.lost: messages (or recorded sets)
                         known to be lost before this one, in all
    """

    grid: Grid
    set: int
    session: int
    t_exposure_ns: int
    t_publish_ns: int
    spread_ns: int
    latency_ns: int
    camera_mask: int
    cameras_present: int
    clamped: bool
    report: Report
    values: Values = field(repr=False)
    units: str = "1/m"
    rig_hash: int = 0
    lost: int = 0
    bars: Optional[Deviations] = field(default=None, repr=False)
    doubts: tuple[str, ...] = ()

    @property
    def time(self) -> np.datetime64:
        """Middle of the exposure, UTC.

        >>> v.time                                  # doctest: +SKIP
        numpy.datetime64('2026-11-23T12:00:00.066666666')
        """
        return np.datetime64(self.t_exposure_ns, "ns")

    @cached_property
    def dense(self) -> Floats:
        """float32 [z][y][x][c].

        >>> v.dense[k, j, i]                        # doctest: +SKIP
        """
        return self.values.dense()

    @cached_property
    def sd(self) -> Optional[Floats]:
        """One standard deviation, float32 [z][y][x][c]; None: this volume has no error bars.

        >>> f"{v.dense[k, j, i, 0]:.3g} \u00b1 {v.sd[k, j, i, 0]:.1g} {v.units}"      # doctest: +SKIP
        '12.3 \u00b1 0.8 1/m'
        """
        return self.bars.sd() if self.bars is not None else None

    @cached_property
    def modes(self) -> Optional[Floats]:
        """What the errors of voxels have in common, float32 [k][z][y][x][c]; None: not known, as of a live stream.

        The covariance of a channel is sum over k of modes[k] modes[k]', and sd**2 minus their squares on the diagonal.
        So the bar of a sum over a region, a mask [z][y][x][c], is

        >>> own = np.maximum(v.sd**2 - (v.modes**2).sum(0), 0)                        # doctest: +SKIP
        >>> np.sqrt(((v.modes * mask).sum((1, 2, 3, 4)) ** 2).sum() + (own * mask).sum())    # doctest: +SKIP
        """
        return self.bars.modes() if self.bars is not None else None

    @cached_property
    def _sparse(self) -> tuple[Ids, Floats]:
        return self.values.bricks()

    @property
    def ids(self) -> Ids:
        """Numbers of the bricks, ascending: (bz * nby + by) * nbx + bx."""
        return self._sparse[0]

    @property
    def bricks(self) -> Floats:
        """float32 [n][8][8][8][c]; what of a brick lies outside the grid is 0."""
        return self._sparse[1]

    def to_xarray(self) -> Any:
        """`dense` as an xarray.DataArray: z, y, x in metres, time and set beside it.

        >>> a = v.to_xarray()                       # doctest: +SKIP
        >>> a.sel(z=0.4, method="nearest").sum("c").plot()             # doctest: +SKIP
        >>> xarray.concat([v.to_xarray() for v in recording[-5:]], "time")   # doctest: +SKIP
        """
        try:
            import xarray
        except ImportError:
            raise ImportError("Volume.to_xarray needs xarray: apt-get install python3-xarray, "
                              "or pip install 'pyrovox[xarray]'") from None
        g = self.grid
        coords: dict[str, Any] = {
            name: (name, g.centres(axis), {"units": "m", "long_name": f"{name} of the voxels' centres"})
            for axis, name in ((2, "z"), (1, "y"), (0, "x"))}
        coords["c"] = ["red", "green", "blue"] if g.channels == 3 else ["grey"]
        coords["time"], coords["set"] = self.time, self.set
        return xarray.DataArray(self.dense, coords, ("z", "y", "x", "c"), "emission", {
            "units": self.units, "basis": g.basis, "session": f"{self.session:016x}",
            "rig_hash": f"{self.rig_hash:016x}"})


class Travelled:
    """Values as they came over the wire, half precision where they were."""

    def __init__(self, grid: Grid, ids: Ids, values: npt.NDArray[Any]):
        self.grid, self.ids, self.values = grid, ids, values

    def bricks(self) -> tuple[Ids, Floats]:
        return self.ids, self.values.astype(np.float32)

    def dense(self) -> Floats:
        return _page.unpack(self.grid.n, self.grid.channels, self.ids, self.values)


class TravelledBars:
    """Error bars as they came over the wire."""

    def __init__(self, values: Travelled):
        self.values = values

    def sd(self) -> Floats:
        return self.values.dense()

    def modes(self) -> None:
        return None


class Planes:
    """Values that lie dense in a file; read(z0, z1) gives planes of it."""

    def __init__(self, grid: Grid, read: Callable[[int, int], Floats], step: int = 16):
        self.grid, self.read, self.step = grid, read, step

    def slabs(self) -> Iterator[tuple[int, Floats]]:
        for z in range(0, self.grid.n[2], self.step):
            yield z, self.read(z, min(z + self.step, self.grid.n[2]))

    def dense(self) -> Floats:
        return self.read(0, self.grid.n[2])

    def bricks(self) -> tuple[Ids, Floats]:
        nx, ny, _ = self.grid.n
        bx, by, c = (nx + 7) // 8, (ny + 7) // 8, self.grid.channels
        ids, bricks = [np.zeros(0, np.uint32)], [np.zeros((0, 8, 8, 8, c), np.float32)]
        for z, slab in self.slabs():
            for z0 in range(0, len(slab), 8):
                room = np.zeros((8, by * 8, bx * 8, c), np.float32)
                room[: min(8, len(slab) - z0), :ny, :nx] = slab[z0 : z0 + 8]
                blocks = room.reshape(8, by, 8, bx, 8, c).transpose(1, 3, 0, 2, 4, 5).reshape(-1, 8, 8, 8, c)
                lit = np.flatnonzero(blocks.any(axis=(1, 2, 3, 4)))
                ids.append((lit + (z + z0) // 8 * by * bx).astype(np.uint32))
                bricks.append(blocks[lit])
        return np.concatenate(ids), np.concatenate(bricks)


def grid_of(m: dict[str, Any]) -> Grid:
    """Of a decoded start or volume."""
    (nx, ny, nz), low, high = m["n"], m["min"], m["max"]
    g = Grid((nx, ny, nz), (low[0], low[1], low[2]), (high[0], high[1], high[2]),
             BASIS[m["basis"]] if m["basis"] < len(BASIS) else "unknown", m["channels"])
    g.check()
    return g


def bars_of(v: Volume, header: dict[str, Any], body: bytes, memory: int, start: Optional[dict[str, Any]]) -> bool:
    """Gives v the bars of a message, if it is of v.  False: the message is damaged."""
    try:
        m = _page.decode_bricks(body, memory, start)
        if not np.isfinite(m["values"]).all() or (m["values"] < 0).any():
            return False
        grid = grid_of(m)
    except (struct.error, ValueError, OverflowError):
        return False
    if header["session"] == v.session and m["set"] == v.set and grid == v.grid and np.array_equal(m["ids"], v.ids):
        v.bars = TravelledBars(Travelled(grid, m["ids"], m["values"]))
        v.doubts = tuple(_page.doubts(m["doubt"]))
    return True


def volume_of(header: dict[str, Any], body: bytes, memory: int, start: Optional[dict[str, Any]]) -> Volume:
    """A volume message, taken apart by decode_header.  Raises BadMessage."""
    try:
        m = _page.decode_bricks(body, memory, start)
        if not np.isfinite(m["values"]).all():
            raise _page.BadMessage("a value is not finite")
        grid, r = grid_of(m), m["report"]
        report = Report(status_name(r.pop("status")), **r)
    except (struct.error, ValueError, OverflowError) as e:
        raise e if isinstance(e, _page.BadMessage) else _page.BadMessage(str(e)) from None
    start = start or {}
    return Volume(grid=grid, set=m["set"], session=header["session"], clamped=bool(header["flags"] & 1),
                  report=report, values=Travelled(grid, m["ids"], m["values"]),
                  units=start.get("units", "1/m"), rig_hash=start.get("rig_hash", 0),
                  **{k: m[k] for k in ("t_exposure_ns", "t_publish_ns", "spread_ns", "latency_ns",
                                       "camera_mask", "cameras_present")})


def decode(message: bytes, memory: int = _page.MEMORY, *, bars: Optional[bytes] = None) -> Volume:
    """One volume message of PROTOCOL.md, for who has sockets of his own; bars: the newest message of error bars.

    Raises BadMessage (a ValueError): damaged, not a volume, not finite; TooLarge: over `memory` bytes.

    >>> v = pyrovox.decode(open("volume-f32-raw.bin", "rb").read())     # doctest: +SKIP
    """
    header, body = _page.decode_header(message)
    if header["type"] != "volume":
        raise _page.BadMessage(f"a message of type {header['type']}, not a volume")
    v = volume_of(header, body, memory, None)
    if bars is not None:
        of, body = _page.decode_header(bars)
        if of["type"] != "bars" or not bars_of(v, of, body, memory, None):
            raise _page.BadMessage(f"a message of type {of['type']} that is damaged, or has no error bars")
    return v
