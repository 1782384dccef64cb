"""Geometries in well-known binary, number by number, and a twin of the reader of points."""

import math
import struct

NAN = math.nan


def point(numbers, *, order="<", axes="", style="iso", srid=None, kind=1):
    """A point, or with kind 4 a MultiPoint of one; ``axes`` is z, m or zm."""
    number = kind + header_of(axes, style, srid)
    own = struct.pack(order + f"{len(numbers)}d", *numbers)
    head = struct.pack(order + "BI", order == "<", number)
    if srid is not None:
        head += struct.pack(order + "I", srid)
    if kind == 4:
        inner = struct.pack(order + "BI", order == "<", 1 + header_of(axes, style, None))
        return head + struct.pack(order + "I", 1) + inner + own
    return head + own


def line(positions, *, order="<", axes="", style="iso"):
    number = 2 + header_of(axes, style, None)
    flat = [value for position in positions for value in position]
    return struct.pack(order + f"BII{len(flat)}d", order == "<", number, len(positions), *flat)


def lines(members):
    return struct.pack("<BII", 1, 5, len(members)) + b"".join(members)


def header_of(axes, style, srid):
    if style == "iso":
        return {"": 0, "z": 1000, "m": 2000, "zm": 3000}[axes]
    flags = 0x80000000 * ("z" in axes) + 0x40000000 * ("m" in axes)
    return flags + 0x20000000 * (srid is not None)


def read_point(data):
    """x, y, z and m of a point; NaN for what isn't there."""
    nothing = [NAN] * 4
    if data is None or len(data) < 5:
        return nothing
    order = "<" if data[0] == 1 else ">"
    (kind,) = struct.unpack_from(order + "I", data, 1)
    plain = kind & 0x1FFFFFFF
    has_z = bool(kind & 0x80000000) or plain // 1000 in (1, 3)
    has_m = bool(kind & 0x40000000) or plain // 1000 in (2, 3)
    start = 9 if kind & 0x20000000 else 5
    if plain % 1000 == 4:
        if len(data) < start + 4 or struct.unpack_from(order + "I", data, start) != (1,):
            return nothing
        start += 9
    elif plain % 1000 != 1:
        return nothing
    names = "xy" + "z" * has_z + "m" * has_m
    if plain // 1000 > 3 or len(data) < start + 8 * len(names) or data[0] > 1:
        return nothing
    numbers = dict(
        zip(names, struct.unpack_from(f"{order}{len(names)}d", data, start), strict=True)
    )
    return [numbers.get(name, NAN) for name in "xyzm"]
