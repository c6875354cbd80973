"""A recording as a folder: SET.npy and SET.json of each volume, sd/SET.npy with its error bars, recording.json, rig.yaml, config.yaml.

Also a folder of `pyrovox reconstruct`: its .json have `frame`, `time_ns` and `solver` for `set`, `t_exposure_ns` and `report`."""
from __future__ import annotations

import json
import os
from typing import Any

import numpy as np

from . import _page
from .recording import BadRecording, Gap
from .volume import Floats, Grid, Planes, Report, Volume

VERSION = 1
TEXT = 4 << 20  # bytes
REPORT = ("status", "solver", "iterations", "rel_residual", "active_voxels", "active_rays", "entries")
NUMBERS = ("t_publish_ns", "spread_ns", "latency_ns", "cameras_present")


def load(path: str) -> dict[str, Any]:
    try:
        with open(path, "rb") as f:
            m = json.loads(f.read(TEXT))
    except (ValueError, RecursionError):
        m = None
    if not isinstance(m, dict):
        raise BadRecording(f"{path}: is not JSON of a recording")
    return m


def text(path: str) -> str:
    try:
        with open(path, encoding="utf-8", errors="replace") as f:
            return f.read(TEXT)
    except OSError:
        return ""


def exposure(m: dict[str, Any]) -> int:
    return int(m["t_exposure_ns"] if "t_exposure_ns" in m else m["time_ns"])


class Beside:
    """Error bars in a file beside the volume's."""

    def __init__(self, values: Planes):
        self.values = values

    def sd(self) -> Floats:
        return self.values.dense()

    def modes(self) -> None:
        return None


