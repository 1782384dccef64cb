"""From the columns of a table to a log; shared by all formats that are tables."""

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
from gpszip.io.values.arrow import factorize, is_text, to_attribute, to_floats
from gpszip.io.values.coordinates import (
    first_unreadable_cell,
    has_decimal_comma,
    has_packed_minutes,
    parse_degrees,
    parse_numbers,
    trimmed_text,
)
from gpszip.model.read_result import Repair

__all__ = ["TableConventions", "build_raw_log", "find_conventions"]

#: Column of track names in tables that GPSZip writes. A track may have a single row there.
_WRITTEN_ID = "track_id"

_DEGREES_UNDERSTOOD = "48.137, 48.137N, 48°08'13\"N or 48 08 13 N"

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TableConventions:
    """How a table writes things, which only many of its rows tell.

    Parameters
    ----------
    decimal_comma : bool
        Whether text writes 1,5 for one and a half.
    packed_minutes : bool
        Whether 4808.225 stands for 48°08.225'.
    ids_name_rows : bool
        Whether the column of ids names each row, and so no track.
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
    """Find out how a table writes things.

    Parameters
    ----------
    columns : sequence of pyarrow.ChunkedArray
        Those of ``roles.used``, in its order: all rows, or so many that they speak for all.
    names : sequence of str
        Names of all the table's columns.
    roles : Roles
        Which column is what.
    request : Request
        The columns that a user names.
    where : str
        Name of the log.
    decimal_comma : bool, optional
        Whether text has decimal commas; found in the columns where left out.

    Raises
    ------
    InputError
        If numbers such as 1,234 may be with or without decimals.
    """
    column = dict(zip(roles.used, columns, strict=True))
    axes = [_numbers_or_text(column[axis], names[axis], where) for axis in roles.axes]

    # Numbers.
    comma = has_decimal_comma(axes) if decimal_comma is None else decimal_comma
    if comma and not roles.geographic:
        _check_thousands(axes, [names[axis] for axis in roles.axes], where)
    packed = bool(roles.hemispheres) and has_packed_minutes(axes[0], axes[1], decimal_comma=comma)
    found = TableConventions(comma, packed)

    # Names.
    if roles.id is None or _is_chosen_id(names[roles.id], request):
        return found
    ids, index = _factorize_ids(column[roles.id], names[roles.id], where)
    if len(ids) * 2 <= len(index):
        return found
    times = (
        read_times(column, names, roles, request, where, decimal_comma=comma).times
        if roles.time
        else np.arange(len(index) * 1.0)
    )
    coordinates = np.stack(
        [_read_axis(column, names, roles, number, found, where) for number in range(len(axes))],
        axis=1,
    )
    return TableConventions(
        comma, packed, names_each_row(len(ids), times, coordinates, geographic=roles.geographic)
    )


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
    """Make a log of a table's columns.

    Parameters
    ----------
    columns : sequence of pyarrow.ChunkedArray
        Those of ``roles.used``, in its order.
    names : sequence of str
        Names of all the table's columns.
    roles : Roles
        Which column is what.
    request : Request
        The unit of time and the order of dates.
    where : str
        Name of the log.
    first : int
        Number of the first row in messages.
    conventions : Habits, optional
        How the table writes things; found in the columns where left out.
    repairs : tuple of Repair
        What was mended before.
    all_rows : bool
        Whether these are all rows, so that a column without any number is a mistake.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If a column can't be what it should be.
    """
    conventions = (
        find_conventions(columns, names, roles, request, where)
        if conventions is None
        else conventions
    )
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

    # Times and positions, and what can't be read of them.
    when = TimeColumn(np.full(len(columns[0]), np.nan))
    if roles.time:
        when = read_times(
            column, names, roles, request, where, decimal_comma=conventions.decimal_comma
        )
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

    # All else.
    attributes = {
        name: _read_attribute(column[i], names[i], where) for name, i in roles.keep.items()
    }
    if roles.heading is not None:
        kept.add(roles.heading)
        attributes["heading"] = to_floats(column[roles.heading], conventions.decimal_comma)
    return RawLog(
        name=where,
        ids=ids,
        codes=index,
        times=when.times,
        coordinates=np.stack(axes, axis=1),
        geographic=roles.geographic,
        attributes=attributes,
        first=first,
        dropped_columns=tuple(name for i, name in enumerate(names) if i not in kept),
        repairs=(*repairs, *when.repairs),
        unreadable=(*when.unreadable, *(one for one in bad if one is not None)),
        guessed_unit=when.guessed_unit,
        time_of_day=when.time_of_day,
        axes=tuple(names[axis] for axis in roles.axes),
        untimed=frozenset() if roles.time else frozenset(range(max(len(ids), 1))),
    )


def _row_names_repair(name: str, rows: int, where: str) -> Repair:
    what = f"rows named one by one in column {name!r}, which is no track id; --columns id={name} makes it one"
    return Repair(what, rows, where, drops=False)


def _is_chosen_id(name: str, request: Request) -> bool:
    """Whether a column certainly names tracks: the user says so, or GPSZip names its own so."""
    if name.strip().lower() == _WRITTEN_ID:
        return True
    columns = request.columns
    return columns is not None and (
        "id" in columns if isinstance(columns, Mapping) else name in columns
    )


def _numbers_or_text(column: Any, name: str, where: str) -> Any:
    """Return a column as numbers or text, or say that it is neither."""
    kind = column.type
    if isinstance(kind, pa.BaseExtensionType):
        column, kind = pc.cast(column, kind.storage_type), kind.storage_type
    if pa.types.is_dictionary(kind):
        column, kind = pc.cast(column, kind.value_type), kind.value_type
    if pa.types.is_binary(kind) or pa.types.is_large_binary(kind) or pa.types.is_binary_view(kind):
        column, kind = _decode_bytes(column, name, where), pa.string()
    if (
        is_text(kind)
        or pa.types.is_integer(kind)
        or pa.types.is_floating(kind)
        or pa.types.is_decimal(kind)
    ):
        return column
    if pa.types.is_null(kind):
        return pc.cast(column, pa.float64())
    raise InputError(
        f"{where}: column {name!r} holds {_format_type(kind)}, not numbers; name another with --columns"
    )


def _decode_bytes(column: Any, name: str, where: str) -> Any:
    """Old Parquet files have text as bytes."""
    try:
        return pc.cast(column, pa.string())
    except pa.ArrowInvalid:
        raise InputError(
            f"{where}: column {name!r} holds bytes that are no text; name another with --columns"
        ) from None


def _format_type(kind: Any) -> str:
    text = str(kind)
    return text if len(text) <= 40 else text[:37] + "..."


def _factorize_ids(
    column: Any, name: str, where: str
) -> tuple[tuple[str, ...], NDArray[np.integer[Any]]]:
    try:
        return factorize(column)
    except (pa.ArrowException, InputError):
        raise InputError(
            f"{where}: column {name!r} holds {_format_type(column.type)}, which is no name of a track; name another one: --columns id=COLUMN"
        ) from None


def _read_attribute(column: Any, name: str, where: str) -> NDArray[np.generic]:
    try:
        return to_attribute(column)
    except (pa.ArrowException, InputError):
        raise InputError(
            f"{where}: column {name!r} holds {_format_type(column.type)}, which can't be kept; name another one"
        ) from None


def _read_axis(
    column: Mapping[int, Any],
    names: Sequence[str],
    roles: Roles,
    number: int,
    conventions: TableConventions,
    where: str,
) -> Floats:
    cells = _numbers_or_text(column[roles.axes[number]], names[roles.axes[number]], where)
    if not roles.geographic:
        return parse_numbers(cells, conventions.decimal_comma)
    side = roles.hemispheres[number] if roles.hemispheres else None
    return parse_degrees(
        cells,
        "lon" if number else "lat",
        hemisphere=None if side is None else _read_hemispheres(column[side], names[side], where),
        decimal_comma=conventions.decimal_comma,
        packed_minutes=conventions.packed_minutes,
    )


def _read_hemispheres(column: Any, name: str, where: str) -> Any:
    """Return a column of hemispheres; one that is no text holds none."""
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
    """Name the first cell that can't be read: the number, or the hemisphere beside it."""
    axis = roles.axes[number]
    side = roles.hemispheres[number] if roles.hemispheres else None
    found = first_unreadable_cell(
        _numbers_or_text(column[axis], names[axis], where), values, names[axis]
    )
    if found is None or side is None:
        return found
    alone = parse_degrees(
        _numbers_or_text(column[axis], names[axis], where).slice(found.row, 1),
        "lon" if number else "lat",
        decimal_comma=conventions.decimal_comma,
        packed_minutes=conventions.packed_minutes,
    )
    said = column[side][found.row].as_py()
    return (
        UnreadableCell(names[side], found.row, "" if said is None else str(said))
        if np.isfinite(alone[0])
        else found
    )


