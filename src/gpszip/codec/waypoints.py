"""Path compression: the few nodes of a walk that determine it (thesis, chapter 7, algorithm 6).

Between two waypoints the walk takes the canonical shortest path, which both sides can compute.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import CorruptArchiveError
from gpszip.graph.road_graph import RoadGraph
from gpszip.graph.route import GAP, STOP, Route, find_arcs, find_route_arcs
from gpszip.graph.trees import kernel_arcs, new_search_on
from gpszip.model.text import count_text

__all__ = [
    "Connection",
    "Waypoints",
    "expand_waypoints",
    "find_waypoints",
    "find_waypoints_by_bisection",
]

#: Indices of the waypoints along a walk, and whether a shortest path leads from each to the next.
_Knots = tuple[NDArray[np.int64], NDArray[np.bool_]]


class Connection(IntEnum):
    """How a walk gets from one waypoint to the next."""

    PATH = 0  #: along the canonical shortest path
    EDGE = 1  #: over one edge that is not the shortest path between its ends
    STOP = 2  #: it stays at the same node
    GAP = 3  #: no travel is claimed


@dataclass(frozen=True, eq=False)
class Waypoints:
    """The thesis's sequence T (definition 4.1.9), and connections that are no shortest paths.

    Parameters
    ----------
    nodes : int32 array, shape (w,)
        Nodes of the map; none for an empty walk.
    connections : uint8 array, shape (w - 1,)
        A :class:`Connection` for each pair of consecutive waypoints.
    parallel_indices : int32 array, shape (w - 1,)
        For an EDGE, its number among the parallel edges, counted from 0 in the order of their
        index; otherwise 0.
    """

    nodes: NDArray[np.int32]
    connections: NDArray[np.uint8]
    parallel_indices: NDArray[np.int32]

    def __repr__(self) -> str:
        return f"Waypoints({count_text(len(self), 'node')})"

    def __len__(self) -> int:
        return len(self.nodes)


def find_waypoints(graph: RoadGraph, route: Route, *, breadth: int | None = None) -> Waypoints:
    """Compress a walk to the smallest number of waypoints.

    Every segment of a canonical path is canonical, so that it is optimal to take the longest prefix
    each time (theory, section 5). The tree of a waypoint is grown no farther than the walk follows
    it. That costs less than galloping over ever longer prefixes, and needs no table of all pairs.

    Parameters
    ----------
    graph : RoadGraph
        The map.
    route : Route
        The walk; may stay, jump, turn round, and take the longer of parallel edges.
    breadth : int, optional
        A path may end at one of this many nodes nearest to its start, or at one as far as the last
        of them; at least 1. By default, all nodes count. A smaller number bounds the time to
        decompress, if :func:`expand_waypoints` is given the same, and takes a few waypoints more.

    Returns
    -------
    Waypoints
        Never more than :func:`find_waypoints_by_bisection` finds.

    Raises
    ------
    ValueError
        If an edge of the walk doesn't lead from its node to the next.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> from gpszip.graph.route import build_route
    >>> graph = build_road_graph([[0, 0], [1, 0], [2, 0], [3, 0]], [[0, 1], [1, 2], [2, 3]])
    >>> find_waypoints(graph, build_route(graph, [0, 1, 2, 3, 3, 2, 1])).nodes.tolist()
    [0, 3, 3, 1]
    """
    from gpszip.graph.kernels.shortest_paths import find_waypoints_greedily

    return _compress(graph, route, find_waypoints_greedily, breadth)


def find_waypoints_by_bisection(
    graph: RoadGraph, route: Route, *, breadth: int | None = None
) -> Waypoints:
    """Compress a walk by recursive bisection, as Traj_compress does (algorithm 6).

    Two misprints are corrected. As printed, the halves are matched and not compressed, which leaves
    all below the first level as it was. And they share no node, which forces the edge between them
    to be a shortest path. Here, each half is compressed in turn, and both have the middle node.

    Parameters and errors are those of :func:`find_waypoints`, which never needs more waypoints and
    often half as many.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> from gpszip.graph.route import build_route
    >>> graph = build_road_graph([[0, 0], [1, 0], [2, 0], [3, 0]], [[0, 1], [1, 2], [2, 3]])
    >>> find_waypoints_by_bisection(graph, build_route(graph, [0, 1, 2, 3, 2])).nodes.tolist()
    [0, 2, 3, 2]
    """
    from gpszip.graph.kernels.shortest_paths import find_waypoints_by_bisection

    return _compress(graph, route, find_waypoints_by_bisection, breadth)


def expand_waypoints(
    graph: RoadGraph, waypoints: Waypoints, limit: int, *, breadth: int | None = None
) -> Route:
    """Decompress a walk: concatenate the canonical shortest paths (thesis, section 7.2).

    Parameters
    ----------
    graph : RoadGraph
        The map that the walk was compressed against.
    waypoints : Waypoints
        The result of :func:`find_waypoints` or :func:`find_waypoints_by_bisection`.
    limit : int
        Largest number of steps of the walk; bounds the memory that forged waypoints can take.
    breadth : int, optional
        The number that was given to compress.

    Raises
    ------
    CorruptArchiveError
        If a waypoint is no node of the map, a path or edge does not exist, or the walk has more
        steps than the limit.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> from gpszip.graph.route import build_route
    >>> graph = build_road_graph([[0, 0], [1, 0], [2, 0], [3, 0]], [[0, 1], [1, 2], [2, 3]])
    >>> waypoints = find_waypoints(graph, build_route(graph, [0, 1, 2, 3, 3, 2, 1]))
    >>> expand_waypoints(graph, waypoints, 6).nodes.tolist()
    [0, 1, 2, 3, 3, 2, 1]
    """
    from gpszip.graph.kernels.shortest_paths import NO_PATH, TOO_LONG, expand_waypoints

    # Refuse waypoints that do not fit the map; none at all make an empty walk.
    _check(graph, waypoints)
    if not len(waypoints):
        return Route(np.zeros(0, np.int32), np.zeros(0, np.int32))

    # Fill in nodes and edges; the kernel returns the index of the last node, or what is wrong.
    nodes, edges = np.zeros(limit + 1, np.int32), np.zeros(limit, np.int32)
    search = new_search_on(graph, breadth)
    last, waypoint = expand_waypoints(
        kernel_arcs(graph), search, waypoints.nodes, _literals(graph, waypoints), nodes, edges
    )
    if last == NO_PATH:
        raise CorruptArchiveError(f"no path leads to waypoint {waypoint}")
    if last == TOO_LONG:
        raise CorruptArchiveError(
            f"at waypoint {waypoint} the walk has more than the {limit} steps that it may have"
        )
    return Route(nodes[: last + 1], edges[:last])


def _compress(
    graph: RoadGraph, route: Route, find_knots: Callable[..., _Knots], breadth: int | None
) -> Waypoints:
    """Compress a walk with a kernel that selects its waypoints."""
    # Select knots of the route as waypoints; an empty walk needs none.
    if len(route.nodes) == 0:
        return Waypoints(np.zeros(0, np.int32), np.zeros(0, np.uint8), np.zeros(0, np.int32))
    arcs = find_route_arcs(graph, route)
    search = new_search_on(graph, breadth)
    knots, is_path = find_knots(kernel_arcs(graph), search, route.nodes, route.edges)

    # Between waypoints that no shortest path connects, there is one step.
    edges = route.edges[knots[:-1]]
    connections = np.select(
        [is_path, edges == STOP, edges == GAP],
        [Connection.PATH, Connection.STOP, Connection.GAP],
        Connection.EDGE,
    ).astype(np.uint8)

    # The arcs from one node to another follow each other, so that a difference tells them apart.
    parallel_indices = np.zeros(len(connections), np.int32)
    single = np.flatnonzero(connections == Connection.EDGE)
    first, _ = find_arcs(graph, route.nodes[knots[single]], route.nodes[knots[single] + 1])
    parallel_indices[single] = arcs[knots[single]] - first
    return Waypoints(route.nodes[knots], connections, parallel_indices)


def _check(graph: RoadGraph, waypoints: Waypoints) -> None:
    """Refuse waypoints whose arrays don't fit each other or the map."""
    nodes, connections = waypoints.nodes, waypoints.connections
    expected, indices = max(len(nodes) - 1, 0), len(waypoints.parallel_indices)
    if len(connections) != expected or indices != expected:
        raise CorruptArchiveError(
            f"{len(nodes)} waypoints can't have {len(connections)} connections"
            f" and {indices} parallel indices"
        )
    if len(nodes) and (nodes.min() < 0 or nodes.max() >= len(graph)):
        raise CorruptArchiveError(f"a waypoint is none of the {len(graph)} nodes of the map")
    if len(connections) and connections.max() > max(Connection):
        raise CorruptArchiveError(f"no connection is of kind {connections.max()}")
    if ((connections == Connection.STOP) & (nodes[1:] != nodes[:-1])).any():
        raise CorruptArchiveError("a walk that stays moves to another node")


def _literals(graph: RoadGraph, waypoints: Waypoints) -> NDArray[np.int32]:
    """Edge of each connection, or STOP or GAP; NO_PATH where a shortest path is to be found."""
    from gpszip.graph.kernels.shortest_paths import NO_PATH

    # A table by Connection: PATH, EDGE, STOP, GAP. The edges of the second kind follow below.
    literals = np.array([NO_PATH, 0, STOP, GAP], dtype=np.int32)[waypoints.connections]
    single = np.flatnonzero(waypoints.connections == Connection.EDGE)
    first, count = find_arcs(graph, waypoints.nodes[single], waypoints.nodes[single + 1])
    parallel_indices = waypoints.parallel_indices[single]
    if ((parallel_indices < 0) | (parallel_indices >= count)).any():
        raise CorruptArchiveError("a walk takes an edge that is not on the map")
    literals[single] = graph.edges[first + parallel_indices]
    return literals
