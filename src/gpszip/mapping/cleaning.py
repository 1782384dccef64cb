"""A road map made fit to look at: rare edges and lonely nodes gone, edges strung into ways."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.graph.road_graph import road_graph
from gpszip.model import RoadMap

__all__ = ["Ways", "dissolve", "drop_isolated", "filter_traversals"]


@dataclass(frozen=True, eq=False)
class Ways:
    """Polylines between the junctions and ends of a road map; a ring starts and ends at the same node.

    Parameters
    ----------
    offsets : int64 array, shape (w + 1,)
        Way i runs along the nodes ``nodes[offsets[i]:offsets[i + 1]]``.
    nodes : int32 array, shape (E + w,)
        Nodes of the road map.
    forward, backward : int64 array, shape (w,)
        How often the way was travelled in the order of its nodes and against it. Walks may turn round underway: it is the
        edge travelled most in that direction that counts.
    """

    offsets: NDArray[np.int64]
    nodes: NDArray[np.int32]
    forward: NDArray[np.int64]
    backward: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.forward)

    def __getitem__(self, way: int) -> NDArray[np.int32]:
        """Nodes of one way."""
        return self.nodes[self.offsets[way] : self.offsets[way + 1]]


def filter_traversals(road_map: RoadMap, minimum: int) -> RoadMap:
    """Keep the edges travelled at least ``minimum`` times, both directions together; the nodes stay.

    Examples
    --------
    >>> road_map = RoadMap(np.zeros((3, 2)), np.array([[0, 1], [1, 2]]), np.array([3, 1]), np.array([1, 2]))
    >>> filter_traversals(road_map, 4).edges.tolist()
    [[0, 1]]
    """
    often = road_map.forward + road_map.backward >= minimum
    return replace(road_map, edges=road_map.edges[often], forward=road_map.forward[often], backward=road_map.backward[often])


def drop_isolated(road_map: RoadMap) -> RoadMap:
    """Drop the nodes without edges; the others move up.

    Examples
    --------
    >>> road_map = RoadMap(np.zeros((4, 2)), np.array([[1, 3]]), np.array([1]), np.array([0]))
    >>> drop_isolated(road_map).edges.tolist()
    [[0, 1]]
    """
    joined, edges = np.unique(road_map.edges, return_inverse=True)
    return replace(road_map, nodes=road_map.nodes[joined], edges=edges.reshape(-1, 2).astype(np.int32))


def dissolve(road_map: RoadMap) -> Ways:
    """String the edges of a road map into ways, dissolving the nodes where exactly two edges meet.

    Examples
    --------
    >>> nodes = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
    >>> ways = dissolve(RoadMap(nodes, np.array([[0, 1], [0, 3], [1, 2]]), np.array([4, 5, 6]), np.array([1, 2, 3])))
    >>> ways[0].tolist(), ways.forward.tolist(), ways.backward.tolist()
    ([2, 1, 0, 3], [5], [6])
    """
    from gpszip.kernels.ways import string_ways

    graph = road_graph(road_map.nodes, road_map.edges)
    offsets, nodes, edges = string_ways(graph.offsets, graph.targets, graph.edges, len(road_map.edges))
    along = np.delete(nodes, offsets[1:] - 1) == road_map.edges[edges, 0]
    counts = np.where(along, (road_map.forward[edges], road_map.backward[edges]), (road_map.backward[edges], road_map.forward[edges]))
    first = offsets[:-1] - np.arange(len(offsets) - 1)
    forward, backward = np.maximum.reduceat(counts, first, axis=1) if len(edges) else counts
    return Ways(offsets, nodes, forward, backward)
