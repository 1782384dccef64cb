"""The nodes and edges of a map as columns, which can be written in any format."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.crs import METRES
from gpszip.geo.degree_lines import DegreeLines, lines_in_degrees
from gpszip.geo.planes import to_geographic
from gpszip.io.logs.track_rows import DEGREE_DIGITS, round_decimals
from gpszip.model import CleanMap, Plane, RoadMap

__all__ = ["MapTable", "clean_map_table", "learned_table", "map_table"]

#: Decimals of metres in files.
_DECIMALS = 3

#: Metres by which a line in degrees may deviate from the line on the plane.
_MAX_DEVIATION = 0.1


@dataclass(frozen=True, eq=False)
class MapTable:
    """Columns of a map.

    Parameters
    ----------
    node_positions : float64 array, shape (V, d)
        Positions of nodes or junctions: longitude and latitude in degrees, or metres.
    geographic : bool
        Whether positions are degrees.
    offsets : int64 array, shape (E + 1,)
        Vertices of line i are ``points[offsets[i]:offsets[i + 1]]``.
    points : float64 array, shape (n, d)
        Vertices of the lines. A long edge in degrees has some between its nodes, since a line that
        is straight on a plane is not straight in degrees.
    properties : dict of str to array, shape (E,)
        Columns of the lines by their names in files. The first are u and v, the indices of the
        nodes where each line starts and ends. NaN is a missing value.
    has_shapes : bool
        Whether lines have points between their ends.
    cuts : int64 array, shape (c,)
        Sorted indices into ``points`` at which a line goes on across the antimeridian.
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
    def crs(self) -> str:
        """Coordinate system: degrees on the earth, or metres of no place on it."""
        return "EPSG:4326" if self.geographic else METRES

    @property
    def nodes(self) -> NDArray[np.int64]:
        """Nodes at which a line starts or ends, in the order of their numbers."""
        ends = np.concatenate([self.properties["u"], self.properties["v"]])
        return np.unique(ends.astype(np.int64))

    @property
    def traversals(self) -> NDArray[np.int64]:
        """How often each line was travelled in both directions together."""
        both = np.stack([self.properties["forward"], self.properties["backward"]])
        traversals: NDArray[np.int64] = both.astype(np.int64).sum(axis=0)
        return traversals

    @property
    def fragments(self) -> list[list[slice]]:
        """Indices of the vertices of each line: one slice, or several if the line is cut."""
        offsets = self.offsets.tolist()
        if not len(self.cuts):
            return [[slice(start, stop)] for start, stop in pairwise(offsets)]

        # The cuts of line i are those after its first vertex and before its end.
        first_cut = np.searchsorted(self.cuts, offsets, "right").tolist()
        last_cut = np.searchsorted(self.cuts, offsets, "left").tolist()
        cuts = self.cuts.tolist()
        fragments = []
        for i, (start, stop) in enumerate(pairwise(offsets)):
            bounds = [start, *cuts[first_cut[i] : last_cut[i + 1]], stop]
            fragments.append([slice(a, b) for a, b in pairwise(bounds)])
        return fragments

    @property
    def wkt(self) -> list[str]:
        """Lines in well-known text."""
        z_flag = " Z" if self.points.shape[1] == 3 else ""
        vertices = [" ".join(map(repr, point)) for point in self.points.tolist()]
        lines = []
        for slices in self.fragments:
            texts = [f"({', '.join(vertices[fragment])})" for fragment in slices]
            if len(texts) == 1:
                lines.append(f"LINESTRING{z_flag} {texts[0]}")
            else:
                lines.append(f"MULTILINESTRING{z_flag} ({', '.join(texts)})")
        return lines


def learned_table(learned: RoadMap | CleanMap, min_traversals: int = 0) -> MapTable:
    """Return a map of either kind as columns.

    Parameters
    ----------
    learned : RoadMap or CleanMap
        The map.
    min_traversals : int
        Leave out edges of a road map with fewer traversals; a clean map has its own minimum.
    """
    if isinstance(learned, CleanMap):
        return clean_map_table(learned)
    return map_table(learned, min_traversals)


