"""Roads near a position: the line segments of roads by the square cells that they cross.

The cells are kept in a hash table, so that memory grows with the roads and not with the area.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted, jit
from gpszip.matching.kernels.roads import RoadGrid, Roads, project

__all__ = ["count_cells", "fill_cells", "find_near_roads", "hash_cells", "nearest_distances"]

#: Multiplier of Fibonacci hashing: 2 ** 64 divided by the golden ratio, as a signed number.
_HASH_MULTIPLIER = -7046029254386353131

#: Rows of the first table of hits; it doubles when full.
_FIRST_CAPACITY = 64

#: Radius at which the search for the nearest road begins, in cells.
_FIRST_RADIUS = 0.5

#: Number of radii tried, each twice the one before: roads within four cells are found.
_RADII = 4

# Columns of a table of hits.

#: Distance in metres from the position.
_DISTANCE = 0

#: Number of the road.
_ROAD = 1

#: Offset in metres along the road.
_OFFSET = 2


@inner_uncounted
def _list_cells(
    points: NDArray[np.float64],
    vertex: int,
    cell_size: float,
    origin: NDArray[np.float64],
    columns: int,
    out: NDArray[np.int64],
) -> int:
    """Write the cells that the segment from a vertex to the next crosses to ``out``.

    Returns their number, which may exceed the length of ``out``; the rest is not written.
    """
    # Ends of the segment in units of cells, from left to right.
    ax = (points[vertex, 0] - origin[0]) / cell_size
    ay = (points[vertex, 1] - origin[1]) / cell_size
    bx = (points[vertex + 1, 0] - origin[0]) / cell_size
    by = (points[vertex + 1, 1] - origin[1]) / cell_size
    if ax > bx:
        ax, ay, bx, by = bx, by, ax, ay

    # In each column, all rows between where the segment enters and leaves it.
    count = 0
    first_column, last_column = math.floor(ax), math.floor(bx)
    for column in range(first_column, last_column + 1):
        y0, y1 = ay, by
        if last_column > first_column:
            slope = (by - ay) / (bx - ax)
            y0 = ay if column == first_column else ay + (column - ax) * slope
            y1 = by if column == last_column else ay + (column + 1 - ax) * slope
        first_row, last_row = math.floor(min(y0, y1)), math.floor(max(y0, y1))
        for row in range(first_row, last_row + 1):
            if count < len(out):
                out[count] = row * columns + column
            count += 1
    return count


@jit
def count_cells(
    points: NDArray[np.float64],
    offsets: NDArray[np.int64],
    cell_size: float,
    origin: NDArray[np.float64],
    columns: int,
) -> int:
    """Number of entries that :func:`fill_cells` makes."""
    nothing = np.empty(0, np.int64)
    total = 0
    for road in range(len(offsets) - 1):
        for vertex in range(offsets[road], offsets[road + 1] - 1):
            total += _list_cells(points, vertex, cell_size, origin, columns, nothing)
    return total


@jit
def fill_cells(
    points: NDArray[np.float64],
    offsets: NDArray[np.int64],
    cell_size: float,
    origin: NDArray[np.float64],
    columns: int,
    total: int,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]:
    """List cell, first vertex and road of every segment in every cell that it crosses."""
    cells = np.empty(total, np.int64)
    vertices = np.empty(total, np.int32)
    roads = np.empty(total, np.int32)
    filled = 0
    for road in range(len(offsets) - 1):
        for vertex in range(offsets[road], offsets[road + 1] - 1):
            count = _list_cells(points, vertex, cell_size, origin, columns, cells[filled:])
            vertices[filled : filled + count] = vertex
            roads[filled : filled + count] = road
            filled += count
    return cells, vertices, roads


@inner_uncounted
def _find_slot(cell: int, keys: NDArray[np.int64]) -> int:
    """Find the slot of a hash table that holds a cell, or the empty slot where it belongs."""
    mask = len(keys) - 1
    mixed = np.int64(cell) * np.int64(_HASH_MULTIPLIER)
    slot = (mixed ^ (mixed >> 29)) & mask
    while keys[slot] != 0 and keys[slot] != cell + 1:
        slot = (slot + 1) & mask
    return slot


@jit
def hash_cells(
    cells: NDArray[np.int64], size: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Build the hash table over sorted cells: keys, and where the entries of each begin and end.

    ``size`` is a power of two.
    """
    keys = np.zeros(size, np.int64)
    starts = np.zeros(size, np.int64)
    ends = np.zeros(size, np.int64)
    i = 0
    while i < len(cells):
        j = i
        while j < len(cells) and cells[j] == cells[i]:
            j += 1
        slot = _find_slot(cells[i], keys)
        keys[slot] = cells[i] + 1
        starts[slot] = i
        ends[slot] = j
        i = j
    return keys, starts, ends


