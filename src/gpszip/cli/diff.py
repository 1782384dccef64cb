"""gpszip diff: compare an archive or a log with another one."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from io import BytesIO
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.histories import is_archive, print_reading, reading_facts
from gpszip.cli.options import (
    Settings,
    common_options,
    force,
    map_option,
    robot_options,
    time_options,
    time_order_options,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, select_from, selection_options
from gpszip.cli.units import DURATION, Quantity, format_duration

if TYPE_CHECKING:
    from gpszip.model import ReadResult
    from gpszip.model.difference import Difference, Distances, TrackDifference
    from gpszip.model.selection import Selection
    from gpszip.pipeline.diff import Side

__all__ = ["command"]

#: Names of tracks that a line lists.
_MAX_NAMED = 5

#: Heads of the columns of the table.
_HEADS = (
    "track",
    "compared",
    "mean",
    "RMSE",
    "95 %",
    "maximum",
    "Hausdorff",
    "Fréchet",
    "discrete",
    "length",
    "duration",
)

#: Metres from which lengths are in kilometres.
_MIN_KILOMETRES = 100_000

#: Metres from which it is said how far distances of lines may be off.
_MIN_WITHIN = 1e-3

#: Durations in seconds; infinite for "none".
_GAP = Quantity("duration", DURATION.units, DURATION.hints, {"none": math.inf})


@click.command(
    "diff", cls=CommandWithFormats, short_help="Compare an archive or a log with another one."
)
@click.argument("first", metavar="A", shell_complete=complete_files())
@click.argument("others", metavar="B...", nargs=-1, required=True, shell_complete=complete_files())
@click.option(
    "--exact",
    is_flag=True,
    help="Compare every byte of the logs B, of Parquet every value, with what compress "
    "--lossless kept of them in A.",
)
@click.option(
    "-o",
    "--output",
    "target",
    metavar="WORST.geojson",
    help="Write the places where A and B are farthest apart; - is standard output.",
    shell_complete=complete_files(),
)
@click.option(
    "--worst",
    type=click.IntRange(1),
    default=100,
    show_default=True,
    metavar="N",
    help="Number of places to write.",
)
@click.option(
    "--gap",
    type=_GAP,
    metavar="DURATION",
    help="Intervals between points of logs longer than this are gaps; none: no gaps. By default "
    "estimated.",
)
@map_option
@click.option("--clean", is_flag=True, help="Drop outliers of logs, as compress does.")
@time_order_options
@click.option(
    "--skip-bad",
    is_flag=True,
    help="Leave out logs, features and points that can't be read, name them, end with exit code 3.",
)
@click.option(
    "--columns",
    metavar="ROLES",
    help="Which column of logs is what: t=when,x=east,y=north.",
)
@time_options
@selection_options
@robot_options
@click.option(
    "--format",
    metavar="FORMAT",
    help="Format of the logs: LOG_FORMATS; by default found from the content.",
)
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    first: str,
    others: tuple[str, ...],
    exact: bool,
    target: str | None,
    worst: int,
    gap: float | None,
    map_name: str | None,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Compare A with B, each an archive or a log; tracks of one id are compared.

    A log against an archive is compared at the log's samples, two logs at the times of both, two
    archives over all time. Distances are those of both positions at one time; Hausdorff and
    Fréchet distances are those of the lines. With --exact, exit code 1 and the first line that
    differs say that a log is not what the archive A keeps.
    """
    from gpszip.cli.output import check_output, print_json, print_status
    from gpszip.errors import OptionError
    from gpszip.io.far_places import write_far_places
    from gpszip.pipeline.diff import diff

    # Bytes, or positions.
    reading["selection"] = pop_selection(reading)
    if exact:
        return _compare_bytes(settings, first, others)
    if len(others) > 1:
        raise OptionError(f"{1 + len(others)} files were named", remedy="name A and B")

    # Refuse what can be refused before anything is read.
    (second,) = others
    if first == second == "-":
        raise OptionError("only one of both can come from standard input", remedy="name a file")
    if target is not None:
        check_output(target, force=force)

    # Read and compare.
    sides, results = [], []
    for name in (first, second):
        side, read_result = _open(name, map_name, gap, reading)
        if read_result is not None and not settings.json:
            print_reading(read_result)
        sides.append(side)
        results.append(read_result)
    found = diff(*sides, worst=worst)
    if target is not None:
        write_far_places(found.worst, target, geographic=found.geographic)

    # Say what was found; a table on standard output would mix with places there.
    if settings.json:
        print_json(_facts((first, second), found, results), err=target == "-")
    else:
        time_step = max(side.time_step for side in sides)
        for line in _table(found, (first, second), time_step):
            click.echo(line, err=target == "-")
        if target not in {None, "-"}:
            print_status(f"{target}: {len(found.worst):,} places")
    read = [result for result in results if result is not None]
    return Outcome.DONE if all(result.complete for result in read) else Outcome.LEFT_OUT


def _compare_bytes(settings: Settings, archive: str, logs: tuple[str, ...]) -> Outcome:
    """Compare every byte of logs with what an archive keeps of them."""
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import print_json
    from gpszip.io.logs.formats import is_bundle
    from gpszip.io.storage.source import spooled
    from gpszip.pipeline.exact_logs import check_exact, exact_logs, kept_exactly

    with open_archive_file(archive) as source, spooled(logs, unzip=is_bundle) as sources:
        size = check_exact(source, sources)
        what = kept_exactly(exact_logs(source))
    if settings.json:
        print_json({"archive": archive, "equal": True, "logs": len(sources), "bytes": size})
    else:
        click.echo(f"{archive}: holds {what}; logs {len(sources):,}, bytes {size:,}")
    return Outcome.DONE


