"""Lines without the vertices that they don't need for their shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["simplify_lines"]


@jit
def _distance_to_segment(
    point: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> float:
    along = dot = square = 0.0
    for c in range(len(point)):
        along += (end[c] - start[c]) ** 2
        dot += (end[c] - start[c]) * (point[c] - start[c])
    share = min(max(dot / along, 0.0), 1.0) if along > 0 else 0.0
    for c in range(len(point)):
        square += (start[c] + share * (end[c] - start[c]) - point[c]) ** 2
    return np.sqrt(square)


@jit
def simplify_lines(
    places: NDArray[np.float64], offsets: NDArray[np.int64], tolerance: float
) -> NDArray[np.bool_]:
    """Which vertices of the lines ``places[offsets[i]:offsets[i + 1]]`` Douglas and Peucker keep; their ends always."""
    kept = np.zeros(len(places), np.bool_)
    todo = np.empty((len(places) + 1, 2), np.int64)
    for line in range(len(offsets) - 1):
        kept[offsets[line]] = kept[offsets[line + 1] - 1] = True
        todo[0] = offsets[line], offsets[line + 1] - 1
        size = 1
        while size:
            size -= 1
            first, last = todo[size]
            worst, at = tolerance, -1
            for i in range(first + 1, last):
                away = _distance_to_segment(places[i], places[first], places[last])
                if away > worst:
                    worst, at = away, i
            if at >= 0:
                kept[at] = True
                todo[size] = first, at
                todo[size + 1] = at, last
                size += 2
    return kept
