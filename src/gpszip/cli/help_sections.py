"""Sections for the options of commands that have many."""

from __future__ import annotations

from collections.abc import Sequence

import click

__all__ = ["write_sections"]

#: Options from which a help has sections; fewer are read at a glance.
_MIN_OPTIONS = 15

#: Sections in the order in which they are shown, with the names of their parameters. What no
#: section names is a matter of the command itself, and comes first.
_SECTIONS = {
    "Sources": (
        *("http", "mqtt", "gpsd", "nmea", "ros", "ros_topics", "mavlink", "signalk", "kafka"),
        "stdin",
    ),
    "Archive": ("archive", "every", "roll_now"),
    "Stream": ("stream", "batch_lines", "batch_seconds"),
    "Error bound": ("rmse", "max_error", "size", "ratio"),
    "Map": ("map_name", "update_map", "append", "network"),
    "Learning": ("effort", "coreset", "k", "m", "given", "memo", "layer"),
    "Reading": (
        "raw",
        "format",
        "columns",
        "weight",
        "time_unit",
        "dates",
        "clean",
        "sort",
        "split",
        "skip_bad",
        "gap",
    ),
    "Logs of robots": ("topics", "frame", "times_file", "rate"),
    "Selection": ("tracks", "since", "until", "bbox"),
    "What is kept": ("keep", "heights", "keep_times", "times"),
    "Work": ("memory", "workers", "engine", "scheduler", "dry_run"),
    "Output": ("target", "places_target", "kind", "force", "quiet", "json", "debug", "--help"),
}


def write_sections(
    parameters: Sequence[click.Parameter], ctx: click.Context, formatter: click.HelpFormatter
) -> None:
    """Write the help of options, in sections if there are many.

    Parameters
    ----------
    parameters : sequence of click.Parameter
        All parameters of a command, with the one for its help.
    ctx : click.Context
        The context of the command.
    formatter : click.HelpFormatter
        Takes the text.
    """
    # Options without a help are hidden.
    records = {
        _key(parameter): record
        for parameter in parameters
        if isinstance(parameter, click.Option)
        and (record := parameter.get_help_record(ctx)) is not None
    }
    if len(records) < _MIN_OPTIONS:
        _write("Options", list(records.values()), formatter)
        return

    # Options of the command itself, then the sections.
    named = {name for names in _SECTIONS.values() for name in names}
    own = [record for name, record in records.items() if name not in named]
    _write("Options", own, formatter)
    for title, names in _SECTIONS.items():
        _write(title, [records[name] for name in names if name in records], formatter)


def _key(option: click.Option) -> str:
    """Name of an option in the sections; click names that of the help as no other is named."""
    return "--help" if "--help" in option.opts else str(option.name)


def _write(title: str, records: Sequence[tuple[str, str]], formatter: click.HelpFormatter) -> None:
    if records:
        with formatter.section(title):
            formatter.write_dl(records)
