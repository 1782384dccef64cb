"""From the cheapest chain of candidates to legs over roads, and the place of every sample on them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.matching.kernels.candidates import (
    OFF_ROAD,
    OTHER_ROADS,
    SAME_ROAD,
    U_TURN,
    first_minimum,
)
from gpszip.matching.kernels.roads import (
    Graph,
    ModelParameters,
    Roads,
    Workspace,
    distance_between,
    interpolate_position,
    project,
    resized,
    road_direction,
    vertex_before,
)
from gpszip.matching.kernels.search import find_path
from gpszip.matching.kernels.transitions import max_path_length
from gpszip.matching.kernels.trellis import Trellis

__all__ = [
    "Legs",
    "best_path",
    "build_legs",
    "legs_to_line",
    "nearest_on_road",
    "place_samples",
    "road_positions",
    "travel_directions",
]


class Legs(NamedTuple):
    """Legs one after the other: directed road, metres on it at begin and end, and the layer at which the leg's piece begins."""

    roads: NDArray[np.int32]
    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    piece: NDArray[np.int64]


@jit
def best_path(trellis: Trellis) -> NDArray[np.int64]:
    """Candidate of each layer on the cheapest chain."""
    begins = trellis.candidate_starts
    layers = len(begins) - 1
    chain = np.empty(layers, np.int64)
    chain[-1] = begins[layers - 1] + first_minimum(
        trellis.candidates.path_costs[begins[layers - 1] : begins[layers]]
    )
    for layer in range(layers - 1, 0, -1):
        chain[layer - 1] = begins[layer - 1] + trellis.candidates.predecessors[chain[layer]]
    return chain


