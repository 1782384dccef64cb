"""Bottom-up merging: join the two neighbours whose common line costs least more, until k parts are left."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import jit
from gpszip.kernels.sums import PrefixSums, add_moments, add_sample, best_line_cost

__all__ = ["bottom_up"]


@jit
def _block_moments(sums: PrefixSums, firsts: NDArray[np.int64], rows: NDArray[np.float64]) -> None:
    for j in range(len(rows)):
        last = firsts[j + 1] if j + 1 < len(rows) else len(sums.t)
        for i in range(firsts[j], last):
            add_sample(rows[j], sums.t[i] - sums.t[firsts[j]], sums.w[i], sums.p, i, firsts[j])


@jit
def _merge_cost(
    sums: PrefixSums,
    firsts: NDArray[np.int64],
    rows: NDArray[np.float64],
    costs: NDArray[np.float64],
    i: int,
    j: int,
    row: NDArray[np.float64],
) -> float:
    row[:] = rows[i]
    add_moments(row, rows[j], sums.t[firsts[j]] - sums.t[firsts[i]], sums.p, firsts[j], firsts[i])
    increase: float = best_line_cost(row) - costs[i] - costs[j]
    return increase


@jit
def bottom_up(sums: PrefixSums, firsts: NDArray[np.int64], k: int) -> NDArray[np.int64]:
    """Merge blocks that begin at ``firsts`` to k parts; return the k + 1 boundaries."""
    n, d = sums.p.shape
    blocks = len(firsts)
    rows = np.zeros((blocks, 2 * d + 4))
    row = np.empty(2 * d + 4)
    _block_moments(sums, firsts, rows)
    costs = np.array([best_line_cost(rows[j]) for j in range(blocks)])
    after = np.arange(1, blocks + 1)
    before = np.arange(-1, blocks - 1)
    keys, items = np.empty(3 * blocks), np.empty(3 * blocks, np.int64)
    owner, valid = np.empty(3 * blocks, np.int64), np.full(blocks, -1)
    size, entries = 0, 0
    for j in range(blocks - 1):
        owner[entries], valid[j] = j, entries
        size = push(
            keys, items, size, _merge_cost(sums, firsts, rows, costs, j, j + 1, row), entries
        )
        entries += 1
    parts = blocks
    while parts > k:
        entry, size = pop(keys, items, size)
        i = owner[entry]
        if valid[i] != entry:
            continue
        j = after[i]
        add_moments(
            rows[i], rows[j], sums.t[firsts[j]] - sums.t[firsts[i]], sums.p, firsts[j], firsts[i]
        )
        costs[i] = best_line_cost(rows[i])
        valid[i], valid[j], after[i] = -1, -1, after[j]
        if after[i] < blocks:
            before[after[i]] = i
            owner[entries], valid[i] = i, entries
            size = push(
                keys, items, size, _merge_cost(sums, firsts, rows, costs, i, after[i], row), entries
            )
            entries += 1
        if before[i] >= 0:
            h = before[i]
            owner[entries], valid[h] = h, entries
            size = push(
                keys, items, size, _merge_cost(sums, firsts, rows, costs, h, i, row), entries
            )
            entries += 1
        parts -= 1
    boundaries = np.empty(k + 1, np.int64)
    i = 0
    for j in range(k):
        boundaries[j] = firsts[i]
        i = after[i]
    boundaries[k] = n
    return boundaries
