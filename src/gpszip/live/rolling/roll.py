"""Appending a journal to an archive.

The segments that are complete are read, appended, and deleted once the archive on disk is proved to
hold each of their fixes. If the process is killed before, the next one finds them in the archive
already, and appends nothing twice.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.errors import BoundError, OptionError, OutputError
from gpszip.files.os_errors import as_output_error
from gpszip.live.journal import Lock, Tail, mark_archived, segments
from gpszip.live.place_read import read_place, state_path
from gpszip.live.rolling.archives import (
    archive_names,
    assign_parts,
    distances_to,
    divide_at_breaks,
    largest_error,
    open_archives,
    plane_of,
    reachable,
    tracks_on,
)
from gpszip.live.rolling.fixes import AgentFixes, read_fixes
from gpszip.model import Listener, Options
from gpszip.model.grid import step_size

__all__ = ["RollReport", "roll"]

#: Bytes of segments that are appended at once, which are about a million fixes.
_MAX_BYTES = 128 << 20

#: Name of the file that is locked while a journal is archived.
_LOCK = "rolling"

#: Maximum error of a new archive as a multiple of its RMSE, where only that is given: a fix is
#: proved to be in an archive by its own error.
_MAX_PER_RMSE = 4.0

#: Relative excess of the RMSE up to which it counts as held: the rounding of the measurement.
_ROUNDING = 1e-9

#: Time steps of the archive that a track must have ended before it is continued, in the attempts.
#: Where a walk can't be cut near its end, its continuation needs some; if all fails, new tracks.
_MARGINS = (0.0, 2.0, np.inf)

Fixes = dict[str, AgentFixes]


@dataclass
class RollReport:
    """What was archived.

    Parameters
    ----------
    fixes : int
        Fixes of the segments, without repeats.
    known : int
        Those of them that the archives held already.
    late : int
        Those that went to further tracks of their agents.
    damaged : int
        Records that could not be read.
    segments : int
        Segments that were deleted.
    waiting : int
        Complete segments that were kept, as the listener has not read them for events yet.
    archives : list of str
        Archives that were written.
    """

    fixes: int = 0
    known: int = 0
    late: int = 0
    damaged: int = 0
    segments: int = 0
    waiting: int = 0
    archives: list[str] = field(default_factory=list)


def roll(
    folder: str | os.PathLike[str],
    path: str | os.PathLike[str],
    options: Options,
    progress: Listener | None = None,
) -> RollReport:
    """Append the complete segments of a journal to an archive, and delete them.

    Parameters
    ----------
    folder : path
        The journal. If a listener writes to it, its last segment is not complete.
    path : path
        The archive; a new one if it doesn't exist.
    options : Options
        Bound and effort of a new archive. Later fixes hold the bound that the archive states.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.

    Raises
    ------
    OutputError
        If the archive can't be written, or another process archives the journal.
    OptionError
        If nothing can be appended to the archive, or events of the journal were asked for and not
        found yet, and no listener runs.
    """
    # One process at a time.
    journal = Path(folder)
    lock = Lock(journal, _LOCK)
    if not lock.acquire():
        raise OutputError("another process archives this journal", path=journal)

    # Each batch is deleted once it is archived.
    report = RollReport()
    try:
        for batch in _batches(_complete_segments(journal, report)):
            with as_output_error(path):
                _roll_batch(batch, Path(path), options, progress, report)
            with as_output_error(journal):
                mark_archived(journal, batch[-1])
            report.segments += len(batch)
    finally:
        lock.release()
    return report


def _complete_segments(journal: Path, report: RollReport) -> list[Path]:
    """Segments that nobody writes to, and that nobody has to read for events.

    Raises
    ------
    OptionError
        If events were asked for, and no listener runs that would find the missing ones.
    """
    # Segments that were read for events, if anybody asked for events.
    found = segments(journal)
    place = read_place(journal)
    read = [path for path in found if place is None or place.is_past(path)]

    # A listener goes on reading, and writes to the last one.
    writer = Lock(journal)
    if not writer.acquire():
        complete = [path for path in read if path != found[-1]]
        report.waiting = len(found[:-1]) - len(complete)
        return complete
    writer.release()
    if len(read) < len(found):
        raise OptionError(
            "the listener ended before it found the events of all positions",
            path=str(journal),
            remedy="run gpszip listen with -o or --page again, which finds them; or remove "
            f"{state_path(journal)}, to archive without these events",
        )
    return found


def _batches(paths: Sequence[Path]) -> list[list[Path]]:
    """Gather segments up to a size."""
    batches: list[list[Path]] = []
    size = 0
    for path in paths:
        own = path.stat().st_size
        if not batches or size + own > _MAX_BYTES:
            batches.append([])
            size = 0
        batches[-1].append(path)
        size += own
    return batches


def _roll_batch(
    paths: Sequence[Path],
    target: Path,
    options: Options,
    progress: Listener | None,
    report: RollReport,
) -> None:
    """Append the fixes of some segments, and prove that the archives hold them."""
    # Read them, and leave out what the archives hold.
    tail = Tail()
    fixes, geographic = read_fixes(paths, tail)
    report.damaged += tail.damaged
    if not fixes:
        return
    archives = open_archives(target)
    _check_kind(archives, geographic=geographic)
    unknown = _unknown(archives, fixes)
    report.fixes += _count(fixes)
    report.known += _count(fixes) - _count(unknown)

    # Append to each archive what it can take; a new one with the bound of the first takes the rest.
    options = _with_bound(options, archives, target)
    rest = unknown
    for name, archive in archives:
        near, far = _divide(archive, rest)
        extended = _append(archive, near, options, progress, report) if near else None
        if extended is not None:
            _save(extended, name, report)
            rest = far
    if rest:
        new = next(name for name in archive_names(target) if name not in dict(archives))
        _save(_compress(rest, options, progress, geographic=geographic), new, report)

    # The proof reads the files.
    _prove(open_archives(target), fixes, unknown)


def _with_bound(
    options: Options, archives: Sequence[tuple[Path, Archive]], target: Path
) -> Options:
    """Return options with a bound: one that is given, or that of the first archive.

    Raises
    ------
    OptionError
        If there is neither: the first fixes of a log, when all are parked, say nothing about it.
    """
    if options.max_error is not None:
        return options
    if options.rmse is not None:
        return replace(options, max_error=_MAX_PER_RMSE * options.rmse)
    bound = archives[0][1].error_bound if archives else None
    if bound is None:
        raise OptionError(
            "a new archive needs a bound",
            path=str(target),
            remedy="add --rmse, such as --rmse 5m",
        )
    largest = largest_error(bound)
    return replace(options, rmse=None if bound.maximum else bound.metres, max_error=largest)


def _count(fixes: Fixes) -> int:
    return sum(map(len, fixes.values()))


def _check_kind(archives: Sequence[tuple[Path, Archive]], *, geographic: bool) -> None:
    """Refuse degrees for an archive in metres, and the other way round."""
    for name, archive in archives:
        if (archive.grid.plane is not None) != geographic:
            kinds = ("degrees", "metres") if geographic else ("metres", "degrees")
            raise OptionError(
                f"the journal is in {kinds[0]}, the archive in {kinds[1]}",
                path=str(name),
                remedy="name another archive with --archive",
            )


def _unknown(archives: Sequence[tuple[Path, Archive]], fixes: Fixes) -> Fixes:
    """Return the fixes that no archive holds within its bound."""
    found = {
        agent: each.take(_excesses(archives, agent, each) > 1) for agent, each in fixes.items()
    }
    return {agent: each for agent, each in found.items() if len(each)}


def _excesses(
    archives: Sequence[tuple[Path, Archive]], agent: str, fixes: AgentFixes
) -> NDArray[np.float64]:
    """Error of each fix in the archive that holds it best, as a multiple of its bound."""
    excesses = np.full(len(fixes), np.inf)
    for _, archive in archives:
        limit = largest_error(archive.error_bound)
        # check_archive() has found that there is one.
        assert limit is not None
        distances = distances_to(archive, agent, fixes)
        excesses = np.fmin(excesses, distances / (limit * (1 + _ROUNDING)))
    return excesses


def _divide(archive: Archive, fixes: Fixes) -> tuple[Fixes, Fixes]:
    """Divide fixes into those near an archive's map, and those too far from it."""
    near: Fixes = {}
    far: Fixes = {}
    for agent, each in fixes.items():
        is_near = reachable(archive, each.coordinates)
        for part, rows in ((near, is_near), (far, ~is_near)):
            if rows.any():
                part[agent] = each.take(rows)
    return near, far


