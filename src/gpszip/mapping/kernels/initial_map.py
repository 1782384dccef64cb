"""The map under construction: live nodes, how often each step between two is taken, and a grid of cells to find near ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.kernels.pair_table import find_pair_slot

__all__ = [
    "WorkingMap",
    "add_node",
    "cluster_by_leader",
    "copy_working_map",
    "count_prior_steps",
    "count_step",
    "count_walks",
    "find_near_nodes",
    "free_capacity",
    "index_node",
    "index_nodes",
    "merge_disjoint_pairs",
    "release_node",
    "step_count",
]

#: Numbers kept in ``Draft.scalars``: nodes ever used, nodes on the free list, half-edges, and the first number that may be used again.
NODES, FREE, HALVES, BASE = 0, 1, 2, 3

#: Only so many axes take part in the grid's cells; three keep a search at 27 cells.
_GRID_AXES = 3


class WorkingMap(NamedTuple):
    """State of the map while walks are being moved on it."""

    positions: NDArray[np.float64]  # nodes, in quanta
    uses: NDArray[np.int64]  # knots at a node
    free: NDArray[np.int64]  # stack of unused numbers
    outgoing_weight: NDArray[np.float64]  # weight of all steps from a node
    first_half_edge: NDArray[np.int64]  # first half-edge of a node
    next_half_edge: NDArray[np.int64]
    into: NDArray[np.int64]
    table_index: NDArray[np.int64]  # slot of a half-edge in the table
    keys: NDArray[np.int64]  # table of pairs of nodes
    counts: NDArray[np.int64]
    buckets: NDArray[np.int64]  # grid: first node of a bucket
    next_in_bucket: NDArray[np.int64]  # next node of the same bucket
    bucket_size: NDArray[np.float64]  # size of a grid cell
    scalars: NDArray[np.int64]


@jit
def step_count(working_map: WorkingMap, u: int, v: int) -> int:
    """How often v follows u."""
    return working_map.counts[find_pair_slot(working_map.keys, u * (np.int64(1) << 31) + v)]


@jit
def _entry(working_map: WorkingMap, u: int, v: int) -> int:
    key = u * (np.int64(1) << 31) + v
    at = find_pair_slot(working_map.keys, key)
    if working_map.keys[at] == -1:
        working_map.keys[at] = key
        working_map.counts[at] = 0
        half = working_map.scalars[HALVES]
        working_map.scalars[HALVES] = half + 1
        working_map.into[half] = v
        working_map.table_index[half] = at
        working_map.next_half_edge[half] = working_map.first_half_edge[u]
        working_map.first_half_edge[u] = half
    return at


@jit
def count_step(working_map: WorkingMap, u: int, v: int, change: int) -> None:
    """Count a step from u to v; the way back is entered, too, so that it is found from v."""
    working_map.counts[_entry(working_map, u, v)] += change
    if u != v:
        _entry(working_map, v, u)
        working_map.outgoing_weight[u] += change
        working_map.outgoing_weight[v] += 0.5 * change


@jit
def free_capacity(working_map: WorkingMap) -> int:
    """Number of steps and nodes that still fit."""
    halves = (
        min(len(working_map.into), len(working_map.keys) * 3 // 4) - working_map.scalars[HALVES]
    )
    return min(halves // 2, len(working_map.positions) - working_map.scalars[NODES])


@jit
def _bucket(working_map: WorkingMap, place: NDArray[np.float64], shift: int) -> int:
    key = np.int64(17)
    for axis in range(min(len(place), _GRID_AXES)):
        step = shift % 3 - 1
        shift //= 3
        key = key * 1000003 + np.int64(np.floor(place[axis] / working_map.bucket_size[0])) + step
    return ((key * 0x9E3779B97F4A7C1) >> 24) & (len(working_map.buckets) - 1)


@jit
def index_node(working_map: WorkingMap, node: int) -> None:
    """Make a node findable by its place."""
    at = _bucket(
        working_map,
        working_map.positions[node],
        13
        if working_map.positions.shape[1] > 2
        else (4 if working_map.positions.shape[1] == 2 else 1),
    )
    working_map.next_in_bucket[node] = working_map.buckets[at]
    working_map.buckets[at] = node


@jit
def _unindex_node(working_map: WorkingMap, node: int) -> None:
    at = _bucket(
        working_map,
        working_map.positions[node],
        13
        if working_map.positions.shape[1] > 2
        else (4 if working_map.positions.shape[1] == 2 else 1),
    )
    if working_map.buckets[at] == node:
        working_map.buckets[at] = working_map.next_in_bucket[node]
        return
    w = working_map.buckets[at]
    while w >= 0:
        if working_map.next_in_bucket[w] == node:
            working_map.next_in_bucket[w] = working_map.next_in_bucket[node]
            return
        w = working_map.next_in_bucket[w]


@jit
def add_node(working_map: WorkingMap, place: NDArray[np.float64]) -> int:
    """Make a new node."""
    scalars = working_map.scalars
    if scalars[FREE] > 0:
        scalars[FREE] -= 1
        node = working_map.free[scalars[FREE]]
    else:
        node = scalars[NODES]
        scalars[NODES] += 1
    working_map.positions[node] = place
    working_map.uses[node] = 0
    index_node(working_map, node)
    return node


@jit
def release_node(working_map: WorkingMap, node: int) -> None:
    """Forget a node that no knot uses."""
    _unindex_node(working_map, node)
    if node >= working_map.scalars[BASE]:
        working_map.free[working_map.scalars[FREE]] = node
        working_map.scalars[FREE] += 1


@jit
def find_near_nodes(
    working_map: WorkingMap,
    place: NDArray[np.float64],
    most: int,
    found: NDArray[np.int64],
    distances: NDArray[np.float64],
) -> int:
    """Find at most ``most`` nodes nearest to a place, within one grid cell's size; return how many."""
    dimension = len(place)
    count = 0
    cells = 27 if dimension > 2 else (9 if dimension == 2 else 3)
    reach = working_map.bucket_size[0] * working_map.bucket_size[0]
    for shift in range(cells):
        node = working_map.buckets[_bucket(working_map, place, shift)]
        while node >= 0:
            square = 0.0
            for axis in range(dimension):
                off = working_map.positions[node, axis] - place[axis]
                square += off * off
            if square <= reach:
                i = count
                while i > 0 and (
                    distances[i - 1] > square
                    or (distances[i - 1] == square and found[i - 1] > node)
                ):
                    i -= 1
                known = False
                for other in range(count):
                    known |= found[other] == node
                if not known and i < most:
                    for other in range(min(count, most - 1), i, -1):
                        found[other] = found[other - 1]
                        distances[other] = distances[other - 1]
                    found[i] = node
                    distances[i] = square
                    count = min(count + 1, most)
            node = working_map.next_in_bucket[node]
    return count


