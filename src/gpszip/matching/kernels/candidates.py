"""A layer of a hidden Markov model on roads: the candidates of one sample.

A candidate is a place on a directed road, or ``NOWHERE``: off all roads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.matching.kernels.road_grid import find_near_roads
from gpszip.matching.kernels.roads import Graph, ModelParameters, RoadGrid, Roads, road_direction

__all__ = [
    "BREAK",
    "JUMP",
    "OFF_ROAD",
    "OTHER_ROADS",
    "ROUNDING",
    "SAME_ROAD",
    "U_TURN",
    "Candidates",
    "candidates_from",
    "empty_candidates",
    "find_candidates",
    "first_minimum",
    "start_paths",
]

OFF_ROAD = -1

#: How one candidate was reached from the one before: over other roads, on the same one, turned round on it, without a way, after a break.
OTHER_ROADS, SAME_ROAD, U_TURN, JUMP, BREAK = 0, 1, 2, 3, 4

#: Two sums of the same numbers differ by less.
ROUNDING = 1e-9


class Candidates(NamedTuple):
    """Candidates of one sample, or of many: directed roads, metres along them, distance to the sample, and price of being there.

    Then, of the cheapest chain to each: its price, the candidate of the layer before, and how it was reached from there.
    """

    roads: NDArray[np.int32]
    metres: NDArray[np.float64]
    distances: NDArray[np.float64]
    emission_costs: NDArray[np.float64]
    path_costs: NDArray[np.float64]
    predecessors: NDArray[np.int16]
    transitions: NDArray[np.uint8]


@jit
def find_candidates(
    at: NDArray[np.float64],
    heading: NDArray[np.float64],
    roads: Roads,
    cells: RoadGrid,
    graph: Graph,
    model: ModelParameters,
    out: Candidates,
) -> int:
    """Fill a layer for one sample and return the number of its candidates; the last one is always off all roads.

    ``heading`` is a unit vector, or zero where it is not known; off the roads it costs as much as at a right angle to one.
    """
    found, offsets, distances = (
        np.empty(model.max_candidates, np.int32),
        np.empty(model.max_candidates),
        np.empty(model.max_candidates),
    )
    count = find_near_roads(at, model.search_radius, roads, cells, found, offsets, distances)
    headed = model.heading > 0 and (heading[0] != 0 or heading[1] != 0)
    n, cosine = 0, 0.0
    for i in range(count):
        if headed:
            east, north = road_direction(roads, found[i], offsets[i])
            cosine = heading[0] * east + heading[1] * north
        for way in range(2):
            road = 2 * found[i] + way
            if graph.open[road]:
                out.roads[n] = road
                out.metres[n] = offsets[i] if way == 0 else graph.lengths[road] - offsets[i]
                out.distances[n] = distances[i]
                out.emission_costs[n] = 0.5 * (distances[i] / model.sigma) ** 2
                if headed:
                    out.emission_costs[n] += math.log1p(
                        model.heading * (1.0 - (cosine if way == 0 else -cosine))
                    )
                n += 1
    out.roads[n], out.metres[n], out.distances[n], out.emission_costs[n] = (
        OFF_ROAD,
        0.0,
        0.0,
        model.off_road_cost,
    )
    if headed:
        out.emission_costs[n] += math.log1p(model.heading)
    return n + 1


@jit
def start_paths(layer: Candidates, n: int, back: int) -> None:
    """Begin new chains, all after one that has ended."""
    for j in range(n):
        layer.path_costs[j], layer.predecessors[j], layer.transitions[j] = (
            layer.emission_costs[j],
            back,
            BREAK,
        )


@jit
def empty_candidates(size: int) -> Candidates:
    """Room for so many candidates."""
    return Candidates(
        np.empty(size, np.int32),
        np.empty(size),
        np.empty(size),
        np.empty(size),
        np.empty(size),
        np.empty(size, np.int16),
        np.empty(size, np.uint8),
    )


@jit
def candidates_from(layer: Candidates, low: int) -> Candidates:
    """The same room without its first candidates."""
    return Candidates(
        layer.roads[low:],
        layer.metres[low:],
        layer.distances[low:],
        layer.emission_costs[low:],
        layer.path_costs[low:],
        layer.predecessors[low:],
        layer.transitions[low:],
    )


@jit
def first_minimum(scores: NDArray[np.float64]) -> int:
    """The first of the least numbers, but for rounding."""
    least = scores.min()
    for i in range(len(scores)):
        if scores[i] <= least + ROUNDING:
            return i
    return 0
