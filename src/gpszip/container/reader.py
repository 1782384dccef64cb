"""From the untrusted bytes of an archive to its contents.

Any contradiction is a CorruptArchiveError with the offset of the byte.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeVar, cast

from gpszip.container.contents import (
    DEFAULT_ID,
    MAP_HASH_BYTES,
    Contents,
    Group,
    MapReference,
    Section,
    find_contradiction,
)
from gpszip.container.error_bound_record import read_error_bound
from gpszip.container.expansion import unpack_bz2
from gpszip.container.grid_record import read_grid, read_short_grid
from gpszip.container.group_index import encode_index, index_entry, read_end_mark, read_group
from gpszip.container.layout import (
    CHECKSUM_BYTES,
    HEAD_BYTES,
    SECTION_MARKER,
    SMALL_LIMIT,
    Cursor,
    Form,
    Head,
    SectionKind,
    checksum,
    max_sections,
    read_head,
)
from gpszip.container.map_record import read_reference
from gpszip.container.names import read_names
from gpszip.errors import CorruptArchiveError, InputError
from gpszip.model.error_bound import ErrorBound
from gpszip.model.grid import QuantisationGrid

__all__ = [
    "LAYER_FREE",
    "LAYER_RATIO",
    "Opening",
    "StoredSection",
    "assemble_contents",
    "from_bytes",
    "layer_limit",
    "load",
    "open_file",
    "read_file",
    "read_fully",
    "read_opening",
    "read_section",
    "read_sections",
]

#: Compressed payloads of an archive expand to at most this many bytes, and so many more for each
#: byte of the file.
LAYER_FREE = 1 << 26
LAYER_RATIO = 16

T = TypeVar("T")

#: Kinds of which there is at most one section.
_UNIQUE_KINDS = frozenset(
    {
        SectionKind.GRID,
        SectionKind.NAMES,
        SectionKind.MAP,
        SectionKind.INDEX,
        SectionKind.ERROR_BOUND,
    }
)


@dataclass(frozen=True)
class StoredSection:
    """A section and its offset in the file.

    Parameters
    ----------
    kind : int
        What it holds.
    offset, size : int
        First byte and number of bytes with marker, kind, length and checksum.
    body : bytes
        What is inside.
    checksum : bytes
        Its own checksum; empty if it has none.
    body_offset : int
        First byte of the body.
    """

    kind: int
    offset: int
    size: int
    body: bytes
    checksum: bytes
    body_offset: int

    def cursor(self) -> Cursor:
        """Return a cursor at the start of the body."""
        return Cursor(self.body, base=self.body_offset)


class Opening(NamedTuple):
    """What the first sections of an archive hold beside the names."""

    grid: QuantisationGrid | None
    map: MapReference | None
    error_bound: ErrorBound | None
    sampling: int | None


def layer_limit(size: int) -> int:
    """Bytes to which the compressed payloads of an archive of this size may expand."""
    return LAYER_FREE + LAYER_RATIO * size


def from_bytes(data: bytes) -> Contents:
    """Read an archive and check all of it.

    Parameters
    ----------
    data : bytes
        A complete file.

    Raises
    ------
    CorruptArchiveError
        If any byte is wrong, missing or too many.

    Examples
    --------
    >>> from_bytes(bytes.fromhex("a75a820000807800000077616c6b73592744d4")).groups[0].payload
    b'walks'
    """
    head = read_head(data)
    if head.form is not Form.SECTIONS:
        return _read_compact(data, head)
    return assemble_contents(read_sections(data, head), head, len(data))


def load(path: str | os.PathLike[str]) -> Contents:
    """Read an archive from a file.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    CorruptArchiveError
        If it is no complete archive.
    """
    return from_bytes(read_file(path))


def read_file(path: str | os.PathLike[str]) -> bytes:
    """All bytes of a regular file, or an InputError in one line."""
    with open_file(path) as file:
        return file.read()


@contextmanager
def open_file(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a regular file without a buffer, to read it; any failure is an InputError in one line.

    A read may give fewer bytes than were asked for.
    """
    source = Path(path)
    try:
        if source.is_dir():
            raise InputError("is a folder, not an archive", path=source)
        # A pipe is refused before it is opened, since opening it would wait for a writer.
        if source.exists() and not source.is_file():
            raise InputError("is no regular file", path=source)
        with source.open("rb", buffering=0) as file:
            yield cast(BinaryIO, file)
    except FileNotFoundError:
        raise InputError("no such file", path=source) from None
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror or error}", path=source) from None


def read_sections(data: bytes, head: Head) -> list[StoredSection]:
    """Split an archive into its sections, and check every checksum.

    The end mark of a large archive is checked and left out.
    """
    # The low bits of the head are 1 for one checksum of all sections.
    if head.low:
        return _read_small_sections(data)
    cursor = Cursor(data, HEAD_BYTES)
    sections: list[StoredSection] = []
    while True:
        section = read_section(cursor)
        if section.kind == SectionKind.END:
            break
        sections.append(section)
        # Forged sections of a few bytes each must not ask for memory.
        if len(sections) > max_sections(len(data)):
            raise cursor.error("too many sections")
    _check_end(data, section, sections)
    cursor.expect_end("the archive")
    return sections


