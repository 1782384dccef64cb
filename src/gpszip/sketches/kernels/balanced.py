"""Balanced partition: every block as long as its own best line costs no more than a given amount."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.kernels.sums import PrefixSums, best_line_cost, tick_moments

__all__ = ["balanced_cuts"]

#: Share of the squared distances from a block's first sample up to which its free cost is rounding.
_ROUNDING = 1e-14


@jit
def _block_cost(sums: PrefixSums, a: int, b: int, row: NDArray[np.float64]) -> float:
    if b - a <= 2:
        return 0.0
    tick_moments(sums, a, b, row)
    cost = float(best_line_cost(row))
    return cost if cost > _ROUNDING * row[3] else 0.0


@jit
def balanced_cuts(sums: PrefixSums, limit: float, most: int) -> NDArray[np.int64]:
    """Cut samples into the fewest blocks whose free cost is at most ``limit`` square ticks each.

    The free cost never falls when samples are added, so that the end of each block is found by galloping and halving,
    O(log n) costs a block. Stops early when there are more than ``most`` blocks; the last cut is then before the end.
    """
    n = len(sums.t)
    row = np.empty(2 * sums.p.shape[1] + 4)
    cuts = np.empty(min(most + 1, n) + 2, np.int64)
    cuts[0] = 0
    blocks, a, stride = 0, 0, 2
    while a < n and blocks <= most:
        low, step = min(a + 2, n), max(stride // 2, 1)
        high = n + 1
        while low < n:
            b = min(low + step, n)
            if _block_cost(sums, a, b, row) > limit:
                high = b
                break
            low, step = b, 2 * step
        while high - low > 1 and high <= n:
            middle = (low + high) // 2
            if _block_cost(sums, a, middle, row) > limit:
                high = middle
            else:
                low = middle
        blocks += 1
        cuts[blocks] = low
        stride = low - a
        a = low
    return cuts[: blocks + 1].copy()
