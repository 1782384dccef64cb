"""A road map as GeoPackage, for geographic information systems."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.io.map_table import MapTable

__all__ = ["write_map_gpkg"]


def write_map_gpkg(table: MapTable, path: Path) -> None:
    """Write the layer ``edges`` with u, v, forward, backward and length (metres).

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    """
    import pyogrio

    pyogrio.raw.write(
        path,
        geometry=_lines(table),
        field_data=list(table.properties.values()),
        fields=list(table.properties),
        layer="edges",
        driver="GPKG",
        geometry_type="LineString" if table.places.shape[1] == 2 else "LineString Z",
        crs="EPSG:4326" if table.geographic else 'LOCAL_CS["metres",UNIT["metre",1]]',
    )


def _lines(table: MapTable) -> NDArray[np.object_]:
    """Well-known binary: all lines have two ends and so the same layout."""
    width = table.places.shape[1]
    records = np.zeros(len(table.u), dtype=[("order", "u1"), ("kind", "<u4"), ("count", "<u4"), ("ends", "<f8", (2, width))])
    records["order"], records["kind"], records["count"] = 1, 2 if width == 2 else 1002, 2
    records["ends"][:, 0], records["ends"][:, 1] = table.places[table.u], table.places[table.v]
    packed, size = records.tobytes(), records.dtype.itemsize
    lines = np.empty(len(records), dtype=object)
    lines[:] = [packed[i : i + size] for i in range(0, len(packed), size)]
    return lines
