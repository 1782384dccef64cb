"""The coordinate system of geometries: degrees on WGS 84, other positions on earth, or metres."""

from __future__ import annotations

import json
from collections.abc import Mapping
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.crs import is_local, to_degrees

__all__ = ["Reference", "ReferenceKind", "find_reference"]

#: WGS 84 in degrees, by authority and code: geometries have the longitude first in all of them.
_WGS84 = {("OGC", "CRS84"), ("OGC", "CRS84H"), ("EPSG", "4326"), ("EPSG", "4979")}

#: Its names as GDAL writes them.
_WGS84_NAMES = {"EPSG:4326", "EPSG:4979", "OGC:CRS84", "OGC:CRS84H"}


class ReferenceKind(Enum):
    """What the coordinates of geometries are."""

    #: Longitude and latitude on WGS 84.
    WGS84 = "WGS 84"
    #: Positions on earth in another system, which are converted.
    OTHER = "another system"
    #: Metres on a plane of their own.
    LOCAL = "a local system"
    #: No system is stated.
    NONE = "none"


class Reference(NamedTuple):
    """The coordinate system of a column of geometries.

    Parameters
    ----------
    kind : ReferenceKind
        What the coordinates are.
    crs : str
        The system as pyproj reads it; empty if it is WGS 84 or none is stated.
    """

    kind: ReferenceKind
    crs: str = ""

    @property
    def geographic(self) -> bool:
        """Whether positions are read as latitude and longitude, rather than x and y."""
        return self.kind in (ReferenceKind.WGS84, ReferenceKind.OTHER)

    def convert(self, xy: NDArray[np.float64], where: str) -> NDArray[np.float64]:
        """Return positions as longitude and latitude, or as metres.

        Parameters
        ----------
        xy : float64 array, shape (n, 2)
            Coordinates of geometries; NaN for those without.
        where : str
            Name of the file, for messages.

        Raises
        ------
        InputError
            If pyproj can't convert from the system.
        """
        if self.kind is not ReferenceKind.OTHER:
            return xy
        degrees = np.full_like(xy, np.nan)
        has_position = np.isfinite(xy).all(axis=1)
        degrees[has_position] = to_degrees(xy[has_position], self.crs, where)
        return degrees


def find_reference(crs: Any, where: str) -> Reference:
    """Find out what a stated coordinate system means.

    Parameters
    ----------
    crs : mapping, str or None
        PROJJSON, a name or well-known text; None if none is stated.
    where : str
        Name of the file, for messages.

    Raises
    ------
    InputError
        If the system is unknown.

    Examples
    --------
    >>> find_reference({"id": {"authority": "OGC", "code": "CRS84"}}, "a.parquet").geographic
    True
    >>> find_reference(None, "a.parquet").kind
    <ReferenceKind.NONE: 'none'>
    """
    # No system, or WGS 84
    if crs is None or crs == "":
        return Reference(ReferenceKind.NONE)
    if isinstance(crs, str) and crs.upper() in _WGS84_NAMES:
        return Reference(ReferenceKind.WGS84)
    if isinstance(crs, Mapping):
        identity = crs.get("id")
        stated = identity if isinstance(identity, Mapping) else {}
        if (str(stated.get("authority")).upper(), str(stated.get("code")).upper()) in _WGS84:
            return Reference(ReferenceKind.WGS84)
    elif not isinstance(crs, str):
        raise InputError(
            "names its coordinate system in a way that isn't known",
            path=where,
            remedy="write it with longitude and latitude (EPSG:4326)",
        )

    # Any other, which pyproj has to know
    text = crs if isinstance(crs, str) else json.dumps(crs)
    kind = ReferenceKind.LOCAL if is_local(text, where) else ReferenceKind.OTHER
    return Reference(kind, text)
