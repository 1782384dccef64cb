"""gpszip diff: compare logs with what an archive keeps of them."""

from __future__ import annotations

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.options import Settings, archive_argument, common_options
from gpszip.cli.outcome import Outcome

__all__ = ["command"]


@click.command("diff", short_help="Compare logs with what an archive keeps of them.")
@archive_argument
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, shell_complete=complete_files())
@click.option(
    "--exact", is_flag=True, help="Compare every byte, with an archive made by compress --lossless."
)
@common_options
@click.pass_obj
def command(settings: Settings, archive: str, logs: tuple[str, ...], exact: bool) -> Outcome:
    """Compare every LOG with ARCHIVE; exit code 1 and the first line that differs if one does."""
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import print_json
    from gpszip.errors import OptionError
    from gpszip.io.logs.formats import is_bundle
    from gpszip.io.storage.source import spooled
    from gpszip.pipeline.exact_logs import check_exact

    if not exact:
        raise OptionError("diff compares bytes only", remedy="add --exact")
    with open_archive_file(archive) as source, spooled(logs, unzip=is_bundle) as sources:
        size = check_exact(source, sources)
    if settings.json:
        print_json({"archive": archive, "equal": True, "logs": len(sources), "bytes": size})
    else:
        click.echo(f"{archive}: holds every byte; logs {len(sources):,}, bytes {size:,}")
    return Outcome.DONE
