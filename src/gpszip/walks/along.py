"""Positions along walks at given times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["interpolate_between", "interpolate_positions"]


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
    # The knots around each time.
    after = np.searchsorted(knot_times, times, side="right")
    left, right = np.maximum(after - 1, 0), np.minimum(after, len(knot_times) - 1)
    return interpolate_between(
        knot_times, knot_positions, np.append(gaps, True), left, right, times, slack
    )


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
    since, duration = times - knot_times[left], knot_times[right] - knot_times[left]
    before, since[off] = np.abs(since[off]), 0.0
    fraction = (since / np.where(duration > 0, duration, 1.0))[:, None]
    positions = (1.0 - fraction) * knot_positions[left] + fraction * knot_positions[right]

    # Elsewhere the nearest knot, within the slack.
    until = np.abs(times[off] - knot_times[right[off]])
    is_near = np.minimum(before, until) <= slack
    nearest = np.where(before <= until, left[off], right[off])
    positions[off] = np.where(is_near[:, None], knot_positions[nearest], np.nan)
    return positions
