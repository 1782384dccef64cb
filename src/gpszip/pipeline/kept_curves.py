"""Columns of a log that an archive keeps within an error, as curves over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpszip.archive import Archive
from gpszip.archive.curves import encode_curves
from gpszip.codec.curves import fit_column
from gpszip.container.contents import Section
from gpszip.container.layout import SectionKind
from gpszip.errors import OptionError
from gpszip.model import Options, Track
from gpszip.model.log import Log, MemoryLog
from gpszip.model.text import count_text
from gpszip.pipeline.validate import check_names

__all__ = ["curve_notes", "curve_sections", "refuse_curves"]


def curve_sections(log: Log, options: Options) -> tuple[Section, ...]:
    """Encode the columns that are to be kept within an error; nothing where none are.

    Raises
    ------
    OptionError
        If the log lacks a column or has it on disk, a column can't be kept, or no track has times.
    """
    if not options.curves:
        return ()
    check_names([name for name, _ in options.curves], geographic=log.plane is not None)
    if not isinstance(log, MemoryLog):
        raise OptionError(
            "columns can be kept within an error only of logs that fit the memory",
            remedy="keep them exactly, such as --keep ele, or allow more --memory",
        )

    # Tracks without times have no curve; tracks that lack a column have one without knots.
    timed = [track.timed for track in log.tracks]
    if not any(timed):
        raise OptionError(
            "the log has no times, over which columns are kept", remedy="leave out --keep"
        )
    columns = {}
    for name, bound in options.curves:
        if not any(name in track.attributes for track in log.tracks):
            raise OptionError(
                f"no track has a column {name!r} to keep", remedy="name it when reading: keep"
            )
        values = [
            track.attributes[name]
            if name in track.attributes and track.timed
            else np.full(len(track), np.nan)
            for track in log.tracks
        ]
        columns[name] = fit_column([track.times for track in log.tracks], values, bound, name)
    return (Section(SectionKind.CURVES, encode_curves(columns)),)


def curve_notes(archive: Archive, log: Log) -> tuple[str, ...]:
    """Say what each curve took, and how many infinite values of the log it leaves out."""
    notes = []
    for name, (bound, size) in archive.curve_sizes.items():
        note = f"{name} within {bound:g} at every point: {size:,} B"
        infinite = _count_infinite(log.tracks, name)
        if infinite:
            note += f", {count_text(infinite, 'infinite value')} left out"
        notes.append(note)
    return tuple(notes)


def _count_infinite(tracks: Sequence[Track], name: str) -> int:
    """Number of infinite values of a column of numbers."""
    columns = [track.attributes[name] for track in tracks if name in track.attributes]
    return sum(int(np.isinf(values.astype(np.float64)).sum()) for values in columns)


def refuse_curves(archives: Sequence[Archive], what: str) -> None:
    """Refuse archives with curves where they can't be kept.

    Raises
    ------
    OptionError
        If an archive keeps columns within an error.
    """
    for archive in archives:
        if archive.curve_sizes:
            names = ", ".join(archive.curve_sizes)
            raise OptionError(
                f"an archive keeps {names} within an error, which {what} can't continue",
                remedy="compress all logs together, or keep the columns exactly",
            )
