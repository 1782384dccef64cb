"""Line simplification by Douglas and Peucker."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit

__all__ = ["simplify_lines"]


@inner_uncounted
def _distance_to_segment(
    point: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> float:
    """Distance between a point and the line segment from start to end."""
    # Project the point onto the segment.
    length_square = dot = square = 0.0
    for c in range(len(point)):
        length_square += (end[c] - start[c]) ** 2
        dot += (end[c] - start[c]) * (point[c] - start[c])
    fraction = min(max(dot / length_square, 0.0), 1.0) if length_square > 0 else 0.0

    for c in range(len(point)):
        square += (start[c] + fraction * (end[c] - start[c]) - point[c]) ** 2
    return np.sqrt(square)


@jit
def simplify_lines(
    positions: NDArray[np.float64], offsets: NDArray[np.int64], tolerance: float
) -> NDArray[np.bool_]:
    """Mark the vertices that the algorithm of Douglas and Peucker (1973) keeps.

    Parameters
    ----------
    positions : float64 array, shape (n, d)
        Vertices; line i consists of ``positions[offsets[i]:offsets[i + 1]]``.
    offsets : int64 array, shape (m + 1,)
        Where the lines begin and end.
    tolerance : float
        Largest distance between a dropped vertex and the simplified line.

    Returns
    -------
    bool array, shape (n,)
        True for vertices to keep, the ends of lines always among them.
    """
    # Segments still to check, each by its first and last vertex.
    kept = np.zeros(len(positions), np.bool_)
    stack = np.empty((len(positions) + 1, 2), np.int64)
    for line in range(len(offsets) - 1):
        # Start with the segment between the ends of the line.
        kept[offsets[line]] = kept[offsets[line + 1] - 1] = True
        stack[0, 0], stack[0, 1] = offsets[line], offsets[line + 1] - 1
        size = 1

        # Split segments until every vertex between is within the tolerance.
        while size:
            # Find the vertex farthest from the segment.
            size -= 1
            first, last = stack[size, 0], stack[size, 1]
            largest, farthest = tolerance, -1
            for i in range(first + 1, last):
                distance = _distance_to_segment(positions[i], positions[first], positions[last])
                if distance > largest:
                    largest, farthest = distance, i

            # Split the segment there.
            if farthest >= 0:
                kept[farthest] = True
                stack[size, 0], stack[size, 1] = first, farthest
                stack[size + 1, 0], stack[size + 1, 1] = farthest, last
                size += 2
    return kept
