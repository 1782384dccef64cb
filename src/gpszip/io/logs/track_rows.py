"""The numbers that a file of tracks holds, before any format writes them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.antimeridian import find_crossings, insert_crossings
from gpszip.geo.linear_in_degrees import densify_for_degrees
from gpszip.geo.planes import to_geographic
from gpszip.model import Track

__all__ = [
    "DEGREE_DIGITS",
    "TIME_DECIMALS",
    "TrackRows",
    "densified_rows",
    "group_into_lines",
    "metre_decimals",
    "round_decimals",
    "track_rows",
]

#: Degrees need this many decimals more than metres to be as fine.
DEGREE_DIGITS = 5

#: Decimals of seconds: microseconds, about what a float holds of an epoch.
TIME_DECIMALS = 6

#: Decimals of metres where nothing finer is called for.
_MIN_METRE_DECIMALS = 3

#: More decimals than a float64 holds of a position on a plane are of no use.
_MAX_METRE_DECIMALS = 9

#: Rounding to the last decimal of metres moves a place by at most so many units of it.
_ROUNDING_ERROR = math.sqrt(2) / 2 * 1.12  # the fifth decimal of a degree is 1.12 m

#: Share of the allowed deviation that rounding may take; the rest is left to the line between the points.
_ROUNDING_SHARE = 2 / 3

#: Times are rounded to a coarser decimal where this moves what is on the way by at most this share of what is allowed.
_TIME_SHARE = 1 / 2

#: Steps shorter than so many units of the last decimal of seconds call for finer times.
_MIN_STEP_UNITS = 8

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TrackRows:
    """A track, or a piece of one between gaps, as rows of rounded numbers.

    Parameters
    ----------
    id : str
        Name of the piece.
    track : str
        Name of the track that it is a piece of; the same where the track has no gaps.
    times : float64 array, shape (n,), or None
        Seconds; None for a track without times.
    coordinates : float64 array, shape (n, d)
        Latitude and longitude in degrees, or metres.
    geographic : bool
        Whether the places are degrees.
    attributes : mapping of str to array, shape (n,)
        Further columns.
    """

    id: str
    track: str
    times: Floats | None
    coordinates: Floats
    geographic: bool
    attributes: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.coordinates)

    def take(self, rows: slice) -> TrackRows:
        """Return some of the rows."""
        times = None if self.times is None else self.times[rows]
        attributes = {name: values[rows] for name, values in self.attributes.items()}
        return TrackRows(
            self.id, self.track, times, self.coordinates[rows], self.geographic, attributes
        )


def round_decimals(values: Floats, decimals: int) -> Floats:
    """Round to decimals, so that the shortest text of each number has no more of them; there is no minus zero.

    Examples
    --------
    >>> round_decimals(np.array([1.23456, -0.0001]), 3).tolist()
    [1.235, 0.0]
    """
    rounded: Floats = np.round(values, decimals) + 0.0
    return rounded


def metre_decimals(max_deviation: float | None) -> int:
    """Decimals of metres with which rounding stays well within so many metres; 3 where they do.

    Examples
    --------
    >>> metre_decimals(None), metre_decimals(0.02), metre_decimals(0.0002)
    (3, 3, 4)
    """
    if max_deviation is None:
        return _MIN_METRE_DECIMALS
    fine = math.ceil(math.log10(_ROUNDING_ERROR / (_ROUNDING_SHARE * max_deviation)))
    return min(max(fine, _MIN_METRE_DECIMALS), _MAX_METRE_DECIMALS)


def track_rows(track: Track, decimals: int, whole: str | None = None) -> TrackRows:
    """Round the samples of a track, one row for each.

    Parameters
    ----------
    track : Track
        The samples.
    decimals : int
        Of metres; degrees have five more, seconds have six.
    whole : str, optional
        Name of the track that this is a piece of; by default its own.

    Returns
    -------
    TrackRows

    Examples
    --------
    >>> track_rows(Track("walk", [0, 0.5], [[0, 0], [1, 2.00049]]), 3).coordinates.tolist()
    [[0.0, 0.0], [1.0, 2.0]]
    """
    places = round_decimals(track.positions, decimals)
    if track.plane is not None:
        places = round_decimals(
            np.stack(to_geographic(track.positions[:, :2], track.plane), axis=1),
            decimals + DEGREE_DIGITS,
        )
    times = round_decimals(track.times, TIME_DECIMALS) if track.timed else None
    return TrackRows(
        track.id, whole or track.id, times, places, track.plane is not None, track.attributes
    )


def densified_rows(
    track: Track,
    decimals: int,
    max_deviation: float,
    whole: str | None = None,
    *,
    ticks: int = TIME_DECIMALS,
) -> TrackRows:
    """Round the knots of a track, with as many more rows as linear interpolation of the columns needs.

    Parameters
    ----------
    track : Track
        Knots, between which the track is linear in time on its plane.
    decimals : int
        Of metres; degrees have five more.
    max_deviation : float
        Metres by which latitude and longitude, read as linear in time, may deviate from the track. A track that crosses the
        antimeridian has a row on each side of it.
    whole : str, optional
        Name of the track that this is a piece of; by default its own.
    time_decimals : int
        Decimals of seconds if these are fine enough; else times have six.

    Returns
    -------
    TrackRows

    Examples
    --------
    >>> from gpszip.model import Plane
    >>> plane = Plane(((480000000, 115000000),))
    >>> track = Track("flight", [0.0, 600.0], [[0.0, 0.0], [100_000.0, 0.0]], plane=plane)
    >>> len(track_rows(track, 3)), len(densified_rows(track, 3, 1.0))
    (2, 17)
    """
    if track.plane is None or track.attributes:
        return track_rows(track, decimals, whole)
    ticks = ticks if _can_round_times(track, ticks, max_deviation) else TIME_DECIMALS
    digits = decimals + DEGREE_DIGITS
    straight = densify_for_degrees(
        track.times,
        track.positions[:, :2],
        track.plane,
        max_deviation,
        decimals=digits,
        time_decimals=ticks,
    )
    times, lat, lon = insert_crossings(*straight, 10.0**-ticks)
    places = round_decimals(np.stack([lat, lon], axis=1), digits)
    return TrackRows(
        track.id,
        whole or track.id,
        round_decimals(times, ticks) if track.timed else None,
        places,
        geographic=True,
    )


def group_into_lines(pieces: Iterable[TrackRows]) -> Iterator[tuple[str, list[TrackRows]]]:
    """Gather the pieces of each track that follow each other, and cut them at the antimeridian.

    Parameters
    ----------
    pieces : iterable of TrackRows
        In the order in which they are to be written.

    Yields
    ------
    str, list of TrackRows
        Name of a track, and its lines in the order of travel, none of which crosses the antimeridian.
    """
    name, lines = None, list[TrackRows]()
    for rows in pieces:
        if lines and (rows.id == rows.track or rows.track != name):
            yield lines[0].track, lines
            lines = []
        name, lines = rows.track, [*lines, *_cut_at_antimeridian(rows)]
    if lines:
        yield lines[0].track, lines


def _cut_at_antimeridian(rows: TrackRows) -> list[TrackRows]:
    ends = (
        [0, *(np.flatnonzero(find_crossings(rows.coordinates[:, 1])) + 1).tolist(), len(rows)]
        if rows.geographic
        else [0, len(rows)]
    )
    return [rows] if len(ends) == 2 else [rows.take(slice(a, b)) for a, b in pairwise(ends)]


def _can_round_times(track: Track, ticks: int, max_deviation: float) -> bool:
    """Whether times may be rounded to so many decimals: no knots fall together, and nothing moves far in half a unit."""
    if len(track) < 2 or ticks >= TIME_DECIMALS:
        return True
    unit = 10.0**-ticks
    steps, ways = np.diff(track.times), np.sqrt((np.diff(track.positions, axis=0) ** 2).sum(axis=1))
    slow = ways / steps * unit / 2 <= _TIME_SHARE * max_deviation
    return bool((slow & (steps >= _MIN_STEP_UNITS * unit)).all())
