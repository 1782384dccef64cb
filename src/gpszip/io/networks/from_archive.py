"""The clean map of an archive as a road network."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from gpszip.geo.planes import to_geographic
from gpszip.io.networks.lines import RoadLines, RoadUsers
from gpszip.model import CleanMap

__all__ = ["clean_map_lines"]


def clean_map_lines(clean_map: CleanMap, name: str) -> RoadLines:
    """Return the edges of a clean map as road lines.

    Every edge may be travelled both ways: if the log has travels in one direction only, the other
    direction need not be forbidden.

    Parameters
    ----------
    clean_map : CleanMap
        The map.
    name : str
        Name of its archive.

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
    )