def map_table(road_map: RoadMap, min_traversals: int = 0) -> MapTable:
    """Return the nodes and edges of a road map as columns.

    Parameters
    ----------
    road_map : RoadMap
        The map.
    min_traversals : int
        Leave out edges with fewer traversals in both directions together.

    Returns
    -------
    MapTable
        Nodes keep their numbers.

    Examples
    --------
    >>> nodes, edges = np.array([[0.0, 0.0], [3.0, 4.0]]), np.array([[0, 1]], dtype=np.int32)
    >>> road_map = RoadMap(nodes, edges, np.array([2]), np.array([1]))
    >>> map_table(road_map).properties["length"].tolist()
    [5.0]
    >>> len(map_table(road_map, min_traversals=4))
    0
    """
    # Columns.
    is_kept = road_map.forward + road_map.backward >= min_traversals
    u, v = road_map.edges[is_kept].astype(np.int64).T
    steps = road_map.nodes[v] - road_map.nodes[u]
    columns = {
        "u": u,
        "v": v,
        "forward": road_map.forward[is_kept],
        "backward": road_map.backward[is_kept],
        "length": round_decimals(np.sqrt((steps * steps).sum(axis=1)), _DECIMALS),
    }

    # Coordinates.
    # Each edge is a line of two vertices: edge i has the points 2i and 2i + 1.
    points = road_map.nodes[np.stack((u, v), axis=1).ravel()]
    lines = _to_output_lines(points, np.arange(0, 2 * len(u) + 1, 2), road_map.plane)
    return MapTable(
        _to_output_coordinates(road_map.nodes, road_map.plane),
        road_map.plane is not None,
        lines.offsets,
        lines.points,
        columns,
        cuts=lines.cuts,
    )


def clean_map_table(clean_map: CleanMap) -> MapTable:
    """Return the junctions and edges of a clean map as columns.

    The columns are counts of traversals, length, width, and quartiles of speeds; hourly speeds if
    the map has them.

    Parameters
    ----------
    clean_map : CleanMap
        The map.
    """
    # Columns.
    u, v = clean_map.ends.astype(np.int64).T
    columns = {
        "u": u,
        "v": v,
        "forward": clean_map.forward,
        "backward": clean_map.backward,
        "length": _round_metres(clean_map.length),
        "width": _round_metres(clean_map.width),
        "speed": _round_metres(clean_map.speed[:, 1]),
        "speed_q1": _round_metres(clean_map.speed[:, 0]),
        "speed_q3": _round_metres(clean_map.speed[:, 2]),
    }
    interval_count = clean_map.hourly.shape[1]
    for i in range(interval_count):
        # A column is named by the hour at which its interval of the day begins.
        hour = 24 * i // interval_count
        columns[f"speed_{hour:02d}h"] = _round_metres(clean_map.hourly[:, i])

    # Coordinates.
    lines = _to_output_lines(clean_map.points, clean_map.offsets, clean_map.plane)
    return MapTable(
        _to_output_coordinates(clean_map.junctions, clean_map.plane),
        clean_map.plane is not None,
        lines.offsets,
        lines.points,
        columns,
        has_shapes=True,
        cuts=lines.cuts,
    )


def _round_metres(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round metres or m/s; NaN stays."""
    # NaN is replaced for the rounding only.
    return np.where(np.isnan(values), np.nan, round_decimals(np.nan_to_num(values), _DECIMALS))


def _to_output_coordinates(
    positions: NDArray[np.float64], plane: Plane | None
) -> NDArray[np.float64]:
    """Return longitude and latitude, or metres, rounded."""
    if plane is None or not len(positions):
        return round_decimals(positions, _DECIMALS)
    lat, lon = to_geographic(positions[:, :2], plane)
    return round_decimals(np.stack([lon, lat], axis=1), _DECIMALS + DEGREE_DIGITS)


def _to_output_lines(
    positions: NDArray[np.float64], offsets: NDArray[np.int64], plane: Plane | None
) -> DegreeLines:
    """Return lines in degrees, cut at the antimeridian, or in metres; rounded."""
    if plane is None or not len(positions):
        return DegreeLines(round_decimals(positions, _DECIMALS), offsets, np.empty(0, np.int64))
    return lines_in_degrees(
        positions[:, :2], offsets, plane, _MAX_DEVIATION, decimals=_DECIMALS + DEGREE_DIGITS
    )
