"""The samples that a maximum error depends on most: those farthest out between two slots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["mark_extreme_samples"]


@jit
def mark_extreme_samples(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    ends: NDArray[np.int64],
    directions: NDArray[np.float64],
    few: int,
    is_extreme: NDArray[np.bool_],
) -> None:
    """Mark the samples that lie farthest out between each two slots.

    Of the samples between two slots, these are the first and the last one, and in each direction u
    those with the least and the largest u.e, where e is the offset of a sample from the straight
    line between the first and the last one at the sample's time.

    Parameters
    ----------
    times, positions : float64 arrays, shape (n,) and (n, d)
        The samples in order of time.
    ends : int64 array, shape (S,)
        Number of samples before each slot.
    directions : float64 array, shape (m, d)
        Unit vectors.
    few : int
        So many samples between two slots are marked all.
    is_extreme : bool array, shape (n,)
        Receives the marks: set to True where a sample is marked.
    """
    fan, dimension = directions.shape
    offset, least, most = np.empty(dimension), np.empty(fan), np.empty(fan)
    lowest, highest = np.empty(fan, np.int64), np.empty(fan, np.int64)
    for slot in range(len(ends) - 1):
        # Few samples are all marked.
        first, last = ends[slot], ends[slot + 1] - 1
        if last - first < few:
            is_extreme[first : last + 1] = True
            continue

        # The straight line passes through the first and the last sample, which are at 0.
        duration = times[last] - times[first]
        rate = 1.0 / duration if duration > 0.0 else 0.0
        for m in range(fan):
            least[m], most[m], lowest[m], highest[m] = 0.0, 0.0, first, last

        # Find the extremes along each direction.
        for i in range(first, last):
            share = (times[i] - times[first]) * rate
            for axis in range(dimension):
                start = positions[first, axis]
                offset[axis] = positions[i, axis] - start - share * (positions[last, axis] - start)
            for m in range(fan):
                along = 0.0
                for axis in range(dimension):
                    along += directions[m, axis] * offset[axis]
                if along < least[m]:
                    least[m], lowest[m] = along, i
                if along > most[m]:
                    most[m], highest[m] = along, i

        # Mark them.
        is_extreme[first] = is_extreme[last] = True
        for m in range(fan):
            is_extreme[lowest[m]] = is_extreme[highest[m]] = True
