"""Dijkstra's search with canonical ties, and the compression of walks to waypoints.

Among equally short paths, the canonical one has the lexicographically first nodes (thesis,
definition 4.1.9). Among parallel edges of equal weight it takes the one with the smallest index.
Weights are positive integers, so ties are exact and every subpath of a canonical path is canonical.

A search grows in steps: callers settle nodes until they have what they need. A node is settled
once its shortest path is final (Dijkstra's term).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import inner_uncounted, jit, jit_uncounted

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

#: A radius that no path exceeds. Weights are capped so that a path through all nodes stays below.
UNBOUNDED = 1 << 62

#: Status of functions that write walks: no path joins the nodes. Below all entries of ``edges``.
NO_PATH = -3

#: Status of functions that write walks: the walk has more knots than the arrays hold.
TOO_LONG = -4

# Indices in ``DijkstraSearch.state``.

#: Stamp of the nodes that the current search has reached; one more marks the settled nodes.
STAMP = 0

#: Number of entries in the heap.
HEAP_SIZE = 1

#: Number of settled nodes.
SETTLED = 2

#: Number of nodes that a search may settle, at least 1.
BREADTH = 3


class Arcs(NamedTuple):
    """Arcs of a graph, sorted by source.

    The arcs of node v are ``offsets[v]`` to ``offsets[v + 1] - 1``. The fields are those of
    :class:`gpszip.graph.road_graph.RoadGraph`.
    """

    offsets: NDArray[np.int64]
    targets: NDArray[np.int32]
    weights: NDArray[np.int64]
    edges: NDArray[np.int32]
    ranks: NDArray[np.int32]


class DijkstraSearch(NamedTuple):
    """Work arrays of consecutive searches on a graph.

    Entries of a node are valid only if its stamp is that of the current search, so that a new
    search needs no clearing.

    Parameters
    ----------
    distance : int64 array, shape (V,)
        Length of the shortest path found so far.
    parent : int32 array, shape (V,)
        Node before the last on this path; -1 at the source.
    arc : int64 array, shape (V,)
        Last arc of this path; -1 at the source.
    stamp : int64 array, shape (V,)
        ``state[STAMP]`` if the current search has reached the node, ``state[STAMP] + 1`` if it has
        settled it.
    order : int32 array, shape (V,)
        Settled nodes by distance.
    keys : int64 array, shape (A + 1,)
        Distances in the heap.
    heap : int32 array, shape (A + 1,)
        Nodes in the heap; outdated entries stay in it until they are popped.
    state : int64 array, shape (4,)
        Numbers by index: STAMP, HEAP_SIZE, SETTLED and BREADTH.
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
    """Allocate the work arrays for a graph.

    Parameters
    ----------
    nodes, arcs : int
        Largest numbers of nodes and arcs.
    breadth : int
        Number of nodes that each search settles; nodes as far as the last of them are settled too.
    """
    return DijkstraSearch(
        distance=np.zeros(nodes, np.int64),
        parent=np.zeros(nodes, np.int32),
        arc=np.zeros(nodes, np.int64),
        stamp=np.zeros(nodes, np.int64),
        order=np.zeros(nodes, np.int32),
        keys=np.zeros(arcs + 1, np.int64),
        heap=np.zeros(arcs + 1, np.int32),
        state=np.array([0, 0, 0, breadth], np.int64),
    )


@inner_uncounted
def _comes_first(arcs: Arcs, search: DijkstraSearch, new: int, old: int, node: int) -> bool:
    """Whether the path to ``node`` by parent ``new`` precedes the equally long one by ``old``."""
    # The paths diverge after their last common node. The nodes right after it decide.
    after_new = after_old = node
    while new != old:
        if search.distance[new] >= search.distance[old]:
            after_new, new = new, search.parent[new]
        else:
            after_old, old = old, search.parent[old]
    return bool(arcs.ranks[after_new] < arcs.ranks[after_old])


@inner_uncounted
def _relax_arcs(arcs: Arcs, search: DijkstraSearch, node: int) -> None:
    """Try the path through a settled node for each of its neighbours that are not settled."""
    # Leave out settled neighbours, whose stamp is one above that of the search.
    stamp = search.state[STAMP]
    for arc in range(arcs.offsets[node], arcs.offsets[node + 1]):
        target = arcs.targets[arc]
        if search.stamp[target] == stamp + 1:
            continue

        # Keep the known path if it is shorter, or comes first among equally short ones.
        length = search.distance[node] + arcs.weights[arc]
        is_known = search.stamp[target] == stamp
        if is_known and length > search.distance[target]:
            continue
        if is_known and length == search.distance[target]:
            # Of parallel arcs the first stays: their paths never diverge.
            if not _comes_first(arcs, search, node, search.parent[target], target):
                continue
        else:
            search.state[HEAP_SIZE] = push(
                search.keys, search.heap, search.state[HEAP_SIZE], length, target
            )

        # Take the new path.
        search.stamp[target] = stamp
        search.distance[target] = length
        search.parent[target] = node
        search.arc[target] = arc


