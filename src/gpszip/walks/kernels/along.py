"""Interpolation along walks at the times of samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit_uncounted

__all__ = ["interpolate_positions", "sample_distances"]


@jit_uncounted
def interpolate_positions(
    knot_times: NDArray[np.float64],
    knot_positions: NDArray[np.float64],
    gaps: NDArray[np.bool_],
    times: NDArray[np.float64],
    slack: float,
    out: NDArray[np.float64],
) -> None:
    """Write the positions of a walk at given times; NaN where it claims no travel.

    Between the knots i and i + 1 at times t_i and t_{i+1}, the position at time t is
    (1 - f) p_i + f p_{i+1} with f = (t - t_i) / (t_{i+1} - t_i).

    Parameters
    ----------
    knot_times, knot_positions : float64 arrays, shape (k,) and (k, d)
        Knots of the walk.
    gaps : bool array, shape (k - 1,)
        Whether each segment is a gap.
    times : float64 array, shape (n,)
        Query times in any order; fastest if they increase.
    slack : float
        Outside of a piece, its nearest knot counts up to this many seconds from it.
    out : float64 array, shape (n, d)
        Filled in.
    """
    # Find the knots around each query, at first where the last query was.
    last = len(knot_times) - 1
    after = 0
    for i in range(len(times)):
        t = times[i]
        after = _count_until(knot_times, t, after)
        left, right = max(after - 1, 0), min(after, last)

        # Before, after, or in a gap: the nearest knot within the slack.
        if after == 0 or after > last or gaps[left]:
            since, until = abs(t - knot_times[left]), abs(t - knot_times[right])
            nearest = left if since <= until else right
            for axis in range(knot_positions.shape[1]):
                out[i, axis] = (
                    knot_positions[nearest, axis] if min(since, until) <= slack else np.nan
                )
            continue

        # On a segment.
        duration = knot_times[right] - knot_times[left]
        fraction = (t - knot_times[left]) / (duration if duration > 0.0 else 1.0)
        for axis in range(knot_positions.shape[1]):
            weighted = (1.0 - fraction) * knot_positions[left, axis]
            out[i, axis] = weighted + fraction * knot_positions[right, axis]


@inner_uncounted
def _count_until(times: NDArray[np.float64], t: float, guess: int) -> int:
    """Number of times up to t; fast if it is ``guess`` or one more."""
    for count in range(guess, min(guess + 2, len(times))):
        if count > 0 and times[count - 1] <= t < times[count]:
            return count

    # Binary search.
    low, high = 0, len(times)
    while low < high:
        middle = (low + high) // 2
        if t < times[middle]:
            high = middle
        else:
            low = middle + 1
    return low


@jit_uncounted
def sample_distances(
    first_slots: NDArray[np.int64],
    last_slots: NDArray[np.int64],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    time_steps: NDArray[np.int64],
    samples_before: NDArray[np.int64],
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    distances: NDArray[np.float64],
    segment: NDArray[np.int64],
) -> None:
    """Write the distance of each sample from its segment at its own time, and that segment.

    Segments are given on a time grid of S slots.

    Parameters
    ----------
    first_slots, last_slots : int64 arrays, shape (k,)
        First and last slot of each segment.
    starts, ends : float64 arrays, shape (k, d)
        Positions at which the segments begin and end.
    time_steps, samples_before : int64 arrays, shape (S,)
        Time of each slot, and the number of samples before it.
    times, positions : float64 arrays, shape (n,) and (n, d)
        The samples, with times in time steps.
    distances, segment : arrays, shape (n,)
        Filled in.
    """
    for j in range(len(first_slots)):
        begin = time_steps[first_slots[j]]
        duration = np.float64(time_steps[last_slots[j]] - time_steps[first_slots[j]])
        for i in range(samples_before[first_slots[j]], samples_before[last_slots[j]]):
            # Interpolate the segment at the sample's time.
            fraction = (times[i] - begin) / duration
            square = 0.0
            for axis in range(positions.shape[1]):
                difference = (
                    (1.0 - fraction) * starts[j, axis]
                    + fraction * ends[j, axis]
                    - positions[i, axis]
                )
                square += difference * difference
            distances[i], segment[i] = np.sqrt(square), j
