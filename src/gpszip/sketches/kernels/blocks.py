"""Blocks of consecutive samples, as rows of exact moments that can be merged.

A row has the columns below, then three groups of d columns each: the position of the first
sample in metres; the mean position, from there; and the drift ``sum w (t - mean t) (p - mean p)``
in m s. Everything is relative to the block's own first sample, so that nothing is lost far from
zero. The free cost of a block is its cost against its own best line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import inner, inner_uncounted, jit, jit_uncounted

__all__ = [
    "COUNT",
    "DEPTH",
    "FIRST",
    "FIXED_COLUMNS",
    "JITTER",
    "LAST",
    "LEAF_SAMPLES",
    "MEAN_TIME",
    "REACH",
    "SCATTER",
    "SPREAD",
    "WEIGHT",
    "absorb_samples",
    "append_block",
    "are_times_exact",
    "balanced_blocks",
    "block_rows",
    "fill_block",
    "free_cost",
    "has_slope",
    "merge_between_cuts",
    "reduce_blocks",
]

#: Column: time of the first sample in seconds.
FIRST = 0

#: Column: time of the last sample in seconds.
LAST = 1

#: Column: sum of the weights.
WEIGHT = 2

#: Column: number of samples.
COUNT = 3

#: Column: weighted mean of the times, in seconds after the first one.
MEAN_TIME = 4

#: Column: ``sum w (t - mean t)^2`` in s^2.
SPREAD = 5

#: Column: ``sum w |p - mean p|^2`` in m^2.
SCATTER = 6

#: Column: upper bound on the distance in metres of any sample from the first one.
REACH = 7

#: Column: upper bound on the seconds by which any time is off COUNT even steps between FIRST and
#: LAST; infinite where weights differ.
JITTER = 8

#: Column: number of merges that led to the block, for bounds on rounding.
DEPTH = 9

#: Columns before the groups of d columns.
FIXED_COLUMNS = 10

#: Samples of the smallest block of a stream; two always lie on their own line.
LEAF_SAMPLES = 2

#: Samples that are summed up directly before blocks are merged.
_RUN_SAMPLES = 64

#: Runs that a tower of partial merges can hold: 2^64 of them.
_TOWER_HEIGHT = 64

#: Relative rounding of an evenly spaced time.
_TIME_ROUNDING = 4.5e-16

#: Multiples of 2^-20 s below 2^32 s need no more than the 53 bits of a float.
_BINARY_FRACTION = float(1 << 20)

#: Seconds; see _BINARY_FRACTION.
_MAX_EXACT_TIME = float(1 << 32)

#: A spread of times below this share of the weight times the squared duration is rounding.
_SINGULAR = 1e-24


@inner_uncounted
def fill_block(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    weights: NDArray[np.float64],
    a: int,
    b: int,
    row: NDArray[np.float64],
) -> None:
    """Write the moments of samples a to b - 1: the means first, then moments about the means."""
    d = positions.shape[1]
    first_column = FIXED_COLUMNS
    mean_column, drift_column = FIXED_COLUMNS + d, FIXED_COLUMNS + 2 * d

    # Weight and means, relative to the first sample.
    total, mean, is_even = 0.0, 0.0, True
    row[:] = 0.0
    for i in range(a, b):
        w = weights[i]
        is_even = is_even and w == weights[a]
        total += w
        mean += w * (times[i] - times[a])
        for c in range(d):
            row[mean_column + c] += w * (positions[i, c] - positions[a, c])
    mean /= total
    for c in range(d):
        row[first_column + c] = positions[a, c]
        row[mean_column + c] /= total

    # Moments about the means, and the bounds.
    step = (times[b - 1] - times[a]) / max(b - a - 1, 1)
    max_square, jitter = 0.0, 0.0
    for i in range(a, b):
        w, x = weights[i], times[i] - times[a]
        jitter = max(jitter, abs(x - step * (i - a)))
        row[SPREAD] += w * (x - mean) ** 2
        square = 0.0
        for c in range(d):
            r = positions[i, c] - positions[a, c]
            square += r * r
            r -= row[mean_column + c]
            row[SCATTER] += w * r * r
            row[drift_column + c] += w * (x - mean) * r
        max_square = max(max_square, square)

    # With unequal weights, sums over even steps don't hold: the jitter is infinite.
    row[FIRST], row[LAST] = times[a], times[b - 1]
    row[WEIGHT], row[COUNT], row[MEAN_TIME] = total, b - a, mean
    row[REACH] = np.sqrt(max_square)
    row[JITTER] = jitter if is_even else np.inf


@jit_uncounted
def append_block(row: NDArray[np.float64], later: NDArray[np.float64]) -> None:
    """Merge a later block into ``row``, in place, exact but for rounding.

    Chan's update: with weights W_1 and W_2, ``h = W_1 W_2 / (W_1 + W_2)`` and the differences dt
    and dp of the means,

        SPREAD = S_1 + S_2 + h dt^2, and likewise SCATTER with |dp|^2 and drift with dt dp.
    """
    d = (len(row) - FIXED_COLUMNS) // 3
    first_column = FIXED_COLUMNS
    mean_column, drift_column = FIXED_COLUMNS + d, FIXED_COLUMNS + 2 * d

    # Jitter first: it needs the old first and last times.
    count = row[COUNT] + later[COUNT]
    is_even = row[WEIGHT] * later[COUNT] == later[WEIGHT] * row[COUNT]
    row[JITTER] = _joint_jitter(row, later, count) if is_even else np.inf

    # Difference of the mean times.
    total = row[WEIGHT] + later[WEIGHT]
    share = later[WEIGHT] / total
    h = row[WEIGHT] * share
    dt = (later[FIRST] - row[FIRST]) + (later[MEAN_TIME] - row[MEAN_TIME])

    # Difference of the mean positions: drift and means by axis.
    first_square, mean_square = 0.0, 0.0
    for c in range(d):
        first_difference = later[first_column + c] - row[first_column + c]
        first_square += first_difference * first_difference
        dp = first_difference + (later[mean_column + c] - row[mean_column + c])
        mean_square += dp * dp
        row[drift_column + c] += later[drift_column + c] + h * dt * dp
        row[mean_column + c] += share * dp

    # Update the other moments, and reach and depth, by which rounding is bounded.
    row[SPREAD] += later[SPREAD] + h * dt * dt
    row[SCATTER] += later[SCATTER] + h * mean_square
    row[MEAN_TIME] += share * dt
    row[REACH] = max(row[REACH], np.sqrt(first_square) + later[REACH])
    row[DEPTH] = max(row[DEPTH], later[DEPTH]) + 1
    row[LAST], row[WEIGHT], row[COUNT] = later[LAST], total, count


@inner_uncounted
def _joint_jitter(a: NDArray[np.float64], b: NDArray[np.float64], count: float) -> float:
    """Return a bound on how far the times of two blocks are off even steps over both.

    Each time is off the even steps of its own block by at most that block's jitter. These steps
    are off the common ones by a linear function, which is largest at an end of a block.
    """
    duration = b[LAST] - a[FIRST]
    step = duration / (count - 1)
    shift_a = abs((a[LAST] - a[FIRST]) - step * (a[COUNT] - 1))
    shift_b = abs((b[FIRST] - a[FIRST]) - step * a[COUNT])
    jitter = max(a[JITTER] + shift_a, b[JITTER] + shift_b)
    if jitter == 0 and are_times_exact(a[FIRST], step, duration):
        return 0.0
    return float(jitter + _TIME_ROUNDING * (duration + abs(a[FIRST])))


@inner_uncounted
def are_times_exact(first: float, step: float, duration: float) -> bool:
    """Whether floats add even steps from ``first`` on without rounding.

    They do for multiples of 2^-20 s below 2^32 s.
    """
    return bool(
        np.floor(first * _BINARY_FRACTION) == first * _BINARY_FRACTION
        and np.floor(step * _BINARY_FRACTION) == step * _BINARY_FRACTION
        and abs(first) + duration < _MAX_EXACT_TIME
    )


@jit
def block_rows(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    weights: NDArray[np.float64],
    cuts: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return the rows of the samples between consecutive cuts, shape (len(cuts) - 1, 10 + 3 d)."""
    width = FIXED_COLUMNS + 3 * positions.shape[1]
    rows, tower = np.empty((len(cuts) - 1, width)), np.empty((_TOWER_HEIGHT, width))
    for j in range(len(rows)):
        _fill_long_block(times, positions, weights, cuts[j], cuts[j + 1], tower)
        rows[j] = tower[0]
    return rows