@inner_uncounted
def start_search(search: DijkstraSearch, source: int) -> None:
    """Begin a new search at ``source``; the entries of earlier ones become invalid."""
    search.state[STAMP] += 2  # each search uses two stamps: reached, and settled
    search.state[HEAP_SIZE] = push(search.keys, search.heap, 0, 0, source)
    search.state[SETTLED] = 0

    search.stamp[source] = search.state[STAMP]
    search.distance[source] = 0
    search.parent[source] = -1
    search.arc[source] = -1


@inner_uncounted
def _is_within_breadth(search: DijkstraSearch) -> bool:
    """Whether the search may settle the first node of the heap."""
    # Nodes as far as the last permitted node still count: their order in the heap is arbitrary.
    settled, breadth = search.state[SETTLED], search.state[BREADTH]
    return bool(settled < breadth or search.keys[0] == search.distance[search.order[breadth - 1]])


@inner_uncounted
def settle_next(arcs: Arcs, search: DijkstraSearch, radius: int) -> int:
    """Settle the nearest open node within ``radius`` and return it, or -1 if there is none."""
    while search.state[HEAP_SIZE] > 0 and search.keys[0] <= radius and _is_within_breadth(search):
        node, search.state[HEAP_SIZE] = pop(search.keys, search.heap, search.state[HEAP_SIZE])

        # Skip outdated entries of nodes that are settled already.
        if search.stamp[node] == search.state[STAMP]:
            search.stamp[node] += 1
            search.order[search.state[SETTLED]] = node
            search.state[SETTLED] += 1
            _relax_arcs(arcs, search, node)
            return int(node)
    return -1


@inner_uncounted
def settle_node(arcs: Arcs, search: DijkstraSearch, node: int, radius: int) -> bool:
    """Continue the search until ``node`` is settled; False if it is not within ``radius``."""
    while search.stamp[node] != search.state[STAMP] + 1:
        if settle_next(arcs, search, radius) < 0:
            return False
    return True


@jit_uncounted
def settle_within(arcs: Arcs, search: DijkstraSearch, source: int, radius: int) -> None:
    """Settle all nodes within ``radius`` of ``source``."""
    start_search(search, source)
    while settle_next(arcs, search, radius) >= 0:
        pass


@jit
def settle_targets(
    arcs: Arcs, search: DijkstraSearch, source: int, targets: NDArray[np.int32], radius: int
) -> NDArray[np.int64]:
    """Distances from ``source`` to each target; -1 for those farther than ``radius``."""
    start_search(search, source)
    distances = np.full(len(targets), -1, np.int64)
    for i in range(len(targets)):
        if settle_node(arcs, search, targets[i], radius):
            distances[i] = search.distance[targets[i]]
    return distances


@inner_uncounted
def follow_canonical_path(
    arcs: Arcs,
    search: DijkstraSearch,
    nodes: NDArray[np.int32],
    edges: NDArray[np.int32],
    first: int,
    last: int,
) -> int:
    """Farthest knot up to ``last`` that a canonical path from knot ``first`` reaches with the walk.

    The canonical path from q_first to q_{j+1} extends the one to q_j where pred(q_{j+1}) = q_j and
    the last edge is that of the walk (theory, section 5). The first knot that violates this ends
    the longest prefix, because later knots violate it as well.

    The tree of the first node grows only as far as the walk follows it.
    """
    start_search(search, nodes[first])
    for knot in range(first, last):
        node = nodes[knot + 1]
        # A node that isn't settled lies at most one edge beyond the current one. So the search
        # stays within the length of the walk.
        if edges[knot] < 0 or not settle_node(arcs, search, node, UNBOUNDED):
            return knot
        if search.parent[node] != nodes[knot] or arcs.edges[search.arc[node]] != edges[knot]:
            return knot
    return last


