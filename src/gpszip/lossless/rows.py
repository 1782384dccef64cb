"""Rows and cells of text with columns: where they lie, what they hold, and text of some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError

__all__ = [
    "MAX_CELL",
    "Rows",
    "check_quotes",
    "cut_cells",
    "find_rows",
    "has_stray_quotes",
    "join_pieces",
]

#: Bytes of text.
_NEW_LINE = 10
_RETURN = 13
_BLANK = 32
_QUOTE = 34
_ZERO = 48
_NINE = 9  # less that of zero

#: Bytes of a cell by which rows are compared, and digits that order them: times have no more.
MAX_CELL = 64
_MAX_KEY = 32

#: Pieces that are joined at a time: each byte takes 8 bytes of memory then.
_JOINED_PIECES = 1 << 15

_Ints = NDArray[np.int64]
_Bytes = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a text, none of which ends within quotes.

    Parameters
    ----------
    text : uint8 array, shape (m,)
        The bytes.
    bounds : int64 array, shape (n + 1,)
        Where rows begin, and the end of the text. Line ends belong to rows.
    delimiters : int64 array, shape (d,)
        Where delimiters stand, but for those within quotes.
    """

    text: _Bytes
    bounds: _Ints
    delimiters: _Ints

    def __len__(self) -> int:
        return len(self.bounds) - 1

    @property
    def ends(self) -> _Ints:
        """Where rows end, without line ends."""
        ends = self.bounds[1:].copy()
        for byte in (_NEW_LINE, _RETURN):
            has_byte = (ends > self.bounds[:-1]) & (self.text[np.maximum(ends - 1, 0)] == byte)
            ends -= has_byte
        return ends

    def cells(self, column: int) -> tuple[_Ints, _Ints]:
        """Where the cells of a column begin and end; rows with fewer cells have an empty one."""
        # Delimiters of a row are numbered from its first one.
        ends = self.ends
        first = np.searchsorted(self.delimiters, self.bounds[:-1])
        beyond = np.append(self.delimiters, [len(self.text)] * (column + 1))
        after = np.minimum(beyond[first + column], ends)
        before = self.bounds[:-1]
        if column:
            before = np.minimum(beyond[first + column - 1] + 1, ends)
        return before, np.maximum(after, before)

    def groups(self, column: int) -> tuple[_Ints, list[bytes]]:
        """Number rows by their cell in a column, in the order in which cells first appear.

        Returns
        -------
        int64 array, shape (n,)
            Number of the cell of each row.
        list of bytes
            The cells; long ones are cut.
        """
        # The bytes of all cells, with zeros after them, as values of one size.
        starts, ends = self.cells(column)
        width = min(max(int((ends - starts).max(initial=0)), 1), MAX_CELL)
        letters = np.zeros((len(self), width), np.uint8)
        for place in range(width):
            at = starts + place
            is_there = at < ends
            letters[is_there, place] = self.text[at[is_there]]
        values = letters.view(f"S{width}")[:, 0]

        # Rows of a group mostly follow one another: compare the first of each run.
        begins = np.flatnonzero(np.append(True, values[1:] != values[:-1])[: len(values)])
        found, first, inverse = np.unique(values[begins], return_index=True, return_inverse=True)
        order = np.argsort(first)
        number = np.empty(len(order), np.int64)
        number[order] = np.arange(len(order))
        runs = np.diff(np.append(begins, len(values)))
        return np.repeat(number[inverse], runs), [bytes(found[i]) for i in order]

    def keys(self, column: int) -> _Ints:
        """The digits of each cell of a column as one number, modulo 2**64."""
        starts, ends = self.cells(column)
        keys = np.zeros(len(self), np.int64)
        for place in range(min(int((ends - starts).max(initial=0)), _MAX_KEY)):
            at = starts + place
            byte = self.text[np.minimum(at, max(len(self.text) - 1, 0))].astype(np.int64) - _ZERO
            is_digit = (at < ends) & (byte >= 0) & (byte <= _NINE)
            keys[is_digit] = keys[is_digit] * 10 + byte[is_digit]
        return keys

    def head(self, count: int | None) -> Rows:
        """The first rows; all of them by default."""
        return self if count is None else Rows(self.text, self.bounds[: count + 1], self.delimiters)

    def pick(self, order: _Ints) -> bytes:
        """Text of some rows, in this order."""
        return join_pieces(self.text, self.bounds[:-1][order], self.bounds[1:][order])


