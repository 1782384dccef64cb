"""From metres on a plane back to latitude and longitude: what a :class:`Plane` means."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.model.grid import Plane

if TYPE_CHECKING:
    from pyproj import Transformer

__all__ = [
    "UNITS_PER_DEGREE",
    "map_coordinates",
    "plane_indices",
    "project",
    "projection",
    "to_geographic",
]

#: A plane's centre is kept in units of 1e-7 degrees, which are about a centimetre.
UNITS_PER_DEGREE = 1e7

Floats = NDArray[np.float64]


def map_coordinates(positions: Floats, plane: Plane | None) -> Floats:
    """Positions in the coordinates that the log came in.

    Parameters
    ----------
    positions : float64 array, shape (n, d)
        Metres. Rows with NaN stay NaN.
    plane : Plane or None
        The plane of a log in degrees; None for a log in x, y.

    Returns
    -------
    float64 array, shape (n, d)
        Latitude and longitude in degrees for a log in degrees, the positions themselves otherwise.

    Examples
    --------
    >>> map_coordinates(np.zeros((1, 2)), Plane(((525000000, 134000000),))).round(9).tolist()
    [[52.5, 13.4]]
    """
    if plane is None:
        return positions
    # Only the first two coordinates lie on the plane.
    coordinates = positions.copy()
    unknown = np.isnan(positions[:, 0])
    if unknown.any():
        known = ~unknown
        coordinates[known, :2] = np.stack(to_geographic(positions[known, :2], plane), axis=1)
    else:
        coordinates[:, 0], coordinates[:, 1] = to_geographic(positions[:, :2], plane)
    return coordinates


def to_geographic(positions: ArrayLike, plane: Plane) -> tuple[Floats, Floats]:
    """Latitude and longitude of positions on the planes.

    Parameters
    ----------
    positions : array_like, shape (n, 2)
        Metres.
    plane : Plane
        The planes on which they lie.

    Returns
    -------
    lat, lon : float64 array, shape (n,)
        Degrees; lon in [-180, 180].

    Examples
    --------
    >>> lat, lon = to_geographic([[0.0, 0.0]], Plane(((600000000, 250000000),)))
    >>> lat.round(9).tolist(), lon.round(9).tolist()
    ([60.0], [25.0])
    """
    positions = np.asarray(positions, dtype=np.float64)
    if len(plane.centers) == 1:
        return _unproject(positions[:, 0], positions[:, 1], plane.centers[0])
    index = plane_indices(positions, plane)
    lat, lon = np.empty(len(positions)), np.empty(len(positions))
    # Each plane has its own projection, and its own range of x.
    for i in np.unique(index).tolist():
        on_plane = index == i
        x = positions[on_plane, 0] - i * Plane.SPREAD
        lat[on_plane], lon[on_plane] = _unproject(x, positions[on_plane, 1], plane.centers[i])
    return lat, lon


def project(lat: Floats, lon: Floats, center: tuple[int, int]) -> tuple[Floats, Floats]:
    """Metres to the east and to the north of a plane's centre."""
    from gpszip.model.plane_series import onto_plane

    return onto_plane(lat, lon, center[1] / UNITS_PER_DEGREE, projection(center).transform)


def _unproject(x: Floats, y: Floats, center: tuple[int, int]) -> tuple[Floats, Floats]:
    """Latitude and longitude of metres to the east and to the north of a plane's centre."""
    from gpszip.model.plane_series import from_plane

    inverse = partial(projection(center).transform, direction="INVERSE")
    return from_plane(x, y, center[1] / UNITS_PER_DEGREE, inverse)


def plane_indices(positions: ArrayLike, plane: Plane) -> NDArray[np.int64]:
    """Which of the planes each position lies on.

    Parameters
    ----------
    positions : array_like, shape (n, 2)
        Metres.
    plane : Plane
        The planes.

    Returns
    -------
    int64 array, shape (n,)
        In [0, number of planes).

    Examples
    --------
    >>> two = Plane(((0, 0), (0, 900000000)))
    >>> plane_indices([[5.0, 0.0], [Plane.SPREAD - 7.0, 0.0]], two).tolist()
    [0, 1]
    """
    # A plane carries positions far less than half a spread from its centre, at x = i * spread. So
    # the nearest centre in x is that of the position's plane.
    x = np.asarray(positions, dtype=np.float64)[:, 0]
    return np.clip(np.rint(x / Plane.SPREAD), 0, len(plane.centers) - 1).astype(np.int64)


@lru_cache(maxsize=256)
def projection(center: tuple[int, int]) -> Transformer:
    """Transverse Mercator projection of WGS84 about a centre, scale 1, from degrees to metres."""
    # A log in x and y needs no projection, and doesn't wait for this import.
    from pyproj import Transformer

    lat, lon = center[0] / UNITS_PER_DEGREE, center[1] / UNITS_PER_DEGREE

    # Seven decimals are exactly the units in which a centre is kept. PROJ expects radians.
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        f"+step +proj=tmerc +lat_0={lat:.7f} +lon_0={lon:.7f} +ellps=WGS84"
    )
