"""Blocks of consecutive samples as rows of exact moments that can be merged.

A row holds, in these columns: FIRST and LAST, the times of the block's first and last sample in seconds; WEIGHT; COUNT;
MEAN, the mean time since FIRST; SPREAD, sum w (t - mean)^2; SCATTER, sum w |p - mean|^2; REACH, no sample is farther from the
first one; JITTER, no sample's time is farther from COUNT even steps between FIRST and LAST, infinite where weights differ; DEPTH,
how many merges lie behind it; then d columns each for the first sample's position, for the mean position from there, and for the
drift sum w (t - mean) (p - mean). Everything is measured from the block's own first sample, so nothing is lost far from zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import jit

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

FIRST, LAST, WEIGHT, COUNT, MEAN_TIME, SPREAD, SCATTER, REACH, JITTER, DEPTH, FIXED_COLUMNS = range(
    11
)

#: Samples of the smallest block of a stream.
LEAF_SAMPLES = 2

#: Samples that are summed at once before blocks are merged.
_RUN_SAMPLES = 64

#: Share of a block's time span by which an evenly spaced time may be rounded.
_TIME_ROUNDING = 4.5e-16

#: A binary fraction of a second, and a time, with which 53 bits are enough.
_BINARY, _FAR = float(1 << 20), float(1 << 32)

#: Relative spread of the times below which no slope can be told.
_SINGULAR = 1e-24


@jit
def fill_block(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    weights: NDArray[np.float64],
    a: int,
    b: int,
    row: NDArray[np.float64],
) -> None:
    """Write the moments of samples a to b - 1: their means first, then everything about the means."""
    d = places.shape[1]
    total, mean, even = 0.0, 0.0, True
    row[:] = 0.0
    for i in range(a, b):
        w = weights[i]
        even = even and w == weights[a]
        total += w
        mean += w * (times[i] - times[a])
        for c in range(d):
            row[FIXED_COLUMNS + d + c] += w * (places[i, c] - places[a, c])
    mean /= total
    for c in range(d):
        row[FIXED_COLUMNS + c] = places[a, c]
        row[FIXED_COLUMNS + d + c] /= total
    step = (times[b - 1] - times[a]) / max(b - a - 1, 1)
    farthest, jitter = 0.0, 0.0
    for i in range(a, b):
        w, x = weights[i], times[i] - times[a]
        jitter = max(jitter, abs(x - step * (i - a)))
        row[SPREAD] += w * (x - mean) ** 2
        square = 0.0
        for c in range(d):
            r = places[i, c] - places[a, c]
            square += r * r
            r -= row[FIXED_COLUMNS + d + c]
            row[SCATTER] += w * r * r
            row[FIXED_COLUMNS + 2 * d + c] += w * (x - mean) * r
        farthest = max(farthest, square)
    row[FIRST], row[LAST], row[WEIGHT], row[COUNT], row[MEAN_TIME] = (
        times[a],
        times[b - 1],
        total,
        b - a,
        mean,
    )
    row[REACH] = np.sqrt(farthest)
    row[JITTER] = jitter if even else np.inf


@jit
def append_block(row: NDArray[np.float64], later: NDArray[np.float64]) -> None:
    """Merge a later block into ``row`` (Chan's update), exact but for rounding."""
    d = (len(row) - FIXED_COLUMNS) // 3
    count = row[COUNT] + later[COUNT]
    even = row[WEIGHT] * later[COUNT] == later[WEIGHT] * row[COUNT]
    row[JITTER] = _joint_jitter(row, later, count) if even else np.inf
    total = row[WEIGHT] + later[WEIGHT]
    share = later[WEIGHT] / total
    h = row[WEIGHT] * share
    dt = (later[FIRST] - row[FIRST]) + (later[MEAN_TIME] - row[MEAN_TIME])
    between, square = 0.0, 0.0
    for c in range(d):
        step = later[FIXED_COLUMNS + c] - row[FIXED_COLUMNS + c]
        between += step * step
        dp = step + (later[FIXED_COLUMNS + d + c] - row[FIXED_COLUMNS + d + c])
        square += dp * dp
        row[FIXED_COLUMNS + 2 * d + c] += later[FIXED_COLUMNS + 2 * d + c] + h * dt * dp
        row[FIXED_COLUMNS + d + c] += share * dp
    row[SPREAD] += later[SPREAD] + h * dt * dt
    row[SCATTER] += later[SCATTER] + h * square
    row[MEAN_TIME] += share * dt
    row[REACH] = max(row[REACH], np.sqrt(between) + later[REACH])
    row[DEPTH] = max(row[DEPTH], later[DEPTH]) + 1
    row[LAST], row[WEIGHT], row[COUNT] = later[LAST], total, count


@jit
def _joint_jitter(a: NDArray[np.float64], b: NDArray[np.float64], count: float) -> float:
    """How far the times of two blocks can be from even steps over both: each is off its own by its jitter, and these by a line."""
    span = b[LAST] - a[FIRST]
    step = span / (count - 1)
    bend_a = abs((a[LAST] - a[FIRST]) - step * (a[COUNT] - 1))
    bend_b = abs((b[FIRST] - a[FIRST]) - step * a[COUNT])
    bend = max(a[JITTER] + bend_a, b[JITTER] + bend_b)
    if bend == 0 and are_times_exact(a[FIRST], step, span):
        return 0.0
    return float(bend + _TIME_ROUNDING * (span + abs(a[FIRST])))


@jit
def are_times_exact(first: float, step: float, span: float) -> bool:
    """Whether times from ``first`` in even steps are multiples of 2^-20 s below 2^32 s, which floats add without rounding."""
    return bool(
        np.floor(first * _BINARY) == first * _BINARY
        and np.floor(step * _BINARY) == step * _BINARY
        and abs(first) + span < _FAR
    )


@jit
def block_rows(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    weights: NDArray[np.float64],
    cuts: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Rows of the samples between consecutive cuts, shape (len(cuts) - 1, 10 + 3 d)."""
    width = FIXED_COLUMNS + 3 * places.shape[1]
    rows, tower = np.empty((len(cuts) - 1, width)), np.empty((64, width))
    for j in range(len(rows)):
        _fill_long_block(times, places, weights, cuts[j], cuts[j + 1], tower)
        rows[j] = tower[0]
    return rows


@jit
def _fill_long_block(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    weights: NDArray[np.float64],
    a: int,
    b: int,
    tower: NDArray[np.float64],
) -> None:
    """Moments of many samples by merging runs in pairs, so that rounding grows with the logarithm of their number."""
    size, done, even = 0, 0, True
    for i in range(a, b, _RUN_SAMPLES):
        fill_block(times, places, weights, i, min(i + _RUN_SAMPLES, b), tower[size])
        even = even and tower[size, JITTER] < np.inf and weights[i] == weights[a]
        size, done = size + 1, done + 1
        pairs = done
        while pairs % 2 == 0:
            append_block(tower[size - 2], tower[size - 1])
            size, pairs = size - 1, pairs // 2
    while size > 1:
        append_block(tower[size - 2], tower[size - 1])
        size -= 1
    if even and done > 1:
        step = (times[b - 1] - times[a]) / (b - a - 1)
        jitter = 0.0
        for i in range(a, b):
            jitter = max(jitter, abs((times[i] - times[a]) - step * (i - a)))
        tower[0, JITTER] = jitter


@jit
def has_slope(row: NDArray[np.float64]) -> bool:
    """Whether the times of a block are spread, so that its best line has a slope."""
    return bool(
        row[COUNT] > 1 and row[SPREAD] > _SINGULAR * row[WEIGHT] * (row[LAST] - row[FIRST]) ** 2
    )


@jit
def free_cost(row: NDArray[np.float64]) -> float:
    """Fitting cost of a block against its own best line."""
    d = (len(row) - FIXED_COLUMNS) // 3
    cost = row[SCATTER]
    if has_slope(row):
        drift = 0.0
        for c in range(d):
            drift += row[FIXED_COLUMNS + 2 * d + c] ** 2
        cost -= drift / row[SPREAD]
    return max(float(cost), 0.0)


@jit
def _pair_cost(a: NDArray[np.float64], b: NDArray[np.float64], room: NDArray[np.float64]) -> float:
    """What two blocks cost when they become one: this keeps the largest cost low, too, which the growth alone would not."""
    room[:] = a
    append_block(room, b)
    return float(free_cost(room))


@jit
def balanced_blocks(rows: NDArray[np.float64], limit: float) -> NDArray[np.int64]:
    """Cuts of the fewest blocks, made of given ones, whose free costs are at most ``limit`` unless a given one's is."""
    room, whole = np.empty(rows.shape[1]), np.empty(rows.shape[1])
    cuts, count = np.empty(len(rows) + 1, np.int64), 0
    for i in range(len(rows)):
        if i > 0:
            room[:] = whole
            append_block(room, rows[i])
        if i == 0 or free_cost(room) > limit:
            cuts[count] = i
            count += 1
            room[:] = rows[i]
        whole[:] = room
    cuts[count] = len(rows)
    return cuts[: count + 1].copy()


@jit
def merge_between_cuts(rows: NDArray[np.float64], cuts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Rows of the blocks between consecutive cuts, each made one."""
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
    """Merge neighbours of one owner, always the two that cost least as one, until ``size`` are left; return how many are.

    Blocks stay in order; rows and owners are overwritten. Time count log count.
    """
    if count <= size:
        return count
    room = np.empty(rows.shape[1])
    following, before = np.arange(1, count + 1), np.arange(-1, count - 1)
    price, alive = np.full(count, np.inf), np.ones(count, np.bool_)
    keys, items = np.empty(3 * count), np.empty(3 * count, np.int64)
    queued, left = 0, count
    for i in range(count - 1):
        if owners[i] == owners[i + 1]:
            price[i] = _pair_cost(rows[i], rows[i + 1], room)
            queued = push(keys, items, queued, price[i], i)
    while left > size and queued > 0:
        key = keys[0]
        i, queued = pop(keys, items, queued)
        if not alive[i] or key != price[i]:
            continue
        j = following[i]
        append_block(rows[i], rows[j])
        alive[j], price[j] = False, np.inf
        following[i] = following[j]
        if following[i] < count:
            before[following[i]] = i
        left -= 1
        for k in (i, before[i]):
            if k < 0:
                continue
            price[k] = np.inf
            if following[k] < count and owners[k] == owners[following[k]]:
                price[k] = _pair_cost(rows[k], rows[following[k]], room)
                queued = push(keys, items, queued, price[k], k)
    at = 0
    for i in range(count):
        if alive[i]:
            rows[at] = rows[i]
            owners[at] = owners[i]
            at += 1
    return at


@jit
def absorb_samples(
    rows: NDArray[np.float64],
    count: int,
    size: int,
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> int:
    """Add samples, a whole number of leaves, to the ``count`` blocks of a stream; return how many blocks there are then.

    Whenever ``rows`` is full, the blocks are merged until ``size`` are left.
    """
    owners = np.zeros(len(rows), np.int64)
    for a in range(0, len(times), LEAF_SAMPLES):
        if count == len(rows):
            count = reduce_blocks(rows, owners, count, size)
        fill_block(times, places, weights, a, a + LEAF_SAMPLES, rows[count])
        count += 1
    return count
