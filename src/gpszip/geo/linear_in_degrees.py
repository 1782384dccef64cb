"""Lines that stay where they are when they are read as linear in degrees.

A line that is straight on a metric plane is bent in latitude and longitude, and what moves on it evenly in metres does not
move evenly in degrees. At latitude 48 a leg of 220 km to the east is 1 km off. More points on the line make both as small as
they have to be: the error shrinks with the square of the distance between points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.antimeridian import wrap_degrees
from gpszip.geo.planes import plane_changes, to_geographic
from gpszip.model import Plane

__all__ = ["densify_for_degrees"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Metres; above any radius of curvature of WGS84, so that distances come out too long rather than too short.
_MAX_EARTH_RADIUS = 6_400_000.0

#: Share by which a plane may stretch distances at most, as far from its centre as any position lies.
_MAX_SCALE_FACTOR = 1.01

#: Degrees of latitude above which legs are always measured: meridians meet, and no estimate holds.
_POLAR_LATITUDE = 85.0

#: A leg is measured at these shares of it, and at its ends.
_PROBE_SHARES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])

#: A leg is cut into at most so many at once, as the error may be unevenly spread.
_MAX_SPLITS = 64

#: Leg and shares of it where it starts and ends, in columns.
_Subsegments = tuple[Ints, Floats, Floats]


def densify_for_degrees(
    times: Floats,
    positions: Floats,
    plane: Plane,
    max_deviation: float,
    *,
    decimals: int,
    time_decimals: int,
    skipped: NDArray[np.bool_] | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Add points to a line until latitude and longitude, rounded and read as linear in time, stay near it.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Increasing. For a line without times, any number that increases along it.
    positions : float64 array, shape (n, 2)
        Metres on the plane; the line is straight and even between two of them.
    plane : Plane
        Where they lie on the earth.
    max_deviation : float
        Metres by which the line in degrees may deviate. Rounding, of times, too, takes a part of it.
    decimals : int
        To which degrees are rounded.
    time_decimals : int
        Decimals to which times are rounded.
    skipped : bool array, shape (n - 1,), optional
        Steps that are no part of the line, and are left alone.

    Returns
    -------
    times, lat, lon : float64 array, shape (m,), m >= n
        Rounded, with all of the points that were given.

    Examples
    --------
    >>> plane = Plane(((480000000, 115000000),))
    >>> line = np.array([[-100_000.0, 0.0], [100_000.0, 0.0]])
    >>> times, lat, lon = densify_for_degrees(np.array([0.0, 1e4]), line, plane, 100.0, decimals=8, time_decimals=6)
    >>> times.tolist()
    [0.0, 2500.0, 5000.0, 7500.0, 10000.0]
    """
    lat, lon = to_geographic(positions, plane)
    room = np.maximum(
        max_deviation - _time_rounding_errors(times, positions, time_decimals), max_deviation / 4
    )
    legs = _may_deviate(positions, lat, room - _rounding_error(decimals)) & ~plane_changes(
        positions, plane
    )
    if skipped is not None:
        legs &= ~skipped
    line = _LineOnPlane(times, positions, plane, room, decimals, time_decimals)
    number, share = line.find_cuts(np.flatnonzero(legs))

    # put the new points behind the starts of their legs
    order = np.lexsort((share, number))
    number, share = number[order], share[order]
    more_lat, more_lon = line.to_degrees(number, share)
    columns = (
        (np.round(times, time_decimals), np.round(line.times_at(number, share), time_decimals)),
        (np.round(lat, decimals), np.round(more_lat, decimals)),
        (np.round(lon, decimals), np.round(more_lon, decimals)),
    )
    when, north, east = (np.insert(old, number + 1, new) + 0.0 for old, new in columns)
    return when, north, east


def _rounding_error(decimals: int) -> float:
    """Metres by which rounding moves a place at most."""
    return float(_MAX_EARTH_RADIUS * np.radians(0.5 * 10.0**-decimals) * np.sqrt(2))


def _time_rounding_errors(times: Floats, positions: Floats, time_decimals: int) -> Floats:
    """Metres by which rounded times move what is on each leg at most."""
    moved = np.abs(np.round(times, time_decimals) - times)
    lengths = np.sqrt((np.diff(positions, axis=0) ** 2).sum(axis=1))
    shifts: Floats = lengths / np.diff(times) * np.maximum(moved[:-1], moved[1:])
    return shifts


