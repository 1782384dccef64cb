"""Lines that stay where they are when they are read as linear in degrees.

A line that is straight on a metric plane is bent in latitude and longitude, and what moves on it evenly in metres does not
move evenly in degrees. At latitude 48 a leg of 220 km to the east is 1 km off. More points on the line make both as small as
they have to be: the error shrinks with the square of the distance between points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.antimeridian import wrapped
from gpszip.geo.planes import plane_changes, to_geographic
from gpszip.model import Plane

__all__ = ["straight_in_degrees"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Metres; above any radius of curvature of WGS84, so that distances come out too long rather than too short.
_RADIUS = 6_400_000.0

#: Share by which a plane may stretch distances at most, as far from its centre as any position lies.
_STRETCH = 1.01

#: Degrees of latitude above which legs are always measured: meridians meet, and no estimate holds.
_POLAR = 85.0

#: A leg is measured at these shares of it, and at its ends.
_SHARES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])

#: A leg is cut into at most so many at once, as the error may be unevenly spread.
_MOST_PARTS = 64

#: Leg and shares of it where it starts and ends, in columns.
_Pieces = tuple[Ints, Floats, Floats]


def straight_in_degrees(
    times: Floats,
    positions: Floats,
    plane: Plane,
    within: float,
    *,
    decimals: int,
    ticks: int,
    apart: NDArray[np.bool_] | None = None,
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
    within : float
        Metres by which the line in degrees may deviate. Rounding, of times, too, takes a part of it.
    decimals : int
        To which degrees are rounded.
    ticks : int
        Decimals to which times are rounded.
    apart : bool array, shape (n - 1,), optional
        Steps that are no part of the line, and are left alone.

    Returns
    -------
    times, lat, lon : float64 array, shape (m,), m >= n
        Rounded, with all of the points that were given.

    Examples
    --------
    >>> plane = Plane(((480000000, 115000000),))
    >>> line = np.array([[-100_000.0, 0.0], [100_000.0, 0.0]])
    >>> times, lat, lon = straight_in_degrees(np.array([0.0, 1e4]), line, plane, 100.0, decimals=8, ticks=6)
    >>> times.tolist()
    [0.0, 2500.0, 5000.0, 7500.0, 10000.0]
    """
    lat, lon = to_geographic(positions, plane)
    room = np.maximum(within - _shifts(times, positions, ticks), within / 4)
    legs = _suspects(positions, lat, room - _rounding(decimals)) & ~plane_changes(positions, plane)
    if apart is not None:
        legs &= ~apart
    line = _Line(times, positions, plane, room, decimals, ticks)
    number, share = line.cuts(np.flatnonzero(legs))

    # put the new points behind the starts of their legs
    order = np.lexsort((share, number))
    number, share = number[order], share[order]
    more_lat, more_lon = line.places(number, share)
    columns = (
        (np.round(times, ticks), np.round(line.times_at(number, share), ticks)),
        (np.round(lat, decimals), np.round(more_lat, decimals)),
        (np.round(lon, decimals), np.round(more_lon, decimals)),
    )
    when, north, east = (np.insert(old, number + 1, new) + 0.0 for old, new in columns)
    return when, north, east


def _rounding(decimals: int) -> float:
    """Metres by which rounding moves a place at most."""
    return float(_RADIUS * np.radians(0.5 * 10.0**-decimals) * np.sqrt(2))


def _shifts(times: Floats, positions: Floats, ticks: int) -> Floats:
    """Metres by which rounded times move what is on each leg at most."""
    moved = np.abs(np.round(times, ticks) - times)
    lengths = np.sqrt((np.diff(positions, axis=0) ** 2).sum(axis=1))
    shifts: Floats = lengths / np.diff(times) * np.maximum(moved[:-1], moved[1:])
    return shifts


