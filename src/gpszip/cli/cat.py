"""gpszip cat: print the points of an archive."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import Settings, archive_argument, common_options, map_option
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, selection_options
from gpszip.cli.units import DURATION

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import Track
    from gpszip.model.selection import Selection

__all__ = ["command"]


@click.command("cat", cls=CommandWithFormats, short_help="Print the points of an archive.")
@archive_argument
@map_option
@click.option(
    "--every",
    type=DURATION,
    metavar="DURATION",
    help="Print positions at each multiple of this, such as 1s, instead of knots.",
)
@selection_options
@click.option(
    "--format",
    "kind",
    metavar="FORMAT",
    default="csv",
    show_default=True,
    help="Format: WRITTEN_LOG_FORMATS.",
)
@common_options
@click.pass_obj
def command(
    _: Settings,
    /,
    archive: str,
    every: float | None,
    kind: str,
    map_name: str | None,
    **selecting: Any,
) -> Outcome:
    """Print the points of ARCHIVE on standard output, group by group of its tracks.

    It begins to print before all is decoded. gpszip decompress has more options and writes files.
    """
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import STDOUT, check_output
    from gpszip.io.logs.formats import format_for_writing
    from gpszip.io.logs.track_rows import metre_decimals
    from gpszip.io.logs.write import write_tracks
    from gpszip.model.error_bound import writing_error

    # Refuse what can be refused before the archive is read.
    selection = pop_selection(selecting)
    check_output(STDOUT, force=False, binary=format_for_writing(STDOUT, kind).is_binary)

    # Print.
    with open_archive_file(archive, map_name) as source:
        error = writing_error(source.error_bound, geographic=source.grid.plane is not None)
        owners: dict[str, str] = {}
        write_tracks(
            _points(source, selection, every, owners),
            STDOUT,
            kind,
            decimals=metre_decimals(error),
            pieces=owners,
            max_deviation=error if every is None else None,
        )
    return Outcome.DONE


def _points(
    archive: Archive, selection: Selection, every: float | None, owners: dict[str, str]
) -> Iterator[Track]:
    """Yield pieces of what is selected; note in ``owners`` of which track each is."""
    from gpszip.archive.select import iterate_selection

    for pieces, own in iterate_selection(archive, selection):
        owners.update(own)
        for piece in pieces:
            if every is None:
                yield piece
            elif piece.timed:
                yield from archive.with_curves(own[piece.id], list(_sample(piece, every)))


def _sample(piece: Track, every: float) -> Iterator[Track]:
    """Yield a piece at the multiples of a duration; nothing if it lies between two of them."""
    import math

    import numpy as np

    from gpszip.model import Track

    first, last = math.ceil(piece.times[0] / every), math.floor(piece.times[-1] / every)
    if first > last:
        return
    times = np.arange(first, last + 1) * every
    axes = [np.interp(times, piece.times, axis) for axis in piece.positions.T]
    yield Track(piece.id, times, np.stack(axes, axis=1), plane=piece.plane)
