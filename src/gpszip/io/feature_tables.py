"""Write rows as CSV, JSON and Parquet, and as features of GeoJSON (RFC 7946)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.geo.degree_lines import cut_at_antimeridian
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.logs.track_rows import round_decimals
from gpszip.io.storage.sink import open_sink
from gpszip.io.tables.quotes import quote_text

__all__ = [
    "TABLE_FORMATS",
    "Row",
    "check_table_format",
    "features_text",
    "line_geometry",
    "write_features",
    "write_json",
    "write_table",
]

#: Formats with their suffixes; the first is that of standard output.
TABLE_FORMATS = {
    "csv": (".csv",),
    "json": (".json",),
    "geojson": (".geojson",),
    "parquet": (".parquet",),
}

Row = Mapping[str, Any]


def check_table_format(target: str, what: str) -> str:
    """Return the format of a file by its suffix; CSV for standard output.

    Parameters
    ----------
    target : str
        Name of the file, or ``-``.
    what : str
        What the rows are, for the error.

    Raises
    ------
    OutputError
        If there is no such format.

    Examples
    --------
    >>> check_table_format("T.geojson", "trips"), check_table_format("-", "trips")
    ('geojson', 'csv')
    """
    if target == "-":
        return next(iter(TABLE_FORMATS))
    suffix = Path(target).suffix.lower()
    for name, suffixes in TABLE_FORMATS.items():
        if suffix in suffixes:
            return name
    shown = ", ".join(suffixes[0] for suffixes in TABLE_FORMATS.values())
    raise OutputError(
        f"{what} can be written as {shown}, not as {suffix or 'a file without a suffix'}",
        path=target,
        remedy="name a file with such a suffix",
    )


def write_table(rows: Sequence[Row], kinds: Mapping[str, str], target: str, format: str) -> None:
    """Write rows as CSV or Parquet.

    Parameters
    ----------
    rows : sequence of mapping of str to value
        Each has all columns; None is missing.
    kinds : mapping of str to str
        Names of the columns, and kinds of their values as NumPy's ``dtype.kind``: ``f``, ``i`` and
        ``b``; any other is text. Columns without a value have their type, too.
    target : str
        Name of the file; ``-`` is standard output.
    format : str
        ``csv`` or ``parquet``.

    Raises
    ------
    OutputError
        If the file can't be written.
    """
    import pyarrow as pa

    # A table whose types don't depend on its rows.
    types = {"f": pa.float64(), "i": pa.int64(), "b": pa.bool_()}
    columns = {
        name: pa.array([row[name] for row in rows], types.get(kind, pa.string()))
        for name, kind in kinds.items()
    }
    table = pa.table(columns)
    if format == "parquet":
        import pyarrow.parquet as pq

        with open_sink(target) as sink:
            pq.write_table(table, sink)
        return
    import pyarrow.csv as pc

    # Arrow quotes all texts or none: quote them only if one needs it.
    texts = (table[name].unique().to_pylist() for name in kinds if kinds[name] not in types)
    needs_quotes = any(text and quote_text(text) != text for column in texts for text in column)
    style = "needed" if needs_quotes else "none"
    with open_sink(target) as sink:
        # Arrow's header has quotes around every name.
        sink.write((",".join(quote_text(name) for name in kinds) + "\n").encode())
        pc.write_csv(table, sink, pc.WriteOptions(include_header=False, quoting_style=style))


def write_json(document: Row, target: str) -> None:
    """Write a document as JSON; numbers that JSON doesn't know are null."""
    _write_text(json.dumps(_strict(document), ensure_ascii=False) + "\n", target)


def write_features(
    rows: Iterable[Row], geometries: Iterable[Row], target: str, *, geographic: bool
) -> None:
    """Write rows with their geometries as GeoJSON.

    Parameters
    ----------
    rows : iterable of mapping of str to value
        Properties of each feature.
    geometries : iterable of mapping
        Geometry of each, such as :func:`line_geometry` returns.
    target : str
        Name of the file; ``-`` is standard output.
    geographic : bool
        Whether positions are longitudes and latitudes; metres are marked by the member ``gpszip``.

    Raises
    ------
    OutputError
        If the file can't be written.
    """
    _write_text(features_text(rows, geometries, geographic=geographic), target)


def features_text(rows: Iterable[Row], geometries: Iterable[Row], *, geographic: bool) -> str:
    """GeoJSON with a feature on each line; parameters are those of :func:`write_features`."""
    features = (
        {"type": "Feature", "properties": _strict(row), "geometry": geometry}
        for row, geometry in zip(rows, geometries, strict=True)
    )
    # The slice strips the braces, so that the member stands beside "features".
    member = "" if geographic else f"{json.dumps(METRES_MEMBER)[1:-1]}, "
    lines = ",\n".join(json.dumps(feature, ensure_ascii=False) for feature in features)
    return f'{{"type": "FeatureCollection", {member}"features": [\n{lines}\n]}}\n'


def line_geometry(line: NDArray[np.float64], decimals: int, *, geographic: bool) -> dict[str, Any]:
    """A line as a geometry of GeoJSON, cut where it crosses the antimeridian (RFC 7946, 3.1.9).

    Parameters
    ----------
    line : float64 array, shape (n, d)
        Latitude and longitude in degrees, or metres.
    decimals : int
        Decimals of these numbers.
    geographic : bool
        Whether they are degrees.

    Examples
    --------
    >>> line_geometry(np.array([[0.0, 179.0], [0.0, -179.0]]), 5, geographic=True)["coordinates"]
    [[[179.0, 0.0], [180.0, 0.0]], [[-180.0, 0.0], [-179.0, 0.0]]]
    """
    if not geographic:
        # GeoJSON wants two coordinates at least.
        if line.shape[1] == 1:
            line = np.column_stack([line, np.zeros(len(line))])
        return {"type": "LineString", "coordinates": round_decimals(line, decimals).tolist()}

    # Longitude first. The offsets of a single line are its start and its end.
    degrees = round_decimals(line[:, [1, 0]], decimals)
    cut = cut_at_antimeridian(degrees, np.array([0, len(degrees)]), decimals=decimals)
    parts = [part.tolist() for part in np.split(cut.points, cut.cuts)]
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}


def _strict(value: Any) -> Any:
    """Return a value in which numbers that JSON doesn't know are null."""
    if isinstance(value, Mapping):
        return {name: _strict(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _write_text(text: str, target: str) -> None:
    with open_sink(target) as sink:
        sink.write(text.encode("utf-8", "backslashreplace"))
