"""From the Viterbi path to legs over roads, and the position of every sample on them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted, jit
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
    "slice_legs",
    "travel_directions",
]

#: Leg of what is off the roads.
_NO_LEG = -1

#: First capacity in legs, besides two for each time step.
_FIRST_CAPACITY = 16


class Legs(NamedTuple):
    """Legs of a route, each on one directed road.

    ``begin`` and ``end`` are metres along the directed road; ``piece`` is the time step at which
    the leg's piece begins.
    """

    roads: NDArray[np.int32]
    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    piece: NDArray[np.int64]


@jit
def slice_legs(legs: Legs, first: int, end: int) -> Legs:
    """Legs ``first`` to ``end``, without the latter."""
    return Legs(
        legs.roads[first:end], legs.begin[first:end], legs.end[first:end], legs.piece[first:end]
    )


@jit
def best_path(trellis: Trellis) -> NDArray[np.int64]:
    """The Viterbi path: the candidate of each time step on the cheapest path."""
    starts = trellis.candidate_starts
    steps = len(starts) - 1
    path = np.empty(steps, np.int64)
    path[-1] = starts[steps - 1] + first_minimum(
        trellis.candidates.path_costs[starts[steps - 1] : starts[steps]]
    )
    for step in range(steps - 1, 0, -1):
        path[step - 1] = starts[step - 1] + trellis.candidates.predecessors[path[step]]
    return path


@jit
def build_legs(
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    samples: NDArray[np.int64],
    path: NDArray[np.int64],
    trellis: Trellis,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> tuple[Legs, NDArray[np.int64], NDArray[np.float64]]:
    """Build the legs of a Viterbi path.

    Returns the legs, and for each time step its leg (-1 off the roads) and its metres on the
    directed road. Metres never decrease along a leg.
    """
    # Build the legs in the order of time steps; those off the roads have none.
    candidates = trellis.candidates
    steps = len(path)
    capacity, count = 2 * steps + _FIRST_CAPACITY, 0
    legs = Legs(
        np.empty(capacity, np.int32),
        np.empty(capacity),
        np.empty(capacity),
        np.empty(capacity, np.int64),
    )
    leg_of, metres = np.full(steps, _NO_LEG, np.int64), np.zeros(steps)
    piece = 0
    for step in range(steps):
        road = candidates.roads[path[step]]
        offset = candidates.metres[path[step]]
        transition = candidates.transitions[path[step]]
        if road == OFF_ROAD:
            continue

        # Roads between the time step before and this one.
        between = np.empty(0, np.int32)
        if transition == OTHER_ROADS:
            last = path[step - 1]
            straight = distance_between(positions, samples[step - 1], samples[step])
            seconds = times[samples[step]] - times[samples[step - 1]]
            between = find_path(
                candidates.roads[last],
                graph.lengths[candidates.roads[last]] - candidates.metres[last],
                road,
                straight + model.beta * model.jump_cost,
                max_path_length(straight, seconds, model),
                positions[samples[step]],
                model.search_radius,
                graph,
                model,
                work,
            )
        if count + len(between) + 1 > capacity:
            capacity = 2 * capacity + len(between)
            legs = _resized_legs(legs, capacity)

        # a step off a crossing and back is an error, not a leg
        if transition == OTHER_ROADS and _is_spur(legs, count, graph, model):
            count -= 2
            for other in range(step - 1, -1, -1):
                if leg_of[other] < count:
                    break
                leg_of[other] = count - 1
                metres[other] = legs.end[count - 1]

        # Extend the last leg, and add new ones.
        if transition == SAME_ROAD:
            offset = max(legs.end[count - 1], offset)
            legs.end[count - 1] = offset
        elif transition == U_TURN:
            turning_point = max(legs.end[count - 1], graph.lengths[road] - offset)
            legs.end[count - 1] = turning_point
            begin = graph.lengths[road] - turning_point
            count = _add_leg(legs, count, road, begin, offset, piece)
        elif transition == OTHER_ROADS:
            legs.end[count - 1] = graph.lengths[legs.roads[count - 1]]
            for i in range(len(between)):
                length = graph.lengths[between[i]]
                count = _add_leg(legs, count, between[i], 0.0, length, piece)
            legs.end[count - 1] = offset
        else:
            piece = step
            count = _add_leg(legs, count, road, offset, offset, piece)
        leg_of[step] = count - 1
        metres[step] = offset
    return slice_legs(legs, 0, count), leg_of, metres


@inner_uncounted
def _is_spur(legs: Legs, count: int, graph: Graph, model: ModelParameters) -> bool:
    """Whether the last two legs step off a crossing and back, within ``max_spur`` metres."""
    # Two legs on one road, there and back, after another leg of the same piece.
    if (
        count < 3
        or legs.piece[count - 3] != legs.piece[count - 1]
        or legs.roads[count - 2] != legs.roads[count - 1] ^ 1
    ):
        return False

    # From a crossing, and not far.
    return (
        legs.begin[count - 2] == 0
        and legs.end[count - 2] <= model.max_spur
        and legs.end[count - 3] == graph.lengths[legs.roads[count - 3]]
    )


@inner_uncounted
def _add_leg(legs: Legs, count: int, road: int, begin: float, end: float, piece: int) -> int:
    """Add a leg; return the new number of legs."""
    legs.roads[count] = road
    legs.begin[count] = begin
    legs.end[count] = end
    legs.piece[count] = piece
    return count + 1


@inner
def _resized_legs(legs: Legs, size: int) -> Legs:
    return Legs(
        resized(legs.roads, size),
        resized(legs.begin, size),
        resized(legs.end, size),
        resized(legs.piece, size),
    )


@jit
def place_samples(
    positions: NDArray[np.float64],
    samples: NDArray[np.int64],
    step_legs: NDArray[np.int64],
    step_metres: NDArray[np.float64],
    legs: Legs,
    roads: Roads,
    graph: Graph,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Find leg, metres on its directed road, and distance of every sample.

    Samples between two time steps of one piece lie on the path between them, none before the one
    that came before it. The leg is -1 for samples that are on no piece.
    """
    # Samples on no piece keep the leg -1 and NaN for metres and distance.
    n, steps = len(positions), len(samples)
    leg_of = np.full(n, _NO_LEG, np.int64)
    metres = np.full(n, np.nan)
    distances = np.full(n, np.nan)
    for step in range(steps):
        # The sample of the time step.
        low, begin = step_legs[step], step_metres[step]
        if low < 0:
            continue
        sample = samples[step]
        leg_of[sample] = low
        metres[sample], distances[sample] = nearest_on_road(
            positions[sample], np.int64(legs.roads[low]), begin, begin, roads, graph
        )

        # Samples between it and the next time step of the same piece.
        if step + 1 == steps or step_legs[step + 1] < 0:
            continue
        high = step_legs[step + 1]
        if legs.piece[high] != legs.piece[low]:
            continue
        for between in range(sample + 1, samples[step + 1]):
            low, begin, distance = _nearest_on_legs(
                positions[between], low, begin, high, step_metres[step + 1], legs, roads, graph
            )
            leg_of[between] = low
            metres[between] = begin
            distances[between] = distance
    return leg_of, metres, distances


