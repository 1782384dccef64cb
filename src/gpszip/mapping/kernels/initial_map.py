"""The map under construction: live nodes, how often each step between two is taken, and a grid of cells to find near ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.kernels.pair_table import pair_slot

__all__ = [
    "Draft",
    "count_step",
    "drop",
    "enter_draft",
    "enter_known",
    "enter_nodes",
    "enter_walks",
    "insert",
    "keep_disjoint",
    "lead_clusters",
    "near",
    "room",
    "steps",
    "take_node",
]

#: Numbers kept in ``Draft.scalars``: nodes ever used, nodes on the free list, half-edges, and the first number that may be used again.
NODES, FREE, HALVES, BASE = 0, 1, 2, 3

#: Only so many axes take part in the grid's cells; three keep a search at 27 cells.
_GRID_AXES = 3


class Draft(NamedTuple):
    """State of the map while walks are being moved on it."""

    places: NDArray[np.float64]  # nodes, in quanta
    uses: NDArray[np.int64]  # knots at a node
    free: NDArray[np.int64]  # stack of unused numbers
    leaving: NDArray[np.float64]  # weight of all steps from a node
    head: NDArray[np.int64]  # first half-edge of a node
    following: NDArray[np.int64]
    into: NDArray[np.int64]
    slot_of: NDArray[np.int64]  # slot of a half-edge in the table
    keys: NDArray[np.int64]  # table of pairs of nodes
    counts: NDArray[np.int64]
    buckets: NDArray[np.int64]  # grid: first node of a bucket
    chained: NDArray[np.int64]  # next node of the same bucket
    cell: NDArray[np.float64]  # size of a grid cell
    scalars: NDArray[np.int64]


@jit
def steps(draft: Draft, u: int, v: int) -> int:
    """How often v follows u."""
    return draft.counts[pair_slot(draft.keys, u * (np.int64(1) << 31) + v)]


@jit
def _entry(draft: Draft, u: int, v: int) -> int:
    key = u * (np.int64(1) << 31) + v
    at = pair_slot(draft.keys, key)
    if draft.keys[at] == -1:
        draft.keys[at] = key
        draft.counts[at] = 0
        half = draft.scalars[HALVES]
        draft.scalars[HALVES] = half + 1
        draft.into[half] = v
        draft.slot_of[half] = at
        draft.following[half] = draft.head[u]
        draft.head[u] = half
    return at


@jit
def count_step(draft: Draft, u: int, v: int, change: int) -> None:
    """Count a step from u to v; the way back is entered, too, so that it is found from v."""
    draft.counts[_entry(draft, u, v)] += change
    if u != v:
        _entry(draft, v, u)
        draft.leaving[u] += change
        draft.leaving[v] += 0.5 * change


@jit
def room(draft: Draft) -> int:
    """Number of steps and nodes that still fit."""
    halves = min(len(draft.into), len(draft.keys) * 3 // 4) - draft.scalars[HALVES]
    return min(halves // 2, len(draft.places) - draft.scalars[NODES])


@jit
def _bucket(draft: Draft, place: NDArray[np.float64], shift: int) -> int:
    key = np.int64(17)
    for axis in range(min(len(place), _GRID_AXES)):
        step = shift % 3 - 1
        shift //= 3
        key = key * 1000003 + np.int64(np.floor(place[axis] / draft.cell[0])) + step
    return ((key * 0x9E3779B97F4A7C1) >> 24) & (len(draft.buckets) - 1)


@jit
def insert(draft: Draft, node: int) -> None:
    """Make a node findable by its place."""
    at = _bucket(draft, draft.places[node], 13 if draft.places.shape[1] > 2 else (4 if draft.places.shape[1] == 2 else 1))
    draft.chained[node] = draft.buckets[at]
    draft.buckets[at] = node


@jit
def _remove(draft: Draft, node: int) -> None:
    at = _bucket(draft, draft.places[node], 13 if draft.places.shape[1] > 2 else (4 if draft.places.shape[1] == 2 else 1))
    if draft.buckets[at] == node:
        draft.buckets[at] = draft.chained[node]
        return
    w = draft.buckets[at]
    while w >= 0:
        if draft.chained[w] == node:
            draft.chained[w] = draft.chained[node]
            return
        w = draft.chained[w]


@jit
def take_node(draft: Draft, place: NDArray[np.float64]) -> int:
    """Make a new node."""
    scalars = draft.scalars
    if scalars[FREE] > 0:
        scalars[FREE] -= 1
        node = draft.free[scalars[FREE]]
    else:
        node = scalars[NODES]
        scalars[NODES] += 1
    draft.places[node] = place
    draft.uses[node] = 0
    insert(draft, node)
    return node


@jit
def drop(draft: Draft, node: int) -> None:
    """Forget a node that no knot uses."""
    _remove(draft, node)
    if node >= draft.scalars[BASE]:
        draft.free[draft.scalars[FREE]] = node
        draft.scalars[FREE] += 1


@jit
def near(draft: Draft, place: NDArray[np.float64], most: int, found: NDArray[np.int64], distances: NDArray[np.float64]) -> int:
    """Find at most ``most`` nodes nearest to a place, within one grid cell's size; return how many."""
    dimension = len(place)
    count = 0
    cells = 27 if dimension > 2 else (9 if dimension == 2 else 3)
    reach = draft.cell[0] * draft.cell[0]
    for shift in range(cells):
        node = draft.buckets[_bucket(draft, place, shift)]
        while node >= 0:
            square = 0.0
            for axis in range(dimension):
                off = draft.places[node, axis] - place[axis]
                square += off * off
            if square <= reach:
                i = count
                while i > 0 and (distances[i - 1] > square or (distances[i - 1] == square and found[i - 1] > node)):
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
            node = draft.chained[node]
    return count


