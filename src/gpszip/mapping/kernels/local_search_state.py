"""State of a local search: the knots of all walks, the errors of their segments, and changes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.copying import copy_values
from gpszip.kernels.jit import inner, inner_uncounted, jit_uncounted
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

#: Index in ``KnotList.counts`` of the number of knots.
KNOTS = 0
#: Index in ``KnotList.counts`` of the number of nodes.
NODES = 1

#: Index in ``KnotList.totals`` of the squared error of all segments.
SQUARE = 0
#: Index in ``KnotList.totals`` of the bits of all walks.
BITS = 1

#: Nodes at the end of a knot list's capacity that belong to candidate moves, one for each.
TEMPORARY = 32


class GridSamples(NamedTuple):
    """Slots and the samples between them, with the prefix sums that measure any segment."""

    sums: NDArray[np.int64]  # over the samples before each slot
    ticks: NDArray[np.int64]  # time of each slot, in ticks
    centers: NDArray[np.int64]  # position of the log at each slot, in ticks
    ticks_per_step: float  # position ticks of a grid step
    ends: NDArray[np.int64]  # number of samples before each slot
    times: NDArray[np.float64]  # of the samples, in time steps
    sample_positions: NDArray[np.float64]  # in grid steps
    time_steps: NDArray[np.int64]  # time of each slot, in time steps
    groups: NDArray[np.int64]  # group of each slot, whose segments share an error budget


class KnotList(NamedTuple):
    """Knots of all walks one after the other, with capacity for more."""

    slots: NDArray[np.int64]
    nodes: NDArray[np.int64]
    joined: NDArray[np.int8]  # 1 where a segment leads to the knot from the one before
    begins: NDArray[np.int8]  # 1 where a track begins
    errors: NDArray[np.float64]  # squared error of the segment that leads to each knot
    positions: NDArray[np.float64]  # of the nodes, whole; the last TEMPORARY are of moves
    uses: NDArray[np.int64]  # knots at each node
    counts: NDArray[np.int64]  # by KNOTS and NODES
    totals: NDArray[np.float64]  # by SQUARE and BITS
    group_squares: NDArray[np.float64]  # squared error of each group


@inner_uncounted
def _copy_knot(source: KnotList, i: int, target: KnotList, j: int) -> None:
    """Copy knot i of one list to knot j of another."""
    target.slots[j] = source.slots[i]
    target.nodes[j] = source.nodes[i]
    target.joined[j] = source.joined[i]
    target.begins[j] = source.begins[i]
    target.errors[j] = source.errors[i]


@jit_uncounted
def copy_knot_list(source: KnotList, target: KnotList) -> None:
    """Copy all that is in use."""
    # Loops compile several times as fast as assignments of slices.
    for i in range(source.counts[KNOTS]):
        _copy_knot(source, i, target, i)
    for v in range(source.counts[NODES]):
        target.uses[v] = source.uses[v]
        for axis in range(source.positions.shape[1]):
            target.positions[v, axis] = source.positions[v, axis]
    for i in range(2):
        target.counts[i], target.totals[i] = source.counts[i], source.totals[i]
    for g in range(len(source.group_squares)):
        target.group_squares[g] = source.group_squares[g]


@inner
def segment_error(
    samples: GridSamples,
    first: int,
    start: NDArray[np.float64],
    last: int,
    end: NDArray[np.float64],
) -> float:
    """Squared error of a segment from ``start`` at slot ``first`` to ``end`` at slot ``last``."""
    # Take the moments of the samples about the centre of the first slot, and measure the line.
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


@inner_uncounted
def is_within(
    samples: GridSamples,
    first: int,
    start: NDArray[np.float64],
    last: int,
    end: NDArray[np.float64],
    maximum: float,
) -> bool:
    """Whether no sample of a segment is farther from it than a maximum, in grid steps."""
    begin, span = samples.time_steps[first], samples.time_steps[last] - samples.time_steps[first]
    for i in range(samples.ends[first], samples.ends[last]):
        share = (samples.times[i] - begin) / span
        square = 0.0
        for axis in range(len(start)):
            offset = (
                start[axis] + share * (end[axis] - start[axis]) - samples.sample_positions[i, axis]
            )
            square += offset * offset
        if square > maximum * maximum:
            return False
    return True


@jit_uncounted
def remeasure(samples: GridSamples, knot_list: KnotList, first: int, last: int) -> None:
    """Measure the segments that lead to knots ``first`` to ``last``, and sum all errors up."""
    # Measure the segments that changed; none leads to a knot that begins a piece.
    for i in range(max(first, 0), min(last, knot_list.counts[KNOTS] - 1) + 1):
        knot_list.errors[i] = 0.0
        if knot_list.joined[i]:
            u, v = knot_list.nodes[i - 1], knot_list.nodes[i]
            knot_list.errors[i] = segment_error(
                samples,
                knot_list.slots[i - 1],
                knot_list.positions[u],
                knot_list.slots[i],
                knot_list.positions[v],
            )

    # Sum over all knots in their order, so that rounding does not depend on the changes made.
    for g in range(len(knot_list.group_squares)):
        knot_list.group_squares[g] = 0.0
    square = 0.0
    for i in range(knot_list.counts[KNOTS]):
        square += knot_list.errors[i]
        knot_list.group_squares[samples.groups[knot_list.slots[i]]] += knot_list.errors[i]
    knot_list.totals[SQUARE] = square


@inner_uncounted
def allocate_node(knot_list: KnotList, fixed: int, position: NDArray[np.float64]) -> int:
    """Make a node at a position, under a number that no knot uses; -1 if the capacity is used up.

    The first ``fixed`` nodes belong to prior walks and stay.
    """
    for v in range(fixed, knot_list.counts[NODES]):
        if knot_list.uses[v] == 0:
            copy_values(position, knot_list.positions[v])
            return v

    v = knot_list.counts[NODES]
    if v >= len(knot_list.positions) - TEMPORARY:
        return -1
    knot_list.counts[NODES] = v + 1
    knot_list.uses[v] = 0
    copy_values(position, knot_list.positions[v])
    return v


@inner_uncounted
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
    """Replace the knots from ``first`` to before ``after`` by ``count`` others.

    Returns
    -------
    bool
        Whether the capacity sufficed; if not, the list is left half changed.
    """
    # Give up before any change if the list lacks capacity.
    knots = knot_list.counts[KNOTS]
    shift = count - (after - first)
    if knots + shift > len(knot_list.slots):
        return False

    # Release the old knots' nodes, and move the knots behind them.
    for i in range(first, after):
        knot_list.uses[knot_list.nodes[i]] -= 1
    if shift > 0:
        for i in range(knots - 1, after - 1, -1):
            _copy_knot(knot_list, i, knot_list, i + shift)
    elif shift < 0:
        for i in range(after, knots):
            _copy_knot(knot_list, i, knot_list, i + shift)
    knot_list.counts[KNOTS] = knots + shift

    # Enter the new knots; temporary nodes become real ones.
    for i in range(count):
        knot, v = first + i, nodes[i]
        if v >= len(knot_list.positions) - TEMPORARY:
            v = allocate_node(knot_list, fixed, knot_list.positions[v])
            if v < 0:
                return False
        knot_list.slots[knot], knot_list.nodes[knot] = slots[i], v
        knot_list.uses[v] += 1
        if i >= after - first:
            knot_list.joined[knot], knot_list.begins[knot] = 1, 0

    # Measure the new segments, and the one that leads on from the last new knot.
    remeasure(samples, knot_list, first, first + count)
    return True
