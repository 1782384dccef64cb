"""Candidates of one time step of the hidden Markov model: where on the roads a sample may belong.

A candidate is a position on a directed road, or ``OFF_ROAD``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted
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

#: Directed road of the candidate that is off all roads.
OFF_ROAD = -1

# Transitions: how a candidate was reached from its predecessor. Those below JUMP are paths over
# roads; of transitions that cost the same, the smallest number is taken.

#: By a path over one or more other directed roads.
OTHER_ROADS = 0

#: On the same directed road.
SAME_ROAD = 1

#: By turning round on the road.
U_TURN = 2

#: Without a path over roads.
JUMP = 3

#: The path begins here, after a gap or at the start of the track.
BREAK = 4

#: Two sums of the same numbers in another order differ by less than this cost.
ROUNDING = 1e-9


class Candidates(NamedTuple):
    """Candidates of one time step, or of many.

    ``roads`` are directed roads, ``metres`` the distances along them, ``distances`` those to the
    sample, and ``emission_costs`` the costs of being there. ``path_costs`` are the costs of the
    cheapest path to each candidate, ``predecessors`` the candidate of the time step before on that
    path, and ``transitions`` how it was reached from there.
    """

    roads: NDArray[np.int32]
    metres: NDArray[np.float64]
    distances: NDArray[np.float64]
    emission_costs: NDArray[np.float64]
    path_costs: NDArray[np.float64]
    predecessors: NDArray[np.int16]
    transitions: NDArray[np.uint8]


@inner
def find_candidates(
    position: NDArray[np.float64],
    heading: NDArray[np.float64],
    roads: Roads,
    grid: RoadGrid,
    graph: Graph,
    model: ModelParameters,
    out: Candidates,
) -> int:
    """Write the candidates of one sample to ``out`` and return their number; the last is off-road.

    A candidate at distance d, whose direction of travel is at angle a to the heading, costs
    ``(d / sigma) ** 2 / 2 + log(1 + heading_weight * (1 - cos(a)))`` (Newson and Krumm 2009,
    equation 1, and a term for the heading). ``heading`` is a unit vector, or zero where it is not
    known; off the roads it costs as much as at a right angle to a road.
    """
    # Nearest positions on roads.
    near_roads = np.empty(model.max_candidates, np.int32)
    offsets = np.empty(model.max_candidates)
    distances = np.empty(model.max_candidates)
    count = find_near_roads(
        position, model.search_radius, roads, grid, near_roads, offsets, distances
    )

    # a candidate for each open direction
    has_heading = model.heading_weight > 0 and (heading[0] != 0 or heading[1] != 0)
    n = 0
    cosine = 0.0
    for i in range(count):
        if has_heading:
            east, north = road_direction(roads, near_roads[i], offsets[i])
            cosine = heading[0] * east + heading[1] * north
        for backward in range(2):
            road = 2 * near_roads[i] + backward
            if not graph.is_open[road]:
                continue
            out.roads[n] = road
            out.metres[n] = graph.lengths[road] - offsets[i] if backward else offsets[i]
            out.distances[n] = distances[i]
            out.emission_costs[n] = 0.5 * (distances[i] / model.sigma) ** 2
            if has_heading:
                out.emission_costs[n] += math.log1p(
                    model.heading_weight * (1.0 - (-cosine if backward else cosine))
                )
            n += 1

    # Off the roads.
    out.roads[n] = OFF_ROAD
    out.metres[n] = 0.0
    out.distances[n] = 0.0
    out.emission_costs[n] = model.off_road_cost
    if has_heading:
        out.emission_costs[n] += math.log1p(model.heading_weight)
    return n + 1


@inner_uncounted
def start_paths(candidates: Candidates, n: int, predecessor: int) -> None:
    """Begin a path at each candidate; ``predecessor`` is the end of the path before the break."""
    for j in range(n):
        candidates.path_costs[j] = candidates.emission_costs[j]
        candidates.predecessors[j] = predecessor
        candidates.transitions[j] = BREAK


@inner
def empty_candidates(size: int) -> Candidates:
    """Allocate a number of candidates."""
    return Candidates(
        np.empty(size, np.int32),
        np.empty(size),
        np.empty(size),
        np.empty(size),
        np.empty(size),
        np.empty(size, np.int16),
        np.empty(size, np.uint8),
    )


@inner
def candidates_from(candidates: Candidates, first: int) -> Candidates:
    """A view of the candidates from ``first`` on."""
    return Candidates(
        candidates.roads[first:],
        candidates.metres[first:],
        candidates.distances[first:],
        candidates.emission_costs[first:],
        candidates.path_costs[first:],
        candidates.predecessors[first:],
        candidates.transitions[first:],
    )


@inner
def first_minimum(costs: NDArray[np.float64]) -> int:
    """Index of the first cost that is the least but for rounding."""
    least = np.inf
    for i in range(len(costs)):
        least = min(least, costs[i])
    for i in range(len(costs)):
        if costs[i] <= least + ROUNDING:
            return i
    return 0