@inner_uncounted
def _fill_long_block(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    weights: NDArray[np.float64],
    a: int,
    b: int,
    tower: NDArray[np.float64],
) -> None:
    """Write the moments of many samples to ``tower[0]``, by merging runs pairwise.

    Pairwise merges form a balanced tree, so that rounding grows with the logarithm of the number
    of samples.
    """
    # The tower holds complete subtrees of falling size, as the ones of a binary number of runs.
    size, runs, is_even = 0, 0, True
    for i in range(a, b, _RUN_SAMPLES):
        fill_block(times, positions, weights, i, min(i + _RUN_SAMPLES, b), tower[size])
        is_even = is_even and tower[size, JITTER] < np.inf and weights[i] == weights[a]
        size, runs = size + 1, runs + 1
        carry = runs
        while carry % 2 == 0:
            append_block(tower[size - 2], tower[size - 1])
            size, carry = size - 1, carry // 2

    # Merge what is left.
    while size > 1:
        append_block(tower[size - 2], tower[size - 1])
        size -= 1

    # The jitter from the times themselves: the bound after merges is wider.
    if is_even and runs > 1:
        step = (times[b - 1] - times[a]) / (b - a - 1)
        jitter = 0.0
        for i in range(a, b):
            jitter = max(jitter, abs((times[i] - times[a]) - step * (i - a)))
        tower[0, JITTER] = jitter


