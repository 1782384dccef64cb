"""Numbers in text: found, and written back.

A record is a line of text, or a part of a long one. Its numbers are tokens; all else is its shape.
A token is a number with at most 17 digits, or a date and time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit_uncounted

__all__ = ["MARK", "MAX_DIGITS", "MINUS_ZERO", "NUMBER", "split_records", "write_records"]

#: Kinds of tokens: a number, and dates with what stands between their parts.
NUMBER = np.int64(0)
_DATE_T = np.int64(1)  # 2024-05-06T07:08:09
_DATE_SPACE = np.int64(2)  # 2024-05-06 07:08:09
_DATE_SLASH = np.int64(3)  # 2024/05/06 07:08:09
_CLOCK = np.int64(4)  # 07:08:09
_NO_TOKEN = np.int64(-1)

#: Stands for a token in a shape: a byte that UTF-8 never holds, then its kind.
MARK = np.uint8(0xFF)

#: Digits of a token that surely fit: 10**17 is below 2**57.
MAX_DIGITS = 17

#: Bytes of a date and of a time of day.
_DATE_BYTES = 19
_CLOCK_BYTES = 8

#: Is added to the width of a zero with a minus before it.
MINUS_ZERO = 128

#: A line that is longer than this is split after brackets and commas; so many bytes of a record
#: suffice for a split at a comma.
_LONG_LINE = 1000
_LONG_RECORD = 200

#: A record has at most so many tokens, and an empty shape is never split.
_MAX_TOKENS = 64

#: Bytes of text.
_NEW_LINE = np.uint8(10)
_COMMA = np.uint8(44)
_MINUS = np.uint8(45)
_POINT = np.uint8(46)
_SLASH = np.uint8(47)
_ZERO = np.uint8(48)
_NINE = np.uint8(57)
_COLON = np.uint8(58)
_SPACE = np.uint8(32)
_T = np.uint8(84)
_BRACKET = np.uint8(93)
_BRACE = np.uint8(125)

#: Hash of a shape, by bytes (Fowler, Noll and Vo's FNV-1a).
_HASH_START = np.uint64(0xCBF29CE484222325)
_HASH_FACTOR = np.uint64(0x100000001B3)

_SECONDS_PER_DAY = 86400

#: Powers of ten, and the digits of 0 to 99: division by 100 halves the divisions.
_POWERS = np.array([10**i for i in range(MAX_DIGITS + 2)], np.int64)
_PAIRS = np.array([_ZERO + digit for i in range(100) for digit in divmod(i, 10)], np.uint8)


@inner_uncounted
def _is_digit(byte: int) -> bool:
    return _ZERO <= byte <= _NINE


@inner_uncounted
def _read_digits(text: NDArray[np.uint8], start: int, count: int) -> int:
    """Value of ``count`` digits; -1 if they are none."""
    value = np.int64(0)
    for i in range(start, start + count):
        if not _is_digit(text[i]):
            return np.int64(-1)
        value = value * 10 + np.int64(text[i] - _ZERO)
    return value


@inner_uncounted
def _days_before(year: int, month: int) -> int:
    """Days from 1970-01-01 to the first of a month, in the Gregorian calendar.

    Years begin in March, so that a day that some years have more is their last one.
    """
    moved = (month + 9) % 12
    years = year - moved // 10
    return 365 * years + years // 4 - years // 100 + years // 400 + (306 * moved + 5) // 10 - 719468


@inner_uncounted
def _read_clock(text: NDArray[np.uint8], start: int) -> int:
    """Seconds of a time of day, such as 07:08:09; -1 if it is none."""
    if text[start + 2] != _COLON or text[start + 5] != _COLON:
        return np.int64(-1)
    hours, minutes = _read_digits(text, start, 2), _read_digits(text, start + 3, 2)
    seconds = _read_digits(text, start + 6, 2)
    if hours < 0 or minutes < 0 or seconds < 0 or hours > 23 or minutes > 59 or seconds > 59:
        return np.int64(-1)
    return (hours * 60 + minutes) * 60 + seconds


@inner_uncounted
def _read_date(text: NDArray[np.uint8], start: int) -> int:
    """Seconds since 1970 of a date and time of 19 bytes; -1 if it is none, or before 1970."""
    year, month = _read_digits(text, start, 4), _read_digits(text, start + 5, 2)
    day, seconds = _read_digits(text, start + 8, 2), _read_clock(text, start + 11)
    if year < 1970 or month < 1 or month > 12 or day < 1 or seconds < 0:
        return np.int64(-1)
    first = _days_before(year, month)
    next_first = _days_before(year + month // 12, month % 12 + 1)
    if day > next_first - first:
        return np.int64(-1)
    return (first + day - 1) * _SECONDS_PER_DAY + seconds


@inner_uncounted
def _find_date(text: NDArray[np.uint8], start: int, end: int) -> tuple[int, int]:
    """Kind and seconds of a date or time of day that begins here; no token if there is none."""
    if end - start >= _DATE_BYTES:
        first, second, middle = text[start + 4], text[start + 7], text[start + 10]
        kind = _NO_TOKEN
        if first == _MINUS and second == _MINUS and middle == _T:
            kind = _DATE_T
        elif first == _MINUS and second == _MINUS and middle == _SPACE:
            kind = _DATE_SPACE
        elif first == _SLASH and second == _SLASH and middle == _SPACE:
            kind = _DATE_SLASH
        if kind != _NO_TOKEN:
            seconds = _read_date(text, start)
            if seconds >= 0:
                return kind, seconds
    if end - start >= _CLOCK_BYTES:
        seconds = _read_clock(text, start)
        if seconds >= 0:
            return _CLOCK, seconds
    return _NO_TOKEN, np.int64(0)


@inner_uncounted
def _find_token(
    text: NDArray[np.uint8], start: int, end: int, last: int
) -> tuple[int, int, int, int, int]:
    """Find the token that begins at a byte.

    Parameters
    ----------
    start, end : int
        Where it may begin, and the end of the text.
    last : int
        The byte before, by which a minus between digits is no sign.

    Returns
    -------
    kind, value, decimals, width, end : int
        Its kind or -1; its value without the point; digits after and before the point; its end.
    """
    # A sign.
    first = start
    is_negative = text[start] == _MINUS and not _is_digit(last)
    if is_negative:
        first += 1
    if first >= end or not _is_digit(text[first]):
        return _NO_TOKEN, np.int64(0), 0, 0, start

    # The whole part: a date, or digits.
    kind, value = _NO_TOKEN, np.int64(0)
    if not is_negative:
        kind, value = _find_date(text, first, end)
    i, digits = first, 0
    if kind != _NO_TOKEN:
        i += _CLOCK_BYTES if kind == _CLOCK else _DATE_BYTES
        digits = 11
    else:
        while i < end and digits < MAX_DIGITS and _is_digit(text[i]):
            value = value * 10 + np.int64(text[i] - _ZERO)
            i += 1
            digits += 1
    width = 0 if kind != _NO_TOKEN else digits

    # Digits after a point.
    decimals = 0
    if i + 1 < end and text[i] == _POINT and _is_digit(text[i + 1]) and digits < MAX_DIGITS:
        i += 1
        while i < end and digits < MAX_DIGITS and _is_digit(text[i]):
            value = value * 10 + np.int64(text[i] - _ZERO)
            i += 1
            digits += 1
            decimals += 1
    if is_negative:
        # Minus zero is a value of its own.
        if value == 0:
            width |= MINUS_ZERO
        value = -value
    return kind if kind != _NO_TOKEN else NUMBER, value, decimals, width, i


@inner_uncounted
def _hashed(key: np.uint64, byte: np.uint8) -> np.uint64:
    return (key ^ np.uint64(byte)) * _HASH_FACTOR


@jit_uncounted
def split_records(
    text: NDArray[np.uint8],
    starts: NDArray[np.int64],
    first_tokens: NDArray[np.int64],
    keys: NDArray[np.uint64],
    kinds: NDArray[np.uint8],
    values: NDArray[np.int64],
    decimals: NDArray[np.uint8],
    widths: NDArray[np.uint8],
    token_starts: NDArray[np.int64],
    token_ends: NDArray[np.int64],
) -> tuple[int, int]:
    """Split text into records and their tokens; return how many there are of each.

    Parameters
    ----------
    text : uint8 array, shape (n,)
        Without the byte ff.
    starts, first_tokens, keys : array, shape (n + 1,)
        Start, number of the first token and hash of the shape of each record; filled in.
    kinds, values, decimals, widths, token_starts, token_ends : array, shape (n,)
        Of each token; filled in.
    """
    records, tokens = 0, 0
    i, end, line_start, record_start = 0, len(text), 0, 0
    last = _SPACE
    key = _HASH_START
    while i < end:
        if i == record_start:
            starts[records], first_tokens[records] = i, tokens
            key = _HASH_START

        # A token, or a byte of the shape.
        byte = text[i]
        kind, value, places, width, after = _NO_TOKEN, np.int64(0), 0, 0, i
        if (_is_digit(byte) or byte == _MINUS) and tokens - first_tokens[records] < _MAX_TOKENS:
            kind, value, places, width, after = _find_token(text, i, end, last)
        if kind != _NO_TOKEN:
            kinds[tokens], values[tokens] = kind, value
            decimals[tokens], widths[tokens] = places, width
            token_starts[tokens], token_ends[tokens] = i, after
            tokens += 1
            key = _hashed(_hashed(key, MARK), np.uint8(kind))
            last = text[after - 1]
            i = after
            continue
        key = _hashed(key, byte)
        i += 1

        # The end of the record.
        is_end = byte == _NEW_LINE
        if byte == _COMMA and i - line_start > _LONG_LINE:
            is_end = last in (_BRACKET, _BRACE) or i - record_start > _LONG_RECORD
        if is_end or i == end:
            keys[records] = key
            records += 1
            record_start = i
        if byte == _NEW_LINE:
            line_start = i
        last = byte
    if record_start < end:
        # The text ends with a token.
        keys[records] = key
        records += 1
    starts[records], first_tokens[records] = end, tokens
    return records, tokens


@inner_uncounted
def _write_digits(out: NDArray[np.uint8], start: int, value: int, count: int) -> None:
    """Write the last ``count`` digits of a number >= 0, two at a time."""
    i, rest = np.uint64(start + count), np.uint64(value)
    for _ in range(count >> 1):
        quotient = rest // np.uint64(100)
        pair = np.uint32(rest - np.uint64(100) * quotient) << np.uint32(1)
        i -= np.uint64(2)
        out[i], out[i + np.uint64(1)] = _PAIRS[pair], _PAIRS[pair + np.uint32(1)]
        rest = quotient
    if count & 1:
        out[np.uint64(start)] = _ZERO + np.uint8(rest % np.uint64(10))


@inner_uncounted
def _count_digits(value: int) -> int:
    """Number of decimal digits of a number >= 0, at least 1."""
    digits = np.int64(1)
    while digits <= MAX_DIGITS and value >= _POWERS[np.uint32(digits)]:
        digits += 1
    return digits


@inner_uncounted
def _write_clock(out: NDArray[np.uint8], start: int, seconds: int) -> None:
    """Write a time of day in 8 bytes."""
    _write_digits(out, start, seconds // 3600, 2)
    out[start + 2] = _COLON
    _write_digits(out, start + 3, seconds // 60 % 60, 2)
    out[start + 5] = _COLON
    _write_digits(out, start + 6, seconds % 60, 2)


@inner_uncounted
def _write_date(out: NDArray[np.uint8], start: int, kind: int, seconds: int) -> None:
    """Write a date and time in 19 bytes."""
    # The year whose March begins at or before the day, by the length of 400 years.
    day = seconds // _SECONDS_PER_DAY + 719468
    era, rest = day // 146097, day % 146097
    year = (rest - rest // 1460 + rest // 36524 - rest // 146096) // 365
    rest -= 365 * year + year // 4 - year // 100
    moved = (5 * rest + 2) // 153
    month = moved + 3 if moved < 10 else moved - 9
    year += 400 * era + (1 if month <= 2 else 0)

    # What stands between the parts.
    separator = _SLASH if kind == _DATE_SLASH else _MINUS
    _write_digits(out, start, year, 4)
    out[start + 4] = separator
    _write_digits(out, start + 5, month, 2)
    out[start + 7] = separator
    _write_digits(out, start + 8, rest - (153 * moved + 2) // 5 + 1, 2)
    out[start + 10] = _T if kind == _DATE_T else _SPACE
    _write_clock(out, start + 11, seconds % _SECONDS_PER_DAY)


@inner_uncounted
def _write_token(
    out: NDArray[np.uint8], i: int, kind: int, value: int, places: int, width: int
) -> int:
    """Write a token; return its end, or -1 if it does not fit."""
    # The sign, and the digits before and after the point.
    if value < 0 or width & MINUS_ZERO:
        if i >= len(out):
            return -1
        out[i] = _MINUS
        i += 1
        value = abs(value)
    width &= MINUS_ZERO - 1
    whole, fraction = value, np.int64(0)
    if places > 0:
        power = np.uint64(_POWERS[np.uint32(places)])
        quotient = np.uint64(value) // power
        whole, fraction = np.int64(quotient), np.int64(np.uint64(value) - quotient * power)

    # The whole part.
    if kind == NUMBER:
        size = max(_count_digits(whole), width)
    else:
        size = _CLOCK_BYTES if kind == _CLOCK else _DATE_BYTES
    if i + size + 1 + places > len(out) + (0 if places > 0 else 1):
        return -1
    if kind == NUMBER:
        _write_digits(out, i, whole, size)
    elif kind == _CLOCK:
        _write_clock(out, i, whole)
    else:
        _write_date(out, i, kind, whole)
    i += size

    # The point and what follows.
    if places > 0:
        out[i] = _POINT
        _write_digits(out, i + 1, fraction, places)
        i += 1 + places
    return i


@jit_uncounted
def write_records(
    out: NDArray[np.uint8],
    record_shapes: NDArray[np.int64],
    shapes: NDArray[np.uint8],
    shape_starts: NDArray[np.int64],
    values: NDArray[np.int64],
    decimals: NDArray[np.uint8],
    widths: NDArray[np.uint8],
) -> bool:
    """Write records from their shapes and tokens; return whether they fill the text exactly.

    Parameters
    ----------
    out : uint8 array, shape (n,)
        The text; filled in.
    record_shapes : int64 array, shape (r,)
        Number of each record's shape.
    shapes : uint8 array, shape (m,)
        Bytes of all shapes, each token as the byte ff and its kind.
    shape_starts : int64 array, shape (s + 1,)
        Where each shape starts.
    values, decimals, widths : array, shape (t,)
        Of the tokens of all records.
    """
    i, token = 0, 0
    for record in range(len(record_shapes)):
        j = shape_starts[record_shapes[record]]
        end = shape_starts[record_shapes[record] + 1]
        while j < end:
            if shapes[j] != MARK:
                if i >= len(out):
                    return False
                out[i] = shapes[j]
                i, j = i + 1, j + 1
                continue
            kind = np.int64(shapes[j + 1])
            places, width = np.int64(decimals[token]), np.int64(widths[token])
            i = _write_token(out, i, kind, values[token], places, width)
            if i < 0:
                return False
            token, j = token + 1, j + 2
    return i == len(out)
