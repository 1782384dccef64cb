"""Cheapest ways between pairs of places on a graph, each within an ellipse about its ends."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import jit

__all__ = ["cheapest_paths"]


@jit
def _ensure_capacity(values: NDArray[Any], size: int) -> NDArray[Any]:
    # Twice the room where none is left.
    if size < len(values):
        return values
    larger = np.empty(2 * len(values), values.dtype)
    larger[:size] = values[:size]
    return larger


@jit
def _distance(places: NDArray[np.float64], one: int, other: int) -> float:
    return np.sqrt(
        (places[one, 0] - places[other, 0]) ** 2 + (places[one, 1] - places[other, 1]) ** 2
    )


@jit
def _in_corridor(
    places: NDArray[np.float64], place: int, start: int, end: int, far: float, wide: float
) -> bool:
    x, y = places[place, 0] - places[start, 0], places[place, 1] - places[start, 1]
    along, up = places[end, 0] - places[start, 0], places[end, 1] - places[start, 1]
    length = along**2 + up**2
    share = min(max((x * along + y * up) / length, 0.0), 1.0) if length > 0 else 0.0
    if (x - share * along) ** 2 + (y - share * up) ** 2 > wide**2:
        return False
    return _distance(places, place, start) + _distance(places, place, end) <= far


@jit
def cheapest_paths(
    places: NDArray[np.float64],
    near: NDArray[np.int32],
    price: NDArray[np.float64],
    starts: NDArray[np.int32],
    ends: NDArray[np.int32],
    far: NDArray[np.float64],
    wide: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Offsets and places of the routes; empty where there is none.

    A step costs its length times the mean price of both its places. Route i stays where the distances to both its ends add up
    to at most ``far[i]``, and within ``wide[i]`` of the straight line between them. Neighbours of a place end with -1.
    """
    cost = np.empty(len(places))
    seen, done = np.full(len(places), -1, np.int32), np.full(len(places), -1, np.int32)
    before = np.empty(len(places), np.int32)
    keys, items = np.empty(1024), np.empty(1024, np.int32)
    offsets, out, total = np.zeros(len(starts) + 1, np.int64), np.empty(1024, np.int32), 0
    for i in range(len(starts)):
        start, end = starts[i], ends[i]
        size = push(keys, items, 0, 0.0, start)
        cost[start], seen[start] = 0.0, i
        while size > 0:
            place, size = pop(keys, items, size)
            if done[place] == i:
                continue
            done[place] = i
            if place == end:
                break
            for k in range(near.shape[1]):
                other = near[place, k]
                if (
                    other < 0
                    or done[other] == i
                    or not _in_corridor(places, other, start, end, far[i], wide[i])
                ):
                    continue
                reached = cost[place] + _distance(places, place, other) * 0.5 * (
                    price[place] + price[other]
                )
                if seen[other] != i or reached < cost[other]:
                    seen[other], cost[other], before[other] = i, reached, place
                    keys, items = _ensure_capacity(keys, size), _ensure_capacity(items, size)
                    size = push(keys, items, size, reached, other)
        if done[end] == i:
            first, place = total, end
            while True:
                out = _ensure_capacity(out, total)
                out[total] = place
                total += 1
                if place == start:
                    break
                place = before[place]
            out[first:total] = out[first:total][::-1].copy()
        offsets[i + 1] = total
    return offsets, out[:total].copy()
