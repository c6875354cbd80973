"""What the buttons do, and the main thread's part of following a bridge: a timer that sets Volume.filepath."""
from __future__ import annotations

import os
import time
from typing import Any, Optional

import bpy
from bpy.app.handlers import persistent

from . import flame, vdb
from .stream import Stream
from .websocket import Address

TICK = 0.01  # s
REDRAW = 0.25


class Wrong(Exception):
    """What was asked for cannot be done; the text says what can."""


class Follower:
    """The one connection of this Blender."""

    def __init__(self) -> None:
        self.address: Optional[Address] = None  # with the token: here, in no property, so in no .blend
        self.stream: Optional[Stream] = None
        self.shelf: Optional[vdb.Shelf] = None
        self.take: Optional[vdb.Take] = None
        self.paused = False
        self.error = ""
        self.shown: Optional[vdb.Entry] = None
        self._redrawn = 0.0

    # ---- buttons ---------------------------------------------------------------------------

    def connect(self, certificate: str, memory: int) -> None:
        if self.address is None:
            raise Wrong("paste the address that pyrovox view prints: http://127.0.0.1:8737/#...")
        if not self.address.token:
            raise Wrong("the address has no token: copy it whole, with '#' and the 32 digits behind it")
        library = vdb.library()
        if library is None:
            raise Wrong(vdb.MISSING)
        self.disconnect()
        try:
            self.shelf = self.shelf or vdb.Shelf(bpy.app.tempdir or None)
        except vdb.NoRoom as e:
            raise Wrong(str(e)) from None
        self.error, self.paused = "", False
        self.appear()
        self.stream = Stream(self.address, self.shelf, library, certificate, memory)
        self.stream.start()
        if not bpy.app.timers.is_registered(tick):
            bpy.app.timers.register(tick, persistent=True)

    def disconnect(self) -> None:
        """What is shown stays."""
        if self.stream is not None:
            self.record_end()
            self.stream.stop()
            self.error, self.stream = "", None
        if bpy.app.timers.is_registered(tick):
            bpy.app.timers.unregister(tick)

    def close(self) -> None:
        self.disconnect()
        if self.shelf is not None:
            self.shelf.close()
            self.shelf = None

    def pause(self, on: bool) -> None:
        if self.stream is None:
            raise Wrong("not connected")
        self.paused = on
        self.stream.pause(on)
        if not on:
            self.appear()

    def record(self, folder: str) -> None:
        if self.stream is None:
            raise Wrong("not connected")
        try:
            self.take = vdb.Take(where(folder))
        except vdb.NoRoom as e:
            raise Wrong(str(e)) from None
        self.stream.record(self.take)

    def record_end(self) -> None:
        if self.stream is not None and self.recording() is not None:
            self.take = self.recording()
            self.stream.record(None)
            if self.take is not None and not self.take.entries:
                self.take.discard()

    def recording(self) -> Optional[vdb.Take]:
        return self.stream.recording() if self.stream is not None else None

    def bake(self, folder: str, fps: float, first: int) -> tuple[Any, int]:
        """The take, or what came so far, as a sequence, in place of the live flame; and the number of its files."""
        self.record_end()
        entries = list(self.take.entries) if self.take is not None and self.take.entries else self.shelf.kept() if self.shelf is not None else []
        if not entries:
            raise Wrong("nothing came yet: connect first")
        try:
            files = vdb.bake(entries, where(folder), fps)
        except vdb.NoRoom as e:
            raise Wrong(str(e)) from None
        if folder.startswith("//"):
            files = [bpy.path.relpath(f) for f in files]
        if self.stream is not None:
            self.pause(True)
        if (volume := flame.find()) is not None:
            flame.hide(volume, True)
        self.take = None
        return flame.sequence(files, entries[-1].channels, entries[-1].spacing, first), len(files)

    # ---- the timer -------------------------------------------------------------------------

    def appear(self) -> None:
        volume = flame.find() or flame.make(flame.LIVE, "Flame")
        flame.hide(volume, False)
        if self.shown is not None and self.shelf is not None and os.path.exists(self.shown.path):
            volume.filepath = self.shown.path
            flame.dress(volume, self.shown.channels, self.shown.spacing)

    def tick(self) -> Optional[float]:
        s = self.stream
        if s is None:
            return None
        if bpy.app.is_job_running("RENDER"):
            return 0.1  # what is being rendered stays as it is
        e = s.newest()
        if e is not None:
            volume = flame.find()
            if volume is None:
                self.disconnect()
                self.error = "the flame's Volume was deleted: Connect makes it anew"
                return None
            volume.filepath = e.path
            if self.shown is None or (self.shown.channels, self.shown.spacing) != (e.channels, e.spacing) or len(volume.materials) == 0:
                flame.dress(volume, e.channels, e.spacing)
            self.shown = e
            if self.shelf is not None:
                self.shelf.hold(e.path)
            s.shown(e)
        elif self.shown is not None and (volume := flame.find()) is not None and volume.filepath != self.shown.path:
            volume.filepath = self.shown.path  # an undo brought back a file that is gone
        self._redraw()
        return TICK if s.state == "live" else 0.1

    def _redraw(self) -> None:
        if time.monotonic() - self._redrawn < REDRAW:
            return
        self._redrawn = time.monotonic()
        for window in bpy.context.window_manager.windows:
            for area in window.screen.areas:
                if area.type == "VIEW_3D":
                    area.tag_redraw()

    def words(self) -> tuple[list[str], str]:
        """What the panel says: lines, and what is wrong."""
        s = self.stream
        if s is None:
            return ["Not connected"], self.error
        state = "Paused" if self.paused and s.state == "live" else {"connecting": "Connecting", "live": "Live", "failed": "Ended"}[s.state]
        lines = [f"{state}: {s.address}"]
        if s.state == "live":
            if self.shown is not None:
                lines.append(f"Set {self.shown.set}: {s.rate():.1f} sets/s, {s.age_ms():.0f} ms old")
            else:
                lines.append("No volume yet: the daemon sends none to the bridge")
            if s.reason:
                lines.append(f"The daemon has ended: {s.reason}")
            lost = ", ".join(f"{n} {where}" for where, n in s.drops().items() if n)
            lines.append(f"Not shown: {lost or 'none'}")
        if (take := self.recording()) is not None:
            lines.append(f"Recording: {len(take.entries)} volumes in {take.folder}")
        return lines, s.error or s.notice or self.error


def where(folder: str) -> str:
    if folder.startswith("//") and not bpy.data.filepath:
        raise Wrong("save the .blend first, as the folder is beside it, or choose another folder")
    return str(bpy.path.abspath(folder))


live = Follower()


def tick() -> Optional[float]:
    """For bpy.app.timers; None ends it.  Blender drops a timer that raises, in silence as far as the panel goes."""
    try:
        return live.tick()
    except Exception as e:
        live.disconnect()
        live.error = f"has ended by a mistake of its own, please report it: {type(e).__name__}: {e}"
        raise


@persistent  # type: ignore[misc]
def loaded(*_: Any) -> None:
    """Another .blend: the flame appears there."""
    if live.stream is not None:
        live.appear()
