"""Where walks are at the times of samples, sample by sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["interpolate_positions", "sample_distances"]


@jit
def interpolate_positions(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    gaps: NDArray[np.bool_],
    when: NDArray[np.float64],
    slack: float,
    out: NDArray[np.float64],
) -> None:
    """Fill in where a walk is at instants in any order; NaN where it claims no travel.

    Parameters
    ----------
    times, places : float64 arrays, shape (k,) and (k, d)
        The walk's knots.
    gaps : bool array, shape (k - 1,)
        Parts in which no travel is claimed.
    when : float64 array, shape (n,)
        The instants.
    slack : float
        The nearest knot counts outside of a piece, up to so far from it in time.
    out : float64 array, shape (n, d)
        Changed in place.
    """
    last = len(times) - 1
    after = 0
    for i in range(len(when)):
        t = when[i]
        after = _count_until(times, t, after)
        left, right = max(after - 1, 0), min(after, last)
        if after == 0 or after > last or gaps[left]:
            before, beyond = abs(t - times[left]), abs(t - times[right])
            nearest = left if before <= beyond else right
            for axis in range(places.shape[1]):
                out[i, axis] = places[nearest, axis] if min(before, beyond) <= slack else np.nan
            continue
        span = times[right] - times[left]
        share = (t - times[left]) / (span if span > 0.0 else 1.0)
        for axis in range(places.shape[1]):
            out[i, axis] = (1.0 - share) * places[left, axis] + share * places[right, axis]


@jit
def _count_until(times: NDArray[np.float64], t: float, guess: int) -> int:
    """Number of times up to t, where ``guess`` or the next one is likely."""
    for near in range(guess, min(guess + 2, len(times))):
        if near > 0 and times[near - 1] <= t < times[near]:
            return near
    low, high = 0, len(times)
    while low < high:
        middle = (low + high) // 2
        if t < times[middle]:
            high = middle
        else:
            low = middle + 1
    return low


@jit
def sample_distances(
    froms: NDArray[np.int64],
    tos: NDArray[np.int64],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    cells: NDArray[np.int64],
    before: NDArray[np.int64],
    times: NDArray[np.float64],
    spots: NDArray[np.float64],
    distances: NDArray[np.float64],
    part: NDArray[np.int64],
) -> None:
    """Fill in the distance of each sample from its part at its own time, and the number of that part.

    Parameters
    ----------
    froms, tos : int64 arrays, shape (k,)
        First and last slot of each part.
    starts, ends : float64 arrays, shape (k, d)
        Where the parts begin and end.
    time_steps, before : int64 arrays, shape (S,)
        Time of each slot, and the number of samples before it.
    times, spots : float64 arrays, shape (n,) and (n, d)
        The samples.
    distances, part : arrays, shape (n,)
        Changed in place.
    """
    for j in range(len(froms)):
        begin, span = cells[froms[j]], np.float64(cells[tos[j]] - cells[froms[j]])
        for i in range(before[froms[j]], before[tos[j]]):
            share = (times[i] - begin) / span
            square = 0.0
            for axis in range(spots.shape[1]):
                away = (1.0 - share) * starts[j, axis] + share * ends[j, axis] - spots[i, axis]
                square += away * away
            distances[i], part[i] = np.sqrt(square), j
