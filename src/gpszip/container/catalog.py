"""One track or one time range out of a large archive.

Only the end of the file, its beginning and the group that is asked for are read.
"""

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
    """What an archive holds and where, without the walks.

    Parameters
    ----------
    grid : QuantisationGrid or None
        Grid of positions and times; None where it is that of a map kept elsewhere.
    ids : tuple of str or None
        Ids of all tracks; None for one track with the id of the first track of a map that is kept
        elsewhere.
    map : MapReference or None
        The map, where it is kept elsewhere.
    entries : tuple of IndexEntry
        Where each group lies; empty if there are ``contents``.
    layered : bool
        Whether payloads are compressed.
    size : int
        Bytes of the file.
    contents : Contents or None
        Everything, in an archive of a single group, which has no index.
    """

    grid: QuantisationGrid | None
    ids: tuple[str, ...] | None
    map: MapReference | None
    entries: tuple[IndexEntry, ...]
    layered: bool
    size: int
    contents: Contents | None = None


def open_catalog(file: BinaryIO) -> Catalog:
    """Read what an archive holds from its beginning and its end.

    Parameters
    ----------
    file : binary file
        With ``seek`` and ``read``. Of an archive of several groups, no group is read.

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
    # the end mark of a large archive says where the index is
    size = file.seek(0, os.SEEK_END)
    head = read_head(_read(file, 0, min(size, HEAD_BYTES)))
    index_offset = 0
    if head.form is Form.SECTIONS and not head.low:
        index_offset = _read_index_offset(file, size)

    # without an index, there is one group
    if not index_offset:
        contents = from_bytes(_read(file, 0, size))
        return Catalog(
            contents.grid, contents.ids, contents.map, (), bool(contents.layer), size, contents
        )

    # the index says where the first group begins, and with it what comes before
    entries = _read_entries(file, index_offset, size - END_BYTES)
    sections = _read_opening_sections(file, entries[0].offset)
    opening = read_opening(sections, head.version)
    ids = read_fully(sections[1], lambda cursor: read_names(cursor, size))
    groups = tuple(
        Group(entry.first_track, entry.tracks, b"", entry.time_range) for entry in entries
    )
    contradiction = find_contradiction(Contents(opening.grid, ids, groups, opening.map))
    if contradiction:
        raise CorruptArchiveError(contradiction, HEAD_BYTES)
    return Catalog(opening.grid, ids, opening.map, entries, bool(head.high), size)


def read_catalog_group(file: BinaryIO, catalog: Catalog, number: int) -> Group:
    """Read one group.

    Parameters
    ----------
    file : binary file
        The one that the catalog was read from.
    catalog : Catalog
        The result of :func:`open_catalog`.
    number : int
        Number of the group, see :func:`find_group` and :func:`find_groups`.

    Raises
    ------
    CorruptArchiveError
        If the group is damaged or another one than the index says.
    """
    if catalog.contents is not None:
        return catalog.contents.groups[number]

    # the group must be the one of the index
    entry = catalog.entries[number]
    section = _read_one_section(file, entry.offset, entry.offset + entry.size, SectionKind.WALKS)
    group = read_group(section.cursor())
    if (group.first_track, group.tracks, group.time_range) != (
        entry.first_track,
        entry.tracks,
        entry.time_range,
    ):
        raise CorruptArchiveError("the index and the group differ", entry.offset)
    if not catalog.layered:
        return group
    payload = unpack_bz2(group.payload, layer_limit(catalog.size), entry.offset)
    return replace(group, payload=payload)


def find_group(catalog: Catalog, track: int) -> int:
    """Number of the group that holds a track, given the track's index in ``catalog.ids``."""
    count = 1 if catalog.ids is None else len(catalog.ids)
    if not 0 <= track < count:
        raise IndexError(f"track {track} of {count}")
    return max(bisect_right([entry.first_track for entry in catalog.entries], track) - 1, 0)


def find_groups(catalog: Catalog, first: int, last: int) -> tuple[int, ...]:
    """Numbers of the groups that may have knots in the time steps ``first`` to ``last``.

    A group without a time range may have knots at any time.
    """
    if catalog.contents is not None:
        return (0,)
    ranges = enumerate(entry.time_range for entry in catalog.entries)
    return tuple(
        number
        for number, time_range in ranges
        if time_range is None or (time_range[0] <= last and first <= time_range[1])
    )


def _read(file: BinaryIO, start: int, stop: int) -> bytes:
    """Read the bytes from ``start`` to before ``stop``."""
    file.seek(start)
    data = file.read(stop - start)
    if len(data) != stop - start:
        raise CorruptArchiveError("the file became shorter while it was read", start + len(data))
    return data


def _read_one_section(file: BinaryIO, start: int, stop: int, kind: SectionKind) -> StoredSection:
    """Read a section of a kind that takes all bytes from ``start`` to before ``stop``."""
    cursor = Cursor(_read(file, start, stop), base=start)
    section = read_section(cursor)
    cursor.expect_end(f"the section {kind.name.lower()}")
    if section.kind != kind:
        raise CorruptArchiveError(
            f"a section of kind {section.kind} where {kind.name.lower()} belongs", start
        )
    return section


def _read_index_offset(file: BinaryIO, size: int) -> int:
    """Offset of the index from the end mark; 0 if there is none."""
    start = size - END_BYTES
    if start < HEAD_BYTES:
        raise CorruptArchiveError("the archive ends within its head", size)
    offset, _ = read_end_mark(_read_one_section(file, start, size, SectionKind.END).cursor())
    if offset and not HEAD_BYTES < offset < start:
        raise CorruptArchiveError(f"the end mark puts the index at byte {offset}", start)
    return offset


def _read_entries(file: BinaryIO, start: int, stop: int) -> tuple[IndexEntry, ...]:
    """Read the index, whose groups must lie before it, one after the other."""
    entries = read_fully(_read_one_section(file, start, stop, SectionKind.INDEX), read_index)
    end = HEAD_BYTES
    for entry in entries:
        if entry.offset < end or entry.offset + entry.size > start:
            raise CorruptArchiveError(f"the index puts a group at byte {entry.offset}", start)
        end = entry.offset + entry.size
    if not entries:
        raise CorruptArchiveError("an index of no groups", start)
    return entries


def _read_opening_sections(file: BinaryIO, stop: int) -> list[StoredSection]:
    """Read the sections before the first group, which begins at ``stop``."""
    cursor = Cursor(_read(file, HEAD_BYTES, stop), base=HEAD_BYTES)
    sections: list[StoredSection] = []
    while cursor.remaining:
        sections.append(read_section(cursor))
    return sections
