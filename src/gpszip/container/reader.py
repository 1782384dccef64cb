"""From the untrusted bytes of an archive to its contents; anything wrong is a CorruptArchiveError with its offset."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import BinaryIO, TypeVar, cast

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

#: All layered payloads of an archive expand to at most this many bytes, and so many for each byte of the file.
LAYER_FREE = 1 << 26
LAYER_RATIO = 16

T = TypeVar("T")

#: Sections of which there is at most one, and what they are about.
_ONCE = {
    SectionKind.FRAME,
    SectionKind.NAMES,
    SectionKind.MAP,
    SectionKind.INDEX,
    SectionKind.PROMISE,
}


@dataclass(frozen=True)
class StoredSection:
    """A section where it lies in the bytes.

    Parameters
    ----------
    kind : int
        What it holds.
    offset, size : int
        First byte and number of bytes with all framing.
    body : bytes
        What is inside.
    checksum : bytes
        Its own checksum; empty where it has none.
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
        """The body, to read it."""
        return Cursor(self.body, base=self.body_offset)


def layer_limit(size: int) -> int:
    """Bytes to which the layers of an archive of this size may expand."""
    return LAYER_FREE + LAYER_RATIO * size


def from_bytes(data: bytes) -> Contents:
    """Read a whole archive and check all of it.

    Parameters
    ----------
    data : bytes
        A whole file.

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
    found = read_sections(data, head)
    return assemble_contents(found, head, len(data))


def load(path: str | os.PathLike[str]) -> Contents:
    """Read an archive from a file.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    CorruptArchiveError
        If it is no whole archive.
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
        if source.exists() and not source.is_file():
            raise InputError("is no regular file", path=source)
        with source.open("rb", buffering=0) as file:
            yield cast(BinaryIO, file)
    except FileNotFoundError:
        raise InputError("no such file", path=source) from None
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror or error}", path=source) from None


def read_sections(data: bytes, head: Head) -> list[StoredSection]:
    """Cut an archive of sections into them, checking every checksum; the end mark is checked and left out."""
    if head.low:
        return _small_pieces(data)
    cursor = Cursor(data, HEAD_BYTES)
    found: list[StoredSection] = []
    while True:
        piece = read_section(cursor)
        if piece.kind == SectionKind.END:
            break
        found.append(piece)
        if len(found) > max_sections(len(data)):
            raise cursor.error("too many sections")
    _check_end(data, piece, found)
    cursor.expect_end("the archive")
    return found


def read_section(cursor: Cursor) -> StoredSection:
    """Read one section of a large archive: marker, kind, length, body, checksum."""
    offset = cursor.offset
    if cursor.read_bytes(len(SECTION_MARKER), "a section's marker") != SECTION_MARKER:
        cursor.offset = offset
        raise cursor.error("no section begins here")
    start = cursor.offset
    kind, body_offset, body = _kind_and_body(cursor)
    content = memoryview(cursor.data)[start : cursor.offset]
    seal = cursor.read_bytes(CHECKSUM_BYTES, "a section's checksum")
    if checksum(content) != seal:
        raise CorruptArchiveError(
            f"the checksum of a section of kind {kind} is wrong", cursor.base + offset
        )
    return StoredSection(
        kind, cursor.base + offset, cursor.offset - offset, body, seal, body_offset
    )


def read_opening(
    found: list[StoredSection], version: int
) -> tuple[QuantisationGrid | None, MapReference | None, ErrorBound | None, int | None]:
    """Where an archive lies, or on which map, what it promises, and how its log was sampled."""
    kinds = [piece.kind for piece in found[:2]]
    if kinds not in ([SectionKind.FRAME, SectionKind.NAMES], [SectionKind.MAP, SectionKind.NAMES]):
        raise CorruptArchiveError(
            "an archive begins with its frame or its map, and its names", HEAD_BYTES
        )
    said = next(
        (
            read_fully(piece, partial(read_error_bound, version=version))
            for piece in found
            if piece.kind == SectionKind.PROMISE
        ),
        (None, None),
    )
    if kinds[0] == SectionKind.MAP:
        return None, read_fully(found[0], read_reference), *said
    return read_fully(found[0], read_grid), None, *said


def assemble_contents(found: list[StoredSection], head: Head, file_size: int) -> Contents:
    """Contents from the sections of an archive, each checked against the others."""
    grid, reference, error_bound, sampling = read_opening(found, head.version)
    _check_order(found)
    ids = read_fully(found[1], lambda cursor: read_names(cursor, file_size))
    layered = bool(head.high)
    walks = [piece for piece in found if piece.kind == SectionKind.WALKS]
    groups = tuple(read_group(piece.cursor()) for piece in walks)
    _check_index(found, walks, groups)
    contents = Contents(
        grid,
        ids,
        _unwrapped(groups, walks, file_size) if layered else groups,
        reference,
        tuple(
            Section(piece.kind, piece.body)
            for piece in found
            if piece.kind not in {*_ONCE, SectionKind.WALKS}
        ),
        "bz2" if layered else None,
        error_bound,
        sampling,
        head.version,
    )
    return _believed(contents, found[-1].offset)


def read_fully(piece: StoredSection, read: Callable[[Cursor], T]) -> T:
    """What ``read`` makes of a section, all of it."""
    cursor = piece.cursor()
    value = read(cursor)
    cursor.expect_end(f"a section of kind {piece.kind}")
    return value


