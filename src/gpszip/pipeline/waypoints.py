"""Walks on a directed road map as waypoints, and back (thesis, chapter 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec import waypoints as codec
from gpszip.codec.waypoints import Waypoints
from gpszip.errors import OptionError
from gpszip.graph.road_graph import RoadGraph, build_road_graph
from gpszip.graph.route import build_route
from gpszip.model import RoadMap, Walk

__all__ = ["expand_waypoints", "find_waypoints"]

#: Most steps of a walk that is restored, for each node and waypoint: a shortest path visits no node
#: twice.
_MOST_STEPS = 1


def find_waypoints(road_map: RoadMap, walk: Walk, *, bisection: bool = False) -> Waypoints:
    """Compress a walk to the nodes between which shortest paths on a map give it back.

    Edges may be travelled in the directions in which they were. Times are not part of waypoints.

    Parameters
    ----------
    road_map : RoadMap
        The map, such as that of :func:`make_map`.
    walk : Walk
        A walk on it, such as that of :func:`build_walk`.
    bisection : bool, default False
        Halve the walk as Algorithm 6 does. By default, the longest prefix that is a shortest path
        is taken each time, which needs the fewest waypoints.

    Raises
    ------
    OptionError
        If a step of the walk is no edge of the map.

    Examples
    --------
    >>> import gpszip
    >>> positions = [[x, 0.0] for x in [0, 1, 2, 3, 3, 2, 1, 0] * 3]
    >>> track = gpszip.Track("lane", range(24), positions)
    >>> mean = gpszip.segment_mean(track, k=6, m=2)
    >>> road_map = gpszip.make_map(mean).road_map
    >>> walk = gpszip.build_walk(mean, track)
    >>> walk.nodes.tolist()
    [0, 2, 1, 3, 0, 2, 1, 3, 0, 2, 1, 3]
    >>> waypoints = find_waypoints(road_map, walk)
    >>> waypoints.nodes.tolist()
    [0, 3, 1, 2, 3]
    >>> expand_waypoints(road_map, waypoints).tolist() == walk.nodes.tolist()
    True
    """
    graph = _directed_graph(road_map)
    find = codec.find_waypoints_by_bisection if bisection else codec.find_waypoints
    try:
        return find(graph, build_route(graph, walk.nodes, walk.gaps))
    except ValueError as error:
        raise OptionError(
            f"walk {walk.id!r} is none on this map ({error})", remedy="give its own map"
        ) from error


def expand_waypoints(road_map: RoadMap, waypoints: Waypoints) -> NDArray[np.int32]:
    """Return the nodes of a walk from its waypoints (thesis, section 7.2).

    Parameters
    ----------
    road_map : RoadMap
        The map on which :func:`find_waypoints` found them.
    waypoints : Waypoints
        The waypoints.

    Raises
    ------
    CorruptArchiveError
        If no walk on the map has these waypoints.
    """
    graph = _directed_graph(road_map)
    limit = _MOST_STEPS * len(road_map.nodes) * max(len(waypoints), 1)
    nodes: NDArray[np.int32] = codec.expand_waypoints(graph, waypoints, limit).nodes
    return nodes


def _directed_graph(road_map: RoadMap) -> RoadGraph:
    """Each direction in which an edge was travelled as an edge of its own."""
    pairs = [(start, end) for start, end, _ in road_map.directed()]
    directed = np.array(pairs, np.int32).reshape(-1, 2)
    return build_road_graph(road_map.nodes, directed, oneway=np.ones(len(directed), np.bool_))
