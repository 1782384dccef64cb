"""Lines from well-known binary and text, many at once."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

__all__ = ["parse_wkb_lines", "parse_wkt_line"]

_HEADER_BYTES = 9  # byte order, kind, number of points
_LINE, _MULTI = 2, 5

_Lines = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], int]


def parse_wkb_lines(geometries: Any) -> _Lines:
    """Lines of an array of geometries; lines of a MultiLineString are lines of their own.

    Parameters
    ----------
    geometries : pyarrow.BinaryArray
        Well-known binary, little-endian; nulls are nothing.

    Returns
    -------
    points : float64 array, shape (N, 2)
        First two coordinates of all vertices.
    offsets : int64 array, shape (L + 1,)
        Vertices of line i are ``points[offsets[i]:offsets[i + 1]]``.
    rows : int64 array, shape (L,)
        Geometry to which each line belongs.
    others : int
        Number of geometries that are no lines.

    Examples
    --------
    >>> text = "0102000000020000000000000000000000000000000000000000000000000008400000000000001040"
    >>> parse_wkb_lines(pa.array([bytes.fromhex(text), None]))[0].tolist()
    [[0.0, 0.0], [3.0, 4.0]]
    """
    starts, data = _buffers(geometries)
    sizes = np.diff(starts)
    if len(sizes) and (sizes >= _HEADER_BYTES).all():
        heads = data[starts[:-1, None] + np.arange(_HEADER_BYTES)]
        if (heads[:, 0] == 1).all() and (heads[:, 1:5].copy().view("<u4") == _LINE).all():
            return _parse_plain_lines(starts, data, heads)
    return _parse_mixed(geometries)


def _buffers(geometries: Any) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    wide = geometries.cast(pa.large_binary())
    _, offsets, values = wide.buffers()
    starts = np.frombuffer(offsets, np.int64)[wide.offset : wide.offset + len(wide) + 1]
    return starts, np.frombuffer(values, np.uint8) if values is not None else np.empty(0, np.uint8)


def _parse_plain_lines(
    starts: NDArray[np.int64], data: NDArray[np.uint8], heads: NDArray[np.uint8]
) -> _Lines:
    """All of them are flat lines: what is no head is coordinates."""
    counts = heads[:, 5:9].copy().view("<u4")[:, 0].astype(np.int64)
    first, last = int(starts[0]), int(starts[-1])
    body = np.ones(last - first, np.bool_)
    body[(starts[:-1, None] - first + np.arange(_HEADER_BYTES)).ravel()] = False
    points = data[first:last][body].view("<f8").reshape(-1, 2)
    return points, np.append(0, np.cumsum(counts)), np.arange(len(counts)), 0


def _parse_mixed(geometries: Any) -> _Lines:
    pieces: list[NDArray[np.float64]] = []
    rows: list[int] = []
    others = 0
    for row, geometry in enumerate(geometries.to_pylist()):
        found = _parse(geometry, 0)[0] if geometry else []
        others += not found
        pieces += found
        rows += [row] * len(found)
    counts = [len(piece) for piece in pieces]
    points = np.concatenate(pieces) if pieces else np.empty((0, 2))
    return (
        points,
        np.append(0, np.cumsum(counts)).astype(np.int64),
        np.array(rows, np.int64),
        others,
    )


def _parse(data: bytes, at: int) -> tuple[list[NDArray[np.float64]], int]:
    order = "<" if data[at] == 1 else ">"
    kind, count = struct.unpack_from(order + "II", data, at + 1)
    width = 2 + (
        bool(kind & 0x80000000) + bool(kind & 0x40000000)
        or (0, 1, 1, 2)[kind % 0x20000000 // 1000 % 4]
    )
    plain, at = kind % 0x20000000 % 1000, at + _HEADER_BYTES
    if plain == _LINE:
        points = np.frombuffer(data, order + "f8", count * width, at).reshape(-1, width)[:, :2]
        return [points.astype(np.float64)], at + 8 * count * width
    lines: list[NDArray[np.float64]] = []
    if plain == _MULTI:
        for _ in range(count):
            found, at = _parse(data, at)
            lines += found
    return lines, at


def parse_wkt_line(text: str) -> Sequence[tuple[float, float]]:
    """Vertices of a ``LINESTRING``, or of a ``MULTILINESTRING`` that is one line cut at the antimeridian; none for anything else.

    Examples
    --------
    >>> parse_wkt_line("LINESTRING (1 2, 3.5 4)"), parse_wkt_line("POINT (1 2)")
    ([(1.0, 2.0), (3.5, 4.0)], [])
    >>> parse_wkt_line("MULTILINESTRING ((179 2, 180 3), (-180 3, -179 4))")
    [(179.0, 2.0), (180.0, 3.0), (-180.0, 3.0), (-179.0, 4.0)]
    """
    kind, _, rest = text.partition("(")
    if not kind.strip().upper().startswith(("LINESTRING", "MULTILINESTRING")):
        return []
    parts = [
        [vertex.strip("() ").split() for vertex in part.split(",")]
        for part in re.split(r"\)\s*,\s*\(", rest)
    ]
    try:
        lines = [[(float(vertex[0]), float(vertex[1])) for vertex in part] for part in parts]
    except (ValueError, IndexError):
        return []
    whole = all(_same_position(one[-1], other[0]) for one, other in pairwise(lines))
    return [vertex for line in lines for vertex in line] if whole else []


def _same_position(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[1] == other[1] and (one[0] - other[0]) % 360 == 0
