"""Coordinates of any system that has a name to longitude and latitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError

__all__ = ["is_geographic", "to_degrees"]


def is_geographic(crs: str, where: str) -> bool:
    """Whether a coordinate system is in degrees.

    Parameters
    ----------
    crs : str
        A name such as ``EPSG:32633``, or well-known text.
    where : str
        Name of the data for messages.

    Raises
    ------
    InputError
        If nobody knows it.

    Examples
    --------
    >>> is_geographic("EPSG:4326", "roads"), is_geographic("EPSG:32633", "roads")
    (True, False)
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return bool(CRS.from_user_input(crs).is_geographic)
    except CRSError as error:
        short = " ".join(crs.split())[:60]
        raise InputError(f"{where}: unknown coordinate system {short!r}; convert it to WGS84 (EPSG:4326) first") from error


def to_degrees(points: NDArray[np.float64], crs: str, where: str) -> NDArray[np.float64]:
    """Longitude and latitude on WGS84.

    Parameters
    ----------
    points : float64 array, shape (n, 2)
        In the system's own units, east first.
    crs : str
        The system.
    where : str
        Name of the data for messages.

    Returns
    -------
    float64 array, shape (n, 2)
        Degrees, longitude first; infinite where the system holds no such place.

    Raises
    ------
    InputError
        If nobody knows the system.

    Examples
    --------
    >>> import numpy as np
    >>> to_degrees(np.array([[500000.0, 0.0]]), "EPSG:32633", "roads").round(6).tolist()
    [[15.0, 0.0]]
    """
    is_geographic(crs, where)
    from pyproj import Transformer

    lon, lat = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(points[:, 0], points[:, 1])
    return np.stack((lon, lat), axis=1)
