"""The lattice of matching one sample at a time: only its last layers are kept."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.matching.kernels.candidates import Layer, begin, candidates, cheapest, empty_layer, layer_from
from gpszip.matching.kernels.roads import Cells, Graph, Model, Roads, Work
from gpszip.matching.kernels.transitions import advance, longest_way, too_fast

__all__ = ["Ring", "add_layer", "best", "empty_ring", "merged", "trail"]


class Ring(NamedTuple):
    """The last layers of a lattice: the one numbered i begins at ``i % len(sizes)`` times the width of all and has so many candidates.

    ``ahead`` is the logarithm of the probability of each candidate, given its sample and those before; ``moves`` is room.
    """

    layers: Layer
    sizes: NDArray[np.int64]
    ahead: NDArray[np.float64]
    moves: NDArray[np.float64]


@jit
def empty_ring(size: int, width: int) -> Ring:
    """A ring for so many layers of at most so many candidates."""
    return Ring(empty_layer(size * width), np.zeros(size, np.int64), np.zeros(size * width), np.empty((width, width)))


@jit
def add_layer(
    ring: Ring,
    number: int,
    at: NDArray[np.float64],
    heading: NDArray[np.float64],
    straight: float,
    seconds: float,
    roads: Roads,
    cells: Cells,
    graph: Graph,
    model: Model,
    work: Work,
) -> tuple[int, float, float, float, int]:
    """Add the layer with some number, ``straight`` metres and so many seconds after the one before, or after a silence if that is infinite.

    Returns directed road, metres, distance and probability of the best candidate, and how it was reached; a road is as probable as all
    candidates on it.
    """
    size, width = len(ring.sizes), len(ring.moves)
    low = (number % size) * width
    here = layer_from(ring.layers, low)
    n = candidates(at, heading, roads, cells, graph, model, here)
    ring.sizes[number % size] = n
    ahead = ring.ahead[low : low + n]
    if number == 0 or seconds == np.inf or too_fast(straight, seconds, model):
        begin(here, n, 0 if number == 0 else best(ring, number - 1))
        ahead[:] = -here.prices[:n]
    else:
        last = ((number - 1) % size) * width
        n0 = ring.sizes[(number - 1) % size]
        before = layer_from(ring.layers, last)
        advance(before, n0, here, n, at, straight, longest_way(straight, seconds, model), graph, model, work, ring.moves)
        _arrive(ring.ahead[last : last + n0], ring.moves, ahead)
        ahead -= here.prices[:n]
    ahead -= ahead.max()
    chosen = best(ring, number)
    total, share = 0.0, 0.0
    for j in range(n):
        total += math.exp(ahead[j])
        if here.roads[j] == here.roads[chosen]:
            share += math.exp(ahead[j])
    return here.roads[chosen], here.metres[chosen], here.distances[chosen], share / total, here.kinds[chosen]


@jit
def best(ring: Ring, number: int) -> int:
    """The candidate of a layer to which the cheapest chain leads."""
    slot = number % len(ring.sizes)
    low = slot * len(ring.moves)
    return cheapest(ring.layers.scores[low : low + ring.sizes[slot]])


@jit
def _arrive(before: NDArray[np.float64], moves: NDArray[np.float64], after: NDArray[np.float64]) -> None:
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
def merged(ring: Ring, number: int, first: int) -> tuple[int, int]:
    """The last layer, from layer ``first`` to layer ``number``, in which all chains to the latter are on one candidate, and that candidate.

    Whatever follows, the cheapest chain comes from there. The layer is -1 if there is none.
    """
    size, width = len(ring.sizes), len(ring.moves)
    alive, before = np.zeros(width, np.bool_), np.zeros(width, np.bool_)
    alive[: ring.sizes[number % size]] = True
    for layer in range(number, first - 1, -1):
        low, count, last = (layer % size) * width, 0, 0
        before[:] = False
        for j in range(ring.sizes[layer % size]):
            if alive[j]:
                count, last = count + 1, j
                before[ring.layers.backs[low + j]] = True
        if count == 1:
            return layer, last
        alive, before = before, alive
    return -1, -1


@jit
def trail(ring: Ring, number: int, chosen: int, first: int) -> NDArray[np.int64]:
    """Places in the ring of the cheapest chain to a candidate of layer ``number``, from layer ``first`` on."""
    size, width = len(ring.sizes), len(ring.moves)
    out = np.empty(number - first + 1, np.int64)
    for layer in range(number, first - 1, -1):
        out[layer - first] = (layer % size) * width + chosen
        chosen = ring.layers.backs[out[layer - first]]
    return out
