"""The section of columns that are kept within an error."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import NamedTuple

from gpszip.codec.curves import (
    MAX_FIRST,
    UNITS,
    CurveColumn,
    decode_knots,
    encode_knots,
    max_rows,
    times_of_knots,
)
from gpszip.container.contents import Section
from gpszip.container.layout import Cursor, SectionKind, encode_signed, encode_varint
from gpszip.errors import CorruptArchiveError

__all__ = ["curves_section", "read_curve_heads", "read_curves"]

#: Bytes of bound and step.
_FLOATS = struct.Struct("<dd")

#: Two bytes of a short bound: digits in the lower bits, then the exponent of 10, which is at least
#: the negative offset.
_SHORT = struct.Struct("<H")
_DIGIT_BITS = 10
_MAX_DIGITS = 999
_EXPONENT_OFFSET = 8
_EXPONENTS = 16


class _Head(NamedTuple):
    """What stands before the knots of a column."""

    bound: float
    step: float
    unit: int
    first: int
    knots: int
    payload: bytes
    offset: int
    size: int


def curves_section(columns: Mapping[str, CurveColumn]) -> Section:
    """The section of some columns, with short bounds where all are short.

    Examples
    --------
    >>> from gpszip.codec.curves import fit_column
    >>> import numpy as np
    >>> own = [fit_column([np.arange(3.0)], [np.zeros(3)], bound) for bound in (0.3, 0.9144)]
    >>> [curves_section({"ele": column}).kind.name for column in own]
    ['SHORT_CURVES', 'CURVES']
    >>> section = curves_section({"ele": fit_column([np.arange(3.0)], [np.full(3, 5.0)], 1.0)})
    >>> read_curves(section.kind, section.body, 1)["ele"].curve(0).at([1.5]).tolist()
    [5.0]
    """
    short = all(_short_bound(column) is not None for column in columns.values())
    kind = SectionKind.SHORT_CURVES if short else SectionKind.CURVES
    return Section(kind, _encode_curves(columns, short=short))


def _short_bound(column: CurveColumn) -> int | None:
    """Bound of at most three digits as a number of two bytes; None for others, or other steps."""
    if column.step != column.bound / 2:
        return None
    digits, _, exponent = f"{column.bound:.2e}".partition("e")
    power = int(exponent) - 2
    number = int(digits.replace(".", ""))
    while number % 10 == 0:
        number, power = number // 10, power + 1
    code = number | (power + _EXPONENT_OFFSET) << _DIGIT_BITS
    in_range = 0 <= power + _EXPONENT_OFFSET < _EXPONENTS
    return code if in_range and _bound_of(code) == column.bound else None


def _bound_of(code: int) -> float:
    """The bound of two bytes."""
    digits, power = code & ((1 << _DIGIT_BITS) - 1), (code >> _DIGIT_BITS) - _EXPONENT_OFFSET
    return float(digits * 10**power) if power >= 0 else digits / 10**-power


def _encode_curves(columns: Mapping[str, CurveColumn], *, short: bool) -> bytes:
    """Encode the body of the section; short bounds only where all columns have such."""
    out = [encode_varint(len(columns))]
    for name, column in columns.items():
        # The head.
        text = name.encode()
        payload, knots = encode_knots(column)
        code = _short_bound(column) if short else None
        bound = _FLOATS.pack(column.bound, column.step) if code is None else _SHORT.pack(code)
        out += [
            encode_varint(len(text)),
            text,
            bound,
            encode_varint(column.unit),
            encode_signed(int(times_of_knots(column)[0])),
            encode_varint(knots),
            encode_varint(len(payload)),
            payload,
        ]
    return b"".join(out)


def read_curve_heads(kind: int, body: bytes) -> dict[str, tuple[float, int]]:
    """Bound and bytes of each column with its name, without decoding any.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no curves.
    """
    heads = _read_heads(body, short=kind == SectionKind.SHORT_CURVES)
    return {name: (head.bound, head.size) for name, head in heads.items()}


def read_curves(kind: int, body: bytes, tracks: int) -> dict[str, CurveColumn]:
    """Undo :func:`curves_section`.

    Parameters
    ----------
    kind : int
        Kind of the section.
    body : bytes
        Untrusted; memory stays below 100 kB for each of its bytes, plus 1 MB for each column.
    tracks : int
        Number of tracks of the archive.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no curves of so many tracks.
    """
    heads = _read_heads(body, short=kind == SectionKind.SHORT_CURVES)
    return {name: _read_column(head, tracks) for name, head in heads.items()}


def _read_heads(body: bytes, *, short: bool) -> dict[str, _Head]:
    """What stands before the knots of each column."""
    cursor = Cursor(body)
    count = cursor.read_varint("the number of curves")
    heads: dict[str, _Head] = {}
    for _ in range(count):
        # The name.
        start = cursor.offset
        text = cursor.read_bytes(cursor.read_varint("a name's length"), "a name")
        try:
            name = text.decode()
        except UnicodeDecodeError:
            raise cursor.error("the name of a curve is not UTF-8") from None
        if name in heads:
            raise cursor.error("two curves of one name")

        # The grid.
        bound, step = _read_short_bound(cursor) if short else _read_floats(cursor)
        unit = cursor.read_varint("the unit of time")
        first = cursor.read_signed("the first time")
        knots = cursor.read_varint("the number of knots")
        is_grid = 0 < bound < math.inf and 0 < step < math.inf and unit in UNITS
        if not is_grid or abs(first) >= MAX_FIRST:
            raise cursor.error(f"no curve has bound {bound:g}, step {step:g} and unit {unit}")
        offset = cursor.offset
        payload = cursor.read_bytes(cursor.read_varint("the length of a curve"), "a curve")
        if knots > max_rows(len(payload)):
            raise cursor.error(f"{knots} knots can't lie in {len(payload)} bytes")
        size = cursor.offset - start
        heads[name] = _Head(bound, step, unit, first, knots, payload, offset, size)
    cursor.expect_end("the curves")
    return heads


def _read_floats(cursor: Cursor) -> tuple[float, float]:
    """Bound and step of any size."""
    bound, step = _FLOATS.unpack(cursor.read_bytes(_FLOATS.size, "a bound"))
    return bound, step


def _read_short_bound(cursor: Cursor) -> tuple[float, float]:
    """A bound of two bytes, and the step, half of it."""
    (code,) = _SHORT.unpack(cursor.read_bytes(_SHORT.size, "a bound"))
    digits = code & ((1 << _DIGIT_BITS) - 1)
    if not 0 < digits <= _MAX_DIGITS or code >> _DIGIT_BITS >= _EXPONENTS:
        raise cursor.error("a bound is none of two bytes")
    bound = _bound_of(code)
    return bound, bound / 2


def _read_column(head: _Head, tracks: int) -> CurveColumn:
    """Decode the knots of a column."""
    knots = decode_knots(head.payload, head.knots, head.first, tracks)
    if knots is None:
        raise CorruptArchiveError("the knots of a curve are damaged", head.offset)
    return CurveColumn(head.bound, head.step, head.unit, knots)
