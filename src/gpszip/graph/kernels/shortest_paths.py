"""Dijkstra's search with canonical ties, grown step by step, and the walks that its trees give back.

Among equally short paths the one whose nodes come first in lexicographic order is taken (thesis, definition 4.1.9), and
among parallel edges of equal weight the one with the smallest index. Weights are positive integers, so ties are exact
and every part of a canonical path is canonical itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import jit

__all__ = [
    "NO_PATH",
    "TOO_LONG",
    "UNBOUNDED",
    "Arcs",
    "DijkstraSearch",
    "expand_waypoints",
    "find_waypoints_by_bisection",
    "find_waypoints_greedily",
    "follow_canonical_path",
    "new_search",
    "settle_next",
    "settle_node",
    "settle_targets",
    "settle_within",
    "start_search",
    "write_canonical_path",
]

#: A radius that no path exceeds: weights are chosen so that even a path through all nodes stays below.
UNBOUNDED = 1 << 62

#: Answers of the functions that write walks, below every entry of ``edges``.
NO_PATH, TOO_LONG = -3, -4


class Arcs(NamedTuple):
    """Arcs of a graph in order of their source; those of node v are ``offsets[v]`` to ``offsets[v + 1] - 1``."""

    offsets: NDArray[np.int64]
    targets: NDArray[np.int32]
    weights: NDArray[np.int64]
    edges: NDArray[np.int32]
    ranks: NDArray[np.int32]


class DijkstraSearch(NamedTuple):
    """Work arrays of one search after another; ``stamp`` says which entries belong to the present one.

    ``state`` holds the stamp of the present search, the size of the heap, the number of settled nodes in ``order``,
    and how many a search may settle, at least 1; others as far as the last of them are settled too.
    """

    distance: NDArray[np.int64]
    parent: NDArray[np.int32]
    arc: NDArray[np.int64]
    stamp: NDArray[np.int64]
    order: NDArray[np.int32]
    keys: NDArray[np.int64]
    heap: NDArray[np.int32]
    state: NDArray[np.int64]


def new_search(nodes: int, arcs: int, breadth: int) -> DijkstraSearch:
    """Work arrays for graphs with at most this many nodes and arcs, and searches that settle ``breadth`` nodes."""
    return DijkstraSearch(
        np.zeros(nodes, np.int64),
        np.zeros(nodes, np.int32),
        np.zeros(nodes, np.int64),
        np.zeros(nodes, np.int64),
        np.zeros(nodes, np.int32),
        np.zeros(arcs + 1, np.int64),
        np.zeros(arcs + 1, np.int32),
        np.array([0, 0, 0, breadth], np.int64),
    )


@jit
def _comes_first(arcs: Arcs, search: DijkstraSearch, one: int, other: int, node: int) -> bool:
    # The two paths part below their last common node; the nodes right after it decide.
    after_one = after_other = node
    while one != other:
        if search.distance[one] >= search.distance[other]:
            after_one, one = one, search.parent[one]
        else:
            after_other, other = other, search.parent[other]
    return bool(arcs.ranks[after_one] < arcs.ranks[after_other])


@jit
def _relax_arcs(arcs: Arcs, search: DijkstraSearch, node: int) -> None:
    stamp = search.state[0]
    for arc in range(arcs.offsets[node], arcs.offsets[node + 1]):
        target = arcs.targets[arc]
        if search.stamp[target] == stamp + 1:
            continue
        length = search.distance[node] + arcs.weights[arc]
        known = search.stamp[target] == stamp
        if known and length > search.distance[target]:
            continue
        if known and length == search.distance[target]:
            # Of parallel arcs the first stays: their paths never part.
            if not _comes_first(arcs, search, node, search.parent[target], target):
                continue
        else:
            search.state[1] = push(search.keys, search.heap, search.state[1], length, target)
        search.stamp[target] = stamp
        search.distance[target] = length
        search.parent[target] = node
        search.arc[target] = arc


@jit
def start_search(search: DijkstraSearch, source: int) -> None:
    """Forget the last search and begin one at ``source``."""
    search.state[0] += 2  # stamp: reached; stamp + 1: settled
    search.state[1] = push(search.keys, search.heap, 0, 0, source)
    search.state[2] = 0
    search.stamp[source] = search.state[0]
    search.distance[source] = 0
    search.parent[source] = -1
    search.arc[source] = -1


@jit
def _within_breadth(search: DijkstraSearch) -> bool:
    # Nodes as far as the last one allowed still count: which of them comes first is an accident of the heap.
    settled, breadth = search.state[2], search.state[3]
    return bool(settled < breadth or search.keys[0] == search.distance[search.order[breadth - 1]])


@jit
def settle_next(arcs: Arcs, search: DijkstraSearch, radius: int) -> int:
    """Settle the nearest open node within ``radius`` and return it, or -1 if there is none."""
    while search.state[1] > 0 and search.keys[0] <= radius and _within_breadth(search):
        node, search.state[1] = pop(search.keys, search.heap, search.state[1])
        if search.stamp[node] == search.state[0]:
            search.stamp[node] += 1
            search.order[search.state[2]] = node
            search.state[2] += 1
            _relax_arcs(arcs, search, node)
            return int(node)
    return -1


@jit
def settle_node(arcs: Arcs, search: DijkstraSearch, node: int, radius: int) -> bool:
    """Grow the search until ``node`` is settled; False if it is not within ``radius``."""
    while search.stamp[node] != search.state[0] + 1:
        if settle_next(arcs, search, radius) < 0:
            return False
    return True


@jit
def settle_within(arcs: Arcs, search: DijkstraSearch, source: int, radius: int) -> None:
    """Settle everything within ``radius`` of ``source``."""
    start_search(search, source)
    while settle_next(arcs, search, radius) >= 0:
        pass


@jit
def settle_targets(
    arcs: Arcs, search: DijkstraSearch, source: int, targets: NDArray[np.int32], radius: int
) -> NDArray[np.int64]:
    """Distances from ``source`` to each target; -1 for those farther than ``radius``."""
    start_search(search, source)
    found = np.full(len(targets), -1, np.int64)
    for place in range(len(targets)):
        if settle_node(arcs, search, targets[place], radius):
            found[place] = search.distance[targets[place]]
    return found


@jit
def follow_canonical_path(
    arcs: Arcs,
    search: DijkstraSearch,
    nodes: NDArray[np.int32],
    edges: NDArray[np.int32],
    first: int,
    last: int,
) -> int:
    """Farthest knot up to ``last`` that the walk reaches from knot ``first`` along canonical paths alone.

    The tree of the first node is grown only as far as the walk follows it. It follows where ``pred[q_{j+1}] = q_j``
    (theory, section 5); the first knot at which it doesn't ends the longest prefix, for later ones can't hold either.
    """
    start_search(search, nodes[first])
    for knot in range(first, last):
        node = nodes[knot + 1]
        # Unsettled, the next node lies no farther than over the edge from the present one: the search stays within the walk's own length.
        if edges[knot] < 0 or not settle_node(arcs, search, node, UNBOUNDED):
            return knot
        if search.parent[node] != nodes[knot] or arcs.edges[search.arc[node]] != edges[knot]:
            return knot
    return last


@jit
def find_waypoints_greedily(
    arcs: Arcs, search: DijkstraSearch, nodes: NDArray[np.int32], edges: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Knots of the fewest waypoints, and which hops between them are canonical paths rather than single hops that are none."""
    last = len(nodes) - 1
    knots = np.zeros(len(nodes), np.int64)
    paths = np.zeros(last, np.bool_)
    count = 0
    while knots[count] < last:
        knot = knots[count]
        reached = follow_canonical_path(arcs, search, nodes, edges, knot, last)
        paths[count] = reached > knot
        knots[count + 1] = max(reached, knot + 1)
        count += 1
    return knots[: count + 1].copy(), paths[:count].copy()