def _open(
    name: str, map_name: str | None, gap: float | None, reading: dict[str, Any]
) -> tuple[Side, ReadResult | None]:
    """Open an archive, or read a log."""
    from gpszip.cli.archives import explain_corruption, open_archive_bytes, read_archive_bytes
    from gpszip.io.logs.read import read_logs
    from gpszip.pipeline.diff import side_of_archive, side_of_log

    # The file begins like an archive, or is none.
    stdin = sys.stdin.buffer.read() if name == "-" else b""
    if is_archive(name, stdin):
        data = stdin or read_archive_bytes(name)
        with explain_corruption(name, data):
            archive = open_archive_bytes(name, data, map_name)
            return side_of_archive(select_from(archive, _selection(reading))), None

    # A log; one without times is compared as lines.
    read_result = read_logs([BytesIO(stdin)] if name == "-" else [name], times=False, **reading)
    return side_of_log(read_result.tracks, gap), read_result


def _selection(reading: dict[str, Any]) -> Selection:
    selection: Selection = reading["selection"]
    return selection


def _facts(
    names: tuple[str, str], found: Difference, results: Sequence[ReadResult | None]
) -> dict[str, Any]:
    """Return the result for JSON: lengths in metres, times in seconds."""
    return {
        "a": names[0],
        "b": names[1],
        "total": asdict(found.total),
        "tracks": [asdict(track) for track in found.tracks],
        "missing": list(found.missing),
        "worst": [asdict(place) for place in found.worst],
        "read": [reading_facts(result) for result in results],
    }


def _table(found: Difference, names: tuple[str, str], time_step: float) -> list[str]:
    """Return the lines of the table, and what only one of both has; ``time_step`` in seconds."""
    # A row for each track, and one for all of several.
    rows = [_HEADS, *(_row(track) for track in found.tracks)]
    if len(found.tracks) != 1:
        rows.append(("all", *_distance_cells(found.total), *[""] * 5))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(
            cell.ljust(width) if number == 0 else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]

    # What one of them lacks.
    for name, ids in zip(names, found.missing, strict=True):
        if ids:
            lines.append(f"{name} lacks {len(ids):,} of the tracks{_list_names(ids)}")
    for track in found.tracks:
        lines += _describe_alone(track, names, time_step)
        if track.within > _MIN_WITHIN:
            lines.append(
                f"{track.id}: the lines are too long to compare all points; Hausdorff and Fréchet "
                f"distances are within {_metres(track.within)}, the discrete one within "
                f"{_metres(track.discrete_within)}"
            )
    return lines


def _row(track: TrackDifference) -> tuple[str, ...]:
    """Return the cells of a track; lengths and durations of both."""
    a, b = track.lengths
    since, until = track.durations
    return (
        track.id,
        *_distance_cells(track.distances),
        _metres(track.hausdorff),
        _metres(track.frechet),
        _metres(track.discrete_frechet),
        f"{_metres(a)} / {_metres(b)}",
        f"{format_duration(since)} / {format_duration(until)}",
    )


def _distance_cells(distances: Distances) -> tuple[str, ...]:
    values = (distances.mean, distances.rmse, distances.percentile_95, distances.maximum)
    return (
        f"{distances.compared:,}",
        *("-" if math.isnan(value) else _metres(value) for value in values),
    )


def _describe_alone(track: TrackDifference, names: tuple[str, str], time_step: float) -> list[str]:
    """Say in which time ranges only one of both travels, and where samples have no counterpart.

    Parameters
    ----------
    track : TrackDifference
        Whose times are described.
    names : (str, str)
        Names of both files.
    time_step : float
        Seconds to which archives round times; ranges up to this are no surprise.
    """
    from gpszip.model.text import count_text

    # Time ranges.
    lines = []
    for name, ranges in zip(names, track.alone, strict=True):
        if ranges:
            durations = [end - begin for begin, end in ranges]
            line = (
                f"{track.id}: only {name} travels in {count_text(len(ranges), 'time range')}, "
                f"{format_duration(sum(durations))} in all"
            )
            if max(durations) <= time_step:
                line += f"; archives round times, here to {format_duration(time_step)}"
            lines.append(line)

    # Samples.
    for name, other, samples in zip(names, names[::-1], track.unmatched, strict=True):
        if samples:
            missed = count_text(samples, "sample")
            lines.append(f"{track.id}: at {missed} of {name}, {other} has no position")
    return lines


def _metres(length: float) -> str:
    """Format metres with three digits or to a metre.

    Examples
    --------
    >>> _metres(12.345), _metres(5677.2), _metres(1_342_000.0)
    ('12.3 m', '5,677 m', '1,342 km')
    """
    if length >= _MIN_KILOMETRES:
        return f"{length / 1000:,.0f} km"
    return f"{length:.3g} m" if length < 1000 else f"{length:,.0f} m"


def _list_names(ids: Sequence[str]) -> str:
    shown = ", ".join(ids[:_MAX_NAMED])
    return f" ({shown}{', ...' if len(ids) > _MAX_NAMED else ''})"
