"""Headers of groups, and the index at an archive's end that finds one group without the others."""

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

#: Bytes of the index's offset in the end mark: archives are below 256 TiB.
_OFFSET_BYTES = 6

#: Bytes of the checksum of checksums.
_DIGEST_BYTES = 4


@dataclass(frozen=True)
class IndexEntry:
    """One entry of the index.

    Parameters
    ----------
    offset, size : int
        First byte of the group's section in the archive, and bytes of the section with its marker,
        kind, length and checksum.
    first_track, tracks : int
        Number of its first track, and how many tracks it holds.
    time_range : (int, int) or None
        First and last time step of its knots.
    """

    offset: int
    size: int
    first_track: int
    tracks: int
    time_range: tuple[int, int] | None


def encode_group(group: Group, wrapped: bytes) -> bytes:
    """Body of a section of walks; ``wrapped`` is the payload as it is stored."""
    return (
        encode_varint(group.first_track)
        + encode_varint(group.tracks)
        + _encode_time_range(group.time_range)
        + wrapped
    )


def read_group(cursor: Cursor) -> Group:
    """Undo :func:`encode_group`; the payload is still wrapped."""
    first_track = cursor.read_varint("a group's first track")
    tracks = cursor.read_varint("a group's number of tracks")
    time_range = _read_time_range(cursor)
    return Group(first_track, tracks, cursor.read_rest(), time_range)


def index_entry(group: Group, offset: int, size: int) -> IndexEntry:
    """Entry of the index for a group."""
    return IndexEntry(offset, size, group.first_track, group.tracks, group.time_range)


def encode_index(entries: tuple[IndexEntry, ...]) -> bytes:
    """Body of the index: each offset as the distance from the one before."""
    out = [encode_varint(len(entries))]
    before = 0
    # First tracks are not stored, as they are the sums of the numbers of tracks.
    for entry in entries:
        out.append(
            encode_varint(entry.offset - before)
            + encode_varint(entry.size)
            + encode_varint(entry.tracks)
            + _encode_time_range(entry.time_range)
        )
        before = entry.offset
    return b"".join(out)


def read_index(cursor: Cursor) -> tuple[IndexEntry, ...]:
    """Undo :func:`encode_index`."""
    count = cursor.read_varint("the number of groups")
    # Each entry takes a byte at least: a forged number must not ask for memory.
    if count > cursor.remaining:
        raise cursor.error(f"an index of {count} groups in {cursor.remaining} bytes")

    entries: list[IndexEntry] = []
    offset = first_track = 0
    for _ in range(count):
        offset += cursor.read_varint("a group's offset")
        size = cursor.read_varint("a group's size")
        tracks = cursor.read_varint("a group's number of tracks")
        entries.append(IndexEntry(offset, size, first_track, tracks, _read_time_range(cursor)))
        first_track += tracks
    cursor.expect_end("the index")
    return tuple(entries)


def encode_end_mark(index_offset: int, digest: bytes) -> bytes:
    """Body of the end mark: offset of the index (0 for none), and the checksum of all checksums."""
    return index_offset.to_bytes(_OFFSET_BYTES, "little") + digest


def read_end_mark(cursor: Cursor) -> tuple[int, bytes]:
    """Undo :func:`encode_end_mark`."""
    offset = int.from_bytes(cursor.read_bytes(_OFFSET_BYTES, "the index's offset"), "little")
    digest = cursor.read_bytes(_DIGEST_BYTES, "the archive's checksum")
    cursor.expect_end("the end mark")
    return offset, digest


def _encode_time_range(time_range: tuple[int, int] | None) -> bytes:
    """Number of time steps and the first one; a zero if there is no range."""
    if time_range is None:
        return encode_varint(0)
    first, last = time_range
    # A range has one time step at least, so that 0 can stand for no range.
    return encode_varint(last - first + 1) + encode_signed(first)


def _read_time_range(cursor: Cursor) -> tuple[int, int] | None:
    """Undo :func:`_encode_time_range`."""
    length = cursor.read_varint("a group's time range")
    if not length:
        return None
    first = cursor.read_signed("a group's first time step")
    return first, first + length - 1
