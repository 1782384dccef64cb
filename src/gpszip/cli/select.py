"""gpszip select: write some tracks, a time range or an area of an archive as a new archive."""

from __future__ import annotations

from typing import Any

import click

from gpszip.cli.options import (
    Settings,
    archive_argument,
    common_options,
    force,
    map_option,
    output_option,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, select_from, selection_options

__all__ = ["command"]


@click.command("select", short_help="Write a part of an archive as a new archive.")
@archive_argument
@map_option
@output_option("part.gpsz")
@selection_options
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    archive: str,
    target: str,
    map_name: str | None,
    force: bool,
    **selecting: Any,
) -> Outcome:
    """Write some tracks, a time range or an area of ARCHIVE as a new archive.

    Nothing is learned anew: knots and positions stay what they are. A track that leaves the area
    and comes back has a gap in between. The new archive states the largest error, if ARCHIVE does;
    an RMSE need not hold for a part.
    """
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import check_output, write_archive
    from gpszip.errors import OptionError

    # Refuse what can be refused before the archive is read.
    selection = pop_selection(selecting)
    if selection.is_everything:
        raise OptionError(
            "nothing says which part", remedy="give --track, --since, --until or --bbox"
        )
    check_output(target, force=force, binary=True, in_place=True)

    # Select, and write.
    with open_archive_file(archive, map_name) as whole:
        part = select_from(whole, selection)
        tracks, has_logs = len(whole), bool(whole.exact_names)
    write_archive(target, part, force=force)
    print_parts([(target, len(part), part.size)], tracks, settings)
    if has_logs:
        warn_of_exact_logs(archive)
    return Outcome.DONE


def warn_of_exact_logs(archive: str) -> None:
    """Say that the logs which --lossless kept are in none of the new archives."""
    from gpszip.cli.output import print_status

    print_status(f"gpszip: logs kept by --lossless are not copied: keep {archive}")


def print_parts(parts: list[tuple[str, int, int]], tracks: int, settings: Settings) -> None:
    """Say what was written: name, tracks and bytes of each archive."""
    from gpszip.cli.output import STDOUT, print_json, print_status
    from gpszip.cli.units import format_bytes, format_count

    # For programs.
    to_stdout = any(name == STDOUT for name, _, _ in parts)
    if settings.json:
        facts = [{"output": name, "tracks": own, "bytes": size} for name, own, size in parts]
        print_json({"tracks": tracks, "parts": facts}, err=to_stdout)
        return

    # For a person.
    for name, own, size in parts:
        count = format_count(own, "track") if own == tracks else f"{own:,} of {tracks:,} tracks"
        print_status(f"{name}: {count}, {format_bytes(size)}")
