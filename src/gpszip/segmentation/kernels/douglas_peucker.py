"""Best-first Douglas-Peucker with the synchronised distance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import inner_uncounted, jit

__all__ = ["douglas_peucker"]


@inner_uncounted
def _farthest(t: NDArray[np.float64], p: NDArray[np.float64], i: int, j: int) -> tuple[float, int]:
    """Return squared distance and index of the sample farthest from the chord from i to j.

    The synchronised distance is taken at the sample's own time:
    ``|p_i + u (p_j - p_i) - p_h|`` with ``u = (t_h - t_i) / (t_j - t_i)``.
    """
    farthest, max_square = (i + j) // 2, 0.0
    inverse = 1.0 / (t[j] - t[i]) if t[j] > t[i] else 0.0
    for h in range(i + 1, j):
        u = (t[h] - t[i]) * inverse
        square = 0.0
        for c in range(p.shape[1]):
            r = p[i, c] + u * (p[j, c] - p[i, c]) - p[h, c]
            square += r * r
        if square > max_square:
            farthest, max_square = h, square
    return max_square, farthest


@jit
def douglas_peucker(t: NDArray[np.float64], p: NDArray[np.float64], k: int) -> NDArray[np.int64]:
    """Split the chord with the farthest sample until there are k intervals.

    Parameters
    ----------
    t : float64 array, shape (n,)
        Times.
    p : float64 array, shape (n, d)
        Positions.
    k : int
        Number of intervals, 1 <= k <= n.

    Returns
    -------
    int64 array, shape (k + 1,)
        Boundaries, in no order. The sample of a split starts the interval after it.
    """
    # The entire track is the first interval.
    n = len(t)
    boundaries = np.empty(k + 1, np.int64)
    boundaries[0], boundaries[k] = 0, n
    intervals = 1

    # Heap of chords by falling distance: end points, and the sample at which to split.
    capacity = 2 * k + 2
    keys, items = np.empty(capacity), np.empty(capacity, np.int64)
    left, right = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    split = np.empty(capacity, np.int64)
    size, entries = 0, 0
    if n > 2:
        max_square, farthest = _farthest(t, p, 0, n - 1)
        left[0], right[0], split[0], entries = 0, n - 1, farthest, 1
        size = push(keys, items, size, -max_square, 0)

    # Split at the farthest sample until there are k intervals.
    while intervals < k:
        # With k = n, no chord is left, and the last sample gets an interval of its own.
        if size == 0:
            boundaries[intervals] = n - 1
            intervals += 1
            continue

        # Split the chord with the farthest sample.
        entry, size = pop(keys, items, size)
        middle = split[entry]
        boundaries[intervals] = middle
        intervals += 1

        # Push both halves that have samples inside.
        for side in range(2):
            i, j = (left[entry], middle) if side == 0 else (middle, right[entry])
            if j - i < 2:
                continue
            max_square, farthest = _farthest(t, p, i, j)
            left[entries], right[entries], split[entries] = i, j, farthest
            size = push(keys, items, size, -max_square, entries)
            entries += 1
    return boundaries
