"""Rows whose positions are points: a table with columns of coordinates instead of geometries."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request
from gpszip.io.logs.table_batches import TableBatch, interpret_batches
from gpszip.io.logs.vector.geometry import parse_points
from gpszip.io.logs.vector.reference import Reference, ReferenceKind
from gpszip.io.tables.roles import Roles, find_roles
from gpszip.io.tables.table import build_raw_log
from gpszip.model.read_result import LeftOut, Repair

__all__ = ["PointRows", "open_point_rows"]

#: Letters of an error message of Arrow that are shown.
_MAX_REASON_LETTERS = 120


def _axis_names(properties: Sequence[str], reference: Reference, *, has_z: bool) -> tuple[str, ...]:
    """Return the names of the columns of coordinates.

    Parameters
    ----------
    properties : sequence of str
        Names of the other columns.
    reference : Reference
        What the coordinates are.
    has_z : bool
        Whether points have a third number: z, or the height beside degrees, unless a property is
        the height.

    Examples
    --------
    >>> _axis_names(["t", "lat"], Reference(ReferenceKind.WGS84), has_z=True)
    ('lon', 'lat', 'alt')
    """
    axes = ["lon", "lat"] if reference.geographic else ["x", "y"]
    has_height = any(name.lower() in HEIGHT_NAMES for name in properties)
    if has_z and not (reference.geographic and has_height):
        axes.append("alt" if reference.geographic else "z")
    return tuple(axes)


@dataclass(frozen=True)
class PointRows:
    """A file whose rows are points, as :class:`gpszip.io.logs.table_batches.TableReader` has it.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    column_names : tuple of str
        Names of the columns of coordinates, then those of the other columns.
    roles : Roles
        Which column holds what.
    geometry : str
        Name of the column of geometries.
    reference : Reference
        Their coordinate system.
    axis_count : int
        Number of columns of coordinates, which come first.
    tables : callable
        Yields tables of all rows with the columns of the given names.
    """

    name: str
    column_names: tuple[str, ...]
    roles: Roles
    geometry: str
    reference: Reference
    axis_count: int
    tables: Callable[[list[str]], Iterable[Any]]
    first_row_number: int = 1

    def logs(self, request: Request, left_out: tuple[LeftOut, ...] = ()) -> Iterator[RawLog]:
        """Yield the rows as logs, in the order of the file.

        Parameters
        ----------
        request : Request
            Unit of time, order of dates and attributes.
        left_out : tuple of LeftOut
            What else the file holds.
        """
        for raw in interpret_batches(self, request):
            yield replace(raw, left_out=left_out, repairs=(*self._notes(raw), *raw.repairs))
            left_out = ()

    def log(self, request: Request, left_out: tuple[LeftOut, ...] = ()) -> RawLog:
        """Return all rows as one log.

        Parameters
        ----------
        request, left_out
            As for :meth:`logs`.

        Raises
        ------
        InputError
            If there is no row, or a column holds something else than its role says.
        """
        tables = [batch.table for batch in self.read()]
        if not sum(table.num_rows for table in tables):
            raise InputError("columns, but no rows", path=self.name)
        # Batches may differ in the types of dictionaries; permissive promotion joins them.
        table = pa.concat_tables(tables, promote_options="permissive")
        raw = build_raw_log(table.columns, self.column_names, self.roles, request, self.name)
        return replace(raw, left_out=left_out, repairs=(*self._notes(raw), *raw.repairs))

    def read(self) -> Iterator[TableBatch]:
        """Yield all rows."""
        used = self.roles.used
        stored = [self.column_names[i] for i in used if i >= self.axis_count]
        for table in self.tables([self.geometry, *stored]):
            # Replace geometries by coordinates.
            points = parse_points(table[self.geometry])
            coordinates = points.table[:, :3]
            coordinates[:, :2] = self.reference.convert(coordinates[:, :2], self.name)
            columns = [
                pa.chunked_array([pa.array(coordinates[:, i], from_pandas=True)])
                if i < self.axis_count
                else table[self.column_names[i]]
                for i in used
            ]
            yield TableBatch(pa.Table.from_arrays(columns, [self.column_names[i] for i in used]))

    def read_as_text(self) -> Iterator[Any]:
        """Yield all rows as tables, with the types that the file has."""
        return (batch.table for batch in self.read())

    def uses_decimal_comma(self) -> bool:
        """Coordinates are numbers."""
        return False

    def explain_error(self, error: Exception) -> str:
        """Say what is wrong with the file when Arrow can't read it."""
        lines = str(error).splitlines() or [type(error).__name__]
        return f"damaged: {lines[0][:_MAX_REASON_LETTERS]}"

    def _notes(self, raw: RawLog) -> tuple[Repair, ...]:
        """Tell that metres are assumed where no coordinate system is stated."""
        if self.reference.kind is not ReferenceKind.NONE:
            return ()
        what = "points without a coordinate system, read as x and y in metres"
        return (Repair(what, len(raw.times), self.name, drops=False),)


def open_point_rows(
    properties: Sequence[str],
    geometry: str,
    reference: Reference,
    tables: Callable[[list[str]], Iterable[Any]],
    request: Request,
    where: str,
    *,
    has_z: bool,
) -> PointRows:
    """Find out which column holds what, where the positions are points.

    Parameters
    ----------
    properties : sequence of str
        Names of the columns besides the geometry.
    geometry, reference, tables
        As for :class:`PointRows`.
    request : Request
        Columns by role, attributes, and whether times are needed.
    where : str
        Name of the file, for messages.
    has_z : bool
        Whether points have a third number: z, or the height beside degrees.

    Raises
    ------
    InputError
        If there is no column for times.
    """
    # Columns of coordinates hide properties of their names.
    axes = _axis_names(properties, reference, has_z=has_z)
    names = (*axes, *(name for name in properties if name not in axes))
    by_role = request.columns if isinstance(request.columns, Mapping) else {}
    roles = find_roles(
        names,
        {**by_role, **{axis: axis for axis in sorted(axes[:2])}},
        request.keep,
        where,
        heading=request.heading,
        accuracy=request.accuracy,
        times=request.times,
        optional=request.optional,
    )
    # Coordinates of geometries have a sign, so there are no hemispheres.
    roles = replace(roles, hemispheres=())
    return PointRows(where, names, roles, geometry, reference, len(axes), tables)
