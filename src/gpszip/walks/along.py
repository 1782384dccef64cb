"""Positions along walks at given times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["interpolate_between", "interpolate_positions"]

#: Times whose positions are computed at a time, which fit into a processor's cache.
_BLOCK = 8192

#: Times below which one binary search for each is fastest.
_MIN_TIMES = 1000

#: Buckets of equal duration for each knot: with more, fewer of them hold a knot.
_BUCKETS_PER_KNOT = 8


def interpolate_positions(
    knot_times: NDArray[np.float64],
    knot_positions: NDArray[np.float64],
    gaps: NDArray[np.bool_],
    times: NDArray[np.float64],
    slack: float,
) -> NDArray[np.float64]:
    """Positions of a walk at given times; NaN where it claims no travel.

    Between the knots i and i + 1 at times t_i and t_{i+1}, the position at time t is
    (1 - f) p_i + f p_{i+1} with f = (t - t_i) / (t_{i+1} - t_i).

    Parameters
    ----------
    knot_times, knot_positions : float64 arrays, shape (k,) and (k, d)
        Knots of the walk.
    gaps : bool array, shape (k - 1,)
        Whether each segment is a gap.
    times : float64 array, shape (n,)
        Times in any order.
    slack : float
        Outside of a piece, its nearest knot counts up to this many seconds from it.

    Returns
    -------
    float64 array, shape (n, d)

    Examples
    --------
    >>> knots = np.array([0.0, 10.0]), np.array([[0.0], [5.0]])
    >>> interpolate_positions(*knots, np.array([False]), np.array([4.0, 11.0]), 0.001).tolist()
    [[2.0], [nan]]
    """
    # Block by block, which fits into a processor's cache.
    after = _count_knots_before(knot_times, times)
    gap_after = np.ones(len(knot_times), np.bool_)
    gap_after[:-1] = gaps
    positions = np.empty((len(times), knot_positions.shape[1]))
    for first in range(0, len(times), _BLOCK):
        # The knots around each time.
        block = slice(first, first + _BLOCK)
        left = np.maximum(after[block] - 1, 0)
        right = np.minimum(after[block], len(knot_times) - 1)
        positions[block] = interpolate_between(
            knot_times, knot_positions, gap_after, left, right, times[block], slack
        )
    return positions


def interpolate_between(
    knot_times: NDArray[np.float64],
    knot_positions: NDArray[np.float64],
    gap_after: NDArray[np.bool_],
    left: NDArray[np.intp],
    right: NDArray[np.intp],
    times: NDArray[np.float64],
    slack: float,
) -> NDArray[np.float64]:
    """Positions between given knots, as :func:`interpolate_positions` computes them.

    Parameters
    ----------
    knot_times, knot_positions : float64 arrays, shape (k,) and (k, d)
        Knots of one walk, or of several.
    gap_after : bool array, shape (k,)
        Whether no travel is claimed from each knot to the next.
    left, right : int arrays, shape (n,)
        Knots before and after each time; the same knot where the walk has only one of them.
    times : float64 array, shape (n,)
        Times in any order.
    slack : float
        As for :func:`interpolate_positions`.

    Returns
    -------
    float64 array, shape (n, d)
    """
    # Before, after and in gaps there is no segment.
    off = np.flatnonzero((left == right) | gap_after[left])

    # On a segment.
    start = knot_times[left]
    since, duration = times - start, knot_times[right] - start
    before, since[off] = np.abs(since[off]), 0.0
    fraction = since / np.where(duration > 0, duration, 1.0)
    rest = 1.0 - fraction
    positions = np.empty((len(times), knot_positions.shape[1]))
    for axis in range(knot_positions.shape[1]):
        of_knots = np.ascontiguousarray(knot_positions[:, axis])
        positions[:, axis] = rest * of_knots[left] + fraction * of_knots[right]

    # Elsewhere the nearest knot, within the slack.
    if len(off):
        until = np.abs(times[off] - knot_times[right[off]])
        is_near = np.minimum(before, until) <= slack
        nearest = np.where(before <= until, left[off], right[off])
        positions[off] = np.where(is_near[:, None], knot_positions[nearest], np.nan)
    return positions


def _count_knots_before(
    knot_times: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.intp]:
    """Number of knots at or before each time.

    Examples
    --------
    >>> _count_knots_before(np.array([0.0, 10.0]), np.array([-1.0, 0.0, 12.0])).tolist()
    [0, 1, 2]
    """
    # Few times.
    count = len(knot_times)
    if len(times) < _MIN_TIMES or len(times) < count:
        return np.searchsorted(knot_times, times, side="right")

    # Times in order: find the knots among the times, of which there are more.
    if (times[1:] >= times[:-1]).all():
        first = np.searchsorted(times, knot_times)
        repeats = np.diff(first, prepend=0, append=len(times))
        return np.repeat(np.arange(count + 1), repeats)

    # In any order: count the knots up to the beginning of a time's bucket. In most buckets there
    # is no knot between that and the time; a search finds the others.
    begin, duration = knot_times[0], knot_times[-1] - knot_times[0]
    buckets = _BUCKETS_PER_KNOT * count
    if not duration > 0:
        return np.searchsorted(knot_times, times, side="right")
    until = np.searchsorted(knot_times, begin + np.arange(buckets) * (duration / buckets))
    with np.errstate(invalid="ignore"):
        bucket = ((times - begin) * (buckets / duration)).astype(np.intp)
    after: NDArray[np.intp] = until[np.clip(bucket, 0, buckets - 1)]
    padded = np.concatenate([[-np.inf], knot_times, [np.inf]])
    wrong = np.flatnonzero(~((padded[after] <= times) & (times < padded[after + 1])))
    after[wrong] = np.searchsorted(knot_times, times[wrong], side="right")
    return after
