"""Lines between knots on a grid, and their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .log import Floats, Integers, Log


@dataclass(frozen=True)
class Steps:
    """Steps of the grid, as a file has them.

    Parameters
    ----------
    time : float
        Seconds.
    position : float
        Metres.
    """

    time: float
    position: float

    def __post_init__(self) -> None:
        for name in ("time", "position"):
            object.__setattr__(self, name, float(np.float32(getattr(self, name))))


@dataclass(frozen=True)
class Curve:
    """Lines between knots, one for each track.

    Parameters
    ----------
    firsts : int64 array, shape (tracks + 1,)
        Index of the first knot of each track, and the number of knots.
    ticks : int64 array, shape (knots,)
        Times of the knots since the start of their track, in steps.
    x, y : int64 array, shape (knots,)
        Positions in steps.
    steps : Steps
        The grid.
    """

    firsts: Integers
    ticks: Integers
    x: Integers
    y: Integers
    steps: Steps


def round_times(log: Log, kept: Integers, step: float) -> tuple[Integers, Integers, Integers]:
    """Round the times of the samples kept; leave out those whose time is that of one before.

    The last knot of a track is not earlier than its last sample, and not at the time of the first.

    Returns
    -------
    ticks, kept, firsts : int64 array
        Times since the start of the track in steps, the samples left, and the index of the first of
        each track.
    """
    # Ticks since the start of each track.
    tracks = np.searchsorted(log.firsts, kept, side="right") - 1
    since_start = (log.clock[kept] - log.clock_starts[tracks]) / step
    ticks = np.round(since_start).astype(np.int64)
    last = np.r_[np.diff(tracks) > 0, True]
    ticks[last] = np.ceil(np.maximum(since_start[last] - 1e-6, np.sign(since_start[last])))

    # One knot for each tick.
    fresh = np.r_[True, (np.diff(ticks) > 0) | (np.diff(tracks) > 0)]
    ticks, kept, tracks = ticks[fresh], kept[fresh], tracks[fresh]
    return ticks, kept, np.searchsorted(tracks, np.arange(len(log.names) + 1))


def make_curve(log: Log, kept: Integers, steps: Steps) -> Curve:
    """Round the samples kept to the grid."""
    ticks, kept, firsts = round_times(log, kept, steps.time)
    x, y = (np.round(p[kept] / steps.position).astype(np.int64) for p in (log.x, log.y))
    return Curve(firsts, ticks, x, y, steps)


def knot_clock(log: Log, curve: Curve) -> Floats:
    """Times of the knots on the clock of the log."""
    starts = log.clock_starts.repeat(np.diff(curve.firsts))
    clock: Floats = starts + curve.ticks * curve.steps.time
    return clock


def errors(log: Log, curve: Curve) -> Floats:
    """Distance in metres of each sample from the curve at its time."""
    clock, step = knot_clock(log, curve), curve.steps.position
    dx = np.interp(log.clock, clock, curve.x * step) - log.x
    dy = np.interp(log.clock, clock, curve.y * step) - log.y
    distances: Floats = np.sqrt(dx * dx + dy * dy)
    return distances
