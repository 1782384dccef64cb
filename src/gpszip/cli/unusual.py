"""gpszip unusual: tell how unusual the trips of a log are, given an archive."""

from __future__ import annotations

import math
import sys
from io import BytesIO
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.histories import (
    check_stdin,
    log_options,
    outcome_of,
    print_reading,
    reading_facts,
    timezone_option,
)
from gpszip.cli.options import Settings, common_options, force
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection
from gpszip.cli.units import format_count

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gpszip.model import ReadResult, Track
    from gpszip.model.unusual import Anomaly, Unusual

__all__ = ["command"]

#: Trips and absences that the text names.
_MAX_NAMED = 10

#: Seconds of a day.
_DAY = 86_400.0


@click.command(
    "unusual", cls=CommandWithFormats, short_help="Tell how unusual the trips of a log are."
)
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, shell_complete=complete_files())
@click.option(
    "--map",
    "map_name",
    metavar="ARCHIVE",
    required=True,
    help="What is usual: an archive of earlier trips there.",
    shell_complete=complete_files(),
)
@click.option(
    "-o",
    "--output",
    "target",
    metavar="U.csv",
    help="Write a row for each trip: U.csv, U.json, U.parquet, or U.geojson with lines; - is "
    "standard output, as CSV.",
    shell_complete=complete_files(),
)
@click.option(
    "--stretches",
    "parts",
    is_flag=True,
    help="Write a row for each unusual part of a trip, and for each absence.",
)
@click.option(
    "--alarm",
    type=click.FloatRange(0),
    default=20.0,
    show_default=True,
    metavar="BITS",
    help="Score from which a trip counts as unusual.",
)
@click.option(
    "--coded",
    is_flag=True,
    help="Tell also the bits that the archive's own coder takes to write each trip and part.",
)
@timezone_option
@log_options
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    logs: tuple[str, ...],
    map_name: str,
    target: str | None,
    parts: bool,
    alarm: float,
    coded: bool,
    timezone: str | None,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Tell how unusual the trips of a log are, given an archive of earlier trips.

    Scores are bits: each doubles the surprise. They count rare turns, other ways than usual, wrong
    directions, travel off the map, unusual paces and stops. Trips are those of gpszip trips.
    Agents that don't travel when they always do are named, too; they are known by the
    names of their tracks.
    """
    from gpszip.cli.archives import explain_corruption, open_archive_bytes, read_archive_bytes
    from gpszip.cli.output import STDOUT, check_output, print_json, print_status
    from gpszip.errors import OptionError
    from gpszip.io.feature_tables import check_table_format
    from gpszip.io.logs.read import read_logs
    from gpszip.pipeline.unusual import unusual

    # Refuse what can be refused before anything is read. NaN passes as a number of any range.
    if math.isnan(alarm):
        raise OptionError("--alarm is nan", remedy="give bits, such as 20")
    if parts and target is None:
        raise OptionError("--stretches needs a table", remedy="name one with -o")
    if target is not None:
        check_table_format(target, "unusual")
        check_output(target, force=force)
    check_stdin(map_name, *logs)

    # Read the log and the archive, and compare.
    data = read_archive_bytes(map_name)
    with explain_corruption(map_name, data):
        archive = open_archive_bytes(map_name, data, None)
    sources = [BytesIO(sys.stdin.buffer.read()) if name == "-" else name for name in logs]
    read = read_logs(sources, selection=pop_selection(reading), **reading)
    if not settings.json:
        print_reading(read)
    found = unusual(read.tracks, archive, timezone=timezone, coded=coded)
    if target is not None:
        _write(found, read.tracks, target, parts=parts)

    # Say what was found; on standard output, unless a table is there.
    on_stdout = target == STDOUT
    if settings.json:
        print_json({**_facts(found, alarm, read), "output": target}, err=on_stdout)
    else:
        for line in _describe(found, alarm):
            click.echo(line, err=on_stdout)
        if target is not None and not on_stdout:
            rows = len(found.anomalies) if parts else len(found)
            print_status(f"{target}: {format_count(rows, 'row')}")
    return outcome_of(read)


def _write(found: Unusual, tracks: Sequence[Track], target: str, *, parts: bool) -> None:
    """Write a table of trips, or of their unusual parts."""
    from gpszip.io.unusual import write_parts, write_trips

    if parts:
        write_parts(found, tracks, target)
    else:
        write_trips(found, tracks, target)


def _rates(found: Unusual, alarm: float) -> tuple[int, float | None, float | None]:
    """Trips above a score, these for each agent and day, and the median delay in seconds.

    The delay is the time from the begin of the most unusual part to its end, when it is known.
    """
    above = [trip for trip in found.trips if trip.score >= alarm]
    days = {(trip.track, trip.start // _DAY) for trip in found.trips}
    delays = [trip.anomalies[0].end - trip.anomalies[0].start for trip in above if trip.anomalies]
    rate = len(above) / len(days) if days else None
    return len(above), rate, float(np.median(delays)) if delays else None


def _facts(found: Unusual, alarm: float, read: ReadResult) -> dict[str, Any]:
    """Return the result for JSON: times in seconds, scores in bits."""
    # Trips, the most unusual first.
    trips = [
        {
            "track_id": trip.track,
            "t_start": trip.start,
            "t_end": trip.end,
            "score": trip.score,
            "reason": trip.reason,
            "coded_bits": _known(trip.coded_bits),
            "parts": [_part_facts(part) for part in trip.anomalies],
        }
        for trip in found.ranked
    ]

    # Absences, and what an alarm at this score would mean.
    above, rate, delay = _rates(found, alarm)
    return {
        "trips": trips,
        "absences": [_part_facts(part) for part in found.absences],
        "alarm": alarm,
        "alarms": above,
        "alarms_per_agent_and_day": rate,
        "delay": delay,
        "read": reading_facts(read),
    }


def _part_facts(part: Anomaly) -> dict[str, Any]:
    return {
        "track_id": part.track,
        "kind": part.kind,
        "t_start": part.start,
        "t_end": part.end,
        "score": part.bits,
        "reason": part.reason,
        "coded_bits": _known(part.coded_bits),
        "position": list(part.position),
        "edges": [{"edge": edge, "forward": forward} for edge, forward in part.edges],
    }


def _known(bits: float) -> float | None:
    """A number for JSON, which has no NaN."""
    return None if math.isnan(bits) else bits


def _describe(found: Unusual, alarm: float) -> list[str]:
    """Return lines about what was found, the most unusual first, for a person."""
    from gpszip.model.timestamps import format_span

    # All of it.
    above, rate, delay = _rates(found, alarm)
    line = f"{format_count(len(found), 'trip')}, {above:,} with {alarm:g} bits or more"
    if rate is not None:
        line += f", {rate:.2g} for each agent and day"
    if delay is not None:
        line += f", known after {delay:,.0f} s"

    # The first of the ranking, and of the absences.
    lines = [line]
    for trip in found.ranked[:_MAX_NAMED]:
        span = format_span(float(np.floor(trip.start)), float(np.floor(trip.end)))
        lines.append(f"{trip.score:6.1f} bits  {trip.track}  {span}  {trip.reason}")
    for absence in found.absences[:_MAX_NAMED]:
        day = format_span(absence.start, absence.end)
        lines.append(f"{absence.bits:6.1f} bits  {absence.track}  {day}  {absence.reason}")
    return lines