def _append(
    archive: Archive,
    fixes: Fixes,
    options: Options,
    progress: Listener | None,
    report: RollReport,
) -> Archive | None:
    """Append fixes to an archive; return None if it can't take them within its bound."""
    from gpszip.pipeline.append import append

    step = step_size(archive.grid.time)
    for margin in _MARGINS:
        parts = _assign(archive, fixes, margin * step)
        tracks = tracks_on(parts, archive.grid.plane, archive.grid.dimension)
        try:
            # The bound is that of the archive.
            own = replace(options, rmse=None, max_error=None)
            extended, _ = append(archive, tracks, own, progress=progress)
        except (BoundError, OptionError):
            continue
        report.late += sum(len(each) for name, each in parts.items() if name not in fixes)
        return extended
    return None


def _assign(archive: Archive, fixes: Fixes, margin: float) -> Fixes:
    """Divide the fixes of all agents among their tracks."""
    # An agent may be called as the second track of another one.
    parts: Fixes = {}
    taken: set[str] = set()
    for agent, each in fixes.items():
        parts |= assign_parts(archive, agent, each, margin, taken)
    return parts


def _compress(
    fixes: Fixes, options: Options, progress: Listener | None, *, geographic: bool
) -> Archive:
    """Make a new archive of fixes."""
    from gpszip.pipeline.compress import compress

    dimension = min(each.coordinates.shape[1] for each in fixes.values())
    tracks = tracks_on(divide_at_breaks(fixes), plane_of(fixes) if geographic else None, dimension)
    return compress(tracks, options, progress=progress)[0]


def _save(archive: Archive, name: Path, report: RollReport) -> None:
    archive.save(name, force=True)
    if str(name) not in report.archives:
        report.archives.append(str(name))


def _prove(archives: Sequence[tuple[Path, Archive]], fixes: Fixes, new: Fixes) -> None:
    """Check that the archives hold all fixes.

    Raises
    ------
    BoundError
        If one is missing, or not within the bound. Then the journal keeps all of them.
    """
    # Every fix.
    for agent, each in fixes.items():
        worst = float(_excesses(archives, agent, each).max())
        if worst > 1:
            raise BoundError(
                f"the archive does not hold all fixes of {agent!r} within its bound",
                remedy="the journal keeps them; please report it",
            )

    # All new ones of each archive together, for the RMSE.
    for name, archive in archives:
        bound, limit = archive.error_bound, largest_error(archive.error_bound)
        if bound is None or limit is None or bound.maximum:
            continue
        distances = [distances_to(archive, agent, each) for agent, each in new.items()]
        held = np.concatenate([*distances, np.zeros(0)])
        held = held[held <= limit * (1 + _ROUNDING)]
        if len(held) and np.sqrt(np.mean(held**2)) > bound.metres * (1 + _ROUNDING):
            raise BoundError("the RMSE of new fixes is beyond the bound", path=str(name))
