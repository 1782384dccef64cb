"""Tracks as rounded rows, ready for any format to write.

Rows hold latitude and longitude, or metres. They are rounded to the decimals that the error bound
calls for. Between knots, a track is linear in time on its plane; :func:`densified_rows` adds rows
so that latitude and longitude, too, may be read as linear in time.
"""

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

#: Decimals that degrees have more than metres, to be as fine.
DEGREE_DIGITS = 5

#: Decimals of seconds: microseconds, about the resolution of a float64 that counts from 1970.
TIME_DECIMALS = 6

#: Decimals of metres if the error bound doesn't call for more.
_MIN_METRE_DECIMALS = 3

#: Decimals of metres beyond which a float64 of a position on a plane has nothing to say.
_MAX_METRE_DECIMALS = 9

#: Metres in a unit of the fifth decimal of a degree.
_FIFTH_DECIMAL_OF_DEGREE = 1.12

#: Largest move of a position by rounding, in units of the last decimal of metres.
_ROUNDING_ERROR = math.sqrt(2) / 2 * _FIFTH_DECIMAL_OF_DEGREE

#: Share of the allowed deviation that rounding positions may take; the lines between the rows may
#: take the other third.
_ROUNDING_SHARE = 2 / 3

#: Share of the allowed deviation that rounding times may take.
_TIME_SHARE = 1 / 2

#: Units of the last decimal of seconds below which steps call for finer times.
_MIN_STEP_UNITS = 8

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TrackRows:
    """A track, or a gap-free piece of one, as rows of rounded numbers.

    Parameters
    ----------
    id : str
        Name of the piece.
    track : str
        Name of its track; the same if the track has no gaps.
    times : float64 array, shape (n,), or None
        Seconds; None for a track without times.
    coordinates : float64 array, shape (n, d)
        Latitude and longitude in degrees, or metres.
    geographic : bool
        Whether the coordinates are degrees.
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
    """Round, so that the shortest text of each number has no more decimals. Minus zero becomes 0.

    Examples
    --------
    >>> round_decimals(np.array([1.23456, -0.0001]), 3).tolist()
    [1.235, 0.0]
    """
    # Adding 0.0 turns -0.0 into 0.0; it would be written as -0.0.
    rounded: Floats = np.round(values, decimals) + 0.0
    return rounded


def metre_decimals(max_deviation: float | None) -> int:
    """Return the decimals of metres with which rounding stays well within a deviation; at least 3.

    Parameters
    ----------
    max_deviation : float or None
        Metres.

    Examples
    --------
    >>> metre_decimals(None), metre_decimals(0.02), metre_decimals(0.0002)
    (3, 3, 4)
    """
    if max_deviation is None:
        return _MIN_METRE_DECIMALS
    # Rounding to k decimals moves a position by up to _ROUNDING_ERROR * 10**-k metres. The least k
    # for which this is at most _ROUNDING_SHARE * max_deviation follows from the logarithm.
    decimals = math.ceil(math.log10(_ROUNDING_ERROR / (_ROUNDING_SHARE * max_deviation)))
    return min(max(decimals, _MIN_METRE_DECIMALS), _MAX_METRE_DECIMALS)


def track_rows(track: Track, decimals: int, track_name: str | None = None) -> TrackRows:
    """Round the samples of a track, one row for each.

    Parameters
    ----------
    track : Track
        The samples.
    decimals : int
        Decimals of metres; degrees have five more, seconds have six.
    track_name : str, optional
        Name of the track that this is a piece of; its own id if left out.

    Returns
    -------
    TrackRows

    Examples
    --------
    >>> track_rows(Track("walk", [0, 0.5], [[0, 0], [1, 2.00049]]), 3).coordinates.tolist()
    [[0.0, 0.0], [1.0, 2.0]]
    """
    coordinates = round_decimals(track.positions, decimals)
    # Positions on a plane go back to the degrees that they were projected from.
    if track.plane is not None:
        degrees = np.stack(to_geographic(track.positions[:, :2], track.plane), axis=1)
        coordinates = round_decimals(degrees, decimals + DEGREE_DIGITS)
    return TrackRows(
        id=track.id,
        track=track_name or track.id,
        times=round_decimals(track.times, TIME_DECIMALS) if track.timed else None,
        coordinates=coordinates,
        geographic=track.plane is not None,
        attributes=track.attributes,
    )


def densified_rows(
    track: Track,
    decimals: int,
    max_deviation: float,
    track_name: str | None = None,
    *,
    time_decimals: int = TIME_DECIMALS,
) -> TrackRows:
    """Round the knots of a track, and add the rows that linear interpolation in degrees needs.

    Parameters
    ----------
    track : Track
        Knots, between which the track is linear in time on its plane.
    decimals : int
        Decimals of metres; degrees have five more.
    max_deviation : float
        Metres by which latitude and longitude, read as linear in time, may deviate from the track.
        A track that crosses the antimeridian has a row on each side of it.
    track_name : str, optional
        Name of the track that this is a piece of; its own id if left out.
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
    # Tracks in metres need no added rows, and texts and integers have no values between samples.
    if track.plane is None or any(each.dtype.kind != "f" for each in track.attributes.values()):
        return track_rows(track, decimals, track_name)

    # Add rows.
    if not _can_round_times(track, time_decimals, max_deviation):
        time_decimals = TIME_DECIMALS
    degree_decimals = decimals + DEGREE_DIGITS
    densified = densify_for_degrees(
        track.times,
        track.positions[:, :2],
        track.plane,
        max_deviation,
        decimals=degree_decimals,
        time_decimals=time_decimals,
    )
    times, lat, lon = insert_crossings(*densified, 10.0**-time_decimals)

    # Round.
    return TrackRows(
        id=track.id,
        track=track_name or track.id,
        times=round_decimals(times, time_decimals) if track.timed else None,
        coordinates=round_decimals(np.stack([lat, lon], axis=1), degree_decimals),
        geographic=True,
        attributes={
            name: np.interp(times, track.times, values.astype(np.float64))
            for name, values in track.attributes.items()
        },
    )


