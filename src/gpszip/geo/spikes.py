"""Spikes: samples that leap far away and back again."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["find_spikes"]

#: The longest run of samples that counts as one spike.
_LONGEST = 4

#: A leap is this many times faster than the track's high calm speed.
_FACTOR = 5.0


def find_spikes(times: ArrayLike, positions: ArrayLike) -> NDArray[np.bool_]:
    """Find single samples, or runs of up to four, that leap out and back at a speed this track doesn't have.

    A sample's calm speed is the least of the speeds into it, out of it and past it, so that spikes hardly touch its
    distribution; leaping is faster than five times the 95th percentile of it. A run of samples is a spike if the track
    leaps to its first one and from its last one, and the step that passes over it is no leap. A leap without a way
    back stays: it may be a flight. So do the ends of the track, where out and back can't be told apart.

    Parameters
    ----------
    times : array_like, shape (n,)
        Seconds, strictly increasing.
    positions : array_like, shape (n, d)
        Metres.

    Returns
    -------
    bool array, shape (n,)
        Samples that belong to spikes.

    Examples
    --------
    >>> find_spikes(range(7), [[x, 0.0] for x in (0, 1, 2, 900, 4, 5, 6)]).nonzero()[0].tolist()
    [3]
    """
    times, positions = np.asarray(times, dtype=np.float64), np.asarray(positions, dtype=np.float64)
    spikes = np.zeros(len(times), dtype=np.bool_)
    if len(times) < 3:
        return spikes
    shortest = 0.5 * float(np.median(np.diff(times)))  # two fixes in the same instant are noise, not speed
    speeds, past = _speeds(times, positions, 1, shortest), _speeds(times, positions, 2, shortest)
    limit = _leap(np.minimum(np.minimum(speeds[:-1], speeds[1:]), past))
    fast = speeds > limit
    for run in range(1, min(_LONGEST, len(times) - 2) + 1):
        passes = _speeds(times, positions, run + 1, shortest) <= limit
        starts = np.flatnonzero(fast[: len(passes)] & fast[run:] & passes) + 1
        starts = starts[~spikes[starts - 1] & ~spikes[(starts + run)]]
        for offset in range(run):
            spikes[starts + offset] = True
    return spikes


def _leap(calm: NDArray[np.float64]) -> float:
    moving = calm[calm > 0]
    return _FACTOR * float(np.quantile(moving, 0.95)) if len(moving) else float("inf")


def _speeds(times: NDArray[np.float64], positions: NDArray[np.float64], step: int, shortest: float) -> NDArray[np.float64]:
    away = positions[step:] - positions[:-step]
    speeds: NDArray[np.float64] = np.sqrt((away * away).sum(axis=1)) / np.maximum(times[step:] - times[:-step], shortest)
    return speeds
