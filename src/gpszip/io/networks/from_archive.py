"""The clean map of an archive as a road network."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError
from gpszip.geo.planes import to_geographic
from gpszip.io.networks.joining import build_road_graph
from gpszip.io.networks.lines import RoadLines, RoadUsers
from gpszip.io.networks.read import build_network
from gpszip.model import CleanMap, Network, Plane, Track

__all__ = ["clean_map_lines", "clean_map_network"]


def clean_map_network(
    clean_map: CleanMap,
    name: str,
    resolution: float,
    *,
    plane: Plane | None = None,
    near: Sequence[Track] = (),
) -> Network:
    """Return all edges of a clean map as a network.

    Its roads have the same numbers whatever log is matched to it, so that the routes of several
    logs can be compared.

    Parameters
    ----------
    clean_map : CleanMap
        The map.
    name : str
        Name of its archive.
    resolution : float
        Metres of the steps of the archive's grid: its map errs by about as much.
    plane : Plane, optional
        The planes of the network; by default those of the map.
    near : sequence of Track
        A log that must be near the map.

    Raises
    ------
    InputError
        If the map has no edges, or the log is elsewhere.
    """
    # A log that stands still has no edges.
    if not len(clean_map):
        raise InputError(
            "its map has no edges", path=name, remedy="compress a log in which something moves"
        )

    # The part near the log is built only to find out whether there is one.
    roads = build_road_graph(clean_map_lines(clean_map, name, resolution))
    if near:
        build_network(roads, plane=plane, near=near)
    return build_network(roads, plane=plane or clean_map.plane).network


def clean_map_lines(clean_map: CleanMap, name: str, resolution: float) -> RoadLines:
    """Return the edges of a clean map as road lines.

    Every edge may be travelled both ways: if the log has travels in one direction only, the other
    direction need not be forbidden.

    Parameters
    ----------
    clean_map : CleanMap
        The map.
    name : str
        Name of its archive.
    resolution : float
        Metres of the steps of the archive's grid.

    Returns
    -------
    RoadLines
        Speeds are the median speeds of travel, NaN where unknown. Ids are the numbers of the
        edges; there are no street names.
    """
    # A map with one axis lies on the line y = 0.
    points = clean_map.points[:, :2]
    if points.shape[1] < 2:
        points = np.pad(points, ((0, 0), (0, 1)))
    if clean_map.plane is not None:
        lat, lon = to_geographic(points, clean_map.plane)
        points = np.stack((lon, lat), axis=1)

    # Take the median speed of travel, the middle of three columns, as expected speed.
    count = len(clean_map)
    return RoadLines(
        name=name,
        coordinates=points,
        offsets=clean_map.offsets.astype(np.int64),
        geographic=clean_map.plane is not None,
        forward=np.ones(count, np.bool_),
        backward=np.ones(count, np.bool_),
        speeds=clean_map.speed[:, 1].astype(np.float64),
        users=np.full(count, RoadUsers.ANYBODY, np.uint8),
        ids=pa.array([str(i) for i in range(count)], pa.string()),
        names=pa.nulls(count, pa.string()),
        error=max(_median_width(clean_map), resolution),
    )


def _median_width(clean_map: CleanMap) -> float:
    """Width of half of all metres of edges, which is 0 where all knots are rounded to one line."""
    known = np.flatnonzero(np.isfinite(clean_map.width))
    if not len(known):
        return 0.0
    order = known[np.argsort(clean_map.width[known], kind="stable")]
    travelled = np.cumsum(clean_map.length[order])
    return float(clean_map.width[order][np.searchsorted(travelled, travelled[-1] / 2)])
