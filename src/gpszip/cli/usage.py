"""gpszip usage: tell how often, how fast and when the edges of a map are travelled."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
import numpy as np

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.histories import (
    check_stdin,
    check_tables,
    history_options,
    open_history,
    outcome_of,
    reading_facts,
    sources_argument,
    timezone_option,
)
from gpszip.cli.options import Settings, common_options, force
from gpszip.cli.outcome import Outcome
from gpszip.cli.units import format_count

if TYPE_CHECKING:
    from gpszip.history.transitions import RouteLikelihood
    from gpszip.history.usage import Usage
    from gpszip.model import ReadResult

__all__ = ["command"]

#: Edges that the text names.
_MAX_NAMED = 5


@click.command(
    "usage",
    cls=CommandWithFormats,
    short_help="Tell how often, how fast and when edges are travelled.",
)
@sources_argument
@click.option(
    "-o",
    "--output",
    "target",
    metavar="U.csv",
    help="Write a row for each edge, direction and part of time: U.csv, U.json, U.parquet, or "
    "U.geojson with lines; - is standard output, as CSV.",
    shell_complete=complete_files(),
)
@click.option(
    "--by",
    default="hour,weekday",
    show_default=True,
    metavar="PARTS",
    help="Split rows by parts of local time: hour, weekday, month, period, date; none: no split.",
)
@timezone_option
@click.option(
    "--transitions",
    "transitions_target",
    metavar="M.csv",
    help="Write the probability of each edge after another, as CSV, JSON or Parquet.",
    shell_complete=complete_files(),
)
@click.option(
    "--likelihood",
    "log",
    metavar="LOG",
    help="Tell how likely the transitions of this log are.",
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
    by: str,
    timezone: str | None,
    transitions_target: str | None,
    log: str | None,
    map_name: str | None,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Tell how often, how fast, for how long and when each edge of a map is travelled.

    Edges are those of the clean map, as gpszip map --clean writes them. Speeds leave out standing;
    dwell is standing. Logs are compressed on the way.
    """
    from gpszip.cli.output import STDOUT, check_output, print_json, print_status
    from gpszip.errors import OptionError
    from gpszip.history.local_time import find_zone
    from gpszip.io.feature_tables import check_table_format
    from gpszip.pipeline.usage import log_likelihood, usage

    # Refuse what can be refused before anything is read.
    outputs = [name for name in (target, transitions_target) if name is not None]
    for name in outputs:
        if check_table_format(name, "usage") == "geojson" and name == transitions_target:
            raise OptionError("transitions are no lines", remedy="write .csv, .json or .parquet")
        check_output(name, force=force)
    check_tables(*outputs)
    check_stdin(*sources, map_name, log)
    if timezone is not None:
        find_zone(timezone)
    parts = () if by.strip() in {"", "none"} else tuple(part.strip() for part in by.split(","))

    # Count.
    with open_history(sources, map_name, dict(reading), quiet=settings.json) as (archive, read):
        found = usage(archive, by=parts, timezone=timezone)
        likelihood = None
        if log is not None:
            likelihood = log_likelihood(found, archive, _read_log(log, reading))
        if target is not None:
            _write_usage(found, target)
        if transitions_target is not None:
            _write_transitions(found, transitions_target)

    # Say what was found; on standard output, unless a table is there.
    on_stdout = STDOUT in outputs
    if settings.json:
        facts = _facts(found, likelihood, read)
        facts |= {"output": target, "transitions_output": transitions_target}
        print_json(facts, err=on_stdout)
    else:
        for line in _describe(found, likelihood):
            click.echo(line, err=on_stdout)
        if target not in {None, STDOUT}:
            print_status(f"{target}: {format_count(len(found), 'row')}")
    return outcome_of(read)


def _read_log(name: str, reading: dict[str, Any]) -> Any:
    """Tracks of the log whose likelihood is asked for, read as the others are."""
    from gpszip.io.logs.read import read_logs

    names = ("columns", "time_unit", "dates", "skip_bad", "sort", "split", "clean", "format")
    return read_logs([name], times=False, **{key: reading[key] for key in names}).tracks


def _write_usage(found: Usage, target: str) -> None:
    from gpszip.io.history_tables import edge_lines, write_edge_table

    lines = (
        edge_lines(found.network, found["edge"], found["forward"])
        if target.lower().endswith(".geojson")
        else []
    )
    facts = {"timezone": found.timezone or None, "repeated": found.repeated}
    write_edge_table(
        found.columns, target, "usage", lines=lines, network=found.network, facts=facts
    )


