"""gpszip match: find the roads that a log took."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import (
    Settings,
    common_options,
    dry_run_option,
    force,
    ignore_oneway,
    network_option,
    output_name,
    output_option,
    quiet,
    robot_options,
    skip_bad_logs,
    time_options,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, selection_options
from gpszip.cli.units import DURATION, LENGTH, Quantity, format_count

if TYPE_CHECKING:
    from gpszip.io.networks.read import NetworkReadResult
    from gpszip.model import Network, ReadResult
    from gpszip.model.match import Matching

__all__ = ["command"]

#: Roads that a message names of those travelled against their direction; JSON names them all.
_MAX_NAMED = 3

#: Angles in degrees; infinite for "none".
_ANGLE = Quantity("angle", {"deg": 1.0, "rad": math.degrees(1.0)}, words={"none": math.inf})
#: Durations in seconds; infinite for "none".
_GAP = Quantity("duration", DURATION.units, DURATION.hints, {"none": math.inf})


@click.command("match", cls=CommandWithFormats, short_help="Find the roads that a log took.")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, shell_complete=complete_files())
@network_option
@output_option("routes.geojson", default="the name of the only LOG with -routes.geojson")
@click.option(
    "--sigma",
    type=LENGTH,
    metavar="LENGTH",
    help="Scale of the distance to the roads. By default estimated from the log.",
)
@click.option(
    "--beta",
    type=LENGTH,
    metavar="LENGTH",
    help="Scale of how much longer paths are than straight lines. By default estimated.",
)
@click.option(
    "--gap",
    type=_GAP,
    metavar="DURATION",
    help="Intervals between points longer than this break a route; none: any length is matched. "
    "By default estimated.",
)
@click.option(
    "--heading",
    type=_ANGLE,
    metavar="ANGLE",
    help="Spread of headings about the roads; none: headings are ignored. By default estimated.",
)
@ignore_oneway
@click.option(
    "--format",
    "kind",
    metavar="FORMAT",
    help="Format instead of the one of the output's suffix: ROUTE_FORMATS.",
)
@skip_bad_logs
@selection_options
@click.option(
    "--columns", metavar="ROLES", help="Which column is what: t=when,x=east,y=north,heading=course."
)
@time_options
@robot_options
@dry_run_option
@quiet
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    logs: tuple[str, ...],
    network: tuple[str, ...],
    target: str | None,
    sigma: float | None,
    beta: float | None,
    gap: float | None,
    heading: float | None,
    ignore_oneway: bool,
    kind: str | None,
    skip_bad: bool,
    columns: str | None,
    time_unit: str | None,
    dates: str | None,
    dry_run: bool,
    quiet: bool,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Find the roads that every LOG took, and write its routes.

    GeoJSON has a line for each piece of a route, CSV a row for each point. A route breaks, and
    goes on later, where no road is near, no path joins two points, points go against a one-way
    road, or the log has a long gap.
    """
    from gpszip.cli.output import check_output
    from gpszip.io.maps.routes import route_format

    # Refuse a wrong output before the logs are read; imports that take long follow.
    target = output_name(target, logs, "-routes.geojson", "routes.geojson")
    kind = route_format(target, kind)
    check_output(target, force=force)
    from gpszip.cli.progress import progress_bar
    from gpszip.io.logs.read import read_logs
    from gpszip.io.maps.routes import write_routes
    from gpszip.pipeline.match import match, read_network

    # Read and match.
    selection = pop_selection(reading)
    start = time.perf_counter()
    with progress_bar(quiet=quiet or settings.json) as listener:
        read_result = read_logs(
            logs,
            columns=columns,
            time_unit=time_unit,
            dates=dates,
            **reading,
            # Headings that are ignored need no column.
            heading=heading != math.inf,
            skip_bad=skip_bad,
            selection=selection,
        )
        roads = read_network(list(network), near=read_result.tracks)
        scales = {"sigma": sigma, "beta": beta, "gap": gap, "heading": heading}
        if dry_run:
            return _dry_run(target, read_result, roads, scales, ignore_oneway, settings)
        matching = match(
            read_result.tracks,
            roads.network,
            **scales,
            ignore_oneway=ignore_oneway,
            progress=listener,
        )

    # Write.
    write_routes(matching, read_result.tracks, roads.network, target, kind)
    seconds = time.perf_counter() - start
    if settings.json or not quiet:
        _print_result(target, read_result, roads, matching, seconds, settings)
    return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT


