"""Write tables of what a history knows of edges, and lines of these edges with the numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.io.feature_tables import (
    check_table_format,
    line_geometry,
    write_features,
    write_json,
    write_table,
)
from gpszip.io.logs.track_rows import DEGREE_DIGITS
from gpszip.model import Network
from gpszip.model.projection import map_coordinates

__all__ = ["edge_geometry", "edge_lines", "write_edge_table"]

#: Decimals of numbers, and of those that need more: degrees of points, a centimetre, and
#: probabilities.
_DECIMALS = 3
_FINER = {"lat": 7, "lon": 7, "probability": 6}

#: Decimals of degrees of lines: a centimetre.
_DEGREE_DECIMALS = DEGREE_DIGITS + 2

Columns = Mapping[str, NDArray[np.generic]]
Floats = NDArray[np.float64]


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
    rows = _rows(columns)
    if kind == "geojson":
        geometries = (edge_geometry(line, network) for line in lines)
        write_features(rows, geometries, target, geographic=network.plane is not None)
    elif kind == "json":
        write_json({**(facts or {}), "rows": rows}, target)
    else:
        kinds = {name: column.dtype.kind for name, column in columns.items()}
        write_table(rows, kinds, target, kind)


def edge_lines(
    network: Network, edges: NDArray[np.int64], forward: NDArray[np.bool_]
) -> list[Floats]:
    """Lines of edges in the direction of travel, in metres."""
    return [
        network.road(edge) if along else network.road(edge)[::-1]
        for edge, along in zip(edges.tolist(), forward.tolist(), strict=True)
    ]


def edge_geometry(line: Floats, network: Network) -> dict[str, Any]:
    """A line in metres on the plane of a network as a geometry of GeoJSON."""
    if network.plane is None:
        return line_geometry(line, _DECIMALS, geographic=False)
    degrees = map_coordinates(line[:, :2], network.plane)
    return line_geometry(degrees, _DEGREE_DECIMALS, geographic=True)


def _rows(columns: Columns) -> list[dict[str, Any]]:
    """Rows as dictionaries of plain values; what is not known is None."""
    values = [
        [_plain(value, _FINER.get(name, _DECIMALS)) for value in column.tolist()]
        for name, column in columns.items()
    ]
    return [dict(zip(columns, row, strict=True)) for row in zip(*values, strict=True)]


def _plain(value: Any, decimals: int) -> Any:
    if isinstance(value, float):
        return round(value, decimals) if math.isfinite(value) else None
    return None if value == "" else value
