"""Recovery of the intact sections of a damaged archive."""

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
    CURVE_KINDS,
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
from gpszip.model.error_bound import ErrorBound, rounded_bound
from gpszip.model.grid import QuantisationGrid

__all__ = ["Recovered", "find_intact_sections", "recover", "recover_bytes"]

#: Forged sections may lie within each other: their checksums are computed over at most this many
#: bytes, and so many more for each byte of the file.
_FREE_WORK = 1 << 20
_WORK_PER_BYTE = 8

#: Sections that stand for all tracks together.
_OF_ALL_TRACKS = (SectionKind.ATTRIBUTES, SectionKind.CODED_ATTRIBUTES, *CURVE_KINDS)


@dataclass(frozen=True)
class Recovered:
    """Contents that can be saved again, and what they lack.

    Parameters
    ----------
    contents : Contents
        Intact groups with the names of their tracks.
    lost : tuple of str
        A description of each thing that is missing; empty for an intact archive.
    """

    contents: Contents
    lost: tuple[str, ...]


def recover(path: str | os.PathLike[str]) -> Recovered:
    """Recover every intact section of a damaged archive.

    Parameters
    ----------
    path : path
        The damaged file, which stays as it is.

    Raises
    ------
    CorruptArchiveError
        If nothing can be recovered: the grid or all walks are lost. Small archives have one
        checksum, so that all is intact or lost.
    InputError
        If the file can't be read.
    """
    return recover_bytes(read_file(path))


def recover_bytes(data: bytes) -> Recovered:
    """Recover every intact section of the bytes of a damaged archive, see :func:`recover`."""
    try:
        return Recovered(from_bytes(data), ())
    except CorruptArchiveError as error:
        reason = error
    # Without a checksum for each section, nothing tells which bytes are intact.
    head = read_head(data)
    if head.form is not Form.SECTIONS or head.low:
        raise reason
    return _assemble(list(find_intact_sections(data)), head, len(data), str(reason))


def find_intact_sections(data: bytes) -> Iterator[StoredSection]:
    """Yield the sections of a large archive with a right checksum, whatever lies between them."""
    work = _FREE_WORK + _WORK_PER_BYTE * len(data)
    start = data.find(SECTION_MARKER, HEAD_BYTES)
    while start >= 0 and work > 0:
        cursor = Cursor(data, start)
        try:
            section = read_section(cursor)
        except CorruptArchiveError:
            # The next marker may lie within what seemed to be a section.
            work -= cursor.offset - start
            start = data.find(SECTION_MARKER, start + 1)
        else:
            # Go on behind the section: a marker within an intact body begins no section.
            yield section
            start = data.find(SECTION_MARKER, cursor.offset)


def _assemble(sections: list[StoredSection], head: Head, file_size: int, reason: str) -> Recovered:
    """Assemble what intact sections hold; ``reason`` says what is wrong with the archive."""
    # Collect what is lost, for the report; the reason comes first.
    lost = [reason]

    # Without grid and walks there is nothing.
    grid, reference = _read_grid_or_map(sections)
    if grid is None and reference is None:
        raise CorruptArchiveError(f"nothing can be saved, as the grid is lost: {reason}")
    is_layered = bool(head.high)
    groups = _read_groups(sections, is_layered, file_size)
    if not groups:
        raise CorruptArchiveError(f"nothing can be saved, as all walks are lost: {reason}")

    # Names of the tracks that are left.
    all_ids = _read_ids(sections, groups, file_size, lost)
    ids = tuple(
        all_ids[track]
        for group in groups
        for track in range(group.first_track, group.first_track + group.tracks)
    )
    has_all_tracks = len(ids) == len(all_ids)
    if not has_all_tracks:
        lost.append(f"{len(all_ids) - len(ids)} of {len(all_ids)} tracks")

    # What holds for all tracks together is lost with any of them.
    extras = _read_extras(sections, has_all_tracks, lost)
    error_bound, sampling = _read_error_bound(sections, head.version, has_all_tracks, lost)
    contents = Contents(
        grid,
        ids,
        _renumber(groups),
        reference,
        extras,
        "bz2" if is_layered else None,
        error_bound,
        sampling,
        head.version,
    )
    contradiction = find_contradiction(contents)
    if contradiction:
        raise CorruptArchiveError(contradiction)
    return Recovered(contents, tuple(lost))


def _read_grid_or_map(
    sections: list[StoredSection],
) -> tuple[QuantisationGrid | None, MapReference | None]:
    """The grid, or the map, of the first section that holds one."""
    for section in sections:
        if section.kind == SectionKind.GRID:
            return read_grid(section.cursor()), None
        if section.kind == SectionKind.MAP:
            return None, read_reference(section.cursor())
    return None, None


