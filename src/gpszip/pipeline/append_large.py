"""Further logs, larger than memory, for an archive that is there already."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, new_archive, with_error_bound
from gpszip.container.columns import Values, as_column
from gpszip.container.contents import Section
from gpszip.container.layout import SectionKind
from gpszip.errors import BoundError, OptionError
from gpszip.geo.gaps import find_gaps
from gpszip.io.large.columns import StoredColumn
from gpszip.io.large.store import StoredLog, StoredTrack
from gpszip.mapping.search import suggest_time_step
from gpszip.model import Listener, Options, ReadResult, Report, Track
from gpszip.pipeline.append import SHARES, completed, grown, last_knot, overlapping
from gpszip.pipeline.compress import asked, holds, report_on
from gpszip.pipeline.compress_large import Job, check_memory, ground_on, stored
from gpszip.pipeline.continue_tracks import end_of, ready_to_continue
from gpszip.pipeline.kept_columns import Times, section_of
from gpszip.run.executor import Executor
from gpszip.walks.error import TIME_SLACK, ErrorSummary

__all__ = ["append_large"]

#: Samples among which the first one after the end of a walk is looked for.
_NEAR = 10_000


def append_large(
    archive: Archive,
    sources: Any,
    options: Options,
    *,
    memory: int,
    executor: Executor | None = None,
    progress: Listener | None = None,
    **reading: Any,
) -> tuple[Archive, Report, ReadResult]:
    """Add logs of any size to an archive in bounded memory.

    Parameters
    ----------
    archive : Archive
        As for :func:`gpszip.pipeline.append.append`.
    sources, options, memory, executor, progress, **reading
        As for :func:`gpszip.pipeline.compress_large.compress_large`.

    Returns
    -------
    Archive, Report, Reading
        The old walks and the new ones; the report is on the new ones, the reading without its tracks.

    Raises
    ------
    OptionError
        If logs and archive don't go together, or memory is too small.
    BoundError
        If the bound can't be held on the archive's lattice.
    """
    start = time.perf_counter()
    check_memory(memory)
    options = completed(options, archive)
    with stored(
        sources, options, memory, archive, executor, progress or (lambda _event: None), **reading
    ) as job:
        extras = _extras(archive, job.log) if options.keep_times else _others(archive)
        both, found = _within_bound(archive, job, extras)
        report = report_on(
            both, found, job.options, job.notes, job.gap, time.perf_counter() - start
        )
        return both, replace(report, tracks=len(job.log.tracks)), job.log.read_result


def _within_bound(
    archive: Archive, job: Job, extras: tuple[Section, ...]
) -> tuple[Archive, ErrorSummary]:
    silent = [find_gaps(track, job.gap) for track in job.excerpt]
    starts = {
        track.id: float(job.log.read(track, 0, 1).times[0])
        for track in job.log.tracks
        if track.id in archive.ids
    }
    archive = ready_to_continue(
        archive, starts, suggest_time_step(job.excerpt, silent, archive.grid.space)
    )
    led = _LedOn(archive, job.log, job.gap)
    bound = asked(job.options)
    for share in SHARES:
        try:
            ground = ground_on(archive, job, job.aim.tightened(share))
            grid_walks = job.lay(led, ground)
        except BoundError:
            break
        on_map = new_archive(
            ground.grid,
            [track.id for track in led.tracks],
            grid_walks,
            known_map=archive,
            refinements=ground.refinements,
            spans=job.spans,
        )
        both = grown(archive, with_error_bound(on_map, bound), job.gap, job.sampling, extras)
        found = job.measure(both)
        if holds(found, job.aim):
            return both, found
    raise BoundError(
        "the archive's lattice is too coarse for this bound; allow a larger error, or compress all logs together"
    )


class _LedOn:
    """A log whose tracks begin where an archive's walks of their names end, unless there is a gap between them."""

    def __init__(self, archive: Archive, log: StoredLog, gap: float) -> None:
        self._log, self._leads, self._own = (
            log,
            dict[str, Track](),
            {track.id: track for track in log.tracks},
        )
        self.tracks = tuple(
            self._led(archive, track, gap) if track.id in archive.ids else track
            for track in log.tracks
        )

    def read(self, track: StoredTrack, first: int = 0, last: int | None = None) -> Track:
        """Samples of a track, of which the first may be where the archive's walk ends."""
        last = track.count if last is None else last
        lead = self._leads.get(track.id)
        if lead is None:
            return self._log.read(track, first, last)
        # the lead stands where the last of the samples that it replaces was
        found = self._log.read(track, max(first, 1), last) if last > 1 else None
        if first > 0 and found is not None:
            return found
        parts = [lead] if found is None else [lead, found]
        times, places = (
            np.concatenate([part.times for part in parts]),
            np.concatenate([part.positions for part in parts]),
        )
        return Track(track.id, times, places, plane=self._log.plane)

    def _led(self, archive: Archive, track: StoredTrack, gap: float) -> StoredTrack:
        end, there = last_knot(archive, track.id)
        near = self._log.read(track, 0, min(_NEAR, track.count))
        if near.times[0] - end > gap:
            return track
        after = int(np.searchsorted(near.times, end, side="right"))
        if near.times[0] < end_of(archive, track.id) - TIME_SLACK or after == len(near):
            raise overlapping(track.id)
        self._leads[track.id] = Track(track.id, np.array([end]), there, plane=self._log.plane)
        return StoredTrack(track.id, track.offset + after - 1, track.count - after + 1)


