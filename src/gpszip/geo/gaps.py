"""Gaps: intervals so long that nothing is known of the way between their ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.geo.planes import plane_changes
from gpszip.model import Track

__all__ = ["estimate_gap", "find_gaps", "find_long_intervals"]

#: No shorter interval is a gap: a robot or a car can be followed through it.
_MIN_GAP = 10.0

#: A track needs this many intervals for its own rhythm to count.
_MIN_INTERVALS = 20


def estimate_gap(tracks: Sequence[Track]) -> float:
    """Length of interval above which a log has a gap, from the log's own sampling.

    With the median and the 95th percentile of all intervals it is

        ``max(10 s, 30 * median, min(5 * percentile, 60 * median))``

    so that thirty missed samples are a gap where the log is regular, and more of them where its rhythm varies; the cap
    keeps a log of short bursts, whose 95th percentile is a pause itself, from having none. No gap is shorter than ten usual
    intervals of any track, so that the slow vehicles of a mixed fleet stay whole.

    Parameters
    ----------
    tracks : sequence of Track
        The log.

    Returns
    -------
    float
        Seconds, whole milliseconds; infinite if no interval of the log is longer, or there is none.

    Examples
    --------
    >>> regular = Track("a", range(100), [[t, 0.0] for t in range(100)])
    >>> pause = Track("b", [0, 1, 2, 3, 500], [[0.0, 0.0]] * 5)
    >>> estimate_gap([regular]), estimate_gap([regular, pause])
    (inf, 30.0)
    """
    steps = [_milliseconds(track.times) for track in tracks if len(track) > 1]
    if not steps:
        return float("inf")
    pooled = np.concatenate(steps)
    median, high = np.quantile(pooled, [0.5, 0.95])
    usual = max((float(np.median(own)) for own in steps if len(own) >= _MIN_INTERVALS), default=0.0)
    gap = round(max(1000 * _MIN_GAP, 30 * median, 10 * usual, min(5 * high, 60 * median)))
    return gap / 1000 if pooled.max() > gap else float("inf")


def find_long_intervals(times: ArrayLike, gap: float) -> NDArray[np.bool_]:
    """Intervals longer than a gap.

    Times count in whole milliseconds, so that the answer doesn't hang on where a log's zero is.

    Parameters
    ----------
    times : array_like, shape (n,)
        Seconds, increasing.
    gap : float
        Seconds, may be infinite.

    Returns
    -------
    bool array, shape (n - 1,)

    Examples
    --------
    >>> find_long_intervals([0.0, 1.0, 31.0, 61.5], 30.0).tolist()
    [False, False, True]
    """
    longer: NDArray[np.bool_] = _milliseconds(np.asarray(times, dtype=np.float64)) > np.rint(
        gap * 1000
    )
    return longer


def find_gaps(track: Track, gap: float) -> NDArray[np.bool_]:
    """Steps of a track during which no travel is claimed: gaps, and steps from one plane to another.

    Parameters
    ----------
    track : Track
        The samples.
    gap : float
        Seconds, may be infinite.

    Returns
    -------
    bool array, shape (n - 1,)

    Examples
    --------
    >>> find_gaps(Track("a", [0, 1, 90], [[0.0], [5.0], [7.0]]), 30.0).tolist()
    [False, True]
    """
    silent: NDArray[np.bool_] = find_long_intervals(track.times, gap) | plane_changes(
        track.positions, track.plane
    )
    return silent


def piece_time_ranges(times: NDArray[np.float64], silent: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Times of the first and the last sample of each run between gaps.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds.
    silent : bool array, shape (n - 1,)
        Steps that are gaps.

    Returns
    -------
    float64 array, shape (gaps + 1, 2)

    Examples
    --------
    >>> piece_time_ranges(np.array([0.0, 1.0, 90.0]), np.array([False, True])).tolist()
    [[0.0, 1.0], [90.0, 90.0]]
    """
    return np.stack([times[np.append(True, silent)], times[np.append(silent, True)]], axis=1)


def _milliseconds(times: NDArray[np.float64]) -> NDArray[np.float64]:
    rounded: NDArray[np.float64] = np.rint(np.diff(times) * 1000)
    return rounded
