"""From contents to the bytes of an archive, and to a file that is complete or not there at all."""

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

#: Bytes of an archive, or what yields them.
_Block: TypeAlias = bytes | SpooledBytes | StoredBytes

#: Sections that a large archive may have beside walks and further ones.
_OTHER_SECTIONS = 4


def to_bytes(contents: Contents) -> bytes:
    """Encode an archive; the same contents give the same bytes.

    Parameters
    ----------
    contents : Contents
        One group without further sections takes the compact form, which has at most 28 bytes beside
        names and payload.

    Raises
    ------
    OptionError
        If the contents contradict each other.
    InputError
        If a track's id is no text.

    Examples
    --------
    >>> from gpszip.container.contents import single_group_contents
    >>> from gpszip.model.grid import QuantisationGrid
    >>> grid = QuantisationGrid((0, 0), 0, 128, 120)
    >>> to_bytes(single_group_contents(grid, ("0",), b"walks")).hex()
    'a75a830000807800000077616c6b73dcfed209'
    """
    return b"".join(bytes(block) for block in _encode(contents))


def archive_size(contents: Contents) -> int:
    """Bytes that an archive takes.

    Raises
    ------
    OptionError
        If the contents contradict each other.
    """
    return _total(_encode(contents))


def save(contents: Contents, path: str | os.PathLike[str], *, force: bool = False) -> int:
    """Write an archive so that the file is complete or not there at all.

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
    with atomic_write(path, force=force) as temporary, temporary.open("wb") as file:
        return write(contents, file)


def write(contents: Contents, file: BinaryIO) -> int:
    """Write the bytes of an archive, and return their number.

    Parameters
    ----------
    contents : Contents
        What to write.
    file : binary stream
        Buffered: a raw stream may take less than it is given.

    Raises
    ------
    OptionError
        If the contents contradict each other.
    """
    blocks = _encode(contents)
    for block in blocks:
        file.writelines(_chunks(block))
    return _total(blocks)


def _encode(contents: Contents) -> list[_Block]:
    """Encode an archive in blocks, which may lie in temporary files."""
    # Refuse contents that contradict each other; encode others in the shortest form.
    contradiction = find_contradiction(contents)
    if contradiction:
        raise OptionError(f"this can't be written as an archive: {contradiction}")
    blocks = _encode_shortest(contents, _compress(contents))

    # What no reader would accept.
    size = _total(blocks)
    if contents.tracks > max_tracks(size):
        raise OptionError(
            f"{contents.tracks} tracks in {size} bytes are more than readers accept",
            remedy="split the archive",
        )
    if len(contents.groups) + len(contents.extras) + _OTHER_SECTIONS > max_sections(size):
        raise OptionError(
            f"{len(contents.groups)} groups in {size} bytes are more than readers accept",
            remedy="make them larger",
        )
    return blocks


def _total(blocks: Sequence[_Block]) -> int:
    """Bytes of all blocks."""
    return sum(map(len, blocks))


def _chunks(block: _Block) -> Iterator[bytes]:
    """Bytes of a block, as much at a time as memory holds."""
    return iter((block,)) if isinstance(block, bytes) else block.chunks()


def _compress(contents: Contents) -> list[bytes]:
    """Payloads of all groups as they are stored."""
    if contents.layer is None:
        return [group.payload for group in contents.groups]
    payloads = [pack_bz2(group.payload) for group in contents.groups]
    total = sum(len(group.payload) for group in contents.groups)
    # A reader refuses payloads that expand past its limit.
    if total > layer_limit(sum(map(len, payloads))):
        raise OptionError(
            f"{total} bytes of walks are too many for the bz2 layer", remedy="leave it out"
        )
    return payloads


def _encode_shortest(contents: Contents, payloads: list[bytes]) -> list[_Block]:
    """Encode an archive in the shortest form that holds it."""
    # Several groups need an index, which only the large form has.
    if len(contents.groups) > 1 or any(len(extra.body) >= SMALL_LIMIT for extra in contents.extras):
        return _encode_large(contents, payloads)
    # A single group needs sections only where the head can't tell the shape of the grid.
    if contents.is_single_group and (contents.grid is None or fits_head(contents.grid)):
        return [_encode_compact(contents, payloads[0])]
    small = _encode_small(contents, payloads)
    return [small] if len(small) < SMALL_LIMIT else _encode_large(contents, payloads)


def _encode_compact(contents: Contents, payload: bytes) -> bytes:
    """Encode an archive of one group: head, error bound, grid or map, names, payload, checksum."""
    # Leave out a name that readers supply: the default one, or that of the map's first track.
    grid, reference = contents.grid, contents.map
    is_unnamed = contents.ids is None or (grid is not None and contents.ids == (DEFAULT_ID,))
    names = b"" if is_unnamed or contents.ids is None else encode_names(contents.ids)

    # Store the grid, or the hash of the map that replaces it; the form says which.
    if grid is not None:
        form = Form.LONE if is_unnamed else Form.NAMED
        low, high = short_grid_shape(grid), int(has_whole_units(grid))
        grid_or_map = encode_short_grid(grid)
    elif reference is not None:
        form = Form.ON_MAP
        low, high = reference.refinements, int(not is_unnamed)
        grid_or_map = reference.hash

    # Join the parts in the order of the format.
    return _with_checksum(
        encode_head(Head(form, low, high, contents.version))
        + encode_error_bound(contents.error_bound, contents.sampling)
        + grid_or_map
        + names
        + payload
    )


def _with_checksum(data: bytes) -> bytes:
    """Append the checksum of the bytes."""
    return data + checksum(data)


def _encode_opening(contents: Contents) -> list[tuple[int, bytes]]:
    """Kinds and bodies of the first sections: grid or map, names, error bound."""
    sections: list[tuple[int, bytes]] = []
    if contents.grid is not None:
        sections.append((SectionKind.GRID, encode_grid(contents.grid)))
    elif contents.map is not None:
        sections.append((SectionKind.MAP, encode_reference(contents.map)))
    sections.append((SectionKind.NAMES, encode_names(contents.ids or ())))
    if contents.error_bound is not None or contents.sampling is not None:
        error_bound = encode_error_bound(contents.error_bound, contents.sampling)
        sections.append((SectionKind.ERROR_BOUND, error_bound))
    return sections


def _encode_small(contents: Contents, payloads: list[bytes]) -> bytes:
    """Encode an archive of sections with one checksum for all of them."""
    # a single group has no time range
    group = contents.groups[0]
    walks = encode_group(Group(group.first_track, group.tracks, b""), payloads[0])
    sections = [
        *_encode_opening(contents),
        (SectionKind.WALKS, walks),
        *((extra.kind, bytes(extra.body)) for extra in contents.extras),
    ]
    head = encode_head(Head(Form.SECTIONS, 1, int(contents.layer is not None), contents.version))
    return _with_checksum(
        head + b"".join(bytes([kind]) + encode_varint(len(body)) + body for kind, body in sections)
    )


def _encode_large(contents: Contents, payloads: list[bytes]) -> list[_Block]:
    """Encode an archive of sections with a checksum each, an index and an end mark."""
    # Encode the sections that precede the walks; the end mark covers all checksums.
    head = encode_head(Head(Form.SECTIONS, 0, int(contents.layer is not None), contents.version))
    opening = [encode_section(kind, body) for kind, body in _encode_opening(contents)]
    blocks: list[_Block] = [head, *opening]
    checksums = [section[-CHECKSUM_BYTES:] for section in opening]

    # The groups; a single one has no time range.
    entries: list[IndexEntry] = []
    offset = _total(blocks)
    is_single = len(contents.groups) == 1
    for group, payload in zip(contents.groups, payloads, strict=True):
        stored = Group(group.first_track, group.tracks, b"") if is_single else group
        section = encode_section(SectionKind.WALKS, encode_group(stored, payload))
        entries.append(index_entry(stored, offset, len(section)))
        blocks.append(section)
        checksums.append(section[-CHECKSUM_BYTES:])
        offset += len(section)

    # Further sections.
    for extra in contents.extras:
        section_blocks = _encode_extra(extra)
        blocks += section_blocks
        checksums.append(bytes(section_blocks[-1])[-CHECKSUM_BYTES:])

    # The index of several groups, and the end mark.
    index_offset = 0
    if not is_single:
        index_offset = _total(blocks)
        index = encode_section(SectionKind.INDEX, encode_index(tuple(entries)))
        blocks.append(index)
        checksums.append(index[-CHECKSUM_BYTES:])
    digest = checksum(head + b"".join(checksums))
    end = encode_section(SectionKind.END, encode_end_mark(index_offset, digest))
    return [*blocks, end]


def _encode_extra(extra: Section) -> list[_Block]:
    """Encode a further section, whose body may lie in a temporary file."""
    if isinstance(extra.body, bytes):
        return [encode_section(extra.kind, extra.body)]
    # Compute the checksum chunk by chunk, as the body may not fit in memory.
    start = bytes([extra.kind]) + encode_varint(len(extra.body))
    digest = zlib.crc32(start)
    for chunk in extra.body.chunks():
        digest = zlib.crc32(chunk, digest)
    return [SECTION_MARKER + start, extra.body, digest.to_bytes(CHECKSUM_BYTES, "little")]
