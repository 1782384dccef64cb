"""Stays, trips and places: what :func:`gpszip.trips` returns."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.text import count_text

__all__ = ["Place", "Stay", "Trip", "Trips"]


@dataclass(frozen=True)
class Stay:
    """A stay of a track at a place.

    Parameters
    ----------
    track : str
        Name of the track.
    start, end : float
        Seconds, as the log counts them. Estimated where the log is silent around them.
    first_seen, last_seen : float
        Times of the first and the last fix at the place.
    place : int
        Number of the place, from 1.
    position : tuple of float
        Its own centre: latitude and longitude, or x, y[, z] in metres.
    spread : float
        Typical distance of the track from there in metres.
    pause : bool
        Whether it lies within a trip, which goes on in its direction.
    """

    track: str
    start: float
    end: float
    first_seen: float
    last_seen: float
    place: int
    position: tuple[float, ...]
    spread: float
    pause: bool


@dataclass(frozen=True, eq=False)
class Trip:
    """A trip of a track.

    Parameters
    ----------
    track : str
        Name of the track.
    start, end : float
        Seconds, as the log counts them.
    origin, goal : int
        Numbers of the places from which and to which it leads.
    begin, finish : tuple of float
        Where it begins and ends: latitude and longitude, or x, y[, z] in metres.
    length : float
        Metres travelled, gaps by straight lines.
    moving : float
        Seconds in motion, without red lights and pauses.
    line : float64 array, shape (n, d)
        Positions on the way, in the coordinates of the log.
    """

    track: str
    start: float
    end: float
    origin: int
    goal: int
    begin: tuple[float, ...]
    finish: tuple[float, ...]
    length: float
    moving: float
    line: NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """Stays of all tracks and days that lie together.

    Parameters
    ----------
    number : int
        From 1, by the time spent there.
    position : tuple of float
        Latitude and longitude, or x, y[, z] in metres.
    spread : float
        Root mean square distance of the stays from there in metres.
    visits : int
        Number of stays; 0 where trips begin or end without a stay.
    dwell : float
        Seconds of all stays.
    first, last : float
        Seconds: begin of the first stay and end of the last one.
    departures, arrivals : int
        Numbers of trips from there and to there.
    hours : tuple of float
        Seconds spent there in each local hour of the day, 0 to 23; empty for a log whose times are
        no dates.
    weekdays : tuple of float
        Seconds spent there on each local weekday from Monday; empty as ``hours``.
    usual : str
        Local hours in which the place is occupied on half of the days with a visit, or more, such
        as ``0-7, 18-24``.
    role : str
        What the place seems to be: ``home`` where most nights are spent, ``work`` where most
        working hours, or empty; also where nothing tells the time zone.
    evidence : str
        The counts behind the role.
    """

    number: int
    position: tuple[float, ...]
    spread: float
    visits: int
    dwell: float
    first: float
    last: float
    departures: int
    arrivals: int
    hours: tuple[float, ...]
    weekdays: tuple[float, ...]
    usual: str
    role: str
    evidence: str


@dataclass(frozen=True, eq=False, repr=False)
class Trips:
    """Stays, trips and places of a log or an archive.

    Parameters
    ----------
    stays : tuple of Stay
        Track by track, in the order of time.
    trips : tuple of Trip
        Track by track, in the order of time.
    places : tuple of Place
        By the time spent there.
    timezone : str
        Name of the time zone of local hours; empty for a log whose times are no dates.
    timezone_from : str
        Who said it: ``option``, ``place`` or ``default``; empty as ``timezone``.
    geographic : bool
        Whether positions are latitudes and longitudes.
    unseen : int
        Changes of place that lie in gaps, so that no trip was seen.
    doubtful : int
        Single fixes far off between gaps, which are left out.
    """

    stays: tuple[Stay, ...]
    trips: tuple[Trip, ...]
    places: tuple[Place, ...]
    timezone: str
    timezone_from: str
    geographic: bool
    unseen: int
    doubtful: int

    def __repr__(self) -> str:
        facts = (
            count_text(len(self.trips), "trip"),
            count_text(len(self.stays), "stay"),
            count_text(len(self.places), "place"),
        )
        return f"Trips({', '.join(facts)})"

    @property
    def matrix(self) -> dict[tuple[int, int], int]:
        """Number of trips from one place to another, by their numbers, most frequent first."""
        pairs = Counter((trip.origin, trip.goal) for trip in self.trips)
        return dict(sorted(pairs.items(), key=lambda item: (-item[1], item[0])))
