"""Which column of a frame holds geometries, how they are encoded, and their coordinate system."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import pyarrow as pa

from gpszip.errors import InputError

__all__ = ["GeometryColumn", "find_geometry"]

#: Encodings by the names of Arrow's extension types (GeoArrow) and of GeoParquet.
_ENCODINGS = {
    **dict.fromkeys(("geoarrow.wkb", "ogc.wkb", "wkb"), "wkb"),
    **dict.fromkeys(("geoarrow.point", "point"), "point"),
    **dict.fromkeys(("geoarrow.linestring", "linestring"), "linestring"),
}

#: Names of columns of binary that hold geometries though nothing says so.
_PLAIN_NAMES = ("geometry", "geom", "wkb_geometry", "the_geom", "wkb")

#: The coordinate system of GeoParquet that names none.
_GEOPARQUET_CRS = "OGC:CRS84"


class GeometryColumn(NamedTuple):
    """A column of geometries.

    Parameters
    ----------
    number : int
        Index of the column.
    encoding : str
        ``wkb`` (well-known binary), ``point`` or ``linestring`` (coordinates in Arrow's own types).
    crs : str or None
        Coordinate system as a name, as JSON or as well-known text; None if there is none.
    is_stated : bool
        Whether the frame says that it holds geometries, rather than its name and type alone.
    """

    number: int
    encoding: str
    crs: str | None
    is_stated: bool = True


def find_geometry(schema: Any, where: str) -> GeometryColumn | None:
    """Find the column of geometries by the metadata of an Arrow schema.

    Parameters
    ----------
    schema : pyarrow.Schema
        The schema.
    where : str
        Name of the frame in messages.

    Raises
    ------
    InputError
        If the geometries are in another encoding than well-known binary, points or lines.

    Examples
    --------
    >>> text = {"ARROW:extension:name": "geoarrow.wkb"}
    >>> find_geometry(pa.schema([pa.field("where", pa.binary(), metadata=text)]), "Table")
    GeometryColumn(number=0, encoding='wkb', crs=None, is_stated=True)
    """
    # Extension types of GeoArrow; then the metadata of GeoParquet, which names a primary column.
    found = {field.name: kind for field in schema if (kind := _extension(field))}
    primary, parquet = _geoparquet_columns(schema)
    found = {**parquet, **found}
    name = primary if primary in found else next(iter(found), None)

    # Else a column of binary that is named like one.
    if name is None:
        plain = next((name for name in _PLAIN_NAMES if _is_binary(schema, name)), None)
        if plain is None:
            return None
        return GeometryColumn(schema.get_field_index(plain), "wkb", None, is_stated=False)

    encoding, crs = found[name]
    if encoding.lower() not in _ENCODINGS:
        raise InputError(
            f"column {name!r} holds geometries as {encoding}, not points or lines",
            path=where,
            remedy="write them as well-known binary, or name columns of latitudes and longitudes",
        )
    return GeometryColumn(schema.get_field_index(name), _ENCODINGS[encoding.lower()], crs)


def _extension(field: Any) -> tuple[str, str | None] | None:
    """Encoding and coordinate system of a column with an extension type of GeoArrow."""
    # A type that Arrow knows has a name of its own; that of others stays in the metadata.
    if isinstance(field.type, pa.BaseExtensionType):
        name, metadata = field.type.extension_name, field.type.__arrow_ext_serialize__()
    else:
        stored = field.metadata or {}
        name = stored.get(b"ARROW:extension:name", b"").decode("utf-8", "replace")
        metadata = stored.get(b"ARROW:extension:metadata", b"")
    if not name.startswith(("geoarrow.", "ogc.")):
        return None
    return name, _crs_text(_parse_json(metadata).get("crs"))


def _geoparquet_columns(schema: Any) -> tuple[str | None, dict[str, tuple[str, str | None]]]:
    """Primary column, and encoding and coordinate system of each column, by GeoParquet."""
    parsed = _parse_json((schema.metadata or {}).get(b"geo", b""))
    columns = parsed.get("columns")
    if not isinstance(columns, Mapping):
        return None, {}
    found = {
        name: (str(column.get("encoding", "WKB")), _crs_text(column.get("crs", _GEOPARQUET_CRS)))
        for name, column in columns.items()
        if isinstance(column, Mapping) and name in schema.names
    }
    primary = parsed.get("primary_column")
    return primary if isinstance(primary, str) else None, found


def _parse_json(text: bytes) -> dict[str, Any]:
    """Parse a JSON object; an empty one for anything else."""
    try:
        parsed = json.loads(text)
    except ValueError:
        return {}
    return parsed if isinstance(parsed, dict) else {}


def _crs_text(crs: Any) -> str | None:
    return crs if crs is None or isinstance(crs, str) else json.dumps(crs)


def _is_binary(schema: Any, name: str) -> bool:
    # Of several columns of one name, none is found.
    index = schema.get_field_index(name)
    if index < 0:
        return False
    kind = schema.field(index).type
    return bool(
        pa.types.is_binary(kind) or pa.types.is_large_binary(kind) or pa.types.is_binary_view(kind)
    )
