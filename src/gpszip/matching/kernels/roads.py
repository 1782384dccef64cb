"""What the kernels of matching share: roads, the cells that they cross, the graph that they make, and the model's numbers.

Directed road 2e leads along road e from its start to its end, 2e + 1 back, so that ``a ^ 1`` is a turned round.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = [
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

#: Metres behind a place at which its road's direction is taken: more than offsets err by rounding.
_BEHIND = 1e-6


class Roads(NamedTuple):
    """Shapes: road e has the vertices ``offsets[e]`` to ``offsets[e + 1]`` of ``points``, so many metres ``along`` it."""

    points: NDArray[np.float64]
    along: NDArray[np.float64]
    offsets: NDArray[np.int64]


class RoadGrid(NamedTuple):
    """Bits of road by the square cells that they cross, over the first two axes.

    The cell in some row and column counted from (left, low) has number ``row * columns + column``. ``table`` is a hash table of cell
    numbers plus one, 0 where empty; in the same slot are the begin and end of the cell's bits: first vertex and road of each.
    """

    table: NDArray[np.int64]
    begins: NDArray[np.int64]
    ends: NDArray[np.int64]
    firsts: NDArray[np.int32]
    owners: NDArray[np.int32]
    left: float
    low: float
    size: float
    columns: int
    rows: int


class Graph(NamedTuple):
    """Directed roads that may be travelled out of each node, ``outs[begins[v]:begins[v + 1]]``, and into it, ``ins[arrivals[v]:...]``.

    For each directed road: the node at its end, its length, the unit vector at its beginning, and whether it may be travelled.
    ``nodes`` are the places of the nodes.
    """

    begins: NDArray[np.int64]
    outs: NDArray[np.int32]
    heads: NDArray[np.int32]
    lengths: NDArray[np.float64]
    headings: NDArray[np.float64]
    open: NDArray[np.bool_]
    nodes: NDArray[np.float64]
    arrivals: NDArray[np.int64]
    ins: NDArray[np.int32]


class BackwardSearch(NamedTuple):
    """What is missing from the beginning of each directed road to what a layer wants, found by one search back from there.

    ``state`` holds the number of the search, the size of its heap and the node near which ways come from; ``limits`` how far it got, and
    how near. A road was met by this search if ``stamps`` says so, and ``slots`` is its place in the heap, -1 for what has left it.
    ``wanted`` are the nodes from which ways come.
    """

    state: NDArray[np.int64]
    limits: NDArray[np.float64]
    stamps: NDArray[np.int64]
    keys: NDArray[np.float64]
    costs: NDArray[np.float64]
    slots: NDArray[np.int32]
    heap: NDArray[np.int32]
    wanted: NDArray[np.bool_]


class Workspace(NamedTuple):
    """Room for one search at a time, as large as the graph.

    ``state`` holds the number of the search and the size of its heap; what belongs to a directed road is of this search if ``stamps``
    says so. ``keys`` are prices with what is at least missing to the goal; ``slots`` the place in the heap, -1 for what has left it.
    ``targets`` is the first candidate of a layer on a directed road, and ``known`` the one of the layer before whose ways on are known;
    -1 for none, also between searches. ``rest`` is room for searches back.
    """

    state: NDArray[np.int64]
    stamps: NDArray[np.int64]
    keys: NDArray[np.float64]
    costs: NDArray[np.float64]
    metres: NDArray[np.float64]
    parents: NDArray[np.int32]
    slots: NDArray[np.int32]
    heap: NDArray[np.int32]
    targets: NDArray[np.int32]
    known: NDArray[np.int32]
    backward: BackwardSearch


class ModelParameters(NamedTuple):
    """Numbers of the model; prices are negative logarithms of probability.

    Candidates are the ``most`` nearest places within ``reach`` metres; one d metres off costs ``(d / sigma) ** 2 / 2``, none at all
    ``off``. A way that is x metres longer or shorter than the straight line costs ``x / beta``, a link that no road makes ``jump``,
    turning off up to ``turn``, turning round ``u_turn``. A candidate may seem to go ``slack`` metres back,
    and steps off a crossing and back within ``spur`` metres are dropped. Ways that cost ``margin`` more
    than the best are not looked for. The next four bound the length of a way, see ``longest_way``. Going another way than the heading
    says costs ``log(1 + heading * (1 - cosine))``: headings err often a little, sometimes much; 0 where they say nothing.
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
    heading: float


@jit
def project(
    points: NDArray[np.float64], first: int, at: NDArray[np.float64]
) -> tuple[float, float]:
    """Squared distance from a place to a bit of road, and the share of the bit before its nearest point."""
    dot = square = 0.0
    for axis in range(points.shape[1]):
        step = points[first + 1, axis] - points[first, axis]
        dot += step * (at[axis] - points[first, axis])
        square += step * step
    share = min(max(dot / square, 0.0), 1.0) if square > 0 else 0.0
    distance = 0.0
    for axis in range(points.shape[1]):
        here = points[first, axis] + share * (points[first + 1, axis] - points[first, axis])
        distance += (at[axis] - here) ** 2
    return distance, share


@jit
def vertex_before(roads: Roads, road: int, offset: float) -> int:
    """The last vertex of a road, but never its end, that does not lie beyond an offset."""
    a, b = roads.offsets[road], roads.offsets[road + 1] - 1
    while b - a > 1:
        middle = (a + b) // 2
        if roads.along[middle] <= offset:
            a = middle
        else:
            b = middle
    return a


@jit
def interpolate_position(roads: Roads, road: int, offset: float, out: NDArray[np.float64]) -> None:
    """Coordinates of the place at an offset on a road."""
    a = vertex_before(roads, road, offset)
    bit = roads.along[a + 1] - roads.along[a]
    share = min(max((offset - roads.along[a]) / bit, 0.0), 1.0) if bit > 0 else 0.0
    for axis in range(len(out)):
        out[axis] = roads.points[a, axis] + share * (
            roads.points[a + 1, axis] - roads.points[a, axis]
        )


@jit
def road_direction(roads: Roads, road: int, offset: float) -> tuple[float, float]:
    """Unit vector of a road, from its start to its end, at an offset; where it bends, behind the bend. Zero where it has no length."""
    first = vertex_before(roads, road, offset + _BEHIND)
    east, north = (
        roads.points[first + 1, 0] - roads.points[first, 0],
        roads.points[first + 1, 1] - roads.points[first, 1],
    )
    length = np.hypot(east, north)
    return (east / length, north / length) if length > 0 else (0.0, 0.0)


@jit
def distance_between(positions: NDArray[np.float64], i: int, j: int) -> float:
    """Distance between two samples."""
    square = 0.0
    for axis in range(positions.shape[1]):
        square += (positions[i, axis] - positions[j, axis]) ** 2
    return np.sqrt(square)


@jit
def resized(values: NDArray[np.generic], size: int) -> NDArray[np.generic]:
    """A larger array that begins with the same values."""
    out = np.empty(size, values.dtype)
    out[: len(values)] = values
    return out
