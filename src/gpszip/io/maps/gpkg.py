"""Write a map as GeoPackage, for geographic information systems."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import MissingExtraError
from gpszip.io.maps.table import MapTable

__all__ = ["write_map_gpkg"]

#: Type of a LineString in well-known binary.
_LINE_STRING = 2

#: Type of a MultiLineString.
_MULTI_LINE_STRING = 5

#: Added to a type whose points have a z coordinate (ISO).
_WITH_Z = 1000


def write_map_gpkg(table: MapTable, path: Path) -> None:
    """Write the layer ``edges``, or ``ways`` of a clean map, with the columns as fields.

    Lengths are in metres, speeds in m/s. Lines that cross the antimeridian are cut there.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.

    Raises
    ------
    MissingExtraError
        If pyogrio, which brings GDAL, is not installed.
    """
    # GDAL comes with an extra.
    try:
        import pyogrio
    except ImportError as error:
        raise MissingExtraError("gis", "writing a GeoPackage") from error

    # GDAL builds the file in memory: it ignores a full disk when it closes a file.
    package = io.BytesIO()
    geometry_type = "MultiLineString" if len(table.cuts) else "LineString"
    if table.points.shape[1] == 3:
        geometry_type += " Z"
    # Without a local coordinate system, programs may take metres for positions on the earth.
    pyogrio.raw.write(
        package,
        geometry=_to_wkb(table),
        field_data=list(table.properties.values()),
        fields=list(table.properties),
        layer="ways" if table.has_shapes else "edges",
        driver="GPKG",
        geometry_type=geometry_type,
        crs="EPSG:4326" if table.geographic else 'LOCAL_CS["metres",UNIT["metre",1]]',
    )
    path.write_bytes(package.getbuffer())


def _to_wkb(table: MapTable) -> NDArray[np.object_]:
    """Return lines in well-known binary.

    If any line is cut, all are MultiLineStrings, since a layer has one type.
    """
    # Encode all coordinates at once; a fragment is a slice of these bytes.
    coordinates = table.points.astype("<f8").tobytes()
    point_bytes = 8 * table.points.shape[1]
    z_flag = _WITH_Z if table.points.shape[1] == 3 else 0

    # Encode each line from its fragments.
    lines = np.empty(len(table), dtype=object)
    for i, fragments in enumerate(table.fragments):
        # Byte order (1 is little-endian), type, number of points, points.
        encoded = [
            struct.pack("<BII", 1, _LINE_STRING + z_flag, fragment.stop - fragment.start)
            + coordinates[fragment.start * point_bytes : fragment.stop * point_bytes]
            for fragment in fragments
        ]
        if len(table.cuts):
            header = struct.pack("<BII", 1, _MULTI_LINE_STRING + z_flag, len(encoded))
            lines[i] = header + b"".join(encoded)
        else:
            lines[i] = encoded[0]
    return lines