def read_section(cursor: Cursor) -> StoredSection:
    """Read one section of a large archive: marker, kind, length, body, checksum."""
    # Find the marker; an error is reported at the section's start.
    offset = cursor.offset
    if cursor.read_bytes(len(SECTION_MARKER), "a section's marker") != SECTION_MARKER:
        cursor.offset = offset
        raise cursor.error("no section begins here")

    # The checksum is that of kind, length and body.
    start = cursor.offset
    kind, body_offset, body = _read_kind_and_body(cursor)
    # A view saves a copy of the body.
    content = memoryview(cursor.data)[start : cursor.offset]
    stored = cursor.read_bytes(CHECKSUM_BYTES, "a section's checksum")
    if checksum(content) != stored:
        raise CorruptArchiveError(
            f"the checksum of a section of kind {kind} is wrong", cursor.base + offset
        )
    size = cursor.offset - offset
    return StoredSection(kind, cursor.base + offset, size, body, stored, body_offset)


def read_opening(sections: list[StoredSection], version: int) -> Opening:
    """Read the grid or the map, the error bound and the sampling of an archive.

    Parameters
    ----------
    sections : list of StoredSection
        The first sections of the archive, or all of them.
    version : int
        Version of the format.
    """
    kinds = [section.kind for section in sections[:2]]
    if kinds not in ([SectionKind.GRID, SectionKind.NAMES], [SectionKind.MAP, SectionKind.NAMES]):
        raise CorruptArchiveError(
            "an archive begins with its grid or its map, and its names", HEAD_BYTES
        )

    error_bound = sampling = None
    bound_section = _find_section(sections, SectionKind.ERROR_BOUND)
    if bound_section is not None:
        read_bound = partial(read_error_bound, version=version)
        error_bound, sampling = read_fully(bound_section, read_bound)
    if kinds[0] == SectionKind.MAP:
        return Opening(None, read_fully(sections[0], read_reference), error_bound, sampling)
    return Opening(read_fully(sections[0], read_grid), None, error_bound, sampling)


def assemble_contents(sections: list[StoredSection], head: Head, file_size: int) -> Contents:
    """Read the contents from all sections of an archive, each checked against the others."""
    # Read what precedes the walks: the opening sections, with the names of tracks.
    opening = read_opening(sections, head.version)
    _check_order(sections)
    ids = read_fully(sections[1], lambda cursor: read_names(cursor, file_size))

    # Walks, decompressed.
    walks = [section for section in sections if section.kind == SectionKind.WALKS]
    groups = tuple(read_group(section.cursor()) for section in walks)
    _check_index(sections, walks, groups)
    is_layered = bool(head.high)
    if is_layered:
        groups = _decompress(groups, walks, file_size)

    # Sections that the container does not look into.
    extras = tuple(
        Section(section.kind, section.body)
        for section in sections
        if section.kind not in _UNIQUE_KINDS | {SectionKind.WALKS}
    )
    contents = Contents(
        opening.grid,
        ids,
        groups,
        opening.map,
        extras,
        "bz2" if is_layered else None,
        opening.error_bound,
        opening.sampling,
        head.version,
    )
    return _checked(contents, sections[-1].offset)


def read_fully(section: StoredSection, read: Callable[[Cursor], T]) -> T:
    """Apply ``read`` to a section; refuse bytes that it leaves."""
    cursor = section.cursor()
    value = read(cursor)
    cursor.expect_end(f"a section of kind {section.kind}")
    return value


def _find_section(sections: list[StoredSection], kind: SectionKind) -> StoredSection | None:
    """The first section of a kind."""
    return next((section for section in sections if section.kind == kind), None)


def _read_compact(data: bytes, head: Head) -> Contents:
    """Read an archive of one group with one checksum."""
    # The checksum is that of all bytes before it.
    end = len(data) - CHECKSUM_BYTES
    if end < HEAD_BYTES:
        raise CorruptArchiveError("the archive ends within its head", len(data))
    _check_checksum(data, end)

    # Error bound; grid or map; names; the payload up to the checksum.
    cursor = Cursor(data, HEAD_BYTES, end)
    error_bound, sampling = read_error_bound(cursor, head.version)
    grid, reference = None, None
    ids: tuple[str, ...] | None
    # On a map, the head tells the refinements and whether there are names; otherwise it tells the
    # shape of the grid and whether its units are whole.
    if head.form is Form.ON_MAP:
        reference = MapReference(cursor.read_bytes(MAP_HASH_BYTES, "the map's hash"), head.low)
        ids = read_names(cursor, len(data)) if head.high else None
    else:
        grid = read_short_grid(cursor, head.low, bool(head.high))
        ids = (DEFAULT_ID,) if head.form is Form.LONE else read_names(cursor, len(data))
    group = Group(0, 1 if ids is None else len(ids), cursor.read_rest())
    contents = Contents(
        grid,
        ids,
        (group,),
        reference,
        error_bound=error_bound,
        sampling=sampling,
        version=head.version,
    )
    return _checked(contents, HEAD_BYTES)


