"""Tables of integers to bytes and back: columns that move together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import Cursor, encode_varint
from gpszip.lossless.columns import MAX_VALUE, CodedColumn, decode_column, encode_column
from gpszip.lossless.grids import decode_grid, encode_grid, find_grid

__all__ = ["decode_table", "encode_table"]

#: Columns that help to predict one, at most.
_SIDES = 2

#: Times increase in so many of 100 steps, and go back in at most one of 100.
_MIN_INCREASING = 60
_MAX_DECREASING = 1

_Ints = NDArray[np.int64]


def encode_table(columns: Sequence[_Ints], decimals: Sequence[int] | None = None) -> bytes:
    """Encode columns of the same length.

    Parameters
    ----------
    columns : sequence of int64 array, shape (n,)
        Numbers in units of their last digit, between -2**57 and 2**57.
    decimals : sequence of int, optional
        Digits after the decimal point of each column; by default seven.

    Examples
    --------
    >>> columns = [np.arange(100), np.arange(0, 700, 7)]
    >>> back = decode_table(Cursor(encode_table(columns)), 100, 2)
    >>> back[1].tolist()[:3]
    [0, 7, 14]
    """
    decimals = [7] * len(columns) if decimals is None else decimals

    # The times come first, since they help to predict all others.
    times = next((i for i, column in enumerate(columns) if _are_times(column)), None)
    record = [encode_varint(0 if times is None else times + 1)]
    coded: list[CodedColumn] = []
    time_column = None
    for i in _coding_order(len(columns), times):
        head, multiples = encode_grid(find_grid(columns[i], decimals[i]), columns[i])
        data, column = encode_column(multiples, time_column, _sides(coded))
        record += [head, data]
        if i == times:
            time_column = column
        else:
            coded.append(column)
    return b"".join(record)


def decode_table(cursor: Cursor, rows: int, count: int) -> list[_Ints]:
    """Undo :func:`encode_table` for ``count`` columns of ``rows`` numbers.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no such table.
    """
    number = cursor.read_varint("the column of times")
    if number > count:
        raise cursor.error(f"times in column {number} of {count}")
    times = number - 1 if number else None
    coded: list[CodedColumn] = []
    columns: dict[int, _Ints] = {}
    time_column = None
    for i in _coding_order(count, times):
        grid, differences = decode_grid(cursor, rows)
        multiples, column = decode_column(cursor, rows, time_column, _sides(coded))
        columns[i] = grid.numbers(multiples) + differences
        if i == times:
            time_column = column
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
