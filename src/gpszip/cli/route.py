"""gpszip route: plan a route over the map of an archive."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.histories import (
    history_options,
    open_history,
    outcome_of,
    reading_facts,
    timezone_option,
)
from gpszip.cli.options import Settings, common_options, force
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import format_count, format_duration

if TYPE_CHECKING:
    from gpszip.history.routes import PlannedRoute
    from gpszip.model import ReadResult
    from gpszip.pipeline.route import Plan

__all__ = ["command"]

#: Numbers of a place.
_AXES = 2


@click.command(
    "route",
    cls=CommandWithFormats,
    short_help="Plan a route over the map of an archive.",
    # A latitude or x below 0 is no option.
    context_settings={"ignore_unknown_options": True},
)
@click.argument("source", metavar="ARCHIVE|LOG", shell_complete=complete_files())
@click.argument("places", metavar="FROM [VIA]... TO", nargs=-1, required=True)
@click.option(
    "-o",
    "--output",
    "target",
    metavar="R.gpx",
    help="Write the routes as R.gpx or R.geojson; - is standard output, as GeoJSON.",
    shell_complete=complete_files(),
)
@click.option(
    "--by",
    type=click.Choice(("time", "length", "traversals")),
    default="time",
    show_default=True,
    help="What the route minimises; traversals: the most travelled edges.",
)
@click.option(
    "--depart",
    metavar="TIME",
    help="Departure, such as 08:00 or 2024-05-01T08:00Z. By default means over the day count.",
)
@click.option(
    "--alternatives",
    type=click.IntRange(0, 9),
    default=2,
    show_default=True,
    metavar="N",
    help="Alternatives to look for.",
)
@timezone_option
@history_options
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    source: str,
    places: tuple[str, ...],
    target: str | None,
    by: str,
    depart: str | None,
    alternatives: int,
    timezone: str | None,
    map_name: str | None,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Plan a route over a learned map, from FROM to TO, each as LAT,LON or X,Y.

    A route takes directions that somebody travelled. Seconds are those of the hour at which each
    edge is reached, and 80 % of all drives take between the two numbers that are told.
    """
    from gpszip.cli.output import STDOUT, check_output, print_json, print_status
    from gpszip.history.local_time import find_zone
    from gpszip.history.write_routes import (
        check_route_format,
        write_planned_routes,
    )
    from gpszip.pipeline.route import plan_route

    # Refuse what can be refused before anything is read.
    stops = _read_places(places)
    if target is not None:
        check_route_format(target)
        check_output(target, force=force)
    if timezone is not None:
        find_zone(timezone)

    # Plan.
    with open_history([source], map_name, dict(reading), quiet=settings.json) as (archive, read):
        plan = plan_route(
            archive,
            stops,
            by=by,
            depart=depart,
            alternatives=alternatives,
            timezone=timezone,
        )
    if target is not None:
        write_planned_routes(plan.routes, plan.network, target)

    # Say what was found; on standard output, unless the routes are there.
    on_stdout = target == STDOUT
    if settings.json:
        print_json(_facts(plan, by, target, read), err=on_stdout)
    else:
        for line in _describe(plan, by):
            click.echo(line, err=on_stdout)
        if target not in {None, STDOUT}:
            print_status(f"{target}: {format_count(len(plan.routes), 'route')}")
    return outcome_of(read)


def _read_places(texts: tuple[str, ...]) -> list[tuple[float, ...]]:
    """Read places such as 52.5,13.4."""
    from gpszip.errors import OptionError

    places = []
    for text in texts:
        # An unknown option comes here, too.
        if text.startswith("--"):
            raise OptionError(f"no such option {text}", remedy="see gpszip route --help")
        try:
            place = tuple(float(part) for part in text.split(","))
        except ValueError:
            place = ()
        if len(place) != _AXES:
            raise OptionError(
                f"{text!r} is no place", remedy="write LAT,LON or X,Y, such as 52.5,13.4"
            )
        places.append(place)
    if len(places) < _AXES:
        raise OptionError("a route needs two places or more", remedy="name FROM and TO")
    return places


def _facts(
    plan: Plan, by: str, target: str | None, read_result: ReadResult | None
) -> dict[str, Any]:
    """Return the result for JSON."""
    from gpszip.history.write_routes import route_facts

    return {
        "by": by,
        "depart": plan.depart,
        "timezone": plan.calendar.name or None,
        "timezone_from": plan.calendar.source,
        "routes": [route_facts(route) for route in plan.routes],
        "output": target,
        "read": reading_facts(read_result),
    }


def _describe(plan: Plan, by: str) -> list[str]:
    """Return lines about the routes, for a person."""
    name = {"time": "fastest", "length": "shortest", "traversals": "most travelled"}[by]
    lines = [f"{name}: {_describe_route(plan.routes[0], plan)}"]
    lines += [
        f"alternative {number}: {_describe_route(route, plan)}"
        for number, route in enumerate(plan.routes[1:], 1)
    ]
    if plan.depart is not None:
        lines.append(plan.calendar.describe())
    lines.append("only directions that were travelled are taken")
    return lines


def _describe_route(route: PlannedRoute, plan: Plan) -> str:
    """Length, time and arrival of a route."""
    text = f"{route.length:,.0f} m"
    if route.arrival is not None:
        seconds, low, high = route.arrival
        text += f", {format_duration(round(seconds))} ({format_duration(round(low))} to "
        text += f"{format_duration(round(high))} in 80 % of drives)"
        if plan.depart is not None:
            arrive = [_clock(plan, plan.depart + each) for each in route.arrival]
            text += f", arrival {arrive[0]} ({arrive[1]} to {arrive[2]})"
    least = format_count(route.traversals, "traversal")
    return f"{text}, {least} of its least travelled edge"


def _clock(plan: Plan, time: float) -> str:
    """Local time of day."""
    return datetime.fromtimestamp(time, plan.calendar.zone).strftime("%H:%M")
