"""The cheapest chain of knots for one piece of a track on its own: exact dynamic programming over slots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.grid_moments import best_line_cost, line_cost, moments_between

__all__ = ["find_private_chain", "find_private_chains"]

#: A part that misses the best line by more than this many bits is never worth it.
_MAX_LINE_BITS = 45.0


@jit
def find_private_chain(
    sums: NDArray[np.int64],
    ticks: NDArray[np.int64],
    centers: NDArray[np.int64],
    positions: NDArray[np.float64],
    ticks_per_step: float,
    first: int,
    last: int,
    price: float,
    knot_bits: float,
    max_slots: int,
    slot_nodes: NDArray[np.int64],
) -> None:
    """Choose the slots in [first, last] that carry knots; write 0 into ``at`` there and -1 elsewhere.

    The curve runs through ``places``; a knot costs ``knot_bits`` and twice the logarithm of its step, a squared error
    ``price`` bits for each squared quantum.
    """
    count = last - first + 1
    dimension = positions.shape[1]
    best = np.full(count, np.inf)
    parent = np.full(count, -1, np.int64)
    best[0] = 0.0
    m, n = np.empty(dimension), np.empty(dimension)
    center = np.empty(dimension)
    # the best line's error grows with a span at either end: the first origin worth a look only moves on
    lowest = 0
    for g in range(1, count):
        b = first + g
        lowest = max(lowest, g - max_slots)
        while lowest < g - 1:
            a = first + lowest
            w, u1, u2, q = moments_between(
                sums, a, b, ticks[a], ticks[b], centers[a], ticks_per_step, m, n
            )
            if price * best_line_cost(w, u1, u2, q, m, n) <= _MAX_LINE_BITS:
                break
            lowest += 1
        for e in range(lowest, g):
            if best[e] + knot_bits >= best[g]:
                continue
            a = first + e
            far = 0.0
            for axis in range(dimension):
                center[axis] = centers[a, axis] / ticks_per_step
                far += abs(positions[b, axis] - positions[a, axis])
            cost = best[e] + knot_bits + 2.0 * np.log2(1.0 + far)
            if cost >= best[g]:
                continue
            w, u1, u2, q = moments_between(
                sums, a, b, ticks[a], ticks[b], centers[a], ticks_per_step, m, n
            )
            cost += price * line_cost(w, u1, u2, q, m, n, positions[a], positions[b], center)
            if cost < best[g]:
                best[g] = cost
                parent[g] = e
    slot_nodes[first : last + 1] = -1
    g = count - 1
    while g >= 0:
        slot_nodes[first + g] = 0
        g = parent[g]


@jit
def find_private_chains(
    sums: NDArray[np.int64],
    ticks: NDArray[np.int64],
    centers: NDArray[np.int64],
    positions: NDArray[np.float64],
    ticks_per_step: float,
    pieces: NDArray[np.int64],
    price: float,
    knot_bits: float,
    max_slots: int,
    slot_nodes: NDArray[np.int64],
) -> None:
    """Choose knots as :func:`find_private_chain` for each piece; a row of ``pieces`` begins with its first and last slot."""
    for i in range(len(pieces)):
        find_private_chain(
            sums,
            ticks,
            centers,
            positions,
            ticks_per_step,
            pieces[i, 0],
            pieces[i, 1],
            price,
            knot_bits,
            max_slots,
            slot_nodes,
        )
