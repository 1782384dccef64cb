"""gpszip report: write a page that tells what the history of an archive knows."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.histories import (
    check_stdin,
    is_archive,
    outcome_of,
    print_reading,
    reading_facts,
    reading_options,
    timezone_option,
)
from gpszip.cli.options import Settings, common_options, force, map_option, quiet
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import TIME

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import ReadResult
    from gpszip.view.report.report import HistoryReport

__all__ = ["command"]

#: What is added to the name of an archive or log for the name of its report.
_SUFFIX = ".report.html"

#: Name of the report where the archive comes from standard input.
_REPORT_OF_STDIN = "report.html"

#: Effort of compressing a log on the way.
_EFFORT = 1


@click.command(
    "report",
    cls=CommandWithFormats,
    short_help="Write a page that tells what a history knows.",
)
@click.argument(
    "sources",
    metavar="ARCHIVE [LOG...]|LOG...",
    nargs=-1,
    required=True,
    shell_complete=complete_files(),
)
@click.option(
    "-o",
    "--output",
    "target",
    metavar="FILE",
    help="Page to write; by default the first file's name with .report.html; - is standard output.",
    shell_complete=complete_files(),
)
@timezone_option
@click.option(
    "--since",
    "boundary",
    type=TIME,
    metavar="TIME",
    help="Tell changes, unusual trips and rounds from then on, compared with the time before. By "
    "default, changes are sought in the last quarter of all travel.",
)
@click.option("--title", metavar="TEXT", help="Title of the page; by default the file's name.")
@map_option
@reading_options
@quiet
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    sources: tuple[str, ...],
    target: str | None,
    timezone: str | None,
    boundary: float | None,
    title: str | None,
    map_name: str | None,
    quiet: bool,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Write a page about ARCHIVE: places, trips, hours, edges, changes, unusual trips, rounds.

    The page has sentences with numbers, tables, small pictures, and the map of gpszip view. It is
    one file, opens offline, and can be printed. LOG after ARCHIVE is the log that was compressed;
    without ARCHIVE, LOG is compressed on the way. What can't be told is said.
    """
    from gpszip.cli.output import check_output
    from gpszip.history.local_time import find_zone

    # Refuse what can be refused before anything is read.
    check_stdin(*sources, map_name)
    target = target or _report_name(sources[0])
    check_output(target, force=force)
    if timezone is not None:
        find_zone(timezone)

    # Find all of it, and write the page.
    with _open(sources, map_name, reading, quiet=quiet or settings.json) as (archive, log):
        name = title or ("archive" if sources[0] == "-" else Path(sources[0]).name)
        told = _build(archive, log, name, timezone, boundary)
    _write(target, told)
    _print_result(target, told, log, settings, quiet=quiet)
    return outcome_of(log)


def _report_name(source: str) -> str:
    """Name of the report of a file: in the current folder."""
    if source == "-":
        return _REPORT_OF_STDIN
    stem = Path(source).name
    return f"{stem.split('.')[0] or stem}{_SUFFIX}"


@contextmanager
def _open(
    sources: Sequence[str], map_name: str | None, reading: dict[str, Any], *, quiet: bool
) -> Iterator[tuple[Archive, ReadResult | None]]:
    """Open an archive and its log, or a log that is compressed on the way."""
    from gpszip.cli.archives import explain_corruption, open_archive_bytes, read_archive_bytes
    from gpszip.errors import OptionError

    # Logs alone.
    stdin = sys.stdin.buffer.read() if "-" in sources else b""
    first, *rest = sources
    other = next((name for name in rest if is_archive(name, stdin)), None)
    if other is not None:
        raise OptionError(
            f"{other} is an archive, and stands behind other files",
            remedy="name one archive first, then the logs that it holds",
        )
    if not is_archive(first, stdin):
        log = _read_log(sources, stdin, reading, quiet=quiet)
        from gpszip.api import compress

        yield compress(log.tracks, effort=_EFFORT), log
        return

    # An archive, and its log.
    data = stdin if first == "-" else read_archive_bytes(first)
    with explain_corruption(first, data):
        archive = open_archive_bytes(first, data, map_name)
        yield archive, _read_log(rest, stdin, reading, quiet=quiet) if rest else None


def _read_log(
    names: Sequence[str], stdin: bytes, reading: dict[str, Any], *, quiet: bool
) -> ReadResult:
    """Read logs with the errors that they state, in the order of time."""
    from gpszip.io.logs.read import read_logs

    logs = [BytesIO(stdin) if name == "-" else name for name in names]
    options = {**reading, "sort": not reading["split"]}
    log = read_logs(logs, accuracy=True, times=False, **options)
    if not quiet:
        print_reading(log)
    return log


def _build(
    archive: Archive,
    log: ReadResult | None,
    name: str,
    timezone: str | None,
    since: float | None,
) -> HistoryReport:
    from gpszip.view.report.report import report

    raw = () if log is None else log
    return report(archive, raw=raw, timezone=timezone, since=since, title=name)


def _write(target: str, told: HistoryReport) -> None:
    from gpszip.io.storage.sink import open_sink

    with open_sink(target) as stream:
        stream.write(told.html.encode("utf-8"))


def _print_result(
    target: str, told: HistoryReport, log: ReadResult | None, settings: Settings, *, quiet: bool
) -> None:
    """Say what was written, and what can't be told."""
    from gpszip.cli.output import STDOUT, print_json, print_status
    from gpszip.cli.summary import output_label

    # For programs.
    size = len(told.html.encode("utf-8"))
    if settings.json:
        facts = {"output": target, "bytes": size, **told.numbers, "read": reading_facts(log)}
        print_json(facts, err=target == STDOUT)
        return

    # For a person.
    if not quiet:
        text = f"{output_label(target)}: a report of {size / 1e6:.1f} MB"
        names = {"unusual": "unusual trips"}
        reasons = [
            f"no {names.get(part, part)}: {reason}"
            for part, reason in told.numbers["cannot_tell"].items()
        ]
        print_status("; ".join([text, *reasons]))
