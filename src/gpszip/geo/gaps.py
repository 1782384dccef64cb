"""Gaps: intervals between samples that are so long that the path in between is unknown."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.geo.planes import plane_changes
from gpszip.geo.steps import group_medians, steps_between
from gpszip.model import Track

__all__ = [
    "estimate_gap",
    "find_gaps",
    "find_gaps_of_all",
    "find_long_intervals",
    "piece_time_ranges",
]

#: Seconds; no shorter interval is a gap, as a robot or a car can be followed through it.
_MIN_GAP = 10.0

#: A track needs this many intervals for its own median to count.
_MIN_INTERVALS = 20


def estimate_gap(tracks: Sequence[Track]) -> float:
    """Estimate the length of a gap from the log's own sampling.

    With the median and the 95th percentile of all intervals it is

        ``max(10 s, 30 * median, min(5 * percentile, 60 * median))``

    In a regular log, thirty missed samples are a gap; in an irregular log it takes more of them.
    The cap of 60 medians is for logs of short bursts, whose 95th percentile is a pause itself. No
    gap is shorter than ten median intervals of any track, so that the tracks of slow vehicles in
    a mixed fleet are not broken up.

    Parameters
    ----------
    tracks : sequence of Track
        The log.

    Returns
    -------
    float
        Seconds, whole milliseconds; infinite if no interval of the log is longer, or there is no
        interval.

    Examples
    --------
    >>> regular = Track("a", range(100), [[t, 0.0] for t in range(100)])
    >>> pause = Track("b", [0, 1, 2, 3, 500], [[0.0, 0.0]] * 5)
    >>> estimate_gap([regular]), estimate_gap([regular, pause])
    (inf, 30.0)
    """
    # Intervals of all tracks in whole milliseconds.
    times = [track.times for track in tracks if len(track) > 1]
    if not times:
        return float("inf")
    pooled = _milliseconds(steps_between(times))

    # Statistics of all intervals, and of the slowest track.
    median, percentile = np.quantile(pooled, [0.5, 0.95])
    counts = np.array([len(of_track) - 1 for of_track in times])
    has_median = counts >= _MIN_INTERVALS
    long = pooled[np.repeat(has_median, counts)]
    slowest_median = float(group_medians(long, counts[has_median].tolist()).max(initial=0.0))

    # Apply the rule in milliseconds; a log whose longest interval is within it has no gap.
    gap = round(
        max(
            1000 * _MIN_GAP,
            30 * median,
            10 * slowest_median,
            min(5 * percentile, 60 * median),
        )
    )
    return gap / 1000 if pooled.max() > gap else float("inf")


def find_long_intervals(times: ArrayLike, gap: float) -> NDArray[np.bool_]:
    """Find intervals longer than a gap.

    Intervals are compared in whole milliseconds, so that the result doesn't depend on the origin
    of the times.

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
    intervals = np.diff(np.asarray(times, dtype=np.float64))
    is_longer: NDArray[np.bool_] = _milliseconds(intervals) > np.rint(gap * 1000)
    return is_longer


def find_gaps(track: Track, gap: float) -> NDArray[np.bool_]:
    """Find the steps of a track without a known path: long intervals and changes of plane.

    A shape has no intervals of time.

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
    # The distance between two planes is that of their shifts, not one that was travelled.
    longest = gap if track.timed else math.inf
    gaps: NDArray[np.bool_] = find_long_intervals(track.times, longest) | plane_changes(
        track.positions, track.plane
    )
    return gaps


def find_gaps_of_all(tracks: Sequence[Track], gap: float) -> list[NDArray[np.bool_]]:
    """Find the gaps of each track as :func:`find_gaps` does, those without times at no interval.

    Parameters
    ----------
    tracks : sequence of Track
        All on one plane.
    gap : float
        Seconds, may be infinite.

    Examples
    --------
    >>> track, shape = Track("a", [0, 90], [[0.0], [5.0]]), Track("b", [0], [[0.0]], timed=False)
    >>> [gaps.tolist() for gaps in find_gaps_of_all([track, shape], 30.0)]
    [[True], []]
    """
    # A plane that lies in one piece has no changes: then times are enough.
    if not all(track.plane is None or len(track.plane.centers) == 1 for track in tracks):
        return [find_gaps(track, gap) for track in tracks]
    is_long = _milliseconds(steps_between([track.times for track in tracks])) > np.rint(gap * 1000)

    # Cut them where a track begins; the "times" of a shape are lengths.
    gaps, end = [], 0
    for track in tracks:
        first, end = end, end + len(track) - 1
        gaps.append(is_long[first:end] if track.timed else np.zeros(end - first, np.bool_))
    return gaps


def piece_time_ranges(times: NDArray[np.float64], gaps: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the times of the first and the last sample of each gap-free piece.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds.
    gaps : bool array, shape (n - 1,)
        Steps that are gaps.

    Returns
    -------
    float64 array, shape (gaps + 1, 2)

    Examples
    --------
    >>> piece_time_ranges(np.array([0.0, 1.0, 90.0]), np.array([False, True])).tolist()
    [[0.0, 1.0], [90.0, 90.0]]
    """
    if not gaps.any():
        return times[[0, -1]].reshape(1, 2)
    return np.stack([times[np.append(True, gaps)], times[np.append(gaps, True)]], axis=1)


def _milliseconds(intervals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return intervals in seconds as whole milliseconds."""
    rounded: NDArray[np.float64] = np.rint(intervals * 1000)
    return rounded