@jit
def build_legs(
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    used: NDArray[np.int64],
    chain: NDArray[np.int64],
    trellis: Trellis,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> tuple[Legs, NDArray[np.int64], NDArray[np.float64]]:
    """Legs of a chain; and for each layer its leg, -1 off the roads, and its metres on it, which never go back."""
    layers = len(chain)
    room, count = 2 * layers + 16, 0
    legs = Legs(np.empty(room, np.int32), np.empty(room), np.empty(room), np.empty(room, np.int64))
    leg_of, metres = np.full(layers, -1, np.int64), np.zeros(layers)
    first = 0
    for layer in range(layers):
        road, at, kind = (
            trellis.candidates.roads[chain[layer]],
            trellis.candidates.metres[chain[layer]],
            trellis.candidates.transitions[chain[layer]],
        )
        if road == OFF_ROAD:
            continue
        way = np.empty(0, np.int32)
        if kind == OTHER_ROADS:
            last = chain[layer - 1]
            rest = graph.lengths[trellis.candidates.roads[last]] - trellis.candidates.metres[last]
            straight = distance_between(positions, used[layer - 1], used[layer])
            longest = max_path_length(straight, times[used[layer]] - times[used[layer - 1]], model)
            bound, goal = straight + model.beta * model.jump_cost, positions[used[layer]]
            way = find_path(
                trellis.candidates.roads[last],
                rest,
                road,
                bound,
                longest,
                goal,
                model.search_radius,
                graph,
                model,
                work,
            )
        if count + len(way) + 1 > room:
            room = 2 * room + len(way)
            legs = Legs(
                resized(legs.roads, room),
                resized(legs.begin, room),
                resized(legs.end, room),
                resized(legs.piece, room),
            )
        if kind == OTHER_ROADS and _is_spur(legs, count, graph, model):
            count -= 2
            for one in range(layer - 1, -1, -1):
                if leg_of[one] < count:
                    break
                leg_of[one], metres[one] = count - 1, legs.end[count - 1]
        if kind == SAME_ROAD:
            at = max(legs.end[count - 1], at)
            legs.end[count - 1] = at
        elif kind == U_TURN:
            turned = max(legs.end[count - 1], graph.lengths[road] - at)
            legs.end[count - 1] = turned
            count = _add_leg(legs, count, road, graph.lengths[road] - turned, at, first)
        elif kind == OTHER_ROADS:
            legs.end[count - 1] = graph.lengths[legs.roads[count - 1]]
            for i in range(len(way)):
                count = _add_leg(legs, count, way[i], 0.0, graph.lengths[way[i]], first)
            legs.end[count - 1] = at
        else:
            first = layer
            count = _add_leg(legs, count, road, at, at, first)
        leg_of[layer], metres[layer] = count - 1, at
    return (
        Legs(legs.roads[:count], legs.begin[:count], legs.end[:count], legs.piece[:count]),
        leg_of,
        metres,
    )


@jit
def _is_spur(legs: Legs, count: int, graph: Graph, model: ModelParameters) -> bool:
    """Whether the last two legs only step off a crossing and back, no farther than errors do."""
    if (
        count < 3
        or legs.piece[count - 3] != legs.piece[count - 1]
        or legs.roads[count - 2] != legs.roads[count - 1] ^ 1
    ):
        return False
    return (
        legs.begin[count - 2] == 0
        and legs.end[count - 2] <= model.max_spur
        and legs.end[count - 3] == graph.lengths[legs.roads[count - 3]]
    )


@jit
def _add_leg(legs: Legs, count: int, road: int, begin: float, end: float, piece: int) -> int:
    legs.roads[count], legs.begin[count], legs.end[count], legs.piece[count] = (
        road,
        begin,
        end,
        piece,
    )
    return count + 1


@jit
def place_samples(
    positions: NDArray[np.float64],
    used: NDArray[np.int64],
    leg_of: NDArray[np.int64],
    metres_of: NDArray[np.float64],
    legs: Legs,
    roads: Roads,
    graph: Graph,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Leg, metres on its directed road, and distance of every sample; leg -1 for samples that are on no piece.

    Samples between two layers of one piece lie on the way between them, none before the one that came before it.
    """
    n, layers = len(positions), len(used)
    leg, metres, distance = np.full(n, -1, np.int64), np.full(n, np.nan), np.full(n, np.nan)
    for layer in range(layers):
        low = leg_of[layer]
        if low < 0:
            continue
        i, at = used[layer], metres_of[layer]
        leg[i] = low
        metres[i], distance[i] = nearest_on_road(
            positions[i], legs.roads[low], at, at, roads, graph
        )
        if (
            layer + 1 == layers
            or leg_of[layer + 1] < 0
            or legs.piece[leg_of[layer + 1]] != legs.piece[low]
        ):
            continue
        high = leg_of[layer + 1]
        for k in range(i + 1, used[layer + 1]):
            best, best_leg, best_at = np.inf, low, at
            for one in range(low, high + 1):
                begin = at if one == low else legs.begin[one]
                end = metres_of[layer + 1] if one == high else legs.end[one]
                found, far = nearest_on_road(
                    positions[k], legs.roads[one], begin, max(begin, end), roads, graph
                )
                if far < best:
                    best, best_leg, best_at = far, one, found
            leg[k], metres[k], distance[k] = best_leg, best_at, best
            low, at = best_leg, best_at
    return leg, metres, distance


@jit
def nearest_on_road(
    at: NDArray[np.float64], directed: int, low: float, high: float, roads: Roads, graph: Graph
) -> tuple[float, float]:
    """Metres along a directed road between ``low`` and ``high`` of the place nearest to ``at``, and its distance."""
    road, length = directed >> 1, graph.lengths[directed]
    if directed & 1:
        low, high = length - high, length - low
    vertex, end = vertex_before(roads, road, low), roads.offsets[road + 1] - 1
    best, best_at = np.inf, low
    first, here = vertex, np.empty(len(at))
    while vertex < end and (roads.along[vertex] <= high or vertex == first):
        bit = roads.along[vertex + 1] - roads.along[vertex]
        _, share = project(roads.points, vertex, at)
        offset = min(max(roads.along[vertex] + share * bit, low), high)
        interpolate_position(roads, road, offset, here)
        square = 0.0
        for axis in range(len(at)):
            square += (at[axis] - here[axis]) ** 2
        if square < best:
            best, best_at = square, offset
        vertex += 1
    return length - best_at if directed & 1 else best_at, math.sqrt(best)


@jit
def road_positions(
    directed: NDArray[np.int32], metres: NDArray[np.float64], roads: Roads, graph: Graph
) -> NDArray[np.float64]:
    """Coordinates of places, so many metres along directed roads."""
    out = np.empty((len(directed), roads.points.shape[1]))
    for i in range(len(directed)):
        offset = graph.lengths[directed[i]] - metres[i] if directed[i] & 1 else metres[i]
        interpolate_position(roads, directed[i] >> 1, offset, out[i])
    return out


@jit
def travel_directions(
    directed: NDArray[np.int32], metres: NDArray[np.float64], roads: Roads, graph: Graph
) -> NDArray[np.float64]:
    """Unit vectors in which directed roads lead, so many metres along them."""
    out = np.empty((len(directed), 2))
    for i in range(len(directed)):
        back = directed[i] & 1
        east, north = road_direction(
            roads, directed[i] >> 1, graph.lengths[directed[i]] - metres[i] if back else metres[i]
        )
        out[i, 0], out[i, 1] = (-east, -north) if back else (east, north)
    return out


@jit
def legs_to_line(legs: Legs, roads: Roads, graph: Graph) -> NDArray[np.float64]:
    """Vertices of legs, one after the other, none twice in a row."""
    room = 0
    for i in range(len(legs.roads)):
        road = legs.roads[i] >> 1
        room += roads.offsets[road + 1] - roads.offsets[road] + 2
    out, count = np.empty((room, roads.points.shape[1])), 0
    here = np.empty(roads.points.shape[1])
    for i in range(len(legs.roads)):
        road, back, length = legs.roads[i] >> 1, legs.roads[i] & 1, graph.lengths[legs.roads[i]]
        low, high = (
            (length - legs.end[i], length - legs.begin[i]) if back else (legs.begin[i], legs.end[i])
        )
        interpolate_position(roads, road, high if back else low, here)
        count = _add(out, count, here)
        first, last = roads.offsets[road], roads.offsets[road + 1]
        for k in range(last - first):
            vertex = last - 1 - k if back else first + k
            if low < roads.along[vertex] < high:
                count = _add(out, count, roads.points[vertex])
        interpolate_position(roads, road, low if back else high, here)
        count = _add(out, count, here)
    return out[:count].copy()


@jit
def _add(out: NDArray[np.float64], count: int, point: NDArray[np.float64]) -> int:
    same = count > 0
    for axis in range(len(point)):
        same = same and out[count - 1, axis] == point[axis]
    if same:
        return count
    out[count] = point
    return count + 1
