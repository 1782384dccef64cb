"""Visvalingam, SQUISH-E, STTrace and bottom-up: always remove the sample that matters least."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track

__all__ = ["effective_areas", "merge_costs", "squish_priorities", "sttrace"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Parts of a second, and of a metre, in which sums are exact.
_PER_UNIT = 1_000

#: Time and coordinates of a sample.
Sample = tuple[float, ...]

#: Cost of removing the second of three samples, by their indices.
Cost = Callable[[int, int, int], float]


def _area(a: Sample, q: Sample, b: Sample) -> float:
    """Return the area of the triangle of three positions.

    With the vectors u and v from a to the others it is ``sqrt(|u|^2 |v|^2 - (u v)^2) / 2``.
    """
    uu = vv = uv = 0.0
    for i in range(1, len(a)):
        u, v = q[i] - a[i], b[i] - a[i]
        uu += u * u
        vv += v * v
        uv += u * v
    return math.sqrt(max(uu * vv - uv * uv, 0.0)) / 2


def _distance(a: Sample, q: Sample, b: Sample) -> float:
    """Return the synchronised distance of q from the line between a and b."""
    share = (q[0] - a[0]) / (b[0] - a[0])
    total = 0.0
    for i in range(1, len(a)):
        difference = q[i] - a[i] - share * (b[i] - a[i])
        total += difference * difference
    return math.sqrt(total)


def effective_areas(track: Track) -> Floats:
    """Return the effective area of each sample (Visvalingam and Whyatt 1993).

    The sample whose triangle with its neighbours is smallest goes first, then its neighbours have
    new triangles. An effective area is not below that of a sample removed before.

    Parameters
    ----------
    track : Track
        n samples.

    Returns
    -------
    float64 array, shape (n,)
        Square metres; infinite for both ends.

    Examples
    --------
    >>> track = Track("a", range(4), [[0, 0], [2, 1], [4, 0], [6, 4]])
    >>> effective_areas(track).tolist()
    [inf, 2.0, 8.0, inf]
    """
    samples = _samples(track)
    return _eliminate(
        len(track), lambda a, q, b: _area(samples[a], samples[q], samples[b]), adds=False
    )


def squish_priorities(track: Track) -> Floats:
    """Return for each sample the bound from which on SQUISH-E drops it (Muckell et al. 2014).

    The priority of a sample is its synchronised distance from the line between its neighbours, and
    the largest priority of a neighbour that was removed is added to it. That bounds the error.

    Parameters
    ----------
    track : Track
        n samples.

    Returns
    -------
    float64 array, shape (n,)
        Metres; infinite for both ends.

    Examples
    --------
    >>> track = Track("a", range(4), [[0, 0], [1, 1], [2, 0], [3, 0]])
    >>> squish_priorities(track).round(2).tolist()
    [inf, 1.5, 0.5, inf]
    """
    samples = _samples(track)
    return _eliminate(
        len(track), lambda a, q, b: _distance(samples[a], samples[q], samples[b]), adds=True
    )


def merge_costs(track: Track) -> Floats:
    """Return for each sample the cost from which on bottom-up merging drops it (Keogh et al. 2001).

    Two lines are merged where that adds least to the sum of squared synchronised distances. With
    times t and positions p of samples a to b, both since sample a, and with D and d those of b, the
    sum of one line is ``sum |p|^2 - 2 (d / D) sum t p + |d / D|^2 sum t^2``. Sums are those of
    whole milliseconds and millimetres, so that nothing cancels.

    Parameters
    ----------
    track : Track
        n samples.

    Returns
    -------
    float64 array, shape (n,)
        Square metres; infinite for both ends.

    Examples
    --------
    >>> track = Track("a", range(4), [[0, 0], [1, 1], [2, 0], [3, 0]])
    >>> merge_costs(track).round(2).tolist()
    [inf, 0.75, 0.25, inf]
    """
    # Whole numbers, and their sums over all samples before each.
    times = np.round((track.times - track.times[0]) * _PER_UNIT)
    places = np.round((track.positions - track.positions[0]) * _PER_UNIT)
    t, p = (values.astype(np.int64).astype(object) for values in (times, places))
    terms = [t, t * t, *p.T, *(p * p).T, *(t[:, None] * p).T]
    sums = list(zip(*([0, *np.cumsum(term).tolist()] for term in terms), strict=True))
    samples, dimension = list(zip(t.tolist(), *p.T.tolist(), strict=True)), track.dimension

    # Squared distances from the line between a and b.
    def line(a: int, b: int) -> float:
        low, high, (t0, *p0), (t1, *p1) = sums[a], sums[b + 1], samples[a], samples[b]
        n, st, stt = b + 1 - a, high[0] - low[0], high[1] - low[1]
        spread, total = stt - 2 * t0 * st + n * t0 * t0, 0.0
        for axis in range(dimension):
            sp, spp, stp = (high[i] - low[i] for i in range(2 + axis, 2 + 3 * dimension, dimension))
            x, v = p0[axis], (p1[axis] - p0[axis]) / max(t1 - t0, 1)
            squares = spp - 2 * x * sp + n * x * x
            mixed = stp - t0 * sp - x * st + n * t0 * x
            total += squares - 2 * v * mixed + v * v * spread
        return total / _PER_UNIT**2

    return _eliminate(len(track), lambda a, q, b: line(a, b) - line(a, q) - line(q, b), adds=False)


def _eliminate(count: int, cost: Cost, *, adds: bool) -> Floats:
    """Return the largest cost up to the removal of each sample, when always the cheapest goes.

    Parameters
    ----------
    count : int
        Number of samples.
    cost : callable
        Cost of a sample between its neighbours.
    adds : bool
        Whether the cost of a sample that was removed is added to those of its neighbours.
    """
    # Costs of all samples, in a heap. Entries that are no longer true are skipped.
    before, after = list(range(-1, count - 1)), list(range(1, count + 1))
    costs = [math.inf] * count
    for q in range(1, count - 1):
        costs[q] = cost(q - 1, q, q + 1)
    heap = [(costs[q], q) for q in range(1, count - 1)]
    heapq.heapify(heap)

    # Remove the cheapest, and update its neighbours.
    added, largest = [0.0] * count, 0.0
    found = np.full(count, np.inf)
    while heap:
        value, q = heapq.heappop(heap)
        if value != costs[q] or found[q] < np.inf:
            continue
        largest = max(largest, value)
        found[q] = largest
        a, b = before[q], after[q]
        after[a], before[b] = b, a
        for side in (a, b):
            if adds:
                added[side] = max(added[side], value)
            if 0 < side < count - 1:
                own = cost(before[side], side, after[side])
                costs[side] = added[side] + own
                heapq.heappush(heap, (costs[side], side))
    return found


def sttrace(track: Track, size: int) -> Ints:
    """Return the samples that STTrace keeps in a buffer (Potamias et al., SSDBM 2006).

    Samples come one by one. Where the buffer is full, the sample in it goes whose synchronised
    distance from the line between its neighbours in the buffer is least.

    Parameters
    ----------
    track : Track
        n samples.
    size : int
        Samples in the buffer, at least 2.

    Returns
    -------
    int64 array
        Indices of the samples kept, among them both ends.

    Examples
    --------
    >>> sttrace(Track("a", range(5), [[0, 0], [1, 0], [2, 5], [3, 0], [4, 0]]), 4).tolist()
    [0, 2, 3, 4]
    """
    # The buffer as a list of neighbours, and a heap as above.
    samples = _samples(track)
    before: dict[int, int] = {}
    after: dict[int, int] = {}
    costs: dict[int, float] = {}
    heap: list[tuple[float, int]] = []

    # Cost of a sample between its neighbours in the buffer.
    def update(q: int) -> None:
        if before.get(q, -1) >= 0 and q in after:
            costs[q] = _distance(samples[before[q]], samples[q], samples[after[q]])
            heapq.heappush(heap, (costs[q], q))

    for new in range(len(samples)):
        # A sample more.
        before[new] = new - 1
        if new:
            after[new - 1] = new
            update(new - 1)

        # One fewer.
        while len(before) > max(size, 2):
            value, q = heapq.heappop(heap)
            if costs.get(q) != value:
                continue
            a, b = before.pop(q), after.pop(q)
            del costs[q]
            after[a], before[b] = b, a
            update(a)
            update(b)
    return np.array(sorted(before), np.int64)


def _samples(track: Track) -> Sequence[Sample]:
    """Return time and coordinates of each sample as plain numbers, which are quick one by one."""
    columns = [track.times.tolist(), *(axis.tolist() for axis in track.positions.T)]
    return list(zip(*columns, strict=True))
