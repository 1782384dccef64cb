"""Roads near a place: straight bits of roads filed by the square cells that they cross, in a hash table."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inlined, jit
from gpszip.matching.kernels.roads import RoadGrid, Roads, project

__all__ = ["count_cells", "fill_cells", "find_near_roads", "hash_cells", "nearest_distances"]

#: Multiplier of Fibonacci hashing, 2 ** 64 over the golden ratio, as a signed number.
_SPREAD = -7046029254386353131


@jit
def _cells_of(
    points: NDArray[np.float64],
    first: int,
    cell: float,
    origin: NDArray[np.float64],
    columns: int,
    out: NDArray[np.int64],
) -> int:
    """Cells that the bit from vertex ``first`` to the next crosses, column by column; return their number."""
    ax, ay = (points[first, 0] - origin[0]) / cell, (points[first, 1] - origin[1]) / cell
    bx, by = (points[first + 1, 0] - origin[0]) / cell, (points[first + 1, 1] - origin[1]) / cell
    if ax > bx:
        ax, ay, bx, by = bx, by, ax, ay
    count = 0
    left, right = math.floor(ax), math.floor(bx)
    for column in range(left, right + 1):
        y0, y1 = ay, by
        if right > left:
            slope = (by - ay) / (bx - ax)
            y0 = ay if column == left else ay + (column - ax) * slope
            y1 = by if column == right else ay + (column + 1 - ax) * slope
        low, high = math.floor(min(y0, y1)), math.floor(max(y0, y1))
        for row in range(low, high + 1):
            if count < len(out):
                out[count] = row * columns + column
            count += 1
    return count


@jit
def count_cells(
    points: NDArray[np.float64],
    offsets: NDArray[np.int64],
    cell: float,
    origin: NDArray[np.float64],
    columns: int,
) -> int:
    """Number of entries that :func:`fill_cells` makes."""
    nothing = np.empty(0, np.int64)
    total = 0
    for road in range(len(offsets) - 1):
        for first in range(offsets[road], offsets[road + 1] - 1):
            total += _cells_of(points, first, cell, origin, columns, nothing)
    return total


@jit
def fill_cells(
    points: NDArray[np.float64],
    offsets: NDArray[np.int64],
    cell: float,
    origin: NDArray[np.float64],
    columns: int,
    total: int,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]:
    """Cell, first vertex and road of every bit of road in every cell that it crosses."""
    cells, firsts, roads = (
        np.empty(total, np.int64),
        np.empty(total, np.int32),
        np.empty(total, np.int32),
    )
    at = 0
    for road in range(len(offsets) - 1):
        for first in range(offsets[road], offsets[road + 1] - 1):
            count = _cells_of(points, first, cell, origin, columns, cells[at:])
            firsts[at : at + count] = first
            roads[at : at + count] = road
            at += count
    return cells, firsts, roads


@jit
def _slot(cell: int, table: NDArray[np.int64]) -> int:
    """Slot of a hash table (cell numbers plus one, 0 for empty) that holds a cell, or the empty one where it would be."""
    mask = len(table) - 1
    mixed = np.int64(cell) * np.int64(_SPREAD)
    slot = (mixed ^ (mixed >> 29)) & mask
    while table[slot] != 0 and table[slot] != cell + 1:
        slot = (slot + 1) & mask
    return slot


@jit
def hash_cells(
    cells: NDArray[np.int64], size: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Hash table over sorted cells: the cells, and where each one's run begins and ends. ``size`` is a power of two."""
    table, begins, ends = (
        np.zeros(size, np.int64),
        np.zeros(size, np.int64),
        np.zeros(size, np.int64),
    )
    i = 0
    while i < len(cells):
        j = i
        while j < len(cells) and cells[j] == cells[i]:
            j += 1
        slot = _slot(cells[i], table)
        table[slot], begins[slot], ends[slot] = cells[i] + 1, i, j
        i = j
    return table, begins, ends


@jit
def find_near_roads(
    at: NDArray[np.float64],
    radius: float,
    roads: Roads,
    cells: RoadGrid,
    found: NDArray[np.int32],
    offsets: NDArray[np.float64],
    distances: NDArray[np.float64],
) -> int:
    """Nearest places on the roads within a radius, by increasing distance, into the last three arrays; return their number.

    A road that comes by twice, such as a hairpin, counts twice if the two places lie more than the radius apart along it.
    """
    x, y = at[0] - cells.left, at[1] - cells.low
    left, right = (
        max(math.floor((x - radius) / cells.size), 0),
        min(math.floor((x + radius) / cells.size), cells.columns - 1),
    )
    low, high = (
        max(math.floor((y - radius) / cells.size), 0),
        min(math.floor((y + radius) / cells.size), cells.rows - 1),
    )
    near, hits = np.empty((64, 3)), 0
    for row in range(low, high + 1):
        for column in range(left, right + 1):
            slot = _slot(row * cells.columns + column, cells.table)
            if cells.table[slot] == 0:
                continue
            for entry in range(cells.begins[slot], cells.ends[slot]):
                first = cells.firsts[entry]
                square, share = project(roads.points, first, at)
                if square > radius * radius:
                    continue
                if hits == len(near):
                    near = np.concatenate((near, np.empty_like(near)))
                near[hits, 0], near[hits, 1] = math.sqrt(square), cells.owners[entry]
                near[hits, 2] = roads.along[first] + share * (
                    roads.along[first + 1] - roads.along[first]
                )
                hits += 1
    return _nearest(near[:hits], radius, found, offsets, distances)


@jit
def _nearest(
    found: NDArray[np.float64],
    apart: float,
    roads: NDArray[np.int32],
    offsets: NDArray[np.float64],
    distances: NDArray[np.float64],
) -> int:
    """Take distance, road and offset of the nearest places; those near one on the same road go without saying."""
    count, most = 0, len(roads)
    for hit in range(len(found)):
        if count == most:
            break
        best = hit
        for i in range(hit + 1, len(found)):
            if _before(found, i, best):
                best = i
        for axis in range(3):
            found[hit, axis], found[best, axis] = found[best, axis], found[hit, axis]
        stands = False
        for i in range(count):
            stands = stands or (
                roads[i] == found[hit, 1] and abs(offsets[i] - found[hit, 2]) <= apart
            )
        if not stands:
            distances[count], roads[count], offsets[count] = (
                found[hit, 0],
                np.int32(found[hit, 1]),
                found[hit, 2],
            )
            count += 1
    return count


@inlined
def _before(found: NDArray[np.float64], i: int, j: int) -> bool:
    """Whether hit i comes before hit j: by distance, then road, then offset."""
    for axis in range(3):
        if found[i, axis] != found[j, axis]:
            return found[i, axis] < found[j, axis]
    return False


@jit
def nearest_distances(
    positions: NDArray[np.float64], roads: Roads, cells: RoadGrid
) -> NDArray[np.float64]:
    """Distance of each place to the nearest road, infinite where none is within a few cells."""
    out = np.full(len(positions), np.inf)
    road, offset, distance = np.empty(1, np.int32), np.empty(1), np.empty(1)
    for i in range(len(positions)):
        radius = 0.5 * cells.size
        for _ in range(4):
            if find_near_roads(positions[i], radius, roads, cells, road, offset, distance):
                out[i] = distance[0]
                break
            radius *= 2
    return out
