"""The best k-segment approximation whose parts begin and end at block edges, at a price for each part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.sketches.kernels.blocks import append_block, free_cost

__all__ = ["penalised_block_partition"]


@jit
def _prepend_block(
    row: NDArray[np.float64], earlier: NDArray[np.float64], room: NDArray[np.float64]
) -> None:
    room[:] = earlier
    append_block(room, row)
    row[:] = room


@jit
def penalised_block_partition(
    rows: NDArray[np.float64], price: float
) -> tuple[float, NDArray[np.int64]]:
    """Least of free cost + price * parts over all partitions at block edges, and the cuts of one that has it.

    The scan for the last part's begin runs backward and stops where no earlier one can do better: with H(a) the least of
    F(a') + fr(a', a) over a' below a, and fr superadditive, F(a') + fr(a', b) >= H(a) + fr(a, b).
    """
    count = len(rows)
    total, joined, origin = (
        np.zeros(count + 1),
        np.full(count + 1, np.inf),
        np.zeros(count + 1, np.int64),
    )
    row, room = np.empty(rows.shape[1]), np.empty(rows.shape[1])
    for b in range(1, count + 1):
        best, reach = np.inf, np.inf
        row[:] = rows[b - 1]
        for a in range(b - 1, -1, -1):
            if a < b - 1:
                _prepend_block(row, rows[a], room)
            free = free_cost(row)
            reach = min(reach, total[a] + free)
            if total[a] + free + price < best:
                best, origin[b] = total[a] + free + price, a
            if joined[a] + free + price >= best:
                break
        total[b], joined[b] = best, reach
    cuts, at = [count], count
    while at > 0:
        at = origin[at]
        cuts.append(at)
    return float(total[count]), np.array(cuts[::-1])
