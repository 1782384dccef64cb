"""Lines between knots on a grid, as files, and their errors at the samples."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.experiments.peers.coders import CODERS, decode_varint, encode_varint
from gpszip.model import Track

__all__ = ["Knots", "Steps", "decode_file", "encode_file", "errors_of", "on_grid"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Steps:
    """Steps of the grid, in seconds and in metres, rounded to the four bytes of each in a file."""

    time: float
    position: float

    def __post_init__(self) -> None:
        for name in ("time", "position"):
            object.__setattr__(self, name, float(np.float32(getattr(self, name))))


@dataclass(frozen=True, eq=False)
class Knots:
    """One track as a line between knots.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds, increasing.
    positions : float64 array, shape (n, d)
        Metres.
    """

    times: Floats
    positions: Floats


def _rounded(knots: Knots, steps: Steps) -> tuple[float, Ints]:
    """Return the first time, and ticks and cells of the knots as a table.

    Of knots that share a tick, the first stays. The last one is not earlier than it was.
    """
    start = float(knots.times[0])
    since = (knots.times - start) / steps.time
    ticks = np.round(since).astype(np.int64)
    ticks[-1] = np.ceil(since[-1] - 1e-6)
    cells = np.round(knots.positions / steps.position).astype(np.int64)
    fresh = np.append(True, np.diff(ticks) > 0)
    return start, np.column_stack([ticks, cells])[fresh]


def on_grid(knots: Knots, steps: Steps) -> Knots:
    """Return the line that a file of these knots gives back.

    Examples
    --------
    >>> line = on_grid(Knots(np.array([5.0, 8.2]), np.array([[1.1], [3.9]])), Steps(1.0, 0.5))
    >>> line.times.tolist(), line.positions.tolist()
    ([5.0, 9.0], [[1.0], [4.0]])
    """
    start, table = _rounded(knots, steps)
    return Knots(*_placed(start, table, steps))


def _placed(start: float, table: NDArray[Any], steps: Steps) -> tuple[Floats, Floats]:
    """Return times and positions of ticks and cells."""
    return start + table[:, 0] * steps.time, table[:, 1:] * steps.position


def encode_file(lines: Sequence[Knots], steps: Steps, coder: str) -> bytes:
    """Return the bytes of all tracks: their starts, and the differences of their knots.

    Examples
    --------
    >>> line = Knots(np.array([5.0, 8.0]), np.array([[1.0, 2.0], [4.0, 6.0]]))
    >>> data = encode_file([line], Steps(0.5, 0.5), "bzip2")
    >>> (back,) = decode_file(data, "bzip2")
    >>> back.times.tolist(), back.positions.tolist()
    ([5.0, 8.0], [[1.0, 2.0], [4.0, 6.0]])
    """
    # The first knot of each track, exact in time.
    rounded = [_rounded(line, steps) for line in lines]
    columns = rounded[0][1].shape[1]
    head = struct.pack("<ff", steps.time, steps.position) + bytes([columns])
    head += encode_varint(len(lines))
    for start, table in rounded:
        head += struct.pack("<d", start) + encode_varint(len(table) - 1)
        head += b"".join(encode_varint(_fold(int(cell))) for cell in table[0, 1:])

    # The differences of all knots in one table.
    differences = np.concatenate([np.diff(table, axis=0) for _, table in rounded])
    return head + (CODERS[coder].encode(differences) if len(differences) else b"")


def decode_file(data: bytes, coder: str) -> list[Knots]:
    """Return the lines of a file."""
    # The first knot of each track.
    steps = Steps(*struct.unpack("<ff", data[:8]))
    columns, at = data[8], 9
    count, at = decode_varint(data, at)
    heads: list[tuple[float, int, list[int]]] = []
    for _ in range(count):
        (start,) = struct.unpack("<d", data[at : at + 8])
        rows, at = decode_varint(data, at + 8)
        first = [0]
        for _ in range(columns - 1):
            folded, at = decode_varint(data, at)
            first.append(_unfold(folded))
        heads.append((start, rows, first))

    # The others.
    total = sum(rows for _, rows, _ in heads)
    table = CODERS[coder].decode(data[at:], total, columns) if total else np.empty((0, columns))
    lines, begin = [], 0
    for start, rows, first in heads:
        knots = np.vstack([[first], table[begin : begin + rows]]).cumsum(axis=0)
        lines.append(Knots(*_placed(start, knots, steps)))
        begin += rows
    return lines


def errors_of(tracks: Sequence[Track], lines: Sequence[Knots]) -> Floats:
    """Return the distance in metres of each sample from the line at its time.

    Examples
    --------
    >>> track = Track("a", [0, 1, 2], [[0, 0], [1, 3], [2, 0]])
    >>> errors_of([track], [Knots(track.times[::2], track.positions[::2])]).tolist()
    [0.0, 3.0, 0.0]
    """
    distances = []
    for track, line in zip(tracks, lines, strict=True):
        found = np.column_stack(
            [np.interp(track.times, line.times, axis) for axis in line.positions.T]
        )
        distances.append(np.linalg.norm(found - track.positions, axis=1))
    return np.concatenate(distances)


def _fold(value: int) -> int:
    """Count integers without a sign: 0, -1, 1, -2, ..."""
    return 2 * value if value >= 0 else -2 * value - 1


def _unfold(value: int) -> int:
    return value // 2 if value % 2 == 0 else -(value + 1) // 2
