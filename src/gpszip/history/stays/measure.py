"""How far and how long a track moves on a trip."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.fixes import Fixes, lengths

__all__ = ["Travel", "measure_travel"]

#: Seconds between two positions along which the length of a trip is measured.
_STEP = 5.0

#: Positions whose mean is taken, so that errors of single fixes add no length: 25 seconds.
_SMOOTHED = 5

#: Positions over which a speed is measured: 30 seconds.
_SPEED_STEPS = 6

#: Metres per second from which a track is in motion: half of a walk.
_MOVING_SPEED = 0.7

#: A jump is faster than so many times the speed that one calm step in twenty exceeds, as for
#: matching.
_JUMP_FACTOR = 4.0

#: Metres per second² that it takes from rest and back to it, at least, unlike a train after a walk.
_JUMP_ACCELERATION = 3.0

#: Most positions along a trip; those of a longer one lie farther apart.
_MAX_POSITIONS = 100_000

Floats = NDArray[np.float64]


class Travel(NamedTuple):
    """What a trip takes.

    Parameters
    ----------
    length : float
        Metres.
    moving : float
        Seconds in motion.
    line : float64 array, shape (n, d)
        Metres: positions of the fixes on the way, from begin to end.
    """

    length: float
    moving: float
    line: Floats


def measure_travel(fixes: Fixes, start: float, end: float, begin: Floats, finish: Floats) -> Travel:
    """Measure a trip between two times.

    Its length is that of the positions at even times, each the mean of those around it, as errors
    of single fixes would add to it.

    Parameters
    ----------
    fixes : Fixes
        A track.
    start, end : float
        Seconds.
    begin, finish : float64 array, shape (d,)
        Metres: where the trip begins and ends.

    Examples
    --------
    >>> times = np.arange(0.0, 601, 10)
    >>> x = np.interp(times, [0, 200, 300, 600], [0, 2000, 2000, 5000])
    >>> fixes = Fixes(times, x[:, None], np.full(61, 10.0))
    >>> travel = measure_travel(fixes, 0.0, 600.0, np.array([0.0]), np.array([5000.0]))
    >>> round(travel.length), round(travel.moving, -1)
    (5000, 540.0)
    """
    from scipy.ndimage import uniform_filter1d

    # Fixes on the way, between where it begins and where it ends.
    first = int(np.searchsorted(fixes.times, start, side="right"))
    rows = slice(first, max(first, int(np.searchsorted(fixes.times, end))))
    times = np.concatenate([[start], fixes.times[rows], [end]])
    line = np.concatenate([[begin], fixes.positions[rows], [finish]])
    if end <= start:
        return Travel(0.0, 0.0, line)

    # Positions at even times, and their means; the ends stay where they are. What is beyond a jump
    # moves back by it, so that it is no travel.
    together = line - _jumped(times, line)
    count = min(max(round((end - start) / _STEP), 1) + 1, _MAX_POSITIONS)
    even = np.linspace(start, end, count)
    positions = np.stack([np.interp(even, times, axis) for axis in together.T], axis=1)
    smooth = uniform_filter1d(positions, _SMOOTHED, axis=0, mode="nearest")
    smooth[0], smooth[-1] = together[0], together[-1]
    steps = lengths(np.diff(smooth, axis=0))

    # Speeds over half a minute around each step.
    speeds = uniform_filter1d(steps, _SPEED_STEPS, mode="nearest") / ((end - start) / (count - 1))
    moving = float((speeds >= _MOVING_SPEED).mean()) * (end - start)
    return Travel(float(steps.sum()), moving, line)


def _jumped(times: Floats, line: Floats) -> Floats:
    """How far jumps of the receiver have moved each position, shape (n, d).

    Of two successive steps, the slower one is calm. Half of a step between two rests speeds up and
    half of it slows down, by ``4 d / t**2``.
    """
    seconds, steps = np.diff(times), np.diff(line, axis=0)
    metres = lengths(steps)
    speeds = np.divide(metres, seconds, out=np.zeros(len(seconds)), where=seconds > 0)
    calm = np.minimum(speeds[1:], speeds[:-1]) if len(speeds) > 1 else speeds
    is_jump = (speeds > _JUMP_FACTOR * np.quantile(calm, 0.95)) & (
        4.0 * metres > _JUMP_ACCELERATION * seconds**2
    )
    moved: Floats = np.cumsum(np.where(is_jump[:, None], steps, 0.0), axis=0)
    return np.concatenate([np.zeros_like(line[:1]), moved])
