"""Cheapest paths between pairs of vertices, each within a corridor about its two ends."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.copying import copy_values
from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import inner, inner_uncounted, jit

__all__ = ["append_path", "cheapest_paths", "is_in_corridor"]

#: Initial capacity of growing arrays; they double when they are full.
_INITIAL_CAPACITY = 1024


@inner
def _ensure_capacity(values: NDArray[Any], size: int) -> NDArray[Any]:
    """The array, or a copy with twice its capacity if ``size`` entries fill it."""
    if size < len(values):
        return values
    larger = np.empty(2 * len(values), values.dtype)
    copy_values(values, larger[:size])
    return larger


@inner
def append_path(
    vertices: NDArray[np.int32], total: int, before: NDArray[np.int32], start: int, end: int
) -> tuple[NDArray[np.int32], int]:
    """Append the path that leads to the end, where ``before`` has each vertex's predecessor.

    Returns
    -------
    vertices : int32 array
        The array, or a larger copy.
    total : int
        Vertices of all paths so far.
    """
    # Go from the end back to the start.
    first, vertex = total, end
    while True:
        vertices = _ensure_capacity(vertices, total)
        vertices[total] = vertex
        total += 1
        if vertex == start:
            break
        vertex = before[vertex]

    # Reverse it.
    for i in range((total - first) // 2):
        j = total - 1 - i
        vertices[first + i], vertices[j] = vertices[j], vertices[first + i]
    return vertices, total


@inner_uncounted
def _distance(positions: NDArray[np.float64], a: int, b: int) -> float:
    return np.sqrt(
        (positions[a, 0] - positions[b, 0]) ** 2 + (positions[a, 1] - positions[b, 1]) ** 2
    )


@inner_uncounted
def is_in_corridor(
    positions: NDArray[np.float64],
    vertex: int,
    start: int,
    end: int,
    max_detour: float,
    max_offset: float,
) -> bool:
    """Whether a vertex lies in the ellipse about the ends and near the segment between them."""
    # Distance to the nearest point of the segment, at the fraction of its length.
    x = positions[vertex, 0] - positions[start, 0]
    y = positions[vertex, 1] - positions[start, 1]
    along = positions[end, 0] - positions[start, 0]
    up = positions[end, 1] - positions[start, 1]
    square = along**2 + up**2
    fraction = min(max((x * along + y * up) / square, 0.0), 1.0) if square > 0 else 0.0
    if (x - fraction * along) ** 2 + (y - fraction * up) ** 2 > max_offset**2:
        return False

    return _distance(positions, vertex, start) + _distance(positions, vertex, end) <= max_detour


@jit
def cheapest_paths(
    positions: NDArray[np.float64],
    neighbours: NDArray[np.int32],
    price: NDArray[np.float64],
    starts: NDArray[np.int32],
    ends: NDArray[np.int32],
    max_detour: NDArray[np.float64],
    max_offset: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Find the cheapest path of each pair by Dijkstra's search.

    A link from vertex a to vertex b costs ``|a - b| (price[a] + price[b]) / 2``.

    Parameters
    ----------
    positions : float64 array, shape (n, 2)
        Vertices in metres.
    neighbours : int32 array, shape (n, m)
        Neighbours of each vertex; -1 where there are fewer.
    price : float64 array, shape (n,)
        Cost of a metre at each vertex.
    starts, ends : int32 arrays, shape (p,)
        Vertices that the paths join.
    max_detour : float64 array, shape (p,)
        Largest sum of the distances from a vertex of the path to both ends, in metres.
    max_offset : float64 array, shape (p,)
        Largest distance of a vertex from the straight line between the ends, in metres.

    Returns
    -------
    offsets : int64 array, shape (p + 1,)
        Path i visits ``vertices[offsets[i]:offsets[i + 1]]``; empty where there is no path.
    vertices : int32 array
        Vertices of all paths, from start to end.
    """
    # Entries of a vertex are valid for path i if they are marked with i.
    cost = np.empty(len(positions))
    seen, done = np.full(len(positions), -1, np.int32), np.full(len(positions), -1, np.int32)
    before = np.empty(len(positions), np.int32)
    keys, items = np.empty(_INITIAL_CAPACITY), np.empty(_INITIAL_CAPACITY, np.int32)
    offsets = np.zeros(len(starts) + 1, np.int64)
    vertices = np.empty(_INITIAL_CAPACITY, np.int32)
    total = 0

    # Search for each pair anew, by cost from its start.
    for i in range(len(starts)):
        start, end = starts[i], ends[i]
        size = push(keys, items, 0, 0.0, start)
        cost[start], seen[start] = 0.0, i

        # Search until the end is reached or the corridor is exhausted.
        while size > 0:
            vertex, size = pop(keys, items, size)
            if done[vertex] == i:
                continue
            done[vertex] = i
            if vertex == end:
                break

            # Try the path through this vertex for each neighbour in the corridor.
            for k in range(neighbours.shape[1]):
                other = neighbours[vertex, k]
                if (
                    other < 0
                    or done[other] == i
                    or not is_in_corridor(
                        positions, other, start, end, max_detour[i], max_offset[i]
                    )
                ):
                    continue
                new_cost = cost[vertex] + _distance(positions, vertex, other) * 0.5 * (
                    price[vertex] + price[other]
                )
                if seen[other] != i or new_cost < cost[other]:
                    seen[other], cost[other], before[other] = i, new_cost, vertex
                    keys, items = _ensure_capacity(keys, size), _ensure_capacity(items, size)
                    size = push(keys, items, size, new_cost, other)

        # The path, if the end was reached.
        if done[end] == i:
            vertices, total = append_path(vertices, total, before, start, end)
        offsets[i + 1] = total
    return offsets, vertices[:total].copy()
