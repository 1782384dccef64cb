"""Write a map as GeoParquet 1.1: a table with a column of lines in well-known binary."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from gpszip.geo.crs import to_projjson
from gpszip.io.maps.table import MapTable
from gpszip.io.maps.wkb import table_wkb

__all__ = ["write_map_geoparquet"]

#: Version of GeoParquet.
_VERSION = "1.1.0"

#: Column of the lines.
_GEOMETRY = "geometry"


def write_map_geoparquet(table: MapTable, path: Path) -> None:
    """Write the columns of edges and their lines. NaN becomes null.

    A map in degrees is in the default coordinate system of GeoParquet, longitude and latitude on
    WGS84. That of a map in metres is local.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    """
    columns = {name: pa.array(v, from_pandas=True) for name, v in table.properties.items()}
    columns[_GEOMETRY] = pa.array(table_wkb(table).tolist(), pa.binary())
    metadata = {"geo": json.dumps(_geo_metadata(table))}
    pq.write_table(pa.table(columns).replace_schema_metadata(metadata), path)


def _geo_metadata(table: MapTable) -> dict[str, Any]:
    """Return the metadata that GeoParquet asks for."""
    kind = "MultiLineString" if len(table.cuts) else "LineString"
    column: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": [kind + (" Z" if table.points.shape[1] == 3 else "")],
    }
    # Smallest, then largest coordinates.
    if len(table.points):
        column["bbox"] = [*table.points.min(axis=0).tolist(), *table.points.max(axis=0).tolist()]
    if not table.geographic:
        column["crs"] = to_projjson(table.crs)
    return {"version": _VERSION, "primary_column": _GEOMETRY, "columns": {_GEOMETRY: column}}