@jit
def find_waypoints_greedily(
    arcs: Arcs, search: DijkstraSearch, nodes: NDArray[np.int32], edges: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Fewest waypoints of a walk: each is as far as a canonical path follows from the last.

    Parameters
    ----------
    arcs, search : Arcs, DijkstraSearch
        The graph, and work arrays.
    nodes, edges : int32 arrays, shape (k + 1,) and (k,)
        The walk.

    Returns
    -------
    knots : int64 array, shape (w + 1,)
        Knots that are waypoints.
    is_path : bool array, shape (w,)
        Whether the canonical path leads from each waypoint to the next. Otherwise the two are
        consecutive knots, joined by an edge that is not the canonical path, or by none.
    """
    last = len(nodes) - 1
    knots = np.zeros(len(nodes), np.int64)
    is_path = np.zeros(last, np.bool_)

    count = 0
    while knots[count] < last:
        knot = knots[count]
        reached = follow_canonical_path(arcs, search, nodes, edges, knot, last)
        is_path[count] = reached > knot
        knots[count + 1] = max(reached, knot + 1)
        count += 1
    return knots[: count + 1].copy(), is_path[:count].copy()


@jit
def find_waypoints_by_bisection(
    arcs: Arcs, search: DijkstraSearch, nodes: NDArray[np.int32], edges: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Waypoints of a walk by recursive bisection (thesis, algorithm 6).

    A segment of the walk that is no canonical path is split at its middle knot, which both halves
    keep. Parameters and results are those of :func:`find_waypoints_greedily`.
    """
    # The stack holds the ends of the open segments; the next one starts at the last waypoint.
    last = len(nodes) - 1
    knots = np.zeros(len(nodes), np.int64)
    is_path = np.zeros(last, np.bool_)
    reach = np.full(len(nodes), -1, np.int64)
    ends = np.full(len(nodes), last, np.int64)
    depth = 1 if last > 0 else 0

    # Decide the segments in the order of the walk, until none is open.
    count = 0
    while depth > 0:
        # Later segments from the same knot are shorter, so one search for each knot suffices.
        first, end = knots[count], ends[depth - 1]
        if reach[first] < 0:
            reach[first] = follow_canonical_path(arcs, search, nodes, edges, first, end)

        # Accept the segment or split it.
        if reach[first] >= end or end == first + 1:
            is_path[count] = reach[first] >= end
            knots[count + 1] = end
            count += 1
            depth -= 1
        else:
            ends[depth] = (first + end) >> 1
            depth += 1
    return knots[: count + 1].copy(), is_path[:count].copy()


@inner_uncounted
def write_canonical_path(
    arcs: Arcs,
    search: DijkstraSearch,
    source: int,
    target: int,
    nodes: NDArray[np.int32],
    edges: NDArray[np.int32],
    begin: int,
) -> int:
    """Write the canonical path after knot ``begin``; return its last knot, NO_PATH or TOO_LONG."""
    # Search until the target is settled.
    start_search(search, source)
    if source == target or not settle_node(arcs, search, target, UNBOUNDED):
        return NO_PATH

    # Count the knots.
    end = begin
    node = target
    while node != source:
        node = search.parent[node]
        end += 1
    if end >= len(nodes):
        return TOO_LONG

    # Write them from the target back to the source.
    node = target
    for knot in range(end, begin, -1):
        nodes[knot] = node
        edges[knot - 1] = arcs.edges[search.arc[node]]
        node = search.parent[node]
    return end


@jit_uncounted
def expand_waypoints(
    arcs: Arcs,
    search: DijkstraSearch,
    waypoints: NDArray[np.int32],
    literals: NDArray[np.int32],
    nodes: NDArray[np.int32],
    edges: NDArray[np.int32],
) -> tuple[int, int]:
    """Write the walk that waypoints stand for.

    Parameters
    ----------
    arcs, search : Arcs, DijkstraSearch
        The graph, and work arrays.
    waypoints : int32 array, shape (w + 1,)
        Nodes.
    literals : int32 array, shape (w,)
        Entry of ``edges`` between two waypoints that are consecutive knots; NO_PATH where the
        canonical path leads from one waypoint to the next.
    nodes, edges : int32 arrays
        Filled in.

    Returns
    -------
    knot : int
        Last knot of the walk, NO_PATH or TOO_LONG.
    waypoint : int
        Index of the last waypoint that was tried.
    """
    # Write the segments one after the other, each from the last knot on.
    knot = 0
    nodes[0] = waypoints[0]
    for i in range(len(literals)):
        # A canonical path.
        if literals[i] == NO_PATH:
            knot = write_canonical_path(
                arcs, search, waypoints[i], waypoints[i + 1], nodes, edges, knot
            )
            if knot < 0:
                return knot, i + 1

        # A single edge, stop or gap.
        elif knot + 1 >= len(nodes):
            return TOO_LONG, i + 1
        else:
            knot += 1
            nodes[knot] = waypoints[i + 1]
            edges[knot - 1] = literals[i]
    return knot, len(literals)
