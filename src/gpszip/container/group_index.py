"""Headers of groups and the index at an archive's end, by which one group is found without the others."""

from __future__ import annotations

from dataclasses import dataclass

from gpszip.container.contents import Group
from gpszip.container.layout import Cursor, signed, varint

__all__ = ["Entry", "end_body", "entry", "group_body", "index_body", "read_end", "read_group", "read_index"]

_OFFSET_BYTES = 6
_DIGEST_BYTES = 4


@dataclass(frozen=True)
class Entry:
    """One line of the index.

    Parameters
    ----------
    offset, size : int
        Where the group's section begins in the archive, and how many bytes it takes with all its framing.
    first_track, tracks : int
        Which tracks it holds.
    span : (int, int) or None
        First and last time cell.
    """

    offset: int
    size: int
    first_track: int
    tracks: int
    span: tuple[int, int] | None


def group_body(group: Group, wrapped: bytes) -> bytes:
    """Body of a section of walks; ``wrapped`` is the payload as it lies in the file."""
    return varint(group.first_track) + varint(group.tracks) + _span_bytes(group.span) + wrapped


def read_group(cursor: Cursor) -> Group:
    """Undo :func:`group_body`; the payload is still wrapped."""
    first, tracks = cursor.varint("a group's first track"), cursor.varint("a group's number of tracks")
    span = _read_span(cursor)
    return Group(first, tracks, cursor.rest(), span)


def entry(group: Group, offset: int, size: int) -> Entry:
    """Line of the index for a group."""
    return Entry(offset, size, group.first_track, group.tracks, group.span)


def index_body(entries: tuple[Entry, ...]) -> bytes:
    """Body of the index: each offset as the distance from the one before."""
    out = [varint(len(entries))]
    before = 0
    for line in entries:
        out.append(varint(line.offset - before) + varint(line.size) + varint(line.tracks) + _span_bytes(line.span))
        before = line.offset
    return b"".join(out)


def read_index(cursor: Cursor) -> tuple[Entry, ...]:
    """Undo :func:`index_body`."""
    count = cursor.varint("the number of groups")
    if count > cursor.left:
        raise cursor.fail(f"an index of {count} groups in {cursor.left} bytes")
    entries: list[Entry] = []
    offset = track = 0
    for _ in range(count):
        offset += cursor.varint("a group's offset")
        size, tracks = cursor.varint("a group's size"), cursor.varint("a group's number of tracks")
        entries.append(Entry(offset, size, track, tracks, _read_span(cursor)))
        track += tracks
    cursor.finish("the index")
    return tuple(entries)


def end_body(index_offset: int, digest: bytes) -> bytes:
    """Body of the end mark: where the index lies (0 for none) and the checksum of all checksums."""
    return index_offset.to_bytes(_OFFSET_BYTES, "little") + digest


def read_end(cursor: Cursor) -> tuple[int, bytes]:
    """Undo :func:`end_body`."""
    offset = int.from_bytes(cursor.take(_OFFSET_BYTES, "the index's offset"), "little")
    digest = cursor.take(_DIGEST_BYTES, "the archive's checksum")
    cursor.finish("the end mark")
    return offset, digest


def _span_bytes(span: tuple[int, int] | None) -> bytes:
    return varint(0) if span is None else varint(span[1] - span[0] + 1) + signed(span[0])


def _read_span(cursor: Cursor) -> tuple[int, int] | None:
    length = cursor.varint("a group's time range")
    if not length:
        return None
    first = cursor.signed("a group's first cell")
    return first, first + length - 1