def _may_deviate(positions: Floats, lat: Floats, max_deviation: Floats) -> NDArray[np.bool_]:
    """Legs that may be off by more than so many metres each: cheap, and true of all legs that are."""
    steps = np.diff(positions, axis=0)
    squares = np.einsum("ij,ij->i", steps, steps)
    highest = np.maximum(np.abs(lat[:-1]), np.abs(lat[1:])) + np.degrees(np.sqrt(squares) / 6e6)

    # A leg to the east bends by L^2 tan(lat) / 8 R, and is uneven by up to 1.2 times that; planes bend lines by far less.
    bend = 1.2 * np.tan(np.radians(np.minimum(highest, _POLAR_LATITUDE))) + 0.3
    sagitta = squares * bend / (8 * 6e6)
    found: NDArray[np.bool_] = (squares > 0) & (
        (sagitta > max_deviation) | (highest > _POLAR_LATITUDE)
    )
    return found


@dataclass(frozen=True, eq=False)
class _LineOnPlane:
    """A line on a plane, to be written in degrees, each leg of it within so many metres."""

    times: Floats
    positions: Floats
    plane: Plane
    max_deviation: Floats
    decimals: int
    time_decimals: int

    def find_cuts(self, legs: Ints) -> tuple[Ints, Floats]:
        """Leg and share of the leg of each point to be added."""
        pieces: _Subsegments = (legs, np.zeros(len(legs)), np.ones(len(legs)))
        numbers, shares = [np.empty(0, np.int64)], [np.empty(0)]
        while len(pieces[0]):
            new, at, pieces = self._split(pieces)
            numbers.append(new)
            shares.append(at)
        return np.concatenate(numbers), np.concatenate(shares)

    def times_at(self, legs: Ints, shares: Floats) -> Floats:
        start = self.times[legs]
        found: Floats = start + shares * (self.times[legs + 1] - start)
        return found

    def to_degrees(self, legs: Ints, shares: Floats) -> tuple[Floats, Floats]:
        start = self.positions[legs]
        return to_geographic(
            start + shares[:, None] * (self.positions[legs + 1] - start), self.plane
        )

    def _split(self, pieces: _Subsegments) -> tuple[Ints, Floats, _Subsegments]:
        """Cut the pieces that are off; the points where they are cut, and what is to be measured again."""
        legs, start, end = pieces
        off = self._measure_deviation(pieces)
        wide = off > self.max_deviation[legs]
        legs, start, end, off = legs[wide], start[wide], end[wide], off[wide]

        # the error shrinks with the square of the number of parts; half a tick would be no time
        room = np.floor((end - start) * np.diff(self.times)[legs] * 10.0**self.time_decimals / 2)
        max_deviation = self.max_deviation[legs]
        allowed = np.maximum(max_deviation - _rounding_error(self.decimals), max_deviation / 3)
        parts = np.clip(np.ceil(np.sqrt(1.05 * off / allowed)), 2, _MAX_SPLITS)
        parts = np.minimum(parts, room).astype(np.int64)
        legs, start, end, parts = (column[parts > 1] for column in (legs, start, end, parts))

        # shares at which each piece is cut, moved to where the rounded time is
        first = np.cumsum(parts) - parts
        nth = np.arange(parts.sum()) - np.repeat(first, parts)
        legs = np.repeat(legs, parts)
        starts = np.repeat(start, parts) + nth * np.repeat((end - start) / parts, parts)
        inner = nth > 0
        starts[inner] = self._round_to_time(legs[inner], starts[inner])
        ends = np.append(starts[1:], 0.0)
        ends[first + parts - 1] = end
        return legs[inner], starts[inner], (legs, starts, ends)

    def _round_to_time(self, legs: Ints, shares: Floats) -> Floats:
        start = self.times[legs]
        moved: Floats = (np.round(self.times_at(legs, shares), self.time_decimals) - start) / (
            self.times[legs + 1] - start
        )
        return moved

    def _measure_deviation(self, pieces: _Subsegments) -> Floats:
        """Metres between the line and what is read from the rounded ends of pieces, at most."""
        legs, start, end = pieces
        shares = start + _PROBE_SHARES[:, None] * (end - start)
        lat, lon = (
            axis.reshape(shares.shape)
            for axis in self.to_degrees(np.tile(legs, len(_PROBE_SHARES)), shares.ravel())
        )

        # the chord, on the shorter way round the earth
        first, last = np.round(lat[0], self.decimals), np.round(lat[-1], self.decimals)
        west, east = np.round(lon[0], self.decimals), np.round(lon[-1], self.decimals)
        north = first + _PROBE_SHARES[:, None] * (last - first) - lat
        across = wrap_degrees(
            west + _PROBE_SHARES[:, None] * wrap_degrees(east - west) - lon
        ) * np.cos(np.radians(lat))
        off: Floats = (
            _MAX_SCALE_FACTOR
            * _MAX_EARTH_RADIUS
            * np.radians(np.hypot(north, across)).max(axis=0, initial=0.0)
        )
        return off
