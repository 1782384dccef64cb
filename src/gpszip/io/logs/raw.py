"""What a reader of one format hands over: columns, before anything is mended."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from itertools import count

import numpy as np
from numpy.typing import NDArray

from gpszip.model.read_result import LeftOut, Repair

__all__ = ["GuessedUnit", "RawLog", "Request", "UnreadableCell", "unused_name"]


@dataclass(frozen=True)
class Request:
    """What a reader is asked for.

    Parameters
    ----------
    columns : str, sequence of str, or mapping of str to str, optional
        Names of the columns by position, or the column for each role (``{"t": "when", "x": "east"}``).
    time_unit : str, optional
        Unit of times that are numbers, one of :data:`gpszip.io.values.timestamps.TIME_UNITS`; found from their size where left out.
    keep : tuple of str
        Further columns to keep as attributes.
    heading : bool
        Keep headings, too, as attribute ``heading``, where there are some.
    dates : str, optional
        ``dmy``, ``mdy`` or ``ymd``, the order of day, month and year in dates such as 03/04/2024; found from the whole column
        where left out.
    skip_bad : bool
        Leave out parts of a log that can't be used, such as a feature of GeoJSON, and name them, instead of raising.
    times : bool
        Whether a table needs a column of times; without one, its tracks are read as shapes.
    """

    columns: Mapping[str, str] | tuple[str, ...] | None = None
    time_unit: str | None = None
    keep: tuple[str, ...] = ()
    heading: bool = False
    dates: str | None = None
    skip_bad: bool = False
    times: bool = True


@dataclass(frozen=True)
class UnreadableCell:
    """The first cell of a column that can't be read.

    Parameters
    ----------
    column : str
        Name of the column or element, such as ``lat``.
    row : int
        Index of the row, counted from 0.
    value : str
        The text of the cell, as it stands in the log.
    """

    column: str
    row: int
    value: str


@dataclass(frozen=True)
class GuessedUnit:
    """A unit of times that the user hasn't said.

    Parameters
    ----------
    unit : str
        One of :data:`gpszip.io.values.timestamps.TIME_UNITS`.
    from_name : bool
        Whether the name of the column says it, rather than the size of the numbers.
    """

    unit: str
    from_name: bool


@dataclass(frozen=True, eq=False)
class RawLog:
    """One log as its columns; rows that can't be used hold NaN.

    Parameters
    ----------
    name : str
        Name of the log in messages.
    ids : tuple of str
        Names of the tracks, in the order in which they first appear; empty for a log that names none.
    codes : int array, shape (n,), or None
        Index into ``ids`` of each row; None where all rows are one track.
    times : float64 array, shape (n,)
        Seconds.
    coordinates : float64 array, shape (n, d)
        Metres, or latitude and longitude in degrees.
    geographic : bool
        Whether the coordinates are degrees.
    attributes : mapping of str to array, shape (n,)
        Columns that were asked for.
    first : int
        Number by which messages call the first row.
    row_noun : str
        What messages call a row: ``row`` or ``point``.
    ids_are_titles : bool
        Whether ids are titles, of which two tracks may share one, rather than names of vehicles.
    dropped_columns : tuple of str
        Columns that are not kept.
    repairs : tuple of Repair
        What the reader itself had to drop; such points are not among the n rows.
    left_out : tuple of LeftOut
        Parts of the log that hold no track.
    unreadable : tuple of Unread
        For each column of times or coordinates, the first cell that holds something, but nothing that can be read.
    untimed : frozenset of int
        Codes of the tracks that have no times at all, and are read as shapes; 0 stands for the track of a log that names none.
        Their rows hold NaN for the time and are in the order of travel.
    guessed_unit : Guess, optional
        The unit in which numbers were read as times, where the user doesn't say it.
    time_of_day : bool
        Whether times are seconds from midnight, as the log has no dates.
    axes : tuple of str
        Names of the columns of coordinates, as the log gives them; empty where it has no columns.
    """

    name: str
    ids: tuple[str, ...]
    codes: NDArray[np.integer] | None
    times: NDArray[np.float64]
    coordinates: NDArray[np.float64]
    geographic: bool
    attributes: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    first: int = 1
    row_noun: str = "row"
    ids_are_titles: bool = False
    dropped_columns: tuple[str, ...] = ()
    repairs: tuple[Repair, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    unreadable: tuple[UnreadableCell, ...] = ()
    untimed: frozenset[int] = frozenset()
    guessed_unit: GuessedUnit | None = None
    time_of_day: bool = False
    axes: tuple[str, ...] = ()


def unused_name(name: str, taken: Container[str]) -> str:
    """Return the name, or the first of ``name-2``, ``name-3``, ... that is not taken.

    Examples
    --------
    >>> unused_name("walk", {"walk", "walk-2"})
    'walk-3'
    """
    if name not in taken:
        return name
    return next(other for number in count(2) if (other := f"{name}-{number}") not in taken)