@jit
def find_waypoints_by_bisection(
    arcs: Arcs, search: DijkstraSearch, nodes: NDArray[np.int32], edges: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The same by recursive halving (thesis, algorithm 6); both halves keep the middle knot."""
    last = len(nodes) - 1
    knots = np.zeros(len(nodes), np.int64)
    paths = np.zeros(last, np.bool_)
    reach = np.full(len(nodes), -1, np.int64)
    ends = np.full(len(nodes), last, np.int64)
    depth = 1 if last > 0 else 0
    count = 0
    while depth > 0:
        first, end = knots[count], ends[depth - 1]
        if reach[first] < 0:
            # Halves that start here later on are shorter: where this prefix ends is all that they need.
            reach[first] = follow_canonical_path(arcs, search, nodes, edges, first, end)
        if reach[first] >= end or end == first + 1:
            paths[count] = reach[first] >= end
            knots[count + 1] = end
            count += 1
            depth -= 1
        else:
            ends[depth] = (first + end) >> 1
            depth += 1
    return knots[: count + 1].copy(), paths[:count].copy()


@jit
def write_canonical_path(
    arcs: Arcs,
    search: DijkstraSearch,
    source: int,
    target: int,
    nodes: NDArray[np.int32],
    edges: NDArray[np.int32],
    begin: int,
) -> int:
    """Write the canonical path behind knot ``begin``; return the knot of its end, NO_PATH or TOO_LONG."""
    start_search(search, source)
    if source == target or not settle_node(arcs, search, target, UNBOUNDED):
        return NO_PATH
    end = begin
    node = target
    while node != source:
        node = search.parent[node]
        end += 1
    if end >= len(nodes):
        return TOO_LONG
    node = target
    for knot in range(end, begin, -1):
        nodes[knot] = node
        edges[knot - 1] = arcs.edges[search.arc[node]]
        node = search.parent[node]
    return end


@jit
def expand_waypoints(
    arcs: Arcs,
    search: DijkstraSearch,
    waypoints: NDArray[np.int32],
    literals: NDArray[np.int32],
    nodes: NDArray[np.int32],
    edges: NDArray[np.int32],
) -> tuple[int, int]:
    """Write the whole walk; return its last knot, NO_PATH or TOO_LONG, and the waypoint reached by then.

    A literal is the entry of ``edges`` for a single hop, or NO_PATH where the canonical path is meant.
    """
    knot = 0
    nodes[0] = waypoints[0]
    for hop in range(len(literals)):
        if literals[hop] == NO_PATH:
            knot = write_canonical_path(
                arcs, search, waypoints[hop], waypoints[hop + 1], nodes, edges, knot
            )
            if knot < 0:
                return knot, hop + 1
        elif knot + 1 >= len(nodes):
            return TOO_LONG, hop + 1
        else:
            knot += 1
            nodes[knot] = waypoints[hop + 1]
            edges[knot - 1] = literals[hop]
    return knot, len(literals)
