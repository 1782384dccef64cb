"""What a format's reader gets and returns: a :class:`Request`, and a :class:`RawLog` of columns.

A reader only parses. Dropping bad rows, ordering by time, naming tracks and projecting onto a
plane happen afterwards, alike for all formats (:mod:`gpszip.io.logs.read`).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.model.read_result import LeftOut, Repair

__all__ = [
    "HEIGHT",
    "HEIGHT_NAMES",
    "GuessedUnit",
    "RawLog",
    "Request",
    "UnreadableCell",
    "find_kept",
    "join_batches",
    "name_heights",
    "unused_name",
]

#: Names of the attribute that holds the height above the sea in metres, the preferred one first.
#: They stand for each other: a request for one is met by another.
HEIGHT_NAMES = ("alt", "altitude", "ele", "elevation", "height")

#: The one that heights get which nobody named.
HEIGHT = "ele"


def name_heights(names: Iterable[str]) -> bool:
    """Whether any name is one of heights.

    Examples
    --------
    >>> name_heights(["hr", "Alt"]), name_heights(["hr"])
    (True, False)
    """
    return any(name.lower() in HEIGHT_NAMES for name in names)


@dataclass(frozen=True)
class Request:
    """What a user asks of a reader.

    Parameters
    ----------
    columns : mapping of str to str or tuple of str, optional
        The column for each role (``{"t": "when", "x": "east"}``), or names for the columns in
        their order.
    time_unit : str, optional
        Unit of times that are numbers, one of :data:`gpszip.io.values.timestamps.TIME_UNITS`;
        found from their size if left out.
    keep : tuple of str
        Further columns to keep as attributes.
    heading : bool
        Keep headings, if the log has some, as the attribute ``heading``.
    heights : bool
        Keep heights, if a file of GPX, KML, TCX or FIT has some, as the attribute ``ele``. Where
        ``keep`` names heights, any file may lack them, instead.
    accuracy : bool
        Keep errors of positions, if the log states them, as the attribute ``accuracy`` in metres.
    dates : str, optional
        ``dmy``, ``mdy`` or ``ymd``, the order of day, month and year in dates such as 03/04/2024;
        found from all dates of the column if left out.
    skip_bad : bool
        Leave out items that can't be used, such as a feature of GeoJSON, and list them, instead of
        raising.
    times : bool
        Whether a table needs a column of times; without one, its tracks are read as shapes.
    topics : tuple of str
        Topics of a ROS log to read, each as a track.
    frame : str, optional
        Frames of a ROS log, ``map:base_link``: the position of the second in the first, from
        transforms.
    times_file : str, optional
        File with a time in each line, for poses that have none.
    rate : float, optional
        Poses in a second, for poses that have no times.
    """

    columns: Mapping[str, str] | tuple[str, ...] | None = None
    time_unit: str | None = None
    keep: tuple[str, ...] = ()
    heading: bool = False
    accuracy: bool = False
    dates: str | None = None
    skip_bad: bool = False
    times: bool = True
    topics: tuple[str, ...] = ()
    frame: str | None = None
    times_file: str | None = None
    rate: float | None = None
    heights: bool = False

    @property
    def optional(self) -> tuple[str, ...]:
        """Columns to keep where a file has them.

        Examples
        --------
        >>> Request(heights=True).optional, Request(keep=("alt", "hr"), heights=True).optional
        (('ele',), ('alt',))
        """
        named = tuple(name for name in self.keep if name.lower() in HEIGHT_NAMES)
        return (named or (HEIGHT,)) if self.heights else ()

    @property
    def required(self) -> tuple[str, ...]:
        """Columns to keep that each file must have."""
        optional = self.optional
        return tuple(name for name in self.keep if name not in optional)


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
        Text of the cell in the log.
    """

    column: str
    row: int
    value: str


@dataclass(frozen=True)
class GuessedUnit:
    """A unit of times that the user didn't state.

    Parameters
    ----------
    unit : str
        One of :data:`gpszip.io.values.timestamps.TIME_UNITS`.
    from_name : bool
        Whether the name of the column states the unit, rather than the size of the numbers.
    """

    unit: str
    from_name: bool


