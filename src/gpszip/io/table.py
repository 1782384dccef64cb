"""From the columns of a table to a log; shared by all formats that are tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gpszip.errors import InputError
from gpszip.io.arrow_values import codes, numbers, seconds, unit_seconds, values
from gpszip.io.columns import Roles, time_unit_of
from gpszip.io.raw_log import RawLog, Request
from gpszip.model.reading import Repair

__all__ = ["table_log"]

#: Columns of these names may number the rows instead of naming the track.
_PERHAPS_ROW_NUMBERS = ("id", "uuid", "uid", "oid", "object_id", "objectid")
_UUID = 36  # letters


def table_log(
    columns: Sequence[Any],
    names: Sequence[str],
    roles: Roles,
    request: Request,
    where: str,
    *,
    first: int = 1,
    decimal_comma: bool = False,
    repairs: tuple[Repair, ...] = (),
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
        The unit of time.
    where : str
        Name of the log.
    first : int
        Number of the first row in messages.
    decimal_comma : bool
        Whether text writes 1,5 for one and a half.
    repairs : tuple of Repair
        What was mended before.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If a column can't be what it should be.
    """
    column = dict(zip(roles.used, columns, strict=True))
    ids, index = codes(column[roles.id]) if roles.id is not None else ((), None)
    kept = {*roles.time, *roles.axes, *roles.keep.values()}
    if index is not None and roles.id is not None:
        if _numbers_rows(names[roles.id], ids, len(index)):
            ids, index = (), None
        else:
            kept.add(roles.id)
    headings = {}
    if roles.heading is not None:
        kept.add(roles.heading)
        headings = {"heading": numbers(column[roles.heading], decimal_comma)}
    axes = [numbers(column[axis], decimal_comma) for axis in roles.axes]
    _check_numbers(axes, [names[axis] for axis in roles.axes], where)
    return RawLog(
        name=where,
        ids=ids,
        codes=index,
        times=_times(column, names, roles, request, where, decimal_comma),
        coordinates=np.stack(axes, axis=1),
        geographic=roles.geographic,
        attributes={name: values(column[i]) for name, i in roles.keep.items()} | headings,
        first=first,
        dropped=tuple(name for i, name in enumerate(names) if i not in kept),
        repairs=repairs,
    )


def _numbers_rows(name: str, ids: Sequence[str], rows: int) -> bool:
    numbered = rows > 2 and len(ids) == rows and name.strip().lower() in _PERHAPS_ROW_NUMBERS
    return numbered and all(text.isdigit() or len(text) == _UUID for text in ids)


def _times(column: dict[int, Any], names: Sequence[str], roles: Roles, request: Request, where: str, decimal_comma: bool) -> Any:
    time = roles.time[-1]
    cells = column[time]
    if len(roles.time) == 2:
        cells = _joined(column[roles.time[0]], cells)
    if decimal_comma and pa.types.is_string(cells.type):
        cells = pc.replace_substring(cells, ",", ".")
    unit = unit_seconds(request.time_unit) if request.time_unit else time_unit_of(names[time])
    return seconds(cells, unit, f"{where}: column {names[time]!r}")


def _joined(date: Any, time: Any) -> Any:
    """Join a date and a time of day; a time that holds its date, too, stands for itself."""
    days, hours = pc.cast(date, pa.string()), pc.utf8_trim_whitespace(pc.cast(time, pa.string()))
    if not pc.any(pc.match_substring_regex(hours, r"^\d{1,2}:\d{2}")).as_py():
        return time
    hours = pc.replace_substring_regex(hours, r"^(\d):", r"0\1:")
    days = pc.utf8_slice_codeunits(pc.utf8_trim_whitespace(days), 0, 10)
    return pc.binary_join_element_wise(days, hours, " ")


def _check_numbers(axes: Sequence[Any], names: Sequence[str], where: str) -> None:
    for axis, name in zip(axes, names, strict=True):
        if len(axis) and not np.isfinite(axis).any():
            raise InputError(f"{where}: column {name!r} holds no number; name the right one with --columns, such as --columns x=COLUMN")
