"""gpszip join: make one archive of those that lie on one grid, such as the parts of another."""

from __future__ import annotations

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.options import Settings, common_options, force, map_option, output_option
from gpszip.cli.outcome import Outcome
from gpszip.cli.select import warn_of_exact_logs

__all__ = ["command"]


@click.command("join", short_help="Join the parts of an archive again.")
@click.argument(
    "archives",
    metavar="ARCHIVE...",
    nargs=-1,
    required=True,
    shell_complete=complete_files(".gpsz"),
)
@map_option
@output_option("whole.gpsz")
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    archives: tuple[str, ...],
    target: str,
    map_name: str | None,
    force: bool,
) -> Outcome:
    """Join every ARCHIVE to one, without learning anything anew.

    They have to lie on one grid, as the parts do that gpszip select and gpszip split write. Tracks
    of one name become one, if they follow each other in time. gpszip merge takes any archives.
    """
    from gpszip.archive.join import join
    from gpszip.cli.archives import read_decoded_archive
    from gpszip.cli.output import check_output, print_json, print_status, write_archive
    from gpszip.cli.units import format_bytes, format_count

    # Join.
    check_output(target, force=force, binary=True, in_place=True)
    parts = [read_decoded_archive(name, map_name) for name in archives]
    whole = join(parts, names=archives)
    with_logs = [name for name, part in zip(archives, parts, strict=True) if part.exact_names]
    write_archive(target, whole, force=force)

    # Say what was written.
    if settings.json:
        facts = {"output": target, "tracks": len(whole), "bytes": whole.size}
        print_json(facts, err=target == "-")
    else:
        tracks = format_count(len(whole), "track")
        print_status(
            f"{target}: {tracks} of {len(archives):,} archives, {format_bytes(whole.size)}"
        )
    if with_logs:
        warn_of_exact_logs(" and ".join(with_logs))
    return Outcome.DONE
