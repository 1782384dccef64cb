"""The coordinate system that a GeoJSON file names."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

__all__ = ["crs_problem"]

#: Endings of names of WGS 84 in degrees: OGC's CRS84, EPSG's 4326 and, with heights, 4979.
_WGS84 = {"crs84", "crs84h", "84", "4326", "4979", "wgs84", "wgs 84"}

#: How to convert a file of GeoJSON.
_CONVERT = "ogr2ogr -t_srs EPSG:4326 OUT.geojson FILE"

#: Letters of a name that messages show.
_MAX_SHOWN_LETTERS = 60


def crs_problem(crs: Any, *, remedy: str = _CONVERT) -> str:
    """Say what is wrong with the coordinate system that the member ``crs`` names.

    Positions in GeoJSON (RFC 7946) are longitudes and latitudes on WGS 84. Files of the older
    GeoJSON 2008 may name another system.

    Parameters
    ----------
    crs : object
        The member; None if there is none.
    remedy : str
        How to bring coordinates to longitude and latitude.

    Returns
    -------
    str
        Empty if it is WGS 84, or none is named.

    Examples
    --------
    >>> crs_problem({"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}})
    ''
    >>> crs_problem({"type": "name", "properties": {"name": "EPSG:3857"}})[:42]
    "its coordinates are in 'EPSG:3857'; bring "
    """
    # Without the member, coordinates are on WGS 84 by RFC 7946.
    if crs is None:
        return ""

    # Find its name.
    properties = crs.get("properties") if isinstance(crs, Mapping) else None
    name = None
    if isinstance(properties, Mapping):
        name = properties.get("name", properties.get("code"))
    if name is None:
        return (
            "names a coordinate system in a way that isn't known; "
            "remove its member 'crs' if it is in longitude and latitude"
        )

    # Is it WGS 84?
    # Names end with the system: urn:ogc:def:crs:OGC:1.3:CRS84, EPSG:4326, .../EPSG/0/4326.
    if re.split("[:/]", str(name).strip().lower())[-1] in _WGS84:
        return ""
    shown = json.dumps(str(name)[:_MAX_SHOWN_LETTERS], ensure_ascii=False)[1:-1]
    return f"its coordinates are in '{shown}'; bring them to longitude and latitude: {remedy}"
