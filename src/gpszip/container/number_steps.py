"""Names that are growing numbers with holes, as the steps between them: Rice codes, about two bits a name."""

from __future__ import annotations

from itertools import pairwise

from gpszip.container.layout import Cursor, encode_varint
from gpszip.errors import CorruptArchiveError

__all__ = ["WIDTH_LIMIT", "encode_number_steps", "read_number_steps"]

#: Digits of the longest number that is told from other text.
WIDTH_LIMIT = 18

_DIVISORS = 60


def encode_number_steps(ids: tuple[str, ...]) -> bytes | None:
    """Code names that are all numbers, each larger than the one before; None for other names.

    Examples
    --------
    >>> encode_number_steps(("007", "008", "011")).hex()
    '07030060'
    """
    if not ids or not all(
        name.isascii() and name.isdigit() and len(name) <= WIDTH_LIMIT for name in ids
    ):
        return None
    numbers = [int(name) for name in ids]
    width = next(
        (
            wide
            for wide in (0, len(ids[0]))
            if all(str(n).zfill(wide) == name for n, name in zip(numbers, ids, strict=True))
        ),
        -1,
    )
    steps = [b - a - 1 for a, b in pairwise(numbers)]
    if width < 0 or min(steps, default=0) < 0:
        return None
    divisor = min(range(_DIVISORS), key=lambda k: sum(step >> k for step in steps) + k * len(steps))
    if sum(step >> divisor for step in steps) > 64 * len(steps):
        return None
    return encode_varint(numbers[0]) + bytes([width, divisor]) + _packed(steps, divisor)


def read_number_steps(data: bytes, count: int, offset: int) -> tuple[str, ...]:
    """Undo :func:`encode_number_steps`, given the number of names."""
    cursor = Cursor(data, base=offset)
    number = cursor.read_varint("the first number")
    width, divisor = (
        cursor.read_byte("the width of numbers"),
        cursor.read_byte("the steps' divisor"),
    )
    if not count or width > WIDTH_LIMIT or divisor >= _DIVISORS:
        raise cursor.error("names are no growing numbers")
    bits = "".join(f"{byte:08b}" for byte in cursor.read_rest())
    names, at = [str(number).zfill(width)], 0
    for _ in range(count - 1):
        stop = bits.find("0", at)
        end = stop + 1 + divisor
        if stop < 0 or end > len(bits):
            raise CorruptArchiveError("numbers end too early", offset + len(data))
        number += 1 + (stop - at << divisor | int(bits[stop + 1 : end] or "0", 2))
        names.append(str(number).zfill(width))
        at = end
    if len(bits) - at >= 8 or "1" in bits[at:]:
        raise CorruptArchiveError("bytes after the last number", offset + len(data))
    return tuple(names)


def _packed(steps: list[int], divisor: int) -> bytes:
    low = (1 << divisor) - 1
    bits = "".join(
        "1" * (step >> divisor) + "0" + (f"{step & low:0{divisor}b}" if divisor else "")
        for step in steps
    )
    bits += "0" * (-len(bits) % 8)
    return int(bits or "0", 2).to_bytes(len(bits) // 8, "big")
