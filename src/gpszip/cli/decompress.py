"""gpszip decompress: write the tracks of an archive as a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import (
    Settings,
    archive_argument,
    common_options,
    force,
    map_option,
    output_name,
    output_option,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, select_from, selection_options
from gpszip.cli.units import DURATION, LENGTH

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gpszip.archive import Archive
    from gpszip.io.logs.log_format import LogFormat
    from gpszip.model import Track
    from gpszip.model.selection import Selection

__all__ = ["command"]


@click.command(
    "decompress", cls=CommandWithFormats, short_help="Write the tracks of an archive as a log."
)
@archive_argument
@map_option
@output_option("walks.csv", default="the name of ARCHIVE with .csv")
@click.option(
    "--every",
    type=DURATION,
    metavar="DURATION",
    help="Write positions at each multiple of this, such as 1s, instead of knots.",
)
@click.option(
    "--at",
    metavar="TIMES",
    help="Write positions at these times: 10,20.5,30, or a file with one time a line.",
)
@click.option(
    "--samples",
    is_flag=True,
    help="Write positions at the log's own times, with the columns that --keep kept.",
)
@click.option(
    "--exact",
    is_flag=True,
    help="Write the logs that --lossless kept, byte by byte; several go into the folder -o.",
)
@click.option("--log", "log_name", metavar="NAME", help="With --exact: only the log of this name.")
@click.option(
    "--columns",
    "column_names",
    metavar="NAME,...",
    help="With --exact: only these columns of the log, such as ele,hr; with --track, only rows of "
    "that track. Other columns and tracks are not decoded.",
)
@click.option(
    "--blur",
    type=LENGTH,
    metavar="LENGTH",
    help="Leave out what lies in circles of this radius about places where a track stayed, to "
    "share the rest.",
)
@click.option(
    "--drop-ends",
    type=LENGTH,
    metavar="LENGTH",
    help="Leave out what lies within this distance of where each track begins and ends.",
)
@selection_options
@click.option(
    "--format",
    "kind",
    metavar="FORMAT",
    help="Format instead of the one of the output's suffix: WRITTEN_LOG_FORMATS.",
)
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    archive: str,
    target: str | None,
    every: float | None,
    at: str | None,
    samples: bool,
    exact: bool,
    log_name: str | None,
    column_names: str | None,
    blur: float | None,
    drop_ends: float | None,
    kind: str | None,
    map_name: str | None,
    force: bool,
    **selecting: Any,
) -> Outcome:
    """Write the tracks of ARCHIVE in one of the formats WRITTEN_LOG_FORMATS.

    The points are knots, between which each track is linear in time. A track that leaves the area
    of --bbox and comes back has a gap in between.
    """
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import check_output, print_json, print_status
    from gpszip.cli.times import parse_times
    from gpszip.errors import OptionError
    from gpszip.io.logs.formats import format_for_writing
    from gpszip.io.logs.track_rows import metre_decimals
    from gpszip.io.logs.write import write_tracks
    from gpszip.model.error_bound import writing_error

    # Refuse what can be refused before the archive is read.
    at_times = _find_times_option(every, at, samples)
    selection = pop_selection(selecting)
    hides = "--blur" if blur is not None else "--drop-ends" if drop_ends is not None else None
    if exact:
        _check_exact_options(at_times, selection, kind, hides)
        if selection.tracks or column_names is not None:
            chosen = (selection.tracks, column_names, log_name)
            return _write_rows(settings, archive, target, *chosen, force=force)
        return _write_exact(settings, archive, target, log_name, force=force)
    _refuse_without_exact({"--log": log_name, "--columns": column_names})
    target = output_name(target, [archive], ".csv", "walks.csv")
    times = None if at is None else parse_times(at)
    log_format = format_for_writing(target, kind)
    check_output(target, force=force, binary=log_format.is_binary)

    # Read.
    untimed: Sequence[str] = ()
    with open_archive_file(archive, map_name) as whole:
        # Decode within the block, which names the archive where it is damaged.
        pieces: Mapping[str, str] | None = None
        source = _select_at_times(whole, selection) if at_times else whole
        if samples:
            tracks = _read_samples(source)
        elif at_times:
            tracks, pieces = source.sample(every, at=times), source.pieces
        else:
            tracks, pieces = _read_knots(source, selection)
        if hides is not None:
            tracks, pieces = _hide(whole, tracks, pieces, blur, drop_ends, sampled=bool(at_times))
        error = writing_error(source.error_bound, geographic=source.grid.plane is not None)
        if not selection.tracks and (every is not None or times is not None):
            untimed = source.untimed
    if not tracks:
        raise OptionError(_explain_empty(archive, hides))

    # Write.
    # Between knots a track is straight on the plane, and a reader of the file takes it as straight
    # in degrees: where these differ by more than the error, rows are added.
    points = write_tracks(
        tracks,
        target,
        kind,
        decimals=metre_decimals(error),
        pieces=pieces,
        max_deviation=None if at_times else error,
    )

    # Say what was written, and what could not be.
    if untimed:
        noun = "track" if len(untimed) == 1 else "tracks"
        print_status(
            f"gpszip: left out {len(untimed):,} {noun} without times, such as {untimed[0]!r}; "
            "decompress without --at or --every for their shapes"
        )
    for warning in _format_warnings(log_format, tracks, pieces or {}):
        print_status(f"gpszip: {warning}")
    if settings.json:
        print_json({"output": target, "pieces": len(tracks), "points": points}, err=target == "-")
    elif target != "-":
        noun = "positions" if at_times else "knots"
        print_status(f"{target}: {points:,} {noun}, pieces {len(tracks):,}")
    return Outcome.DONE


def _refuse_without_exact(options: Mapping[str, str | None]) -> None:
    """Refuse options that name parts of logs that are kept exactly."""
    from gpszip.errors import OptionError

    for option, value in options.items():
        if value is not None:
            raise OptionError(f"{option} names what is kept exactly", remedy="add --exact")


def _check_exact_options(
    at_times: str | None, selection: Selection, kind: str | None, hides: str | None
) -> None:
    """Refuse options that choose or change points."""
    from gpszip.errors import OptionError

    options = {
        at_times: at_times is not None,
        "--since or --until": selection.has_times,
        "--bbox": selection.bbox is not None,
        "--format": kind is not None,
        hides: hides is not None,
    }
    for option, is_given in options.items():
        if is_given:
            raise OptionError(f"--exact and {option} were both given", remedy="give one")
    if len(selection.tracks) > 1:
        raise OptionError(
            f"--exact and {len(selection.tracks)} tracks were given", remedy="give one --track"
        )


def _write_exact(
    settings: Settings, archive: str, target: str | None, log_name: str | None, *, force: bool
) -> Outcome:
    """Write the logs that the archive keeps byte by byte."""
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import print_json, print_status
    from gpszip.pipeline.exact_logs import exact_logs, find_log, write_logs

    with open_archive_file(archive) as source:
        logs = exact_logs(source)
        numbers = range(len(logs.logs)) if log_name is None else [find_log(logs, log_name)]
        written = write_logs(logs, numbers, target, force=force)
    if settings.json:
        print_json({"output": target, "logs": len(written)}, err=target == "-")
    elif target != "-":
        for path, size in written.items():
            print_status(f"{path}: {size:,} bytes")
    return Outcome.DONE


def _write_rows(
    settings: Settings,
    archive: str,
    target: str | None,
    tracks: Sequence[str],
    columns: str | None,
    log_name: str | None,
    *,
    force: bool,
) -> Outcome:
    """Write rows and columns of the logs that the archive keeps byte by byte."""
    from gpszip.archive.exact_rows import choose_rows
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import print_json, print_status
    from gpszip.cli.units import format_count
    from gpszip.errors import OptionError
    from gpszip.pipeline.exact_logs import write_rows

    names = None if columns is None else [name.strip() for name in columns.split(",")]
    track = tracks[0] if tracks else None
    with open_archive_file(archive) as source:
        chosen = choose_rows(source, track, names, log_name)
        target = output_name(target, [archive], chosen.suffix, f"rows{chosen.suffix}")
        if chosen.suffix == ".parquet" and target.endswith((".csv", ".txt", ".tsv")):
            raise OptionError(
                "rows of Parquet are written as Parquet", remedy="name the output .parquet"
            )
        if chosen.suffix == ".csv" and target.endswith(".parquet"):
            raise OptionError("rows of text are written as text", remedy="name the output .csv")
        rows, size = write_rows(chosen, target, force=force)
    if settings.json:
        facts = {"output": target, "logs": len(chosen.numbers), "rows": rows, "bytes": size}
        print_json(facts, err=target == "-")
    elif target != "-":
        print_status(f"{target}: {format_count(rows, 'row')}, {size:,} bytes")
    return Outcome.DONE


def _find_times_option(every: float | None, at: str | None, samples: bool) -> str | None:
    """Return the option that asks for positions at certain times; None for knots."""
    from gpszip.errors import OptionError

    wanted = {"--every": every is not None, "--at": at is not None, "--samples": samples}
    given = [name for name, is_given in wanted.items() if is_given]
    if len(given) > 1:
        raise OptionError(f"{given[0]} and {given[1]} were both given", remedy="give one")
    return given[0] if given else None


def _select_at_times(archive: Archive, selection: Selection) -> Archive:
    """Return what is selected; a track may be named by its pieces, such as bus/1."""
    return select_from(archive, replace(selection, tracks=_owners(archive, selection.tracks)))


def _owners(archive: Archive, names: Sequence[str]) -> tuple[str, ...]:
    """Return the tracks of names that may be those of pieces."""
    if all(name in archive for name in names):
        return tuple(names)
    owners = archive.pieces
    return tuple(dict.fromkeys(owners.get(name, name) for name in names))


def _read_samples(archive: Archive) -> list[Track]:
    from gpszip.errors import OptionError

    if archive.kept_columns is None:
        raise OptionError(
            "--samples: the archive keeps no times of points",
            remedy="compress the log with --keep-times or --keep",
        )
    return archive.samples()


def _read_knots(archive: Archive, selection: Selection) -> tuple[list[Track], Mapping[str, str]]:
    """Return the knots of all pieces that are selected, and the track of each piece."""
    # Pieces have their names only as long as nothing is cut.
    if selection.has_times or selection.bbox is not None:
        from gpszip.archive.select import decompress_selection

        return decompress_selection(archive, selection)
    pieces, owners = archive.decompress(), archive.pieces
    if not selection.tracks:
        return pieces, owners
    wanted = set(selection.tracks)
    for name in selection.tracks:
        if name not in owners:
            archive.walk(name)  # raises if there is no such track
    chosen = [piece for piece in pieces if not wanted.isdisjoint((piece.id, owners[piece.id]))]
    return chosen, owners


def _format_warnings(
    log_format: LogFormat, tracks: list[Track], pieces: Mapping[str, str]
) -> list[str]:
    """Describe what a format can't hold of the tracks."""
    if log_format.describe_losses is None:
        return []
    # Pieces of a track are written under its name; name each once.
    names = dict.fromkeys(pieces.get(track.id, track.id) for track in tracks)
    return log_format.describe_losses(list(names), list(tracks[0].attributes))


