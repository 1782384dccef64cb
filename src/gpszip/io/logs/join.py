"""Name the tracks of all files, and join those that go on in another file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from gpszip.io.logs.file_collector import FileCollector
from gpszip.io.logs.raw import unused_name
from gpszip.io.logs.rows import Floats
from gpszip.model.read_result import Repair

__all__ = ["JoinedTrack", "join_tracks", "name_of_unnamed"]

#: Name of the track without a name of a log that is read alone.
_UNNAMED_TRACK = "0"


class _Part(NamedTuple):
    """The rows that one file has of a track.

    Parameters
    ----------
    code : int
        The number by which they are found.
    name : str
        Name of the track.
    is_title : bool
        Whether other files may have another track of that name.
    timed : bool
        Whether the track has times.
    first_time, last_time : float
        Extent in seconds.
    where : str
        Name of the file.
    """

    code: int
    name: str
    is_title: bool
    timed: bool
    first_time: float
    last_time: float
    where: str


class JoinedTrack(NamedTuple):
    """A track of the log.

    Parameters
    ----------
    name : str
        Its name, which no other track has.
    codes : tuple of int
        Its rows in each file, in the order of time.
    where : str
        Name of the first of these files.
    timed : bool
        Whether it has times.
    """

    name: str
    codes: tuple[int, ...]
    where: str
    timed: bool


def join_tracks(
    files: Sequence[FileCollector], *, is_alone: bool, repairs: list[Repair]
) -> tuple[list[JoinedTrack], Floats]:
    """Name the tracks of all files, and join those of one name that follow each other in time.

    A track that overlaps with another one of its name becomes ``NAME-2``. So does one whose name is
    only a title, which several files may use.

    Parameters
    ----------
    files : sequence of FileCollector
        Files in the order in which they were read.
    is_alone : bool
        Whether only one log was named.
    repairs : list of Repair
        Tracks that get another name are added.

    Returns
    -------
    list of JoinedTrack
        In the order in which the files first name them.
    float64 array, shape (k,)
        For each code, the time at which the rows of the same track in an earlier file end; NaN if
        no earlier file has the track.
    """
    # Group what the files have by name.
    parts = [part for file in files for part in _name_parts(file, is_alone)]
    by_name: dict[str, list[_Part]] = {}
    for part in parts:
        by_name.setdefault(part.name, []).append(part)

    # Join what doesn't overlap; each of the others gets an unused name.
    taken = set(by_name)
    joined: list[JoinedTrack] = []
    ends_before = np.full(max((file.tracks.next_code for file in files), default=0), np.nan)
    for name, group in by_name.items():
        # Most names are those of one track in one file.
        if len(group) == 1:
            joined.append(JoinedTrack(name, (group[0].code,), group[0].where, group[0].timed))
            continue
        successive, overlapping = _split_overlapping(group)
        codes = tuple(part.code for part in successive)
        ends_before[list(codes[1:])] = [part.last_time for part in successive[:-1]]
        joined.append(JoinedTrack(name, codes, successive[0].where, successive[0].timed))
        for part in overlapping:
            new_name = unused_name(name, taken)
            taken.add(new_name)
            joined.append(JoinedTrack(new_name, (part.code,), part.where, part.timed))
            what = f"track renamed to {new_name!r}, as there is another {name!r}"
            repairs.append(Repair(what, 1, part.where, drops=False))
    return joined, ends_before


def name_of_unnamed(file: FileCollector, *, is_alone: bool) -> str:
    """Return the name of a file's track without a name: that of the file, if it is not alone."""
    return _UNNAMED_TRACK if is_alone else file.source.stem


def _name_parts(file: FileCollector, is_alone: bool) -> Iterable[_Part]:
    """Yield the tracks of a file, and give names to those without.

    Such a name is a title, which other files may use for another track, unless the files are those
    of one folder.
    """
    # A file without names has several tracks if it is split where time goes back.
    taken: set[str] = set()
    for track in file.tracks.named_tracks():
        name, is_title = track.name, file.ids_are_titles
        if name is None:
            name = unused_name(name_of_unnamed(file, is_alone=is_alone), taken)
            is_title = is_title or file.source.folder is None
        taken.add(name)
        extent = track.first_time, track.last_time
        yield _Part(track.code, name, is_title, track.timed, *extent, file.name)


def _split_overlapping(group: list[_Part]) -> tuple[list[_Part], list[_Part]]:
    """Split tracks of one name into those that follow each other in time, and the others."""
    # Nothing shows that titles or shapes of one name belong together, so they are not joined.
    if any(part.is_title or not part.timed for part in group):
        return group[:1], group[1:]

    # A part may start at the very time at which the one before it ends. That row is dropped when
    # the rows are sorted, see drop_repeated_rows.
    successive: list[_Part] = []
    overlapping: list[_Part] = []
    for part in sorted(group, key=lambda part: part.first_time):
        follows = not successive or part.first_time >= successive[-1].last_time
        (successive if follows else overlapping).append(part)
    return successive, overlapping
