"""gpszip verify: check that every byte of an archive is as it was written."""

from __future__ import annotations

import click

from gpszip.cli.options import Settings, archive_argument, common, on_map
from gpszip.cli.outcome import Outcome

__all__ = ["command"]


@click.command("verify", short_help="Check every byte of an archive.")
@archive_argument
@on_map
@common
@click.pass_obj
def command(settings: Settings, archive: str, map_name: str | None) -> Outcome:
    """Check every byte of ARCHIVE and decode its walks; a corrupt archive ends with exit code 4."""
    from gpszip.cli.archives import archive_bytes, naming, read_archive
    from gpszip.cli.output import show_json

    data = archive_bytes(archive)
    with naming(archive, data):
        source = read_archive(archive, data, map_name)
        knots, tracks = sum(len(walk.nodes) for walk in source.lattice.walks), len(source.ids)
    if settings.json:
        show_json({"archive": archive, "whole": True, "bytes": len(data), "tracks": tracks, "knots": knots})
    else:
        click.echo(f"{archive}: whole; {len(data):,} bytes, tracks {tracks:,}, knots {knots:,}")
    return Outcome.DONE
