"""A map learnt from logs as a network: its ways may be travelled both ways, at the speed at which they were."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from gpszip.geo.planes import to_geographic
from gpszip.io.networks.lines import RoadLines, RoadUsers
from gpszip.model import CleanMap

__all__ = ["clean_map_lines"]


def clean_map_lines(ways: CleanMap, name: str) -> RoadLines:
    """Lines of a clean map.

    That a way was travelled in one direction only does not say that the other one is forbidden.

    Parameters
    ----------
    ways : WayMap
        The map.
    name : str
        Of its archive.

    Returns
    -------
    RoadLines
        With the median speeds where they are known; the ids are their numbers, and they have no names.
    """
    points = ways.points[:, :2]
    if points.shape[1] < 2:
        points = np.pad(points, ((0, 0), (0, 1)))
    if ways.plane is not None:
        lat, lon = to_geographic(points, ways.plane)
        points = np.stack((lon, lat), axis=1)
    return RoadLines(
        name=name,
        coordinates=points,
        offsets=ways.offsets.astype(np.int64),
        geographic=ways.plane is not None,
        forward=np.ones(len(ways), np.bool_),
        backward=np.ones(len(ways), np.bool_),
        speeds=ways.speed[:, 1].astype(np.float64),
        users=np.full(len(ways), RoadUsers.ANYBODY, np.uint8),
        ids=pa.array([str(i) for i in range(len(ways))], pa.string()),
        names=pa.nulls(len(ways), pa.string()),
    )