class Folder:
    def __init__(self, path: str, memory: int):
        self.path, self.memory = path, memory
        self.refresh()

    def close(self) -> None:
        pass

    def refresh(self) -> None:
        # a volume's .npy comes after its .json
        self.names = sorted((n[:-4] for n in os.listdir(self.path) if n.endswith(".npy") and n[:-4].isdigit()), key=int)
        for a, b in zip(self.names, self.names[1:]):
            if int(a) == int(b):
                raise BadRecording(f"{self.path}: {a}.npy and {b}.npy have one number: move one of them away")
        try:
            self._head()
            self.sets = np.array([int(n) for n in self.names], np.uint64)
            self.t_exposure_ns = np.array([self._times(n) for n in self.names], np.int64)
        except (KeyError, TypeError, ValueError, OverflowError, IndexError) as e:
            if isinstance(e, (BadRecording, _page.TooLarge)):
                raise
            raise BadRecording(f"{self.path}: {type(e).__name__} in a .json: {e}") from None

    def _head(self) -> None:
        whole = os.path.join(self.path, "recording.json")
        m = load(whole) if os.path.exists(whole) else {}
        if m.get("version", VERSION) != VERSION:
            raise BadRecording(f"{self.path}: is of version {m['version']}, this package reads {VERSION}: install a newer one")
        self.closed, self.fps = bool(m.get("closed", True)), float(m.get("fps", 0))
        self.gaps = [Gap(str(g["why"]), int(g["set_first"]), int(g["set_last"]), int(g["volumes"]))
                     for g in m.get("gaps", [])]
        self.rig, self.config = (text(os.path.join(self.path, n)) for n in ("rig.yaml", "config.yaml"))
        if not self.names:
            if not m:
                raise BadRecording(f"{self.path}: is not a recording of volumes: no NUMBER.npy with its NUMBER.json")
            self.grid = Grid((1, 1, 1), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), "box", 1)
            self.session, self.rig_hash, self.units = int(m.get("session", "0"), 16), 0, "1/m"
            return
        first = self._describe(self.names[0])
        self.grid = self._grid(self.names[0], first)
        self.session, self.rig_hash = (int(first.get(k, "0"), 16) for k in ("session", "rig_hash"))
        self.units = str(first.get("units", "1/m")) if "set" in first else "1/m"

    def _describe(self, name: str) -> dict[str, Any]:
        path = os.path.join(self.path, name + ".json")
        if not os.path.exists(path):
            raise BadRecording(f"{path}: is missing; move {name}.npy away, or let pyrovox repair do so")
        m = load(path)
        number = int(m["set"] if "set" in m else m["frame"]) % (1 << 64)  # written as of 64 bits with a sign
        if number != int(name):
            raise BadRecording(f"{path}: is of set {number}, of another file; name the two alike after their set")
        return m

    def _times(self, name: str) -> int:
        return exposure(self._describe(name))

    def _grid(self, name: str, m: dict[str, Any]) -> Grid:
        nz, ny, nx, channels = (int(v) for v in [*m["shape"], 1][:max(4, len(m["shape"]))])
        try:
            _page.check_grid((nx, ny, nz), channels, self.memory)
            low = [float(v) for v in m["origin"]]
            high = [a + float(h) * n for a, h, n in zip(low, m["spacing"], (nx, ny, nz))]
            g = Grid((nx, ny, nz), (low[0], low[1], low[2]), (high[0], high[1], high[2]), str(m["basis"]), channels)
            g.check()
            return g
        except _page.TooLarge as e:
            raise _page.TooLarge(f"{self.path}: {e}; memory=BYTES allows more") from None
        except ValueError as e:
            raise BadRecording(f"{self.path}/{name}.json: {e}") from None

    def volume(self, k: int) -> Volume:
        name = self.names[k]
        try:
            m = self._describe(name)
            if self._grid(name, m) != self.grid:
                raise BadRecording(f"{self.path}/{name}.json: is of another grid than the first volume")
            r = m.get("report", m.get("solver", {}))
            ms = {f"{key}_ns": round(1e6 * float(value)) for key, value in r.get("ms", {}).items()
                  if f"{key}_ns" in Report.__dataclass_fields__}
            more: dict[str, Any] = {key: int(m.get(key, 0)) for key in NUMBERS}
            residual = {} if r.get("rel_residual", 0) is not None else {"rel_residual": float("nan")}
            report = Report(**{**{key: r[key] for key in REPORT if key in r}, **ms, **residual})
            return Volume(grid=self.grid, set=int(name), session=int(m.get("session", "0"), 16), report=report,
                          t_exposure_ns=exposure(m), camera_mask=int(m.get("camera_mask", "0"), 16),
                          clamped=bool(m.get("clamped", False)), values=self._values(name), units=self.units,
                          rig_hash=self.rig_hash, **more, **self._bars(name, m))
        except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as e:
            if isinstance(e, (BadRecording, _page.TooLarge)):
                raise
            raise BadRecording(f"{self.path}/{name}.json: {type(e).__name__}: {e}") from None

    def _bars(self, name: str, m: dict[str, Any]) -> dict[str, Any]:
        if "bars" not in m or not os.path.exists(os.path.join(self.path, "sd", name + ".npy")):
            return {}
        bits = int(m["bars"].get("doubt", 0))
        return {"bars": Beside(self._values(os.path.join("sd", name))), "doubts": tuple(_page.doubts(bits))}

    def _values(self, name: str) -> Planes:
        path = os.path.join(self.path, name + ".npy")

        def read(z0: int, z1: int) -> Floats:
            try:
                a = np.load(path, mmap_mode="r", allow_pickle=False)
            except (OSError, ValueError, SyntaxError, EOFError, MemoryError, OverflowError) as e:
                raise BadRecording(f"{path}: {e}") from None
            a = a[..., None] if a.ndim == 3 else a
            if a.shape != self.grid.shape or a.dtype != np.dtype("<f4"):
                raise BadRecording(f"{path}: is not float32 {list(self.grid.shape)}, as its .json says")
            planes = np.array(a[z0:z1], np.float32)
            if not np.isfinite(planes).all():
                raise BadRecording(f"{path}: has a value that is not finite")
            return planes

        return Planes(self.grid, read)
