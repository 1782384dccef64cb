"""Help texts that list formats, taken from the tables of formats when the help is shown.

Imports of the tables take longer than other help texts may, so they wait for this moment.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy

import click

from gpszip.cli.help_sections import write_sections
from gpszip.errors import GPSZipError

__all__ = ["CommandWithFormats"]


def _list_logs() -> str:
    from gpszip.io.logs.formats import log_formats

    return ", ".join(log_format.name for log_format in log_formats())


def _list_written_logs() -> str:
    from gpszip.io.logs.formats import log_formats

    return ", ".join(
        log_format.name for log_format in log_formats() if log_format.write is not None
    )


def _list_networks() -> str:
    from gpszip.io.networks.formats import describe_network_formats

    return describe_network_formats()


def _list_maps() -> str:
    from gpszip.io.maps.write import map_formats

    return ", ".join(map_format.name for map_format in map_formats())


def _list_routes() -> str:
    from gpszip.io.maps.routes import ROUTE_FORMATS

    return " or ".join(ROUTE_FORMATS)


def _list_segments() -> str:
    from gpszip.io.segments import SEGMENT_FORMATS

    return ", ".join(SEGMENT_FORMATS)


#: What stands for a list in help texts, and how the list is made.
#: A name that contains another one comes before it: LOG_FORMATS is a part of WRITTEN_LOG_FORMATS.
_LISTS: dict[str, Callable[[], str]] = {
    "WRITTEN_LOG_FORMATS": _list_written_logs,
    "LOG_FORMATS": _list_logs,
    "NETWORK_FORMATS": _list_networks,
    "MAP_FORMATS": _list_maps,
    "ROUTE_FORMATS": _list_routes,
    "SEGMENT_FORMATS": _list_segments,
}


class CommandWithFormats(click.Command):
    """A command whose help texts contain ``NETWORK_FORMATS`` or another name of a list."""

    def filled(self) -> CommandWithFormats:
        """Return a copy with the lists in its help texts; they change when a package comes."""
        command = copy(self)
        command.help = _fill(self.help)
        command.params = [copy(parameter) for parameter in self.params]
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                parameter.help = _fill(parameter.help)
        return command

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help of the command with the lists."""
        click.Command.format_help(self.filled(), ctx, formatter)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, in sections if there are many."""
        write_sections(self.get_params(ctx), ctx, formatter)


def _fill(text: str | None) -> str | None:
    for placeholder, make_list in _LISTS.items():
        if text and placeholder in text:
            text = text.replace(placeholder, _list_or_hint(make_list))
    return text


def _list_or_hint(make_list: Callable[[], str]) -> str:
    """Return a list; if a plugin can't be loaded, name the command that reports it."""
    try:
        return make_list()
    except GPSZipError:
        return "see 'gpszip formats'"
