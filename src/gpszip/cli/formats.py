"""gpszip formats: list what can be read and written."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gpszip.cli.options import Settings, common_options
from gpszip.cli.outcome import Outcome

if TYPE_CHECKING:
    from gpszip.io.logs.log_format import LogFormat

__all__ = ["command"]

#: Columns of the table of logs.
_HEADER = ("format", "suffixes", "does", "in batches", "needs", "what it holds")


@click.command("formats", short_help="List what can be read and written.")
@common_options
@click.pass_obj
def command(settings: Settings) -> Outcome:
    """List the formats of logs, maps and road networks.

    The content of a file decides on its format, whatever its name. Logs may be packed with gzip,
    or lie in a folder or a zip archive, among other files. Those that are read in batches may be
    larger than memory.
    """
    from gpszip.cli.output import print_json
    from gpszip.io.logs.formats import log_formats
    from gpszip.io.maps.write import map_suffixes
    from gpszip.io.networks.formats import network_formats

    # For programs.
    networks = [
        suffix for network_format in network_formats() for suffix in network_format.suffixes
    ]
    if settings.json:
        logs = [_facts(log_format) for log_format in log_formats()]
        print_json({"logs": logs, "maps": map_suffixes(), "networks": networks})
        return Outcome.DONE

    # For a person: a table of logs, then the suffixes of maps and of road networks.
    click.echo("logs")
    rows = [_HEADER, *map(_row, log_formats())]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
        click.echo(f"  {'  '.join(cells).rstrip()}")
    click.echo(f"maps\n  write    {' '.join(map_suffixes())}")
    click.echo(f"networks\n  read     {' '.join(networks)}")
    return Outcome.DONE


def _facts(log_format: LogFormat) -> dict[str, object]:
    """Return what a program may want to know of a format of logs."""
    return {
        "name": log_format.name,
        "suffixes": log_format.suffixes,
        "about": log_format.description,
        "write": log_format.write is not None,
        "batches": log_format.read_batches is not None,
        "extra": log_format.extra,
    }


def _row(log_format: LogFormat) -> tuple[str, ...]:
    """Return the row of a format in the table for a person."""
    return (
        log_format.name,
        " ".join(log_format.suffixes) or "-",
        "read" if log_format.write is None else "read, write",
        "no" if log_format.read_batches is None else "yes",
        f"gpszip[{log_format.extra}]" if log_format.extra else "-",
        log_format.description,
    )