@inner_uncounted
def _nearest_on_legs(
    position: NDArray[np.float64],
    low: int,
    begin: float,
    high: int,
    end: float,
    legs: Legs,
    roads: Roads,
    graph: Graph,
) -> tuple[int, float, float]:
    """Find leg, metres and distance of the nearest point on legs ``low`` to ``high``.

    The legs are cut at ``begin`` metres on the first and ``end`` metres on the last.
    """
    least, nearest_leg, nearest_metres = np.inf, low, begin
    for leg in range(low, high + 1):
        # The interval of the leg.
        leg_begin = begin if leg == low else legs.begin[leg]
        leg_end = end if leg == high else legs.end[leg]

        # The first of the nearest points.
        metres, distance = nearest_on_road(
            position, np.int64(legs.roads[leg]), leg_begin, max(leg_begin, leg_end), roads, graph
        )
        if distance < least:
            least, nearest_leg, nearest_metres = distance, leg, metres
    return nearest_leg, nearest_metres, least


@jit
def nearest_on_road(
    position: NDArray[np.float64],
    directed: int,
    low: float,
    high: float,
    roads: Roads,
    graph: Graph,
) -> tuple[float, float]:
    """Find the nearest point on a directed road between two distances along it.

    Returns the metres along the directed road, and the distance.
    """
    # Offsets from the start of the road.
    road, length = directed >> 1, graph.lengths[directed]
    if directed & 1:
        low, high = length - high, length - low

    # Nearest point on each line segment between them.
    first_vertex, last_vertex = vertex_before(roads, road, low), roads.offsets[road + 1] - 1
    least, nearest = np.inf, low
    vertex, point = first_vertex, np.empty(len(position))
    while vertex < last_vertex and (roads.along[vertex] <= high or vertex == first_vertex):
        segment = roads.along[vertex + 1] - roads.along[vertex]
        _, fraction = project(roads.points, vertex, position)
        offset = min(max(roads.along[vertex] + fraction * segment, low), high)
        interpolate_position(roads, road, offset, point)
        square = 0.0
        for axis in range(len(position)):
            square += (position[axis] - point[axis]) ** 2
        if square < least:
            least, nearest = square, offset
        vertex += 1
    return length - nearest if directed & 1 else nearest, math.sqrt(least)


