"""gpszip verify: check every byte of an archive."""

from __future__ import annotations

import click

from gpszip.cli.options import Settings, archive_argument, common_options, map_option
from gpszip.cli.outcome import Outcome

__all__ = ["command"]


@click.command("verify", short_help="Check every byte of an archive.")
@archive_argument
@map_option
@common_options
@click.pass_obj
def command(settings: Settings, archive: str, map_name: str | None) -> Outcome:
    """Check every byte of ARCHIVE, and decode its walks and the logs that it keeps exactly.

    A corrupt archive ends with exit code 4.
    """
    from gpszip.archive.exact import find_exact_logs
    from gpszip.cli.archives import explain_corruption, open_archive_bytes, read_archive_bytes
    from gpszip.cli.output import print_json

    # Check and decode.
    data = read_archive_bytes(archive)
    with explain_corruption(archive, data):
        # Opening checks the checksums; to decode all walks also finds bytes that are none in spite
        # of them.
        source = open_archive_bytes(archive, data, map_name)
        knots = sum(len(walk.nodes) for walk in source.grid_walks.walks)
        tracks = len(source.ids)
        exact = find_exact_logs(source)
        if exact is not None:
            exact.check()
        source.check_curves()

    # Say what was found.
    if settings.json:
        print_json(
            {
                "archive": archive,
                "whole": True,
                "bytes": len(data),
                "tracks": tracks,
                "knots": knots,
            }
        )
    else:
        click.echo(f"{archive}: intact; {len(data):,} bytes, tracks {tracks:,}, knots {knots:,}")
    return Outcome.DONE
