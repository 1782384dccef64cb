"""Coordinates of any system that has a name to longitude and latitude."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError

if TYPE_CHECKING:
    from pyproj import CRS

__all__ = ["is_geographic", "is_local", "to_degrees"]


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
    return bool(_parse_crs(crs, where).is_geographic)


def is_local(crs: str, where: str) -> bool:
    """Whether a coordinate system lies nowhere on the earth, as that of a building.

    Parameters
    ----------
    crs, where : str
        As for :func:`is_geographic`.

    Raises
    ------
    InputError
        If nobody knows it.

    Examples
    --------
    >>> is_local('LOCAL_CS["hall",UNIT["metre",1]]', "roads"), is_local("EPSG:32633", "roads")
    (True, False)
    """
    return bool(_parse_crs(crs, where).is_engineering)


def _parse_crs(crs: str, where: str) -> CRS:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input(crs)
    except CRSError as error:
        raise _unknown_crs_error(crs, where) from error


def _unknown_crs_error(crs: str, where: str) -> InputError:
    short = " ".join(crs.split())[:60]
    return InputError(
        f"{where}: unknown coordinate system {short!r}; convert it to WGS84 (EPSG:4326) first"
    )


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
    known = _parse_crs(crs, where)
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        lon, lat = Transformer.from_crs(known, "EPSG:4326", always_xy=True).transform(
            points[:, 0], points[:, 1]
        )
    except ProjError as error:
        raise _unknown_crs_error(crs, where) from error
    return np.stack((lon, lat), axis=1)
