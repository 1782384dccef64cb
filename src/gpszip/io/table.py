"""From the columns of a table to a log; shared by all formats that are tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gpszip.errors import InputError
from gpszip.io.arrow_values import codes, numbers, values
from gpszip.io.columns import Roles
from gpszip.io.raw_log import RawLog, Request
from gpszip.io.time_columns import read_times
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
        The unit of time and the order of dates.
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
    when = read_times(column, names, roles, request, where, decimal_comma=decimal_comma)
    return RawLog(
        name=where,
        ids=ids,
        codes=index,
        times=when.times,
        coordinates=np.stack(axes, axis=1),
        geographic=roles.geographic,
        attributes={name: values(column[i]) for name, i in roles.keep.items()} | headings,
        first=first,
        dropped=tuple(name for i, name in enumerate(names) if i not in kept),
        repairs=(*repairs, *when.repairs),
        unread=when.unread,
        guess=when.guess,
        time_of_day=when.time_of_day,
        axes=tuple(names[axis] for axis in roles.axes),
    )


def _numbers_rows(name: str, ids: Sequence[str], rows: int) -> bool:
    numbered = rows > 2 and len(ids) == rows and name.strip().lower() in _PERHAPS_ROW_NUMBERS
    return numbered and all(text.isdigit() or len(text) == _UUID for text in ids)


def _check_numbers(axes: Sequence[Any], names: Sequence[str], where: str) -> None:
    for axis, name in zip(axes, names, strict=True):
        if len(axis) and not np.isfinite(axis).any():
            raise InputError(f"{where}: column {name!r} holds no number; name the right one with --columns, such as --columns x=COLUMN")
