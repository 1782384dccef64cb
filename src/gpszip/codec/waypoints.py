"""Path compression: the few nodes from which shortest paths give a walk back (thesis, chapter 7, algorithm 6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import CorruptArchiveError
from gpszip.graph.road_graph import RoadGraph
from gpszip.graph.route import JUMP, STAY, Route, arcs_along, arcs_between
from gpszip.graph.trees import arcs_of, search_on

__all__ = ["Hop", "Waypoints", "bisect", "expand", "shorten"]

_Knots = tuple[NDArray[np.int64], NDArray[np.bool_]]


class Hop(IntEnum):
    """How a walk gets from one waypoint to the next."""

    PATH = 0  #: along the canonical shortest path
    EDGE = 1  #: over one edge that is not the shortest path between its ends
    STAY = 2  #: not at all: the same node once more
    JUMP = 3  #: no travel is claimed


@dataclass(frozen=True, eq=False)
class Waypoints:
    """The thesis's sequence T (definition 4.1.9), with the hops that no shortest path can stand for.

    Parameters
    ----------
    nodes : int32 array, shape (w,)
        Nodes of the map; none for an empty walk.
    hops : uint8 array, shape (w - 1,)
        A :class:`Hop` for each two waypoints.
    choices : int32 array, shape (w - 1,)
        For an EDGE which of the parallel ones it is, counted from 0 in order of their index; otherwise 0.
    """

    nodes: NDArray[np.int32]
    hops: NDArray[np.uint8]
    choices: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.nodes)


def shorten(graph: RoadGraph, route: Route, *, breadth: int | None = None) -> Waypoints:
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
        same number given to :func:`expand` bounds the time to decompress; by default all nodes count. The price is a few
        waypoints more than the smallest number.

    Raises
    ------
    ValueError
        If an edge of the walk doesn't lead from its node to the next.

    Examples
    --------
    >>> from gpszip.graph.road_graph import road_graph
    >>> from gpszip.graph.route import route_along
    >>> graph = road_graph([[0, 0], [1, 0], [2, 0], [3, 0]], [[0, 1], [1, 2], [2, 3]])
    >>> shorten(graph, route_along(graph, [0, 1, 2, 3, 3, 2, 1])).nodes.tolist()
    [0, 3, 3, 1]
    """
    from gpszip.graph.kernels.shortest_paths import greedy_knots

    return _compress(graph, route, greedy_knots, breadth)


def bisect(graph: RoadGraph, route: Route, *, breadth: int | None = None) -> Waypoints:
    """Compress a walk by recursive halving, as Traj_compress does (algorithm 6).

    Two misprints are mended: as printed the halves are matched and not compressed, which leaves all below the first
    level as it was; and they share no node, which forces the edge between them to be a shortest path. Here each half
    is compressed in turn and both keep the middle node.

    Takes and raises what :func:`shorten` does, which never needs more waypoints and often half as many.

    Examples
    --------
    >>> from gpszip.graph.road_graph import road_graph
    >>> from gpszip.graph.route import route_along
    >>> graph = road_graph([[0, 0], [1, 0], [2, 0], [3, 0]], [[0, 1], [1, 2], [2, 3]])
    >>> bisect(graph, route_along(graph, [0, 1, 2, 3, 2])).nodes.tolist()
    [0, 2, 3, 2]
    """
    from gpszip.graph.kernels.shortest_paths import bisected_knots

    return _compress(graph, route, bisected_knots, breadth)


def expand(graph: RoadGraph, waypoints: Waypoints, limit: int, *, breadth: int | None = None) -> Route:
    """Decompress a walk: the canonical shortest paths between the waypoints, joined (thesis, section 7.2).

    Parameters
    ----------
    graph : RoadGraph
        The map that the walk was compressed against.
    waypoints : Waypoints
        What :func:`shorten` or :func:`bisect` made of it.
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
    >>> from gpszip.graph.road_graph import road_graph
    >>> from gpszip.graph.route import route_along
    >>> graph = road_graph([[0, 0], [1, 0], [2, 0], [3, 0]], [[0, 1], [1, 2], [2, 3]])
    >>> expand(graph, shorten(graph, route_along(graph, [0, 1, 2, 3, 3, 2, 1])), 6).nodes.tolist()
    [0, 1, 2, 3, 3, 2, 1]
    """
    from gpszip.graph.kernels.shortest_paths import NO_PATH, TOO_LONG, join_waypoints

    _check(graph, waypoints)
    if not len(waypoints):
        return Route(np.zeros(0, np.int32), np.zeros(0, np.int32))
    nodes, edges = np.zeros(limit + 1, np.int32), np.zeros(limit, np.int32)
    search = search_on(graph, breadth)
    last, waypoint = join_waypoints(arcs_of(graph), search, waypoints.nodes, _literals(graph, waypoints), nodes, edges)
    if last == NO_PATH:
        raise CorruptArchiveError(f"no path leads to waypoint {waypoint}")
    if last == TOO_LONG:
        raise CorruptArchiveError(f"at waypoint {waypoint} the walk has more than the {limit} hops that it may have")
    return Route(nodes[: last + 1], edges[:last])


def _compress(graph: RoadGraph, route: Route, rule: Callable[..., _Knots], breadth: int | None) -> Waypoints:
    if len(route.nodes) == 0:
        return Waypoints(np.zeros(0, np.int32), np.zeros(0, np.uint8), np.zeros(0, np.int32))
    arcs = arcs_along(graph, route)
    knots, paths = rule(arcs_of(graph), search_on(graph, breadth), route.nodes, route.edges)
    edges = route.edges[knots[:-1]]
    hops = np.select([paths, edges == STAY, edges == JUMP], [Hop.PATH, Hop.STAY, Hop.JUMP], Hop.EDGE).astype(np.uint8)
    choices = np.zeros(len(hops), np.int32)
    direct = np.flatnonzero(hops == Hop.EDGE)
    first, _ = arcs_between(graph, route.nodes[knots[direct]], route.nodes[knots[direct] + 1])
    choices[direct] = arcs[knots[direct]] - first
    return Waypoints(route.nodes[knots], hops, choices)


def _check(graph: RoadGraph, waypoints: Waypoints) -> None:
    nodes, hops = waypoints.nodes, waypoints.hops
    if len(hops) != max(len(nodes) - 1, 0) or len(waypoints.choices) != len(hops):
        raise CorruptArchiveError(f"{len(nodes)} waypoints can't have {len(hops)} hops and {len(waypoints.choices)} choices")
    if len(nodes) and (nodes.min() < 0 or nodes.max() >= len(graph)):
        raise CorruptArchiveError(f"a waypoint is none of the {len(graph)} nodes of the map")
    if len(hops) and hops.max() > max(Hop):
        raise CorruptArchiveError(f"no hop is of kind {hops.max()}")
    if ((hops == Hop.STAY) & (nodes[1:] != nodes[:-1])).any():
        raise CorruptArchiveError("a walk that stays moves to another node")


def _literals(graph: RoadGraph, waypoints: Waypoints) -> NDArray[np.int32]:
    from gpszip.graph.kernels.shortest_paths import NO_PATH

    literals = np.array([NO_PATH, 0, STAY, JUMP], dtype=np.int32)[waypoints.hops]
    direct = np.flatnonzero(waypoints.hops == Hop.EDGE)
    first, count = arcs_between(graph, waypoints.nodes[direct], waypoints.nodes[direct + 1])
    choices = waypoints.choices[direct]
    if ((choices < 0) | (choices >= count)).any():
        raise CorruptArchiveError("a walk takes an edge that is not on the map")
    literals[direct] = graph.edges[first + choices]
    return literals
