"""A map's nodes and edges, or junctions and ways, as columns that can be written in any format."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import to_geographic
from gpszip.io.track_table import DEGREE_DIGITS, decimal
from gpszip.model import Plane, RoadMap, WayMap

__all__ = ["MapTable", "map_table", "way_table"]

_DECIMALS = 3


@dataclass(frozen=True, eq=False)
class MapTable:
    """Columns of a map.

    Parameters
    ----------
    places : float64 array, shape (V, d)
        Longitude and latitude in degrees, or metres, of nodes or junctions.
    geographic : bool
        Whether the places are degrees.
    offsets : int64 array, shape (E + 1,)
        Line i runs through ``points[offsets[i]:offsets[i + 1]]``.
    points : float64 array, shape (n, d)
        As the places.
    properties : dict of str to array, shape (E,)
        Columns of the lines by their names in files, first u and v, the places where each line ends. NaN stands for nothing.
    shaped : bool
        Whether lines have points between their ends.
    """

    places: NDArray[np.float64]
    geographic: bool
    offsets: NDArray[np.int64]
    points: NDArray[np.float64]
    properties: dict[str, NDArray[np.generic]]
    shaped: bool = False

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def axes(self) -> list[str]:
        """Names of the coordinates."""
        return ["lon", "lat"] if self.geographic else list("xyz"[: self.places.shape[1]])

    @property
    def nodes(self) -> NDArray[np.int64]:
        """Nodes at which a line ends, in the order of their numbers."""
        return np.unique(np.concatenate([self.properties["u"], self.properties["v"]]).astype(np.int64))

    @property
    def wkt(self) -> list[str]:
        """Lines in well-known text."""
        kind = "LINESTRING Z" if self.points.shape[1] == 3 else "LINESTRING"
        texts = [" ".join(map(repr, point)) for point in self.points.tolist()]
        starts = self.offsets.tolist()
        return [f"{kind} ({', '.join(texts[i:j])})" for i, j in pairwise(starts)]


def map_table(road_map: RoadMap, min_traversals: int = 0) -> MapTable:
    """Put a road map's nodes and edges in columns.

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
    >>> map_table(road_map).properties["length"].tolist(), len(map_table(road_map, min_traversals=4))
    ([5.0], 0)
    """
    often = road_map.forward + road_map.backward >= min_traversals
    u, v = road_map.edges[often].astype(np.int64).T
    steps = road_map.nodes[v] - road_map.nodes[u]
    places = _places(road_map.nodes, road_map.plane)
    columns = {
        "u": u,
        "v": v,
        "forward": road_map.forward[often],
        "backward": road_map.backward[often],
        "length": decimal(np.sqrt((steps * steps).sum(axis=1)), _DECIMALS),
    }
    points = places[np.stack((u, v), axis=1).ravel()]
    return MapTable(places, road_map.plane is not None, np.arange(0, 2 * len(u) + 1, 2), points, columns)


def way_table(ways: WayMap) -> MapTable:
    """Put a clean map's junctions and ways in columns: counts, length, width, and speeds where they are known.

    Examples
    --------
    >>> line, none = np.array([[0.0, 0.0], [3.0, 4.0]]), np.zeros((1, 0))
    >>> one, ends = np.ones(1, np.int64), np.array([[0, 1]], np.int32)
    >>> ways = WayMap(line, ends, np.array([0, 2]), line, np.array([5.0]), one, one, np.full((1, 3), 2.0), none, np.ones(1))
    >>> list(way_table(ways).properties)
    ['u', 'v', 'forward', 'backward', 'length', 'width', 'speed', 'speed_q1', 'speed_q3']
    """
    u, v = ways.ends.astype(np.int64).T
    columns = {
        "u": u,
        "v": v,
        "forward": ways.forward,
        "backward": ways.backward,
        "length": _rounded(ways.length),
        "width": _rounded(ways.width),
        "speed": _rounded(ways.speed[:, 1]),
        "speed_q1": _rounded(ways.speed[:, 0]),
        "speed_q3": _rounded(ways.speed[:, 2]),
    }
    parts = ways.hourly.shape[1]
    columns |= {f"speed_{24 * i // parts:02d}h": _rounded(ways.hourly[:, i]) for i in range(parts)}
    places, points = (_places(positions, ways.plane) for positions in (ways.junctions, ways.points))
    return MapTable(places, ways.plane is not None, ways.offsets, points, columns, shaped=True)


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.isnan(values), np.nan, decimal(np.nan_to_num(values), _DECIMALS))


def _places(positions: NDArray[np.float64], plane: Plane | None) -> NDArray[np.float64]:
    if plane is None or not len(positions):
        return decimal(positions, _DECIMALS)
    lat, lon = to_geographic(positions[:, :2], plane)
    return decimal(np.stack([lon, lat], axis=1), _DECIMALS + DEGREE_DIGITS)
