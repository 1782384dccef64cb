"""gpszip match: the roads that a log took."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.options import Settings, common, force, output, time_options
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import DURATION, LENGTH, Quantity

if TYPE_CHECKING:
    from gpszip.io.networks import NetworkReading
    from gpszip.model import Reading
    from gpszip.model.match import Matching

__all__ = ["command"]

_ANGLE = Quantity("angle", {"deg": 1.0, "rad": math.degrees(1.0)}, words={"none": math.inf})
_GAP = Quantity("duration", DURATION.units, DURATION.hints, {"none": math.inf})


@click.command("match", short_help="Find the roads that a log took.")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True)
@click.option("--network", metavar="FILE", multiple=True, required=True, help="Roads, prepared ones, or an archive, for its map.")
@output("routes.geojson")
@click.option("--sigma", type=LENGTH, metavar="LENGTH", help="Scale of the distance to the roads. Estimated from the log where left out.")
@click.option("--beta", type=LENGTH, metavar="LENGTH", help="Scale of the way's difference from the straight line. Estimated, too.")
@click.option("--gap", type=_GAP, metavar="DURATION", help="Silences longer than this break a route, or none. Estimated where left out.")
@click.option(
    "--heading",
    type=_ANGLE,
    metavar="ANGLE",
    help="Spread of the log's headings about the roads, or none to leave them out. Estimated, too.",
)
@click.option("--format", "kind", metavar="FORMAT", help="Instead of the output's suffix: geojson, or csv with a row for each point.")
@click.option("--skip-bad", is_flag=True, help="Leave out logs that can't be read, name them, end with exit code 3.")
@click.option("--columns", metavar="ROLES", help="Which column is what: t=when,x=east,y=north,heading=course.")
@time_options
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
@force
@common
@click.pass_obj
def command(settings: Settings, /, logs: tuple[str, ...], network: tuple[str, ...], target: str, **choices: Any) -> Outcome:
    """Find the way that every LOG took over the roads of a network, and write it as GeoJSON lines or CSV rows.

    A route breaks, and goes on behind, where no road is near, no way joins two points, or the log is silent for long.
    """
    from gpszip.cli.output import check_output
    from gpszip.io.routes import route_format

    kind = route_format(target, choices["kind"])
    check_output(target, force=choices["force"])
    from gpszip import pipeline
    from gpszip.cli.progress import progress
    from gpszip.io.routes import write_routes

    start = time.perf_counter()
    with progress(quiet=choices["quiet"] or settings.json) as listener:
        how = {name: choices[name] for name in ("skip_bad", "columns", "time_unit", "dates")}
        reading = pipeline.read(logs, **how, heading=choices["heading"] != math.inf)
        roads = pipeline.read_network(list(network), near=reading.tracks)
        scales = {name: choices[name] for name in ("sigma", "beta", "gap", "heading")}
        matching = pipeline.match(reading.tracks, roads.network, **scales, progress=listener)
    write_routes(matching, reading.tracks, roads.network, target, kind)
    if settings.json or not choices["quiet"]:
        _show(target, reading, roads, matching, time.perf_counter() - start, settings)
    return Outcome.DONE if reading.complete else Outcome.LEFT_OUT


def _show(target: str, reading: Reading, roads: NetworkReading, matching: Matching, seconds: float, settings: Settings) -> None:
    from gpszip.cli.output import STDOUT, say, show_json
    from gpszip.cli.summary import account_of, losses_of, name_left_out, name_losses, place_of, repairs_in_words
    from gpszip.cli.units import format_length

    repairs = [*reading.repairs, *roads.repairs]
    if settings.json:
        facts = _facts(matching) | {"seconds": round(seconds, 3)}
        show_json({"output": target, **facts, **losses_of(reading), **account_of(repairs, reading.left_out)}, err=target == STDOUT)
        return
    name_losses(reading)
    name_left_out(reading)
    facts = _facts(matching)
    breaks = ", ".join(f"{reason} {count:,}" for reason, count in matching.breaks.items()) or "none"
    scales = [f"{name} {format_length(facts[name])}" for name in ("error", "sigma", "beta")]
    if facts["heading"] is not None:
        scales.append(f"heading {facts['heading']:.3g} deg")
    words = [
        f"{facts['points']:,} points in {facts['tracks']:,} tracks, {100 * matching.share:.1f} % on {facts['pieces']:,} routes of "
        f"{format_length(facts['length'])}, {', '.join(scales)}, {seconds:.1f} s",
        f"breaks: {breaks}",
        *([_unheeded(facts["unheeded"])] if facts["unheeded"] else []),
        *repairs_in_words(repairs),
    ]
    say(f"{place_of(target)}: {'; '.join(words)}")


def _unheeded(tracks: list[str]) -> str:
    several = f"{len(tracks):,} tracks" if len(tracks) > 1 else f"track {tracks[0]!r}"
    return f"headings of {several} left out, as they don't show that they follow the roads travelled"


def _facts(matching: Matching) -> dict[str, Any]:
    pieces = [piece for match in matching for piece in match.pieces]
    return {
        "points": matching.points,
        "tracks": len(matching),
        "matched": matching.share,
        "pieces": len(pieces),
        "length": sum(piece.length for piece in pieces),
        "error": matching.scales.error,
        "sigma": matching.scales.sigma,
        "beta": matching.scales.beta,
        "heading": matching.scales.heading if math.isfinite(matching.scales.heading) else None,
        "unheeded": list(matching.unheeded),
        "breaks": matching.breaks,
    }
