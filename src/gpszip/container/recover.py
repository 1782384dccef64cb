"""What is left of a torn archive: every whole section of it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace

from gpszip.container.contents import Contents, Group, MapReference, Section, find_contradiction
from gpszip.container.error_bound_record import read_error_bound
from gpszip.container.expansion import unpack_bz2
from gpszip.container.grid_record import read_grid
from gpszip.container.group_index import read_group
from gpszip.container.layout import (
    HEAD_BYTES,
    SECTION_MARKER,
    Cursor,
    Form,
    Head,
    SectionKind,
    max_tracks,
    read_head,
)
from gpszip.container.map_record import read_reference
from gpszip.container.names import read_names
from gpszip.container.reader import StoredSection, from_bytes, layer_limit, read_file, read_section
from gpszip.errors import CorruptArchiveError
from gpszip.model.grid import QuantisationGrid

__all__ = ["Recovered", "find_intact_sections", "recover", "recover_bytes"]

#: Checksums of forged sections that lie within each other are tried over so many bytes for each byte of the file.
_WORK = 8
_FREE_WORK = 1 << 20


@dataclass(frozen=True)
class Recovered:
    """Contents that can be saved again, and what they lack.

    Parameters
    ----------
    contents : Contents
        Whole groups with the names of their tracks.
    lost : tuple of str
        One sentence for each thing that is missing; empty for a whole archive.
    """

    contents: Contents
    lost: tuple[str, ...]


def recover(path: str | os.PathLike[str]) -> Recovered:
    """Save every whole section of a torn archive.

    Parameters
    ----------
    path : path
        The torn file, which stays as it is.

    Raises
    ------
    CorruptArchiveError
        If nothing can be saved: the frame or all walks are gone. Small archives have one checksum and are whole or lost.
    InputError
        If the file can't be read.
    """
    return recover_bytes(read_file(path))


def recover_bytes(data: bytes) -> Recovered:
    """Save every whole section of the bytes of a torn archive, see :func:`recover`."""
    try:
        return Recovered(from_bytes(data), ())
    except CorruptArchiveError as error:
        reason = error
    head = read_head(data)
    if head.form is not Form.SECTIONS or head.low:
        raise reason
    found = {piece.offset: piece for piece in find_intact_sections(data)}
    return _joined(list(found.values()), head, len(data), str(reason))


def find_intact_sections(data: bytes) -> Iterator[StoredSection]:
    """Yield the sections of a large archive whose checksum is right, whatever lies between them."""
    work = _FREE_WORK + _WORK * len(data)
    at = data.find(SECTION_MARKER, HEAD_BYTES)
    while at >= 0 and work > 0:
        cursor = Cursor(data, at)
        try:
            piece = read_section(cursor)
        except CorruptArchiveError:
            work -= cursor.offset - at
            at = data.find(SECTION_MARKER, at + 1)
        else:
            yield piece
            at = data.find(SECTION_MARKER, cursor.offset)


def _joined(found: list[StoredSection], head: Head, size: int, reason: str) -> Recovered:
    grid, reference = _place(found)
    if grid is None and reference is None:
        raise CorruptArchiveError(f"nothing can be saved, as the frame is lost: {reason}")
    lost, layered = [reason], bool(head.high)
    groups = _groups(found, layered, size)
    if not groups:
        raise CorruptArchiveError(f"nothing can be saved, as all walks are lost: {reason}")
    ids = _names(found, groups, size, lost)
    kept = tuple(
        ids[track]
        for group in groups
        for track in range(group.first_track, group.first_track + group.tracks)
    )
    if len(kept) < len(ids):
        lost.append(f"{len(ids) - len(kept)} of {len(ids)} tracks")
    extras = tuple(
        Section(piece.kind, piece.body)
        for piece in found
        if piece.kind == SectionKind.ATTRIBUTES or piece.kind > SectionKind.PROMISE
    )
    if len(kept) < len(ids) and any(extra.kind == SectionKind.ATTRIBUTES for extra in extras):
        extras = tuple(extra for extra in extras if extra.kind != SectionKind.ATTRIBUTES)
        lost.append("kept columns and times of samples, as they stand for all tracks together")
    error_bound, sampling = next(
        (
            read_error_bound(piece.cursor(), head.version)
            for piece in found
            if piece.kind == SectionKind.PROMISE
        ),
        (None, None),
    )
    if error_bound is not None and not error_bound.maximum and len(kept) < len(ids):
        error_bound = None
        lost.append("the error promised, which is of all tracks together")
    layer = "bz2" if layered else None
    contents = Contents(
        grid,
        kept,
        _renumbered(groups),
        reference,
        extras,
        layer,
        error_bound,
        sampling,
        head.version,
    )
    wrong = find_contradiction(contents)
    if wrong:
        raise CorruptArchiveError(wrong)
    return Recovered(contents, tuple(lost))


def _place(found: list[StoredSection]) -> tuple[QuantisationGrid | None, MapReference | None]:
    for piece in found:
        if piece.kind == SectionKind.FRAME:
            return read_grid(piece.cursor()), None
        if piece.kind == SectionKind.MAP:
            return None, read_reference(piece.cursor())
    return None, None


def _groups(found: list[StoredSection], layered: bool, size: int) -> list[Group]:
    groups: list[Group] = []
    left, following = layer_limit(size), 0
    for piece in found:
        if piece.kind != SectionKind.WALKS:
            continue
        group = read_group(piece.cursor())
        if group.first_track < following or not group.tracks:
            continue
        if layered:
            group = replace(group, payload=unpack_bz2(group.payload, left, piece.offset))
            left -= len(group.payload)
        groups.append(group)
        following = group.first_track + group.tracks
    return groups


def _names(
    found: list[StoredSection], groups: list[Group], size: int, lost: list[str]
) -> tuple[str, ...]:
    needed = groups[-1].first_track + groups[-1].tracks
    for piece in found:
        if piece.kind == SectionKind.NAMES:
            ids = read_names(piece.cursor(), size)
            if len(ids) < needed:
                raise CorruptArchiveError(
                    f"walks of {needed} tracks, names of {len(ids)}", piece.offset
                )
            return ids
    if needed > max_tracks(size):
        raise CorruptArchiveError(f"walks of {needed} tracks in {size} bytes")
    lost.append("the names of all tracks; they are numbered instead")
    return tuple(map(str, range(needed)))


def _renumbered(groups: list[Group]) -> tuple[Group, ...]:
    out: list[Group] = []
    following = 0
    for group in groups:
        out.append(replace(group, first_track=following))
        following += group.tracks
    return tuple(out)
