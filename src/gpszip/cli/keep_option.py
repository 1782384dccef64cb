"""The options for what an archive keeps beside positions: --keep, --no-ele and --keep-times."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from gpszip.cli.units import LENGTH

if TYPE_CHECKING:
    from gpszip.archive import Archive

__all__ = ["KeptColumns", "keep_options", "parse_keep"]

#: Characters with which a number begins.
_DIGITS = tuple("0123456789.")


class KeptColumns(NamedTuple):
    """What ``--keep`` and ``--no-ele`` ask for.

    Parameters
    ----------
    exact : tuple of str
        Columns to keep exactly.
    curves : tuple of (str, float)
        Columns to keep within an error.
    heights : bool
        Whether heights may be kept that no column names.
    """

    exact: tuple[str, ...]
    curves: tuple[tuple[str, float], ...]
    heights: bool

    @property
    def named(self) -> tuple[str, ...]:
        """Names of all columns."""
        return (*self.exact, *(name for name, _ in self.curves))

    def to_read(self, extended: Archive | None) -> tuple[str, ...]:
        """Columns to read: those that are named, and those of the archive that is extended."""
        from gpszip.io.logs.raw import HEIGHT

        known = () if extended is None else (*(extended.kept_columns or ()), *extended.curve_sizes)
        wanted = [name for name in known if name != HEIGHT or self.heights]
        return tuple(dict.fromkeys([*self.named, *wanted]))

    def reads_heights(self, extended: Archive | None) -> bool:
        """Whether to read heights that are not named; an archive goes on as it is."""
        from gpszip.io.logs.raw import HEIGHT, name_heights

        goes_on = extended is None or HEIGHT in extended.curve_sizes
        return self.heights and not name_heights(self.named) and goes_on


def keep_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--keep``, ``--no-ele`` and ``--keep-times``."""
    # Click lists options in the order in which they are added from the last one up.
    for option in (
        click.option("--keep-times", is_flag=True, help="Keep the times of the points exactly."),
        click.option(
            "--no-ele",
            "heights",
            is_flag=True,
            callback=lambda _context, _option, is_given: not is_given,
            help="Leave out the heights of GPX, KML, TCX and FIT, which are kept within 3 m.",
        ),
        click.option(
            "--keep",
            metavar="COLUMNS",
            help="Further columns to keep: exactly, with the times of the points, such as cad,hr; "
            "or within an error, such as ele:1m,hr:2.",
        ),
    ):
        command = option(command)
    return command


def parse_keep(text: str | None, *, heights: bool) -> KeptColumns:
    """Parse the columns of ``--keep``, each with its bound or without one.

    Parameters
    ----------
    text : str, optional
        Columns between commas.
    heights : bool
        Whether heights may be kept that no column names.

    Examples
    --------
    >>> parse_keep("hr,ele:1m,hr", heights=False)
    KeptColumns(exact=('hr',), curves=(('ele', 1.0),), heights=False)
    """
    # Drop empty and repeated names.
    names = (name.strip() for name in (text or "").split(","))
    items = [_parse_column(name) for name in dict.fromkeys(names) if name]
    return KeptColumns(
        tuple(name for name, bound in items if bound is None),
        tuple((name, bound) for name, bound in items if bound is not None),
        heights,
    )


def _parse_column(text: str) -> tuple[str, float | None]:
    """Split a column and its bound; a length is in metres, any other number as the column has it.

    Examples
    --------
    >>> _parse_column("ele:3ft"), _parse_column("hr:2"), _parse_column("tag:red")
    (('ele', 0.9144000000000001), ('hr', 2.0), ('tag:red', None))
    """
    # A colon may be part of a name, unless a number follows.
    name, colon, bound = text.rpartition(":")
    if not (colon and name.strip() and bound.strip().lstrip("+-")[:1] in _DIGITS):
        return text, None
    try:
        return name.strip(), LENGTH.parse(bound.strip())
    except ValueError as error:
        raise click.UsageError(f"--keep {text}: {error}") from None