def _check_axes(
    axes: Sequence[Floats],
    names: Sequence[str],
    roles: Roles,
    bad: Sequence[UnreadableCell | None],
    where: str,
) -> None:
    for axis, found, cell in zip(roles.axes, axes, bad, strict=True):
        if not len(found) or np.isfinite(found).any():
            continue
        said = "" if cell is None else f"; the first of it is {cell.column} {cell.value[:40]!r}"
        understood = f"; degrees are written {_DEGREES_UNDERSTOOD}" if roles.geographic else ""
        role = ("lat=" if axis == roles.axes[0] else "lon=") if roles.geographic else "x="
        raise InputError(
            f"{where}: column {names[axis]!r} holds no number{said}{understood}; "
            f"name the right one with --columns, such as --columns {role}COLUMN"
        )


def _check_thousands(axes: Sequence[Any], names: Sequence[str], where: str) -> None:
    """Refuse metres such as 1,234 unless some cell shows that the comma is a decimal one."""
    first = ""
    for cells, name in zip(axes, names, strict=True):
        if not is_text(cells.type):
            continue
        commas = trimmed_text(cells).filter(pc.match_substring(cells, ","))
        if not len(commas):
            continue
        if not pc.all(pc.match_substring_regex(commas, r"^[+-]?[1-9]\d{0,2},\d{3}$")).as_py():
            return
        first = first or f"column {name!r}: {commas[0].as_py()!r}"
    if first:
        raise InputError(
            f"{where}: {first} may have decimals or thousands; write numbers with a point before decimals"
        )