def _read_compact(data: bytes, head: Head) -> Contents:
    end = len(data) - CHECKSUM_BYTES
    if end < HEAD_BYTES:
        raise CorruptArchiveError("the archive ends within its head", len(data))
    if checksum(memoryview(data)[:end]) != data[end:]:
        raise CorruptArchiveError(
            "the archive's checksum is wrong: bytes are missing or changed", end
        )
    cursor = Cursor(data, HEAD_BYTES, end)
    error_bound, sampling = read_error_bound(cursor, head.version)
    if head.form is Form.ON_MAP:
        reference = MapReference(cursor.read_bytes(MAP_HASH_BYTES, "the map's hash"), head.low)
        own = read_names(cursor, len(data)) if head.high else None
        group = Group(0, 1 if own is None else len(own), cursor.read_rest())
        return _believed(
            Contents(
                None,
                own,
                (group,),
                reference,
                error_bound=error_bound,
                sampling=sampling,
                version=head.version,
            ),
            HEAD_BYTES,
        )
    grid = read_short_grid(cursor, head.low, bool(head.high))
    ids = (DEFAULT_ID,) if head.form is Form.LONE else read_names(cursor, len(data))
    group = Group(0, len(ids), cursor.read_rest())
    return _believed(
        Contents(
            grid, ids, (group,), error_bound=error_bound, sampling=sampling, version=head.version
        ),
        HEAD_BYTES,
    )


def _believed(contents: Contents, offset: int) -> Contents:
    wrong = find_contradiction(contents)
    if wrong:
        raise CorruptArchiveError(wrong, offset)
    return contents


def _small_pieces(data: bytes) -> list[StoredSection]:
    end = len(data) - CHECKSUM_BYTES
    if len(data) >= SMALL_LIMIT:
        raise CorruptArchiveError(
            f"an archive of {len(data)} bytes needs a checksum for each section", 2
        )
    if end < HEAD_BYTES or checksum(memoryview(data)[:end]) != data[end:]:
        raise CorruptArchiveError(
            "the archive's checksum is wrong: bytes are missing or changed", max(end, 0)
        )
    cursor = Cursor(data, HEAD_BYTES, end)
    found: list[StoredSection] = []
    while cursor.remaining:
        offset = cursor.offset
        kind, body_offset, body = _kind_and_body(cursor)
        found.append(StoredSection(kind, offset, cursor.offset - offset, body, b"", body_offset))
    return found


def _kind_and_body(cursor: Cursor) -> tuple[int, int, bytes]:
    kind = cursor.read_byte("a section's kind")
    length = cursor.read_varint("a section's length")
    body_offset = cursor.base + cursor.offset
    return kind, body_offset, cursor.read_bytes(length, f"a section of kind {kind}")


def _check_end(data: bytes, end: StoredSection, found: list[StoredSection]) -> None:
    index_offset, digest = read_end_mark(end.cursor())
    if checksum(data[:HEAD_BYTES] + b"".join(piece.checksum for piece in found)) != digest:
        raise CorruptArchiveError("sections are missing, added or out of order", end.offset)
    if index_offset != next(
        (piece.offset for piece in found if piece.kind == SectionKind.INDEX), 0
    ):
        raise CorruptArchiveError("the end mark points to no index", end.offset)


def _check_order(found: list[StoredSection]) -> None:
    kinds = [piece.kind for piece in found]
    both = SectionKind.FRAME in kinds and SectionKind.MAP in kinds
    for piece in found:
        if (
            piece.kind in {0, SectionKind.END}
            or (piece.kind in _ONCE and kinds.count(piece.kind) > 1)
            or (both and piece.kind == SectionKind.MAP)
        ):
            raise CorruptArchiveError(
                f"a section of kind {piece.kind} has no place here", piece.offset
            )
    if (
        SectionKind.PROMISE in kinds
        and SectionKind.WALKS in kinds[: kinds.index(SectionKind.PROMISE)]
    ):
        raise CorruptArchiveError("the promise comes after walks", HEAD_BYTES)
    if SectionKind.INDEX in kinds[:-1]:
        raise CorruptArchiveError(
            "the index is not the last section", found[kinds.index(SectionKind.INDEX)].offset
        )


def _check_index(
    found: list[StoredSection], walks: list[StoredSection], groups: tuple[Group, ...]
) -> None:
    index = next((piece for piece in found if piece.kind == SectionKind.INDEX), None)
    if index is None:
        if len(groups) > 1 and walks[0].checksum:
            raise CorruptArchiveError("several groups and no index", walks[0].offset)
        return
    lines = tuple(
        index_entry(group, piece.offset, piece.size)
        for group, piece in zip(groups, walks, strict=True)
    )
    if index.body != encode_index(lines):
        raise CorruptArchiveError("the index and the groups differ", index.offset)


def _unwrapped(
    groups: tuple[Group, ...], walks: list[StoredSection], file_size: int
) -> tuple[Group, ...]:
    left = layer_limit(file_size)
    out: list[Group] = []
    for group, piece in zip(groups, walks, strict=True):
        payload = unpack_bz2(group.payload, left, piece.offset)
        left -= len(payload)
        out.append(replace(group, payload=payload))
    return tuple(out)
