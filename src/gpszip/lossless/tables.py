"""Tables of integers to bytes and back: columns that move together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import Cursor, encode_varint
from gpszip.lossless.columns import MAX_VALUE, CodedColumn, decode_column, encode_column
from gpszip.lossless.grids import decode_grid, encode_grid, find_grid
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.guides import NAME_ROLE, Guided, decode_guide, encode_guide
from gpszip.lossless.trails import Trails

__all__ = ["decode_table", "encode_table"]

#: Columns that help to predict one, at most.
_SIDES = 2

#: Times increase in so many of 100 steps, and go back in at most one of 100.
_MIN_INCREASING = 60
_MAX_DECREASING = 1

_Ints = NDArray[np.int64]


def encode_table(
    columns: Sequence[_Ints],
    decimals: Sequence[int] | None = None,
    finder: GuideFinder | None = None,
) -> bytes:
    """Encode columns of the same length.

    Parameters
    ----------
    columns : sequence of int64 array, shape (n,)
        Numbers in units of their last digit, between -2**57 and 2**57.
    decimals : sequence of int, optional
        Digits after the decimal point of each column; by default seven.
    finder : GuideFinder, optional
        Finds what walks tell of the columns; a decoder then needs the walks, too.

    Examples
    --------
    >>> columns = [np.arange(100), np.arange(0, 700, 7)]
    >>> back = decode_table(Cursor(encode_table(columns)), 100, 2)
    >>> back[1].tolist()[:3]
    [0, 7, 14]
    """
    decimals = [7] * len(columns) if decimals is None else decimals

    # The column of times, and what walks tell of the rows.
    times = next((i for i, column in enumerate(columns) if _are_times(column)), None)
    if finder is not None:
        times = finder.find_times(columns, decimals, times)
    record = [encode_varint(0 if times is None else times + 1)]
    found = None
    if finder is not None:
        found = None if times is None else finder.find(columns, decimals, times)
        record.append(encode_guide(None if found is None else found.guide))

    # The times come first, since they help to predict all others. Names need no coding.
    coded: list[CodedColumn] = []
    time_column = None
    for i in _coding_order(len(columns), times):
        if found is not None and found.guide.roles[i].kind == NAME_ROLE:
            continue
        grid = find_grid(columns[i], decimals[i])
        head, multiples = encode_grid(grid, columns[i])
        guide = None if found is None else found.column_guide(i, times, grid)
        data, column = encode_column(multiples, time_column, _sides(coded), guide)
        record += [head, data]
        if i == times:
            time_column = column
        else:
            coded.append(column)
    return b"".join(record)


def decode_table(
    cursor: Cursor, rows: int, count: int, trails: Trails | None = None
) -> list[_Ints]:
    """Undo :func:`encode_table` for ``count`` columns of ``rows`` numbers.

    Parameters
    ----------
    trails : Trails, optional
        The walks, where the table was encoded with a finder.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no such table.
    """
    # The column of times, and what the walks tell.
    number = cursor.read_varint("the column of times")
    if number > count:
        raise cursor.error(f"times in column {number} of {count}")
    times = number - 1 if number else None
    found = None
    if trails is not None:
        table_guide = decode_guide(cursor, rows, count, trails)
        found = None if table_guide is None else Guided(table_guide, trails)

    # The columns, in the order of coding.
    coded: list[CodedColumn] = []
    columns: dict[int, _Ints] = {}
    time_column = None
    for i in _coding_order(count, times):
        if found is not None and found.guide.roles[i].kind == NAME_ROLE:
            columns[i] = found.names(i)
            continue
        grid, differences = decode_grid(cursor, rows)
        guide = None if found is None else found.column_guide(i, times, grid)
        multiples, column = decode_column(cursor, rows, time_column, _sides(coded), guide)
        columns[i] = grid.numbers(multiples) + differences
        if i == times:
            time_column = column
            if found is not None:
                found.locate(multiples)
        else:
            coded.append(column)
    return [columns[i] for i in range(count)]


def _coding_order(count: int, times: int | None) -> list[int]:
    """Order in which columns are coded: times first."""
    others = [i for i in range(count) if i != times]
    return others if times is None else [times, *others]


def _sides(coded: Sequence[CodedColumn]) -> list[CodedColumn]:
    """The last columns that tell anything, the latest first."""
    return [column for column in reversed(coded) if not column.is_constant][:_SIDES]


def _are_times(column: _Ints) -> bool:
    """Whether numbers nearly always increase, as times do."""
    if len(column) < 2 or int(np.abs(column).max()) >= MAX_VALUE:
        return False
    steps = np.diff(column)
    increasing, decreasing = np.count_nonzero(steps > 0), np.count_nonzero(steps < 0)
    return bool(
        increasing * 100 >= _MIN_INCREASING * len(steps)
        and decreasing * 100 <= _MAX_DECREASING * len(steps)
    )
