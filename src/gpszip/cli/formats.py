"""gpszip formats: list what can be read and written."""

from __future__ import annotations

import click

from gpszip.cli.options import Settings, common_options
from gpszip.cli.outcome import Outcome

__all__ = ["command"]


@click.command("formats", short_help="List what can be read and written.")
@common_options
@click.pass_obj
def command(settings: Settings) -> Outcome:
    """List the formats of logs, maps and road networks.

    The content of a file decides on its format, whatever its name. Logs may be packed with gzip,
    or be in a zip archive.
    """
    from gpszip.cli.output import print_json
    from gpszip.io.logs.formats import log_formats
    from gpszip.io.maps.write import map_suffixes
    from gpszip.io.networks.formats import network_formats

    # For programs: which extra each format of logs needs, and whether it can be written.
    networks = [
        suffix for network_format in network_formats() for suffix in network_format.suffixes
    ]
    if settings.json:
        logs = [
            {
                "name": log_format.name,
                "suffixes": log_format.suffixes,
                "about": log_format.description,
                "write": log_format.write is not None,
                "extra": log_format.extra,
            }
            for log_format in log_formats()
        ]
        print_json({"logs": logs, "maps": map_suffixes(), "networks": networks})
        return Outcome.DONE

    # For a person: a table of logs, then the suffixes of maps and of road networks.
    click.echo("logs")
    width = max(len(log_format.name) for log_format in log_formats()) + 1
    for log_format in log_formats():
        suffixes = " ".join(log_format.suffixes)
        does = "read" if log_format.write is None else "read, write"
        needs = f"; needs gpszip[{log_format.extra}]" if log_format.extra else ""
        about = log_format.description + needs
        # Columns of the table: name, suffixes, what it does, and a description.
        click.echo(f"  {log_format.name:<{width}}{suffixes:<22}{does:<13}{about}")
    click.echo(f"maps\n  write    {' '.join(map_suffixes())}")
    click.echo(f"networks\n  read     {' '.join(networks)}")
    return Outcome.DONE
