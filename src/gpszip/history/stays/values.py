"""What a track is cut into: halts, stops, moves and what is left over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.fixes import Fixes

__all__ = ["Doubt", "Halt", "Move", "Settings", "Stop", "Timeline", "TripSpans"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Settings:
    """What counts as a stay and as a trip.

    Parameters
    ----------
    min_stay : float
        Seconds; shorter stops are no stays.
    max_pause : float
        Seconds; shorter stays on the way of a trip don't end it.
    radius : float
        Metres around the centre of a place that belong to it.
    """

    min_stay: float = 300.0
    max_pause: float = 900.0
    radius: float = 100.0


@dataclass(frozen=True, eq=False)
class Halt:
    """A time range in which a track stays in place.

    Parameters
    ----------
    first, last : int
        Numbers of the first and the last fix at the place.
    centre : float64 array, shape (d,)
        Metres.
    noise : float
        Error of a typical fix in metres.
    reach : float
        Metres around the centre within which fixes are at the place.
    spread : float
        Typical distance of positions from the centre in metres.
    """

    first: int
    last: int
    centre: Floats
    noise: float
    reach: float
    spread: float = 0.0


@dataclass(frozen=True, eq=False)
class Stop:
    """A stop of a track at a place.

    Parameters
    ----------
    start, end : float
        Seconds; estimated where the track was silent.
    first_seen, last_seen : float
        Times of the first and the last fix at the place.
    halt : Halt
        The fixes at the place.
    pause : bool
        Whether the trip goes on after it.
    """

    start: float
    end: float
    first_seen: float
    last_seen: float
    halt: Halt
    pause: bool = False

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.end - self.start


@dataclass(frozen=True, eq=False)
class Move:
    """A trip: from the stop before it to the stop after it, if the track has them.

    Parameters
    ----------
    start, end : float
        Seconds.
    begin, finish : float64 array, shape (d,)
        Metres: where it begins and ends.
    origin, goal : int or None
        Numbers of the stops at its ends; None where the track begins or ends on the way.
    """

    start: float
    end: float
    begin: Floats
    finish: Floats
    origin: int | None
    goal: int | None


@dataclass(frozen=True, eq=False)
class Doubt:
    """A single fix far off between gaps: an error, or a stay that nothing else confirms.

    Parameters
    ----------
    time : float
        Seconds.
    position : float64 array, shape (d,)
        Metres.
    """

    time: float
    position: Floats


@dataclass(frozen=True, eq=False)
class Timeline:
    """Stops and trips of one track, each in the order of time.

    Parameters
    ----------
    fixes : Fixes
        The fixes that were used.
    stops : tuple of Stop
        All stays.
    moves : tuple of Move
        Trips; a pause lies within one.
    doubtful : tuple of Doubt
        Single fixes far off between gaps, which are left out.
    unseen : int
        Changes of place between stops that were not seen.
    open : bool
        Whether places that are known may tell more.
    """

    fixes: Fixes
    stops: tuple[Stop, ...]
    moves: tuple[Move, ...]
    doubtful: tuple[Doubt, ...]
    unseen: int
    open: bool


@dataclass(frozen=True, eq=False)
class TripSpans:
    """When the trips of a log are.

    Parameters
    ----------
    tracks : frozenset of str
        Names of the tracks that have a stay or a trip.
    trips : tuple of (str, float, float)
        Track of each trip, and seconds at which it begins and ends; track by track.
    """

    tracks: frozenset[str]
    trips: tuple[tuple[str, float, float], ...]
