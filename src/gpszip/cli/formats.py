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
    from gpszip.io.logs.formats import FORMATS
    from gpszip.io.maps.write import map_suffixes
    from gpszip.io.networks.formats import network_formats

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
            }
            for log_format in FORMATS
        ]
        print_json({"logs": logs, "maps": map_suffixes(), "networks": networks})
        return Outcome.DONE

    click.echo("logs")
    for log_format in FORMATS:
        suffixes = " ".join(log_format.suffixes)
        does = "read" if log_format.write is None else "read, write"
        click.echo(f"  {log_format.name:<9}{suffixes:<22}{does:<13}{log_format.description}")
    click.echo(f"maps\n  write    {' '.join(map_suffixes())}")
    click.echo(f"networks\n  read     {' '.join(networks)}")
    return Outcome.DONE