@inner
def find_near_roads(
    position: NDArray[np.float64],
    radius: float,
    roads: Roads,
    grid: RoadGrid,
    near_roads: NDArray[np.int32],
    offsets: NDArray[np.float64],
    distances: NDArray[np.float64],
) -> int:
    """Find the nearest positions on roads within a radius, by increasing distance.

    Writes them to the last three arrays, at most as many as fit, and returns their number. A road
    that comes near twice, such as a hairpin, counts twice if its two positions lie more than the
    radius apart along it.
    """
    # Cells that the circle touches.
    x, y = position[0] - grid.x_min, position[1] - grid.y_min
    first_column = max(math.floor((x - radius) / grid.cell_size), 0)
    last_column = min(math.floor((x + radius) / grid.cell_size), grid.columns - 1)
    first_row = max(math.floor((y - radius) / grid.cell_size), 0)
    last_row = min(math.floor((y + radius) / grid.cell_size), grid.rows - 1)

    # All segments in them that are near; a segment in several cells is hit several times.
    hits, count = np.empty((_FIRST_CAPACITY, 3)), 0
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            slot = _find_slot(row * grid.columns + column, grid.keys)
            if grid.keys[slot] == 0:
                continue
            for entry in range(grid.starts[slot], grid.ends[slot]):
                vertex = grid.vertices[entry]
                square, fraction = project(roads.points, vertex, position)
                if square > radius * radius:
                    continue
                if count == len(hits):
                    hits = np.concatenate((hits, np.empty_like(hits)))
                hits[count, _DISTANCE] = math.sqrt(square)
                hits[count, _ROAD] = grid.roads[entry]
                hits[count, _OFFSET] = roads.along[vertex] + fraction * (
                    roads.along[vertex + 1] - roads.along[vertex]
                )
                count += 1
    return _take_nearest(hits[:count], radius, near_roads, offsets, distances)


@inner_uncounted
def _take_nearest(
    hits: NDArray[np.float64],
    min_spacing: float,
    near_roads: NDArray[np.int32],
    offsets: NDArray[np.float64],
    distances: NDArray[np.float64],
) -> int:
    """Select the nearest hits, without those near a nearer one on the same road.

    Selection sort: few of the hits are needed.
    """
    # Go through the hits from the nearest on, until the capacity is reached.
    count, capacity = 0, len(near_roads)
    for hit in range(len(hits)):
        if count == capacity:
            break

        # Move the next hit to its place in the order.
        best = hit
        for i in range(hit + 1, len(hits)):
            if _is_before(hits, i, best):
                best = i
        for column in range(3):
            hits[hit, column], hits[best, column] = hits[best, column], hits[hit, column]

        # Take it unless a nearer hit stands for it.
        is_known = False
        for i in range(count):
            is_known = is_known or (
                near_roads[i] == hits[hit, _ROAD]
                and abs(offsets[i] - hits[hit, _OFFSET]) <= min_spacing
            )
        if not is_known:
            distances[count] = hits[hit, _DISTANCE]
            near_roads[count] = np.int32(hits[hit, _ROAD])
            offsets[count] = hits[hit, _OFFSET]
            count += 1
    return count


@inner_uncounted
def _is_before(hits: NDArray[np.float64], i: int, j: int) -> bool:
    """Whether hit i comes before hit j: by distance, then road, then offset."""
    for column in range(3):
        if hits[i, column] != hits[j, column]:
            return hits[i, column] < hits[j, column]
    return False


@jit
def nearest_distances(
    positions: NDArray[np.float64], roads: Roads, grid: RoadGrid
) -> NDArray[np.float64]:
    """Distance of each position to the nearest road, infinite where none is within four cells."""
    out = np.full(len(positions), np.inf)
    road, offset, distance = np.empty(1, np.int32), np.empty(1), np.empty(1)
    for i in range(len(positions)):
        radius = _FIRST_RADIUS * grid.cell_size
        for _ in range(_RADII):
            if find_near_roads(positions[i], radius, roads, grid, road, offset, distance):
                out[i] = distance[0]
                break
            radius *= 2
    return out
