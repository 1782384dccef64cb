"""A network that is prepared once and used for many logs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import BinaryIO, TypedDict

import numpy as np

from gpszip.io.networks.joining import RoadGraph
from gpszip.io.networks.prepared_file import write_prepared_file
from gpszip.io.networks.read import build_network

__all__ = ["NetworkStatistics", "PreparedNetwork"]


class NetworkStatistics(TypedDict):
    """Numbers about a network.

    Parameters
    ----------
    roads, nodes : int
        Numbers of roads and of their ends.
    length : float
        Length of all roads in metres.
    one_way : int
        Number of one-way roads.
    with_speed : int
        Number of roads with a known speed.
    components : int
        Number of connected components.
    geographic : bool
        Whether its coordinates are degrees.
    """

    roads: int
    nodes: int
    length: float
    one_way: int
    with_speed: int
    components: int
    geographic: bool


@dataclass(frozen=True, eq=False)
class PreparedNetwork:
    """A road graph that can be written as a prepared file.

    Parameters
    ----------
    roads : RoadGraph
        The graph in the coordinates of its source.
    """

    roads: RoadGraph

    @property
    def statistics(self) -> NetworkStatistics:
        """Numbers of roads, nodes and components, and the length of all roads."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        # Connected components, with every road as a link in both directions.
        roads = self.roads
        graph = coo_array(
            (np.ones(len(roads), np.int8), (roads.starts, roads.ends)),
            shape=2 * (len(roads.nodes),),
        )
        components = int(connected_components(graph, directed=False)[0])

        # Lengths in metres need the projected network, as the graph may be in degrees.
        return {
            "roads": len(roads),
            "nodes": len(roads.nodes),
            "length": float(build_network(roads).network.lengths.sum()),
            "one_way": int((roads.forward != roads.backward).sum()),
            "with_speed": int(np.isfinite(roads.speeds).sum()),
            "components": components,
            "geographic": roads.geographic,
        }

    def write(self, stream: BinaryIO) -> int:
        """Write the prepared file; return its number of bytes."""
        return write_prepared_file(self.roads, stream)