def find_rows(text: bytes, delimiter: int) -> Rows:
    r"""Find rows and cells.

    Parameters
    ----------
    text : bytes
        Begins with a row.
    delimiter : int
        The byte between cells.

    Examples
    --------
    >>> rows = find_rows(b'a,1\n"b,c",2\na,3', ord(","))
    >>> len(rows), rows.groups(0), rows.keys(1).tolist()
    (3, (array([0, 1, 0]), [b'a', b'"b,c"']), [1, 2, 3])
    """
    array = np.frombuffer(text, np.uint8)
    lines = np.flatnonzero(array == _NEW_LINE)
    delimiters = np.flatnonzero(array == delimiter)
    if _QUOTE in text:
        # What stands after an odd number of quotes is within a cell.
        quotes = np.flatnonzero(array == _QUOTE)
        lines = lines[np.searchsorted(quotes, lines) % 2 == 0]
        delimiters = delimiters[np.searchsorted(quotes, delimiters) % 2 == 0]
    bounds = np.concatenate([[0], lines + 1, [len(text)]]).astype(np.int64)
    if len(bounds) > 1 and bounds[-1] == bounds[-2]:
        bounds = bounds[:-1]
    return Rows(array, bounds, delimiters.astype(np.int64))


def has_stray_quotes(text: bytes, delimiter: int) -> bool:
    r"""Whether a quote stands elsewhere than at the ends of a cell, or one is never closed.

    Rows and cells can't be told apart then: who counts quotes finds others than who does not.

    Parameters
    ----------
    text : bytes
        Begins with a row.
    delimiter : int
        The byte between cells.

    Examples
    --------
    >>> has_stray_quotes(b'a,"b ""c"" d"\n', ord(",")), has_stray_quotes(b'3" a,b\n', ord(","))
    (False, True)
    """
    if _QUOTE not in text:
        return False
    quotes = np.flatnonzero(np.frombuffer(text, np.uint8) == _QUOTE)
    if len(quotes) % 2:
        return True

    # Cells end at delimiters and line ends; one blank may stand between. Two quotes are one.
    padded = np.frombuffer(b"\n\n%b\n\n" % text, np.uint8)
    ends = [_NEW_LINE, _RETURN, delimiter]
    for places, step in ((quotes[::2] + 2, -1), (quotes[1::2] + 2, 1)):
        beside, beyond = padded[places + step], padded[places + 2 * step]
        is_blank = (beside == _BLANK) & np.isin(beyond, ends)
        if not (is_blank | np.isin(beside, [*ends, _QUOTE])).all():
            return True
    return False


def check_quotes(text: bytes, delimiter: int) -> None:
    """Refuse text with stray quotes.

    Raises
    ------
    OptionError
        If there are any.
    """
    if has_stray_quotes(text, delimiter):
        raise OptionError(
            "the log has a quote within a cell, so that its rows and cells can't be told apart",
            remedy="take all of it: decompress --exact, or exact_log in Python",
        )


def cut_cells(text: bytes, delimiter: int, columns: Sequence[int]) -> bytes:
    r"""Text of some columns only, with a newline after each row.

    Raises
    ------
    OptionError
        If quotes stand within cells.

    Examples
    --------
    >>> cut_cells(b"a,b,c\r\nd,e,f\r\n", ord(","), [2, 0])
    b'c,a\nf,d\n'
    """
    check_quotes(text, delimiter)
    rows = find_rows(text, delimiter)
    bounds = [rows.cells(column) for column in columns]
    starts = np.stack([start for start, _ in bounds], axis=1).ravel()
    ends = np.stack([end for _, end in bounds], axis=1).ravel()
    after = np.full(len(columns), delimiter, np.uint8)
    after[-1] = _NEW_LINE
    return join_pieces(rows.text, starts, ends, np.tile(after, len(rows)))


def join_pieces(text: _Bytes, starts: _Ints, ends: _Ints, after: _Bytes | None = None) -> bytes:
    """Join pieces of a text.

    Parameters
    ----------
    text : uint8 array, shape (m,)
        The bytes.
    starts, ends : int64 array, shape (p,)
        Of each piece.
    after : uint8 array, shape (p,), optional
        A byte to put after each piece.
    """
    parts = []
    for first in range(0, len(starts), _JOINED_PIECES):
        piece = slice(first, first + _JOINED_PIECES)
        begin, lengths = starts[piece], ends[piece] - starts[piece]
        capacity = lengths if after is None else lengths + 1
        stops = np.cumsum(capacity)
        places = np.arange(stops[-1]) - np.repeat(stops - capacity - begin, capacity)
        if after is None:
            parts.append(text[places].tobytes())
            continue
        joined = text[np.minimum(places, max(len(text) - 1, 0))]
        joined[stops - 1] = after[piece]
        parts.append(joined.tobytes())
    return b"".join(parts)
