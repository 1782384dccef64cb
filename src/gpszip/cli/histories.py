"""Archives, or logs that are compressed on the way, for commands that ask what was."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gpszip.cli.options import (
    map_option,
    robot_options,
    skip_bad_logs,
    time_options,
    time_order_options,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, select_from, selection_options

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import ReadResult

__all__ = ["history_options", "log_options", "open_history", "outcome_of", "timezone_option"]

#: Bytes by which an archive is known.
_HEAD_BYTES = 8

#: Effort of compressing a log on the way.
_EFFORT = 1

F = TypeVar("F", bound=Callable[..., Any])


def timezone_option(command: F) -> F:
    """Add the option --timezone."""
    return click.option(
        "--timezone",
        metavar="ZONE",
        help="Time zone of hours, such as Europe/Berlin. By default that of the place, if the "
        "package timezonefinder is there, else UTC.",
    )(command)


def history_options(command: F) -> F:
    """Add the options of reading an archive, or logs that are compressed on the way."""
    return map_option(log_options(command))


def log_options(command: F) -> F:
    """Add the options of reading logs."""
    decorators: Sequence[Callable[[F], F]] = (
        click.option("--clean", is_flag=True, help="Drop outliers of logs, as compress does."),
        time_order_options,
        skip_bad_logs,
        click.option(
            "--columns", metavar="ROLES", help="Which column of logs is what: t=when,x=east."
        ),
        time_options,
        selection_options,
        robot_options,
        click.option(
            "--format",
            metavar="FORMAT",
            help="Format of logs: LOG_FORMATS; by default found from the content.",
        ),
    )
    for decorate in reversed(decorators):
        command = decorate(command)
    return command


@contextmanager
def open_history(
    names: Sequence[str], map_name: str | None, reading: dict[str, Any], *, quiet: bool = False
) -> Iterator[tuple[Archive, ReadResult | None]]:
    """Open an archive, or read logs and compress them on the way.

    Parameters
    ----------
    names : sequence of str
        One archive, or logs; ``-`` is standard input.
    map_name : str, optional
        Archive that holds the map of the archive.
    reading : dict
        Values of :func:`history_options`.
    quiet : bool
        Whether losses of logs are not told.

    Raises
    ------
    InputError, CorruptArchiveError
        If a file can't be read.
    OptionError
        If an archive is named beside other files.
    """
    from gpszip.cli.archives import explain_corruption, open_archive_bytes, read_archive_bytes
    from gpszip.errors import OptionError
    from gpszip.pipeline.diff import holds_archive

    # An archive alone.
    selection = pop_selection(reading)
    stdin = sys.stdin.buffer.read() if "-" in names else b""
    archives = [name for name in names if holds_archive(stdin if name == "-" else _head(name))]
    if archives and len(names) > 1:
        raise OptionError(
            f"{archives[0]} is an archive, and {len(names)} files were named",
            remedy="name one archive, or logs; gpszip merge makes one archive of several",
        )
    if archives:
        data = stdin or read_archive_bytes(archives[0])
        with explain_corruption(archives[0], data):
            yield select_from(open_archive_bytes(archives[0], data, map_name), selection), None
        return

    # Logs.
    from gpszip.api import compress
    from gpszip.cli.output import print_status
    from gpszip.cli.summary import describe_repairs, print_losses
    from gpszip.io.logs.read import read_logs

    sources = [BytesIO(stdin) if name == "-" else name for name in names]
    read_result = read_logs(sources, times=False, selection=selection, **reading)
    if not quiet:
        print_losses(read_result)
        for line in describe_repairs(read_result.repairs):
            print_status(f"gpszip: {line}")
    yield compress(read_result.tracks, effort=_EFFORT), read_result


def outcome_of(read_result: ReadResult | None) -> Outcome:
    """The outcome of a command: inputs may have been left out."""
    return Outcome.DONE if read_result is None or read_result.complete else Outcome.LEFT_OUT


def _head(name: str) -> bytes:
    """First bytes of a file; none where it is a pattern or lies elsewhere."""
    path = Path(name)
    if not path.is_file():
        return b""
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES)
