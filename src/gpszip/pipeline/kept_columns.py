"""Columns of a log that an archive keeps exactly, beside its walks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.container.attributes import write_attributes
from gpszip.container.columns import Column, Values, as_column
from gpszip.container.contents import Section
from gpszip.container.layout import CURVE_KINDS, SectionKind
from gpszip.errors import OptionError
from gpszip.lossless.kept import smaller_section
from gpszip.model import Options, Track
from gpszip.model.log import Log, MemoryLog
from gpszip.pipeline.spooled_section import spooled_section
from gpszip.pipeline.validate import check_names

if TYPE_CHECKING:
    from gpszip.io.large.columns import StoredColumn
    from gpszip.io.large.store import StoredLog

__all__ = ["extended_sections", "kept_sections"]


#: Values up to which columns are coded in memory, in about 100 bytes each.
_MAX_CODED = 1 << 21


@dataclass(frozen=True, eq=False)
class _Times:
    """Timestamps of all samples of a log on disk, as a column."""

    log: StoredLog
    kind: str = "f"
    texts: tuple[str, ...] = ()

    def chunks(self, first: int = 0, count: int | None = None) -> Iterator[NDArray[np.float64]]:
        """Yield ``count`` timestamps from a sample on, in pieces."""
        return self.log.times(first, count)


@dataclass(frozen=True, eq=False)
class _Chained:
    """A column made of fragments that are read one after the other."""

    kind: str
    texts: tuple[str, ...]
    fragments: tuple[Callable[[], Iterable[Values]], ...]

    def chunks(self) -> Iterator[Values]:
        """Yield the values from the first on, in pieces."""
        for fragment in self.fragments:
            yield from fragment()


def kept_sections(log: Log, options: Options) -> tuple[Section, ...]:
    """Encode the columns that are to be kept; nothing where none are.

    Raises
    ------
    OptionError
        If the log lacks a column, a column can't be kept, or a track has no times.
    """
    if not (options.keep or options.keep_times):
        return ()
    check_names(options.keep, geographic=log.plane is not None)
    _refuse_shapes(log)
    if isinstance(log, MemoryLog):
        _check_tracks(log.tracks, options.keep)

    columns = _columns(log, options.keep)
    times = columns.pop("t")
    return (_section([len(track) for track in log.tracks], times, columns),)


def extended_sections(archive: Archive, log: Log, options: Options) -> tuple[Section, ...]:
    """Sections of an archive but curves, its kept columns extended by those of a log.

    Parameters
    ----------
    archive : Archive
        The archive that grows.
    log : Log
        What is appended.
    options : Options
        Whose ``keep`` names the columns of the archive.
    """
    # Leave all other sections as they are; without times of samples there are no columns.
    replaced = {SectionKind.ATTRIBUTES, SectionKind.CODED_ATTRIBUTES, *CURVE_KINDS}
    others = tuple(each for each in archive.contents.extras if each.kind not in replaced)
    if not options.keep_times:
        return others
    _refuse_shapes(log)
    if isinstance(log, MemoryLog):
        _check_tracks(log.tracks, options.keep)

    # Tracks of the archive keep their order; new ones follow.
    ids = tuple(dict.fromkeys([*archive.ids, *(track.id for track in log.tracks)]))
    number = {track.id: i for i, track in enumerate(log.tracks)}
    old: dict[str, dict[str, Values]] = {
        "t": {name: archive.sample_times(name) for name in archive.ids}
    }
    for column in options.keep:
        old[column] = {name: archive.attributes(name)[column] for name in archive.ids}

    # Each column is that of the archive and that of the log, track by track.
    columns = {
        name: _chained(name, ids, old[name], number, values, log)
        for name, values in _columns(log, options.keep).items()
    }
    counts = [
        len(old["t"].get(name, ())) + (len(log.tracks[number[name]]) if name in number else 0)
        for name in ids
    ]
    times = columns.pop("t")
    return (*others, _section(counts, times, columns))


def _columns(log: Log, names: Sequence[str]) -> dict[str, Column]:
    """Times, as column ``t``, and the named columns of a log."""
    if isinstance(log, MemoryLog):
        arrays = {
            name: np.concatenate([track.attributes[name] for track in log.tracks]) for name in names
        }
        times = np.concatenate([track.times for track in log.tracks])
        return {name: as_column(name, values) for name, values in {"t": times, **arrays}.items()}
    stored_log = cast("StoredLog", log)
    stored = {column.name: column for column in stored_log.columns}
    return {"t": _Times(stored_log), **{name: stored[name] for name in names}}


def _chained(
    name: str,
    ids: Sequence[str],
    old: Mapping[str, Values],
    number: Mapping[str, int],
    column: Column,
    log: Log,
) -> _Chained:
    """A column of an archive followed, in each track, by that of a log."""
    # Refuse a column that holds texts on one side and numbers on the other.
    before = as_column(name, np.concatenate(list(old.values())))
    if (before.kind == "U") != (column.kind == "U"):
        raise OptionError(
            f"column {name!r} holds texts here and numbers there",
            remedy="numbers or texts can be kept, but not both",
        )

    # Texts are stored as numbers into one common list.
    texts = tuple(sorted({*before.texts, *column.texts}))
    code = {text: i for i, text in enumerate(texts)}
    old_codes, new_codes = (
        np.array([code[text] for text in each.texts], np.int64) if texts else None
        for each in (before, column)
    )
    old_values = np.concatenate([np.zeros(0, np.int64), *before.chunks()])
    old_values = old_values if old_codes is None else old_codes[old_values]

    # The fragments of each track: what was there, then what is added.
    read_new = _reader(log, column, new_codes)
    starts = np.cumsum([0, *(len(track) for track in log.tracks)]).tolist()
    first = 0
    fragments: list[Callable[[], Iterable[Values]]] = []
    for track in ids:
        if track in old:
            after = first + len(old[track])
            fragments.append(partial(_slice, old_values, first, after))
            first = after
        if track in number:
            begin, end = starts[number[track]], starts[number[track] + 1]
            fragments.append(partial(read_new, begin, end))
    return _Chained(max(before.kind, column.kind, key="ifU".index), texts, tuple(fragments))


def _slice(values: Values, first: int, after: int) -> Iterable[Values]:
    return (values[first:after],)


def _reader(
    log: Log, column: Column, codes: NDArray[np.int64] | None
) -> Callable[[int, int], Iterable[Values]]:
    """Return a function that reads rows of a column, texts as numbers into the common list."""
    if isinstance(log, MemoryLog):
        values = np.concatenate([np.zeros(0, np.int64), *column.chunks()])
        return partial(_slice, values if codes is None else codes[values])
    return partial(_stored_rows, cast("StoredColumn", column), codes)


def _stored_rows(
    column: StoredColumn | _Times, codes: NDArray[np.int64] | None, first: int, after: int
) -> Iterator[Values]:
    for values in column.chunks(first, after - first):
        yield values if codes is None else codes[values]


def _section(counts: Sequence[int], times: Column, columns: Mapping[str, Column]) -> Section:
    """Encode columns of any length; a large section stays in a temporary file."""
    section = spooled_section(
        SectionKind.ATTRIBUTES, lambda sink: write_attributes(counts, times, columns, sink)
    )
    # Columns too many for memory stay as they are.
    if isinstance(section.body, bytes) and sum(counts) * (1 + len(columns)) <= _MAX_CODED:
        return Section(*smaller_section(section.body, len(counts)))
    return section


def _refuse_shapes(log: Log) -> None:
    """Refuse tracks that lack times."""
    untimed = next((track for track in log.tracks if not track.timed), None)
    if untimed is not None:
        raise OptionError(
            f"track {untimed.id!r} has no times, by which columns are kept",
            remedy="leave out --keep and --keep-times (keep)",
        )


def _check_tracks(tracks: Sequence[Track], names: Sequence[str]) -> None:
    """Refuse tracks that lack one of the columns."""
    for name in names:
        lacking = next((track for track in tracks if name not in track.attributes), None)
        if lacking is not None:
            present = ", ".join(lacking.attributes) or "none; name it when reading: keep"
            raise OptionError(
                f"track {lacking.id!r} has no column {name!r} to keep", remedy=f"it has {present}"
            )
