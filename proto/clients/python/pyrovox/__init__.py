"""Volumes of a pyrovoxd: live over the network, and from recordings.

    import pyrovox
    for v in pyrovox.subscribe():        # the daemon of this host; of another: ("tcp://lab:5555", key="me.key")
        v.dense                  # float32 [z][y][x][c]: emission per metre
        v.to_xarray()            # the same with metres and time

    with pyrovox.open("volumes.h5") as recording:
        recording[0], recording[-1], recording.set(1200)
        recording[np.datetime64("2026-11-23T12:00:00")]   # the nearest in time
        for v in recording: ...

The daemon is never held up: who reads too slowly loses volumes, and `lost` tells how many.
"""
from ._page import BadMessage, TooLarge
from .live import Refused, Subscription, subscribe
from .recording import BadRecording, CutOff, Gap, Recording, open
from .volume import Grid, Report, Volume, decode

__all__ = ["BadMessage", "BadRecording", "CutOff", "Gap", "Grid", "Recording", "Refused", "Report",
           "Subscription", "TooLarge", "Volume", "decode", "open", "subscribe"]
__version__ = "0.1.0"
