"""Columns of a log that an archive keeps within an error, as curves over time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, cast

import numpy as np

from gpszip.archive import Archive
from gpszip.archive.curves import curves_section
from gpszip.archive.joined_curves import curve_part
from gpszip.codec.curves import CurveColumn, CurveSlice, fit_slices
from gpszip.codec.joined_curves import CurvePart, join_columns
from gpszip.container.contents import Section
from gpszip.errors import OptionError
from gpszip.io.logs.raw import HEIGHT, HEIGHT_NAMES
from gpszip.model import Options
from gpszip.model.log import Log, LogTrack, MemoryLog
from gpszip.model.text import count_text
from gpszip.pipeline.memory import knots_of_curves
from gpszip.pipeline.validate import check_names

if TYPE_CHECKING:
    from gpszip.io.large.store import StoredLog

__all__ = ["curve_notes", "curve_sections", "extended_curves"]

#: Metres within which heights are kept that nobody asked for: about the error of barometers, and
#: less than that of receivers.
_HEIGHT_ERROR = 3.0

#: Rows of a log on disk that are read at once, in about 100 bytes each.
_ROWS = 1 << 16

#: Samples of a track among which the first one after a curve in an archive is looked for.
_SAMPLES_NEAR_START = 10_000


def curve_sections(
    log: Log, options: Options, memory: int | None = None
) -> tuple[tuple[Section, ...], tuple[str, ...]]:
    """Encode the columns that are to be kept within an error.

    Parameters
    ----------
    log : Log
        In memory or on disk.
    options : Options
        Whose ``curves`` names the columns; and whether heights are kept unasked.
    memory : int, optional
        Bytes that the process may take.

    Returns
    -------
    tuple of Section
        One section, or none where no column is kept.
    tuple of str
        Notes on heights that are not kept.

    Raises
    ------
    OptionError
        If the log lacks a named column, that can't be kept, or no track has times.
    """
    columns = _named_columns(log, options, memory)
    notes: tuple[str, ...] = ()
    if options.heights:
        heights, notes = _unnamed_heights(log, options, memory)
        columns |= heights
    sections = (curves_section(columns),) if columns else ()
    return sections, notes


def _named_columns(log: Log, options: Options, memory: int | None) -> dict[str, CurveColumn]:
    """Fit the columns that the options name."""
    if not options.curves:
        return {}
    check_names([name for name, _ in options.curves], geographic=log.plane is not None)
    if not any(track.timed for track in log.tracks):
        raise OptionError(
            "the log has no times, over which columns are kept", remedy="leave out --keep"
        )

    # Tracks without times have no curve; tracks that lack a column have one without knots.
    columns = {}
    for name, bound in options.curves:
        if name not in _names(log):
            raise OptionError(
                f"no track has a column {name!r} to keep", remedy="name it when reading: keep"
            )
        columns[name] = _fit(log, name, bound, memory)
    return columns


def _unnamed_heights(
    log: Log, options: Options, memory: int | None
) -> tuple[dict[str, CurveColumn], tuple[str, ...]]:
    """Fit the heights of a log in degrees, if it has any and nobody named them."""
    # Tracks with heights.
    named = (*options.keep, *(name for name, _ in options.curves))
    if HEIGHT in named or log.plane is None or HEIGHT not in _names(log):
        return {}, ()
    slices = list(_slices_with_numbers(log, HEIGHT))
    has_height = {track for track, _ in slices}
    # Such as Google Earth writes for lines on the ground.
    if slices and not any(is_high for _, is_high in slices):
        return {}, ("heights are not kept: all are 0",)

    # Heights of shapes have no time; those beside a size would leave too little for the walks.
    shapes = sum(not log.tracks[track].timed for track in has_height)
    notes: tuple[str, ...] = ()
    if shapes:
        notes = (f"heights of {count_text(shapes, 'track')} without times are not kept",)
    if len(has_height) == shapes or not options.times:
        return {}, notes
    if options.sized:
        return {}, (*notes, f"heights are not kept beside a size: add --keep {HEIGHT}:3m")

    # Heights that can't be kept must not keep a log from being compressed.
    try:
        return {HEIGHT: _fit(log, HEIGHT, _HEIGHT_ERROR, memory)}, notes
    except OptionError as error:
        return {}, (*notes, f"heights are not kept: {error.reason}")


def _slices_with_numbers(log: Log, name: str) -> Iterator[tuple[int, bool]]:
    """Number of the track of each slice with numbers, and whether any is other than 0."""
    for each in _slices(log, name, shapes=True):
        if each.values.dtype.kind in "iuf":
            numbers = each.values[np.isfinite(each.values)]
            if len(numbers):
                yield each.track, bool((numbers != 0).any())


def extended_curves(
    archive: Archive, log: Log, options: Options, memory: int | None = None
) -> tuple[Section, ...]:
    """Encode the columns of an archive within an error, continued by those of a log.

    Parameters
    ----------
    archive : Archive
        The archive that grows.
    log : Log
        What is appended; it may lack columns of the archive.
    options : Options
        Whose ``curves`` names the columns of the archive, and further ones of the log.
    memory : int, optional
        As for :func:`curve_sections`.

    Raises
    ------
    OptionError
        If the log lacks a column that the archive lacks, too, or a column can't be kept.
    """
    if not options.curves:
        return ()
    check_names([name for name, _ in options.curves], geographic=log.plane is not None)
    ids = tuple(dict.fromkeys([*archive.ids, *(track.id for track in log.tracks)]))

    columns = {}
    for name, bound in options.curves:
        # The curves of the log begin after those of the archive.
        old = archive._curve_columns.get(name)
        if old is None and name not in _names(log):
            raise OptionError(
                f"no track has a column {name!r} to keep", remedy="name it when reading: keep"
            )
        new, ends = None, {}
        if name in _names(log):
            ends = _ends_of_curves(archive, old, log, name, bound)
            new = _fit(log, name, bound, memory, step=_step_of(old, bound), ends=ends)

        # Track by track, what was there and what is added.
        parts: dict[str, list[CurvePart]] = {id: [] for id in ids}
        for number, id in enumerate(archive.ids):
            parts[id].append(curve_part(archive, number, old))
        for number, track in enumerate(log.tracks):
            span = _time_range(log, track, ends.get(track.id, -math.inf))
            parts[track.id].append(CurvePart(new, number, *span))
        columns[name] = join_columns([parts[id] for id in ids], name)
    return (curves_section(columns),)


def curve_notes(archive: Archive, log: Log) -> tuple[str, ...]:
    """Say what each curve took, and how many infinite values of the log it leaves out."""
    notes = []
    for name, (bound, size) in archive.curve_sizes.items():
        unit = " m" if name in HEIGHT_NAMES else ""
        note = f"{name} within {bound:g}{unit} at every point: {size:,} B"
        infinite = _count_infinite(log, name)
        if infinite:
            note += f", {count_text(infinite, 'infinite value')} left out"
        notes.append(note)
    return tuple(notes)


def _count_infinite(log: Log, name: str) -> int:
    """Number of infinite values of a column of numbers."""
    if name not in _names(log):
        return 0
    return sum(int(np.isinf(each.values.astype(np.float64)).sum()) for each in _slices(log, name))


def _names(log: Log) -> set[str]:
    """Names of the columns of a log."""
    if isinstance(log, MemoryLog):
        return {name for track in log.tracks for name in track.attributes}
    return {column.name for column in cast("StoredLog", log).columns}


def _fit(
    log: Log,
    name: str,
    bound: float,
    memory: int | None,
    *,
    step: float | None = None,
    ends: Mapping[str, float] | None = None,
) -> CurveColumn:
    """Fit the curves of a column; those of some tracks begin after the end of another curve."""
    known = ends or {}

    def slices() -> Iterator[CurveSlice]:
        for each in _slices(log, name):
            end = known.get(log.tracks[each.track].id)
            if end is None:
                yield each
            else:
                is_new = each.times > end
                yield CurveSlice(each.track, each.times[is_new], each.values[is_new])

    limit = None if memory is None or isinstance(log, MemoryLog) else knots_of_curves(memory)
    return fit_slices(slices, len(log.tracks), bound, name, step=step, max_knots=limit)


def _slices(log: Log, name: str, *, shapes: bool = False) -> Iterator[CurveSlice]:
    """The samples of all tracks with their values; without ``shapes``, only of those with times."""
    if isinstance(log, MemoryLog):
        for number, track in enumerate(log.tracks):
            own = track.attributes.get(name)
            has_values = own is not None and (track.timed or shapes)
            values = np.asarray(own) if has_values else np.full(len(track), np.nan)
            yield CurveSlice(number, track.times, values)
        return

    # Rows of a log on disk, cut where tracks begin.
    stored = cast("StoredLog", log)
    column = next(column for column in stored.columns if column.name == name)
    texts = np.array(column.texts) if column.texts else None
    starts = np.cumsum([0, *(len(track) for track in log.tracks)])
    for first in range(0, int(starts[-1]), _ROWS):
        count = min(_ROWS, int(starts[-1]) - first)
        times = np.concatenate(list(stored.times(first, count)))
        values = np.concatenate(list(column.chunks(first, count)))
        values = values if texts is None else texts[values]
        begin = int(np.searchsorted(starts, first, side="right")) - 1
        end = int(np.searchsorted(starts, first + count))
        for number in range(begin, end):
            rows = slice(max(int(starts[number]) - first, 0), int(starts[number + 1]) - first)
            own = values[rows]
            counts = log.tracks[number].timed or shapes
            yield CurveSlice(number, times[rows], own if counts else np.full(len(own), np.nan))


def _ends_of_curves(
    archive: Archive, old: CurveColumn | None, log: Log, name: str, bound: float
) -> dict[str, float]:
    """Time up to which the archive has the curve of each track that goes on in a log.

    A part of an archive has the line in which it was cut to its end. That line stays where it is
    within the bound of the log's samples, as those of the same log are.
    """
    if old is None:
        return {}
    timed = {track.id for track in log.tracks if track.timed}
    ends, beyond = {}, {}
    for number, id in enumerate(archive.ids):
        if id in timed and len(old.knots[number]):
            last = float(old.knots[number][-1, 1]) / old.unit
            ends[id] = min(curve_part(archive, number, None).end, last)
            if last > ends[id]:
                beyond[id] = old.curve(number)

    # Lines beyond the end of a track, and the samples there.
    for each in _slices(log, name) if beyond else ():
        id = log.tracks[each.track].id
        if id in beyond:
            is_there = (each.times > ends[id]) & (each.times <= beyond[id].times[-1])
            found = beyond[id].at(each.times[is_there])
            if not (np.abs(found - each.values[is_there].astype(np.float64)) <= bound).all():
                del beyond[id]
    return ends | {id: float(curve.times[-1]) for id, curve in beyond.items()}


def _time_range(log: Log, track: LogTrack, end: float) -> tuple[float, float]:
    """Seconds of the first sample of a track after a time, and of its last sample."""
    if not track.timed:
        return 0.0, 0.0
    near = log.read(track, 0, min(_SAMPLES_NEAR_START, len(track))).times
    later = near[near > end]
    begin = float(later[0]) if len(later) else float(np.nextafter(end, math.inf))
    return begin, float(log.read(track, len(track) - 1, len(track)).times[-1])


def _step_of(column: CurveColumn | None, bound: float) -> float | None:
    """A step for a bound that is a multiple of that of a column."""
    if column is None:
        return None
    return column.step * 2.0 ** max(math.floor(math.log2(bound / 2 / column.step)), 0)