def _hide(
    archive: Archive,
    tracks: Sequence[Track],
    pieces: Mapping[str, str] | None,
    blur: float | None,
    drop_ends: float | None,
    *,
    sampled: bool,
) -> tuple[list[Track], dict[str, str]]:
    """Leave out places where a track of the archive stayed, and the ends of tracks."""
    import numpy as np

    from gpszip.history.stays.hide import hide_places

    # Circles differ in each run: whoever knew how they are drawn could compute what they hide.
    places = np.zeros((0, archive.grid.dimension))
    if blur is not None:
        places = _places_to_hide(archive)
    left, owners = hide_places(
        tracks,
        pieces or {},
        places,
        np.random.default_rng(),
        radius=blur,
        ends=drop_ends,
        sampled=sampled,
    )
    if sampled:
        return left, owners
    return [
        piece for part in left for piece in archive.with_curves(owners[part.id], [part])
    ], owners


def _places_to_hide(archive: Archive) -> NDArray[np.float64]:
    """Places where a track stayed; say where there are none, or some may be missing."""
    from gpszip.cli.output import print_status
    from gpszip.cli.units import format_count
    from gpszip.errors import OptionError
    from gpszip.history.stays.find import places_of_archive

    # Whoever shares what is left must know what was not hidden.
    if not archive.timed:
        raise OptionError(
            "--blur hides places where tracks stayed, which no track without times tells",
            remedy="hide where tracks begin and end: --drop-ends 200m",
        )
    places = places_of_archive(archive)
    if not len(places):
        print_status("gpszip: no track stayed anywhere for 5 minutes: --blur hides nothing")
    if archive.untimed:
        lacking = format_count(len(archive.untimed), "track")
        print_status(f"gpszip: {lacking} without times: --blur doesn't know where they stayed")
    return places


def _explain_empty(archive: str, hides: str | None) -> str:
    if hides is not None:
        return f"{archive}: {hides} leaves nothing; give a shorter length"
    return (
        f"{archive}: no travel is known at any of these times; "
        "gpszip info --detail shows the time range"
    )
