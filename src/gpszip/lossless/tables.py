"""Tables of integers to bytes and back: columns that move together."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import Cursor, encode_varint
from gpszip.lossless.columns import (
    MAX_VALUE,
    CodedColumn,
    decode_column,
    encode_column,
    skip_column,
)
from gpszip.lossless.grids import decode_grid, encode_grid, find_grid
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.guides import NAME_ROLE, NO_ROLE, Guided, decode_guide, encode_guide
from gpszip.lossless.trails import Trails

__all__ = ["decode_table", "encode_table"]

#: Columns that help to predict one, at most.
_SIDES = 2

#: Rows by which the number of sides is chosen, and the share that more sides have to save.
_TRIAL_ROWS = 1 << 12
_SIDES_GAIN = 0.97

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
        role = NO_ROLE if found is None else found.guide.roles[i].kind
        if role == NAME_ROLE:
            continue
        grid = find_grid(columns[i], decimals[i])
        head, multiples = encode_grid(grid, columns[i])
        sides = _sides(coded)
        if finder is not None and i != times and sides:
            sides = sides if role != NO_ROLE else _worth(multiples, time_column, sides)
            record.append(bytes([len(sides)]))
        guide = None if found is None else found.column_guide(i, times, grid)
        data, column = encode_column(multiples, time_column, sides, guide)
        record += [head, data]
        if i == times:
            time_column = column
        else:
            coded.append(column)
    return b"".join(record)


def decode_table(
    cursor: Cursor,
    rows: int,
    count: int,
    trails: Trails | None = None,
    wanted: Collection[int] | None = None,
) -> list[_Ints]:
    """Undo :func:`encode_table` for ``count`` columns of ``rows`` numbers.

    Parameters
    ----------
    trails : Trails, optional
        The walks, where the table was encoded with a finder.
    wanted : collection of int, optional
        Columns to decode; by default all. All others are zeros, unless these need them. Only
        tables that were encoded with a finder are decoded in part.

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
    if trails is None:
        return _decode_in_order(cursor, rows, count, times)
    table_guide = decode_guide(cursor, rows, count, trails)
    found = None if table_guide is None else Guided(table_guide, trails)

    # Where the columns lie, and which of them are needed.
    names = {i for i in range(count) if found and found.guide.roles[i].kind == NAME_ROLE}
    places = _find_columns(cursor, rows, _coding_order(count, times), times, names)
    wanted = range(count) if wanted is None else wanted
    needed = _needed(wanted, places, times)
    is_guided = any(places[i].is_guided for i in needed)

    # The needed columns, in the order of coding. Walks are asked only where they tell something.
    coded: dict[int, CodedColumn] = {}
    columns = {i: np.zeros(rows, np.int64) for i in range(count)}
    for i in names.intersection(wanted):
        assert found is not None
        columns[i] = found.names(i)
    for i in (i for i in places if i in needed):
        place = places[i]
        at = Cursor(cursor.data, place.offset, cursor.end, cursor.base)
        grid, differences = decode_grid(at, rows)
        guide = found.column_guide(i, times, grid) if found and is_guided else None
        time_column = None if times is None or i == times else coded[times]
        sides = [coded[side] for side in place.sides]
        multiples, coded[i] = decode_column(at, rows, time_column, sides, guide)
        columns[i] = grid.numbers(multiples) + differences
        if i == times and found and is_guided:
            found.locate(multiples)
    return [columns[i] for i in range(count)]


@dataclass(frozen=True)
class _Place:
    """Where a column begins, by which others it is predicted, and whether walks predict it."""

    offset: int
    sides: tuple[int, ...]
    is_guided: bool


def _find_columns(
    cursor: Cursor, rows: int, order: Sequence[int], times: int | None, names: Collection[int]
) -> dict[int, _Place]:
    """Find where each column lies that is coded, in the order of coding; nothing is decoded."""
    places: dict[int, _Place] = {}
    varying: list[int] = []
    for i in order:
        if i in names:
            continue
        has_choice = i != times and len(varying) > 0
        sides = cursor.read_byte("the number of a column's sides") if has_choice else 0
        if sides > min(len(varying), _SIDES):
            raise cursor.error(f"a column is predicted by {sides} of {len(varying)}")
        offset = cursor.offset
        decode_grid(cursor, rows)
        differs, is_guided = skip_column(cursor, rows)
        places[i] = _Place(offset, tuple(varying[::-1][:sides]), is_guided)
        if i != times and differs:
            varying.append(i)
    return places


def _needed(
    wanted: Collection[int], places: Mapping[int, _Place], times: int | None
) -> frozenset[int]:
    """Columns that have to be decoded for those that are wanted."""
    needed = {i for i in wanted if i in places}
    # A column is predicted by columns before it only.
    for i in reversed(list(places)):
        if i in needed:
            needed.update(places[i].sides)
    if needed and times is not None:
        needed.add(times)
    return frozenset(needed)


def _decode_in_order(cursor: Cursor, rows: int, count: int, times: int | None) -> list[_Ints]:
    """Decode a table without a finder: each column has the last two as sides."""
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


def _worth(values: _Ints, times: CodedColumn | None, sides: list[CodedColumn]) -> list[CodedColumn]:
    """Fewest sides that save enough: a column with fewer is decoded without the others."""
    head = slice(_TRIAL_ROWS)
    known = [CodedColumn(side.values[head], side.shift, side.sizes[head]) for side in sides]
    time = times and CodedColumn(times.values[head], times.shift, times.sizes[head])
    trials = [
        len(encode_column(values[head], time, known[:count])[0]) for count in range(len(sides) + 1)
    ]
    fewest = next(i for i, size in enumerate(trials) if size * _SIDES_GAIN <= min(trials))
    return sides[:fewest]


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
