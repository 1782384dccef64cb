"""The lattice of matching one sample at a time: only its last layers are kept."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.matching.kernels.candidates import (
    Candidates,
    candidates_from,
    empty_candidates,
    find_candidates,
    first_minimum,
    start_paths,
)
from gpszip.matching.kernels.roads import Graph, ModelParameters, RoadGrid, Roads, Workspace
from gpszip.matching.kernels.transitions import advance_paths, is_too_fast, max_path_length

__all__ = [
    "TrellisRing",
    "add_time_step",
    "backtrack",
    "best_candidate",
    "empty_ring",
    "find_convergence",
]


class TrellisRing(NamedTuple):
    """The last layers of a lattice: the one numbered i begins at ``i % len(sizes)`` times the width of all and has so many candidates.

    ``ahead`` is the logarithm of the probability of each candidate, given its sample and those before; ``moves`` is room.
    """

    candidates: Candidates
    counts: NDArray[np.int64]
    log_forward: NDArray[np.float64]
    transition_costs: NDArray[np.float64]


@jit
def empty_ring(size: int, width: int) -> TrellisRing:
    """A ring for so many layers of at most so many candidates."""
    return TrellisRing(
        empty_candidates(size * width),
        np.zeros(size, np.int64),
        np.zeros(size * width),
        np.empty((width, width)),
    )


@jit
def add_time_step(
    ring: TrellisRing,
    number: int,
    at: NDArray[np.float64],
    heading: NDArray[np.float64],
    straight: float,
    seconds: float,
    roads: Roads,
    cells: RoadGrid,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> tuple[int, float, float, float, int]:
    """Add the layer with some number, ``straight`` metres and so many seconds after the one before, or after a silence if that is infinite.

    Returns directed road, metres, distance and probability of the best candidate, and how it was reached; a road is as probable as all
    candidates on it.
    """
    size, width = len(ring.counts), len(ring.transition_costs)
    low = (number % size) * width
    here = candidates_from(ring.candidates, low)
    n = find_candidates(at, heading, roads, cells, graph, model, here)
    ring.counts[number % size] = n
    ahead = ring.log_forward[low : low + n]
    if number == 0 or seconds == np.inf or is_too_fast(straight, seconds, model):
        start_paths(here, n, 0 if number == 0 else best_candidate(ring, number - 1))
        ahead[:] = -here.emission_costs[:n]
    else:
        last = ((number - 1) % size) * width
        n0 = ring.counts[(number - 1) % size]
        before = candidates_from(ring.candidates, last)
        advance_paths(
            before,
            n0,
            here,
            n,
            at,
            straight,
            max_path_length(straight, seconds, model),
            graph,
            model,
            work,
            ring.transition_costs,
        )
        _arrive(ring.log_forward[last : last + n0], ring.transition_costs, ahead)
        ahead -= here.emission_costs[:n]
    ahead -= ahead.max()
    chosen = best_candidate(ring, number)
    total, share = 0.0, 0.0
    for j in range(n):
        total += math.exp(ahead[j])
        if here.roads[j] == here.roads[chosen]:
            share += math.exp(ahead[j])
    return (
        here.roads[chosen],
        here.metres[chosen],
        here.distances[chosen],
        share / total,
        here.transitions[chosen],
    )


@jit
def best_candidate(ring: TrellisRing, number: int) -> int:
    """The candidate of a layer to which the cheapest chain leads."""
    slot = number % len(ring.counts)
    low = slot * len(ring.transition_costs)
    return first_minimum(ring.candidates.path_costs[low : low + ring.counts[slot]])


@jit
def _arrive(
    before: NDArray[np.float64], moves: NDArray[np.float64], after: NDArray[np.float64]
) -> None:
    """Logarithm of the probability of reaching each candidate."""
    for j in range(len(after)):
        most = -np.inf
        for i in range(len(before)):
            most = max(most, before[i] - moves[i, j])
        total = 0.0
        for i in range(len(before)):
            total += math.exp(before[i] - moves[i, j] - most)
        after[j] = most + math.log(total)


@jit
def find_convergence(ring: TrellisRing, number: int, first: int) -> tuple[int, int]:
    """The last layer, from layer ``first`` to layer ``number``, in which all chains to the latter are on one candidate, and that candidate.

    Whatever follows, the cheapest chain comes from there. The layer is -1 if there is none.
    """
    size, width = len(ring.counts), len(ring.transition_costs)
    alive, before = np.zeros(width, np.bool_), np.zeros(width, np.bool_)
    alive[: ring.counts[number % size]] = True
    for layer in range(number, first - 1, -1):
        low, count, last = (layer % size) * width, 0, 0
        before[:] = False
        for j in range(ring.counts[layer % size]):
            if alive[j]:
                count, last = count + 1, j
                before[ring.candidates.predecessors[low + j]] = True
        if count == 1:
            return layer, last
        alive, before = before, alive
    return -1, -1


@jit
def backtrack(ring: TrellisRing, number: int, chosen: int, first: int) -> NDArray[np.int64]:
    """Places in the ring of the cheapest chain to a candidate of layer ``number``, from layer ``first`` on."""
    size, width = len(ring.counts), len(ring.transition_costs)
    out = np.empty(number - first + 1, np.int64)
    for layer in range(number, first - 1, -1):
        out[layer - first] = (layer % size) * width + chosen
        chosen = ring.candidates.predecessors[out[layer - first]]
    return out
