"""Steps between successive samples of many tracks, in arrays that hold those of all tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["group_medians", "steps_between"]

#: Values of a group from which on its median is found by itself, by partition: sorting a million
#: values takes ten times as long. In shorter groups, calls for each would take most of the time.
_LONG_GROUP = 1000

Floats = NDArray[np.float64]


def steps_between(values: Sequence[Floats]) -> Floats:
    """Return the differences of successive rows within each array.

    Parameters
    ----------
    values : sequence of float64 array, shape (n_i, ...)
        For each track, n_i >= 1 times or positions.

    Returns
    -------
    float64 array, shape (sum of n_i - 1, ...)
        Track after track.

    Examples
    --------
    >>> steps_between([np.array([1.0, 3.0, 4.0]), np.array([9.0]), np.array([0.0, 5.0])]).tolist()
    [2.0, 1.0, 5.0]
    """
    # Without the steps from one track to the next.
    if len(values) == 1:
        return np.diff(values[0], axis=0)
    within = np.ones(sum(map(len, values)), np.bool_)
    within[np.cumsum([len(of_track) for of_track in values]) - 1] = False
    return np.diff(np.concatenate(values), axis=0)[within[:-1]]


def group_medians(values: Floats, counts: Sequence[int]) -> Floats:
    """Return the median of each group of successive values.

    Parameters
    ----------
    values : float64 array, shape (n,)
        Group after group.
    counts : sequence of int, length g
        Values of each group, at least 1; n in all.

    Returns
    -------
    float64 array, shape (g,)

    Examples
    --------
    >>> group_medians(np.array([3.0, 1.0, 2.0, 7.0, 8.0]), [3, 2]).tolist()
    [2.0, 7.5]
    """
    # Few long groups.
    sizes = np.asarray(counts, np.int64)
    ends = np.cumsum(sizes)
    if len(values) >= _LONG_GROUP * len(sizes):
        groups = zip((ends - sizes).tolist(), ends.tolist(), strict=True)
        return np.array([np.median(values[first:end]) for first, end in groups])

    # Sort within all groups at once, and take the values in the middle of each.
    order = np.lexsort((values, np.repeat(np.arange(len(sizes)), sizes)))
    ranked = values[order]
    first = ends - sizes
    medians: Floats = (ranked[first + (sizes - 1) // 2] + ranked[first + sizes // 2]) / 2
    return medians
