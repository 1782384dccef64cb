"""The options that select tracks, times and an area, for logs and for archives."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model.selection import Selection

__all__ = ["TIME", "pop_selection", "select_from", "selection_options"]

#: Years that dates of logs may have.
_FIRST_YEAR = 1900
_LAST_YEAR = 2100

F = TypeVar("F", bound=Callable[..., Any])


class _TimeType(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A time: seconds as the log counts them, or a date."""

    name = "time"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return seconds."""
        from gpszip.cli.times import parse_time

        if isinstance(value, float):
            return value
        # A year or a date in digits alone would be taken for seconds.
        date = _date_of_digits(value)
        if date is not None:
            self.fail(
                f"{value} may be a date or seconds; write {date}, or {value}.0 for seconds",
                param,
                ctx,
            )
        seconds = parse_time(value)
        if seconds is None:
            self.fail(
                f"{value!r} is no time; write a date such as 2024-05-01T10:00:00Z or seconds as "
                "the log counts them",
                param,
                ctx,
            )
        return seconds


def _date_of_digits(text: str) -> str | None:
    """Return the date that digits alone may mean, such as 2024 or 20240501; else None."""
    from datetime import date

    if not text.isdecimal() or not _FIRST_YEAR <= int(text[:4]) <= _LAST_YEAR:
        return None
    if len(text) == len("2024"):
        return f"{text}-01-01"
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        return None


#: The type of options that take a time.
TIME = _TimeType()


class _BoxType(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """Four numbers separated by commas."""

    name = "box"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return west, south, east and north."""
        if isinstance(value, tuple):
            return value
        try:
            sides = tuple(float(side) for side in value.split(","))
        except ValueError:
            sides = ()
        if len(sides) != 4:
            self.fail(
                f"{value!r} is no box; write four numbers: {param and param.metavar}", param, ctx
            )
        return sides


def selection_options(command: F) -> F:
    """Add the options --track, --since, --until and --bbox, see :func:`pop_selection`."""
    # The options in the order in which a help lists them.
    bbox = "Only this area, in degrees: 13.3,52.4,13.5,52.6. In metres: x from, y from, x to, y to."
    options = (
        click.option(
            "--track",
            "tracks",
            metavar="ID",
            multiple=True,
            help="Only this track; may be repeated.",
        ),
        click.option(
            "--since",
            type=TIME,
            metavar="TIME",
            help="Only from this time on: a date, or seconds as the log counts them.",
        ),
        click.option("--until", type=TIME, metavar="TIME", help="Only up to this time."),
        click.option("--bbox", type=_BoxType(), metavar="WEST,SOUTH,EAST,NORTH", help=bbox),
    )

    # A decorator puts its option before those that are there already.
    for option in reversed(options):
        command = option(command)
    return command


def pop_selection(choices: dict[str, Any]) -> Selection:
    """Take the values of these options out of those of a command."""
    from gpszip.model.selection import make_selection

    names = ("tracks", "since", "until", "bbox")
    return make_selection(**{name: choices.pop(name) for name in names})


def select_from(archive: Archive, selection: Selection) -> Archive:
    """Return what is selected of an archive; the archive itself if that is everything."""
    if selection.is_everything:
        return archive
    from gpszip.archive.select import select

    return select(archive, selection)
