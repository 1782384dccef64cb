"""Data structures that the kernels of matching share: roads, grid, graph, workspace, and model.

Each road e of the network makes two directed roads: 2e leads from its start to its end, 2e + 1
from its end to its start. So ``a ^ 1`` is directed road a in the other direction, and ``a >> 1`` is
its road.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted, jit_uncounted

__all__ = [
    "CENTRE_NODE",
    "CENTRE_RADIUS",
    "COST_LIMIT",
    "HEAP_SIZE",
    "SEARCH_NUMBER",
    "BackwardSearch",
    "Graph",
    "ModelParameters",
    "RoadGrid",
    "Roads",
    "Workspace",
    "distance_between",
    "interpolate_position",
    "project",
    "resized",
    "road_direction",
    "vertex_before",
]

#: Metres added to an offset before its direction is taken: more than the offset's rounding error.
_BEHIND = 1e-6

# Indices into ``state`` of a workspace and of a backward search.

#: Number of the current search. Roads with another number in ``stamps`` were not reached by it.
SEARCH_NUMBER = 0

#: Number of directed roads in the heap.
HEAP_SIZE = 1

#: Node in the middle of the sources of a backward search.
CENTRE_NODE = 2

# Indices into ``limits`` of a backward search.

#: Cost in metres up to which the search reached all roads.
COST_LIMIT = 0

#: Distance in metres from the centre to the farthest source.
CENTRE_RADIUS = 1


class Roads(NamedTuple):
    """Shapes of roads.

    Road e has the vertices ``points[offsets[e]:offsets[e + 1]]``; ``along`` is the distance in
    metres of each vertex from the start of its road.
    """

    points: NDArray[np.float64]
    along: NDArray[np.float64]
    offsets: NDArray[np.int64]


class RoadGrid(NamedTuple):
    """A spatial index: the line segments of roads by the square cells that they cross.

    The grid spans the first two axes. The cell in a row and column counted from (``x_min``,
    ``y_min``) has the number ``row * columns + column``. ``keys`` is a hash table of cell numbers
    plus one, 0 where empty. The cell in slot s of the table has the entries ``starts[s]`` to
    ``ends[s]``, one for each segment: its first vertex in ``vertices`` and its road in ``roads``.
    """

    keys: NDArray[np.int64]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    vertices: NDArray[np.int32]
    roads: NDArray[np.int32]
    x_min: float
    y_min: float
    cell_size: float
    columns: int
    rows: int


class Graph(NamedTuple):
    """The directed graph of roads, in compressed sparse rows.

    The open directed roads ``out_roads[out_starts[v]:out_starts[v + 1]]`` leave node v, and
    ``in_roads[in_starts[v]:in_starts[v + 1]]`` enter it. Each directed road has a node at its end
    (``heads``), a length in metres, a unit vector at its beginning (``directions``), and whether it
    may be travelled (``is_open``).
    """

    out_starts: NDArray[np.int64]
    out_roads: NDArray[np.int32]
    heads: NDArray[np.int32]
    lengths: NDArray[np.float64]
    directions: NDArray[np.float64]
    is_open: NDArray[np.bool_]
    node_positions: NDArray[np.float64]
    in_starts: NDArray[np.int64]
    in_roads: NDArray[np.int32]


class BackwardSearch(NamedTuple):
    """Workspace of a search backward from the candidates of a time step: the costs still to go.

    A label belongs to the beginning of a directed road: ``costs`` is its cost to the nearest
    target, ``keys`` that cost plus a lower bound of the distance from the sources. The label
    belongs to the current search if ``stamps`` has its number. ``heap_slots`` is its position in
    the heap, -1 once it has left the heap and is final. ``is_source`` marks the nodes that the
    search must reach. ``state`` and ``limits`` are indexed by the constants of this module.
    """

    state: NDArray[np.int64]
    limits: NDArray[np.float64]
    stamps: NDArray[np.int64]
    keys: NDArray[np.float64]
    costs: NDArray[np.float64]
    heap_slots: NDArray[np.int32]
    heap: NDArray[np.int32]
    is_source: NDArray[np.bool_]


class Workspace(NamedTuple):
    """Arrays for one search at a time, as large as the graph, allocated once.

    A label belongs to the beginning of a directed road: its ``costs`` (metres and turns), its
    ``metres``, and the directed road before it (``parents``). ``keys``, ``stamps``, ``heap_slots``
    and ``state`` are as in :class:`BackwardSearch`; a key adds a lower bound of the cost to go.

    ``first_candidate`` is the first candidate of the current time step on each directed road, and
    ``path_rows`` the row of the path table that holds the paths from its end. Both are -1 for none,
    and everywhere between two time steps.
    """

    state: NDArray[np.int64]
    stamps: NDArray[np.int64]
    keys: NDArray[np.float64]
    costs: NDArray[np.float64]
    metres: NDArray[np.float64]
    parents: NDArray[np.int32]
    heap_slots: NDArray[np.int32]
    heap: NDArray[np.int32]
    first_candidate: NDArray[np.int32]
    path_rows: NDArray[np.int32]
    backward: BackwardSearch


class ModelParameters(NamedTuple):
    """Parameters of the hidden Markov model. Costs are negative logarithms of probability.

    Candidates are the ``max_candidates`` nearest positions on roads within ``search_radius``
    metres, in each open direction.

    Emission: a candidate d metres from its sample costs ``(d / sigma) ** 2 / 2``, and being off all
    roads ``off_road_cost``. A direction of travel at angle a to the heading costs
    ``log(1 + heading_weight * (1 - cos(a)))``: headings often err a little, sometimes much. The
    weight is 0 where headings are not used.

    Transition: a path x metres longer or shorter than the straight line costs ``x / beta``, turning
    off up to ``turn_cost``, turning round ``u_turn_cost``, and a jump that no road makes
    ``jump_cost``. A candidate may lie ``backward_tolerance`` metres behind the one before. A step
    off a crossing and back within ``max_spur`` metres is dropped. The search ignores paths that
    cost ``cost_margin`` more than the best. ``max_speed``, ``median_speed``, ``max_detour`` and
    ``length_tolerance`` bound the length of a path; see ``max_path_length``.
    """

    sigma: float
    beta: float
    search_radius: float
    off_road_cost: float
    jump_cost: float
    turn_cost: float
    u_turn_cost: float
    backward_tolerance: float
    max_spur: float
    cost_margin: float
    max_candidates: int
    max_speed: float
    median_speed: float
    max_detour: float
    length_tolerance: float
    heading_weight: float


@inner_uncounted
def project(
    points: NDArray[np.float64], vertex: int, position: NDArray[np.float64]
) -> tuple[float, float]:
    """Project a position on the line segment that begins at a vertex.

    Returns the squared distance, and the fraction of the segment before its nearest point.
    """
    # fraction = (q - p) . (x - p) / |q - p|^2, clipped to the segment
    dot = square = 0.0
    for axis in range(points.shape[1]):
        step = points[vertex + 1, axis] - points[vertex, axis]
        dot += step * (position[axis] - points[vertex, axis])
        square += step * step
    fraction = min(max(dot / square, 0.0), 1.0) if square > 0 else 0.0

    distance = 0.0
    for axis in range(points.shape[1]):
        nearest = points[vertex, axis] + fraction * (
            points[vertex + 1, axis] - points[vertex, axis]
        )
        distance += (position[axis] - nearest) ** 2
    return distance, fraction


@inner_uncounted
def vertex_before(roads: Roads, road: int, offset: float) -> int:
    """Find the last vertex of a road, other than its end, that is not beyond an offset."""
    low, high = roads.offsets[road], roads.offsets[road + 1] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if roads.along[middle] <= offset:
            low = middle
        else:
            high = middle
    return low


@inner_uncounted
def interpolate_position(roads: Roads, road: int, offset: float, out: NDArray[np.float64]) -> None:
    """Write the coordinates at an offset on a road to ``out``."""
    vertex = vertex_before(roads, road, offset)
    length = roads.along[vertex + 1] - roads.along[vertex]
    fraction = min(max((offset - roads.along[vertex]) / length, 0.0), 1.0) if length > 0 else 0.0
    for axis in range(len(out)):
        out[axis] = roads.points[vertex, axis] + fraction * (
            roads.points[vertex + 1, axis] - roads.points[vertex, axis]
        )


@inner_uncounted
def road_direction(roads: Roads, road: int, offset: float) -> tuple[float, float]:
    """Unit vector of a road from its start to its end, at an offset.

    At a bend it is the direction behind the bend; it is zero where the segment has no length.
    """
    vertex = vertex_before(roads, road, offset + _BEHIND)
    east = roads.points[vertex + 1, 0] - roads.points[vertex, 0]
    north = roads.points[vertex + 1, 1] - roads.points[vertex, 1]
    length = np.hypot(east, north)
    return (east / length, north / length) if length > 0 else (0.0, 0.0)


@jit_uncounted
def distance_between(positions: NDArray[np.float64], i: int, j: int) -> float:
    """Distance between two samples."""
    square = 0.0
    for axis in range(positions.shape[1]):
        square += (positions[i, axis] - positions[j, axis]) ** 2
    return np.sqrt(square)


@inner
def resized(values: NDArray[np.generic], size: int) -> NDArray[np.generic]:
    """Copy an array to a larger one; the rest is not initialised."""
    out = np.empty(size, values.dtype)
    out[: len(values)] = values
    return out
