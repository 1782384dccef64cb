"""Balanced partition of samples: the longest blocks whose cost stays below a limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit
from gpszip.kernels.sums import PrefixSums, best_line_cost, tick_moments

__all__ = ["balanced_cuts"]

#: A free cost up to this share of the sum of squared distances is rounding.
_ROUNDING = 1e-14

#: Column of a row of moments of :mod:`gpszip.kernels.sums` with the sum of squared distances.
_SQUARES = 3


@inner_uncounted
def _block_cost(sums: PrefixSums, a: int, b: int, row: NDArray[np.float64]) -> float:
    """Return the free cost of samples a to b - 1 in square ticks; ``row`` is scratch."""
    if b - a <= 2:
        return 0.0
    tick_moments(sums, a, b, row)
    cost = float(best_line_cost(row))
    return cost if cost > _ROUNDING * row[_SQUARES] else 0.0


@jit
def balanced_cuts(sums: PrefixSums, limit: float, max_blocks: int) -> NDArray[np.int64]:
    """Cut samples into the fewest blocks whose free costs are at most a limit.

    The free cost, against a block's own best line, never falls when samples are added. So greedy
    blocks are optimal, and galloping and bisection find the end of each in O(log n) evaluations.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    limit : float
        Square ticks.
    max_blocks : int
        The search stops after one block more than this.

    Returns
    -------
    int64 array, shape (blocks + 1,)
        Cuts from 0 on. The last one is the number of samples, unless the search was stopped.
    """
    # Greedy blocks: each is as long as the limit allows.
    n = len(sums.t)
    row = np.empty(2 * sums.p.shape[1] + 4)
    cuts = np.empty(min(max_blocks + 1, n) + 2, np.int64)
    cuts[0] = 0
    blocks, a, length = 0, 0, 2
    while a < n and blocks <= max_blocks:
        # Gallop: from half the length of the last block on, in steps that double.
        low, step = min(a + 2, n), max(length // 2, 1)
        high = n + 1
        while low < n:
            b = min(low + step, n)
            if _block_cost(sums, a, b, row) > limit:
                high = b
                break
            low, step = b, 2 * step

        # Bisect between the last end that is cheap enough and the first that isn't.
        while high - low > 1 and high <= n:
            middle = (low + high) // 2
            if _block_cost(sums, a, middle, row) > limit:
                high = middle
            else:
                low = middle

        # Close the block; the next search starts from its length.
        blocks += 1
        cuts[blocks] = low
        length = low - a
        a = low
    return cuts[: blocks + 1].copy()
