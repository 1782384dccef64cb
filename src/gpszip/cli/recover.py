"""gpszip recover: save the intact parts of a damaged archive."""

from __future__ import annotations

import click

from gpszip.cli.options import Settings, archive_argument, common_options, force, output_option
from gpszip.cli.outcome import Outcome

__all__ = ["command"]


@click.command("recover", short_help="Save the intact parts of a damaged archive.")
@archive_argument
@output_option("saved.gpsz")
@force
@common_options
@click.pass_obj
def command(settings: Settings, archive: str, target: str, force: bool) -> Outcome:
    """Save the intact parts of a damaged ARCHIVE as a new one, and name what is lost (exit code 3).

    Of an archive with one checksum, such as a small one, all is intact or all is lost.
    """
    from gpszip.archive import Archive
    from gpszip.cli.archives import explain_corruption, read_archive_bytes
    from gpszip.cli.output import check_output, print_json, print_status, write_archive
    from gpszip.container.recover import recover_bytes

    # Recover.
    check_output(target, force=force, binary=True)
    # The bytes are read before the output is opened: both may be one file, with --force.
    data = read_archive_bytes(archive)
    with explain_corruption(archive, data, recovering=True):
        recovered = recover_bytes(data)
    write_archive(target, Archive(recovered.contents), force=force)

    # Say what was saved and what was lost.
    tracks = recovered.contents.tracks
    if settings.json:
        print_json(
            {"output": target, "tracks": tracks, "lost": list(recovered.lost)}, err=target == "-"
        )
    else:
        lost = "; ".join(recovered.lost) or "nothing"
        print_status(f"{target}: saved tracks {tracks:,}; lost: {lost}")
    return Outcome.LEFT_OUT if recovered.lost else Outcome.DONE
