"""Random access: one track or one time range of a large archive, without reading the rest.

:func:`open_contents` gives the :class:`Contents` of a file whose groups are read when they are
asked for. It reads the two ends of the file: the names of the tracks at its beginning, the index of
the groups at its end.
"""

from __future__ import annotations

import os
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any, BinaryIO, TypeAlias, overload

from gpszip.container.contents import (
    Contents,
    Group,
    MapReference,
    Section,
    StoredBytes,
    find_contradiction,
)
from gpszip.container.expansion import unpack_bz2
from gpszip.container.group_index import IndexEntry, read_end_mark, read_group, read_index
from gpszip.container.layout import (
    CHECKSUM_BYTES,
    END_BYTES,
    HEAD_BYTES,
    SECTION_MARKER,
    Cursor,
    Form,
    Head,
    SectionKind,
    max_sections,
    read_head,
)
from gpszip.container.names import read_names
from gpszip.container.reader import (
    StoredSection,
    from_bytes,
    layer_limit,
    open_file,
    read_fully,
    read_opening,
    read_section,
)
from gpszip.errors import CorruptArchiveError, InputError
from gpszip.model.error_bound import ErrorBound
from gpszip.model.grid import QuantisationGrid

__all__ = [
    "WHOLE_FILE_BYTES",
    "Catalog",
    "Opener",
    "SectionLocation",
    "StoredGroups",
    "find_group",
    "find_groups",
    "group_heads",
    "open_catalog",
    "open_contents",
    "path_opener",
    "read_catalog_group",
    "stored_size",
    "stream_opener",
]

#: Files up to this size are read at once, in a few milliseconds, and all of their checksums are
#: verified. It is about sixteen groups.
WHOLE_FILE_BYTES = 1 << 20

#: Bytes of marker, kind and length at the start of a section: the length takes at most ten.
_MAX_SECTION_HEAD = len(SECTION_MARKER) + 1 + 10

#: Kinds of sections at the start of an archive: its grid or its map, names, error bound.
_OPENING_KINDS = frozenset(
    {SectionKind.GRID, SectionKind.MAP, SectionKind.NAMES, SectionKind.ERROR_BOUND}
)

#: Opens the file of an archive for a moment; each use of it is a ``with`` block of its own.
Opener: TypeAlias = Callable[[], AbstractContextManager[BinaryIO]]


@dataclass(frozen=True)
class SectionLocation:
    """Offset of a section that is neither read yet nor in the index.

    Parameters
    ----------
    kind : int
        What it holds.
    offset, size : int
        First byte, and number of bytes with marker, kind, length and checksum.
    """

    kind: int
    offset: int
    size: int


@dataclass(frozen=True)
class Catalog:
    """What an archive holds and where, without the walks.

    Parameters
    ----------
    grid : QuantisationGrid or None
        Grid of positions and times; None where it is that of a known map.
    ids : tuple of str or None
        Ids of all tracks; None for one track with the id of the first track of a known map.
    map : MapReference or None
        The known map, where the walks lie on one.
    entries : tuple of IndexEntry
        Where each group lies; empty if there are ``contents``.
    layered : bool
        Whether payloads are compressed.
    size : int
        Bytes of the file.
    contents : Contents or None
        Everything, for an archive that was read at once: it has a single group, and no index.
    extras : tuple of SectionLocation
        Further sections, in their order.
    error_bound : ErrorBound or None
        Bound of the walks' error.
    sampling : int or None
        Index of the step size that is about the time between two samples of the log.
    version : int
        Version of the format.
    """

    grid: QuantisationGrid | None
    ids: tuple[str, ...] | None
    map: MapReference | None
    entries: tuple[IndexEntry, ...]
    layered: bool
    size: int
    contents: Contents | None = None
    extras: tuple[SectionLocation, ...] = ()
    error_bound: ErrorBound | None = None
    sampling: int | None = None
    version: int = 0


