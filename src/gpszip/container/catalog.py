"""One track or one time range out of a large archive, reading only its end, its beginning and the group asked for."""

from __future__ import annotations

import os
from bisect import bisect_right
from dataclasses import dataclass, replace
from typing import BinaryIO

from gpszip.container.contents import Contents, Group, MapReference, find_contradiction
from gpszip.container.expansion import unpack_bz2
from gpszip.container.group_index import IndexEntry, read_end_mark, read_group, read_index
from gpszip.container.layout import (
    END_BYTES,
    HEAD_BYTES,
    Cursor,
    Form,
    Head,
    SectionKind,
    read_head,
)
from gpszip.container.names import read_names
from gpszip.container.reader import (
    StoredSection,
    from_bytes,
    layer_limit,
    read_fully,
    read_opening,
    read_section,
)
from gpszip.errors import CorruptArchiveError
from gpszip.model.grid import QuantisationGrid

__all__ = ["Catalog", "find_group", "find_groups", "open_catalog", "read_catalog_group"]


@dataclass(frozen=True)
class Catalog:
    """What there is in an archive and where, without the walks.

    Parameters
    ----------
    grid : Frame or None
        Where positions and times lie; None where a map kept elsewhere tells.
    ids : tuple of str or None
        Names of all tracks; None for one track that is called as the first of the map kept elsewhere.
    map : MapReference or None
        The map, where it is kept elsewhere.
    entries : tuple of Entry
        Where each group lies; empty if ``whole`` is there.
    layered : bool
        Whether payloads are wrapped.
    size : int
        Bytes of the file.
    whole : Contents or None
        Everything, in an archive of a single group, which has no index.
    """

    grid: QuantisationGrid | None
    ids: tuple[str, ...] | None
    map: MapReference | None
    entries: tuple[IndexEntry, ...]
    layered: bool
    size: int
    whole: Contents | None = None


def open_catalog(file: BinaryIO) -> Catalog:
    """Read what an archive holds from its two ends.

    Parameters
    ----------
    file : binary file
        With ``seek`` and ``read``. Of an archive of several groups no group is read.

    Raises
    ------
    CorruptArchiveError
        If what was read is wrong. Groups are checked when they are read.

    Examples
    --------
    >>> import io
    >>> open_catalog(io.BytesIO(bytes.fromhex("a75a820000807800000077616c6b73592744d4"))).ids
    ('0',)
    """
    size = file.seek(0, os.SEEK_END)
    head = read_head(_read(file, 0, min(size, HEAD_BYTES)))
    index_offset = 0
    if head.form is Form.SECTIONS and not head.low:
        index_offset = _index_offset(file, size)
    if not index_offset:
        contents = from_bytes(_read(file, 0, size))
        return Catalog(
            contents.grid, contents.ids, contents.map, (), bool(contents.layer), size, contents
        )
    entries = _entries(file, index_offset, size - END_BYTES)
    return _opened(_opening(file, entries[0].offset), entries, head, size)


def read_catalog_group(file: BinaryIO, catalog: Catalog, number: int) -> Group:
    """Read one group.

    Parameters
    ----------
    file : binary file
        The one that the catalog was read from.
    catalog : Catalog
        What :func:`open_catalog` returned.
    number : int
        Which group, see :func:`find_group` and :func:`find_groups`.

    Raises
    ------
    CorruptArchiveError
        If the group is damaged or another one than the index says.
    """
    if catalog.whole is not None:
        return catalog.whole.groups[number]
    line = catalog.entries[number]
    piece = _lone_piece(file, line.offset, line.offset + line.size, SectionKind.WALKS)
    group = read_group(piece.cursor())
    if (group.first_track, group.tracks, group.time_range) != (
        line.first_track,
        line.tracks,
        line.time_range,
    ):
        raise CorruptArchiveError("the index and the group differ", line.offset)
    if not catalog.layered:
        return group
    return replace(group, payload=unpack_bz2(group.payload, layer_limit(catalog.size), line.offset))


def find_group(catalog: Catalog, track: int) -> int:
    """Number of the group that holds a track, given the track's place in ``catalog.ids``."""
    count = 1 if catalog.ids is None else len(catalog.ids)
    if not 0 <= track < count:
        raise IndexError(f"track {track} of {count}")
    return max(bisect_right([line.first_track for line in catalog.entries], track) - 1, 0)


def find_groups(catalog: Catalog, first: int, last: int) -> tuple[int, ...]:
    """Numbers of the groups that may have knots in the time cells ``first`` to ``last``; those that tell no span may."""
    if catalog.whole is not None:
        return (0,)
    spans = enumerate(line.time_range for line in catalog.entries)
    return tuple(
        number for number, span in spans if span is None or (span[0] <= last and first <= span[1])
    )


def _read(file: BinaryIO, start: int, stop: int) -> bytes:
    file.seek(start)
    data = file.read(stop - start)
    if len(data) != stop - start:
        raise CorruptArchiveError("the file became shorter while it was read", start + len(data))
    return data


def _lone_piece(file: BinaryIO, start: int, stop: int, kind: SectionKind) -> StoredSection:
    cursor = Cursor(_read(file, start, stop), base=start)
    piece = read_section(cursor)
    cursor.expect_end(f"the section {kind.name.lower()}")
    if piece.kind != kind:
        raise CorruptArchiveError(
            f"a section of kind {piece.kind} where {kind.name.lower()} belongs", start
        )
    return piece


def _index_offset(file: BinaryIO, size: int) -> int:
    start = size - END_BYTES
    if start < HEAD_BYTES:
        raise CorruptArchiveError("the archive ends within its head", size)
    offset, _ = read_end_mark(_lone_piece(file, start, size, SectionKind.END).cursor())
    if offset and not HEAD_BYTES < offset < start:
        raise CorruptArchiveError(f"the index is said to lie at byte {offset}", start)
    return offset


def _entries(file: BinaryIO, start: int, stop: int) -> tuple[IndexEntry, ...]:
    entries = read_fully(_lone_piece(file, start, stop, SectionKind.INDEX), read_index)
    end = HEAD_BYTES
    for line in entries:
        if line.offset < end or line.offset + line.size > start:
            raise CorruptArchiveError(
                f"the index says that a group lies at byte {line.offset}", start
            )
        end = line.offset + line.size
    if not entries:
        raise CorruptArchiveError("an index of no groups", start)
    return entries


def _opening(file: BinaryIO, stop: int) -> list[StoredSection]:
    cursor = Cursor(_read(file, HEAD_BYTES, stop), base=HEAD_BYTES)
    found: list[StoredSection] = []
    while cursor.remaining:
        found.append(read_section(cursor))
    return found


def _opened(
    found: list[StoredSection], entries: tuple[IndexEntry, ...], head: Head, size: int
) -> Catalog:
    grid, reference, *_ = read_opening(found, head.version)
    ids = read_fully(found[1], lambda cursor: read_names(cursor, size))
    groups = tuple(Group(line.first_track, line.tracks, b"", line.time_range) for line in entries)
    wrong = find_contradiction(Contents(grid, ids, groups, reference))
    if wrong:
        raise CorruptArchiveError(wrong, HEAD_BYTES)
    return Catalog(grid, ids, reference, entries, bool(head.high), size)
