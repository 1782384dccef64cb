"""Trees of shortest paths from one node, bounded by a radius, and a store of the trees used last."""

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

_FARTHEST = 1 << 62


@dataclass(frozen=True, eq=False)
class ShortestPathTree:
    """The canonical shortest paths from one node to all within a radius.

    Parameters
    ----------
    nodes : int32 array, shape (r,)
        Nodes reached, by increasing index.
    distances : float64 array, shape (r,)
        Metres from the source.
    parents, edges : int32 array, shape (r,)
        Last node and last edge on the way to each; -1 at the source.
    """

    nodes: NDArray[np.int32]
    distances: NDArray[np.float64]
    parents: NDArray[np.int32]
    edges: NDArray[np.int32]

    def distance(self, node: int) -> float:
        """Metres from the source to ``node``; infinite if it was not reached."""
        place = self._place(node)
        return float(self.distances[place]) if place >= 0 else float("inf")

    def route(self, node: int) -> Route | None:
        """The canonical path from the source to ``node``, or None if it was not reached."""
        place = self._place(node)
        if place < 0:
            return None
        nodes, edges = [node], []
        while self.parents[place] >= 0:
            edges.append(self.edges[place])
            nodes.append(self.parents[place])
            place = self._place(nodes[-1])
        return Route(np.array(nodes[::-1], np.int32), np.array(edges[::-1], np.int32))

    def _place(self, node: int) -> int:
        place = int(np.searchsorted(self.nodes, node))
        return place if place < len(self.nodes) and self.nodes[place] == node else -1


def kernel_arcs(graph: RoadGraph) -> Arcs:
    """The graph as the kernels take it."""
    from gpszip.graph.kernels.shortest_paths import Arcs

    return Arcs(graph.offsets, graph.targets, graph.weights, graph.edges, graph.ranks)


def new_search_on(graph: RoadGraph, breadth: int | None = None) -> DijkstraSearch:
    """Work arrays for searches on this graph, one after another; not to be shared between threads.

    Each search settles the nearest ``breadth`` nodes, and all that are as far as the last of them; by default all there are.
    """
    from gpszip.graph.kernels.shortest_paths import new_search

    return new_search(
        len(graph), len(graph.targets), max(len(graph), 1) if breadth is None else breadth
    )


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
        Length in metres up to which paths are followed; by default all are.
    search : Search, optional
        Work arrays to use again, see :func:`new_search_on`.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> tree = build_tree(build_road_graph([[0, 0], [4, 0], [4, 3]], [[0, 1], [1, 2]]), 0)
    >>> tree.distance(2), tree.route(2).nodes.tolist()
    (7.0, [0, 1, 2])
    """
    from gpszip.graph.kernels.shortest_paths import settle_within

    search = new_search_on(graph) if search is None else search
    settle_within(kernel_arcs(graph), search, source, _units(radius))
    reached = np.sort(search.order[: search.state[2]])
    parents = search.parent[reached]
    edges = (
        np.where(parents < 0, -1, graph.edges[search.arc[reached]]) if len(graph.edges) else parents
    )
    return ShortestPathTree(
        reached, search.distance[reached] / UNITS_PER_METRE, parents, edges.astype(np.int32)
    )


def find_distances(
    graph: RoadGraph,
    source: int,
    targets: ArrayLike,
    *,
    radius: float | None = None,
    search: DijkstraSearch | None = None,
) -> NDArray[np.float64]:
    """Lengths of the shortest paths from one node to several, stopping as soon as the last is found.

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
    search : Search, optional
        Work arrays to use again, see :func:`new_search_on`.

    Returns
    -------
    float64 array, shape (c,)
        Metres; infinite where there is no path within the radius.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> find_distances(build_road_graph([[0, 0], [4, 0], [9, 9]], [[0, 1]]), 0, [1, 2]).tolist()
    [4.0, inf]
    """
    from gpszip.graph.kernels.shortest_paths import settle_targets

    search = new_search_on(graph) if search is None else search
    units = settle_targets(
        kernel_arcs(graph), search, source, np.asarray(targets, dtype=np.int32), _units(radius)
    )
    return np.where(units < 0, np.inf, units / UNITS_PER_METRE)


class TreeCache:
    """The trees asked for last, so that paths from the same node are searched once.

    Parameters
    ----------
    graph : RoadGraph
        The graph.
    radius : float, optional
        Radius of all trees in metres; by default unbounded.
    size : int
        Bytes that the stored trees may take together, at least that of the last one; 64 MiB by default.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> store = TreeCache(build_road_graph([[0, 0], [4, 0]], [[0, 1]]))
    >>> store.tree(0).distance(1), store.tree(0) is store.tree(0)
    (4.0, True)
    """

    def __init__(
        self, graph: RoadGraph, *, radius: float | None = None, size: int = 1 << 26
    ) -> None:
        self._graph = graph
        self._radius = radius
        self._room = size
        self._search = new_search_on(graph)
        self._trees: OrderedDict[int, ShortestPathTree] = OrderedDict()

    def tree(self, source: int) -> ShortestPathTree:
        """The tree of ``source``, from the store where it is known."""
        if source in self._trees:
            self._trees.move_to_end(source)
            return self._trees[source]
        tree = build_tree(self._graph, source, radius=self._radius, search=self._search)
        self._trees[source] = tree
        self._room -= _tree_bytes(tree)
        while self._room < 0 and len(self._trees) > 1:
            self._room += _tree_bytes(self._trees.popitem(last=False)[1])
        return tree


def _units(radius: float | None) -> int:
    return _FARTHEST if radius is None else int(min(radius * UNITS_PER_METRE, float(_FARTHEST)))


def _tree_bytes(tree: ShortestPathTree) -> int:
    return int(tree.nodes.nbytes + tree.distances.nbytes + tree.parents.nbytes + tree.edges.nbytes)
