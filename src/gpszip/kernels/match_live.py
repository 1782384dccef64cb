"""The lattice of matching one sample at a time: only its last layers are kept."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.kernels.match_lattice import JUMP, Layer, advance, begin, candidates, empty_layer, layer_from, longest_way
from gpszip.kernels.match_roads import Cells, Graph, Model, Roads, Work

__all__ = ["Ring", "add_layer", "empty_ring", "settled"]


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
    n = candidates(at, roads, cells, graph, model, here)
    ring.sizes[number % size] = n
    ahead = ring.ahead[low : low + n]
    if number == 0 or seconds == np.inf:
        begin(here, n, 0 if number == 0 else _best(ring, number - 1))
        ahead[:] = -here.prices[:n]
    else:
        last = ((number - 1) % size) * width
        n0 = ring.sizes[(number - 1) % size]
        before = layer_from(ring.layers, last)
        advance(before, n0, here, n, at, straight, longest_way(straight, seconds, model), graph, model, work, ring.moves)
        _arrive(ring.ahead[last : last + n0], ring.moves, ahead)
        ahead -= here.prices[:n]
    ahead -= ahead.max()
    best = _best(ring, number)
    total, share = 0.0, 0.0
    for j in range(n):
        total += math.exp(ahead[j])
        if here.roads[j] == here.roads[best]:
            share += math.exp(ahead[j])
    return here.roads[best], here.metres[best], here.distances[best], share / total, here.kinds[best]


@jit
def _best(ring: Ring, number: int) -> int:
    slot = number % len(ring.sizes)
    low = slot * len(ring.moves)
    return int(np.argmin(ring.layers.scores[low : low + ring.sizes[slot]]))


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
def settled(ring: Ring, number: int, back: int) -> tuple[int, float, float, bool]:
    """Directed road, metres, distance and whether a way led there, of the layer so many before layer ``number`` on the cheapest chain."""
    size, width = len(ring.sizes), len(ring.moves)
    chosen = _best(ring, number)
    for one in range(number, number - back, -1):
        chosen = ring.layers.backs[(one % size) * width + chosen]
    here = ((number - back) % size) * width + chosen
    return ring.layers.roads[here], ring.layers.metres[here], ring.layers.distances[here], ring.layers.kinds[here] < JUMP
