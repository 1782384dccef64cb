"""gpszip split: write one archive for each track, or for each period, of an archive."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.options import Settings, archive_argument, common_options, force, map_option
from gpszip.cli.outcome import Outcome
from gpszip.cli.select import print_parts, warn_of_exact_logs
from gpszip.cli.units import DURATION, is_date

if TYPE_CHECKING:
    from gpszip.archive import Archive

__all__ = ["command"]

#: Letters of track names that file systems refuse, or that lead to another folder.
_UNSAFE_LETTERS = frozenset('/\\:*?"<>|')

#: Letters of a track's name that a file name has at most.
_MAX_NAME_LETTERS = 100

#: Archives that one command writes at most.
_MAX_PARTS = 100_000


class _ByType(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """``track`` or a duration."""

    name = "by"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | str:
        """Return the word, or seconds."""
        return value if value == "track" else float(DURATION.convert(value, param, ctx))


@click.command("split", short_help="Write one archive for each track or period.")
@archive_argument
@map_option
@click.option(
    "--by",
    type=_ByType(),
    required=True,
    metavar="track|DURATION",
    help="One archive for each track, or for each period such as 1d or 1h.",
)
@click.option(
    "-o",
    "--output",
    "target",
    metavar="FOLDER",
    help="Folder for the archives. By default the name of ARCHIVE without .gpsz.",
)
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    archive: str,
    by: float | str,
    target: str | None,
    map_name: str | None,
    force: bool,
) -> Outcome:
    """Write one archive for each track, or for each period, of ARCHIVE into a folder.

    Nothing is learned anew: gpszip join makes one archive of them again. Periods begin at multiples
    of the duration, counted as the log counts its times; days are those of UTC.
    """
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import check_output
    from gpszip.container.writer import write
    from gpszip.errors import OptionError
    from gpszip.files.atomic_write import atomic_write_all
    from gpszip.files.os_errors import as_output_error

    # Where to.
    if target is None and archive == "-":
        raise OptionError("standard input has no name", remedy="name a folder with -o")
    folder = Path(target or Path(archive).with_suffix(""))
    stem = "archive" if archive == "-" else Path(archive).stem

    # Cut the archive, and refuse files that exist before the first one is written.
    with open_archive_file(archive, map_name) as whole:
        parts = list(_parts(whole, by, stem))
        tracks, has_logs = len(whole), bool(whole.exact_names)
    with as_output_error(str(folder)):
        folder.mkdir(parents=True, exist_ok=True)
    for name, _ in parts:
        check_output(str(folder / name), force=force, binary=True)

    # Write all, or none.
    paths = [str(folder / name) for name, _ in parts]
    with atomic_write_all(paths, force=force) as temporary_paths:
        for path, temporary_path, (_, part) in zip(paths, temporary_paths, parts, strict=True):
            with as_output_error(path), temporary_path.open("wb") as file:
                write(part.contents, file)
    written = [(path, len(part), part.size) for path, (_, part) in zip(paths, parts, strict=True)]
    print_parts(written, tracks, settings)
    if has_logs:
        warn_of_exact_logs(archive)
    return Outcome.DONE


def _parts(archive: Archive, by: float | str, stem: str) -> Iterator[tuple[str, Archive]]:
    """Yield file names and archives."""
    from gpszip.archive.select import select
    from gpszip.errors import OptionError
    from gpszip.model.selection import Selection

    # By track.
    if isinstance(by, str):
        taken: set[str] = set()
        for track in archive.ids:
            name = _file_name(track, taken)
            yield f"{name}.gpsz", select(archive, Selection(tracks=(track,)))
        return

    # By period: those in which some track travels.
    if not by > 0 or not math.isfinite(by):
        raise OptionError("a period has to be longer than nothing", remedy="write 1d or 1h")
    if archive.untimed:
        raise OptionError(
            f"track {archive.untimed[0]!r} has no times, and belongs to no period",
            remedy="--by track",
        )

    # Count them before the first is cut.
    periods = _travelled_periods(archive, by)
    if len(periods) > _MAX_PARTS:
        raise OptionError(
            f"{len(periods):,} periods would be as many files", remedy="give a longer period"
        )
    for number in periods:
        period = Selection(since=number * by, until=(number + 1) * by)
        yield f"{stem}-{_period_name(number, by)}.gpsz", select(archive, period)


def _travelled_periods(archive: Archive, period: float) -> list[int]:
    """Numbers of the periods in which some track travels, in order."""
    from gpszip.errors import OptionError

    numbers: set[int] = set()
    for piece in archive.decompress():
        first, last = float(piece.times[0]), float(piece.times[-1])
        # A tiny period of a long log would fill the memory before it is refused.
        if (last - first) / period > _MAX_PARTS:
            raise OptionError(
                f"more than {_MAX_PARTS:,} periods would be as many files",
                remedy="give a longer period",
            )

        # Travel that ends where a period begins is not in it.
        after = max(math.ceil(last / period), math.floor(first / period) + 1)
        numbers.update(range(math.floor(first / period), after))
    return sorted(numbers)


def _period_name(number: int, period: float) -> str:
    """Name of a period: the time at which it begins, as a date if the log has dates."""
    from datetime import UTC, datetime

    begin = number * period
    if not is_date(begin):
        return f"{begin:.10g}"
    days = period % 86400 == 0
    return datetime.fromtimestamp(begin, UTC).strftime("%Y-%m-%d" if days else "%Y-%m-%dT%H%M%S")


def _file_name(track: str, taken: set[str]) -> str:
    """File name of a track that no other track has, on any file system."""
    safe = "".join(
        "_" if letter in _UNSAFE_LETTERS or not letter.isprintable() else letter
        for letter in track[:_MAX_NAME_LETTERS]
    ).strip(" .")
    name, number = safe or "track", 1
    # Some file systems don't tell capitals from small letters.
    while name.casefold() in taken:
        number += 1
        name = f"{safe or 'track'}-{number}"
    taken.add(name.casefold())
    return name
