"""The cheapest knots for one piece of a track by itself: exact dynamic programming over slots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, jit_uncounted
from gpszip.mapping.kernels.grid_moments import best_line_cost, line_cost, moments_between

__all__ = ["find_private_chain", "find_private_chains"]

#: Bits of error beyond which no segment pays: more knots cost less than that.
_MAX_LINE_BITS = 45.0


@inner
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
    """Choose the slots in [first, last] that carry knots: 0 in ``slot_nodes``, -1 elsewhere.

    Recurrence: the least bits B of a chain that ends at slot g are

        B[g] = min over g - max_slots <= e < g of
               B[e] + knot_bits + 2 log2(1 + |p_g - p_e|_1) + price * E(e, g)

    where p are the slots' positions and E is the squared error of the samples between the slots
    on the straight line from p_e to p_g, in squared grid steps.
    """
    # The chain begins with a knot on the first slot, at no bits.
    count = last - first + 1
    dimension = positions.shape[1]
    best = np.full(count, np.inf)
    parent = np.full(count, -1, np.int64)
    best[0] = 0.0
    m, n = np.empty(dimension), np.empty(dimension)
    center = np.empty(dimension)

    # Reach each slot from the slots before it, from ``lowest`` on.
    lowest = 0
    for g in range(1, count):
        b = first + g

        # Skip origins whose best line is too far off. Its error grows with a segment at either
        # end, so the lowest origin only moves on.
        lowest = max(lowest, g - max_slots)
        while lowest < g - 1:
            a = first + lowest
            w, u1, u2, q = moments_between(
                sums, a, b, ticks[a], ticks[b], centers[a], ticks_per_step, m, n
            )
            if price * best_line_cost(w, u1, u2, q, m, n) <= _MAX_LINE_BITS:
                break
            lowest += 1

        # Try each slot that is left as the knot before.
        for e in range(lowest, g):
            # The bits of knot and position alone often rule an origin out.
            if best[e] + knot_bits >= best[g]:
                continue
            a = first + e
            length = 0.0
            for axis in range(dimension):
                center[axis] = centers[a, axis] / ticks_per_step
                length += abs(positions[b, axis] - positions[a, axis])
            cost = best[e] + knot_bits + 2.0 * np.log2(1.0 + length)
            if cost >= best[g]:
                continue

            # Add the bits of the squared error.
            w, u1, u2, q = moments_between(
                sums, a, b, ticks[a], ticks[b], centers[a], ticks_per_step, m, n
            )
            cost += price * line_cost(w, u1, u2, q, m, n, positions[a], positions[b], center)
            if cost < best[g]:
                best[g] = cost
                parent[g] = e

    # Trace the cheapest chain back from the last slot.
    slot_nodes[first : last + 1] = -1
    g = count - 1
    while g >= 0:
        slot_nodes[first + g] = 0
        g = parent[g]


@jit_uncounted
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
    """Choose knots by :func:`find_private_chain` for each piece.

    A row of ``pieces`` begins with the first and the last slot of the piece.
    """
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
