"""Outliers: samples that jump far away and back again."""

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

#: Samples; the longest run that counts as one outlier.
_MAX_OUTLIER_RUN = 4

#: A jump is faster than this factor times the quantile below.
SPEED_FACTOR = 5.0

#: Quantile of the nonzero minimum adjacent speeds of a track.
SPEED_QUANTILE = 0.95

#: Steps shorter than this share of the median interval count as that long: two samples at almost
#: the same time are noise, not speed.
_MIN_INTERVAL_SHARE = 0.5


def find_outliers(times: ArrayLike, positions: ArrayLike) -> NDArray[np.bool_]:
    """Find samples, or runs of up to four, that jump away and back at an implausible speed.

    The minimum adjacent speed of a sample is the least of the speeds to it, from it, and from
    its predecessor to its successor. Outliers hardly affect the distribution of these minima. A
    jump is faster than five times their 95th percentile, zeros left out.

    A run of samples is an outlier if the track jumps to its first sample and from its last one,
    and the step that skips the run is no jump. A jump without a return stays: it may be a flight.
    The ends of a track stay, too, as they have no step on one side.

    Parameters
    ----------
    times : array_like, shape (n,)
        Seconds, strictly increasing.
    positions : array_like, shape (n, d)
        Metres.

    Returns
    -------
    bool array, shape (n,)
        Samples that are outliers.

    Examples
    --------
    >>> positions = [[x, 0.0] for x in (0, 1, 2, 900, 4, 5, 6)]
    >>> find_outliers(range(7), positions).nonzero()[0].tolist()
    [3]
    """
    times, positions = np.asarray(times, dtype=np.float64), np.asarray(positions, dtype=np.float64)
    if len(times) < 3:
        return np.zeros(len(times), dtype=np.bool_)

    # The track's own speeds; without movement there is nothing to compare with.
    min_interval = _MIN_INTERVAL_SHARE * float(np.median(np.diff(times)))
    speeds = min_adjacent_speeds(times, positions, min_interval)
    moving = speeds[speeds > 0]
    limit = float("inf")
    if len(moving):
        limit = SPEED_FACTOR * float(np.quantile(moving, SPEED_QUANTILE))
    return mark_outliers(times, positions, min_interval, limit)


def min_adjacent_speeds(
    times: NDArray[np.float64], positions: NDArray[np.float64], min_interval: float
) -> NDArray[np.float64]:
    """Return the minimum adjacent speed of each sample but the first and the last.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds, increasing.
    positions : float64 array, shape (n, d)
        Metres.
    min_interval : float
        Seconds; shorter steps count as this long.

    Returns
    -------
    float64 array, shape (n - 2,)
        Metres per second.
    """
    speeds = _speeds(times, positions, 1, min_interval)
    minima: NDArray[np.float64] = np.minimum(
        np.minimum(speeds[:-1], speeds[1:]), _speeds(times, positions, 2, min_interval)
    )
    return minima


def mark_outliers(
    times: NDArray[np.float64], positions: NDArray[np.float64], min_interval: float, limit: float
) -> NDArray[np.bool_]:
    """Mark samples that are outliers, given the speed above which a step is a jump.

    Parameters
    ----------
    times, positions, min_interval
        As for :func:`min_adjacent_speeds`.
    limit : float
        Metres per second.

    Returns
    -------
    bool array, shape (n,)
    """
    is_outlier = np.zeros(len(times), dtype=np.bool_)
    is_jump = _speeds(times, positions, 1, min_interval) > limit

    # Shorter runs first; a longer run may not start or end beside an outlier.
    for run in range(1, min(_MAX_OUTLIER_RUN, len(times) - 2) + 1):
        is_plausible = _speeds(times, positions, run + 1, min_interval) <= limit
        # Sample i + 1 begins a run if steps i and i + run are jumps, and the step over it is none.
        starts = np.flatnonzero(is_jump[: len(is_plausible)] & is_jump[run:] & is_plausible) + 1
        starts = starts[~is_outlier[starts - 1] & ~is_outlier[(starts + run)]]
        for offset in range(run):
            is_outlier[starts + offset] = True
    return is_outlier


def _speeds(
    times: NDArray[np.float64], positions: NDArray[np.float64], step: int, min_interval: float
) -> NDArray[np.float64]:
    """Return the speeds from each sample to the one ``step`` samples later."""
    difference = positions[step:] - positions[:-step]
    speeds: NDArray[np.float64] = np.sqrt((difference * difference).sum(axis=1)) / np.maximum(
        times[step:] - times[:-step], min_interval
    )
    return speeds
