"""Walks that are being polished: their knots, the error of their parts, and changes to either."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.grid_moments import line_cost, span_moments

__all__ = [
    "BITS",
    "KNOTS",
    "NODES",
    "SQUARE",
    "TEMPORARY",
    "Chain",
    "Samples",
    "copy_chain",
    "error_of",
    "is_within",
    "node_for",
    "renew",
    "replace_knots",
]

#: Numbers kept in ``Chain.counts`` and ``Chain.totals``.
KNOTS, NODES = 0, 1
SQUARE, BITS = 0, 1

#: Nodes at the end of a chain's room that belong to changes not made yet.
TEMPORARY = 32


class Samples(NamedTuple):
    """Slots and the samples between them, with the sums that price any part."""

    sums: NDArray[np.int64]  # over the samples before each slot
    ticks: NDArray[np.int64]  # time of each slot, in ticks
    centers: NDArray[np.int64]  # where the log is at each slot, in ticks
    unit: float  # ticks of a quantum
    ends: NDArray[np.int64]  # samples before each slot
    times: NDArray[np.float64]  # of the samples, in cells
    spots: NDArray[np.float64]  # of the samples, in quanta
    cells: NDArray[np.int64]  # time of each slot, in cells
    groups: NDArray[np.int64]  # group of each slot, whose parts keep to an error of their own


class Chain(NamedTuple):
    """Knots of all walks in a row, with room for more."""

    slot: NDArray[np.int64]
    node: NDArray[np.int64]
    joined: NDArray[np.int8]  # whether a part leads to the knot from the one before
    begins: NDArray[np.int8]  # whether a track begins there
    error: NDArray[np.float64]  # squared error of the part that leads there
    places: NDArray[np.float64]  # of the nodes, whole; the last few are those of changes not made yet
    uses: NDArray[np.int64]  # knots at each node
    counts: NDArray[np.int64]
    totals: NDArray[np.float64]
    squares: NDArray[np.float64]  # squared error of each group


@jit
def _carry(chain: Chain, i: int, into: Chain, to: int) -> None:
    into.slot[to] = chain.slot[i]
    into.node[to] = chain.node[i]
    into.joined[to] = chain.joined[i]
    into.begins[to] = chain.begins[i]
    into.error[to] = chain.error[i]


@jit
def copy_chain(chain: Chain, to: Chain) -> None:
    """Copy all that is in use."""
    # loops compile several times as fast as assignments of slices
    for i in range(chain.counts[KNOTS]):
        _carry(chain, i, to, i)
    for v in range(chain.counts[NODES]):
        to.uses[v] = chain.uses[v]
        for axis in range(chain.places.shape[1]):
            to.places[v, axis] = chain.places[v, axis]
    for i in range(2):
        to.counts[i], to.totals[i] = chain.counts[i], chain.totals[i]
    for g in range(len(chain.squares)):
        to.squares[g] = chain.squares[g]


@jit
def error_of(samples: Samples, first: int, start: NDArray[np.float64], last: int, end: NDArray[np.float64]) -> float:
    """Squared error of a part between two slots and places."""
    dimension = len(start)
    m, n, center = np.empty(dimension), np.empty(dimension), np.empty(dimension)
    for axis in range(dimension):
        center[axis] = samples.centers[first, axis] / samples.unit
    w, u1, u2, q = span_moments(
        samples.sums, first, last, samples.ticks[first], samples.ticks[last], samples.centers[first], samples.unit, m, n
    )
    return line_cost(w, u1, u2, q, m, n, start, end, center)


@jit
def is_within(samples: Samples, first: int, start: NDArray[np.float64], last: int, end: NDArray[np.float64], maximum: float) -> bool:
    """Whether no sample of a part is farther from it than a maximum."""
    begin, span = samples.cells[first], samples.cells[last] - samples.cells[first]
    for i in range(samples.ends[first], samples.ends[last]):
        share = (samples.times[i] - begin) / span
        square = 0.0
        for axis in range(len(start)):
            away = start[axis] + share * (end[axis] - start[axis]) - samples.spots[i, axis]
            square += away * away
        if square > maximum * maximum:
            return False
    return True


@jit
def renew(samples: Samples, chain: Chain, first: int, last: int) -> None:
    """Measure anew the parts that lead to the knots from ``first`` to ``last``, and sum up."""
    for i in range(max(first, 0), min(last, chain.counts[KNOTS] - 1) + 1):
        chain.error[i] = 0.0
        if chain.joined[i]:
            u, v = chain.node[i - 1], chain.node[i]
            chain.error[i] = error_of(samples, chain.slot[i - 1], chain.places[u], chain.slot[i], chain.places[v])
    for g in range(len(chain.squares)):
        chain.squares[g] = 0.0
    square = 0.0
    for i in range(chain.counts[KNOTS]):
        square += chain.error[i]
        chain.squares[samples.groups[chain.slot[i]]] += chain.error[i]
    chain.totals[SQUARE] = square


@jit
def node_for(chain: Chain, fixed: int, place: NDArray[np.float64]) -> int:
    """A node at this place that no knot uses yet, or -1 if there is no room."""
    for v in range(fixed, chain.counts[NODES]):
        if chain.uses[v] == 0:
            chain.places[v] = place
            return v
    v = chain.counts[NODES]
    if v >= len(chain.places) - TEMPORARY:
        return -1
    chain.counts[NODES] = v + 1
    chain.uses[v] = 0
    chain.places[v] = place
    return v


@jit
def replace_knots(
    samples: Samples, chain: Chain, fixed: int, first: int, after: int, count: int, slots: NDArray[np.int64], nodes: NDArray[np.int64]
) -> bool:
    """Put ``count`` knots in place of those from ``first`` to before ``after``; tell whether there was room."""
    knots = chain.counts[KNOTS]
    shift = count - (after - first)
    if knots + shift > len(chain.slot):
        return False
    for i in range(first, after):
        chain.uses[chain.node[i]] -= 1
    if shift > 0:
        for i in range(knots - 1, after - 1, -1):
            _carry(chain, i, chain, i + shift)
    elif shift < 0:
        for i in range(after, knots):
            _carry(chain, i, chain, i + shift)
    chain.counts[KNOTS] = knots + shift
    for i in range(count):
        at, v = first + i, nodes[i]
        if v >= len(chain.places) - TEMPORARY:
            v = node_for(chain, fixed, chain.places[v])
            if v < 0:
                return False
        chain.slot[at], chain.node[at] = slots[i], v
        chain.uses[v] += 1
        if i >= after - first:
            chain.joined[at], chain.begins[at] = 1, 0
    renew(samples, chain, first, first + count)
    return True
