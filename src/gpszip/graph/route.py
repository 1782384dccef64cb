"""A route: the nodes that a walk visits, and the edge from each of them to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.graph.road_graph import RoadGraph

__all__ = ["GAP", "STOP", "Route", "build_route", "find_arcs", "find_route_arcs"]

#: Instead of an edge: the walk stays at the node.
STOP = -1

#: Instead of an edge: a gap, in which the walk claims no travel; the next node may be any.
GAP = -2


@dataclass(frozen=True, eq=False)
class Route:
    """A walk on a road graph, unambiguous also on parallel edges and self-loops.

    Parameters
    ----------
    nodes : int32 array, shape (k + 1,)
        Visited nodes in order.
    edges : int32 array, shape (k,)
        Index of the edge to the next node, or STOP or GAP.
    """

    nodes: NDArray[np.int32]
    edges: NDArray[np.int32]

    @property
    def gaps(self) -> NDArray[np.bool_]:
        """Whether each segment is a gap, shape (k,)."""
        gaps: NDArray[np.bool_] = self.edges == GAP
        return gaps


def find_arcs(
    graph: RoadGraph, sources: ArrayLike, targets: ArrayLike
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First of the arcs from each source to its target, and their number.

    Parallel arcs are consecutive.

    Parameters
    ----------
    graph : RoadGraph
        The graph.
    sources, targets : array_like of int, shape (k,)
        Pairs of nodes.

    Returns
    -------
    first, count : int64 array, shape (k,)
        Index in ``graph.targets``, and number of arcs; 0 where no arc joins the pair.

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
    # Parallel arcs have the same key: they reach from the left end to the right one.
    first = np.searchsorted(keys, wanted, side="left")
    count = np.searchsorted(keys, wanted, side="right") - first
    return first.astype(np.int64), count.astype(np.int64)


def find_route_arcs(graph: RoadGraph, route: Route) -> NDArray[np.int64]:
    """Arc of each segment of a route, shape (k,); -1 at stops and gaps.

    Raises
    ------
    ValueError
        If an edge doesn't lead from its node to the next, or a stop moves to another node.
    """
    # Look up the arc of each edge in the direction of travel.
    arcs = np.full(len(route.edges), -1, dtype=np.int64)
    travelled = np.flatnonzero(route.edges >= 0)
    edges, sources = route.edges[travelled], route.nodes[travelled]
    forward, backward = _arcs_by_direction(graph)
    # An edge that the walk leaves at its first node is travelled along its line.
    arcs[travelled] = np.where(sources == graph.ends[edges, 0], forward[edges], backward[edges])

    # Check that the arcs join the nodes of the route.
    wrong = (route.edges == STOP) & (route.nodes[1:] != route.nodes[:-1])
    travelled_arcs = arcs[travelled]
    # The index -1 of a missing arc reads the last arc, but the first condition marks it.
    wrong[travelled] = (
        (travelled_arcs < 0)
        | ~(graph.ends[edges] == sources[:, None]).any(axis=1)
        | (graph.targets[travelled_arcs] != route.nodes[travelled + 1])
    )
    if wrong.any():
        first = int(wrong.argmax())
        raise ValueError(
            f"segment {first} of the route: edge {route.edges[first]} doesn't lead "
            f"from node {route.nodes[first]} to {route.nodes[first + 1]}"
        )
    return arcs


def _arcs_by_direction(graph: RoadGraph) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Arc along each edge and arc against it, shape (E,); -1 where there is none."""
    arcs = np.arange(len(graph.edges), dtype=np.int64)
    # A self-loop has one arc, which counts as forward.
    is_forward = _arc_sources(graph) == graph.ends[graph.edges, 0]
    forward, backward = np.full((2, len(graph.ends)), -1, dtype=np.int64)
    forward[graph.edges[is_forward]] = arcs[is_forward]
    backward[graph.edges[~is_forward]] = arcs[~is_forward]
    return forward, backward


def build_route(graph: RoadGraph, nodes: ArrayLike, gaps: ArrayLike | None = None) -> Route:
    """Route of a walk that is given by its nodes alone, over the shortest of parallel edges.

    The same node twice in succession is a stop, not a traversal of a self-loop.

    Parameters
    ----------
    graph : RoadGraph
        The graph.
    nodes : array_like of int, shape (k + 1,)
        Nodes of the walk.
    gaps : array_like of bool, shape (k,), optional
        Whether each segment is a gap; by default none is.

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
    # Segments are stops unless they are gaps or move to another node.
    edges = np.full(max(len(visited) - 1, 0), STOP, dtype=np.int32)
    if gaps is not None:
        edges[np.asarray(gaps, dtype=np.bool_)] = GAP
    moves = np.flatnonzero((edges != GAP) & (visited[1:] != visited[:-1]))
    edges[moves] = _find_lightest_edges(graph, visited[moves], visited[moves + 1])
    return Route(visited, edges)


def _find_lightest_edges(
    graph: RoadGraph, sources: NDArray[np.int32], targets: NDArray[np.int32]
) -> NDArray[np.int32]:
    """Lightest edge of each pair of nodes; the first one among equals."""
    _, count = find_arcs(graph, sources, targets)
    if not count.all():
        first = int((count == 0).argmax())
        raise ValueError(f"no edge leads from node {sources[first]} to node {targets[first]}")

    # The first arc of each pair in the order of weights.
    keys = _arc_keys(graph)
    order = np.lexsort((graph.edges, graph.weights, keys))
    lightest: NDArray[np.int32] = graph.edges[
        order[np.searchsorted(keys[order], _pair_keys(graph, sources, targets))]
    ]
    return lightest


def _arc_keys(graph: RoadGraph) -> NDArray[np.int64]:
    """One number for the pair of nodes of each arc; increasing."""
    return _pair_keys(graph, _arc_sources(graph), graph.targets)


def _arc_sources(graph: RoadGraph) -> NDArray[np.int64]:
    """Source node of each arc."""
    return np.repeat(np.arange(len(graph), dtype=np.int64), np.diff(graph.offsets))


def _pair_keys(graph: RoadGraph, sources: ArrayLike, targets: ArrayLike) -> NDArray[np.int64]:
    """One number for each pair of nodes, sorted like the pairs."""
    first, second = np.asarray(sources, dtype=np.int64), np.asarray(targets, dtype=np.int64)
    # Node numbers are 32 bits wide, so that 64 bits hold a pair.
    keys: NDArray[np.int64] = first * len(graph) + second
    return keys
