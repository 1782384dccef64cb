"""What pages and pictures are made of: archives and their names, and the log on their plane."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias, cast

from gpszip.archive import Archive, ArchiveSource, open_archive
from gpszip.errors import OptionError
from gpszip.geo.planes import reproject_track
from gpszip.model import Track
from gpszip.model.text import axes_text

__all__ = [
    "Archives",
    "check_coordinates",
    "check_ids",
    "list_tracks",
    "open_archives",
    "put_on_plane",
]

#: One archive or several, opened or not.
Archives: TypeAlias = "Archive | ArchiveSource | Sequence[Archive | ArchiveSource]"


def open_archives(archives: Archives) -> tuple[tuple[Archive, ...], tuple[str, ...]]:
    """Open archives that are not open yet; return them, and their names.

    Parameters
    ----------
    archives : Archive, path, bytes or binary file, or sequence of these
        One or several.

    Returns
    -------
    tuple of Archive, tuple of str
        Only paths have names; other archives have empty ones.
    """
    # An archive is a sequence of names itself, and bytes are one of numbers.
    single = isinstance(archives, Archive | str | os.PathLike | bytes) or hasattr(archives, "read")
    listed = [archives] if single else list(cast("Sequence[Archive | ArchiveSource]", archives))
    opened = tuple(
        each if isinstance(each, Archive) else open_archive(cast("ArchiveSource", each))
        for each in listed
    )
    names = tuple(Path(each).stem if isinstance(each, str | os.PathLike) else "" for each in listed)
    return opened, names


def list_tracks(raw: Track | Sequence[Track]) -> tuple[Track, ...]:
    """The tracks of a log, of which there may be one."""
    return (raw,) if isinstance(raw, Track) else tuple(raw)


def check_coordinates(tracks: Sequence[Track], archive: Archive) -> None:
    """Refuse a log whose coordinates are of another kind than those of an archive.

    Raises
    ------
    OptionError
        If one is in degrees and the other in metres, or they have different numbers of axes.
    """
    grid = archive.grid
    expected = axes_text(grid.dimension, grid.plane)
    for track in tracks:
        given = axes_text(track.dimension, track.plane)
        if given != expected:
            raise OptionError(
                f"the log is in {given}, the archive in {expected}",
                location=f"track {track.id!r}",
                remedy="give the log that was compressed",
            )


def check_ids(tracks: Sequence[Track], archives: Sequence[Archive]) -> None:
    """Refuse a log none of whose tracks is in an archive: it is another log.

    Raises
    ------
    OptionError
        If there are tracks, and no archive has any of them.
    """
    ids = [track.id for track in tracks]
    if ids and not any(id in archive for archive in archives for id in ids):
        raise OptionError(
            f"no archive has a track {ids[0]!r} of the log; the first has {archives[0].ids[0]!r}",
            remedy="give the log that was compressed",
        )


def put_on_plane(tracks: Sequence[Track], archive: Archive) -> tuple[Track, ...]:
    """Put the tracks of a log on the planes of an archive.

    Raises
    ------
    OptionError
        As :func:`check_coordinates` does, or if a track is far from the archive's planes.
    """
    check_coordinates(tracks, archive)
    plane = archive.grid.plane
    if plane is None:
        return tuple(tracks)
    try:
        return tuple(reproject_track(track, plane) for track in tracks)
    except OptionError as error:
        raise OptionError(error.reason, remedy="give the log that was compressed") from error