@inner_uncounted
def has_slope(row: NDArray[np.float64]) -> bool:
    """Whether the times of a block are spread, so that its best line has a slope."""
    duration = row[LAST] - row[FIRST]
    return bool(row[COUNT] > 1 and row[SPREAD] > _SINGULAR * row[WEIGHT] * duration**2)


@jit_uncounted
def free_cost(row: NDArray[np.float64]) -> float:
    """Return the cost of a block against its own best line: SCATTER - |drift|^2 / SPREAD."""
    d = (len(row) - FIXED_COLUMNS) // 3
    drift_column = FIXED_COLUMNS + 2 * d
    cost = row[SCATTER]
    if has_slope(row):
        square = 0.0
        for c in range(d):
            square += row[drift_column + c] ** 2
        cost -= square / row[SPREAD]
    return max(float(cost), 0.0)


@inner
def _pair_cost(
    a: NDArray[np.float64], b: NDArray[np.float64], scratch: NDArray[np.float64]
) -> float:
    """Return the free cost of two blocks merged.

    Not the increase of cost by the merge: this keeps the largest cost of a block low, too.
    """
    scratch[:] = a
    append_block(scratch, b)
    return float(free_cost(scratch))


@jit
def balanced_blocks(rows: NDArray[np.float64], limit: float) -> NDArray[np.int64]:
    """Merge neighbouring blocks to the fewest ones whose free costs are at most a limit.

    A given block that costs more stays alone.

    Parameters
    ----------
    rows : float64 array, shape (B, 10 + 3 d)
        Blocks; not changed.
    limit : float
        Square metres.

    Returns
    -------
    int64 array, shape (blocks + 1,)
        First given blocks of the merged ones, and B.
    """
    # Greedy blocks are the fewest: the free cost never falls when a block is added.
    candidate, merged = np.empty(rows.shape[1]), np.empty(rows.shape[1])
    cuts, count = np.empty(len(rows) + 1, np.int64), 0
    for i in range(len(rows)):
        # The block so far with the next one.
        if i > 0:
            candidate[:] = merged
            append_block(candidate, rows[i])

        # Start another one if it costs too much.
        if i == 0 or free_cost(candidate) > limit:
            cuts[count] = i
            count += 1
            candidate[:] = rows[i]
        merged[:] = candidate
    cuts[count] = len(rows)
    return cuts[: count + 1].copy()