@jit
def enter_walks(draft: Draft, slots_at: NDArray[np.int64], lasts: NDArray[np.int64]) -> None:
    """Count the knots and steps of all pieces; ``lasts`` is the last slot of each."""
    piece = 0
    before = -1
    for slot in range(len(slots_at)):
        node = slots_at[slot]
        if node >= 0:
            draft.uses[node] += 1
            if before >= 0:
                count_step(draft, before, node, 1)
            before = node
        if slot == lasts[piece]:
            piece += 1
            before = -1


@jit
def enter_known(draft: Draft, pairs: NDArray[np.int64], counts: NDArray[np.int64]) -> None:
    """Count steps between knots that are not to be moved."""
    for i in range(len(pairs)):
        count_step(draft, pairs[i, 0], pairs[i, 1], counts[i])


@jit
def enter_draft(draft: Draft, other: Draft) -> None:
    """Enter all nodes and steps of another draft into an empty one with more room."""
    count = other.scalars[NODES]
    draft.scalars[:] = other.scalars
    draft.scalars[HALVES] = 0
    draft.places[:count] = other.places[:count]
    draft.uses[:count] = other.uses[:count]
    draft.free[: other.scalars[FREE]] = other.free[: other.scalars[FREE]]
    draft.leaving[:count] = other.leaving[:count]
    for node in range(count):
        if other.uses[node] >= 0:
            insert(draft, node)
        half = other.head[node]
        while half >= 0:
            draft.counts[_entry(draft, node, other.into[half])] = other.counts[other.slot_of[half]]
            half = other.following[half]


@jit
def enter_nodes(draft: Draft, count: int) -> None:
    """Make the first ``count`` nodes findable."""
    for node in range(count):
        insert(draft, node)


@jit
def lead_clusters(draft: Draft, places: NDArray[np.float64], at: NDArray[np.int64]) -> None:
    """Give every knot the nearest node within the draft's reach of its place, or a node of its own."""
    found = np.empty(1, np.int64)
    distances = np.empty(1)
    for slot in range(len(at)):
        if at[slot] >= 0:
            if near(draft, places[slot], 1, found, distances) == 1:
                at[slot] = found[0]
            else:
                at[slot] = take_node(draft, places[slot])


@jit
def keep_disjoint(pairs: NDArray[np.int64], target: NDArray[np.int64]) -> int:
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