class StoredGroups(Sequence[Group]):
    """The groups of an archive in its file; each is read, and checked, when it is asked for.

    No group is kept in memory: a caller that needs one twice keeps it.

    Parameters
    ----------
    opener : Opener
        Opens the file.
    catalog : Catalog
        What was read from it.
    """

    def __init__(self, opener: Opener, catalog: Catalog) -> None:
        self._opener = opener
        self.catalog = catalog

    def __repr__(self) -> str:
        return f"StoredGroups({len(self)} in {self.catalog.size:,} bytes)"

    def __len__(self) -> int:
        return len(self.catalog.entries)

    @overload
    def __getitem__(self, number: int) -> Group: ...
    @overload
    def __getitem__(self, number: slice) -> tuple[Group, ...]: ...
    def __getitem__(self, number: int | slice) -> Group | tuple[Group, ...]:
        """Read one group, or a slice of them."""
        with self._opener() as file:
            if isinstance(number, int):
                return read_catalog_group(file, self.catalog, number)
            numbers = range(len(self))[number]
            return tuple(read_catalog_group(file, self.catalog, index) for index in numbers)

    def __reduce__(self) -> tuple[Callable[[Any], tuple[Group, ...]], tuple[list[Group]]]:
        # Another process or machine may not have the file.
        return tuple, (list(self),)


def path_opener(path: str | os.PathLike[str]) -> Opener:
    """Return an opener of a file, which refuses another file at its path.

    No file stays open in between, so that an archive can be replaced while it is in use, and
    nobody has to close it.
    """
    # Note which file this is; it is closed until it is needed again.
    with open_file(path) as file:
        known = _identity(file)

    @contextmanager
    def open_again() -> Iterator[BinaryIO]:
        with open_file(path) as file:
            if _identity(file) != known:
                raise InputError(
                    "the archive has changed since it was opened", path=path, remedy="open it again"
                )
            yield file

    return open_again


def stream_opener(file: BinaryIO) -> Opener:
    """Return an opener that shares one open file, which stays open, between threads.

    The file has ``seek`` and ``read``.
    """
    # One thread's seek must not come between the seek and the read of another one.
    lock = Lock()

    @contextmanager
    def share() -> Iterator[BinaryIO]:
        with lock:
            yield file

    return share


def open_contents(opener: Opener) -> Contents:
    """Read an archive; the groups and further sections of a large one are read on demand.

    Parameters
    ----------
    opener : Opener
        See :func:`path_opener` and :func:`stream_opener`.

    Raises
    ------
    CorruptArchiveError
        If what was read is wrong. Groups are checked when they are read.
    """
    # a small file is read at once, and so is one without an index
    with opener() as file:
        size = file.seek(0, os.SEEK_END)
        if size <= WHOLE_FILE_BYTES:
            return from_bytes(_read(file, 0, size))
        catalog = open_catalog(file)
    if catalog.contents is not None:
        return catalog.contents

    # Of a large file, groups and further sections are read on demand.
    extras = tuple(
        Section(location.kind, StoredBytes(_body_reader(opener, location), location.size))
        for location in catalog.extras
    )
    contents = Contents(
        catalog.grid,
        catalog.ids,
        StoredGroups(opener, catalog),
        catalog.map,
        extras,
        "bz2" if catalog.layered else None,
        catalog.error_bound,
        catalog.sampling,
        catalog.version,
    )

    # Check all but the payloads.
    contradiction = find_contradiction(replace(contents, groups=_group_heads(catalog.entries)))
    if contradiction:
        raise CorruptArchiveError(contradiction, HEAD_BYTES)
    return contents


def stored_size(contents: Contents) -> int | None:
    """Size of the file that contents are read from; None for new or changed contents."""
    groups = contents.groups
    if not isinstance(groups, StoredGroups):
        return None
    catalog = groups.catalog

    # The groups are those of the file; everything else may have been replaced.
    stored = (catalog.ids, catalog.error_bound, catalog.sampling, len(catalog.extras))
    current = (contents.ids, contents.error_bound, contents.sampling, len(contents.extras))
    same_extras = all(isinstance(extra.body, StoredBytes) for extra in contents.extras)
    same_layer = (contents.layer is not None) == catalog.layered
    return catalog.size if stored == current and same_extras and same_layer else None


