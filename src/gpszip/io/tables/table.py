"""Conversion of a table's columns to a log, shared by all formats that are tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.raw import RawLog, Request, UnreadableCell
from gpszip.io.tables.roles import Roles
from gpszip.io.tables.row_names import names_each_row
from gpszip.io.tables.time_columns import TimeColumn, read_times
from gpszip.io.values.arrow import (
    factorize,
    is_number,
    is_text,
    to_attribute,
    to_floats,
    trimmed_text,
)
from gpszip.io.values.coordinates import (
    first_unreadable_cell,
    has_decimal_comma,
    has_packed_minutes,
    parse_degrees,
    parse_numbers,
)
from gpszip.model.read_result import Repair

__all__ = ["TableConventions", "build_raw_log", "find_conventions"]

#: Column of track names in tables that GPSZip writes. A track may have a single row there.
_WRITTEN_ID = "track_id"

#: Notations of degrees that messages suggest.
_DEGREES_UNDERSTOOD = "48.137, 48.137N, 48°08'13\"N or 48 08 13 N"

#: Number of letters of a type that messages show.
_MAX_SHOWN_LETTERS = 40

#: A number that may have thousands or decimals, 1,234.
_AMBIGUOUS_COMMA = r"^[+-]?[1-9]\d{0,2},\d{3}$"

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TableConventions:
    """Conventions of a table's notation, which only many rows together show.

    Parameters
    ----------
    decimal_comma : bool
        Whether text has decimal commas, as in 1,5.
    packed_minutes : bool
        Whether 4808.225 means 48°08.225'.
    ids_name_rows : bool
        Whether the column of ids names each row rather than each track.
    """

    decimal_comma: bool = False
    packed_minutes: bool = False
    ids_name_rows: bool = False


def find_conventions(
    columns: Sequence[Any],
    names: Sequence[str],
    roles: Roles,
    request: Request,
    where: str,
    *,
    decimal_comma: bool | None = None,
) -> TableConventions:
    """Find the conventions of a table.

    Parameters
    ----------
    columns : sequence of pyarrow.ChunkedArray
        Columns of ``roles.used``, in its order, with all rows or a representative sample.
    names : sequence of str
        Names of all columns of the table.
    roles : Roles
        Roles of the columns.
    request : Request
        The columns that the user has given.
    where : str
        Name of the log for messages.
    decimal_comma : bool, optional
        Whether text has decimal commas; by default found from the columns.

    Raises
    ------
    InputError
        If numbers such as 1,234 are ambiguous.
    """
    # Coordinates are numbers, or text whose notation has to be found.
    column = dict(zip(roles.used, columns, strict=True))
    axes = [_numbers_or_text(column[axis], names[axis], where) for axis in roles.axes]

    # Notation of numbers.
    comma = has_decimal_comma(axes) if decimal_comma is None else decimal_comma
    if comma and not roles.geographic:
        _check_thousands(axes, [names[axis] for axis in roles.axes], where)
    packed = bool(roles.hemispheres) and has_packed_minutes(axes[0], axes[1], decimal_comma=comma)
    conventions = TableConventions(comma, packed)

    # Names of tracks, unless the user has given their column or many rows share one.
    if roles.id is None or _is_chosen_id(names[roles.id], request):
        return conventions
    ids, index = _factorize_ids(column[roles.id], names[roles.id], where)
    if len(ids) * 2 <= len(index):
        return conventions

    # Names of rows, if all rows together are plausible as a single track.
    # A table of shapes has no times: rows count as a second apart.
    times = np.arange(len(index) * 1.0)
    if roles.time:
        times = read_times(column, names, roles, request, where, decimal_comma=comma).times
    coordinates = np.stack(
        [
            _read_axis(column, names, roles, number, conventions, where)
            for number in range(len(axes))
        ],
        axis=1,
    )
    ids_name_rows = names_each_row(len(ids), times, coordinates, geographic=roles.geographic)
    return TableConventions(comma, packed, ids_name_rows)


def build_raw_log(
    columns: Sequence[Any],
    names: Sequence[str],
    roles: Roles,
    request: Request,
    where: str,
    *,
    first: int = 1,
    conventions: TableConventions | None = None,
    repairs: tuple[Repair, ...] = (),
    all_rows: bool = True,
) -> RawLog:
    """Build a log from a table's columns.

    Parameters
    ----------
    columns : sequence of pyarrow.ChunkedArray
        Columns of ``roles.used``, in its order.
    names : sequence of str
        Names of all columns of the table.
    roles : Roles
        Roles of the columns.
    request : Request
        The unit of time and the order of dates.
    where : str
        Name of the log for messages.
    first : int, default 1
        Number of the first row in messages.
    conventions : TableConventions, optional
        Conventions of the table; by default found from the columns.
    repairs : tuple of Repair
        Earlier repairs.
    all_rows : bool, default True
        Whether these are all rows of the table, so that a column without numbers is an error.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If the content of a column doesn't fit its role.
    """
    # Find the conventions, and the columns in use; the others are reported as dropped.
    if conventions is None:
        conventions = find_conventions(columns, names, roles, request, where)
    column = dict(zip(roles.used, columns, strict=True))
    kept = {
        *roles.time,
        *roles.axes,
        *roles.keep.values(),
        *(side for side in roles.hemispheres if side is not None),
    }

    # Names of tracks.
    ids: tuple[str, ...] = ()
    index = None
    if roles.id is not None and not conventions.ids_name_rows:
        ids, index = _factorize_ids(column[roles.id], names[roles.id], where)
        kept.add(roles.id)
    elif roles.id is not None:
        repairs = (*repairs, _row_names_repair(names[roles.id], len(columns[0]), where))

    # Times.
    times = TimeColumn(np.full(len(columns[0]), np.nan))
    if roles.time:
        times = read_times(
            column, names, roles, request, where, decimal_comma=conventions.decimal_comma
        )

    # Positions, and the first unreadable cell of each axis.
    axes = [
        _read_axis(column, names, roles, number, conventions, where)
        for number in range(len(roles.axes))
    ]
    bad = [
        _first_unreadable_of_axis(column, names, roles, number, conventions, axis, where)
        for number, axis in enumerate(axes)
    ]
    if all_rows:
        _check_axes(axes, names, roles, bad, where)

    # Attributes.
    attributes = {
        name: _read_attribute(column[i], names[i], where) for name, i in roles.keep.items()
    }
    if roles.heading is not None:
        kept.add(roles.heading)
        attributes["heading"] = to_floats(column[roles.heading], conventions.decimal_comma)
    if roles.accuracy is not None:
        kept.add(roles.accuracy)
        attributes["accuracy"] = to_floats(column[roles.accuracy], conventions.decimal_comma)
    # Without a column of times, all tracks are shapes; the only track without an id has code 0.
    return RawLog(
        name=where,
        ids=ids,
        codes=index,
        times=times.times,
        coordinates=np.stack(axes, axis=1),
        geographic=roles.geographic,
        attributes=attributes,
        first=first,
        dropped_columns=tuple(name for i, name in enumerate(names) if i not in kept),
        repairs=(*repairs, *times.repairs),
        unreadable=(*times.unreadable, *(cell for cell in bad if cell is not None)),
        guessed_unit=times.guessed_unit,
        time_of_day=times.time_of_day,
        axes=tuple(names[axis] for axis in roles.axes),
        untimed=frozenset() if roles.time else frozenset(range(max(len(ids), 1))),
    )


def _row_names_repair(name: str, rows: int, where: str) -> Repair:
    """The repair that ignores a column of row names."""
    what = (
        f"rows named one by one in column {name!r}, which is no track id; "
        f"--columns id={name} makes it one"
    )
    return Repair(what, rows, where, drops=False)


def _is_chosen_id(name: str, request: Request) -> bool:
    """Whether a column certainly names tracks: the user gave it, or it is named as GPSZip does."""
    if name.strip().lower() == _WRITTEN_ID:
        return True
    # Names by position replace those of the table, so a column of such a name was meant.
    columns = request.columns
    if columns is None:
        return False
    return "id" in columns if isinstance(columns, Mapping) else name in columns


def _numbers_or_text(column: Any, name: str, where: str) -> Any:
    """A column as numbers or text.

    Raises
    ------
    InputError
        If it is neither.
    """
    # Unwrap extension types and dictionaries; old Parquet files have text as bytes.
    kind = column.type
    if isinstance(kind, pa.BaseExtensionType):
        column, kind = pc.cast(column, kind.storage_type), kind.storage_type
    if pa.types.is_dictionary(kind):
        column, kind = pc.cast(column, kind.value_type), kind.value_type
    if pa.types.is_binary(kind) or pa.types.is_large_binary(kind) or pa.types.is_binary_view(kind):
        column, kind = _decode_bytes(column, name, where), pa.string()

    # Accept text, numbers and empty columns.
    if is_text(kind) or is_number(kind):
        return column
    if pa.types.is_null(kind):
        return pc.cast(column, pa.float64())
    raise InputError(
        f"column {name!r} holds {_format_type(kind)}, not numbers",
        path=where,
        remedy="name another with --columns",
    )


def _decode_bytes(column: Any, name: str, where: str) -> Any:
    """Cast bytes to text."""
    try:
        return pc.cast(column, pa.string())
    except pa.ArrowInvalid:
        raise InputError(
            f"column {name!r} holds bytes that are no text",
            path=where,
            remedy="name another with --columns",
        ) from None


def _format_type(kind: Any) -> str:
    """Name of an Arrow type, shortened."""
    text = str(kind)
    return text if len(text) <= _MAX_SHOWN_LETTERS else text[: _MAX_SHOWN_LETTERS - 3] + "..."


def _factorize_ids(
    column: Any, name: str, where: str
) -> tuple[tuple[str, ...], NDArray[np.integer[Any]]]:
    try:
        return factorize(column)
    except (pa.ArrowException, InputError):
        raise InputError(
            f"column {name!r} holds {_format_type(column.type)}, which is no name of a track",
            path=where,
            remedy="name another one: --columns id=COLUMN",
        ) from None


def _read_attribute(column: Any, name: str, where: str) -> NDArray[np.generic]:
    try:
        return to_attribute(column)
    except (pa.ArrowException, InputError):
        raise InputError(
            f"column {name!r} holds {_format_type(column.type)}, which can't be kept",
            path=where,
            remedy="name another one",
        ) from None


def _read_axis(
    column: Mapping[int, Any],
    names: Sequence[str],
    roles: Roles,
    number: int,
    conventions: TableConventions,
    where: str,
) -> Floats:
    """Values of an axis by its number in ``roles.axes``; NaN for cells that can't be read."""
    cells = _numbers_or_text(column[roles.axes[number]], names[roles.axes[number]], where)
    if not roles.geographic:
        return parse_numbers(cells, conventions.decimal_comma)

    # Axis 0 is the latitude. Its sign, or that of the longitude, may be in a column beside it.
    side = roles.hemispheres[number] if roles.hemispheres else None
    return parse_degrees(
        cells,
        "lon" if number else "lat",
        hemisphere=None if side is None else _read_hemispheres(column[side], names[side], where),
        decimal_comma=conventions.decimal_comma,
        packed_minutes=conventions.packed_minutes,
    )


