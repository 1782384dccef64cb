"""gpszip changes: find closed, new, moved, slower and faster edges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.histories import (
    check_stdin,
    open_history,
    outcome_of,
    reading_facts,
    reading_options,
)
from gpszip.cli.options import Settings, common_options, force, map_option
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import TIME
from gpszip.cli.units import format_count, format_duration

if TYPE_CHECKING:
    from gpszip.history.changes.changes import Change, Changes
    from gpszip.model import ReadResult

__all__ = ["command"]

#: False alarms of closures a day, where neither they nor a threshold are given.
_FALSE_ALARMS = 0.1

#: Changes that the text names.
_MAX_NAMED = 20


@click.command(
    "changes",
    cls=CommandWithFormats,
    short_help="Find closed, new, moved, slower and faster edges.",
)
@click.argument("old", metavar="OLD", shell_complete=complete_files())
@click.argument("new", metavar="[NEW]", required=False, shell_complete=complete_files())
@click.option(
    "--since",
    "boundary",
    type=TIME,
    metavar="TIME",
    help="Compare the time from then on with the time before, in OLD alone.",
)
@click.option(
    "-o",
    "--output",
    "target",
    metavar="C.csv",
    help="Write a row for each change: C.csv, C.json, C.parquet, or C.geojson with lines; - is "
    "standard output, as CSV.",
    shell_complete=complete_files(),
)
@click.option(
    "--false-alarms",
    type=click.FloatRange(0, min_open=True),
    show_default=f"{_FALSE_ALARMS:g}",
    metavar="N",
    help="False alarms of closures a day; the threshold of evidence is chosen for it.",
)
@click.option(
    "--threshold",
    type=click.FloatRange(0, min_open=True),
    metavar="NATS",
    help="Threshold of evidence, instead.",
)
@click.option(
    "--kinds",
    metavar="KINDS",
    help="Kinds to look for: closed,reopened,new,moved,slower,faster,one-way. By default all.",
)
@map_option
@reading_options
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    old: str,
    new: str | None,
    boundary: float | None,
    target: str | None,
    false_alarms: float | None,
    threshold: float | None,
    kinds: str | None,
    map_name: str | None,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Find what has changed from OLD to NEW, or in OLD since a time.

    An edge is closed where agents that come to the junction before it turn elsewhere, more surely
    than chance has it: nothing is claimed where nobody comes. Evidence is in nats; e to the minus
    evidence is the probability that nothing has changed.
    """
    from gpszip.cli.output import STDOUT, check_output, print_json, print_status
    from gpszip.errors import OptionError
    from gpszip.history.changes.changes import KINDS
    from gpszip.io.feature_tables import check_table_format
    from gpszip.pipeline.changes import changes

    # Refuse what can be refused before anything is read.
    if (boundary is None) == (new is None):
        raise OptionError("name two archives, or one and --since")
    if false_alarms is not None and threshold is not None:
        raise OptionError(
            "--threshold is given, and --false-alarms asks for another one to be chosen",
            remedy="leave out one of both",
        )
    if target is not None:
        check_table_format(target, "changes")
        check_output(target, force=force)
    check_stdin(old, new, map_name)
    wanted = KINDS if kinds is None else tuple(kind.strip() for kind in kinds.split(","))

    # Compare.
    quiet = settings.json
    results: list[ReadResult | None] = []
    with open_history([old], map_name, dict(reading), quiet=quiet) as (first, read):
        results.append(read)
        options: dict[str, Any] = {
            "since": boundary,
            "false_alarms": _FALSE_ALARMS if false_alarms is None else false_alarms,
            "threshold": threshold,
            "kinds": wanted,
        }
        if new is None:
            found = changes(first, None, **options)
        else:
            with open_history([new], map_name, dict(reading), quiet=quiet) as (second, other):
                results.append(other)
                found = changes(first, second, **options)
    if target is not None:
        _write(found, target)

    # Say what was found; on standard output, unless the table is there.
    on_stdout = target == STDOUT
    if settings.json:
        print_json(_facts(found, target, results), err=on_stdout)
    else:
        for line in _describe(found):
            click.echo(line, err=on_stdout)
        if target not in {None, STDOUT}:
            print_status(f"{target}: {format_count(len(found), 'change')}")
    outcomes = [outcome_of(read) for read in results]
    return Outcome.LEFT_OUT if Outcome.LEFT_OUT in outcomes else Outcome.DONE


