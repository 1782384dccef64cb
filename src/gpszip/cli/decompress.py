"""gpszip decompress: from an archive back to a log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.options import (
    Settings,
    archive_argument,
    common_options,
    force,
    map_option,
    output_option,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import DURATION

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import Track

__all__ = ["command"]


@click.command("decompress", short_help="Write the tracks of an archive as a log.")
@archive_argument
@map_option
@output_option("walks.csv")
@click.option(
    "--every",
    type=DURATION,
    metavar="DURATION",
    help="Positions at each multiple of this, such as 1s, instead of knots.",
)
@click.option(
    "--at",
    metavar="TIMES",
    help="Positions at these times: 10,20.5,30, or a file with one time in each line.",
)
@click.option(
    "--samples",
    is_flag=True,
    help="Positions at the log's own times with the columns that --keep has kept.",
)
@click.option("--track", metavar="ID", help="Only this track.")
@click.option(
    "--format",
    "kind",
    metavar="FORMAT",
    help="Instead of the output's suffix: csv, gpx, geojson or parquet.",
)
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    archive: str,
    target: str,
    every: float | None,
    at: str | None,
    samples: bool,
    track: str | None,
    kind: str | None,
    map_name: str | None,
    force: bool,
) -> Outcome:
    """Write the tracks of ARCHIVE as CSV, GPX, GeoJSON or Parquet: the knots, between which each track is linear in time."""
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import check_output, print_json, print_status
    from gpszip.cli.times import parse_times
    from gpszip.errors import OptionError
    from gpszip.io.logs.formats import format_for_writing
    from gpszip.io.logs.track_rows import metre_decimals
    from gpszip.io.logs.write import write_tracks
    from gpszip.model.error_bound import writing_error

    given = [
        name
        for name, wanted in (
            ("--every", every is not None),
            ("--at", at is not None),
            ("--samples", samples),
        )
        if wanted
    ]
    if len(given) > 1:
        raise OptionError(f"{given[0]} and {given[1]} were both given; give one")
    times = None if at is None else parse_times(at)
    chosen = format_for_writing(target, kind)
    check_output(target, force=force, binary=chosen.is_binary)
    with open_archive_file(archive, map_name) as source:
        tracks = (
            _read_samples(source, track) if samples else _read_tracks(source, every, times, track)
        )
        pieces, flat = (None if samples else source.pieces), source.grid.plane is None
        error = writing_error(source.error_bound, geographic=not flat)
        shapes = (
            source.untimed if track is None and (every is not None or times is not None) else ()
        )
    if not tracks:
        raise OptionError(_explain_empty(archive, track))
    points = write_tracks(
        tracks,
        target,
        kind,
        decimals=metre_decimals(error),
        pieces=pieces,
        max_deviation=None if given else error,
    )
    if shapes:
        left = (
            f"{len(shapes):,} track{'s' * (len(shapes) > 1)} without times, such as {shapes[0]!r}"
        )
        print_status(
            f"gpszip: left out {left}; decompress without --at or --every for their shapes"
        )
    for warning in _format_warnings(tracks, pieces or {}, chosen.name):
        print_status(f"gpszip: {warning}")
    if settings.json:
        print_json({"output": target, "pieces": len(tracks), "points": points}, err=target == "-")
    elif target != "-":
        print_status(
            f"{target}: {points:,} {'positions' if given else 'knots'}, pieces {len(tracks):,}"
        )
    return Outcome.DONE


def _read_samples(archive: Archive, track: str | None) -> list[Track]:
    from gpszip.errors import OptionError

    if archive.kept_columns is None:
        raise OptionError(
            "--samples: the archive keeps no times of points; compress the log with --keep-times or --keep"
        )
    return archive.samples(track)


def _format_warnings(tracks: list[Track], pieces: Mapping[str, str], form: str) -> list[str]:
    """What a format can't hold as it is, in words."""
    from gpszip.io.logs.gpx.write import has_unwritable_letters
    from gpszip.io.logs.raw import HEIGHT_NAMES

    if form != "gpx":
        return []
    heights = [name for name in HEIGHT_NAMES if name in tracks[0].attributes]
    lacking = [name for name in tracks[0].attributes if name not in heights[:1]]
    words = (
        [f"gpx has no room for {', '.join(lacking)}; write CSV, GeoJSON or Parquet to have them"]
        if lacking
        else []
    )
    if changed := [
        name
        for name in dict.fromkeys(pieces.get(track.id, track.id) for track in tracks)
        if has_unwritable_letters(name)
    ]:
        words.append(
            f"gpx can't hold control characters: they are U+FFFD in the names of tracks, in {len(changed):,} of them, "
            f"the first {changed[0]!r}; write GeoJSON or Parquet to have them"
        )
    return words


def _read_tracks(
    archive: Archive, every: float | None, times: Any, track: str | None
) -> list[Track]:
    if every is None and times is None:
        pieces, owners = archive.decompress(), archive.pieces
        return (
            pieces
            if track is None
            else [piece for piece in pieces if track in (piece.id, owners[piece.id])]
        )
    return archive.sample(every, at=times, track=track)


def _explain_empty(archive: str, track: str | None) -> str:
    if track is None:
        return f"{archive}: no travel is claimed at any of these times; gpszip info --detail shows the time range"
    return f"{archive}: nothing of a track {track!r}; gpszip info lists the tracks"