def _read_hemispheres(column: Any, name: str, where: str) -> Any:
    """A column of hemispheres as text; numbers become text that is no hemisphere."""
    cells = column if pa.types.is_null(column.type) else _numbers_or_text(column, name, where)
    return cells if is_text(cells.type) else pc.cast(cells, pa.string())


def _first_unreadable_of_axis(
    column: Mapping[int, Any],
    names: Sequence[str],
    roles: Roles,
    number: int,
    conventions: TableConventions,
    values: Floats,
    where: str,
) -> UnreadableCell | None:
    """First cell of an axis that can't be read: a number, or the hemisphere beside it."""
    # Find the first unreadable cell; without a hemisphere, the number is to blame.
    axis = roles.axes[number]
    side = roles.hemispheres[number] if roles.hemispheres else None
    cells = _numbers_or_text(column[axis], names[axis], where)
    cell = first_unreadable_cell(cells, values, names[axis])
    if cell is None or side is None:
        return cell

    # If the number alone can be read, the hemisphere is to blame.
    number_alone = parse_degrees(
        cells.slice(cell.row, 1),
        "lon" if number else "lat",
        decimal_comma=conventions.decimal_comma,
        packed_minutes=conventions.packed_minutes,
    )
    if not np.isfinite(number_alone[0]):
        return cell
    hemisphere = column[side][cell.row].as_py()
    return UnreadableCell(names[side], cell.row, "" if hemisphere is None else str(hemisphere))


