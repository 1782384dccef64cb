"""Read frames as logs: the roles of their columns, their geometries, and their rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.frames.columns import FrameColumns
from gpszip.io.frames.geometries import (
    PointCells,
    in_log_coordinates,
    is_on_earth,
    read_lines,
    read_points,
)
from gpszip.io.frames.geometry_columns import GeometryColumn
from gpszip.io.frames.open import open_columns
from gpszip.io.frames.source import FrameSource
from gpszip.io.frames.stream import frame_errors
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.raw import RawLog, Request, unused_name
from gpszip.io.logs.table_batches import TableBatch, interpret_batches
from gpszip.io.tables.given_columns import find_requested_roles, rename_columns
from gpszip.io.tables.roles import Roles
from gpszip.io.tables.table import build_raw_log
from gpszip.io.values.arrow import factorize, to_attribute
from gpszip.model.read_result import Repair

__all__ = ["read_frame", "read_frame_batches"]

#: Number of the first row in messages: frames count from 0.
_FIRST_ROW = 0

#: Roles of coordinates: a user who names one means no geometry.
_AXIS_ROLES = ("x", "y", "lat", "lon")

#: Column of the heights of points in degrees.
_HEIGHT = "alt"


@dataclass(frozen=True, eq=False)
class _Plan:
    """Which columns are read, and as what.

    Parameters
    ----------
    where : str
        Name of the frame.
    names : tuple of str
        Names of its columns, then of the coordinates of its geometries.
    count : int
        Number of its own columns.
    roles : Roles
        Roles of all these columns.
    read : tuple of int
        Columns of the frame to read.
    geometry : GeometryColumn, optional
        The column of geometries, if positions come from there.
    has_lines : bool
        Whether its geometries are lines.
    """

    where: str
    names: tuple[str, ...]
    count: int
    roles: Roles
    read: tuple[int, ...]
    geometry: GeometryColumn | None = None
    has_lines: bool = False

    def column(self, table: Any, index: int) -> Any:
        """Return a column of the frame from a table that was read."""
        return table.column(self.read.index(index))

    def geometries(self, table: Any) -> PointCells | None:
        """Return the geometries of a table that was read; None for a frame without."""
        if self.geometry is None:
            return None
        cells, name = self.column(table, self.geometry.number), self.names[self.geometry.number]
        return read_points(cells, self.geometry.encoding, self.where, name)

    def used_columns(self, table: Any, geometries: PointCells | None) -> list[Any]:
        """Return the columns of ``roles.used`` from a table that was read.

        Raises
        ------
        InputError
            If these rows hold lines, and those before them points.
        """
        if self.geometry is None or geometries is None:
            return [self.column(table, i) for i in self.roles.used]
        name = self.names[self.geometry.number]
        if geometries.are_lines:
            raise InputError(f"column {name!r} holds points, then lines", path=self.where)

        # Coordinates of the geometries follow the columns of the frame.
        positions = in_log_coordinates(geometries.points, self.geometry.crs, self.where, name)
        return [
            self.column(table, i)
            if i < self.count
            else pa.chunked_array([pa.array(positions[:, i - self.count])])
            for i in self.roles.used
        ]

    def finish(self, raw: RawLog) -> RawLog:
        """Return a log whose geometries don't count as dropped columns."""
        if self.geometry is None:
            return raw
        own = {self.names[self.geometry.number], *self.names[self.count :]}
        dropped = tuple(name for name in raw.dropped_columns if name not in own)
        return replace(raw, dropped_columns=dropped)


def read_frame(source: FrameSource, request: Request) -> RawLog:
    """Read a frame at once.

    Parameters
    ----------
    source : FrameSource
        The frame.
    request : Request
        Columns, unit of time and attributes.

    Raises
    ------
    InputError
        If it has no row, or no column for time or position, or a column can't be read.

    Examples
    --------
    >>> frame = {"t": [0, 1], "x": [0.0, 1.0], "y": [0.0, 0.0]}
    >>> read_frame(FrameSource("dict", frame=frame), Request()).coordinates.tolist()
    [[0.0, 0.0], [1.0, 0.0]]
    """
    # Read only the columns with a role.
    columns = open_columns(source.frame, source.name)
    plan = _make_plan(columns, request, source.name)
    with frame_errors(source.name):
        tables = list(columns.read(plan.read))
        table = pa.concat_tables(tables) if tables else None
    if table is None or table.num_rows == 0:
        raise InputError("columns, but no rows", path=source.name)

    # The geometries show whether they are points.
    geometries = plan.geometries(table)
    plan = _complete_plan(plan, geometries, request)
    if plan.has_lines:
        return _read_shapes(plan, table)
    if geometries is not None and not np.isfinite(geometries.points[:, :2]).all(axis=1).any():
        raise _no_geometry(plan, "point")
    raw = build_raw_log(
        plan.used_columns(table, geometries),
        plan.names,
        plan.roles,
        request,
        source.name,
        first=_FIRST_ROW,
    )
    return plan.finish(raw)