@dataclass(frozen=True, eq=False)
class RawLog:
    """One log as columns. Cells that can't be read are NaN.

    Parameters
    ----------
    name : str
        Name of the log in messages.
    ids : tuple of str
        Names of the tracks in the order of their first rows; empty for a log that names none.
    codes : int array, shape (n,), or None
        Index into ``ids`` for each row; None if all rows are one track.
    times : float64 array, shape (n,)
        Seconds.
    coordinates : float64 array, shape (n, d)
        Metres, or latitude and longitude in degrees.
    geographic : bool
        Whether the coordinates are degrees.
    attributes : mapping of str to array, shape (n,)
        Columns that the request keeps.
    first : int
        Number of the first row in messages.
    row_noun : str
        Word for a row in messages: ``row`` or ``point``.
    ids_are_titles : bool
        Whether ids are titles, which two tracks may share, rather than names of vehicles.
    dropped_columns : tuple of str
        Columns that are not kept.
    repairs : tuple of Repair
        What the reader had to drop or change. Points that it dropped are not among the n rows.
    left_out : tuple of LeftOut
        Items of the log that hold no track.
    unreadable : tuple of UnreadableCell
        For each column of times or coordinates, the first cell with a value that can't be read.
        Cells of times come before cells of coordinates.
    untimed : frozenset of int
        Codes of the tracks without any times, which are read as shapes; 0 for the track of a log
        that names none. Their rows have NaN for the time and are in the order of travel.
    guessed_unit : GuessedUnit, optional
        The unit in which numbers were read as times, if the user didn't state it.
    time_of_day : bool
        Whether times are seconds from midnight, since the log has no dates.
    axes : tuple of str
        Names of the columns of coordinates in the log; empty if the log has no columns.
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


def join_batches(logs: Sequence[RawLog]) -> RawLog:
    """Join the batches of a file, of which the last one names all tracks.

    Parameters
    ----------
    logs : sequence of RawLog
        At least one, in the order of the file, with the same attributes.

    Examples
    --------
    >>> logs = [
    ...     RawLog("a", ("p",), np.array([0]), np.zeros(1), np.zeros((1, 2)), True),
    ...     RawLog("a", ("p", "q"), np.array([1]), np.ones(1), np.ones((1, 2)), True, first=2),
    ... ]
    >>> joined = join_batches(logs)
    >>> joined.ids, joined.codes.tolist(), joined.times.tolist(), joined.first
    (('p', 'q'), [0, 1], [0.0, 1.0], 1)
    """
    # What single batches say: rows count from the start of the file.
    last = logs[-1]
    codes = [log.codes for log in logs if log.codes is not None]
    cells = (replace(cell, row=cell.row + log.first - 1) for log in logs for cell in log.unreadable)
    unreadable: dict[str, UnreadableCell] = {}
    for cell in cells:
        unreadable.setdefault(cell.column, cell)

    return replace(
        last,
        codes=np.concatenate(codes) if codes else None,
        times=np.concatenate([log.times for log in logs]),
        coordinates=np.concatenate([log.coordinates for log in logs]),
        attributes={
            name: np.concatenate([log.attributes[name] for log in logs]) for name in last.attributes
        },
        first=1,
        dropped_columns=tuple(dict.fromkeys(chain(*(log.dropped_columns for log in logs)))),
        repairs=tuple(chain(*(log.repairs for log in logs))),
        left_out=tuple(chain(*(log.left_out for log in logs))),
        unreadable=tuple(unreadable.values()),
    )


def find_kept(
    request: Request, synonyms: Mapping[str, tuple[str, ...]], heading: str, where: str
) -> dict[str, str]:
    """Return the column to keep for each name that was asked for.

    Parameters
    ----------
    request : Request
        The names.
    synonyms : mapping of str to tuple of str
        Names by which each column may be asked for, in lower case.
    heading : str
        The column that is kept if headings are.
    where : str
        Name of the file for messages.

    Raises
    ------
    InputError
        If no column has a name that was asked for.

    Examples
    --------
    >>> find_kept(Request(keep=("Height",)), {"alt": HEIGHT_NAMES, "course": ()}, "course", "a")
    {'Height': 'alt'}
    """
    kept = {}
    for name in request.keep:
        columns = [column for column, names in synonyms.items() if name.lower() in names]
        if not columns:
            shown = ", ".join(synonyms)
            raise InputError(f"no {name!r} to keep", path=where, remedy=f"its points have: {shown}")
        kept[name] = columns[0]
    if request.accuracy and "accuracy" in synonyms:
        kept["accuracy"] = "accuracy"
    return {**kept, "heading": heading} if request.heading else kept


def unused_name(name: str, taken: Container[str]) -> str:
    """Return the name, or one of ``name-2``, ``name-3``, ... that is not taken.

    It is the first one if the numbers that are taken have no gap. A search by bisection keeps the
    work small where a file has 100,000 tracks of one name.

    Examples
    --------
    >>> unused_name("walk", {"walk", "walk-2"})
    'walk-3'
    """
    if name not in taken:
        return name

    # Double the number until it is free.
    taken_number, free_number = 1, 2
    while f"{name}-{free_number}" in taken:
        taken_number, free_number = free_number, 2 * free_number

    # Bisect between the last two.
    while free_number - taken_number > 1:
        number = (taken_number + free_number) // 2
        if f"{name}-{number}" in taken:
            taken_number = number
        else:
            free_number = number
    return f"{name}-{free_number}"
