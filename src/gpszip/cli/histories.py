"""Archives, or logs that are compressed on the way, for commands that ask what was."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gpszip.cli.completing import complete_files
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

__all__ = [
    "check_stdin",
    "check_tables",
    "find_archive",
    "history_options",
    "is_archive",
    "log_options",
    "open_history",
    "outcome_of",
    "print_reading",
    "reading_facts",
    "reading_options",
    "sources_argument",
    "timezone_option",
]

#: Bytes by which an archive is known.
_HEAD_BYTES = 8

#: Effort of compressing a log on the way.
_EFFORT = 1

#: Values of the options of a selection that selects everything.
_NO_SELECTION: dict[str, Any] = {"tracks": (), "since": None, "until": None, "bbox": None}

F = TypeVar("F", bound=Callable[..., Any])


def sources_argument(command: F) -> F:
    """Add the argument of one archive, or of logs."""
    return click.argument(
        "sources",
        metavar="ARCHIVE|LOG...",
        nargs=-1,
        required=True,
        shell_complete=complete_files(),
    )(command)


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
    """Add the options of reading logs, and parts of them."""
    return reading_options(selection_options(command))


def reading_options(command: F) -> F:
    """Add the options of reading logs as a whole."""
    decorators: Sequence[Callable[[F], F]] = (
        click.option("--clean", is_flag=True, help="Drop outliers of logs, as compress does."),
        time_order_options,
        skip_bad_logs,
        click.option(
            "--columns", metavar="ROLES", help="Which column of logs is what: t=when,x=east."
        ),
        time_options,
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

    # An archive alone. A command without a selection takes all of it.
    selection = pop_selection({**_NO_SELECTION, **reading})
    reading = {name: value for name, value in reading.items() if name not in _NO_SELECTION}
    check_stdin(*names, map_name)
    stdin = sys.stdin.buffer.read() if "-" in names else b""
    name = find_archive(names, stdin)
    if name is not None:
        data = stdin or read_archive_bytes(name)
        with explain_corruption(name, data):
            yield select_from(open_archive_bytes(name, data, map_name), selection), None
        return

    # Logs.
    from gpszip.api import compress
    from gpszip.io.logs.read import read_logs

    sources = [BytesIO(stdin) if name == "-" else name for name in names]
    read_result = read_logs(sources, times=False, selection=selection, **reading)
    if not quiet:
        print_reading(read_result)
    yield compress(read_result.tracks, effort=_EFFORT), read_result


def outcome_of(read_result: ReadResult | None) -> Outcome:
    """The outcome of a command: inputs may have been left out."""
    return Outcome.DONE if read_result is None or read_result.complete else Outcome.LEFT_OUT


def print_reading(read_result: ReadResult) -> None:
    """Say what reading a log lost and repaired."""
    from gpszip.cli.output import print_status
    from gpszip.cli.summary import describe_repairs, print_losses

    print_losses(read_result)
    for line in describe_repairs(read_result.repairs):
        print_status(f"gpszip: {line}")


def reading_facts(read_result: ReadResult | None) -> dict[str, Any] | None:
    """What reading logs lost, repaired and left out, for JSON; None for an archive."""
    from gpszip.cli.summary import losses_as_dict, repairs_as_dict

    if read_result is None:
        return None
    repairs = repairs_as_dict(read_result.repairs, read_result.left_out)
    return {**losses_as_dict(read_result), **repairs}


def find_archive(names: Sequence[str], stdin: bytes) -> str | None:
    """Return the archive that was named; None for logs.

    Parameters
    ----------
    names : sequence of str
        One archive, or logs.
    stdin : bytes
        What ``-`` is.

    Raises
    ------
    OptionError
        If an archive is named beside other files.
    """
    from gpszip.errors import OptionError

    found = next((name for name in names if is_archive(name, stdin)), None)
    if found is not None and len(names) > 1:
        raise OptionError(
            f"{found} is an archive, and {len(names)} files were named",
            remedy="name one archive, or logs; gpszip merge makes one archive of several",
        )
    return found


def is_archive(name: str, stdin: bytes) -> bool:
    """Whether a file begins like an archive; a pattern, or what is no file, does not.

    Parameters
    ----------
    name : str
        Name of the file.
    stdin : bytes
        What ``-`` is.
    """
    from gpszip.pipeline.diff import holds_archive

    path = Path(name)
    if name == "-" or not path.is_file():
        return name == "-" and holds_archive(stdin)
    with path.open("rb") as file:
        return holds_archive(file.read(_HEAD_BYTES))


def check_stdin(*names: str | None) -> None:
    """Refuse inputs of which two are standard input, as it can be read only once."""
    from gpszip.errors import OptionError

    if names.count("-") > 1:
        raise OptionError(
            "standard input is named twice, and can be read only once",
            remedy="name a file for one of them",
        )


def check_tables(*targets: str | None) -> None:
    """Refuse tables of which two would be written to the same file, or to standard output."""
    from gpszip.errors import OptionError

    named = [target for target in targets if target is not None]
    if named.count("-") > 1:
        raise OptionError("two tables can't be on standard output", remedy="name a file for one")
    files = [Path(target).resolve() for target in named]
    if len(set(files)) < len(files):
        raise OptionError(
            f"two tables can't be in the same file {named[-1]}", remedy="name another file for one"
        )