def _dry_run(
    target: str,
    read_result: ReadResult,
    roads: NetworkReadResult,
    scales: dict[str, float | None],
    ignore_oneway: bool,
    settings: Settings,
) -> Outcome:
    """Match the first points, and say what would be done."""
    from gpszip.cli.plans import print_match_plan
    from gpszip.pipeline.plans import plan_match

    plan = plan_match(read_result.tracks, roads.network, **scales, ignore_oneway=ignore_oneway)
    print_match_plan(target, read_result, roads, plan, as_json=settings.json)
    return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT


def _print_result(
    target: str,
    read_result: ReadResult,
    roads: NetworkReadResult,
    matching: Matching,
    seconds: float,
    settings: Settings,
) -> None:
    from gpszip.cli.output import print_status
    from gpszip.cli.summary import (
        describe_repairs,
        output_label,
        print_json_result,
        print_losses,
    )
    from gpszip.cli.units import format_length

    # For programs.
    repairs = [*read_result.repairs, *roads.repairs]
    facts = _facts(matching, roads.network)
    if settings.json:
        facts["seconds"] = round(seconds, 3)
        print_json_result(target, facts, read_result, repairs)
        return

    # For a person: what was lost, then one line.
    print_losses(read_result)
    scales = [f"{name} {format_length(facts[name])}" for name in ("error", "sigma", "beta")]
    if facts["heading"] is not None:
        scales.append(f"heading {facts['heading']:.3g} deg")
    breaks = ", ".join(f"{reason} {count:,}" for reason, count in matching.breaks.items())
    lines = [
        f"matched {_format_percentage(matching.matched, matching.points)} of "
        f"{format_count(matching.points, 'point')} in {format_count(len(matching), 'track')} on "
        f"{_describe_routes(matching)}, {', '.join(scales)}, {seconds:.1f} s"
    ]
    if facts["unmatched"]:
        lines.append(f"unmatched: {_describe_unmatched(facts)}")
    lines.append(f"breaks: {breaks or 'none'}")
    if facts["headings_ignored"]:
        lines.append(_describe_ignored_headings(facts["headings_ignored"]))
    lines += describe_repairs(repairs)
    print_status(f"{output_label(target)}: {'; '.join(lines)}")


def _format_percentage(count: int, total: int) -> str:
    """Format a share: 100 % is all of the total only, and 0 % nothing of it only."""
    # Rounding would make 100.0 % of 9,999 in 10,000.
    if count == total:
        return "100 %"
    tenths = 1000 * count // total  # rounded down
    if tenths:
        return f"{tenths / 10:.1f} %"
    return "less than 0.1 %" if count else "0 %"


def _describe_routes(matching: Matching) -> str:
    """Describe how many routes were found, and how many stops: pieces without a length."""
    from gpszip.cli.units import format_length

    lengths = [piece.length for match in matching for piece in match.pieces]
    routes = [length for length in lengths if length]
    if not lengths:
        return "no route"
    words = []
    if routes:
        words.append(f"{format_count(len(routes), 'route')} of {format_length(sum(routes))}")
    if len(lengths) > len(routes):
        words.append(format_count(len(lengths) - len(routes), "stop"))
    return " and ".join(words)


def _describe_unmatched(facts: dict[str, Any]) -> str:
    """Describe how many points are on no road, by reason; name roads travelled the wrong way."""
    roads = facts["one_way"]
    named = ", ".join(roads[:_MAX_NAMED])
    if len(roads) > _MAX_NAMED:
        named += f" and {len(roads) - _MAX_NAMED:,} more"
    words = [
        f"{count:,} {reason}" + (f" ({named})" if reason == "one-way" else "")
        for reason, count in facts["unmatched"].items()
    ]
    return ", ".join(words)


def _describe_ignored_headings(tracks: list[str]) -> str:
    which = f"{len(tracks):,} tracks" if len(tracks) > 1 else f"track {tracks[0]!r}"
    return f"headings of {which} ignored, as they don't follow the roads travelled"


def _facts(matching: Matching, network: Network) -> dict[str, Any]:
    """Return the results for JSON: lengths in metres, angles in degrees."""
    # JSON has no infinite number: a heading that is not used is null.
    pieces = [piece for match in matching for piece in match.pieces]
    heading = matching.scales.heading if math.isfinite(matching.scales.heading) else None

    # "headings_ignored" are the tracks whose headings were ignored.
    return {
        "points": matching.points,
        "tracks": len(matching),
        "matched": matching.share,
        "pieces": len(pieces),
        "length": math.fsum(piece.length for piece in pieces),
        "error": matching.scales.error,
        "sigma": matching.scales.sigma,
        "beta": matching.scales.beta,
        "heading": heading,
        "headings_ignored": list(matching.headings_ignored),
        "breaks": matching.breaks,
        "unmatched": matching.unmatched,
        "one_way": list(dict.fromkeys(map(network.label, matching.wrong_way))),
    }
