"""A layer of a hidden Markov model on roads: the candidates of one sample.

A candidate is a place on a directed road, or ``NOWHERE``: off all roads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.matching.kernels.road_grid import near_roads
from gpszip.matching.kernels.roads import Cells, Graph, Model, Roads, direction

__all__ = [
    "GAP",
    "JUMP",
    "NOWHERE",
    "OVER",
    "ROUND",
    "ROUNDING",
    "STAY",
    "Layer",
    "begin",
    "candidates",
    "cheapest",
    "empty_layer",
    "layer_from",
]

NOWHERE = -1

#: How one candidate was reached from the one before: over other roads, on the same one, turned round on it, without a way, after a break.
OVER, STAY, ROUND, JUMP, GAP = 0, 1, 2, 3, 4

#: Two sums of the same numbers differ by less.
ROUNDING = 1e-9


class Layer(NamedTuple):
    """Candidates of one sample, or of many: directed roads, metres along them, distance to the sample, and price of being there.

    Then, of the cheapest chain to each: its price, the candidate of the layer before, and how it was reached from there.
    """

    roads: NDArray[np.int32]
    metres: NDArray[np.float64]
    distances: NDArray[np.float64]
    prices: NDArray[np.float64]
    scores: NDArray[np.float64]
    backs: NDArray[np.int16]
    kinds: NDArray[np.uint8]


@jit
def candidates(
    at: NDArray[np.float64], heading: NDArray[np.float64], roads: Roads, cells: Cells, graph: Graph, model: Model, out: Layer
) -> int:
    """Fill a layer for one sample and return the number of its candidates; the last one is always off all roads.

    ``heading`` is a unit vector, or zero where it is not known; off the roads it costs as much as at a right angle to one.
    """
    found, offsets, distances = np.empty(model.most, np.int32), np.empty(model.most), np.empty(model.most)
    count = near_roads(at, model.reach, roads, cells, found, offsets, distances)
    headed = model.heading > 0 and (heading[0] != 0 or heading[1] != 0)
    n, cosine = 0, 0.0
    for i in range(count):
        if headed:
            east, north = direction(roads, found[i], offsets[i])
            cosine = heading[0] * east + heading[1] * north
        for way in range(2):
            road = 2 * found[i] + way
            if graph.open[road]:
                out.roads[n] = road
                out.metres[n] = offsets[i] if way == 0 else graph.lengths[road] - offsets[i]
                out.distances[n] = distances[i]
                out.prices[n] = 0.5 * (distances[i] / model.sigma) ** 2
                if headed:
                    out.prices[n] += math.log1p(model.heading * (1.0 - (cosine if way == 0 else -cosine)))
                n += 1
    out.roads[n], out.metres[n], out.distances[n], out.prices[n] = NOWHERE, 0.0, 0.0, model.off
    if headed:
        out.prices[n] += math.log1p(model.heading)
    return n + 1


@jit
def begin(layer: Layer, n: int, back: int) -> None:
    """Begin new chains, all after one that has ended."""
    for j in range(n):
        layer.scores[j], layer.backs[j], layer.kinds[j] = layer.prices[j], back, GAP


@jit
def empty_layer(size: int) -> Layer:
    """Room for so many candidates."""
    return Layer(
        np.empty(size, np.int32),
        np.empty(size),
        np.empty(size),
        np.empty(size),
        np.empty(size),
        np.empty(size, np.int16),
        np.empty(size, np.uint8),
    )


@jit
def layer_from(layer: Layer, low: int) -> Layer:
    """The same room without its first candidates."""
    return Layer(
        layer.roads[low:],
        layer.metres[low:],
        layer.distances[low:],
        layer.prices[low:],
        layer.scores[low:],
        layer.backs[low:],
        layer.kinds[low:],
    )


@jit
def cheapest(scores: NDArray[np.float64]) -> int:
    """The first of the least numbers, but for rounding."""
    least = scores.min()
    for i in range(len(scores)):
        if scores[i] <= least + ROUNDING:
            return i
    return 0
