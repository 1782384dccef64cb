"""Headers of groups and the index at an archive's end, by which one group is found without the others."""

from __future__ import annotations

from dataclasses import dataclass

from gpszip.container.contents import Group
from gpszip.container.layout import Cursor, encode_signed, encode_varint

__all__ = [
    "IndexEntry",
    "encode_end_mark",
    "encode_group",
    "encode_index",
    "index_entry",
    "read_end_mark",
    "read_group",
    "read_index",
]

_OFFSET_BYTES = 6
_DIGEST_BYTES = 4


@dataclass(frozen=True)
class IndexEntry:
    """One line of the index.

    Parameters
    ----------
    offset, size : int
        Where the group's section begins in the archive, and how many bytes it takes with all its framing.
    first_track, tracks : int
        Which tracks it holds.
    time_range : (int, int) or None
        First and last time cell.
    """

    offset: int
    size: int
    first_track: int
    tracks: int
    time_range: tuple[int, int] | None


def encode_group(group: Group, wrapped: bytes) -> bytes:
    """Body of a section of walks; ``wrapped`` is the payload as it lies in the file."""
    return (
        encode_varint(group.first_track)
        + encode_varint(group.tracks)
        + _span_bytes(group.time_range)
        + wrapped
    )


def read_group(cursor: Cursor) -> Group:
    """Undo :func:`encode_group`; the payload is still wrapped."""
    first, tracks = (
        cursor.read_varint("a group's first track"),
        cursor.read_varint("a group's number of tracks"),
    )
    span = _read_span(cursor)
    return Group(first, tracks, cursor.read_rest(), span)


def index_entry(group: Group, offset: int, size: int) -> IndexEntry:
    """Line of the index for a group."""
    return IndexEntry(offset, size, group.first_track, group.tracks, group.time_range)


def encode_index(entries: tuple[IndexEntry, ...]) -> bytes:
    """Body of the index: each offset as the distance from the one before."""
    out = [encode_varint(len(entries))]
    before = 0
    for line in entries:
        out.append(
            encode_varint(line.offset - before)
            + encode_varint(line.size)
            + encode_varint(line.tracks)
            + _span_bytes(line.time_range)
        )
        before = line.offset
    return b"".join(out)


def read_index(cursor: Cursor) -> tuple[IndexEntry, ...]:
    """Undo :func:`encode_index`."""
    count = cursor.read_varint("the number of groups")
    if count > cursor.remaining:
        raise cursor.error(f"an index of {count} groups in {cursor.remaining} bytes")
    entries: list[IndexEntry] = []
    offset = track = 0
    for _ in range(count):
        offset += cursor.read_varint("a group's offset")
        size, tracks = (
            cursor.read_varint("a group's size"),
            cursor.read_varint("a group's number of tracks"),
        )
        entries.append(IndexEntry(offset, size, track, tracks, _read_span(cursor)))
        track += tracks
    cursor.expect_end("the index")
    return tuple(entries)


def encode_end_mark(index_offset: int, digest: bytes) -> bytes:
    """Body of the end mark: where the index lies (0 for none) and the checksum of all checksums."""
    return index_offset.to_bytes(_OFFSET_BYTES, "little") + digest


def read_end_mark(cursor: Cursor) -> tuple[int, bytes]:
    """Undo :func:`encode_end_mark`."""
    offset = int.from_bytes(cursor.read_bytes(_OFFSET_BYTES, "the index's offset"), "little")
    digest = cursor.read_bytes(_DIGEST_BYTES, "the archive's checksum")
    cursor.expect_end("the end mark")
    return offset, digest


def _span_bytes(span: tuple[int, int] | None) -> bytes:
    return (
        encode_varint(0)
        if span is None
        else encode_varint(span[1] - span[0] + 1) + encode_signed(span[0])
    )


def _read_span(cursor: Cursor) -> tuple[int, int] | None:
    length = cursor.read_varint("a group's time range")
    if not length:
        return None
    first = cursor.read_signed("a group's first cell")
    return first, first + length - 1
