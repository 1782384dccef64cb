"""Write tables of what a history knows of edges, and lines of these edges with the numbers."""

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
from gpszip.geo.planes import to_geographic
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.logs.track_rows import DEGREE_DIGITS
from gpszip.io.storage.sink import open_sink
from gpszip.model import Network

__all__ = [
    "EDGE_TABLE_FORMATS",
    "check_table_format",
    "edge_lines",
    "line_geometry",
    "write_edge_table",
]

#: Formats with their suffixes; the first is that of standard output.
EDGE_TABLE_FORMATS = {
    "csv": (".csv",),
    "json": (".json",),
    "geojson": (".geojson",),
    "parquet": (".parquet",),
}

#: Decimals of numbers.
_DECIMALS = 3

#: Decimals of degrees of lines: a centimetre.
_DEGREE_DECIMALS = DEGREE_DIGITS + 2

Columns = Mapping[str, NDArray[np.generic]]
Floats = NDArray[np.float64]


def check_table_format(target: str, what: str) -> str:
    """Return the format of a file by its suffix.

    Raises
    ------
    OutputError
        If there is no such format.

    Examples
    --------
    >>> check_table_format("U.geojson", "usage"), check_table_format("-", "usage")
    ('geojson', 'csv')
    """
    if target == "-":
        return "csv"
    suffix = Path(target).suffix.lower()
    for name, suffixes in EDGE_TABLE_FORMATS.items():
        if suffix in suffixes:
            return name
    raise OutputError(
        f"{what} is written as {', '.join(EDGE_TABLE_FORMATS)}, not as {suffix[1:] or 'nothing'}",
        path=target,
        remedy="name a file with such a suffix",
    )


def write_edge_table(
    columns: Columns,
    target: str,
    what: str,
    *,
    lines: Sequence[Floats],
    network: Network,
    facts: Mapping[str, Any] | None = None,
) -> None:
    """Write a table whose rows belong to lines.

    Parameters
    ----------
    columns : mapping of str to array, shape (r,)
        Names and values of the columns. Empty texts and NaN are missing.
    target : str
        Name of the file, whose suffix says the format; ``-`` is standard output, as CSV.
    what : str
        What the table holds, for messages.
    lines : sequence of float64 arrays, shape (n, d)
        Line of each row in metres on the plane of the network, for GeoJSON.
    network : Network
        Whose plane it is.
    facts : mapping, optional
        What JSON says beside the rows.

    Raises
    ------
    OutputError
        If there is no such format, or the file can't be written.
    """
    kind = check_table_format(target, what)
    if kind == "geojson":
        _write_geojson(columns, target, lines, network)
    elif kind == "json":
        document = {**(facts or {}), "rows": list(_rows(columns))}
        _write_text(json.dumps(document, ensure_ascii=False) + "\n", target)
    else:
        _write_table(columns, target, kind)


def edge_lines(
    network: Network, edges: NDArray[np.int64], forward: NDArray[np.bool_]
) -> list[Floats]:
    """Lines of edges in the direction of travel, in metres."""
    return [
        network.road(edge) if along else network.road(edge)[::-1]
        for edge, along in zip(edges.tolist(), forward.tolist(), strict=True)
    ]


def line_geometry(line: Floats, network: Network) -> dict[str, Any]:
    """A line as a geometry of GeoJSON, cut at the antimeridian."""
    if network.plane is None:
        return {"type": "LineString", "coordinates": np.round(line, _DECIMALS).tolist()}
    # The offsets of a single line are its start and its end.
    lat, lon = to_geographic(line[:, :2], network.plane)
    degrees = np.stack([lon, lat], axis=1).round(_DEGREE_DECIMALS).astype(np.float64)
    cut = cut_at_antimeridian(degrees, np.array([0, len(line)]), decimals=_DEGREE_DECIMALS)
    parts = [part.tolist() for part in np.split(cut.points, cut.cuts)]
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}


def _write_geojson(
    columns: Columns, target: str, lines: Sequence[Floats], network: Network
) -> None:
    """Write a feature for each row."""
    # The slice strips the braces, so that the member stands beside "features".
    member = "" if network.plane is not None else f"{json.dumps(METRES_MEMBER)[1:-1]}, "
    features = (
        json.dumps(
            {"type": "Feature", "properties": row, "geometry": line_geometry(line, network)},
            ensure_ascii=False,
        )
        for row, line in zip(_rows(columns), lines, strict=True)
    )
    text = ",\n".join(features)
    _write_text(f'{{"type": "FeatureCollection", {member}"features": [\n{text}\n]}}\n', target)


def _rows(columns: Columns) -> Iterable[dict[str, Any]]:
    """Rows as dictionaries of plain values; what is not known is None."""
    values = [[_plain(value) for value in column.tolist()] for column in columns.values()]
    return (dict(zip(columns, row, strict=True)) for row in zip(*values, strict=True))


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, _DECIMALS) if math.isfinite(value) else None
    return None if value == "" else value


def _write_table(columns: Columns, target: str, kind: str) -> None:
    import pyarrow as pa

    # NaN is no value, in columns of numbers and in texts.
    table = pa.table(
        {
            name: pa.array([_plain(value) for value in column.tolist()], _arrow_type(column))
            for name, column in columns.items()
        }
    )
    with open_sink(target) as sink:
        if kind == "parquet":
            import pyarrow.parquet as pq

            pq.write_table(table, sink)
            return
        import pyarrow.csv as pc

        # Arrow's header has quotes around every name.
        sink.write((",".join(columns) + "\n").encode())
        pc.write_csv(table, sink, pc.WriteOptions(include_header=False, quoting_style="needed"))


def _arrow_type(column: NDArray[np.generic]) -> Any:
    import pyarrow as pa

    kinds = {"f": pa.float64(), "i": pa.int64(), "b": pa.bool_()}
    return kinds.get(column.dtype.kind, pa.string())


def _write_text(text: str, target: str) -> None:
    with open_sink(target) as sink:
        sink.write(text.encode("utf-8", "backslashreplace"))