def read_frame_batches(source: FrameSource, request: Request) -> LogBatches | None:
    """Open a frame to be read in batches; it has to be one that can be read several times.

    Parameters
    ----------
    source : FrameSource
        The frame, see :meth:`FrameSource.stored_at`.
    request : Request
        Columns, unit of time and attributes.

    Returns
    -------
    LogBatches or None
        None for a frame of lines.

    Raises
    ------
    InputError
        If there is no row, or no column for time or position.
    """
    # The first rows show whether geometries are points, and have heights.
    columns = open_columns(source.frame, source.name)
    plan = _make_plan(columns, request, source.name)
    first = next((table for table in columns.read(plan.read) if table.num_rows), None)
    if first is None:
        raise InputError("columns, but no rows", path=source.name)
    plan = _complete_plan(plan, plan.geometries(first), request)
    if plan.has_lines:
        return None
    batches = interpret_batches(_FrameReader(columns, plan), request)
    rows = columns.rows
    return LogBatches(
        (plan.finish(raw) for raw in batches),
        CoordinateKind(plan.roles.geographic, len(plan.roles.axes)),
        count_rows=None if rows is None else lambda: rows,
    )


@dataclass(frozen=True)
class _FrameReader:
    """Reads batches of cells, see :class:`gpszip.io.logs.table_batches.TableReader`."""

    columns: FrameColumns
    plan: _Plan
    first_row_number: int = _FIRST_ROW

    @property
    def name(self) -> str:
        return self.plan.where

    @property
    def column_names(self) -> tuple[str, ...]:
        return self.plan.names

    @property
    def roles(self) -> Roles:
        return self.plan.roles

    def read(self) -> Iterator[TableBatch]:
        """Yield all rows."""
        names = [str(i) for i in self.plan.roles.used]
        for table in self.columns.read(self.plan.read):
            columns = self.plan.used_columns(table, self.plan.geometries(table))
            yield TableBatch(pa.table(columns, names=names))

    def read_as_text(self) -> Iterator[Any]:
        """Yield all rows as tables, with the types that the frame has."""
        return (batch.table for batch in self.read())

    def uses_decimal_comma(self) -> None:
        """Leave decimal marks of texts to be found in the first rows."""

    def explain_error(self, error: Exception) -> str:
        return f"can't be read: {str(error).splitlines()[0]}"


# Roles


def _make_plan(columns: FrameColumns, request: Request, where: str) -> _Plan:
    """Find the columns to read, before any row is read."""
    names = rename_columns(columns.names, request, where)
    geometry = _wanted_geometry(columns, names, request)
    if geometry is None:
        roles = find_requested_roles(names, request, where)
        return _Plan(where, names, len(names), roles, roles.used)

    # Whether there are lines, which need no times, shows later.
    all_names, roles = _roles_of_geometry(names, geometry, request, where, times=False)
    own = {i for i in roles.used if i < len(names)}
    read = tuple(sorted({*own, geometry.number}))
    return _Plan(where, all_names, len(names), roles, read, geometry)


def _complete_plan(plan: _Plan, geometries: PointCells | None, request: Request) -> _Plan:
    """Find the roles that only the geometries show: whether these are lines, or have heights."""
    if plan.geometry is None or geometries is None:
        return plan

    # Lines have no heights here, and no times.
    names, roles = _roles_of_geometry(
        plan.names[: plan.count],
        plan.geometry,
        request,
        plan.where,
        times=request.times and not geometries.are_lines,
        has_heights=bool(np.isfinite(geometries.points[:, 2]).any()),
    )
    return replace(plan, names=names, roles=roles, has_lines=geometries.are_lines)


