"""gpszip trips: the stays and trips of a log or an archive, and its places."""

from __future__ import annotations

import sys
from datetime import tzinfo
from io import BytesIO
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.histories import (
    check_stdin,
    check_tables,
    find_archive,
    outcome_of,
    print_reading,
    reading_facts,
)
from gpszip.cli.options import (
    Settings,
    common_options,
    force,
    map_option,
    robot_options,
    skip_bad_logs,
    time_options,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, select_from, selection_options
from gpszip.cli.units import DURATION, LENGTH, format_count, format_duration, format_length

if TYPE_CHECKING:
    from gpszip.history.stays.values import Settings as TripSettings
    from gpszip.model import ReadResult
    from gpszip.model.trips import Place, Trips

__all__ = ["command"]

#: Places that the summary lists.
_MAX_PLACES = 8

#: Pairs of places that the summary lists.
_MAX_PAIRS = 5


@click.command(
    "trips",
    cls=CommandWithFormats,
    short_help="Find the stays and trips of a log or an archive, and its places.",
)
@click.argument(
    "sources", metavar="LOG...|A.gpsz", nargs=-1, required=True, shell_complete=complete_files()
)
@click.option(
    "-o",
    "--output",
    "target",
    metavar="FILE",
    help="Write a row for each stay and trip: T.csv, T.json, T.parquet or T.geojson; - is "
    "standard output, as CSV.",
    shell_complete=complete_files(),
)
@click.option(
    "--places",
    "places_target",
    metavar="FILE",
    help="Write a row for each place: P.csv, P.json, P.parquet or P.geojson.",
    shell_complete=complete_files(),
)
@click.option(
    "--timezone",
    metavar="ZONE",
    help="Time zone of local hours, such as Europe/Berlin. By default that of the place where most "
    "time is spent, if the package timezonefinder is there, else UTC, and no home and work.",
)
@click.option(
    "--min-stay",
    type=DURATION,
    default=300.0,
    show_default="5min",
    metavar="DURATION",
    help="Shorter stops are no stays, unless a trip turns back at them.",
)
@click.option(
    "--max-pause",
    type=DURATION,
    default=900.0,
    show_default="15min",
    metavar="DURATION",
    help="Shorter stays on the way don't end a trip, such as waiting for a train.",
)
@click.option(
    "--radius",
    type=LENGTH,
    default=100.0,
    show_default="100m",
    metavar="LENGTH",
    help="Radius of a place.",
)
@map_option
@click.option("--clean", is_flag=True, help="Drop outliers of logs, as compress does.")
@skip_bad_logs
@selection_options
@click.option(
    "--columns",
    metavar="ROLES",
    help="Which column of logs is what: t=when,x=east,y=north.",
)
@time_options
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
    sources: tuple[str, ...],
    target: str | None,
    places_target: str | None,
    timezone: str | None,
    min_stay: float,
    max_pause: float,
    radius: float,
    map_name: str | None,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Find the stays and trips of logs or of an archive, and the places that they join.

    A stay lasts 5 minutes or more; red lights, jams, the wandering of a phone that lies still,
    gaps and single wrong fixes are no trips. Of a log, the errors that it states count (a column
    accuracy); an archive needs no log. Points of logs are put in the order of time.
    """
    from gpszip.cli.output import STDOUT, check_output, print_json
    from gpszip.errors import OptionError
    from gpszip.history.local_time import find_zone
    from gpszip.history.stays.values import Settings as TripSettings
    from gpszip.io.feature_tables import check_table_format
    from gpszip.io.trips import write_places, write_trips

    # Refuse what can be refused before anything is read.
    outputs = [name for name in (target, places_target) if name is not None]
    check_tables(*outputs)
    check_stdin(*sources, map_name)
    for name, what in ((target, "trips"), (places_target, "places")):
        if name is not None:
            check_table_format(name, what)
            check_output(name, force=force)
    if timezone is not None:
        find_zone(timezone)

    # Read and find.
    reading["selection"] = pop_selection(reading)
    options = TripSettings(min_stay, max_pause, radius)
    found, read_result = _find(sources, map_name, options, timezone, reading)
    if timezone is not None and found.places and not found.timezone:
        raise OptionError(
            "the times of the log are no dates, so that they have no time zone",
            remedy="leave out --timezone",
        )
    zone = find_zone(found.timezone) if found.timezone else None
    if target is not None:
        write_trips(found, target, zone)
    if places_target is not None:
        write_places(found, places_target, zone)

    # Say what was found; on standard output, unless a table is there.
    on_stdout = STDOUT in outputs
    if settings.json:
        print_json(_facts(found, read_result, zone, target, places_target), err=on_stdout)
    else:
        if read_result is not None:
            print_reading(read_result)
        for line in _describe(found):
            click.echo(line, err=on_stdout)
    return outcome_of(read_result)


def _find(
    sources: tuple[str, ...],
    map_name: str | None,
    options: TripSettings,
    timezone: str | None,
    reading: dict[str, Any],
) -> tuple[Trips, ReadResult | None]:
    """Open an archive or read logs, and find their trips."""
    from gpszip.cli.archives import explain_corruption, open_archive_bytes, read_archive_bytes
    from gpszip.history.stays.find import trips_of_archive, trips_of_log
    from gpszip.io.logs.read import read_logs

    # An archive alone; standard input is known by its content, too.
    stdin = sys.stdin.buffer.read() if "-" in sources else b""
    name = find_archive(sources, stdin)
    if name is not None:
        data = stdin or read_archive_bytes(name)
        with explain_corruption(name, data):
            archive = open_archive_bytes(name, data, map_name)
            selected = select_from(archive, reading["selection"])
            return trips_of_archive(selected, options, timezone), None

    # Logs; phones send points late, so that their order is often not that of time.
    logs = [BytesIO(stdin) if source == "-" else source for source in sources]
    read_result = read_logs(logs, accuracy=True, sort=True, **reading)
    return trips_of_log(read_result.tracks, options, timezone), read_result


def _facts(
    found: Trips,
    read_result: ReadResult | None,
    zone: tzinfo | None,
    target: str | None,
    places_target: str | None,
) -> dict[str, Any]:
    """Return the result for JSON."""
    from gpszip.io.trips import matrix_rows, place_rows

    return {
        "output": target,
        "places_output": places_target,
        "trips": len(found.trips),
        "stays": len(found.stays),
        "length": sum(trip.length for trip in found.trips),
        "moving_s": sum(trip.moving for trip in found.trips),
        "unseen": found.unseen,
        "doubtful": found.doubtful,
        "timezone": found.timezone or None,
        "timezone_from": found.timezone_from or None,
        "places": place_rows(found, zone),
        "matrix": matrix_rows(found),
        "read": reading_facts(read_result),
    }


def _describe(found: Trips) -> list[str]:
    """Return lines about what was found, for a person."""
    # Counts, and what was left out.
    length = sum(trip.length for trip in found.trips)
    moving = sum(trip.moving for trip in found.trips)
    lines = [
        f"{format_count(len(found.trips), 'trip')} of {format_length(length)} and "
        f"{format_duration(moving)} in motion, {format_count(len(found.stays), 'stay')} at "
        f"{format_count(len(found.places), 'place')}"
    ]
    if found.unseen:
        lines.append(
            f"{format_count(found.unseen, 'change')} of place in gaps: no trip was seen there"
        )
    if found.doubtful:
        fixes = "single fix" if found.doubtful == 1 else "single fixes"
        lines.append(f"{found.doubtful:,} {fixes} far off between gaps left out")

    # Places with their hours, and trips between them.
    if found.timezone:
        said = {
            "option": f"local hours are those of {found.timezone}",
            "place": f"local hours are those of {found.timezone}, that of the first place",
            "default": "hours are those of UTC, as no time zone was given: --timezone "
            "Europe/Berlin gives local ones, and tells home and work",
        }
        lines.append(said[found.timezone_from])
    lines += [_describe_place(place) for place in found.places[:_MAX_PLACES]]
    if len(found.places) > _MAX_PLACES:
        lines.append(f"and {format_count(len(found.places) - _MAX_PLACES, 'more place')}")
    pairs = list(found.matrix.items())[:_MAX_PAIRS]
    lines += [
        f"{format_count(count, 'trip')} from place {origin} to place {goal}"
        for (origin, goal), count in pairs
    ]
    return lines


def _describe_place(place: Place) -> str:
    visits = f"{format_count(place.visits, 'visit')}, {format_duration(place.dwell)}"
    facts = [f"place {place.number}: {visits}"]
    if place.usual:
        facts.append(f"usually {place.usual} h")
    if place.role:
        facts.append(f"perhaps {place.role} ({place.evidence})")
    return ", ".join(facts)
