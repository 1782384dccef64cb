"""The order of rows that are kept track by track: how it follows from the column of times.

Rows are *sorted* by the numbers of their groups, which are tracks; rows of one group stay in their
order. Then the log's own order is that of a column of keys, mostly times, but for differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import Cursor, encode_varint
from gpszip.lossless.columns import decode_column, encode_column

__all__ = ["decode_order", "encode_order", "read_key"]

#: Rows by which the column of keys is chosen.
_SAMPLE_ROWS = 1 << 14

_Ints = NDArray[np.int64]


def encode_order(
    order: _Ints, keys: Callable[[int, int | None], _Ints], columns: Sequence[int]
) -> bytes:
    """Encode in which order sorted rows stand in the log.

    Parameters
    ----------
    order : int64 array, shape (n,)
        Row of the log of each sorted row.
    keys : callable
        Returns a key for each row of the log, of a column; of the first rows only, where a number
        is given.
    columns : sequence of int
        Columns whose keys may order the rows.

    Examples
    --------
    >>> order = np.array([0, 2, 4, 1, 3])
    >>> data = encode_order(order, lambda column, rows: np.arange(5)[:rows], [0])
    >>> cursor = Cursor(data)
    >>> read_key(cursor, 1), decode_order(cursor, 5, order).tolist()
    (0, [0, 3, 1, 4, 2])
    """
    # The column by which the fewest of the first rows stand elsewhere; -1 for none.
    best, differences = -1, _differences(order, None)
    if differences.any():
        head = order[order < _SAMPLE_ROWS]
        moved = {-1: np.count_nonzero(_differences(head, None))}
        for column in columns:
            moved[column] = np.count_nonzero(_differences(head, keys(column, _SAMPLE_ROWS)))
        best = min(moved, key=lambda column: moved[column])
        if best >= 0:
            differences = _differences(order, keys(best, None))
    return encode_varint(best + 1) + encode_column(differences)[0]


def read_key(cursor: Cursor, columns: int) -> int | None:
    """Number of the column of keys, with which an order begins; None if there is none.

    Raises
    ------
    CorruptArchiveError
        If it is none of so many columns.
    """
    column = cursor.read_varint("a column of keys")
    if column > columns:
        raise cursor.error(f"keys in column {column} of {columns}")
    return column - 1 if column else None


def decode_order(cursor: Cursor, rows: int, keys: _Ints | None) -> _Ints | None:
    """Sorted row of each row of the log; None if these are the same.

    Parameters
    ----------
    cursor : Cursor
        After the column of keys.
    rows : int
        Number of rows.
    keys : int64 array, shape (n,), optional
        A key for each sorted row, if there is a column of them.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no order of so many rows.
    """
    differences, _ = decode_column(cursor, rows)
    if keys is None and not differences.any():
        return None
    by_key = np.arange(rows) if keys is None else np.argsort(keys, kind="stable")
    places = np.arange(rows) + differences
    if not np.array_equal(np.sort(places), np.arange(rows)):
        raise cursor.error("rows have no order")
    found: _Ints = by_key[places]
    return found


def _differences(order: _Ints, keys: _Ints | None) -> _Ints:
    """For each row of the log how much later it stands in the order of keys.

    Keys are those of rows of the log.
    """
    if keys is not None:
        order = order[np.argsort(keys[order], kind="stable")]
    places = np.empty(len(order), np.int64)
    places[order] = np.arange(len(order))
    found: _Ints = places - np.arange(len(order))
    return found
