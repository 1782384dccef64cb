"""gpszip formats: say what can be read and written."""

from __future__ import annotations

import click

from gpszip.cli.options import Settings, common_options
from gpszip.cli.outcome import Outcome

__all__ = ["command"]


@click.command("formats", short_help="Say what can be read and written.")
@common_options
@click.pass_obj
def command(settings: Settings) -> Outcome:
    """List the formats of logs, maps and road networks.

    What a log or a network is shows in its content, whatever its name; logs may be packed with gzip, or lie in a zip archive.
    """
    from gpszip.cli.output import print_json
    from gpszip.io.logs.formats import FORMATS
    from gpszip.io.maps.write import MAP_FORMATS
    from gpszip.io.networks.read import NETWORK_FORMATS

    if settings.json:
        logs = [
            {
                "name": one.name,
                "suffixes": one.suffixes,
                "about": one.description,
                "write": one.write is not None,
            }
            for one in FORMATS
        ]
        print_json({"logs": logs, "maps": list(MAP_FORMATS), "networks": list(NETWORK_FORMATS)})
        return Outcome.DONE
    click.echo("logs")
    for one in FORMATS:
        does = "read" if one.write is None else "read, write"
        click.echo(f"  {one.name:<9}{' '.join(one.suffixes):<22}{does:<13}{one.description}")
    click.echo(f"maps\n  write    {' '.join(MAP_FORMATS)}")
    click.echo(f"networks\n  read     {' '.join(NETWORK_FORMATS)}")
    return Outcome.DONE
