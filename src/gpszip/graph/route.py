"""A route: the nodes that a walk visits and the edge by which it goes from each to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.graph.road_graph import RoadGraph

__all__ = ["GAP", "STOP", "Route", "build_route", "find_arcs", "find_route_arcs"]

#: In the place of an edge: the walk stays at the node.
STOP = -1

#: In the place of an edge: no travel is claimed, the next node is elsewhere (a gap).
GAP = -2


@dataclass(frozen=True, eq=False)
class Route:
    """A walk on a road graph, told apart even where parallel edges or self-loops exist.

    Parameters
    ----------
    nodes : int32 array, shape (k + 1,)
        Nodes in the order of the visit.
    edges : int32 array, shape (k,)
        Index of the edge to the next node, or STAY or JUMP.
    """

    nodes: NDArray[np.int32]
    edges: NDArray[np.int32]

    @property
    def gaps(self) -> NDArray[np.bool_]:
        """Hops during which no travel is claimed, shape (k,)."""
        gaps: NDArray[np.bool_] = self.edges == GAP
        return gaps


def find_arcs(
    graph: RoadGraph, sources: ArrayLike, targets: ArrayLike
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First of the arcs from each source to its target, and how many there are; parallel arcs follow each other.

    Parameters
    ----------
    graph : RoadGraph
        The graph.
    sources, targets : array_like of int, shape (k,)
        Pairs of nodes.

    Returns
    -------
    first, count : int64 array, shape (k,)
        Places in ``graph.targets``; a count of 0 where no arc joins the pair.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> graph = build_road_graph([[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2], [0, 1]])
    >>> first, count = find_arcs(graph, [1, 0], [0, 2])
    >>> first.tolist(), count.tolist()
    ([2, 2], [2, 0])
    """
    keys = _arc_keys(graph)
    wanted = _pair_keys(graph, sources, targets)
    first = np.searchsorted(keys, wanted, side="left")
    return first.astype(np.int64), (np.searchsorted(keys, wanted, side="right") - first).astype(
        np.int64
    )


def find_route_arcs(graph: RoadGraph, route: Route) -> NDArray[np.int64]:
    """Arc of each hop of a route, shape (k,); -1 where it stays or jumps.

    Raises
    ------
    ValueError
        If an edge doesn't lead from its node to the next, or a stay moves to another node.
    """
    arcs = np.full(len(route.edges), -1, dtype=np.int64)
    travelled = np.flatnonzero(route.edges >= 0)
    edges, sources = route.edges[travelled], route.nodes[travelled]
    forth, back = _arcs_by_direction(graph)
    arcs[travelled] = np.where(sources == graph.ends[edges, 0], forth[edges], back[edges])
    wrong = (route.edges == STOP) & (route.nodes[1:] != route.nodes[:-1])
    found = arcs[travelled]
    wrong[travelled] = (
        (found < 0)
        | ~(graph.ends[edges] == sources[:, None]).any(axis=1)
        | (graph.targets[found] != route.nodes[travelled + 1])
    )
    if wrong.any():
        hop = int(wrong.argmax())
        raise ValueError(
            f"hop {hop} of the route: edge {route.edges[hop]} doesn't lead from node {route.nodes[hop]} to {route.nodes[hop + 1]}"
        )
    return arcs


def _arcs_by_direction(graph: RoadGraph) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    arcs = np.arange(len(graph.edges), dtype=np.int64)
    forward = _arc_sources(graph) == graph.ends[graph.edges, 0]
    forth, back = np.full((2, len(graph.ends)), -1, dtype=np.int64)
    forth[graph.edges[forward]] = arcs[forward]
    back[graph.edges[~forward]] = arcs[~forward]
    return forth, back


def build_route(graph: RoadGraph, nodes: ArrayLike, gaps: ArrayLike | None = None) -> Route:
    """Route of a walk that is given by its nodes alone, by the shortest of the edges between each two.

    The same node twice in a row is a stay, not a way around a self-loop.

    Parameters
    ----------
    graph : RoadGraph
        The graph.
    nodes : array_like of int, shape (k + 1,)
        Nodes of the walk.
    gaps : array_like of bool, shape (k,), optional
        Hops during which no travel is claimed; by default none.

    Raises
    ------
    ValueError
        If no edge joins two consecutive nodes.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> graph = build_road_graph([[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2]])
    >>> build_route(graph, [0, 1, 1, 2, 0], [False, False, False, True]).edges.tolist()
    [0, -1, 1, -2]
    """
    visited = np.asarray(nodes, dtype=np.int32)
    edges = np.full(max(len(visited) - 1, 0), STOP, dtype=np.int32)
    if gaps is not None:
        edges[np.asarray(gaps, dtype=np.bool_)] = GAP
    hops = np.flatnonzero((edges != GAP) & (visited[1:] != visited[:-1]))
    edges[hops] = _find_lightest_edges(graph, visited[hops], visited[hops + 1])
    return Route(visited, edges)


def _find_lightest_edges(
    graph: RoadGraph, sources: NDArray[np.int32], targets: NDArray[np.int32]
) -> NDArray[np.int32]:
    _, count = find_arcs(graph, sources, targets)
    if not count.all():
        hop = int((count == 0).argmax())
        raise ValueError(f"no edge leads from node {sources[hop]} to node {targets[hop]}")
    keys = _arc_keys(graph)
    order = np.lexsort((graph.edges, graph.weights, keys))
    lightest: NDArray[np.int32] = graph.edges[
        order[np.searchsorted(keys[order], _pair_keys(graph, sources, targets))]
    ]
    return lightest


def _arc_keys(graph: RoadGraph) -> NDArray[np.int64]:
    return _pair_keys(graph, _arc_sources(graph), graph.targets)


def _arc_sources(graph: RoadGraph) -> NDArray[np.int64]:
    return np.repeat(np.arange(len(graph), dtype=np.int64), np.diff(graph.offsets))


def _pair_keys(graph: RoadGraph, sources: ArrayLike, targets: ArrayLike) -> NDArray[np.int64]:
    pairs: NDArray[np.int64] = np.asarray(sources, dtype=np.int64) * len(graph) + np.asarray(
        targets, dtype=np.int64
    )
    return pairs
