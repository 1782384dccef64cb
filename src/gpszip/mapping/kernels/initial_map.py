"""The map under construction: nodes in use, step counts, and a hash grid to find near nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.copying import copy_values
from gpszip.kernels.jit import inner_uncounted, jit, jit_uncounted
from gpszip.kernels.pair_table import find_pair_slot

__all__ = [
    "FIRST_REUSABLE",
    "FREE_COUNT",
    "HALF_EDGE_COUNT",
    "NODE_COUNT",
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

#: Index in ``WorkingMap.counters`` of the number of nodes ever made.
NODE_COUNT = 0
#: Index of the number of node numbers on the stack of free ones.
FREE_COUNT = 1
#: Index of the number of half-edges.
HALF_EDGE_COUNT = 2
#: Index of the first node number that may be used again once its node is released.
FIRST_REUSABLE = 3

#: Axes that take part in the hash grid's cells; three keep a search at 27 cells.
_GRID_AXES = 3


class WorkingMap(NamedTuple):
    """State of the map while knots are assigned; a half-edge is one direction of an edge."""

    positions: NDArray[np.float64]  # of the nodes, in grid steps
    uses: NDArray[np.int64]  # knots at each node; -1 for a released one
    free: NDArray[np.int64]  # stack of node numbers to use again
    outgoing_weight: NDArray[np.float64]  # weight of all steps from each node
    first_half_edge: NDArray[np.int64]  # of each node, or -1
    next_half_edge: NDArray[np.int64]  # of the same node, or -1
    end_node: NDArray[np.int64]  # node that each half-edge leads to
    table_index: NDArray[np.int64]  # entry of each half-edge in the table of pairs
    pair_keys: NDArray[np.int64]  # hash table of pairs of nodes
    pair_counts: NDArray[np.int64]  # steps from the first node of each pair to the second
    first_in_bucket: NDArray[np.int64]  # hash grid: first node of each bucket, or -1
    next_in_bucket: NDArray[np.int64]  # next node of the same bucket, or -1
    cell_size: float  # of the hash grid, in grid steps
    counters: NDArray[np.int64]  # by the indices above


@inner_uncounted
def step_count(working_map: WorkingMap, u: int, v: int) -> int:
    """Count the steps from u to v."""
    return working_map.pair_counts[
        find_pair_slot(working_map.pair_keys, u * (np.int64(1) << 31) + v)
    ]


@inner_uncounted
def _find_or_add_pair(working_map: WorkingMap, u: int, v: int) -> int:
    """Index of a pair in the table; a new pair gets a half-edge from u to v."""
    key = u * (np.int64(1) << 31) + v
    index = find_pair_slot(working_map.pair_keys, key)
    if working_map.pair_keys[index] == -1:
        working_map.pair_keys[index] = key
        working_map.pair_counts[index] = 0
        half = working_map.counters[HALF_EDGE_COUNT]
        working_map.counters[HALF_EDGE_COUNT] = half + 1
        working_map.end_node[half] = v
        working_map.table_index[half] = index
        working_map.next_half_edge[half] = working_map.first_half_edge[u]
        working_map.first_half_edge[u] = half
    return index


@inner_uncounted
def count_step(working_map: WorkingMap, u: int, v: int, change: int) -> None:
    """Change the count of steps from u to v.

    The reverse direction gets a half-edge, too, so that the step is found from v. It weighs half.
    """
    working_map.pair_counts[_find_or_add_pair(working_map, u, v)] += change
    if u != v:
        _find_or_add_pair(working_map, v, u)
        working_map.outgoing_weight[u] += change
        working_map.outgoing_weight[v] += 0.5 * change


@inner_uncounted
def free_capacity(working_map: WorkingMap) -> int:
    """Number of steps and nodes that still fit."""
    # A hash table is slow when it is more than three quarters full.
    half_edges = (
        min(len(working_map.end_node), len(working_map.pair_keys) * 3 // 4)
        - working_map.counters[HALF_EDGE_COUNT]
    )
    return min(half_edges // 2, len(working_map.positions) - working_map.counters[NODE_COUNT])


@inner_uncounted
def _find_bucket(working_map: WorkingMap, position: NDArray[np.float64], neighbour: int) -> int:
    """Bucket of a cell next to a position: a digit to base 3 for each axis, 1 for its own cell."""
    key = np.int64(17)
    for axis in range(min(len(position), _GRID_AXES)):
        shift = neighbour % 3 - 1
        neighbour //= 3
        key = key * 1000003 + np.int64(np.floor(position[axis] / working_map.cell_size)) + shift
    return ((key * 0x9E3779B97F4A7C1) >> 24) & (len(working_map.first_in_bucket) - 1)


@inner_uncounted
def _find_own_bucket(working_map: WorkingMap, node: int) -> int:
    """Bucket of a node: neighbour 111, 11 or 1 to base 3."""
    dimension = working_map.positions.shape[1]
    neighbour = 13 if dimension > 2 else (4 if dimension == 2 else 1)
    return _find_bucket(working_map, working_map.positions[node], neighbour)


@inner_uncounted
def index_node(working_map: WorkingMap, node: int) -> None:
    """Enter a node into the hash grid."""
    bucket = _find_own_bucket(working_map, node)
    working_map.next_in_bucket[node] = working_map.first_in_bucket[bucket]
    working_map.first_in_bucket[bucket] = node


@inner_uncounted
def _unindex_node(working_map: WorkingMap, node: int) -> None:
    """Remove a node from the hash grid."""
    bucket = _find_own_bucket(working_map, node)
    if working_map.first_in_bucket[bucket] == node:
        working_map.first_in_bucket[bucket] = working_map.next_in_bucket[node]
        return

    w = working_map.first_in_bucket[bucket]
    while w >= 0:
        if working_map.next_in_bucket[w] == node:
            working_map.next_in_bucket[w] = working_map.next_in_bucket[node]
            return
        w = working_map.next_in_bucket[w]


@inner_uncounted
def add_node(working_map: WorkingMap, position: NDArray[np.float64]) -> int:
    """Make a new node and return its number."""
    counters = working_map.counters
    if counters[FREE_COUNT] > 0:
        counters[FREE_COUNT] -= 1
        node = working_map.free[counters[FREE_COUNT]]
    else:
        node = counters[NODE_COUNT]
        counters[NODE_COUNT] += 1

    copy_values(position, working_map.positions[node])
    working_map.uses[node] = 0
    index_node(working_map, node)
    return node


@inner_uncounted
def release_node(working_map: WorkingMap, node: int) -> None:
    """Remove a node that no knot uses."""
    _unindex_node(working_map, node)
    if node >= working_map.counters[FIRST_REUSABLE]:
        working_map.free[working_map.counters[FREE_COUNT]] = node
        working_map.counters[FREE_COUNT] += 1


@inner_uncounted
def find_near_nodes(
    working_map: WorkingMap,
    position: NDArray[np.float64],
    max_near: int,
    near: NDArray[np.int64],
    distances: NDArray[np.float64],
) -> int:
    """Find the nodes nearest to a position, within one cell size of the hash grid.

    Parameters
    ----------
    max_near : int
        Largest number of nodes.
    near, distances : arrays, shape (at least max_near,)
        Receive the nodes and their squared distances, the nearest first; among nodes at the same
        distance, the lowest number first.

    Returns
    -------
    int
        Number of nodes.
    """
    # Search the hash grid's cell of the position and the cells next to it: they hold all nodes
    # within one cell size.
    dimension = len(position)
    count = 0
    cells = 27 if dimension > 2 else (9 if dimension == 2 else 3)
    max_square = working_map.cell_size * working_map.cell_size
    for neighbour in range(cells):
        node = working_map.first_in_bucket[_find_bucket(working_map, position, neighbour)]
        while node >= 0:
            square = 0.0
            for axis in range(dimension):
                offset = working_map.positions[node, axis] - position[axis]
                square += offset * offset

            # Insert a node within reach by its distance; a full list drops its farthest node.
            if square <= max_square:
                # Find the rank of the node among those found so far.
                i = count
                while i > 0 and (
                    distances[i - 1] > square or (distances[i - 1] == square and near[i - 1] > node)
                ):
                    i -= 1

                # Two cells may share a bucket: the node may be listed already.
                is_listed = False
                for j in range(count):
                    is_listed |= near[j] == node
                if not is_listed and i < max_near:
                    for j in range(min(count, max_near - 1), i, -1):
                        near[j] = near[j - 1]
                        distances[j] = distances[j - 1]
                    near[i] = node
                    distances[i] = square
                    count = min(count + 1, max_near)
            node = working_map.next_in_bucket[node]
    return count


@jit_uncounted
def count_walks(
    working_map: WorkingMap, slot_nodes: NDArray[np.int64], last_slots: NDArray[np.int64]
) -> None:
    """Count the knots and steps of all pieces; ``last_slots`` is the last slot of each."""
    piece = 0
    before = -1
    for slot in range(len(slot_nodes)):
        node = slot_nodes[slot]
        if node >= 0:
            working_map.uses[node] += 1
            if before >= 0:
                count_step(working_map, before, node, 1)
            before = node

        # No step leads across a gap.
        if slot == last_slots[piece]:
            piece += 1
            before = -1


@jit_uncounted
def count_prior_steps(
    working_map: WorkingMap, pairs: NDArray[np.int64], counts: NDArray[np.int64]
) -> None:
    """Count the steps of prior walks, which stay as they are."""
    for i in range(len(pairs)):
        count_step(working_map, pairs[i, 0], pairs[i, 1], counts[i])


@jit_uncounted
def copy_working_map(working_map: WorkingMap, source: WorkingMap) -> None:
    """Copy all nodes and steps of a map into an empty one with more capacity."""
    # Copy the nodes; half-edges are counted again below.
    count = source.counters[NODE_COUNT]
    copy_values(source.counters, working_map.counters)
    working_map.counters[HALF_EDGE_COUNT] = 0
    for node in range(count):
        copy_values(source.positions[node], working_map.positions[node])
    copy_values(source.uses, working_map.uses[:count])
    copy_values(source.free, working_map.free[: source.counters[FREE_COUNT]])
    copy_values(source.outgoing_weight, working_map.outgoing_weight[:count])

    # Enter nodes and half-edges into the larger hash tables.
    for node in range(count):
        if source.uses[node] >= 0:
            index_node(working_map, node)
        half = source.first_half_edge[node]
        while half >= 0:
            index = _find_or_add_pair(working_map, node, source.end_node[half])
            working_map.pair_counts[index] = source.pair_counts[source.table_index[half]]
            half = source.next_half_edge[half]


@jit_uncounted
def index_nodes(working_map: WorkingMap, count: int) -> None:
    """Enter the first ``count`` nodes into the hash grid."""
    for node in range(count):
        index_node(working_map, node)


@jit
def cluster_by_leader(
    working_map: WorkingMap, positions: NDArray[np.float64], slot_nodes: NDArray[np.int64]
) -> None:
    """Leader clustering: each knot takes the nearest node within a cell size, or becomes a node.

    Parameters
    ----------
    positions : float64 array, shape (S, d)
        Position of each slot, in grid steps.
    slot_nodes : int64 array, shape (S,)
        -1 where a slot carries no knot, else receives the node; changed in place.
    """
    near = np.empty(1, np.int64)
    distances = np.empty(1)
    for slot in range(len(slot_nodes)):
        if slot_nodes[slot] >= 0:
            if find_near_nodes(working_map, positions[slot], 1, near, distances) == 1:
                slot_nodes[slot] = near[0]
            else:
                slot_nodes[slot] = add_node(working_map, positions[slot])


@jit
def merge_disjoint_pairs(pairs: NDArray[np.int64], target: NDArray[np.int64]) -> int:
    """Merge the second node of each pair into the first, in the order given.

    A pair is left out if one of its nodes took part in an earlier merge.

    Returns
    -------
    int
        Number of merges.
    """
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