def _check_axes(
    axes: Sequence[Floats],
    names: Sequence[str],
    roles: Roles,
    bad: Sequence[UnreadableCell | None],
    where: str,
) -> None:
    """Refuse a table if some axis has no number at all."""
    for axis, values, cell in zip(roles.axes, axes, bad, strict=True):
        if not len(values) or np.isfinite(values).any():
            continue

        # Show the first cell, and the notation or option that helps.
        shown = "" if cell is None else f"; the first of it is {cell.column} {cell.value[:40]!r}"
        understood = f"; degrees are written {_DEGREES_UNDERSTOOD}" if roles.geographic else ""
        role = ("lat=" if axis == roles.axes[0] else "lon=") if roles.geographic else "x="
        raise InputError(
            f"column {names[axis]!r} holds no number{shown}{understood}",
            path=where,
            remedy=f"name the right one with --columns, such as --columns {role}COLUMN",
        )


def _check_thousands(axes: Sequence[Any], names: Sequence[str], where: str) -> None:
    """Refuse metres such as 1,234 unless some cell shows that its comma is a decimal comma."""
    # Search for a cell that decides, and keep the first ambiguous one for the message.
    first = ""
    for cells, name in zip(axes, names, strict=True):
        if not is_text(cells.type):
            continue

        # Each cell with a comma must be ambiguous; any other decides.
        commas = trimmed_text(cells).filter(pc.match_substring(cells, ","))
        if not len(commas):
            continue
        if not pc.all(pc.match_substring_regex(commas, _AMBIGUOUS_COMMA)).as_py():
            return
        first = first or f"column {name!r}: {commas[0].as_py()!r}"
    if first:
        raise InputError(
            f"{first} may have decimals or thousands",
            path=where,
            remedy="write numbers with a point before decimals",
        )