@jit
def count_walks(
    working_map: WorkingMap, slots_at: NDArray[np.int64], last_slots: NDArray[np.int64]
) -> None:
    """Count the knots and steps of all pieces; ``lasts`` is the last slot of each."""
    piece = 0
    before = -1
    for slot in range(len(slots_at)):
        node = slots_at[slot]
        if node >= 0:
            working_map.uses[node] += 1
            if before >= 0:
                count_step(working_map, before, node, 1)
            before = node
        if slot == last_slots[piece]:
            piece += 1
            before = -1


@jit
def count_prior_steps(
    working_map: WorkingMap, pairs: NDArray[np.int64], counts: NDArray[np.int64]
) -> None:
    """Count steps between knots that are not to be moved."""
    for i in range(len(pairs)):
        count_step(working_map, pairs[i, 0], pairs[i, 1], counts[i])


@jit
def copy_working_map(working_map: WorkingMap, other: WorkingMap) -> None:
    """Enter all nodes and steps of another draft into an empty one with more room."""
    count = other.scalars[NODES]
    working_map.scalars[:] = other.scalars
    working_map.scalars[HALVES] = 0
    working_map.positions[:count] = other.positions[:count]
    working_map.uses[:count] = other.uses[:count]
    working_map.free[: other.scalars[FREE]] = other.free[: other.scalars[FREE]]
    working_map.outgoing_weight[:count] = other.outgoing_weight[:count]
    for node in range(count):
        if other.uses[node] >= 0:
            index_node(working_map, node)
        half = other.first_half_edge[node]
        while half >= 0:
            working_map.counts[_entry(working_map, node, other.into[half])] = other.counts[
                other.table_index[half]
            ]
            half = other.next_half_edge[half]


@jit
def index_nodes(working_map: WorkingMap, count: int) -> None:
    """Make the first ``count`` nodes findable."""
    for node in range(count):
        index_node(working_map, node)


@jit
def cluster_by_leader(
    working_map: WorkingMap, positions: NDArray[np.float64], at: NDArray[np.int64]
) -> None:
    """Give every knot the nearest node within the draft's reach of its place, or a node of its own."""
    found = np.empty(1, np.int64)
    distances = np.empty(1)
    for slot in range(len(at)):
        if at[slot] >= 0:
            if find_near_nodes(working_map, positions[slot], 1, found, distances) == 1:
                at[slot] = found[0]
            else:
                at[slot] = add_node(working_map, positions[slot])


@jit
def merge_disjoint_pairs(pairs: NDArray[np.int64], target: NDArray[np.int64]) -> int:
    """Merge the second node of each pair into the first, in the order given, unless either took part already; return how many."""
    taken = np.zeros(len(target), np.bool_)
    count = 0
    for i in range(len(pairs)):
        u, v = pairs[i, 0], pairs[i, 1]
        if not taken[u] and not taken[v]:
            taken[u] = True
            taken[v] = True
            target[v] = u
            count += 1
    return count
