"""Rows whose positions are lines: trajectories with times as their m, or shapes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gpszip.io.logs.geojson.features import BadPosition, Line, PropertyNames
from gpszip.io.logs.geojson.lines import Contents, log_from_lines
from gpszip.io.logs.geojson.points import PointTable
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.vector.geometry import parse_lines
from gpszip.io.logs.vector.reference import Reference, ReferenceKind
from gpszip.model.read_result import LeftOut, Repair

__all__ = ["read_line_rows"]

#: Column of m in a table of positions.
_M_COLUMN = 3


def read_line_rows(
    tables: Iterable[Any],
    geometry: str,
    reference: Reference,
    request: Request,
    where: str,
    left_out: tuple[LeftOut, ...] = (),
) -> RawLog:
    """Read rows that are lines, as GeoJSON reads its features.

    The m of a position is its time, as PostGIS keeps trajectories. A line without m is a shape. A
    row is named by a property such as ``track_id`` or ``id``.

    Parameters
    ----------
    tables : iterable of pyarrow.Table
        All rows, with the geometries and perhaps a column of names.
    geometry : str
        Name of the column of geometries.
    reference : Reference
        Their coordinate system.
    request : Request
        Unit of time, attributes, and the column of names.
    where : str
        Name of the file, for messages.
    left_out : tuple of LeftOut
        What else the file holds.

    Raises
    ------
    InputError
        If there is no line, or one is damaged.
    """
    # Collect the lines of all rows, with their names.
    contents = Contents(where, request.skip_bad, PointTable(where))
    id_names = PropertyNames.of(request.columns).id
    for table in tables:
        id_name = next((name for name in id_names if name in table.column_names), None)
        names = [None] * len(table) if id_name is None else _read_names(table[id_name])
        for cell, name in zip(table[geometry], names, strict=True):
            _add_row(contents, cell, name, reference)

    # Make a log of them.
    raw = log_from_lines(contents, request, metric=not reference.geographic)
    notes: tuple[Repair, ...] = ()
    if reference.kind is ReferenceKind.NONE:
        what = "points without a coordinate system, read as x and y in metres"
        notes = (Repair(what, len(raw.times), where, drops=False),)
    return replace(raw, left_out=(*left_out, *raw.left_out), repairs=(*notes, *raw.repairs))


def _read_names(column: Any) -> list[str | None]:
    names: list[str | None] = pc.cast(column, pa.string()).to_pylist()
    return names


def _add_row(contents: Contents, cell: Any, name: str | None, reference: Reference) -> None:
    """Add the lines of a row, without positions that are no numbers."""
    contents.features += 1
    lines = parse_lines(cell, contents.name, f"row {contents.features}")
    if not lines:
        contents.others["geometry that is no line"] += 1

    for table in lines:
        # Drop positions that can't be read, or have no place on earth.
        table[:, :2] = reference.convert(table[:, :2], contents.name)
        good = np.isfinite(table[:, :2]).all(axis=1)
        contents.bad += int((~good).sum())
        if not good.all() and contents.first_bad is None:
            position = int(good.argmin())
            contents.first_bad = BadPosition(
                f"row {contents.features}, position {position + 1}",
                str(table[position, :2].tolist()),
            )

        # Keep the others, with m as their times.
        kept = table[good]
        has_times = bool(np.isfinite(kept[:, _M_COLUMN]).any())
        times = pa.array(kept[:, _M_COLUMN], from_pandas=True) if has_times else None
        if len(kept):
            contents.lines.append(Line(contents.features, name, kept, times))
            contents.has_times |= has_times
