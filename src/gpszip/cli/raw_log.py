"""The log that was compressed, for commands that show it beside its archive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import robot_options, time_options, time_order_options

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import ReadResult

__all__ = ["CommandWithLogs", "raw_log_options", "read_raw_log"]

#: Options after which all words are files, up to the next option or archive.
_OPTIONS = ("--raw", "--network")

#: Suffix of archives, which never are values of these options unless they stand right behind them.
_ARCHIVE = ".gpsz"

F = TypeVar("F", bound=Callable[..., Any])


class CommandWithLogs(CommandWithFormats):
    """A command on archives whose ``--raw`` and ``--network`` take several files.

    A shell turns ``--raw rides/*.gpx`` into one option and many words.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat the option before each of its words."""
        return super().parse_args(ctx, list(_repeat_options(args)))


def raw_log_options(command: F) -> F:
    """Add --raw, and the options that say how it is read."""
    raw = "Logs that were compressed, to show and to measure."
    columns = "Which column of LOG is what: t=when,x=east,y=north."
    command = robot_options(time_options(time_order_options(command)))
    command = click.option("--columns", metavar="ROLES", help=columns)(command)
    return click.option(
        "--raw", metavar="LOG...", multiple=True, help=raw, shell_complete=complete_files()
    )(command)


def read_raw_log(raw: tuple[str, ...], archive: Archive, reading: dict[str, Any]) -> ReadResult:
    """Read the log, without times where the archive has none.

    ``reading`` holds the options of :func:`raw_log_options` but for --raw.
    """
    from gpszip.io.logs.read import read_logs

    return read_logs(raw, times=archive.timed, **reading)


def _repeat_options(arguments: Sequence[str]) -> Iterator[str]:
    """Yield arguments in which each value of such an option has its own.

    Examples
    --------
    >>> list(_repeat_options(["a.gpsz", "--raw", "1.gpx", "2.gpx", "--open"]))
    ['a.gpsz', '--raw', '1.gpx', '--raw', '2.gpx', '--open']
    >>> list(_repeat_options(["--raw", "1.gpx", "a.gpsz"]))
    ['--raw', '1.gpx', 'a.gpsz']
    """
    option, values = "", 0
    for argument in arguments:
        if argument.startswith("-") and argument != "-":
            option, values = argument if argument in _OPTIONS else "", 0
            yield argument
            continue

        # The first value follows its option; an archive ends the list of values.
        if option and values and argument.endswith(_ARCHIVE):
            option = ""
        elif option and values:
            yield option
        values += 1
        yield argument