def _others(archive: Archive) -> tuple[Section, ...]:
    return tuple(
        section for section in archive.contents.extras if section.kind != SectionKind.ATTRIBUTES
    )


def _extras(archive: Archive, log: StoredLog) -> tuple[Section, ...]:
    """Sections of an archive, its kept columns with those of a log."""
    added = {track.id: track for track in log.tracks}
    ids = tuple(dict.fromkeys([*archive.ids, *added]))
    there = {name: archive.sample_times(name) for name in archive.ids}
    counts = [
        len(there.get(name, ())) + (added[name].count if name in added else 0) for name in ids
    ]
    instants = _chained("t", ids, there, added, Times(log))
    columns = {
        column.name: _chained(
            column.name,
            ids,
            {name: archive.attributes(name)[column.name] for name in archive.ids},
            added,
            column,
        )
        for column in log.columns
    }
    return (*_others(archive), section_of(counts, instants, columns))


@dataclass(frozen=True, eq=False)
class _Chain:
    """A column of what an archive keeps and a log adds, track by track."""

    kind: str
    texts: tuple[str, ...]
    parts: tuple[Callable[[], Iterable[Values]], ...]

    def chunks(self) -> Iterator[Values]:
        """Yield the values from the first on."""
        for part in self.parts:
            yield from part()


def _chained(
    name: str,
    ids: Sequence[str],
    there: Mapping[str, Values],
    added: Mapping[str, StoredTrack],
    column: StoredColumn | Times,
) -> _Chain:
    before = as_column(name, np.concatenate(list(there.values())))
    if (before.kind == "U") != (column.kind == "U"):
        raise OptionError(
            f"column {name!r} holds texts here and numbers there; numbers or texts can be kept, but not both"
        )
    texts = tuple(sorted({*before.texts, *column.texts}))
    number = {text: i for i, text in enumerate(texts)}
    ours, theirs = (
        np.array([number[text] for text in one.texts], np.int64) if texts else None
        for one in (before, column)
    )
    whole = np.concatenate([np.zeros(0, np.int64), *before.chunks()])
    whole = whole if ours is None else ours[whole]
    first, parts = 0, list[Callable[[], Iterable[Values]]]()
    for one in ids:
        if one in there:
            parts.append(partial(_slice, whole, first, first + len(there[one])))
            first += len(there[one])
        if one in added:
            parts.append(partial(_stored, column, added[one], theirs))
    return _Chain(max(before.kind, column.kind, key="ifU".index), texts, tuple(parts))


def _slice(values: Values, first: int, last: int) -> Iterable[Values]:
    return (values[first:last],)


def _stored(
    column: StoredColumn | Times, track: StoredTrack, numbers: NDArray[np.int64] | None
) -> Iterator[Values]:
    for values in column.chunks(track.offset, track.count):
        yield values if numbers is None else numbers[values]
