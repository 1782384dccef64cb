"""A map's nodes and edges, or junctions and ways, as columns that can be written in any format."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.degree_lines import DegreeLines, lines_in_degrees
from gpszip.geo.planes import to_geographic
from gpszip.io.logs.track_rows import DEGREE_DIGITS, round_decimals
from gpszip.model import CleanMap, Plane, RoadMap

__all__ = ["MapTable", "clean_map_table", "map_table"]

#: Decimals of metres.
_DECIMALS = 3

#: Metres by which a line in degrees may deviate from the one on the plane.
_MAX_DEVIATION = 0.1


@dataclass(frozen=True, eq=False)
class MapTable:
    """Columns of a map.

    Parameters
    ----------
    node_positions : float64 array, shape (V, d)
        Longitude and latitude in degrees, or metres, of nodes or junctions.
    geographic : bool
        Whether the places are degrees.
    offsets : int64 array, shape (E + 1,)
        Line i runs through ``points[offsets[i]:offsets[i + 1]]``.
    points : float64 array, shape (n, d)
        As the places. Of a long edge or way in degrees, some lie between its nodes, as what is straight on a plane is not
        straight in degrees.
    properties : dict of str to array, shape (E,)
        Columns of the lines by their names in files, first u and v, the places where each line ends. NaN stands for nothing.
    has_shapes : bool
        Whether lines have points between their ends.
    cuts : int64 array, shape (c,)
        Sorted indices into ``points`` at which a line begins anew, on the other side of the antimeridian.
    """

    node_positions: NDArray[np.float64]
    geographic: bool
    offsets: NDArray[np.int64]
    points: NDArray[np.float64]
    properties: dict[str, NDArray[np.generic]]
    has_shapes: bool = False
    cuts: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def axes(self) -> list[str]:
        """Names of the coordinates."""
        return ["lon", "lat"] if self.geographic else list("xyz"[: self.node_positions.shape[1]])

    @property
    def nodes(self) -> NDArray[np.int64]:
        """Nodes at which a line ends, in the order of their numbers."""
        return np.unique(
            np.concatenate([self.properties["u"], self.properties["v"]]).astype(np.int64)
        )

    @property
    def line_parts(self) -> list[list[slice]]:
        """Points of the parts of each line: one, or several where it is cut."""
        ends = self.offsets.tolist()
        if not len(self.cuts):
            return [[slice(i, j)] for i, j in pairwise(ends)]
        first, last = (
            np.searchsorted(self.cuts, ends, side).tolist() for side in ("right", "left")
        )
        cuts = self.cuts.tolist()
        return [
            [slice(i, j) for i, j in pairwise([start, *cuts[first[n] : last[n + 1]], end])]
            for n, (start, end) in enumerate(pairwise(ends))
        ]

    @property
    def wkt(self) -> list[str]:
        """Lines in well-known text."""
        space = " Z" if self.points.shape[1] == 3 else ""
        texts = [" ".join(map(repr, point)) for point in self.points.tolist()]
        lines = [[f"({', '.join(texts[part])})" for part in parts] for parts in self.line_parts]
        return [
            f"LINESTRING{space} {one[0]}"
            if len(one) == 1
            else f"MULTILINESTRING{space} ({', '.join(one)})"
            for one in lines
        ]


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
    node_positions = _to_output_coordinates(road_map.nodes, road_map.plane)
    columns = {
        "u": u,
        "v": v,
        "forward": road_map.forward[often],
        "backward": road_map.backward[often],
        "length": round_decimals(np.sqrt((steps * steps).sum(axis=1)), _DECIMALS),
    }
    points = road_map.nodes[np.stack((u, v), axis=1).ravel()]
    lines = _to_output_lines(points, np.arange(0, 2 * len(u) + 1, 2), road_map.plane)
    return MapTable(
        node_positions,
        road_map.plane is not None,
        lines.offsets,
        lines.points,
        columns,
        cuts=lines.cuts,
    )


def clean_map_table(ways: CleanMap) -> MapTable:
    """Put a clean map's junctions and ways in columns: counts, length, width, and speeds where they are known.

    Examples
    --------
    >>> line, none = np.array([[0.0, 0.0], [3.0, 4.0]]), np.zeros((1, 0))
    >>> one, ends = np.ones(1, np.int64), np.array([[0, 1]], np.int32)
    >>> ways = CleanMap(line, ends, np.array([0, 2]), line, np.array([5.0]), one, one, np.full((1, 3), 2.0), none, np.ones(1))
    >>> list(clean_map_table(ways).properties)
    ['u', 'v', 'forward', 'backward', 'length', 'width', 'speed', 'speed_q1', 'speed_q3']
    """
    u, v = ways.ends.astype(np.int64).T
    columns = {
        "u": u,
        "v": v,
        "forward": ways.forward,
        "backward": ways.backward,
        "length": _round_metres(ways.length),
        "width": _round_metres(ways.width),
        "speed": _round_metres(ways.speed[:, 1]),
        "speed_q1": _round_metres(ways.speed[:, 0]),
        "speed_q3": _round_metres(ways.speed[:, 2]),
    }
    parts = ways.hourly.shape[1]
    columns |= {
        f"speed_{24 * i // parts:02d}h": _round_metres(ways.hourly[:, i]) for i in range(parts)
    }
    lines = _to_output_lines(ways.points, ways.offsets, ways.plane)
    node_positions = _to_output_coordinates(ways.junctions, ways.plane)
    return MapTable(
        node_positions,
        ways.plane is not None,
        lines.offsets,
        lines.points,
        columns,
        has_shapes=True,
        cuts=lines.cuts,
    )


def _round_metres(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.isnan(values), np.nan, round_decimals(np.nan_to_num(values), _DECIMALS))


def _to_output_coordinates(
    positions: NDArray[np.float64], plane: Plane | None
) -> NDArray[np.float64]:
    if plane is None or not len(positions):
        return round_decimals(positions, _DECIMALS)
    lat, lon = to_geographic(positions[:, :2], plane)
    return round_decimals(np.stack([lon, lat], axis=1), _DECIMALS + DEGREE_DIGITS)


def _to_output_lines(
    positions: NDArray[np.float64], offsets: NDArray[np.int64], plane: Plane | None
) -> DegreeLines:
    if plane is None or not len(positions):
        return DegreeLines(round_decimals(positions, _DECIMALS), offsets, np.empty(0, np.int64))
    return lines_in_degrees(
        positions[:, :2], offsets, plane, _MAX_DEVIATION, decimals=_DECIMALS + DEGREE_DIGITS
    )
