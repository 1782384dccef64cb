"""Bottom-up merging of neighbouring intervals, cheapest merge first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import inner, inner_uncounted, jit
from gpszip.kernels.sums import PrefixSums, add_moments, add_sample, best_line_cost

__all__ = ["bottom_up"]

#: Heap entry of an interval without a right neighbour, or that was merged into another one.
_NO_ENTRY = -1


@inner_uncounted
def _block_moments(sums: PrefixSums, firsts: NDArray[np.int64], rows: NDArray[np.float64]) -> None:
    """Write the moments of each block about its first sample to ``rows``."""
    for j in range(len(rows)):
        end = firsts[j + 1] if j + 1 < len(rows) else len(sums.t)
        for i in range(firsts[j], end):
            add_sample(rows[j], sums.t[i] - sums.t[firsts[j]], sums.w[i], sums.p, i, firsts[j])


@inner
def _merge_cost(
    sums: PrefixSums,
    firsts: NDArray[np.int64],
    rows: NDArray[np.float64],
    costs: NDArray[np.float64],
    i: int,
    j: int,
    row: NDArray[np.float64],
) -> float:
    """Return the increase of cost if intervals i and j share a line; ``row`` is scratch."""
    row[:] = rows[i]
    add_moments(row, rows[j], sums.t[firsts[j]] - sums.t[firsts[i]], sums.p, firsts[j], firsts[i])
    increase: float = best_line_cost(row) - costs[i] - costs[j]
    return increase


@jit
def bottom_up(
    sums: PrefixSums, firsts: NDArray[np.int64], is_head: NDArray[np.bool_], k: int
) -> NDArray[np.int64]:
    """Merge blocks to k intervals; return the k + 1 boundaries.

    Repeats: merge the neighbours i and j with the least increase

        best(i + j) - best(i) - best(j)

    where best is the cost of an interval's samples against their own best line. A heap holds an
    entry for each pair of neighbours; entries that a later merge outdated are skipped when they
    are popped. Time b log b for b blocks.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    firsts : int64 array, shape (b,)
        First samples of the blocks, b >= k.
    is_head : bool array, shape (b,)
        Whether a block begins a run; it is not merged into the block before it.
    k : int
        Number of intervals.
    """
    n, d = sums.p.shape
    blocks = len(firsts)

    # Moments and cost of each block; a merged interval is kept at its first block.
    rows = np.zeros((blocks, 2 * d + 4))
    scratch = np.empty(2 * d + 4)
    _block_moments(sums, firsts, rows)
    costs = np.array([best_line_cost(rows[j]) for j in range(blocks)])

    # Linked list of the intervals.
    after = np.arange(1, blocks + 1)
    before = np.arange(-1, blocks - 1)

    # Heap of pairs; owner is the left interval of an entry, current the valid entry of an interval.
    keys, items = np.empty(3 * blocks), np.empty(3 * blocks, np.int64)
    owner = np.empty(3 * blocks, np.int64)
    current = np.full(blocks, _NO_ENTRY)
    size, entries = 0, 0
    for j in range(blocks - 1):
        if is_head[j + 1]:
            continue
        owner[entries], current[j] = j, entries
        increase = _merge_cost(sums, firsts, rows, costs, j, j + 1, scratch)
        size = push(keys, items, size, increase, entries)
        entries += 1

    # Merge the cheapest pair until k intervals are left.
    intervals = blocks
    while intervals > k:
        # Cheapest pair that is still up to date.
        entry, size = pop(keys, items, size)
        i = owner[entry]
        if current[i] != entry:
            continue

        # Merge its right interval j into its left one i.
        j = after[i]
        x = sums.t[firsts[j]] - sums.t[firsts[i]]
        add_moments(rows[i], rows[j], x, sums.p, firsts[j], firsts[i])
        costs[i] = best_line_cost(rows[i])
        current[i], current[j], after[i] = _NO_ENTRY, _NO_ENTRY, after[j]
        intervals -= 1

        # New entries for the pairs on both sides of it.
        if after[i] < blocks:
            before[after[i]] = i
        if after[i] < blocks and not is_head[after[i]]:
            owner[entries], current[i] = i, entries
            increase = _merge_cost(sums, firsts, rows, costs, i, after[i], scratch)
            size = push(keys, items, size, increase, entries)
            entries += 1
        if before[i] >= 0 and not is_head[i]:
            h = before[i]
            owner[entries], current[h] = h, entries
            increase = _merge_cost(sums, firsts, rows, costs, h, i, scratch)
            size = push(keys, items, size, increase, entries)
            entries += 1

    # Follow the list.
    boundaries = np.empty(k + 1, np.int64)
    i = 0
    for j in range(k):
        boundaries[j] = firsts[i]
        i = after[i]
    boundaries[k] = n
    return boundaries
