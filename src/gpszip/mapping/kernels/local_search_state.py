"""Walks that are being polished: their knots, the error of their parts, and changes to either."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.grid_moments import line_cost, moments_between

__all__ = [
    "BITS",
    "KNOTS",
    "NODES",
    "SQUARE",
    "TEMPORARY",
    "GridSamples",
    "KnotList",
    "allocate_node",
    "copy_knot_list",
    "is_within",
    "remeasure",
    "replace_knots",
    "segment_error",
]

#: Numbers kept in ``Chain.counts`` and ``Chain.totals``.
KNOTS, NODES = 0, 1
SQUARE, BITS = 0, 1

#: Nodes at the end of a chain's room that belong to changes not made yet.
TEMPORARY = 32


class GridSamples(NamedTuple):
    """Slots and the samples between them, with the sums that price any part."""

    sums: NDArray[np.int64]  # over the samples before each slot
    ticks: NDArray[np.int64]  # time of each slot, in ticks
    centers: NDArray[np.int64]  # where the log is at each slot, in ticks
    ticks_per_step: float  # ticks of a quantum
    ends: NDArray[np.int64]  # samples before each slot
    times: NDArray[np.float64]  # of the samples, in cells
    sample_positions: NDArray[np.float64]  # of the samples, in quanta
    time_steps: NDArray[np.int64]  # time of each slot, in cells
    groups: NDArray[np.int64]  # group of each slot, whose parts keep to an error of their own


class KnotList(NamedTuple):
    """Knots of all walks in a row, with room for more."""

    slot: NDArray[np.int64]
    node: NDArray[np.int64]
    joined: NDArray[np.int8]  # whether a part leads to the knot from the one before
    begins: NDArray[np.int8]  # whether a track begins there
    error: NDArray[np.float64]  # squared error of the part that leads there
    places: NDArray[
        np.float64
    ]  # of the nodes, whole; the last few are those of changes not made yet
    uses: NDArray[np.int64]  # knots at each node
    counts: NDArray[np.int64]
    totals: NDArray[np.float64]
    squares: NDArray[np.float64]  # squared error of each group


@jit
def _copy_knot(knot_list: KnotList, i: int, into: KnotList, to: int) -> None:
    into.slot[to] = knot_list.slot[i]
    into.node[to] = knot_list.node[i]
    into.joined[to] = knot_list.joined[i]
    into.begins[to] = knot_list.begins[i]
    into.error[to] = knot_list.error[i]


@jit
def copy_knot_list(knot_list: KnotList, to: KnotList) -> None:
    """Copy all that is in use."""
    # loops compile several times as fast as assignments of slices
    for i in range(knot_list.counts[KNOTS]):
        _copy_knot(knot_list, i, to, i)
    for v in range(knot_list.counts[NODES]):
        to.uses[v] = knot_list.uses[v]
        for axis in range(knot_list.places.shape[1]):
            to.places[v, axis] = knot_list.places[v, axis]
    for i in range(2):
        to.counts[i], to.totals[i] = knot_list.counts[i], knot_list.totals[i]
    for g in range(len(knot_list.squares)):
        to.squares[g] = knot_list.squares[g]


@jit
def segment_error(
    samples: GridSamples,
    first: int,
    start: NDArray[np.float64],
    last: int,
    end: NDArray[np.float64],
) -> float:
    """Squared error of a part between two slots and places."""
    dimension = len(start)
    m, n, center = np.empty(dimension), np.empty(dimension), np.empty(dimension)
    for axis in range(dimension):
        center[axis] = samples.centers[first, axis] / samples.ticks_per_step
    w, u1, u2, q = moments_between(
        samples.sums,
        first,
        last,
        samples.ticks[first],
        samples.ticks[last],
        samples.centers[first],
        samples.ticks_per_step,
        m,
        n,
    )
    return line_cost(w, u1, u2, q, m, n, start, end, center)


@jit
def is_within(
    samples: GridSamples,
    first: int,
    start: NDArray[np.float64],
    last: int,
    end: NDArray[np.float64],
    maximum: float,
) -> bool:
    """Whether no sample of a part is farther from it than a maximum."""
    begin, span = samples.time_steps[first], samples.time_steps[last] - samples.time_steps[first]
    for i in range(samples.ends[first], samples.ends[last]):
        share = (samples.times[i] - begin) / span
        square = 0.0
        for axis in range(len(start)):
            away = (
                start[axis] + share * (end[axis] - start[axis]) - samples.sample_positions[i, axis]
            )
            square += away * away
        if square > maximum * maximum:
            return False
    return True


@jit
def remeasure(samples: GridSamples, knot_list: KnotList, first: int, last: int) -> None:
    """Measure anew the parts that lead to the knots from ``first`` to ``last``, and sum up."""
    for i in range(max(first, 0), min(last, knot_list.counts[KNOTS] - 1) + 1):
        knot_list.error[i] = 0.0
        if knot_list.joined[i]:
            u, v = knot_list.node[i - 1], knot_list.node[i]
            knot_list.error[i] = segment_error(
                samples,
                knot_list.slot[i - 1],
                knot_list.places[u],
                knot_list.slot[i],
                knot_list.places[v],
            )
    for g in range(len(knot_list.squares)):
        knot_list.squares[g] = 0.0
    square = 0.0
    for i in range(knot_list.counts[KNOTS]):
        square += knot_list.error[i]
        knot_list.squares[samples.groups[knot_list.slot[i]]] += knot_list.error[i]
    knot_list.totals[SQUARE] = square


@jit
def allocate_node(knot_list: KnotList, fixed: int, place: NDArray[np.float64]) -> int:
    """A node at this place that no knot uses yet, or -1 if there is no room."""
    for v in range(fixed, knot_list.counts[NODES]):
        if knot_list.uses[v] == 0:
            knot_list.places[v] = place
            return v
    v = knot_list.counts[NODES]
    if v >= len(knot_list.places) - TEMPORARY:
        return -1
    knot_list.counts[NODES] = v + 1
    knot_list.uses[v] = 0
    knot_list.places[v] = place
    return v


@jit
def replace_knots(
    samples: GridSamples,
    knot_list: KnotList,
    fixed: int,
    first: int,
    after: int,
    count: int,
    slots: NDArray[np.int64],
    nodes: NDArray[np.int64],
) -> bool:
    """Put ``count`` knots in place of those from ``first`` to before ``after``; tell whether there was room."""
    knots = knot_list.counts[KNOTS]
    shift = count - (after - first)
    if knots + shift > len(knot_list.slot):
        return False
    for i in range(first, after):
        knot_list.uses[knot_list.node[i]] -= 1
    if shift > 0:
        for i in range(knots - 1, after - 1, -1):
            _copy_knot(knot_list, i, knot_list, i + shift)
    elif shift < 0:
        for i in range(after, knots):
            _copy_knot(knot_list, i, knot_list, i + shift)
    knot_list.counts[KNOTS] = knots + shift
    for i in range(count):
        at, v = first + i, nodes[i]
        if v >= len(knot_list.places) - TEMPORARY:
            v = allocate_node(knot_list, fixed, knot_list.places[v])
            if v < 0:
                return False
        knot_list.slot[at], knot_list.node[at] = slots[i], v
        knot_list.uses[v] += 1
        if i >= after - first:
            knot_list.joined[at], knot_list.begins[at] = 1, 0
    remeasure(samples, knot_list, first, first + count)
    return True