def _suspects(positions: Floats, lat: Floats, within: Floats) -> NDArray[np.bool_]:
    """Legs that may be off by more than so many metres each: cheap, and true of all legs that are."""
    steps = np.diff(positions, axis=0)
    squares = np.einsum("ij,ij->i", steps, steps)
    highest = np.maximum(np.abs(lat[:-1]), np.abs(lat[1:])) + np.degrees(np.sqrt(squares) / 6e6)

    # A leg to the east bends by L^2 tan(lat) / 8 R, and is uneven by up to 1.2 times that; planes bend lines by far less.
    bend = 1.2 * np.tan(np.radians(np.minimum(highest, _POLAR))) + 0.3
    sagitta = squares * bend / (8 * 6e6)
    found: NDArray[np.bool_] = (squares > 0) & ((sagitta > within) | (highest > _POLAR))
    return found


@dataclass(frozen=True, eq=False)
class _Line:
    """A line on a plane, to be written in degrees, each leg of it within so many metres."""

    times: Floats
    positions: Floats
    plane: Plane
    within: Floats
    decimals: int
    ticks: int

    def cuts(self, legs: Ints) -> tuple[Ints, Floats]:
        """Leg and share of the leg of each point to be added."""
        pieces: _Pieces = (legs, np.zeros(len(legs)), np.ones(len(legs)))
        numbers, shares = [np.empty(0, np.int64)], [np.empty(0)]
        while len(pieces[0]):
            new, at, pieces = self._cut(pieces)
            numbers.append(new)
            shares.append(at)
        return np.concatenate(numbers), np.concatenate(shares)

    def times_at(self, legs: Ints, shares: Floats) -> Floats:
        start = self.times[legs]
        found: Floats = start + shares * (self.times[legs + 1] - start)
        return found

    def places(self, legs: Ints, shares: Floats) -> tuple[Floats, Floats]:
        start = self.positions[legs]
        return to_geographic(start + shares[:, None] * (self.positions[legs + 1] - start), self.plane)

    def _cut(self, pieces: _Pieces) -> tuple[Ints, Floats, _Pieces]:
        """Cut the pieces that are off; the points where they are cut, and what is to be measured again."""
        legs, start, end = pieces
        off = self._deviation(pieces)
        wide = off > self.within[legs]
        legs, start, end, off = legs[wide], start[wide], end[wide], off[wide]

        # the error shrinks with the square of the number of parts; half a tick would be no time
        room = np.floor((end - start) * np.diff(self.times)[legs] * 10.0**self.ticks / 2)
        within = self.within[legs]
        allowed = np.maximum(within - _rounding(self.decimals), within / 3)
        parts = np.clip(np.ceil(np.sqrt(1.05 * off / allowed)), 2, _MOST_PARTS)
        parts = np.minimum(parts, room).astype(np.int64)
        legs, start, end, parts = (column[parts > 1] for column in (legs, start, end, parts))

        # shares at which each piece is cut, moved to where the rounded time is
        first = np.cumsum(parts) - parts
        nth = np.arange(parts.sum()) - np.repeat(first, parts)
        legs = np.repeat(legs, parts)
        starts = np.repeat(start, parts) + nth * np.repeat((end - start) / parts, parts)
        inner = nth > 0
        starts[inner] = self._on_ticks(legs[inner], starts[inner])
        ends = np.append(starts[1:], 0.0)
        ends[first + parts - 1] = end
        return legs[inner], starts[inner], (legs, starts, ends)

    def _on_ticks(self, legs: Ints, shares: Floats) -> Floats:
        start = self.times[legs]
        moved: Floats = (np.round(self.times_at(legs, shares), self.ticks) - start) / (self.times[legs + 1] - start)
        return moved

    def _deviation(self, pieces: _Pieces) -> Floats:
        """Metres between the line and what is read from the rounded ends of pieces, at most."""
        legs, start, end = pieces
        shares = start + _SHARES[:, None] * (end - start)
        lat, lon = (axis.reshape(shares.shape) for axis in self.places(np.tile(legs, len(_SHARES)), shares.ravel()))

        # the chord, on the shorter way round the earth
        first, last = np.round(lat[0], self.decimals), np.round(lat[-1], self.decimals)
        west, east = np.round(lon[0], self.decimals), np.round(lon[-1], self.decimals)
        north = first + _SHARES[:, None] * (last - first) - lat
        across = wrapped(west + _SHARES[:, None] * wrapped(east - west) - lon) * np.cos(np.radians(lat))
        off: Floats = _STRETCH * _RADIUS * np.radians(np.hypot(north, across)).max(axis=0, initial=0.0)
        return off
