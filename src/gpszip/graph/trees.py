"""Trees of shortest paths from a node, and a cache of the latest trees."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.graph.road_graph import UNITS_PER_METRE, RoadGraph
from gpszip.graph.route import Route

if TYPE_CHECKING:
    from gpszip.graph.kernels.shortest_paths import Arcs, DijkstraSearch

__all__ = [
    "ShortestPathTree",
    "TreeCache",
    "build_tree",
    "find_distances",
    "kernel_arcs",
    "new_search_on",
]

#: Radius of unbounded trees in units of weight; no path is as long.
_UNBOUNDED = 1 << 62

#: Default size of a cache of trees in bytes: 64 MiB.
_CACHE_BYTES = 1 << 26


@dataclass(frozen=True, eq=False)
class ShortestPathTree:
    """The canonical shortest paths from one node to all within a radius.

    Parameters
    ----------
    nodes : int32 array, shape (r,)
        Nodes reached, by increasing index.
    distances : float64 array, shape (r,)
        Metres from the source.
    parents, edges : int32 arrays, shape (r,)
        Node before the last and last edge on the path to each node; -1 at the source.
    """

    nodes: NDArray[np.int32]
    distances: NDArray[np.float64]
    parents: NDArray[np.int32]
    edges: NDArray[np.int32]

    def distance(self, node: int) -> float:
        """Metres from the source to ``node``; infinite if it was not reached."""
        i = self._index(node)
        return float(self.distances[i]) if i >= 0 else float("inf")

    def route(self, node: int) -> Route | None:
        """The canonical path from the source to ``node``, or None if it was not reached."""
        i = self._index(node)
        if i < 0:
            return None

        # Collect nodes and edges from the target back to the source.
        nodes, edges = [node], []
        while self.parents[i] >= 0:
            edges.append(self.edges[i])
            nodes.append(self.parents[i])
            i = self._index(nodes[-1])
        return Route(np.array(nodes[::-1], np.int32), np.array(edges[::-1], np.int32))

    def _index(self, node: int) -> int:
        """Index of a node in the arrays; -1 if it was not reached."""
        # The nodes reached are sorted, so that no array over all nodes is needed.
        i = int(np.searchsorted(self.nodes, node))
        return i if i < len(self.nodes) and self.nodes[i] == node else -1


def kernel_arcs(graph: RoadGraph) -> Arcs:
    """The graph in the form that kernels take."""
    from gpszip.graph.kernels.shortest_paths import Arcs

    return Arcs(graph.offsets, graph.targets, graph.weights, graph.edges, graph.ranks)


def new_search_on(graph: RoadGraph, breadth: int | None = None) -> DijkstraSearch:
    """Allocate work arrays for consecutive searches on a graph. Threads must not share them.

    Parameters
    ----------
    graph : RoadGraph
        The graph.
    breadth : int, optional
        Number of nodes that each search settles; nodes as far as the last of them are settled too.
        By default all nodes.
    """
    from gpszip.graph.kernels.shortest_paths import new_search

    breadth = max(len(graph), 1) if breadth is None else breadth
    return new_search(len(graph), len(graph.targets), breadth)


def build_tree(
    graph: RoadGraph,
    source: int,
    *,
    radius: float | None = None,
    search: DijkstraSearch | None = None,
) -> ShortestPathTree:
    """Grow the tree of canonical shortest paths from one node.

    Parameters
    ----------
    graph : RoadGraph
        The graph.
    source : int
        Node from which the paths start.
    radius : float, optional
        Largest length of paths in metres; by default unbounded.
    search : DijkstraSearch, optional
        Work arrays to reuse, see :func:`new_search_on`.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> tree = build_tree(build_road_graph([[0, 0], [4, 0], [4, 3]], [[0, 1], [1, 2]]), 0)
    >>> tree.distance(2), tree.route(2).nodes.tolist()
    (7.0, [0, 1, 2])
    """
    from gpszip.graph.kernels.shortest_paths import SETTLED, settle_within

    search = new_search_on(graph) if search is None else search
    settle_within(kernel_arcs(graph), search, source, _to_units(radius))

    # Copy the entries of the settled nodes.
    # The search lists settled nodes by distance; the tree has them by index.
    reached = np.sort(search.order[: search.state[SETTLED]])
    distances = search.distance[reached] / UNITS_PER_METRE
    parents = search.parent[reached]
    edges = parents
    # Without arcs, only the source is reached, and no edge can be looked up.
    if len(graph.edges):
        edges = np.where(parents < 0, -1, graph.edges[search.arc[reached]])
    return ShortestPathTree(reached, distances, parents, edges.astype(np.int32))


def find_distances(
    graph: RoadGraph,
    source: int,
    targets: ArrayLike,
    *,
    radius: float | None = None,
    search: DijkstraSearch | None = None,
) -> NDArray[np.float64]:
    """Lengths of the shortest paths from one node to several.

    The search stops as soon as it has reached all targets.

    Parameters
    ----------
    graph : RoadGraph
        The graph.
    source : int
        Node from which the paths start.
    targets : array_like of int, shape (c,)
        Nodes at which they end.
    radius : float, optional
        Length in metres beyond which a target counts as not reached; by default unbounded.
    search : DijkstraSearch, optional
        Work arrays to reuse, see :func:`new_search_on`.

    Returns
    -------
    float64 array, shape (c,)
        Metres; infinite if there is no path within the radius.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> find_distances(build_road_graph([[0, 0], [4, 0], [9, 9]], [[0, 1]]), 0, [1, 2]).tolist()
    [4.0, inf]
    """
    from gpszip.graph.kernels.shortest_paths import settle_targets

    search = new_search_on(graph) if search is None else search
    units = settle_targets(
        kernel_arcs(graph), search, source, np.asarray(targets, dtype=np.int32), _to_units(radius)
    )
    # The kernel marks targets that it did not reach by -1.
    return np.where(units < 0, np.inf, units / UNITS_PER_METRE)


class TreeCache:
    """A cache of the most recently used trees.

    Parameters
    ----------
    graph : RoadGraph
        The graph.
    radius : float, optional
        Radius of all trees in metres; by default unbounded.
    size : int
        Largest total size of the cached trees in bytes, by default 64 MiB. The latest tree is
        always kept.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> cache = TreeCache(build_road_graph([[0, 0], [4, 0]], [[0, 1]]))
    >>> cache.tree(0).distance(1), cache.tree(0) is cache.tree(0)
    (4.0, True)
    """

    def __init__(
        self, graph: RoadGraph, *, radius: float | None = None, size: int = _CACHE_BYTES
    ) -> None:
        self._graph = graph
        self._radius = radius
        self._free_bytes = size
        # All trees share the work arrays, since one is built at a time.
        self._search = new_search_on(graph)
        self._trees: OrderedDict[int, ShortestPathTree] = OrderedDict()

    def tree(self, source: int) -> ShortestPathTree:
        """The tree of ``source``, from the cache if it is there."""
        if source in self._trees:
            # The order of the dict is that of the last use.
            self._trees.move_to_end(source)
            return self._trees[source]

        # Build the tree, then evict the least recently used ones.
        tree = build_tree(self._graph, source, radius=self._radius, search=self._search)
        self._trees[source] = tree
        self._free_bytes -= _tree_bytes(tree)
        while self._free_bytes < 0 and len(self._trees) > 1:
            self._free_bytes += _tree_bytes(self._trees.popitem(last=False)[1])
        return tree


def _to_units(radius: float | None) -> int:
    """A radius in metres as integer weight."""
    if radius is None:
        return _UNBOUNDED
    # An infinite radius has no integer, so that it is cut to the largest one first.
    return int(min(radius * UNITS_PER_METRE, float(_UNBOUNDED)))


def _tree_bytes(tree: ShortestPathTree) -> int:
    return int(tree.nodes.nbytes + tree.distances.nbytes + tree.parents.nbytes + tree.edges.nbytes)