@jit
def merge_between_cuts(rows: NDArray[np.float64], cuts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the blocks between consecutive cuts, each merged to one row."""
    out = np.empty((len(cuts) - 1, rows.shape[1]))
    for j in range(len(out)):
        out[j] = rows[cuts[j]]
        for i in range(cuts[j] + 1, cuts[j + 1]):
            append_block(out[j], rows[i])
    return out


@jit
def reduce_blocks(
    rows: NDArray[np.float64], owners: NDArray[np.int64], count: int, size: int
) -> int:
    """Merge neighbouring blocks of one track, cheapest first, in place.

    Repeats until ``size`` blocks are left or no two neighbours are of one track. Blocks stay in
    order. Time count log count.

    Parameters
    ----------
    rows : float64 array, shape (count or more, 10 + 3 d)
        Blocks; overwritten.
    owners : int64 array, shape (count or more,)
        Track of each block; overwritten.
    count : int
        Number of blocks.
    size : int
        Number of blocks to reach.

    Returns
    -------
    int
        Number of blocks that are left.
    """
    # There may be few enough blocks already.
    if count <= size:
        return count

    # Linked list of the blocks; a merged block is kept at its first one.
    scratch = np.empty(rows.shape[1])
    after, before = np.arange(1, count + 1), np.arange(-1, count - 1)
    is_alive = np.ones(count, np.bool_)

    # Heap of pairs by the cost of the two merged; pair_costs has the valid entry of each block.
    pair_costs = np.full(count, np.inf)
    keys, items = np.empty(3 * count), np.empty(3 * count, np.int64)
    queued, blocks = 0, count
    for i in range(count - 1):
        if owners[i] == owners[i + 1]:
            pair_costs[i] = _pair_cost(rows[i], rows[i + 1], scratch)
            queued = push(keys, items, queued, pair_costs[i], i)

    # Merge the cheapest pair until few enough blocks are left.
    while blocks > size and queued > 0:
        # Cheapest pair that is still up to date.
        key = keys[0]
        i, queued = pop(keys, items, queued)
        if not is_alive[i] or key != pair_costs[i]:
            continue

        # Merge its second block j into its first one i.
        j = after[i]
        append_block(rows[i], rows[j])
        is_alive[j], pair_costs[j] = False, np.inf
        after[i] = after[j]
        if after[i] < count:
            before[after[i]] = i
        blocks -= 1

        # New entries for the pairs on both sides of it.
        for k in (i, before[i]):
            if k < 0:
                continue
            pair_costs[k] = np.inf
            if after[k] < count and owners[k] == owners[after[k]]:
                pair_costs[k] = _pair_cost(rows[k], rows[after[k]], scratch)
                queued = push(keys, items, queued, pair_costs[k], k)

    # Close the gaps.
    kept = 0
    for i in range(count):
        if is_alive[i]:
            rows[kept] = rows[i]
            owners[kept] = owners[i]
            kept += 1
    return kept


@jit
def absorb_samples(
    rows: NDArray[np.float64],
    count: int,
    size: int,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> int:
    """Append samples to the blocks of a stream; return the new number of blocks.

    Every ``LEAF_SAMPLES`` samples become a block. Whenever ``rows`` is full, blocks are merged
    until ``size`` are left.

    Parameters
    ----------
    rows : float64 array, shape (capacity, 10 + 3 d)
        Blocks; overwritten.
    count : int
        Number of blocks.
    size : int
        Number of blocks after a reduction.
    times, positions, weights : float64 arrays, shapes (n,), (n, d), (n,)
        Samples; n is a multiple of ``LEAF_SAMPLES``.
    """
    owners = np.zeros(len(rows), np.int64)
    for a in range(0, len(times), LEAF_SAMPLES):
        if count == len(rows):
            count = reduce_blocks(rows, owners, count, size)
        fill_block(times, positions, weights, a, a + LEAF_SAMPLES, rows[count])
        count += 1
    return count
