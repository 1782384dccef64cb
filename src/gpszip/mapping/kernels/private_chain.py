"""The cheapest chain of knots for one piece of a track on its own: exact dynamic programming over slots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.grid_moments import free_cost, line_cost, span_moments

__all__ = ["settle_chain", "settle_chains"]

#: A part that misses the best line by more than this many bits is never worth it.
_TOO_DEAR = 45.0


@jit
def settle_chain(
    sums: NDArray[np.int64],
    ticks: NDArray[np.int64],
    centers: NDArray[np.int64],
    places: NDArray[np.float64],
    place_unit: float,
    first: int,
    last: int,
    price: float,
    knot_bits: float,
    widest: int,
    at: NDArray[np.int64],
) -> None:
    """Choose the slots in [first, last] that carry knots; write 0 into ``at`` there and -1 elsewhere.

    The curve runs through ``places``; a knot costs ``knot_bits`` and twice the logarithm of its step, a squared error
    ``price`` bits for each squared quantum.
    """
    count = last - first + 1
    dimension = places.shape[1]
    best = np.full(count, np.inf)
    parent = np.full(count, -1, np.int64)
    best[0] = 0.0
    m, n = np.empty(dimension), np.empty(dimension)
    center = np.empty(dimension)
    # the best line's error grows with a span at either end: the first origin worth a look only moves on
    lowest = 0
    for g in range(1, count):
        b = first + g
        lowest = max(lowest, g - widest)
        while lowest < g - 1:
            a = first + lowest
            w, u1, u2, q = span_moments(sums, a, b, ticks[a], ticks[b], centers[a], place_unit, m, n)
            if price * free_cost(w, u1, u2, q, m, n) <= _TOO_DEAR:
                break
            lowest += 1
        for e in range(lowest, g):
            if best[e] + knot_bits >= best[g]:
                continue
            a = first + e
            far = 0.0
            for axis in range(dimension):
                center[axis] = centers[a, axis] / place_unit
                far += abs(places[b, axis] - places[a, axis])
            cost = best[e] + knot_bits + 2.0 * np.log2(1.0 + far)
            if cost >= best[g]:
                continue
            w, u1, u2, q = span_moments(sums, a, b, ticks[a], ticks[b], centers[a], place_unit, m, n)
            cost += price * line_cost(w, u1, u2, q, m, n, places[a], places[b], center)
            if cost < best[g]:
                best[g] = cost
                parent[g] = e
    at[first : last + 1] = -1
    g = count - 1
    while g >= 0:
        at[first + g] = 0
        g = parent[g]


@jit
def settle_chains(
    sums: NDArray[np.int64],
    ticks: NDArray[np.int64],
    centers: NDArray[np.int64],
    places: NDArray[np.float64],
    place_unit: float,
    pieces: NDArray[np.int64],
    price: float,
    knot_bits: float,
    widest: int,
    at: NDArray[np.int64],
) -> None:
    """Choose knots as :func:`settle_chain` for each piece; a row of ``pieces`` begins with its first and last slot."""
    for i in range(len(pieces)):
        settle_chain(sums, ticks, centers, places, place_unit, pieces[i, 0], pieces[i, 1], price, knot_bits, widest, at)