def _wanted_geometry(
    columns: FrameColumns, names: tuple[str, ...], request: Request
) -> GeometryColumn | None:
    """Return the column of geometries, unless positions are in other columns."""
    geometry = columns.geometry
    if geometry is None or any(role in _AXIS_ROLES for role in request.columns or ()):
        return None
    if geometry.is_stated:
        return geometry

    # A column that is a geometry by its name alone counts if no other has positions.
    try:
        find_requested_roles(names, replace(request, times=False, keep=()), "")
    except InputError:
        return geometry
    return None


def _roles_of_geometry(
    names: tuple[str, ...],
    geometry: GeometryColumn,
    request: Request,
    where: str,
    *,
    times: bool,
    has_heights: bool = True,
) -> tuple[tuple[str, ...], Roles]:
    """Return the names of all columns, with those of coordinates, and their roles."""
    # Coordinates are further columns, whose names no other column has.
    on_earth = is_on_earth(geometry.crs, where)
    axes = ["lat", "lon", _HEIGHT] if on_earth else ["x", "y", "z"]
    axes = axes if has_heights else axes[:2]
    added = [unused_name(axis, names) for axis in axes]

    # A height is a third coordinate in metres, and a column beside degrees. Before rows are read,
    # nobody knows whether there is one.
    given = request.columns if isinstance(request.columns, Mapping) else {}
    fixed = {axis: name for axis, name in zip(axes, added, strict=True) if axis != _HEIGHT}
    stated = replace(request, columns={**given, **fixed}, times=times)
    all_names = (*names, *added)
    return all_names, find_requested_roles(all_names, stated, where)


def _no_geometry(plan: _Plan, kind: str) -> InputError:
    """Return the error for a column of geometries that are all empty."""
    assert plan.geometry is not None
    return InputError(
        f"column {plan.names[plan.geometry.number]!r} holds no {kind}: all are empty",
        path=plan.where,
        remedy="name the right column of geometries, or columns with the positions",
    )


# Lines


def _read_shapes(plan: _Plan, table: Any) -> RawLog:
    """Read lines as shapes, one track for each line of a geometry."""
    # Vertices in the coordinates of the log.
    assert plan.geometry is not None
    geometry, column = plan.geometry, plan.names[plan.geometry.number]
    cells = plan.column(table, geometry.number)
    lines = read_lines(cells, geometry.encoding, plan.where, column)
    points = in_log_coordinates(lines.points, geometry.crs, plan.where, column)

    # Names of the lines that have a vertex: null and empty geometries have none.
    has_vertices = np.diff(lines.offsets) > 0
    if not has_vertices.any():
        raise _no_geometry(plan, "line")
    rows, counts = lines.rows[has_vertices], np.diff(lines.offsets)[has_vertices]
    names = _line_names(plan, table, rows)
    lost = lines.others + int((~has_vertices).sum())
    repairs = (Repair("rows without a line dropped", lost, plan.where),) if lost else ()

    # What is kept of a row holds for all vertices.
    owner = np.repeat(rows, counts)
    attributes = {}
    for name, index in plan.roles.keep.items():
        with frame_errors(plan.where, name):
            attributes[name] = to_attribute(plan.column(table, index))[owner]
    used = {plan.geometry.number, plan.roles.id, *plan.roles.keep.values()}
    return RawLog(
        name=plan.where,
        ids=tuple(names),
        codes=np.repeat(np.arange(len(names)), counts),
        times=np.full(len(points), np.nan),
        coordinates=points,
        geographic=is_on_earth(geometry.crs, plan.where),
        attributes=attributes,
        first=_FIRST_ROW,
        row_noun="point",
        dropped_columns=tuple(
            name for i, name in enumerate(plan.names[: plan.count]) if i not in used
        ),
        repairs=repairs,
        untimed=frozenset(range(len(names))),
    )


def _line_names(plan: _Plan, table: Any, rows: Any) -> list[str]:
    """Names of lines: several of one name are numbered ``name``, ``name-2``, and so on."""
    if plan.roles.id is None:
        plain = [str(row) for row in rows.tolist()]
    else:
        ids, index = factorize(plan.column(table, plan.roles.id))
        plain = [ids[i] for i in index[rows].tolist()]

    # Number those that come again, past names that rows have.
    stated, taken = set(plain), set[str]()
    last_numbers: Counter[str] = Counter()
    names = []
    for name in plain:
        free = name
        while free in taken or (free != name and free in stated):
            last_numbers[name] += 1
            free = f"{name}-{last_numbers[name] + 1}"
        taken.add(free)
        names.append(free)
    return names
