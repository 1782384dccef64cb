"""How the numbers of a column are written: digits after the point, and zeros before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import Cursor, encode_varint
from gpszip.lossless.columns import MAX_VALUE, decode_column, encode_column

__all__ = ["Notation", "decode_notation", "encode_notation", "find_notation"]

#: How many digits stand after the point: as many in all numbers; as few as the number needs; the
#: same, but at least one; or a list.
_SAME = 0
_TRIMMED = 1
_TRIMMED_TO_ONE = 2
_LISTED = 3

#: How many stand before it: as many as the number needs; as many in all numbers; or a list.
_NATURAL = 0
_PADDED = 1
_WIDTHS_LISTED = 2

#: Bits of the first byte: two for each of the above, one where numbers keep their own units, one
#: where rows of minus zeros follow.
_WIDTH_SHIFT = 2
_UNSCALED_SHIFT = 4
_MINUS_SHIFT = 5

#: Is added to the width of a zero with a minus before it.
_MINUS_ZERO = 128

#: Most digits of a number.
_MAX_DIGITS = 17

#: Powers of ten that fit 64 bits.
_POWERS = np.array([10**i for i in range(_MAX_DIGITS + 2)], np.int64)

_Ints = NDArray[np.int64]
_Counts = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Notation:
    """How the numbers of a column are written.

    Parameters
    ----------
    places_rule, width_rule : int
        How many digits stand after and before the point.
    decimals : int
        Largest number of digits after the point.
    width : int
        Digits before it, where they are as many in all numbers.
    is_scaled : bool
        Whether all numbers are in units of the last of ``decimals`` digits, not of their own.
    places, widths : int64 array, shape (n,), optional
        Digits after and before the point of each number, where they are listed.
    minus_zeros : int array, optional
        Rows of zeros with a minus before them, where there are any.
    """

    places_rule: int
    width_rule: int
    decimals: int
    width: int
    is_scaled: bool
    places: _Ints | None = None
    widths: _Ints | None = None
    minus_zeros: NDArray[np.intp] | None = None

    def apply(self, column: _Ints) -> tuple[_Ints, _Counts, _Counts]:
        """Return value, digits after and digits before the point of each number."""
        # Digits after the point.
        if self.places is not None:
            places = self.places
        elif self.places_rule == _SAME:
            places = np.full(len(column), self.decimals, np.int64)
        else:
            places = _needed_places(column, self.decimals, self.places_rule)
        values = column
        if self.is_scaled:
            # Towards zero: what is cut off is zero.
            powers = _powers(self.decimals - places)
            values = np.sign(column) * (np.abs(column) // powers)

        # Digits before it; no fewer than the number needs are written.
        widths = np.full(len(column), self.width, np.int64) if self.widths is None else self.widths
        all_widths = widths.astype(np.uint8)
        if self.minus_zeros is not None:
            all_widths[self.minus_zeros] |= _MINUS_ZERO
        return values, places.astype(np.uint8), all_widths


def find_notation(values: _Ints, places: _Counts, widths: _Counts) -> tuple[Notation, _Ints]:
    """Find how numbers are written.

    Parameters
    ----------
    values : int64 array, shape (n,)
        In units of the last digit of each.
    places, widths : uint8 array, shape (n,)
        Digits after and before the point; 128 is added to the latter for minus zero.

    Returns
    -------
    Notation
        The rules.
    int64 array, shape (n,)
        The numbers, in units of the last digit of all where these fit.

    Examples
    --------
    >>> find_notation(np.array([15, 2]), np.array([1, 0], np.uint8), np.ones(2, np.uint8))[1]
    array([15, 20])
    """
    # Zeros with a minus.
    minus_zeros = np.flatnonzero(widths & _MINUS_ZERO)
    widths = widths & np.uint8(_MINUS_ZERO - 1)

    # One unit for all, if no number gets too large.
    decimals, sizes = int(places.max(initial=0)), np.abs(values)
    column, is_scaled = values, bool(sizes.max(initial=0) < MAX_VALUE)
    if (places != decimals).any():
        powers = _powers(decimals - places.astype(np.int64))
        is_scaled = bool((sizes < MAX_VALUE // powers).all())
        column = values * powers if is_scaled else values

    # The rule of digits after the point.
    rule, listed = _LISTED, places.astype(np.int64)
    if (places == decimals).all():
        rule = _SAME
    elif is_scaled:
        for trimmed in (_TRIMMED, _TRIMMED_TO_ONE):
            if (_needed_places(column, decimals, trimmed) == listed).all():
                rule = trimmed

    # The rule of digits before it.
    width_rule, width = _WIDTHS_LISTED, 0
    fewer = np.maximum(widths.astype(np.int64) - 1, 0)
    digits = np.minimum(fewer + places, len(_POWERS) - 1)
    if ((sizes >= _powers(digits)) | (fewer == 0)).all():
        width_rule = _NATURAL
    elif (np.maximum(_needed_widths(values, places), widths.max()) == widths).all():
        width_rule, width = _PADDED, int(widths.max())
    notation = Notation(
        rule,
        width_rule,
        decimals,
        width,
        is_scaled,
        listed if rule == _LISTED else None,
        widths.astype(np.int64) if width_rule == _WIDTHS_LISTED else None,
        minus_zeros if len(minus_zeros) else None,
    )
    return notation, column


def encode_notation(notation: Notation) -> bytes:
    """Encode the rules of a column, and what they list."""
    # The rules, as bits of one byte.
    first = (
        notation.places_rule
        | notation.width_rule << _WIDTH_SHIFT
        | (not notation.is_scaled) << _UNSCALED_SHIFT
        | (notation.minus_zeros is not None) << _MINUS_SHIFT
    )
    parts = [bytes([first, notation.decimals])]

    # What they list: places, widths, and rows of zeros with a minus.
    if notation.places is not None:
        parts.append(encode_column(notation.places)[0])
    if notation.width_rule == _PADDED:
        parts.append(bytes([notation.width]))
    if notation.widths is not None:
        parts.append(encode_column(notation.widths)[0])
    if notation.minus_zeros is not None:
        parts.append(encode_varint(len(notation.minus_zeros)))
        skipped = np.diff(notation.minus_zeros, prepend=-1) - 1
        parts.append(encode_column(skipped.astype(np.int64))[0])
    return b"".join(parts)


def decode_notation(cursor: Cursor, count: int) -> Notation:
    """Undo :func:`encode_notation` for ``count`` numbers.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no notation.
    """
    first, decimals = cursor.read_bytes(2, "a notation")
    places_rule, width_rule = first & 3, first >> _WIDTH_SHIFT & 3
    if first >> (_MINUS_SHIFT + 1) or width_rule > _WIDTHS_LISTED or decimals > _MAX_DIGITS:
        raise cursor.error("no numbers are written in this way")
    is_scaled = not first >> _UNSCALED_SHIFT & 1
    places = _read_counts(cursor, count, decimals) if places_rule == _LISTED else None
    width = cursor.read_byte("a width") if width_rule == _PADDED else 0
    if width > _MAX_DIGITS:
        raise cursor.error(f"numbers with {width} digits before the point")
    widths = _read_counts(cursor, count, _MAX_DIGITS) if width_rule == _WIDTHS_LISTED else None
    minus_zeros = _read_rows(cursor, count) if first >> _MINUS_SHIFT else None
    return Notation(
        places_rule, width_rule, decimals, width, is_scaled, places, widths, minus_zeros
    )


def _read_rows(cursor: Cursor, count: int) -> NDArray[np.intp]:
    """Read numbers of rows, in order."""
    rows = cursor.read_varint("the number of minus zeros")
    if rows > count:
        raise cursor.error(f"{rows} minus zeros of {count} numbers")
    skipped, _ = decode_column(cursor, rows)
    if rows and (skipped.min() < 0 or skipped.max() >= count):
        raise cursor.error(f"a minus zero past the last of {count} numbers")
    found = np.cumsum(skipped + 1) - 1
    if rows and found[-1] >= count:
        raise cursor.error(f"a minus zero past the last of {count} numbers")
    return found.astype(np.intp)


def _read_counts(cursor: Cursor, count: int, limit: int) -> _Ints:
    """Read numbers of digits."""
    counts, _ = decode_column(cursor, count)
    if count and not (counts.min() >= 0 and counts.max() <= limit):
        raise cursor.error(f"numbers with other than 0 to {limit} digits")
    return counts


def _powers(exponents: _Ints) -> _Ints:
    """Powers of ten, from a table: ``np.power`` takes 10 ns for each."""
    return _POWERS[exponents]


def _needed_places(column: _Ints, decimals: int, rule: int) -> _Ints:
    """Fewest digits after the point, of numbers in units of the last one."""
    places = np.full(len(column), decimals, np.int64)
    rest = column.copy()
    for fewer in range(decimals - 1, -1 if rule == _TRIMMED else 0, -1):
        is_shorter = (places == fewer + 1) & (rest % 10 == 0)
        places[is_shorter] = fewer
        rest //= 10
    return places


def _needed_widths(values: _Ints, places: _Counts) -> _Ints:
    """Fewest digits before the point, at least one."""
    whole = np.abs(values) // _powers(places.astype(np.int64))
    return np.maximum(np.searchsorted(_powers(np.arange(1, 19)), whole, side="right") + 1, 1)