def _checked(contents: Contents, offset: int) -> Contents:
    """Return the contents if they can be an archive."""
    contradiction = find_contradiction(contents)
    if contradiction:
        raise CorruptArchiveError(contradiction, offset)
    return contents


def _check_checksum(data: bytes, end: int) -> None:
    """Check an archive's only checksum, which begins at ``end``."""
    if checksum(memoryview(data)[:end]) != data[end:]:
        raise CorruptArchiveError(
            "the archive's checksum is wrong: bytes are missing or changed", end
        )


def _read_small_sections(data: bytes) -> list[StoredSection]:
    """Read the sections of a small archive: kind, length and body each, one checksum for all."""
    # Check size and checksum before anything is read.
    end = len(data) - CHECKSUM_BYTES
    if len(data) >= SMALL_LIMIT:
        raise CorruptArchiveError(
            f"an archive of {len(data)} bytes needs a checksum for each section", 2
        )
    if end < HEAD_BYTES:
        raise CorruptArchiveError(
            "the archive's checksum is wrong: bytes are missing or changed", max(end, 0)
        )
    _check_checksum(data, end)

    # Split the rest into sections.
    cursor = Cursor(data, HEAD_BYTES, end)
    sections: list[StoredSection] = []
    while cursor.remaining:
        offset = cursor.offset
        kind, body_offset, body = _read_kind_and_body(cursor)
        sections.append(StoredSection(kind, offset, cursor.offset - offset, body, b"", body_offset))
    return sections


def _read_kind_and_body(cursor: Cursor) -> tuple[int, int, bytes]:
    """Kind of a section, first byte of its body, and the body."""
    kind = cursor.read_byte("a section's kind")
    length = cursor.read_varint("a section's length")
    body_offset = cursor.base + cursor.offset
    return kind, body_offset, cursor.read_bytes(length, f"a section of kind {kind}")


def _check_end(data: bytes, end: StoredSection, sections: list[StoredSection]) -> None:
    """Check the end mark of a large archive: the checksum of checksums, the index's offset."""
    index_offset, digest = read_end_mark(end.cursor())
    checksums = b"".join(section.checksum for section in sections)
    # Sections of another archive have right checksums, too; only that of all checksums tells.
    if checksum(data[:HEAD_BYTES] + checksums) != digest:
        raise CorruptArchiveError("sections are missing, added or out of order", end.offset)
    index = _find_section(sections, SectionKind.INDEX)
    if index_offset != (0 if index is None else index.offset):
        raise CorruptArchiveError("the end mark points to no index", end.offset)


def _check_order(sections: list[StoredSection]) -> None:
    """Check that no section comes twice, or where it does not belong."""
    # Refuse reserved kinds, repeated sections of a unique kind, and a map beside a grid.
    kinds = [section.kind for section in sections]
    has_both = SectionKind.GRID in kinds and SectionKind.MAP in kinds
    for section in sections:
        if (
            section.kind in {0, SectionKind.END}
            or (section.kind in _UNIQUE_KINDS and kinds.count(section.kind) > 1)
            or (has_both and section.kind == SectionKind.MAP)
        ):
            raise CorruptArchiveError(
                f"a section of kind {section.kind} does not belong here", section.offset
            )

    # The error bound comes before walks, the index last.
    if SectionKind.ERROR_BOUND in kinds:
        before = kinds[: kinds.index(SectionKind.ERROR_BOUND)]
        if SectionKind.WALKS in before:
            raise CorruptArchiveError("the error bound comes after walks", HEAD_BYTES)
    if SectionKind.INDEX in kinds[:-1]:
        raise CorruptArchiveError(
            "the index is not the last section", sections[kinds.index(SectionKind.INDEX)].offset
        )


def _check_index(
    sections: list[StoredSection], walks: list[StoredSection], groups: tuple[Group, ...]
) -> None:
    """Check that the index, which several groups of a large archive must have, is theirs."""
    index = _find_section(sections, SectionKind.INDEX)
    if index is None:
        # Sections of a small archive have no checksums, and it needs no index.
        if len(groups) > 1 and walks[0].checksum:
            raise CorruptArchiveError("several groups and no index", walks[0].offset)
        return
    entries = tuple(
        index_entry(group, section.offset, section.size)
        for group, section in zip(groups, walks, strict=True)
    )
    # An index with the same entries has the same bytes, as every number has one form.
    if index.body != encode_index(entries):
        raise CorruptArchiveError("the index and the groups differ", index.offset)


def _decompress(
    groups: tuple[Group, ...], walks: list[StoredSection], file_size: int
) -> tuple[Group, ...]:
    """Decompress the payloads of all groups within one limit."""
    # One limit holds for all groups, as many groups might reach one each.
    remaining = layer_limit(file_size)
    decompressed: list[Group] = []
    for group, section in zip(groups, walks, strict=True):
        payload = unpack_bz2(group.payload, remaining, section.offset)
        remaining -= len(payload)
        decompressed.append(replace(group, payload=payload))
    return tuple(decompressed)
