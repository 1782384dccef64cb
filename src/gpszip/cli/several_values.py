"""Options that take several words, as a shell makes them of a pattern."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import click

from gpszip.cli.format_lists import CommandWithFormats

__all__ = ["CommandWithLogs"]

#: Options after which all words are files, up to the next option or archive.
_OPTIONS = ("--raw", "--network")

#: Suffix of archives, which never are values of these options unless they stand right behind them.
_ARCHIVE = ".gpsz"


class CommandWithLogs(CommandWithFormats):
    """A command on archives whose ``--raw`` and ``--network`` take several files.

    A shell turns ``--raw rides/*.gpx`` into one option and many words.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat the option before each of its words."""
        return super().parse_args(ctx, list(_repeat_options(args)))


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