def group_heads(contents: Contents) -> Sequence[Group | IndexEntry]:
    """Tracks and time range of each group, without reading the file."""
    groups = contents.groups
    return groups.catalog.entries if isinstance(groups, StoredGroups) else groups


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
    # The end mark, which has a fixed size, says where the index is.
    size = file.seek(0, os.SEEK_END)
    head = read_head(_read(file, 0, min(size, HEAD_BYTES)))
    index_offset = 0
    if head.form is Form.SECTIONS and not head.low:
        index_offset = _read_index_offset(file, size)

    # An archive of a single group has no index.
    if not index_offset:
        contents = from_bytes(_read(file, 0, size))
        return Catalog(
            contents.grid, contents.ids, contents.map, (), bool(contents.layer), size, contents
        )

    # The opening sections lie before the first group.
    entries = _read_entries(file, index_offset, size - END_BYTES)
    extras = _find_extras(file, entries, index_offset, size)
    return _build_catalog(_read_sections(file, entries[0].offset), entries, head, size, extras)


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
    # An archive that was read at once has its group in memory; otherwise the index says where
    # the section of the group is.
    if catalog.contents is not None:
        return catalog.contents.groups[number]
    entry = catalog.entries[number]
    section = _read_one_section(file, entry.offset, entry.offset + entry.size, SectionKind.WALKS)
    group = read_group(section.cursor())

    # The checksum is right; the head must say what the index says.
    if (group.first_track, group.tracks, group.time_range) != (
        entry.first_track,
        entry.tracks,
        entry.time_range,
    ):
        raise CorruptArchiveError("the index and the group differ", entry.offset)
    if not catalog.layered:
        return group
    limit = layer_limit(catalog.size)
    return replace(group, payload=unpack_bz2(group.payload, limit, entry.offset))


def find_group(catalog: Catalog, track: int) -> int:
    """Number of the group that holds a track, given the track's number in ``catalog.ids``."""
    count = 1 if catalog.ids is None else len(catalog.ids)
    if not 0 <= track < count:
        raise IndexError(f"track {track} of {count}")
    # The last group that begins at this track or before it.
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


def _identity(file: BinaryIO) -> tuple[int, int, int, int]:
    """Numbers that differ between files, and change when a file changes."""
    # A new file may get the inode of a deleted one: size and time tell them apart.
    status = os.fstat(file.fileno())
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns


def _body_reader(opener: Opener, location: SectionLocation) -> Callable[[], bytes]:
    """Return a function that reads the body of a section."""

    def read_body() -> bytes:
        with opener() as file:
            stop = location.offset + location.size
            return _read_one_section(file, location.offset, stop, location.kind).body

    return read_body


def _read(file: BinaryIO, start: int, stop: int) -> bytes:
    """Read the bytes from ``start`` to before ``stop``."""
    file.seek(start)
    data = file.read(stop - start)

    # An unbuffered file may give fewer bytes than were asked for, and none at its end.
    while len(data) < stop - start:
        more = file.read(stop - start - len(data))
        if not more:
            raise CorruptArchiveError(
                "the file became shorter while it was read", start + len(data)
            )
        data += more
    return data


def _read_one_section(file: BinaryIO, start: int, stop: int, kind: int) -> StoredSection:
    """Read a section of a kind that takes all bytes from ``start`` to before ``stop``."""
    cursor = Cursor(_read(file, start, stop), base=start)
    section = read_section(cursor)
    cursor.expect_end(f"the section of kind {kind}")
    if section.kind != kind:
        raise CorruptArchiveError(
            f"a section of kind {section.kind} where one of kind {kind} belongs", start
        )
    return section


def _read_index_offset(file: BinaryIO, size: int) -> int:
    """Offset of the index from the end mark; 0 if there is none."""
    start = size - END_BYTES
    if start < HEAD_BYTES:
        raise CorruptArchiveError("the archive ends within its head", size)
    offset, _ = read_end_mark(_read_one_section(file, start, size, SectionKind.END).cursor())
    # An offset of 0 says that there is no index.
    if offset and not HEAD_BYTES < offset < start:
        raise CorruptArchiveError(f"the end mark puts the index at byte {offset}", start)
    return offset


