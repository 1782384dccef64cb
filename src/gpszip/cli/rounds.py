"""gpszip rounds: find the usual round of a patrol, and score all rounds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.histories import (
    check_tables,
    history_options,
    open_history,
    outcome_of,
    reading_facts,
    sources_argument,
)
from gpszip.cli.options import Settings, common_options, force
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import format_count, format_duration, format_length

if TYPE_CHECKING:
    from gpszip.model import Network, ReadResult
    from gpszip.model.rounds import Round, Rounds

__all__ = ["command"]

#: Rounds and edges that the text names.
_MAX_NAMED = 5

#: Share of the usual round below which the text names a round.
_COMPLETE = 0.999


@click.command(
    "rounds",
    cls=CommandWithFormats,
    short_help="Find the usual round of a patrol, and score all rounds.",
)
@sources_argument
@click.option(
    "-o",
    "--output",
    "target",
    metavar="R.csv",
    help="Write a row for each round: R.csv, R.json or R.parquet; - is standard output, as CSV.",
    shell_complete=complete_files(),
)
@click.option(
    "--edges",
    "edges_target",
    metavar="E.csv",
    help="Write a row for each edge, with its visits: E.csv, E.json, E.parquet, or E.geojson with "
    "lines.",
    shell_complete=complete_files(),
)
@history_options
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    sources: tuple[str, ...],
    target: str | None,
    edges_target: str | None,
    map_name: str | None,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Find the usual round of a patrol, and tell what each round misses and how late it is.

    A round leads from one passage of a base to the next. Its score is the share of the usual round
    that it covers. With --since, rounds and visits from then on are told; the usual round is that
    of all. Logs are compressed on the way.
    """
    from gpszip.cli.output import STDOUT, check_output, print_json
    from gpszip.errors import OptionError
    from gpszip.history.rounds import find_rounds
    from gpszip.history.traversals import read_history
    from gpszip.io.feature_tables import check_table_format

    # Refuse what can be refused before anything is read.
    outputs = [name for name in (target, edges_target) if name is not None]
    for name in outputs:
        if check_table_format(name, "rounds") == "geojson" and name == target:
            raise OptionError("rounds are no lines", remedy="write .csv, or edges by --edges")
        check_output(name, force=force)
    check_tables(*outputs)

    # Find the rounds; the usual one is that of all times.
    since, reading["since"] = reading["since"], None
    with open_history(sources, map_name, dict(reading), quiet=settings.json) as (archive, read):
        history = read_history(archive)
        found = find_rounds(history, since)
        if target is not None:
            _write_rounds(found, target, history.network)
        if edges_target is not None:
            _write_edges(found, edges_target, history.network)

    # Say what was found; on standard output, unless a table is there.
    on_stdout = STDOUT in outputs
    if settings.json:
        facts = _facts(found, read)
        facts |= {"output": target, "edges_output": edges_target}
        print_json(facts, err=on_stdout)
    else:
        for line in _describe(found):
            click.echo(line, err=on_stdout)
    return outcome_of(read)


def _write_rounds(found: Rounds, target: str, network: Network) -> None:
    from gpszip.io.history_tables import write_edge_table

    rounds = found.rounds
    columns = {
        "track_id": np.array([each.track for each in rounds], np.str_),
        "round": np.array([each.number for each in rounds], np.int64),
        "t_start": np.array([each.start for each in rounds], np.float64),
        "t_end": np.array([each.end for each in rounds], np.float64),
        "length": np.array([each.length for each in rounds], np.float64),
        "score": np.array([each.share for each in rounds], np.float64),
        "extra": np.array([each.extra for each in rounds], np.float64),
        "late_s": np.array([each.late for each in rounds], np.float64),
        "missed": np.array([" ".join(map(str, each.missed)) for each in rounds], np.str_),
    }
    facts = {
        "usual": [{"edge": edge, "forward": forward} for edge, forward in found.usual],
        "length": found.length,
        "regularity": found.regularity,
    }
    write_edge_table(columns, target, "rounds", lines=[], network=network, facts=facts)


def _write_edges(found: Rounds, target: str, network: Network) -> None:
    from gpszip.io.history_tables import edge_lines, write_edge_table

    edges = found.edges
    number = np.array([each.edge for each in edges], np.int64)
    columns: dict[str, NDArray[np.generic]] = {
        "edge": number,
        "usual": np.array([each.usual for each in edges], np.float64),
        "visits": np.array([each.visits for each in edges], np.int64),
        "missed": np.array([each.missed for each in edges], np.int64),
        "t_first": np.array([each.first for each in edges], np.float64),
        "t_last": np.array([each.last for each in edges], np.float64),
        "interval_s": np.array([each.interval for each in edges], np.float64),
        "longest_s": np.array([each.longest for each in edges], np.float64),
    }
    lines = edge_lines(network, number, np.full(len(number), True))
    write_edge_table(columns, target, "edges", lines=lines, network=network)


def _facts(found: Rounds, read_result: ReadResult | None) -> dict[str, Any]:
    """Return the result for JSON: lengths in metres, times in seconds."""
    return {
        "rounds": len(found.rounds),
        "complete": sum(each.share >= _COMPLETE for each in found.rounds),
        "usual": [{"edge": edge, "forward": forward} for edge, forward in found.usual],
        "length": found.length,
        "duration": found.duration if np.isfinite(found.duration) else None,
        "regularity": found.regularity,
        "read": reading_facts(read_result),
    }


def _describe(found: Rounds) -> list[str]:
    """Return lines about what was found, for a person."""
    # The usual round.
    rounds = found.rounds
    duration = f", {format_duration(found.duration)}" if np.isfinite(found.duration) else ""
    complete = sum(each.share >= _COMPLETE for each in rounds)
    lines = [
        f"usual round: {format_count(len(found.usual), 'edge')}, {format_length(found.length)}"
        f"{duration}; tells {found.regularity:.0%} of all travel",
        f"{format_count(len(rounds), 'round')}, {complete:,} of them complete",
    ]

    # Rounds that miss most, and edges that are missed most.
    short = sorted((each for each in rounds if each.share < _COMPLETE), key=lambda each: each.share)
    lines += [_describe_round(each) for each in short[:_MAX_NAMED]]
    missed = sorted((each for each in found.edges if each.missed), key=lambda each: -each.missed)
    lines += [
        f"edge {each.edge}: missed in {format_count(each.missed, 'round')}"
        for each in missed[:_MAX_NAMED]
    ]
    return lines


def _describe_round(found: Round) -> str:
    from gpszip.model.timestamps import format_span

    when = f" ({format_span(found.start, found.end)})" if np.isfinite(found.start) else ""
    edges = format_count(len(found.missed), "edge")
    return f"{found.track}, round {found.number}{when}: {found.share:.0%}, misses {edges}"
