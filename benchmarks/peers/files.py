"""The files of the peers: a header, the starts of the tracks, and a table of differences."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Sequence

import numpy as np

from .curves import Curve, Steps
from .integers import CODERS, decode_varint, encode_varint, join, split
from .log import MILLISECONDS, Floats, Integers, Log

#: Columns of the tracks: start in milliseconds, first position, number of knots.
TRACK_COLUMNS = 4

#: A curve of a file: name of the track, times, x and y of its knots.
KnotsOfTrack = tuple[str, Floats, Floats, Floats]


def encode_file(log: Log, curve: Curve, coder: str) -> bytes:
    """The bytes of all tracks: those of their starts, and of the differences of their knots."""
    # A row for each track, and one for each knot but the first.
    firsts = curve.firsts[:-1]
    starts = np.round(log.starts * MILLISECONDS).astype(np.int64)
    counts = np.diff(curve.firsts)
    tracks = np.column_stack([starts, curve.x[firsts], curve.y[firsts], counts])
    knots = np.diff(np.column_stack([curve.ticks, curve.x, curve.y]), axis=0)
    knots = np.delete(knots, firsts[1:] - 1, axis=0)

    # Both tables behind the header.
    steps = struct.pack("<ff", curve.steps.time, curve.steps.position)
    head = bytes([list(CODERS).index(coder)]) + steps + encode_varint(len(log.names))
    parts = [encode_names(log.names), encode_tracks(tracks, coder)]
    return head + join(parts) + CODERS[coder].encode(knots)


def decode_file(data: bytes) -> list[KnotsOfTrack]:
    """The knots of all tracks."""
    # The header and the tracks.
    coder = list(CODERS)[data[0]]
    steps = Steps(*struct.unpack("<ff", data[1:9]))
    count, at = decode_varint(data, 9)
    names, track_rows = split(data[at:], 2)
    at += len(join([names, track_rows]))
    tracks = decode_tracks(track_rows, count, coder)

    # The knots.
    rows = int((tracks[:, 3] - 1).sum())
    knots = CODERS[coder].decode(data[at:], rows, 3)
    return [
        (name, *knots_of_track(track, differences, steps))
        for name, track, differences in zip(
            decode_names(names, count),
            tracks,
            np.split(knots, np.cumsum(tracks[:-1, 3] - 1)),
            strict=True,
        )
    ]


def knots_of_track(
    track: Integers, differences: Integers, steps: Steps
) -> tuple[Floats, Floats, Floats]:
    """Times and positions of a track of its first knot and the differences of the others."""
    ticks, x, y = np.vstack([[0, *track[1:3]], differences]).cumsum(axis=0).T
    return track[0] / MILLISECONDS + ticks * steps.time, x * steps.position, y * steps.position


def encode_tracks(tracks: Integers, coder: str) -> bytes:
    """The rows of all tracks: numbers of as few bytes as they need, unless coded arithmetically."""
    differences = np.diff(tracks, axis=0, prepend=0)
    if coder == "arithmetic":
        return CODERS[coder].encode(differences)
    folded = np.where(differences >= 0, 2 * differences, -2 * differences - 1)
    return zlib.compress(b"".join(map(encode_varint, folded.T.ravel().tolist())), 9)


def decode_tracks(data: bytes, count: int, coder: str) -> Integers:
    """The rows of all tracks."""
    if coder == "arithmetic":
        return CODERS[coder].decode(data, count, TRACK_COLUMNS).cumsum(axis=0)
    data, at, numbers = zlib.decompress(data), 0, []
    while at < len(data):
        folded, at = decode_varint(data, at)
        numbers.append(folded // 2 if folded % 2 == 0 else -(folded + 1) // 2)
    return np.array(numbers, np.int64).reshape(TRACK_COLUMNS, count).T.cumsum(axis=0)


def encode_names(names: Sequence[str]) -> bytes:
    """The first name, if the others follow by number; all of them, packed, where they don't."""
    if list(names) == follow(names[0], len(names)):
        return b"\0" + names[0].encode()
    return b"\1" + zlib.compress("\n".join(names).encode(), 9)


def decode_names(data: bytes, count: int) -> list[str]:
    if data[0] == 0:
        return follow(data[1:].decode(), count)
    return zlib.decompress(data[1:]).decode().split("\n")


def follow(name: str, count: int) -> list[str]:
    """Names that begin with this one, and whose number increases: bus-0, bus-1, ..."""
    stem, number = re.fullmatch(r"(.*?)(\d*)", name, re.DOTALL).groups()
    return [name, *(f"{stem}{int(number or 0) + i}" for i in range(1, count))]
