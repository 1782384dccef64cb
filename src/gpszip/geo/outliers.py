"""Spikes: samples that leap far away and back again."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "SPEED_FACTOR",
    "SPEED_QUANTILE",
    "find_outliers",
    "mark_outliers",
    "min_adjacent_speeds",
]

#: The longest run of samples that counts as one spike.
_MAX_OUTLIER_RUN = 4

#: A leap is this many times faster than the track's high calm speed, which is this quantile of those that aren't 0.
SPEED_FACTOR, SPEED_QUANTILE = 5.0, 0.95


def find_outliers(times: ArrayLike, positions: ArrayLike) -> NDArray[np.bool_]:
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
    >>> find_outliers(range(7), [[x, 0.0] for x in (0, 1, 2, 900, 4, 5, 6)]).nonzero()[0].tolist()
    [3]
    """
    times, positions = np.asarray(times, dtype=np.float64), np.asarray(positions, dtype=np.float64)
    if len(times) < 3:
        return np.zeros(len(times), dtype=np.bool_)
    min_interval = 0.5 * float(
        np.median(np.diff(times))
    )  # two fixes in the same instant are noise, not speed
    calm = min_adjacent_speeds(times, positions, min_interval)
    moving = calm[calm > 0]
    return mark_outliers(
        times,
        positions,
        min_interval,
        SPEED_FACTOR * float(np.quantile(moving, SPEED_QUANTILE)) if len(moving) else float("inf"),
    )


def min_adjacent_speeds(
    times: NDArray[np.float64], positions: NDArray[np.float64], min_interval: float
) -> NDArray[np.float64]:
    """Calm speed of each sample but the first and the last, in m/s; shorter steps than ``shortest`` seconds count as such."""
    speeds = _speeds(times, positions, 1, min_interval)
    calm: NDArray[np.float64] = np.minimum(
        np.minimum(speeds[:-1], speeds[1:]), _speeds(times, positions, 2, min_interval)
    )
    return calm


def mark_outliers(
    times: NDArray[np.float64], positions: NDArray[np.float64], min_interval: float, limit: float
) -> NDArray[np.bool_]:
    """Samples that belong to spikes, if speeds above ``limit`` are leaps."""
    spikes = np.zeros(len(times), dtype=np.bool_)
    fast = _speeds(times, positions, 1, min_interval) > limit
    for run in range(1, min(_MAX_OUTLIER_RUN, len(times) - 2) + 1):
        passes = _speeds(times, positions, run + 1, min_interval) <= limit
        starts = np.flatnonzero(fast[: len(passes)] & fast[run:] & passes) + 1
        starts = starts[~spikes[starts - 1] & ~spikes[(starts + run)]]
        for offset in range(run):
            spikes[starts + offset] = True
    return spikes


def _speeds(
    times: NDArray[np.float64], positions: NDArray[np.float64], step: int, min_interval: float
) -> NDArray[np.float64]:
    away = positions[step:] - positions[:-step]
    speeds: NDArray[np.float64] = np.sqrt((away * away).sum(axis=1)) / np.maximum(
        times[step:] - times[:-step], min_interval
    )
    return speeds
