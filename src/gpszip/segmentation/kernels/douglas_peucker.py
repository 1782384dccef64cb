"""Best-first Douglas-Peucker with the synchronised distance: always split where a sample is farthest off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import jit

__all__ = ["douglas_peucker"]


@jit
def _farthest(t: NDArray[np.float64], p: NDArray[np.float64], i: int, j: int) -> tuple[float, int]:
    """Squared distance and index of the sample between i and j that is farthest from the line i to j at its own time."""
    at, worst = (i + j) // 2, 0.0
    inverse = 1.0 / (t[j] - t[i]) if t[j] > t[i] else 0.0
    for h in range(i + 1, j):
        u = (t[h] - t[i]) * inverse
        distance = 0.0
        for c in range(p.shape[1]):
            r = p[i, c] + u * (p[j, c] - p[i, c]) - p[h, c]
            distance += r * r
        if distance > worst:
            at, worst = h, distance
    return worst, at


@jit
def douglas_peucker(t: NDArray[np.float64], p: NDArray[np.float64], k: int) -> NDArray[np.int64]:
    """Return the k + 1 boundaries of k parts; a split sample begins the part after it."""
    n = len(t)
    keys, items = np.empty(2 * k + 2), np.empty(2 * k + 2, np.int64)
    left, right, split = (
        np.empty(2 * k + 2, np.int64),
        np.empty(2 * k + 2, np.int64),
        np.empty(2 * k + 2, np.int64),
    )
    boundaries = np.empty(k + 1, np.int64)
    boundaries[0], boundaries[k] = 0, n
    parts, size, entries = 1, 0, 0
    if n > 2:
        worst, at = _farthest(t, p, 0, n - 1)
        left[0], right[0], split[0], entries = 0, n - 1, at, 1
        size = push(keys, items, size, -worst, 0)
    while parts < k:
        if size == 0:  # every sample but the last begins a part already
            boundaries[parts] = n - 1
            parts += 1
            continue
        entry, size = pop(keys, items, size)
        at = split[entry]
        boundaries[parts] = at
        parts += 1
        for side in range(2):
            i, j = (left[entry], at) if side == 0 else (at, right[entry])
            if j - i < 2:
                continue
            worst, middle = _farthest(t, p, i, j)
            left[entries], right[entries], split[entries] = i, j, middle
            size = push(keys, items, size, -worst, entries)
            entries += 1
    boundaries.sort()
    return boundaries
