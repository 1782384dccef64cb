"""The samples farthest out between two slots, by NumPy."""

import numpy as np


def find_extreme_samples(times, positions, ends, directions, few):
    """Marks of the samples: see :func:`gpszip.mapping.kernels.extreme_samples`."""
    is_extreme = np.zeros(len(times), bool)
    for first, after in zip(ends[:-1], ends[1:], strict=True):
        inside = slice(first, after)
        if after - first <= few:
            is_extreme[inside] = True
            continue
        line = [
            np.interp(times[inside], times[[first, after - 1]], axis)
            for axis in positions[[first, after - 1]].T
        ]
        along = (positions[inside] - np.stack(line, axis=1)) @ directions.T
        is_extreme[first + along.argmin(axis=0)] = True
        is_extreme[first + along.argmax(axis=0)] = True
        is_extreme[[first, after - 1]] = True
    return is_extreme
