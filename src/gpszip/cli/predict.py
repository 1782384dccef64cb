"""gpszip predict: predict where agents go from their last positions."""

from __future__ import annotations

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
from gpszip.cli.selecting import pop_selection, select_from
from gpszip.cli.units import format_count, format_length

if TYPE_CHECKING:
    from gpszip.model import ReadResult
    from gpszip.model.prediction import Destination, Outlook, TripArrival

__all__ = ["command"]

#: Next edges of a track that the text names.
_MAX_NAMED = 3


@click.command(
    "predict",
    cls=CommandWithFormats,
    short_help="Predict where agents go from their last positions.",
)
@click.argument("archive_name", metavar="ARCHIVE", shell_complete=complete_files())
@click.argument("logs", metavar="[LOG]...", nargs=-1, shell_complete=complete_files())
@click.option(
    "-o",
    "--output",
    "target",
    metavar="P.csv",
    help="Write a row for each next edge and destination: P.csv, P.json, P.parquet, or P.geojson "
    "with lines; - is standard output, as CSV.",
    shell_complete=complete_files(),
)
@click.option(
    "--edges",
    type=click.IntRange(1, 100),
    default=5,
    show_default=True,
    metavar="N",
    help="Edges of the routes that are predicted.",
)
@click.option(
    "--destinations",
    type=click.IntRange(1),
    default=3,
    show_default=True,
    metavar="N",
    help="Destinations of each track.",
)
@timezone_option
@log_options
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    archive_name: str,
    logs: tuple[str, ...],
    target: str | None,
    edges: int,
    destinations: int,
    timezone: str | None,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Predict where each track of LOG goes from its last position, by what ARCHIVE knows.

    Told are the next edges, the likeliest route, and where and when the trip may end, with an 80 %
    band. Without LOG, the tracks of the archive go on. Agents are known by the names of their
    tracks, and edges have the numbers of gpszip map.
    """
    from gpszip.cli.archives import explain_corruption, open_archive_bytes, read_archive_bytes
    from gpszip.cli.output import STDOUT, check_output, print_json, print_status
    from gpszip.io.feature_tables import check_table_format
    from gpszip.io.logs.read import read_logs
    from gpszip.io.predictions import write_outlooks
    from gpszip.pipeline.predict import predict

    # Refuse what can be refused before anything is read.
    if target is not None:
        check_table_format(target, "predictions")
        check_output(target, force=force)
    check_stdin(archive_name, *logs)

    # Read the archive and the log; without a log, a part of the archive can be selected.
    data = read_archive_bytes(archive_name)
    with explain_corruption(archive_name, data):
        archive = open_archive_bytes(archive_name, data, None)
    selection, read = pop_selection(reading), None
    if logs:
        sources = [BytesIO(sys.stdin.buffer.read()) if name == "-" else name for name in logs]
        read = read_logs(sources, selection=selection, times=False, **reading)
        if not settings.json:
            print_reading(read)
    else:
        archive = select_from(archive, selection)

    # Predict.
    outlooks, network = predict(
        archive,
        read.tracks if read else None,
        edges=edges,
        destinations=destinations,
        timezone=timezone,
    )
    if target is not None:
        write_outlooks(outlooks, network, target)

    # Say what was found; on standard output, unless a table is there.
    on_stdout = target == STDOUT
    if settings.json:
        print_json({**_facts(outlooks, read), "output": target}, err=on_stdout)
    else:
        for outlook in outlooks:
            for line in _describe(outlook):
                click.echo(line, err=on_stdout)
        if target is not None and not on_stdout:
            rows = sum(len(each.next) + len(each.destinations) for each in outlooks)
            print_status(f"{target}: {format_count(rows, 'row')}")
    return outcome_of(read)


def _facts(outlooks: tuple[Outlook, ...], read: ReadResult | None) -> dict[str, Any]:
    """Return the result for JSON: times in seconds, lengths in metres."""
    tracks = [_outlook_facts(outlook) for outlook in outlooks]
    return {"tracks": tracks, "read": reading_facts(read)}


def _outlook_facts(outlook: Outlook) -> dict[str, Any]:
    return {
        "track_id": outlook.track,
        "t": outlook.time if np.isfinite(outlook.time) else None,
        "edge": outlook.edge if outlook.edge >= 0 else None,
        "forward": outlook.forward if outlook.edge >= 0 else None,
        "next": [road._asdict() for road in outlook.next],
        "routes": [
            {"edges": _edges_facts(route.edges), "probability": route.probability}
            for route in outlook.routes
        ],
        "destinations": [_destination_facts(goal) for goal in outlook.destinations],
    }


def _destination_facts(goal: Destination) -> dict[str, Any]:
    return {
        "node": goal.node,
        "probability": goal.probability,
        "position": list(goal.position),
        "arrival": None if goal.arrival is None else _arrival_facts(goal.arrival),
    }


def _arrival_facts(arrival: TripArrival) -> dict[str, Any]:
    return {
        "seconds": arrival.seconds,
        "low": arrival.low,
        "high": arrival.high,
        "metres": arrival.metres,
        "route": _edges_facts(arrival.route),
    }


def _edges_facts(edges: tuple[tuple[int, bool], ...]) -> list[dict[str, Any]]:
    return [{"edge": edge, "forward": forward} for edge, forward in edges]


def _describe(outlook: Outlook) -> list[str]:
    """Return lines about one track, for a person."""
    from gpszip.model.timestamps import format_span

    # Where it is.
    when = ""
    if np.isfinite(outlook.time):
        second = float(np.floor(outlook.time))
        when = f" at {format_span(second, second).split(' to ')[0]}"
    if outlook.edge < 0:
        return [f"{outlook.track}{when}: off the map"]
    lines = [f"{outlook.track}{when}: on {_edge(outlook.edge, outlook.forward)}"]

    # What may follow.
    following = [
        f"{_edge(road.edge, road.forward)} {road.probability:.0%}"
        for road in outlook.next[:_MAX_NAMED]
    ]
    lines.append(f"  next: {', '.join(following)}")
    if outlook.routes:
        best = outlook.routes[0]
        numbers = " ".join(str(edge) for edge, _ in best.edges)
        lines.append(f"  route: {numbers}, {best.probability:.0%}")
    for goal in outlook.destinations:
        place = ", ".join(f"{each:.6g}" for each in goal.position[:2])
        text = f"  destination: node {goal.node} at {place}, {goal.probability:.0%}"
        if goal.arrival is not None:
            text += (
                f", {format_length(goal.arrival.metres)} in {goal.arrival.seconds:,.0f} s "
                f"({goal.arrival.low:,.0f} to {goal.arrival.high:,.0f} s)"
            )
        lines.append(text)
    return lines


def _edge(edge: int, forward: bool) -> str:
    """An edge and its direction for people."""
    return f"edge {edge}{'' if forward else ' backward'}"