def _read_entries(file: BinaryIO, start: int, stop: int) -> tuple[IndexEntry, ...]:
    """Read the index, whose groups must lie before it, one after the other."""
    entries = read_fully(_read_one_section(file, start, stop, SectionKind.INDEX), read_index)
    end = HEAD_BYTES
    # Groups that overlap would let a few bytes stand for many groups.
    for entry in entries:
        if entry.offset < end or entry.offset + entry.size > start:
            raise CorruptArchiveError(f"the index puts a group at byte {entry.offset}", start)
        end = entry.offset + entry.size
    if not entries:
        raise CorruptArchiveError("an index of no groups", start)
    return entries


def _read_sections(file: BinaryIO, stop: int) -> list[StoredSection]:
    """Read all sections from the head to before ``stop``."""
    cursor = Cursor(_read(file, HEAD_BYTES, stop), base=HEAD_BYTES)
    sections: list[StoredSection] = []
    while cursor.remaining:
        sections.append(read_section(cursor))
    return sections


def _find_extras(
    file: BinaryIO, entries: tuple[IndexEntry, ...], index_offset: int, size: int
) -> tuple[SectionLocation, ...]:
    """Find the sections that are no groups, by their lengths alone: their bodies are not read."""
    # What lies before the first group, between two groups, and after the last one.
    begins = [HEAD_BYTES, *(entry.offset + entry.size for entry in entries)]
    ends = [*(entry.offset for entry in entries), index_offset]
    extras: list[SectionLocation] = []
    for begin, end in zip(begins, ends, strict=True):
        offset = begin
        while offset < end:
            location = _section_at(file, offset, end)
            if begin != HEAD_BYTES or location.kind not in _OPENING_KINDS:
                extras.append(location)
            offset += location.size
            if len(extras) > max_sections(size):
                raise CorruptArchiveError("too many sections", offset)
    return tuple(extras)


def _section_at(file: BinaryIO, offset: int, end: int) -> SectionLocation:
    """Locate a section from its first bytes; it must end at ``end`` or before."""
    # Close to the end, there may be fewer bytes than the longest head takes.
    cursor = Cursor(_read(file, offset, min(offset + _MAX_SECTION_HEAD, end)), base=offset)
    if cursor.read_bytes(len(SECTION_MARKER), "a section's marker") != SECTION_MARKER:
        raise CorruptArchiveError("no section begins here", offset)
    kind = cursor.read_byte("a section's kind")
    length = cursor.read_varint("a section's length")
    # The cursor has passed marker, kind and length.
    size = cursor.offset + length + CHECKSUM_BYTES
    if offset + size > end:
        raise CorruptArchiveError(f"a section of kind {kind} takes {size} bytes", offset)
    return SectionLocation(kind, offset, size)


def _group_heads(entries: tuple[IndexEntry, ...]) -> tuple[Group, ...]:
    """Groups as the index knows them, without their payloads."""
    return tuple(Group(entry.first_track, entry.tracks, b"", entry.time_range) for entry in entries)


def _build_catalog(
    opening: list[StoredSection],
    entries: tuple[IndexEntry, ...],
    head: Head,
    size: int,
    extras: tuple[SectionLocation, ...],
) -> Catalog:
    """Read the opening sections, and check that the names agree with the index."""
    # Check what precedes the walks against the groups' heads, which the index repeats.
    grid, reference, error_bound, sampling = read_opening(opening, head.version)
    ids = read_fully(opening[1], lambda cursor: read_names(cursor, size))
    contradiction = find_contradiction(Contents(grid, ids, _group_heads(entries), reference))
    if contradiction:
        raise CorruptArchiveError(contradiction, HEAD_BYTES)
    return Catalog(
        grid,
        ids,
        reference,
        entries,
        bool(head.high),
        size,
        extras=extras,
        error_bound=error_bound,
        sampling=sampling,
        version=head.version,
    )
