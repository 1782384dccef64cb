"""A network that is to be prepared once and used for many logs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from gpszip.io.networks.joining import RoadGraph
from gpszip.io.networks.prepared_file import write_prepared_file
from gpszip.io.networks.read import build_network

__all__ = ["PreparedNetwork"]


@dataclass(frozen=True, eq=False)
class PreparedNetwork:
    """Joined roads with what there is to say about them.

    Parameters
    ----------
    roads : JoinedRoads
        The graph in the coordinates of its source.
    """

    roads: RoadGraph

    @property
    def statistics(self) -> dict[str, Any]:
        """Numbers of roads, nodes, one-way roads, roads with a speed and connected parts, and all their length in metres."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        roads = self.roads
        graph = coo_array(
            (np.ones(len(roads), np.int8), (roads.starts, roads.ends)),
            shape=2 * (len(roads.nodes),),
        )
        return {
            "roads": len(roads),
            "nodes": len(roads.nodes),
            "length": float(build_network(roads).network.lengths.sum()),
            "one_way": int((roads.forward != roads.backward).sum()),
            "with_speed": int(np.isfinite(roads.speeds).sum()),
            "components": int(connected_components(graph, directed=False)[0]),
            "geographic": roads.geographic,
        }

    def write(self, stream: BinaryIO) -> int:
        """Write the prepared file; its number of bytes."""
        return write_prepared_file(self.roads, stream)