def _write(found: Changes, target: str) -> None:
    """Write a row for each change, with the middle of its edge."""
    from gpszip.geo.planes import to_geographic
    from gpszip.io.history_tables import edge_lines, write_edge_table

    # The middle of each edge.
    network, rows = found.network, found.changes
    edges = np.array([change.edge for change in rows], np.int64)
    forward = np.array([change.forward for change in rows], np.bool_)
    lines = edge_lines(network, edges, forward)
    middle = np.array([network.middle(edge)[:2] for edge in edges.tolist()]).reshape(-1, 2)
    names = ("x", "y")
    if network.plane is not None:
        names = ("lat", "lon")
        middle = np.stack(to_geographic(middle, network.plane), axis=1).round(7)

    # Columns that all kinds have, and those that some have.
    columns: dict[str, np.ndarray[Any, Any]] = {
        "kind": np.array([change.kind for change in rows], np.str_),
        "edge": edges,
        "forward": forward,
        "since": np.array([change.since for change in rows], np.float64),
        "evidence": np.array([change.evidence for change in rows], np.float64),
        names[0]: middle[:, 0],
        names[1]: middle[:, 1],
        "detected": np.array([change.detected for change in rows], np.float64),
        "delay": np.array([change.delay for change in rows], np.float64),
        "agents": np.array([change.agents for change in rows], np.int64),
        "factor": np.array([change.factor for change in rows], np.float64),
        "other": np.array([str(c.other) if c.other >= 0 else "" for c in rows], np.str_),
    }
    facts = {"threshold": found.threshold, "false_alarms": found.false_alarms, "days": found.days}
    write_edge_table(columns, target, "changes", lines=lines, network=network, facts=facts)


def _facts(
    found: Changes, target: str | None, results: Sequence[ReadResult | None]
) -> dict[str, Any]:
    """Return the result for JSON."""
    from dataclasses import asdict

    return {
        "since": found.since,
        "days": found.days,
        "threshold": found.threshold,
        "false_alarms": found.false_alarms,
        "changes": [{**asdict(change), "delay": change.delay} for change in found.changes],
        "output": target,
        "read": [reading_facts(read) for read in results],
    }


def _describe(found: Changes) -> list[str]:
    """Return lines about the changes, for a person."""
    line = (
        f"{format_count(len(found), 'change')} in {found.days:.1f} days; closures from "
        f"{found.threshold:.1f} nats of evidence on"
    )
    if np.isfinite(found.false_alarms):
        line += f", for {found.false_alarms:g} false alarms a day"
    lines = [line]
    lines += [_describe_change(change) for change in found.changes[:_MAX_NAMED]]
    if len(found) > _MAX_NAMED:
        lines.append(f"and {format_count(len(found) - _MAX_NAMED, 'more change')}")
    return lines


def _describe_change(change: Change) -> str:
    """Kind, edge, time and evidence."""
    direction = "forward" if change.forward else "backward"
    text = f"{change.kind}: edge {change.edge} {direction} since {_time_text(change.since)}, "
    text += f"{change.evidence:.1f} nats"
    if change.kind in {"closed", "one-way", "moved"}:
        text += f", {format_count(change.agents, 'agent')} turned elsewhere until it was detected, "
        text += f"after {format_duration(round(change.delay))}"
    if change.other >= 0:
        text += f", to edge {change.other}"
    if np.isfinite(change.factor):
        text += f", travel time x {change.factor:.2f}"
    return text


def _time_text(seconds: float) -> str:
    """A time in UTC, or seconds of a log whose times are no dates."""
    from datetime import UTC, datetime

    from gpszip.model.timestamps import counts_from_1970

    if not counts_from_1970(seconds):
        return f"{seconds:,.0f} s"
    return datetime.fromtimestamp(round(seconds), UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
