"""Distances of samples from segments at their own times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit_uncounted

__all__ = ["sample_distances"]


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
