"""A selection: which tracks, which time range and which area a question is about."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gpszip.errors import OptionError
from gpszip.model.timestamps import Times, format_span, to_seconds

__all__ = ["EVERYTHING", "BoundingBox", "Selection", "make_selection"]

#: Degrees of a full turn.
_FULL_TURN = 360.0

#: Degrees that a side may lie east or west of Greenwich: more than 180, since a box may be written
#: without the jump at the antimeridian.
_MAX_LONGITUDE = 540.0


@dataclass(frozen=True)
class BoundingBox:
    """An area with sides along the axes, in the order of GeoJSON.

    Parameters
    ----------
    west, south, east, north : float
        Longitudes and latitudes in degrees for a log in degrees, x and y in metres for any other. A
        box in degrees whose west lies east of its east crosses the antimeridian.

    Raises
    ------
    OptionError
        If a number is not finite, or south lies north of north.

    Examples
    --------
    >>> BoundingBox(170, -20, -170, -10).width
    20.0
    """

    west: float
    south: float
    east: float
    north: float

    def __post_init__(self) -> None:
        sides = (self.west, self.south, self.east, self.north)
        if not all(map(math.isfinite, sides)):
            raise OptionError(f"a side of {self} is no number")
        if self.south > self.north:
            raise OptionError(
                f"the box {self} ends south of where it begins",
                remedy="write west,south,east,north, such as 13.3,52.4,13.5,52.6",
            )

    def __str__(self) -> str:
        return f"{self.west:g},{self.south:g},{self.east:g},{self.north:g}"

    @property
    def width(self) -> float:
        """Degrees from west to east, the way around the globe that leads east."""
        # A box that spans the globe is no box of width 0.
        width = self.east - self.west
        return width if 0 <= width <= _FULL_TURN else width % _FULL_TURN

    def check(self, *, geographic: bool) -> None:
        """Refuse a box that can't lie where the log does.

        Raises
        ------
        OptionError
            If latitudes or longitudes are off the globe, or x goes from a larger to a smaller
            number.
        """
        if not geographic:
            if self.west > self.east:
                raise OptionError(
                    f"the box {self} ends west of where it begins",
                    remedy="write x from, y from, x to, y to, in metres",
                )
            return
        latitudes, longitudes = (self.south, self.north), (self.west, self.east)
        if max(map(abs, latitudes)) > 90 or max(map(abs, longitudes)) > _MAX_LONGITUDE:
            raise OptionError(
                f"the box {self} is off the globe",
                remedy="write west,south,east,north in degrees, such as 13.3,52.4,13.5,52.6",
            )


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Which tracks, times and positions a question is about; everything by default.

    Parameters
    ----------
    tracks : tuple of str
        Names of tracks; all if empty.
    since, until : float, optional
        Seconds from and to which travel counts, both included.
    bbox : BoundingBox, optional
        The area in which travel counts.

    Raises
    ------
    OptionError
        If the time range ends before it begins.

    Examples
    --------
    >>> Selection().is_everything, Selection(since=5.0).time_range
    (True, (5.0, inf))
    """

    tracks: tuple[str, ...] = ()
    since: float | None = None
    until: float | None = None
    bbox: BoundingBox | None = None

    def __post_init__(self) -> None:
        begin, end = self.time_range
        if math.isnan(begin) or math.isnan(end):
            raise OptionError("the time range begins or ends at no time")
        if begin > end:
            raise OptionError(
                f"the time range ends before it begins: {format_span(begin, end)}",
                remedy="give the earlier time as since",
            )

    @property
    def is_everything(self) -> bool:
        """Whether nothing is left out."""
        return not self.tracks and not self.has_times and self.bbox is None

    @property
    def has_times(self) -> bool:
        """Whether the time counts, so that tracks without times are left out."""
        return self.since is not None or self.until is not None

    @property
    def time_range(self) -> tuple[float, float]:
        """The first and the last time, infinite where it is open."""
        begin = -math.inf if self.since is None else self.since
        return begin, math.inf if self.until is None else self.until


#: The selection that leaves nothing out.
EVERYTHING = Selection()


def make_selection(
    tracks: str | Iterable[str] = (),
    since: Times | None = None,
    until: Times | None = None,
    bbox: Sequence[float] | None = None,
) -> Selection:
    """Make a selection of what callers give.

    Parameters
    ----------
    tracks : str or iterable of str
        Names of tracks.
    since, until : time, optional
        ``datetime``, ``numpy.datetime64``, ISO 8601 text or seconds.
    bbox : sequence of four floats, optional
        West, south, east, north.

    Raises
    ------
    OptionError
        If a value is no time or no area.

    Examples
    --------
    >>> make_selection("bus", since="1970-01-01T00:01").since
    60.0
    """
    # The area.
    box = None
    if bbox is not None:
        sides = [float(side) for side in bbox]
        if len(sides) != 4:
            raise OptionError(
                f"a box has 4 sides, not {len(sides)}", remedy="west, south, east, north"
            )
        box = BoundingBox(*sides)

    names = (tracks,) if isinstance(tracks, str) else tuple(tracks)
    return Selection(
        tracks=names, since=_seconds(since, "since"), until=_seconds(until, "until"), bbox=box
    )


def _seconds(time: Times | None, name: str) -> float | None:
    """One time in seconds."""
    if time is None:
        return None
    seconds = to_seconds(time, name=name)
    if seconds.size != 1 or np.isnan(seconds).any():
        raise OptionError(f"{name} is {time!r}, which is not one time")
    return float(seconds.reshape(-1)[0])