def _write_transitions(found: Usage, target: str) -> None:
    from gpszip.io.history_tables import write_edge_table

    model = found.markov
    columns = {
        "from_edge": model.before // 2,
        "from_forward": model.before % 2 == 0,
        "to_edge": model.after // 2,
        "to_forward": model.after % 2 == 0,
        "count": model.counts,
        "probability": np.round(model.probabilities, 6),
    }
    write_edge_table(columns, target, "transitions", lines=[], network=found.network)


def _facts(
    found: Usage, likelihood: RouteLikelihood | None, read_result: ReadResult | None
) -> dict[str, Any]:
    """Return the result for JSON: lengths in metres, times in seconds."""
    # Agents, and the likelihood of a log if one was named.
    rows = found.traversals
    agents = [
        {
            "track": agent.track,
            "traversals": agent.traversals,
            "relative_speed": agent.relative_speed,
            "cluster": agent.cluster,
        }
        for agent in found.agents
    ]
    told = None
    if likelihood is not None:
        told = {
            "log_likelihood": likelihood.log_likelihood,
            "transitions": likelihood.transitions,
            "bits_per_transition": likelihood.bits_per_transition,
        }

    # All of it.
    return {
        "edges": len(found.network),
        "traversals": len(rows),
        "tracks": len(rows.ids),
        "length": float(rows.metres.sum()),
        "dwell": float(np.nansum(rows.standing)),
        "rows": len(found),
        "by": list(found.by),
        "timezone": found.timezone or None,
        "timezone_from": found.calendar.source,
        "repeated": found.repeated,
        "repeated_by_track": found.repeated_by_track,
        "transitions": int(found.markov.counts.sum()),
        "smoothing": found.markov.smoothing,
        "likelihood": told,
        "agents": agents,
        "read": reading_facts(read_result),
    }


def _describe(found: Usage, likelihood: RouteLikelihood | None) -> list[str]:
    """Return lines about what was found, for a person."""
    # All of it.
    rows = found.traversals
    lines = [
        f"{format_count(len(rows), 'traversal')} of {format_count(len(found.network), 'edge')} by "
        f"{format_count(len(rows.ids), 'track')}, {rows.metres.sum():,.0f} m; "
        f"{found.repeated:.0%} on edges travelled before, {found.repeated_by_track:.0%} by the "
        "same track",
    ]
    if np.isfinite(rows.enter).any():
        lines.append(found.calendar.describe())

    # The edges that are used most.
    counts = np.bincount(rows.edge, minlength=len(found.network))
    most = np.argsort(-counts, kind="stable")[:_MAX_NAMED].tolist()
    lines += [_describe_edge(found, edge, int(counts[edge])) for edge in most]

    # Agents and likelihood.
    clusters: dict[int, list[float]] = {}
    for agent in found.agents:
        if agent.cluster >= 0:
            clusters.setdefault(agent.cluster, []).append(agent.relative_speed)
    if len(clusters) > 1:
        texts = [
            f"{format_count(len(clusters[number]), 'track')} at {np.median(clusters[number]):.2f}"
            for number in sorted(clusters)
        ]
        lines.append(f"speeds relative to others: {', '.join(texts)}")
    if likelihood is not None:
        lines.append(
            f"log-likelihood {likelihood.log_likelihood:.1f} of "
            f"{format_count(likelihood.transitions, 'transition')}, "
            f"{likelihood.bits_per_transition:.3f} bits each"
            if likelihood.transitions
            else "the log whose likelihood is asked for goes from no edge to another"
        )
    return lines


def _describe_edge(found: Usage, edge: int, count: int) -> str:
    """One edge: traversals by direction, speed, first and last passage."""
    from gpszip.history.usage import traversal_speeds
    from gpszip.model.timestamps import format_span

    rows = found.traversals
    mine = rows.edge == edge
    forward = int((mine & rows.forward).sum())
    text = f"edge {edge}, {found.network.lengths[edge]:,.0f} m: "
    text += f"{format_count(count, 'traversal')}, {forward:,} forward"
    speeds = traversal_speeds(rows)[mine]
    if np.isfinite(speeds).any():
        text += f", median {np.nanmedian(speeds):.1f} m/s, "
        first, last = np.nanmin(rows.enter[mine]), np.nanmax(rows.leave[mine])
        text += format_span(float(np.floor(first)), float(np.floor(last)))
    return text
