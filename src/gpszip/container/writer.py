"""From contents to the bytes of an archive, and to a file that is there whole or not at all."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator, Sequence
from typing import BinaryIO, TypeAlias

from gpszip.container.contents import (
    DEFAULT_ID,
    Contents,
    Group,
    Section,
    SpooledBytes,
    StoredBytes,
    find_contradiction,
)
from gpszip.container.error_bound_record import encode_error_bound
from gpszip.container.expansion import pack_bz2
from gpszip.container.grid_record import (
    encode_grid,
    encode_short_grid,
    fits_head,
    has_whole_units,
    short_grid_shape,
)
from gpszip.container.group_index import (
    IndexEntry,
    encode_end_mark,
    encode_group,
    encode_index,
    index_entry,
)
from gpszip.container.layout import (
    CHECKSUM_BYTES,
    SECTION_MARKER,
    SMALL_LIMIT,
    Form,
    Head,
    SectionKind,
    checksum,
    encode_head,
    encode_section,
    encode_varint,
    max_sections,
    max_tracks,
)
from gpszip.container.map_record import encode_reference
from gpszip.container.names import encode_names
from gpszip.container.reader import layer_limit
from gpszip.errors import OptionError
from gpszip.files.atomic_write import atomic_write

__all__ = ["archive_size", "save", "to_bytes", "write"]

_Piece: TypeAlias = bytes | SpooledBytes | StoredBytes


def to_bytes(contents: Contents) -> bytes:
    """Bytes of an archive; the same contents give the same bytes.

    Parameters
    ----------
    contents : Contents
        One group with nothing beside it takes the compact form, of at most 28 bytes beside names and payload.

    Raises
    ------
    OptionError
        If the contents contradict each other.
    InputError
        If a track's id is no text.

    Examples
    --------
    >>> from gpszip.container.contents import single_group_contents
    >>> from gpszip.model.grid import Frame
    >>> to_bytes(single_group_contents(Frame((0, 0), 0, 128, 120), ("0",), b"walks")).hex()
    'a75a830000807800000077616c6b73dcfed209'
    """
    return b"".join(bytes(piece) for piece in _pieces(contents))


def archive_size(contents: Contents) -> int:
    """Bytes that an archive takes.

    Raises
    ------
    OptionError
        If the contents contradict each other.
    """
    return _total(_pieces(contents))


def _pieces(contents: Contents) -> list[_Piece]:
    """The bytes one after the other, some of which may lie in a temporary file."""
    wrong = find_contradiction(contents)
    if wrong:
        raise OptionError(f"this can't be written as an archive: {wrong}")
    found = _shortest(contents, _wrapped(contents))
    size = _total(found)
    if contents.tracks > max_tracks(size):
        raise OptionError(
            f"{contents.tracks} tracks in {size} bytes are more than readers believe; split the archive"
        )
    if len(contents.groups) + len(contents.extras) + 4 > max_sections(size):
        raise OptionError(
            f"{len(contents.groups)} groups in {size} bytes are more than readers believe; make them larger"
        )
    return found


def _total(pieces: Sequence[_Piece]) -> int:
    return sum(map(len, pieces))


def save(contents: Contents, path: str | os.PathLike[str], *, force: bool = False) -> int:
    """Write an archive so that the file is there whole or not at all.

    Parameters
    ----------
    contents : Contents
        What to write.
    path : path
        The new file, in a folder that exists.
    force : bool, default False
        Whether a file of that name is replaced.

    Returns
    -------
    int
        Size of the file in bytes.

    Raises
    ------
    OutputError
        If the file exists, or can't be written.
    """
    with atomic_write(path, force=force) as whole, whole.open("wb") as file:
        return write(contents, file)


def write(contents: Contents, file: BinaryIO) -> int:
    """Write the bytes of an archive piece by piece, and return their number.

    Parameters
    ----------
    contents : Contents
        What to write.
    file : binary stream
        Where to, buffered: a raw stream may take less than it is given.

    Raises
    ------
    OptionError
        If the contents contradict each other.
    """
    pieces = _pieces(contents)
    for piece in pieces:
        file.writelines(_parts(piece))
    return _total(pieces)


def _parts(piece: _Piece) -> Iterator[bytes]:
    return iter((piece,)) if isinstance(piece, bytes) else piece.chunks()


def _shortest(contents: Contents, wrapped: list[bytes]) -> list[_Piece]:
    if len(contents.groups) > 1 or any(len(extra.body) >= SMALL_LIMIT for extra in contents.extras):
        return _large(contents, wrapped)
    if _is_plain(contents):
        return [_compact(contents, wrapped[0])]
    small = _small(contents, wrapped)
    return [small] if len(small) < SMALL_LIMIT else _large(contents, wrapped)


def _is_plain(contents: Contents) -> bool:
    return contents.is_single_group and (contents.grid is None or fits_head(contents.grid))


def _wrapped(contents: Contents) -> list[bytes]:
    if contents.layer is None:
        return [group.payload for group in contents.groups]
    wrapped = [pack_bz2(group.payload) for group in contents.groups]
    total = sum(len(group.payload) for group in contents.groups)
    if total > layer_limit(sum(map(len, wrapped))):
        raise OptionError(f"{total} bytes of walks are too many for the bz2 layer; leave it out")
    return wrapped


def _compact(contents: Contents, payload: bytes) -> bytes:
    grid = contents.grid
    lone = contents.ids is None or (grid is not None and contents.ids == (DEFAULT_ID,))
    names = b"" if lone or contents.ids is None else encode_names(contents.ids)
    if grid is not None:
        head = Head(
            Form.LONE if lone else Form.NAMED,
            short_grid_shape(grid),
            int(has_whole_units(grid)),
            contents.version,
        )
        place = encode_short_grid(grid)
    elif contents.map is not None:
        head, place = (
            Head(Form.ON_MAP, contents.map.refinements, int(not lone), contents.version),
            contents.map.hash,
        )
    return _sealed(
        encode_head(head)
        + encode_error_bound(contents.error_bound, contents.sampling)
        + place
        + names
        + payload
    )


def _sealed(data: bytes) -> bytes:
    return data + checksum(data)


def _opening(contents: Contents) -> list[tuple[int, bytes]]:
    sections = [(int(SectionKind.NAMES), encode_names(contents.ids or ()))]
    if contents.error_bound is not None or contents.sampling is not None:
        sections.append(
            (int(SectionKind.PROMISE), encode_error_bound(contents.error_bound, contents.sampling))
        )
    if contents.grid is not None:
        return [(int(SectionKind.FRAME), encode_grid(contents.grid)), *sections]
    return (
        [(int(SectionKind.MAP), encode_reference(contents.map)), *sections]
        if contents.map is not None
        else sections
    )


def _small(contents: Contents, wrapped: list[bytes]) -> bytes:
    lone = contents.groups[0]
    walks = (
        int(SectionKind.WALKS),
        encode_group(Group(lone.first_track, lone.tracks, b""), wrapped[0]),
    )
    sections = [
        *_opening(contents),
        walks,
        *((extra.kind, bytes(extra.body)) for extra in contents.extras),
    ]
    head = encode_head(Head(Form.SECTIONS, 1, int(contents.layer is not None), contents.version))
    return _sealed(
        head + b"".join(bytes([kind]) + encode_varint(len(body)) + body for kind, body in sections)
    )


def _large(contents: Contents, wrapped: list[bytes]) -> list[_Piece]:
    head = encode_head(Head(Form.SECTIONS, 0, int(contents.layer is not None), contents.version))
    parts: list[_Piece] = [head, *(encode_section(kind, body) for kind, body in _opening(contents))]
    entries: list[IndexEntry] = []
    offset = _total(parts)
    for group, payload in zip(contents.groups, wrapped, strict=True):
        kept = group if len(contents.groups) > 1 else Group(group.first_track, group.tracks, b"")
        section = encode_section(SectionKind.WALKS, encode_group(kept, payload))
        entries.append(index_entry(kept, offset, len(section)))
        parts.append(section)
        offset += len(section)
    seals = [bytes(part)[-CHECKSUM_BYTES:] for part in parts[1:]]
    for extra in contents.extras:
        section_parts = _section(extra)
        parts += section_parts
        seals.append(bytes(section_parts[-1])[-CHECKSUM_BYTES:])
    index_offset = 0
    if len(entries) > 1:
        index_offset = _total(parts)
        parts.append(encode_section(SectionKind.INDEX, encode_index(tuple(entries))))
        seals.append(bytes(parts[-1])[-CHECKSUM_BYTES:])
    return [
        *parts,
        encode_section(
            SectionKind.END, encode_end_mark(index_offset, checksum(head + b"".join(seals)))
        ),
    ]


def _section(extra: Section) -> list[_Piece]:
    """A further section, whose body may lie in a temporary file."""
    if isinstance(extra.body, bytes):
        return [encode_section(extra.kind, extra.body)]
    start = bytes([extra.kind]) + encode_varint(len(extra.body))
    digest = zlib.crc32(start)
    for piece in extra.body.chunks():
        digest = zlib.crc32(piece, digest)
    return [SECTION_MARKER + start, extra.body, digest.to_bytes(CHECKSUM_BYTES, "little")]