def _read_groups(sections: list[StoredSection], is_layered: bool, file_size: int) -> list[Group]:
    """Groups in the order of their tracks, decompressed; empty and repeated ones are left out."""
    groups: list[Group] = []
    remaining, next_track = layer_limit(file_size), 0
    for section in sections:
        if section.kind != SectionKind.WALKS:
            continue
        group = read_group(section.cursor())
        # A group that overlaps those before it would give a track two walks.
        if group.first_track < next_track or not group.tracks:
            continue
        if is_layered:
            payload = unpack_bz2(group.payload, remaining, section.offset)
            group = replace(group, payload=payload)
            remaining -= len(payload)
        groups.append(group)
        next_track = group.first_track + group.tracks
    return groups


def _read_ids(
    sections: list[StoredSection], groups: list[Group], file_size: int, lost: list[str]
) -> tuple[str, ...]:
    """Ids of all tracks; numbers if they are lost."""
    # Tracks are numbered through, so that the last group tells how many ids there must have been.
    needed = groups[-1].first_track + groups[-1].tracks
    for section in sections:
        if section.kind == SectionKind.NAMES:
            ids = read_names(section.cursor(), file_size)
            if len(ids) < needed:
                raise CorruptArchiveError(
                    f"walks of {needed} tracks, names of {len(ids)}", section.offset
                )
            return ids
    # Forged numbers of tracks must not ask for memory.
    if needed > max_tracks(file_size):
        raise CorruptArchiveError(f"walks of {needed} tracks in {file_size} bytes")
    lost.append("the names of all tracks; they are numbered instead")
    return tuple(map(str, range(needed)))


def _read_extras(
    sections: list[StoredSection], has_all_tracks: bool, lost: list[str]
) -> tuple[Section, ...]:
    """Further sections; kept columns are those of all tracks, and lost with any of them."""
    # Kinds above those known here are of later versions.
    extras = tuple(
        Section(section.kind, section.body)
        for section in sections
        if section.kind == SectionKind.ATTRIBUTES or section.kind > SectionKind.ERROR_BOUND
    )
    extras = _without_guided_logs(sections, extras, has_all_tracks, lost)
    if has_all_tracks or all(extra.kind not in _OF_ALL_TRACKS for extra in extras):
        return extras
    are_curves = all(extra.kind in CURVE_KINDS for extra in extras if extra.kind in _OF_ALL_TRACKS)
    what = "columns kept within an error" if are_curves else "kept columns and times of samples"
    lost.append(f"{what}, as they stand for all tracks together")
    return tuple(extra for extra in extras if extra.kind not in _OF_ALL_TRACKS)


def _without_guided_logs(
    sections: list[StoredSection],
    extras: tuple[Section, ...],
    has_all_tracks: bool,
    lost: list[str],
) -> tuple[Section, ...]:
    """All sections but logs that walks or names predict of which some are lost."""
    if has_all_tracks and any(section.kind == SectionKind.NAMES for section in sections):
        return extras
    # Their first byte tells whether anything predicts them.
    guided = [
        extra
        for extra in extras
        if extra.kind == SectionKind.GUIDED_LOGS and bytes(extra.body)[:1] != b"\0"
    ]
    if guided:
        lost.append("logs kept byte by byte, as the walks that predict them are not whole")
    return tuple(extra for extra in extras if extra not in guided)


def _read_error_bound(
    sections: list[StoredSection], version: int, has_all_tracks: bool, lost: list[str]
) -> tuple[ErrorBound | None, int | None]:
    """Error bound and sampling; a root mean square of all tracks is lost with any of them."""
    error_bound = sampling = None
    for section in sections:
        if section.kind == SectionKind.ERROR_BOUND:
            error_bound, sampling = read_error_bound(section.cursor(), version)
            break
    # A maximum holds for each track that is left, a root mean square for all of them together.
    if error_bound is None or error_bound.maximum or has_all_tracks:
        return error_bound, sampling
    if error_bound.max_error is None:
        lost.append("the error bound, which is one of all tracks together")
        return None, sampling
    maximum = rounded_bound(error_bound.max_error, maximum=True)
    still_holds = "" if maximum is None else f"; {maximum} still holds"
    lost.append(f"the bound of the RMSE, which is one of all tracks together{still_holds}")
    return maximum, sampling


def _renumber(groups: list[Group]) -> tuple[Group, ...]:
    """Number the tracks of the groups from 0 on."""
    renumbered: list[Group] = []
    next_track = 0
    for group in groups:
        renumbered.append(replace(group, first_track=next_track))
        next_track += group.tracks
    return tuple(renumbered)
