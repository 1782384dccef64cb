"""Curves of several archives in one section."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gpszip.container.contents import Section
from gpszip.errors import OptionError

if TYPE_CHECKING:
    from gpszip.archive.archive import Archive
    from gpszip.codec.curves import CurveColumn
    from gpszip.codec.joined_curves import CurvePart

__all__ = ["curve_part", "join_curves"]


def join_curves(
    archives: Sequence[Archive], tracks: Sequence[Sequence[tuple[int, int]]]
) -> tuple[Section, ...]:
    """Join the curves of archives; nothing where no archive has any.

    Parameters
    ----------
    archives : sequence of Archive
        Tracks of those without a column have no values in it.
    tracks : sequence of sequence of (int, int)
        For each track of the result, numbers of archives and of their tracks, in any order.

    Raises
    ------
    OptionError
        If a column is kept exactly in one archive and within an error in another.
    """
    names = dict.fromkeys(name for archive in archives for name in archive.curve_sizes)
    if not names:
        return ()
    _refuse_exact(archives, list(names))
    from gpszip.archive.curves import curves_section
    from gpszip.codec.joined_curves import join_columns

    columns = {}
    for name in names:
        own = [archive._curve_columns.get(name) for archive in archives]
        parts = [
            [curve_part(archives[source], number, own[source]) for source, number in track]
            for track in tracks
        ]
        columns[name] = join_columns(parts, name)
    return (curves_section(columns),)


def curve_part(archive: Archive, number: int, column: CurveColumn | None) -> CurvePart:
    """The curve of a track in one of the archive's columns, from its first sample to its last."""
    from gpszip.codec.joined_curves import CurvePart

    walk = archive.walks[number]
    if walk.times is None:
        return CurvePart(None, number, 0.0, 0.0)
    ranges = walk.times[[0, -1]] if walk.time_ranges is None else walk.time_ranges.ravel()[[0, -1]]
    return CurvePart(column, number, float(ranges[0]), float(ranges[1]))


def _refuse_exact(archives: Sequence[Archive], names: Sequence[str]) -> None:
    """Refuse columns that one archive keeps exactly and another one within an error."""
    for archive in archives:
        for name in archive.kept_columns or ():
            if name in names:
                raise OptionError(
                    f"one archive keeps {name!r} exactly, another one within an error",
                    remedy="keep the archives apart, or compress the logs anew in one of both ways",
                )