@jit
def road_positions(
    directed: NDArray[np.int32], metres: NDArray[np.float64], roads: Roads, graph: Graph
) -> NDArray[np.float64]:
    """Coordinates at distances in metres along directed roads."""
    out = np.empty((len(directed), roads.points.shape[1]))
    for i in range(len(directed)):
        offset = graph.lengths[directed[i]] - metres[i] if directed[i] & 1 else metres[i]
        interpolate_position(roads, directed[i] >> 1, offset, out[i])
    return out


@jit
def travel_directions(
    directed: NDArray[np.int32], metres: NDArray[np.float64], roads: Roads, graph: Graph
) -> NDArray[np.float64]:
    """Unit vectors of directed roads at distances in metres along them."""
    out = np.empty((len(directed), 2))
    for i in range(len(directed)):
        is_backward = directed[i] & 1
        offset = graph.lengths[directed[i]] - metres[i] if is_backward else metres[i]
        east, north = road_direction(roads, directed[i] >> 1, offset)
        out[i, 0], out[i, 1] = (-east, -north) if is_backward else (east, north)
    return out


@jit
def legs_to_line(legs: Legs, roads: Roads, graph: Graph) -> NDArray[np.float64]:
    """Vertices of legs as one line, without repeating a vertex."""
    # At most the vertices of all roads, and the two ends of each leg.
    capacity = 0
    for i in range(len(legs.roads)):
        road = legs.roads[i] >> 1
        capacity += roads.offsets[road + 1] - roads.offsets[road] + 2
    out, count = np.empty((capacity, roads.points.shape[1])), 0

    # Append the points of each leg; the end of one is mostly the beginning of the next.
    point = np.empty(roads.points.shape[1])
    for i in range(len(legs.roads)):
        # Offsets from the start of the road.
        road, is_backward = legs.roads[i] >> 1, legs.roads[i] & 1
        length = graph.lengths[legs.roads[i]]
        low, high = legs.begin[i], legs.end[i]
        if is_backward:
            low, high = length - legs.end[i], length - legs.begin[i]

        # Both ends of the leg, and the vertices between them in the order of travel.
        interpolate_position(roads, road, high if is_backward else low, point)
        count = _add_point(out, count, point)
        first, last = roads.offsets[road], roads.offsets[road + 1]
        for k in range(last - first):
            vertex = last - 1 - k if is_backward else first + k
            if low < roads.along[vertex] < high:
                count = _add_point(out, count, roads.points[vertex])
        interpolate_position(roads, road, low if is_backward else high, point)
        count = _add_point(out, count, point)
    return out[:count].copy()


@inner
def _add_point(out: NDArray[np.float64], count: int, point: NDArray[np.float64]) -> int:
    """Add a point unless it is the last one; return the new number of points."""
    is_same = count > 0
    for axis in range(len(point)):
        is_same = is_same and out[count - 1, axis] == point[axis]
    if is_same:
        return count
    out[count] = point
    return count + 1
