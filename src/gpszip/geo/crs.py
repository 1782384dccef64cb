"""Conversion from any named coordinate reference system (CRS) to longitude and latitude."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError

if TYPE_CHECKING:
    from pyproj import CRS

__all__ = ["METRES", "is_geographic", "is_local", "to_degrees", "to_projjson"]

#: Metres in x and y that have no place on the earth. Without a coordinate system, programs ask for
#: one, or take metres for degrees.
METRES = 'LOCAL_CS["metres",UNIT["metre",1]]'

#: Characters of an unknown CRS in a message; well-known text takes many lines.
_MAX_CRS_CHARACTERS = 60


def is_geographic(crs: str, where: str) -> bool:
    """Whether a coordinate reference system is in degrees.

    Parameters
    ----------
    crs : str
        A name such as ``EPSG:32633``, or well-known text.
    where : str
        Name of the data, for messages.

    Raises
    ------
    InputError
        If the system is unknown.

    Examples
    --------
    >>> is_geographic("EPSG:4326", "roads"), is_geographic("EPSG:32633", "roads")
    (True, False)
    """
    return bool(_parse_crs(crs, where).is_geographic)


def is_local(crs: str, where: str) -> bool:
    """Whether a coordinate reference system is tied to no position on earth, as in a building.

    Parameters
    ----------
    crs, where : str
        As for :func:`is_geographic`.

    Raises
    ------
    InputError
        If the system is unknown.

    Examples
    --------
    >>> is_local('LOCAL_CS["hall",UNIT["metre",1]]', "roads"), is_local("EPSG:32633", "roads")
    (True, False)
    """
    return bool(_parse_crs(crs, where).is_engineering)


def to_degrees(points: NDArray[np.float64], crs: str, where: str) -> NDArray[np.float64]:
    """Convert coordinates to longitude and latitude on WGS84.

    Parameters
    ----------
    points : float64 array, shape (n, 2)
        Coordinates in the system's own units, east first.
    crs : str
        The system.
    where : str
        Name of the data, for messages.

    Returns
    -------
    float64 array, shape (n, 2)
        Degrees, longitude first; infinite where the system has no such position.

    Raises
    ------
    InputError
        If the system is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> to_degrees(np.array([[500000.0, 0.0]]), "EPSG:32633", "roads").round(6).tolist()
    [[15.0, 0.0]]
    """
    parsed = _parse_crs(crs, where)
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        # Many systems name north first; always_xy puts east first for all.
        transformer = Transformer.from_crs(parsed, "EPSG:4326", always_xy=True)
        lon, lat = transformer.transform(points[:, 0], points[:, 1])
    except ProjError as error:
        raise _unknown_crs_error(crs, where) from error
    return np.stack((lon, lat), axis=1)


def to_projjson(crs: str, where: str = "") -> dict[str, Any]:
    """Return a coordinate reference system as PROJJSON, which GeoParquet holds.

    Parameters
    ----------
    crs, where : str
        As for :func:`is_geographic`.

    Raises
    ------
    InputError
        If the system is unknown.

    Examples
    --------
    >>> to_projjson("EPSG:4326", "log")["id"]
    {'authority': 'EPSG', 'code': 4326}
    >>> to_projjson(METRES)["type"]
    'EngineeringCRS'
    """
    converted: dict[str, Any] = _parse_crs(crs, where).to_json_dict()
    return converted


def _parse_crs(crs: str, where: str) -> CRS:
    """Parse a name or well-known text; raise InputError if it is unknown."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    # Halves of surrogate pairs, which JSON may escape, are no text for PROJ.
    try:
        return CRS.from_user_input(crs)
    except (CRSError, UnicodeEncodeError) as error:
        raise _unknown_crs_error(crs, where) from error


def _unknown_crs_error(crs: str, where: str) -> InputError:
    shortened = " ".join(crs.split())[:_MAX_CRS_CHARACTERS]
    return InputError(
        f"unknown coordinate system {shortened!r}",
        path=where,
        remedy="convert it to WGS84 (EPSG:4326) first",
    )
