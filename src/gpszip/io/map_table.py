"""A road map's nodes and edges as columns, ready to be written in any format."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import to_geographic
from gpszip.io.track_table import DEGREE_DIGITS, decimal
from gpszip.model import RoadMap

__all__ = ["MapTable", "map_table"]

_DECIMALS = 3


@dataclass(frozen=True, eq=False)
class MapTable:
    """Columns of a road map.

    Parameters
    ----------
    places : float64 array, shape (V, d)
        Longitude and latitude in degrees, or metres.
    geographic : bool
        Whether the places are degrees.
    u, v : int64 array, shape (E,)
        Ends of the edges.
    forward, backward : int64 array, shape (E,)
        Traversals from u to v and from v to u.
    length : float64 array, shape (E,)
        Metres.
    """

    places: NDArray[np.float64]
    geographic: bool
    u: NDArray[np.int64]
    v: NDArray[np.int64]
    forward: NDArray[np.int64]
    backward: NDArray[np.int64]
    length: NDArray[np.float64]

    @property
    def nodes(self) -> NDArray[np.int64]:
        """Nodes at which an edge ends, in the order of their numbers."""
        return np.unique(np.concatenate([self.u, self.v]))

    @property
    def properties(self) -> dict[str, NDArray[np.generic]]:
        """Columns of the edges by their names in files."""
        return {"u": self.u, "v": self.v, "forward": self.forward, "backward": self.backward, "length": self.length}


def map_table(road_map: RoadMap, min_traversals: int = 0) -> MapTable:
    """Put a road map in columns.

    Parameters
    ----------
    road_map : RoadMap
        The map.
    min_traversals : int
        Leave out edges that were travelled less often, both directions together.

    Returns
    -------
    MapTable
        Nodes keep their numbers.

    Examples
    --------
    >>> road_map = RoadMap(np.array([[0.0, 0.0], [3.0, 4.0]]), np.array([[0, 1]], dtype=np.int32), np.array([2]), np.array([1]))
    >>> map_table(road_map).length.tolist(), len(map_table(road_map, min_traversals=4).u)
    ([5.0], 0)
    """
    often = road_map.forward + road_map.backward >= min_traversals
    u, v = road_map.edges[often].astype(np.int64).T
    steps = road_map.nodes[v] - road_map.nodes[u]
    return MapTable(
        places=_places(road_map),
        geographic=road_map.plane is not None,
        u=u,
        v=v,
        forward=road_map.forward[often],
        backward=road_map.backward[often],
        length=decimal(np.sqrt((steps * steps).sum(axis=1)), _DECIMALS),
    )


def _places(road_map: RoadMap) -> NDArray[np.float64]:
    if road_map.plane is None:
        return decimal(road_map.nodes, _DECIMALS)
    lat, lon = to_geographic(road_map.nodes[:, :2], road_map.plane)
    return decimal(np.stack([lon, lat], axis=1), _DECIMALS + DEGREE_DIGITS)