def group_into_lines(pieces: Iterable[TrackRows]) -> Iterator[tuple[str, list[TrackRows]]]:
    """Group successive pieces of a track, and cut them at the antimeridian.

    Parameters
    ----------
    pieces : iterable of TrackRows
        In the order in which they are written.

    Yields
    ------
    str, list of TrackRows
        Name of a track, and its lines in the order of travel. No line crosses the antimeridian.
    """
    # A piece goes on with the track of the piece before it, unless it is a whole track, whose id
    # and track are the same, or a piece of another one.
    name, lines = None, list[TrackRows]()
    for rows in pieces:
        is_new_track = rows.id == rows.track or rows.track != name
        if lines and is_new_track:
            yield lines[0].track, lines
            lines = []
        name, lines = rows.track, [*lines, *_cut_at_antimeridian(rows)]
    if lines:
        yield lines[0].track, lines


def _cut_at_antimeridian(rows: TrackRows) -> list[TrackRows]:
    if not rows.geographic:
        return [rows]
    # Step i leads from row i to row i + 1, so the line is cut before row i + 1.
    cuts = (np.flatnonzero(find_crossings(rows.coordinates[:, 1])) + 1).tolist()
    if not cuts:
        return [rows]
    return [rows.take(slice(a, b)) for a, b in pairwise([0, *cuts, len(rows)])]


def _can_round_times(track: Track, time_decimals: int, max_deviation: float) -> bool:
    """Whether rounded times keep knots apart and move positions by little enough."""
    if len(track) < 2 or time_decimals >= TIME_DECIMALS:
        return True
    unit = 10.0**-time_decimals
    steps = np.diff(track.times)
    lengths = np.sqrt((np.diff(track.positions, axis=0) ** 2).sum(axis=1))

    # Rounding moves a time by at most half a unit, and a position by speed times that.
    is_slow = lengths / steps * unit / 2 <= _TIME_SHARE * max_deviation
    return bool((is_slow & (steps >= _MIN_STEP_UNITS * unit)).all())
