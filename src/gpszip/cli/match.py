"""gpszip match: the roads that a log took."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.options import Settings, common_options, force, output_option, time_options
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import DURATION, LENGTH, Quantity

if TYPE_CHECKING:
    from gpszip.io.networks.read import NetworkReadResult
    from gpszip.model import Network, ReadResult
    from gpszip.model.match import Matching

__all__ = ["command"]

#: So many roads that points travel against are named; JSON names them all.
_MAX_NAMED = 3

_ANGLE = Quantity("angle", {"deg": 1.0, "rad": math.degrees(1.0)}, words={"none": math.inf})
_GAP = Quantity("duration", DURATION.units, DURATION.hints, {"none": math.inf})


@click.command("match", short_help="Find the roads that a log took.")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True)
@click.option(
    "--network",
    metavar="FILE",
    multiple=True,
    required=True,
    help="Roads, prepared ones, or an archive, for its map.",
)
@output_option("routes.geojson")
@click.option(
    "--sigma",
    type=LENGTH,
    metavar="LENGTH",
    help="Scale of the distance to the roads. Estimated from the log where left out.",
)
@click.option(
    "--beta",
    type=LENGTH,
    metavar="LENGTH",
    help="Scale of the way's difference from the straight line. Estimated, too.",
)
@click.option(
    "--gap",
    type=_GAP,
    metavar="DURATION",
    help="Silences longer than this break a route, or none. Estimated where left out.",
)
@click.option(
    "--heading",
    type=_ANGLE,
    metavar="ANGLE",
    help="Spread of the log's headings about the roads, or none to leave them out. Estimated, too.",
)
@click.option(
    "--ignore-oneway",
    is_flag=True,
    help="All roads lead both ways, as for those who walk or cycle.",
)
@click.option(
    "--format",
    "kind",
    metavar="FORMAT",
    help="Instead of the output's suffix: geojson, or csv with a row for each point.",
)
@click.option(
    "--skip-bad",
    is_flag=True,
    help="Leave out logs that can't be read, name them, end with exit code 3.",
)
@click.option(
    "--columns", metavar="ROLES", help="Which column is what: t=when,x=east,y=north,heading=course."
)
@time_options
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    logs: tuple[str, ...],
    network: tuple[str, ...],
    target: str,
    **choices: Any,
) -> Outcome:
    """Find the way that every LOG took over the roads of a network, and write it as GeoJSON lines or CSV rows.

    A route breaks, and goes on behind, where no road is near, no way joins two points, the points go against a one-way road, or the
    log is silent for long.
    """
    from gpszip.cli.output import check_output
    from gpszip.io.maps.routes import route_format

    kind = route_format(target, choices["kind"])
    check_output(target, force=choices["force"])
    from gpszip.cli.progress import progress_bar
    from gpszip.io.logs.read import read_logs
    from gpszip.io.maps.routes import write_routes
    from gpszip.pipeline.match import match, read_network

    start = time.perf_counter()
    with progress_bar(quiet=choices["quiet"] or settings.json) as listener:
        how = {name: choices[name] for name in ("skip_bad", "columns", "time_unit", "dates")}
        read_result = read_logs(logs, **how, heading=choices["heading"] != math.inf)
        roads = read_network(list(network), near=read_result.tracks)
        options = {
            name: choices[name] for name in ("sigma", "beta", "gap", "heading", "ignore_oneway")
        }
        matching = match(read_result.tracks, roads.network, **options, progress=listener)
    write_routes(matching, read_result.tracks, roads.network, target, kind)
    if settings.json or not choices["quiet"]:
        _print_result(target, read_result, roads, matching, time.perf_counter() - start, settings)
    return Outcome.DONE if read_result.complete else Outcome.LEFT_OUT


def _print_result(
    target: str,
    read_result: ReadResult,
    roads: NetworkReadResult,
    matching: Matching,
    seconds: float,
    settings: Settings,
) -> None:
    from gpszip.cli.output import STDOUT, print_json, print_status
    from gpszip.cli.summary import (
        describe_repairs,
        losses_as_dict,
        output_label,
        print_left_out,
        print_losses,
        repairs_as_dict,
    )
    from gpszip.cli.units import format_length

    repairs = [*read_result.repairs, *roads.repairs]
    if settings.json:
        facts = _facts(matching, roads.network) | {"seconds": round(seconds, 3)}
        print_json(
            {
                "output": target,
                **facts,
                **losses_as_dict(read_result),
                **repairs_as_dict(repairs, read_result.left_out),
            },
            err=target == STDOUT,
        )
        return
    print_losses(read_result)
    print_left_out(read_result)
    facts = _facts(matching, roads.network)
    breaks = ", ".join(f"{reason} {count:,}" for reason, count in matching.breaks.items()) or "none"
    scales = [f"{name} {format_length(facts[name])}" for name in ("error", "sigma", "beta")]
    if facts["heading"] is not None:
        scales.append(f"heading {facts['heading']:.3g} deg")
    words = [
        f"matched {_format_percentage(matching.matched, matching.points)} of {_format_count(matching.points, 'point')} in "
        f"{_format_count(len(matching), 'track')} on {_describe_routes(matching)}, {', '.join(scales)}, {seconds:.1f} s",
        *([f"unmatched: {_describe_unmatched(facts)}"] if facts["unmatched"] else []),
        f"breaks: {breaks}",
        *([_describe_ignored_headings(facts["unheeded"])] if facts["unheeded"] else []),
        *describe_repairs(repairs),
    ]
    print_status(f"{output_label(target)}: {'; '.join(words)}")


def _format_percentage(part: int, whole: int) -> str:
    """A share in words, which says 100 % of the whole only, and 0 % of nothing only."""
    if part == whole:
        return "100 %"
    tenths = 1000 * part // whole  # rounded down
    return "less than 0.1 %" if part and not tenths else f"{tenths / 10:.1f} %" if tenths else "0 %"


def _format_count(number: int, word: str) -> str:
    return f"{number:,} {word}" + ("" if number == 1 else "s")


def _describe_routes(matching: Matching) -> str:
    """How many routes were found, and how many places at which points stand still."""
    from gpszip.cli.units import format_length

    lengths = [piece.length for match in matching for piece in match.pieces]
    routes = [length for length in lengths if length]
    words = (
        [f"{_format_count(len(routes), 'route')} of {format_length(sum(routes))}"]
        if routes
        else []
        if lengths
        else ["no route"]
    )
    if len(lengths) > len(routes):
        words.append(f"{_format_count(len(lengths) - len(routes), 'place')} of standing still")
    return " and ".join(words)


def _describe_unmatched(facts: dict[str, Any]) -> str:
    """Numbers of points by reason, with the first roads that they travel against."""
    roads = facts["one_way"]
    named = ", ".join(roads[:_MAX_NAMED]) + (
        f" and {len(roads) - _MAX_NAMED:,} more" if len(roads) > _MAX_NAMED else ""
    )
    words = [
        f"{count:,} {reason}" + (f" ({named})" if reason == "one-way" else "")
        for reason, count in facts["unmatched"].items()
    ]
    return ", ".join(words)


def _describe_ignored_headings(tracks: list[str]) -> str:
    several = f"{len(tracks):,} tracks" if len(tracks) > 1 else f"track {tracks[0]!r}"
    return (
        f"headings of {several} left out, as they don't show that they follow the roads travelled"
    )


def _facts(matching: Matching, network: Network) -> dict[str, Any]:
    pieces = [piece for match in matching for piece in match.pieces]
    return {
        "points": matching.points,
        "tracks": len(matching),
        "matched": matching.share,
        "pieces": len(pieces),
        "length": math.fsum(piece.length for piece in pieces),
        "error": matching.scales.error,
        "sigma": matching.scales.sigma,
        "beta": matching.scales.beta,
        "heading": matching.scales.heading if math.isfinite(matching.scales.heading) else None,
        "unheeded": list(matching.headings_ignored),
        "breaks": matching.breaks,
        "unmatched": matching.unmatched,
        "one_way": list(dict.fromkeys(map(network.label, matching.wrong_way))),
    }
