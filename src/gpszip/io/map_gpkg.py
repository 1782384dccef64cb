"""A map as GeoPackage, for geographic information systems."""

from __future__ import annotations

import io
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.io.map_table import MapTable

__all__ = ["write_map_gpkg"]


def write_map_gpkg(table: MapTable, path: Path) -> None:
    """Write the layer ``edges``, or ``ways``, with the columns as fields; lengths in metres, speeds in m/s.

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
        geometry=_lines(table),
        field_data=list(table.properties.values()),
        fields=list(table.properties),
        layer="ways" if table.shaped else "edges",
        driver="GPKG",
        geometry_type="LineString" if table.places.shape[1] == 2 else "LineString Z",
        crs="EPSG:4326" if table.geographic else 'LOCAL_CS["metres",UNIT["metre",1]]',
    )
    path.write_bytes(made.getbuffer())


def _lines(table: MapTable) -> NDArray[np.object_]:
    """Lines in well-known binary."""
    kind = 2 if table.points.shape[1] == 2 else 1002
    starts, packed = table.offsets.tolist(), table.points.astype("<f8").tobytes()
    point = 8 * table.points.shape[1]
    lines = np.empty(len(table), dtype=object)
    lines[:] = [struct.pack("<BII", 1, kind, j - i) + packed[i * point : j * point] for i, j in pairwise(starts)]
    return lines
