"""Path compression: the few nodes from which shortest paths give a walk back (thesis, chapter 7, algorithm 6)."""

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

_Knots = tuple[NDArray[np.int64], NDArray[np.bool_]]


class Connection(IntEnum):
    """How a walk gets from one waypoint to the next."""

    PATH = 0  #: along the canonical shortest path
    EDGE = 1  #: over one edge that is not the shortest path between its ends
    STOP = 2  #: not at all: the same node once more
    GAP = 3  #: no travel is claimed


@dataclass(frozen=True, eq=False)
class Waypoints:
    """The thesis's sequence T (definition 4.1.9), with the hops that no shortest path can stand for.

    Parameters
    ----------
    nodes : int32 array, shape (w,)
        Nodes of the map; none for an empty walk.
    connections : uint8 array, shape (w - 1,)
        A :class:`Connection` for each two waypoints.
    parallel_indices : int32 array, shape (w - 1,)
        For an EDGE which of the parallel ones it is, counted from 0 in order of their index; otherwise 0.
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

    Every part of a canonical path is canonical, so that taking the longest prefix each time can't be beaten (theory,
    section 5). The tree of a waypoint is grown no farther than the walk follows it, which costs less than galloping
    over ever longer prefixes and needs no table of all pairs.

    Parameters
    ----------
    graph : RoadGraph
        The map.
    route : Route
        The walk; may stay, jump, turn round, and take the longer of parallel edges.
    breadth : int, optional
        A path may end at one of this many nodes nearest to its start, or one as far as the last of them, at least 1. The
        same number given to :func:`expand_waypoints` bounds the time to decompress; by default all nodes count. The price is a few
        waypoints more than the smallest number.

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
    """Compress a walk by recursive halving, as Traj_compress does (algorithm 6).

    Two misprints are mended: as printed the halves are matched and not compressed, which leaves all below the first
    level as it was; and they share no node, which forces the edge between them to be a shortest path. Here each half
    is compressed in turn and both keep the middle node.

    Takes and raises what :func:`find_waypoints` does, which never needs more waypoints and often half as many.

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
    """Decompress a walk: the canonical shortest paths between the waypoints, joined (thesis, section 7.2).

    Parameters
    ----------
    graph : RoadGraph
        The map that the walk was compressed against.
    waypoints : Waypoints
        What :func:`find_waypoints` or :func:`find_waypoints_by_bisection` made of it.
    limit : int
        Number of hops that the walk may have at most; bounds the memory that forged waypoints can take.
    breadth : int, optional
        As it was given to compress.

    Raises
    ------
    CorruptArchiveError
        If a waypoint is no node of the map, a path or edge does not exist, or the walk outgrows the limit.

    Examples
    --------
    >>> from gpszip.graph.road_graph import build_road_graph
    >>> from gpszip.graph.route import build_route
    >>> graph = build_road_graph([[0, 0], [1, 0], [2, 0], [3, 0]], [[0, 1], [1, 2], [2, 3]])
    >>> expand_waypoints(graph, find_waypoints(graph, build_route(graph, [0, 1, 2, 3, 3, 2, 1])), 6).nodes.tolist()
    [0, 1, 2, 3, 3, 2, 1]
    """
    from gpszip.graph.kernels.shortest_paths import NO_PATH, TOO_LONG, expand_waypoints

    _check(graph, waypoints)
    if not len(waypoints):
        return Route(np.zeros(0, np.int32), np.zeros(0, np.int32))
    nodes, edges = np.zeros(limit + 1, np.int32), np.zeros(limit, np.int32)
    search = new_search_on(graph, breadth)
    last, waypoint = expand_waypoints(
        kernel_arcs(graph), search, waypoints.nodes, _literals(graph, waypoints), nodes, edges
    )
    if last == NO_PATH:
        raise CorruptArchiveError(f"no path leads to waypoint {waypoint}")
    if last == TOO_LONG:
        raise CorruptArchiveError(
            f"at waypoint {waypoint} the walk has more than the {limit} hops that it may have"
        )
    return Route(nodes[: last + 1], edges[:last])


def _compress(
    graph: RoadGraph, route: Route, rule: Callable[..., _Knots], breadth: int | None
) -> Waypoints:
    if len(route.nodes) == 0:
        return Waypoints(np.zeros(0, np.int32), np.zeros(0, np.uint8), np.zeros(0, np.int32))
    arcs = find_route_arcs(graph, route)
    knots, paths = rule(kernel_arcs(graph), new_search_on(graph, breadth), route.nodes, route.edges)
    edges = route.edges[knots[:-1]]
    connections = np.select(
        [paths, edges == STOP, edges == GAP],
        [Connection.PATH, Connection.STOP, Connection.GAP],
        Connection.EDGE,
    ).astype(np.uint8)
    parallel_indices = np.zeros(len(connections), np.int32)
    direct = np.flatnonzero(connections == Connection.EDGE)
    first, _ = find_arcs(graph, route.nodes[knots[direct]], route.nodes[knots[direct] + 1])
    parallel_indices[direct] = arcs[knots[direct]] - first
    return Waypoints(route.nodes[knots], connections, parallel_indices)


def _check(graph: RoadGraph, waypoints: Waypoints) -> None:
    nodes, connections = waypoints.nodes, waypoints.connections
    if len(connections) != max(len(nodes) - 1, 0) or len(waypoints.parallel_indices) != len(
        connections
    ):
        raise CorruptArchiveError(
            f"{len(nodes)} waypoints can't have {len(connections)} hops and {len(waypoints.parallel_indices)} choices"
        )
    if len(nodes) and (nodes.min() < 0 or nodes.max() >= len(graph)):
        raise CorruptArchiveError(f"a waypoint is none of the {len(graph)} nodes of the map")
    if len(connections) and connections.max() > max(Connection):
        raise CorruptArchiveError(f"no hop is of kind {connections.max()}")
    if ((connections == Connection.STOP) & (nodes[1:] != nodes[:-1])).any():
        raise CorruptArchiveError("a walk that stays moves to another node")


def _literals(graph: RoadGraph, waypoints: Waypoints) -> NDArray[np.int32]:
    from gpszip.graph.kernels.shortest_paths import NO_PATH

    literals = np.array([NO_PATH, 0, STOP, GAP], dtype=np.int32)[waypoints.connections]
    direct = np.flatnonzero(waypoints.connections == Connection.EDGE)
    first, count = find_arcs(graph, waypoints.nodes[direct], waypoints.nodes[direct + 1])
    parallel_indices = waypoints.parallel_indices[direct]
    if ((parallel_indices < 0) | (parallel_indices >= count)).any():
        raise CorruptArchiveError("a walk takes an edge that is not on the map")
    literals[direct] = graph.edges[first + parallel_indices]
    return literals
