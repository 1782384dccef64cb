"""A map as GeoPackage, for geographic information systems."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.io.maps.table import MapTable

__all__ = ["write_map_gpkg"]

#: Kinds of geometries in well-known binary; 1000 more with z.
_LINE, _MULTI = 2, 5


def write_map_gpkg(table: MapTable, path: Path) -> None:
    """Write the layer ``edges``, or ``ways``, with the columns as fields; lengths in metres, speeds in m/s.

    Lines that cross the antimeridian are cut there.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    """
    import pyogrio

    # GDAL builds it in memory: it tells nothing of a disk that is full when it closes a file
    made = io.BytesIO()
    pyogrio.raw.write(
        made,
        geometry=_to_wkb(table),
        field_data=list(table.properties.values()),
        fields=list(table.properties),
        layer="ways" if table.has_shapes else "edges",
        driver="GPKG",
        geometry_type=("MultiLineString" if len(table.cuts) else "LineString")
        + (" Z" if table.points.shape[1] == 3 else ""),
        crs="EPSG:4326" if table.geographic else 'LOCAL_CS["metres",UNIT["metre",1]]',
    )
    path.write_bytes(made.getbuffer())


def _to_wkb(table: MapTable) -> NDArray[np.object_]:
    """Lines in well-known binary; if any is cut, all are MultiLineStrings, as a layer is of one kind."""
    packed, point = table.points.astype("<f8").tobytes(), 8 * table.points.shape[1]
    space = 1000 if table.points.shape[1] == 3 else 0
    lines = np.empty(len(table), dtype=object)
    for i, parts in enumerate(table.line_parts):
        several = [
            struct.pack("<BII", 1, _LINE + space, part.stop - part.start)
            + packed[part.start * point : part.stop * point]
            for part in parts
        ]
        lines[i] = (
            struct.pack("<BII", 1, _MULTI + space, len(several)) + b"".join(several)
            if len(table.cuts)
            else several[0]
        )
    return lines
