"""Optimal partition of a track at block edges, with a penalty for each interval."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, jit
from gpszip.sketches.kernels.blocks import append_block, free_cost

__all__ = ["penalised_block_partition"]


@inner
def _prepend_block(
    row: NDArray[np.float64], earlier: NDArray[np.float64], scratch: NDArray[np.float64]
) -> None:
    """Merge an earlier block into ``row``, in place."""
    scratch[:] = earlier
    append_block(scratch, row)
    row[:] = scratch


@jit
def penalised_block_partition(
    rows: NDArray[np.float64], penalty: float
) -> tuple[float, NDArray[np.int64]]:
    """Minimise free cost + penalty * intervals over all partitions at block edges.

    With ``free(a, b)`` the free cost of blocks a to b - 1 merged, the recurrence is

        F(b) = min over a < b of F(a) + free(a, b) + penalty,  F(0) = 0.

    The scan over a runs down from b and stops early: with
    ``H(a) = min over a' < a of F(a') + free(a', a)`` and ``free`` superadditive, every a' < a
    costs ``F(a') + free(a', b) >= H(a) + free(a, b)``.

    Parameters
    ----------
    rows : float64 array, shape (B, 10 + 3 d)
        Blocks, with the columns of :mod:`gpszip.sketches.kernels.blocks`.
    penalty : float
        Square metres for each interval.

    Returns
    -------
    value : float
        F(B), in square metres.
    cuts : int64 array, shape (intervals + 1,)
        First blocks of the intervals of an optimal partition, and B.
    """
    count = len(rows)

    # F and H by edge, and the start of the last interval
    best_costs, free_costs = np.zeros(count + 1), np.full(count + 1, np.inf)
    origin = np.zeros(count + 1, np.int64)
    row, scratch = np.empty(rows.shape[1]), np.empty(rows.shape[1])
    for b in range(1, count + 1):
        best, best_free = np.inf, np.inf
        row[:] = rows[b - 1]
        for a in range(b - 1, -1, -1):
            if a < b - 1:
                _prepend_block(row, rows[a], scratch)
            free = free_cost(row)
            best_free = min(best_free, best_costs[a] + free)
            if best_costs[a] + free + penalty < best:
                best, origin[b] = best_costs[a] + free + penalty, a
            if free_costs[a] + free + penalty >= best:
                break
        best_costs[b], free_costs[b] = best, best_free

    # Trace back from the end.
    cuts, edge = [count], count
    while edge > 0:
        edge = origin[edge]
        cuts.append(edge)
    return float(best_costs[count]), np.array(cuts[::-1])
