"""Tracks and archives beside another archive: on its plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.geo.planes import reproject_track, to_plane
from gpszip.model.grid import Plane
from gpszip.model.projection import to_geographic

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import Track

__all__ = ["move_to_plane", "put_on_plane"]


def put_on_plane(tracks: Sequence[Track], archive: Archive) -> list[Track]:
    """Put tracks on the plane of an archive.

    Raises
    ------
    OptionError
        If one is in degrees and the other in metres, they have different numbers of coordinates, or
        a track is too far away from the archive's planes.
    """
    plane = archive.grid.plane
    for track in tracks:
        if (track.plane is None) != (plane is None) or track.dimension != archive.grid.dimension:
            raise OptionError(
                f"track {track.id!r} has other coordinates than the archive",
                remedy="give the log that was compressed",
            )
    return list(tracks) if plane is None else [reproject_track(track, plane) for track in tracks]


def move_to_plane(positions: NDArray[np.float64], own: Plane, plane: Plane) -> NDArray[np.float64]:
    """Move positions in metres from one plane to another; further coordinates stay.

    Examples
    --------
    >>> here, east = Plane(((0, 0),)), Plane(((0, 10_000_000),))
    >>> move_to_plane(np.zeros((1, 2)), here, east).round().tolist()
    [[-111325.0, 0.0]]
    """
    if not len(positions):
        return positions
    lat, lon = to_geographic(positions[:, :2], own)
    moved = positions.copy()
    moved[:, :2] = to_plane(lat, lon, plane)
    return moved
