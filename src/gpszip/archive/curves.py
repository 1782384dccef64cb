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
from gpszip.container.layout import Cursor, encode_signed, encode_varint
from gpszip.errors import CorruptArchiveError

__all__ = ["encode_curves", "read_curve_heads", "read_curves"]

#: Bytes of bound and step.
_FLOATS = struct.Struct("<dd")


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


def encode_curves(columns: Mapping[str, CurveColumn]) -> bytes:
    """Encode the body of the section.

    Examples
    --------
    >>> from gpszip.codec.curves import fit_column
    >>> import numpy as np
    >>> column = fit_column([np.arange(3.0)], [np.array([5.0, 5.0, 5.0])], 1.0)
    >>> read_curves(encode_curves({"ele": column}), 1)["ele"].curve(0).at([1.5]).tolist()
    [5.0]
    """
    out = [encode_varint(len(columns))]
    for name, column in columns.items():
        # The head.
        text = name.encode()
        payload, knots = encode_knots(column)
        out += [
            encode_varint(len(text)),
            text,
            _FLOATS.pack(column.bound, column.step),
            encode_varint(column.unit),
            encode_signed(int(times_of_knots(column)[0])),
            encode_varint(knots),
            encode_varint(len(payload)),
            payload,
        ]
    return b"".join(out)


def read_curve_heads(body: bytes) -> dict[str, tuple[float, int]]:
    """Bound and bytes of each column with its name, without decoding any.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no curves.
    """
    return {name: (head.bound, head.size) for name, head in _read_heads(body).items()}


def read_curves(body: bytes, tracks: int) -> dict[str, CurveColumn]:
    """Undo :func:`encode_curves`.

    Parameters
    ----------
    body : bytes
        Untrusted; memory stays below 100 kB for each of its bytes, plus 1 MB for each column.
    tracks : int
        Number of tracks of the archive.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no curves of so many tracks.
    """
    return {name: _read_column(head, tracks) for name, head in _read_heads(body).items()}


def _read_heads(body: bytes) -> dict[str, _Head]:
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
        bound, step = _FLOATS.unpack(cursor.read_bytes(_FLOATS.size, "a bound"))
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


def _read_column(head: _Head, tracks: int) -> CurveColumn:
    """Decode the knots of a column."""
    knots = decode_knots(head.payload, head.knots, head.first, tracks)
    if knots is None:
        raise CorruptArchiveError("the knots of a curve are damaged", head.offset)
    return CurveColumn(head.bound, head.step, head.unit, knots)
