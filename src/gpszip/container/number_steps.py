"""Names that are growing numbers, as the steps between them: about two bits a name.

A step s (less 1) has a Rice code (R. F. Rice, 1979) with divisor 2**k: s >> k ones, a zero, and the
k lowest digits of s.
"""

from __future__ import annotations

from itertools import pairwise

from gpszip.container.layout import Cursor, encode_varint
from gpszip.errors import CorruptArchiveError

__all__ = ["MAX_WIDTH", "encode_number_steps", "read_number_steps"]

#: Digits of the longest number; longer names are text.
MAX_WIDTH = 18

#: Divisors 2**k that are tried, k = 0 ... 59.
_DIVISORS = 60

#: Codes take at most this many ones for each name on average, or names are text.
_MAX_MEAN_ONES = 64


def encode_number_steps(ids: tuple[str, ...]) -> bytes | None:
    """Encode names that are all numbers, each larger than the one before; None for other names.

    Returns the first number, a byte of the width to which numbers are padded (0: none), one of k,
    and the codes.

    Examples
    --------
    >>> encode_number_steps(("007", "008", "011")).hex()
    '07030060'
    """
    # Names other than numbers have another encoding.
    if not ids or not all(
        name.isascii() and name.isdigit() and len(name) <= MAX_WIDTH for name in ids
    ):
        return None

    # Width and steps.
    numbers = [int(name) for name in ids]
    width = _find_width(numbers, ids)
    # Each number is larger than the one before, so that 1 is taken off every step.
    steps = [after - before - 1 for before, after in pairwise(numbers)]
    if width is None or min(steps, default=0) < 0:
        return None

    # The divisor that takes the fewest bits.
    # A code has s >> k ones, a zero and k digits; the zeros are as many for any k.
    divisor = min(range(_DIVISORS), key=lambda k: sum(step >> k for step in steps) + k * len(steps))
    # A single huge step would take very many ones.
    if sum(step >> divisor for step in steps) > _MAX_MEAN_ONES * len(steps):
        return None
    return encode_varint(numbers[0]) + bytes([width, divisor]) + _rice_codes(steps, divisor)


def read_number_steps(data: bytes, count: int, offset: int) -> tuple[str, ...]:
    """Undo :func:`encode_number_steps`, given the number of names; ``offset`` is for errors."""
    # Read the first number, the width to which numbers are padded, and k of the Rice codes.
    cursor = Cursor(data, base=offset)
    number = cursor.read_varint("the first number")
    width = cursor.read_byte("the width of numbers")
    divisor = cursor.read_byte("the steps' divisor")
    if not count or width > MAX_WIDTH or divisor >= _DIVISORS:
        raise cursor.error("names are no growing numbers")

    # One code for each name but the first.
    bits = "".join(f"{byte:08b}" for byte in cursor.read_rest())
    names, start = [str(number).zfill(width)], 0
    for _ in range(count - 1):
        zero = bits.find("0", start)
        end = zero + 1 + divisor
        if zero < 0 or end > len(bits):
            raise CorruptArchiveError("numbers end too early", offset + len(data))
        # The ones before the zero are s >> k, and k digits follow.
        number += 1 + (zero - start << divisor | int(bits[zero + 1 : end] or "0", 2))
        names.append(str(number).zfill(width))
        start = end

    # Only zeros up to the end of the byte may follow.
    if len(bits) - start >= 8 or "1" in bits[start:]:
        raise CorruptArchiveError("bytes after the last number", offset + len(data))
    return tuple(names)


def _find_width(numbers: list[int], ids: tuple[str, ...]) -> int | None:
    """Digits to which all names are padded, 0 if they are not; None if they differ."""
    # Without padding, or padded to the width of the first name.
    for width in (0, len(ids[0])):
        if all(str(n).zfill(width) == name for n, name in zip(numbers, ids, strict=True)):
            return width
    return None


def _rice_codes(steps: list[int], divisor: int) -> bytes:
    """Codes of all steps, with zeros up to the end of a byte."""
    mask = (1 << divisor) - 1
    bits = "".join(
        "1" * (step >> divisor) + "0" + (f"{step & mask:0{divisor}b}" if divisor else "")
        for step in steps
    )
    bits += "0" * (-len(bits) % 8)
    return int(bits or "0", 2).to_bytes(len(bits) // 8, "big")
