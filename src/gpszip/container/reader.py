"""From the untrusted bytes of an archive to its contents; anything wrong is a CorruptArchiveError with its offset."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from gpszip.container.contents import LONE_ID, MAP_HASH_BYTES, Contents, Group, MapReference, Section, complaint
from gpszip.container.expansion import unpack_bz2
from gpszip.container.frame_record import read_frame, read_short_frame
from gpszip.container.group_index import entry, index_body, read_end, read_group
from gpszip.container.layout import (
    CHECKSUM_BYTES,
    HEAD_BYTES,
    MARKER,
    SMALL_LIMIT,
    Cursor,
    Form,
    Head,
    Kind,
    checksum,
    read_head,
    section_limit,
)
from gpszip.container.map_record import read_reference
from gpszip.container.names import read_names
from gpszip.container.promise_record import read_promise
from gpszip.errors import CorruptArchiveError, InputError
from gpszip.model.frame import Frame
from gpszip.model.promise import Promise

__all__ = [
    "LAYER_FREE",
    "LAYER_RATIO",
    "Piece",
    "assemble",
    "finished",
    "from_bytes",
    "layer_limit",
    "load",
    "opening",
    "pieces",
    "read_file",
    "read_piece",
]

#: All layered payloads of an archive expand to at most this many bytes, and so many for each byte of the file.
LAYER_FREE = 1 << 26
LAYER_RATIO = 16

T = TypeVar("T")

#: Sections of which there is at most one, and what they are about.
_ONCE = {Kind.FRAME, Kind.NAMES, Kind.MAP, Kind.INDEX, Kind.PROMISE}


@dataclass(frozen=True)
class Piece:
    """A section where it lies in the bytes.

    Parameters
    ----------
    kind : int
        What it holds.
    offset, size : int
        First byte and number of bytes with all framing.
    body : bytes
        What is inside.
    seal : bytes
        Its own checksum; empty where it has none.
    body_offset : int
        First byte of the body.
    """

    kind: int
    offset: int
    size: int
    body: bytes
    seal: bytes
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
    found = pieces(data, head)
    return assemble(found, head, len(data))


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
    source = Path(path)
    try:
        if source.is_dir():
            raise InputError(f"{source}: is a folder, not an archive")
        if source.exists() and not source.is_file():
            raise InputError(f"{source}: is no regular file")
        return source.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{source}: no such file") from None
    except OSError as error:
        raise InputError(f"{source}: can't be read: {error.strerror or error}") from None


def pieces(data: bytes, head: Head) -> list[Piece]:
    """Cut an archive of sections into them, checking every checksum; the end mark is checked and left out."""
    if head.low:
        return _small_pieces(data)
    cursor = Cursor(data, HEAD_BYTES)
    found: list[Piece] = []
    while True:
        piece = read_piece(cursor)
        if piece.kind == Kind.END:
            break
        found.append(piece)
        if len(found) > section_limit(len(data)):
            raise cursor.fail("too many sections")
    _check_end(data, piece, found)
    cursor.finish("the archive")
    return found


def read_piece(cursor: Cursor) -> Piece:
    """Read one section of a large archive: marker, kind, length, body, checksum."""
    offset = cursor.at
    if cursor.take(len(MARKER), "a section's marker") != MARKER:
        cursor.at = offset
        raise cursor.fail("no section begins here")
    start = cursor.at
    kind, body_offset, body = _kind_and_body(cursor)
    content = memoryview(cursor.data)[start : cursor.at]
    seal = cursor.take(CHECKSUM_BYTES, "a section's checksum")
    if checksum(content) != seal:
        raise CorruptArchiveError(f"the checksum of a section of kind {kind} is wrong", cursor.base + offset)
    return Piece(kind, cursor.base + offset, cursor.at - offset, body, seal, body_offset)


def opening(found: list[Piece], version: int) -> tuple[Frame | None, MapReference | None, Promise | None, int | None]:
    """Where an archive lies, or on which map, what it promises, and how its log was sampled."""
    kinds = [piece.kind for piece in found[:2]]
    if kinds not in ([Kind.FRAME, Kind.NAMES], [Kind.MAP, Kind.NAMES]):
        raise CorruptArchiveError("an archive begins with its frame or its map, and its names", HEAD_BYTES)
    said = next((finished(piece, partial(read_promise, version=version)) for piece in found if piece.kind == Kind.PROMISE), (None, None))
    if kinds[0] == Kind.MAP:
        return None, finished(found[0], read_reference), *said
    return finished(found[0], read_frame), None, *said


def assemble(found: list[Piece], head: Head, file_size: int) -> Contents:
    """Contents from the sections of an archive, each checked against the others."""
    frame, reference, promise, sampling = opening(found, head.version)
    _check_order(found)
    ids = finished(found[1], lambda cursor: read_names(cursor, file_size))
    layered = bool(head.high)
    walks = [piece for piece in found if piece.kind == Kind.WALKS]
    groups = tuple(read_group(piece.cursor()) for piece in walks)
    _check_index(found, walks, groups)
    contents = Contents(
        frame,
        ids,
        _unwrapped(groups, walks, file_size) if layered else groups,
        reference,
        tuple(Section(piece.kind, piece.body) for piece in found if piece.kind not in {*_ONCE, Kind.WALKS}),
        "bz2" if layered else None,
        promise,
        sampling,
        head.version,
    )
    return _believed(contents, found[-1].offset)


def finished(piece: Piece, read: Callable[[Cursor], T]) -> T:
    """What ``read`` makes of a section, all of it."""
    cursor = piece.cursor()
    value = read(cursor)
    cursor.finish(f"a section of kind {piece.kind}")
    return value


def _read_compact(data: bytes, head: Head) -> Contents:
    end = len(data) - CHECKSUM_BYTES
    if end < HEAD_BYTES:
        raise CorruptArchiveError("the archive ends within its head", len(data))
    if checksum(memoryview(data)[:end]) != data[end:]:
        raise CorruptArchiveError("the archive's checksum is wrong: bytes are missing or changed", end)
    cursor = Cursor(data, HEAD_BYTES, end)
    promise, sampling = read_promise(cursor, head.version)
    if head.form is Form.ON_MAP:
        reference = MapReference(cursor.take(MAP_HASH_BYTES, "the map's hash"), head.low)
        own = read_names(cursor, len(data)) if head.high else None
        group = Group(0, 1 if own is None else len(own), cursor.rest())
        return _believed(Contents(None, own, (group,), reference, promise=promise, sampling=sampling, version=head.version), HEAD_BYTES)
    frame = read_short_frame(cursor, head.low, bool(head.high))
    ids = (LONE_ID,) if head.form is Form.LONE else read_names(cursor, len(data))
    group = Group(0, len(ids), cursor.rest())
    return _believed(Contents(frame, ids, (group,), promise=promise, sampling=sampling, version=head.version), HEAD_BYTES)


def _believed(contents: Contents, offset: int) -> Contents:
    wrong = complaint(contents)
    if wrong:
        raise CorruptArchiveError(wrong, offset)
    return contents


def _small_pieces(data: bytes) -> list[Piece]:
    end = len(data) - CHECKSUM_BYTES
    if len(data) >= SMALL_LIMIT:
        raise CorruptArchiveError(f"an archive of {len(data)} bytes needs a checksum for each section", 2)
    if end < HEAD_BYTES or checksum(memoryview(data)[:end]) != data[end:]:
        raise CorruptArchiveError("the archive's checksum is wrong: bytes are missing or changed", max(end, 0))
    cursor = Cursor(data, HEAD_BYTES, end)
    found: list[Piece] = []
    while cursor.left:
        offset = cursor.at
        kind, body_offset, body = _kind_and_body(cursor)
        found.append(Piece(kind, offset, cursor.at - offset, body, b"", body_offset))
    return found


def _kind_and_body(cursor: Cursor) -> tuple[int, int, bytes]:
    kind = cursor.byte("a section's kind")
    length = cursor.varint("a section's length")
    body_offset = cursor.base + cursor.at
    return kind, body_offset, cursor.take(length, f"a section of kind {kind}")


def _check_end(data: bytes, end: Piece, found: list[Piece]) -> None:
    index_offset, digest = read_end(end.cursor())
    if checksum(data[:HEAD_BYTES] + b"".join(piece.seal for piece in found)) != digest:
        raise CorruptArchiveError("sections are missing, added or out of order", end.offset)
    if index_offset != next((piece.offset for piece in found if piece.kind == Kind.INDEX), 0):
        raise CorruptArchiveError("the end mark points to no index", end.offset)


def _check_order(found: list[Piece]) -> None:
    kinds = [piece.kind for piece in found]
    both = Kind.FRAME in kinds and Kind.MAP in kinds
    for piece in found:
        if piece.kind in {0, Kind.END} or (piece.kind in _ONCE and kinds.count(piece.kind) > 1) or (both and piece.kind == Kind.MAP):
            raise CorruptArchiveError(f"a section of kind {piece.kind} has no place here", piece.offset)
    if Kind.PROMISE in kinds and Kind.WALKS in kinds[: kinds.index(Kind.PROMISE)]:
        raise CorruptArchiveError("the promise comes after walks", HEAD_BYTES)
    if Kind.INDEX in kinds[:-1]:
        raise CorruptArchiveError("the index is not the last section", found[kinds.index(Kind.INDEX)].offset)


def _check_index(found: list[Piece], walks: list[Piece], groups: tuple[Group, ...]) -> None:
    index = next((piece for piece in found if piece.kind == Kind.INDEX), None)
    if index is None:
        if len(groups) > 1 and walks[0].seal:
            raise CorruptArchiveError("several groups and no index", walks[0].offset)
        return
    lines = tuple(entry(group, piece.offset, piece.size) for group, piece in zip(groups, walks, strict=True))
    if index.body != index_body(lines):
        raise CorruptArchiveError("the index and the groups differ", index.offset)


def _unwrapped(groups: tuple[Group, ...], walks: list[Piece], file_size: int) -> tuple[Group, ...]:
    left = layer_limit(file_size)
    out: list[Group] = []
    for group, piece in zip(groups, walks, strict=True):
        payload = unpack_bz2(group.payload, left, piece.offset)
        left -= len(payload)
        out.append(replace(group, payload=payload))
    return tuple(out)
