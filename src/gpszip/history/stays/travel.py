"""How long distances take, and which are too fast to be travel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.fixes import MAX_ACCELERATION, MAX_SPEED, Fixes, lengths
from gpszip.history.stays.values import Halt

__all__ = [
    "ERROR_FACTOR",
    "MAX_GAP",
    "TRAVEL_SHARE",
    "WAY_FACTOR",
    "directness",
    "distance",
    "distances",
    "fills",
    "is_jump",
    "passes_by",
    "speed_after",
    "speed_before",
    "travel_time",
]

#: Errors that are stated hold for two of three fixes: this many times as much holds for 19 of 20.
ERROR_FACTOR = 2.0

#: Length of a way as a multiple of the straight line: 1.3 in towns, by roads or on foot.
WAY_FACTOR = 1.3

#: Metres per second of a walk.
_WALKING_SPEED = 1.3

#: Metres of straight lines, and the speeds in m/s at which ways of up to this length are travelled
#: with waits: on foot, through a town by car, bicycle or bus, and by motorway or train.
_USUAL_SPEEDS = ((1000.0, _WALKING_SPEED), (30_000.0, 8.0), (math.inf, 25.0))

#: A gap is travel if a way of its displacement takes this share of it or more.
TRAVEL_SHARE = 0.5

#: Seconds of a gap beyond which nothing is said about where the track was, even if it is at one
#: place before and after: whoever is away for longer sleeps elsewhere.
MAX_GAP = 86_400.0

#: Seconds before and after a gap in which its speed is measured.
_SPEED_TIME = 180.0

#: Metres per second from which a track drives, faster than a run.
_DRIVING_SPEED = 4.0

#: Seconds of the longest gap in which a track that drives past a known place is taken to go on. In
#: logs of persons with gaps on six of ten trips, stays where nobody stayed fall from 20 to 8 of 400
#: with it, and those that are missed from 12 to 11.
_PASSING_GAP = 7200.0

#: Directness from which a way goes on in its direction.
_GOES_ON = 0.7

Floats = NDArray[np.float64]


def distance(one: Floats, other: Floats) -> float:
    """Metres between two positions."""
    return math.dist(one, other)


def distances(positions: Floats, centre: Floats) -> Floats:
    """Metres of positions, shape (n, d), from another one."""
    return lengths(positions - centre)


def directness(begin: Floats, middle: Floats, end: Floats) -> float:
    """Straight line between two positions as a share of the way over a third; 1 if it is on it."""
    way = distance(begin, middle) + distance(middle, end)
    return distance(begin, end) / way if way > 0 else 0.0


def is_jump(fixes: Fixes, one: Halt, other: Halt) -> bool:
    """Whether nobody gets from one halt to the other in the time between, from rest to rest."""
    duration = float(fixes.times[other.first] - fixes.times[one.last])
    noise = float(fixes.noise[one.last] + fixes.noise[other.first])
    way = distance(fixes.positions[one.last], fixes.positions[other.first]) - noise
    return way > 0 and duration < max(2 * math.sqrt(way / MAX_ACCELERATION), way / MAX_SPEED)


def fills(fixes: Fixes, one: Halt, other: Halt) -> bool:
    """Whether the way from one halt to the next takes a good part of the time between them."""
    way = distance(one.centre, other.centre)
    gap = float(fixes.times[other.first] - fixes.times[one.last])
    return gap <= MAX_GAP and WAY_FACTOR * way / _usual_speed(way) >= TRAVEL_SHARE * gap


def travel_time(fixes: Fixes, row: int) -> float:
    """Seconds that the way between two successive fixes takes at the speed around it."""
    way = distance(fixes.positions[row], fixes.positions[row + 1])
    speeds = (speed_before(fixes, row), speed_after(fixes, row + 1), _usual_speed(way))
    return WAY_FACTOR * way / max(speeds)


def _usual_speed(way: float) -> float:
    return next(speed for longest, speed in _USUAL_SPEEDS if way <= longest)


def speed_before(fixes: Fixes, row: int) -> float:
    """Speed of the fixes up to one, but that of a walk at least."""
    first = int(np.searchsorted(fixes.times, fixes.times[row] - _SPEED_TIME))
    return max(_speed(fixes, first, row), _WALKING_SPEED)


def speed_after(fixes: Fixes, row: int) -> float:
    """Speed of the fixes from one on, but that of a walk at least."""
    last = int(np.searchsorted(fixes.times, fixes.times[row] + _SPEED_TIME, side="right")) - 1
    return max(_speed(fixes, row, last), _WALKING_SPEED)


def _speed(fixes: Fixes, first: int, last: int) -> float:
    if first >= last:
        return 0.0
    way = distance(fixes.positions[first], fixes.positions[last])
    noise = float(fixes.noise[first] + fixes.noise[last])
    speed = max(way - noise, 0.0) / float(fixes.times[last] - fixes.times[first])
    return speed if speed <= MAX_SPEED else 0.0


def passes_by(fixes: Fixes, row: int) -> tuple[bool, bool]:
    """Whether a track is on the way before a gap and after it, rather than at the places there.

    It drives at the last fix before the gap (or at the first one after it), goes on in its
    direction, and the gap is too short for most stays.

    Parameters
    ----------
    fixes : Fixes
        A track.
    row : int
        Number of the last fix before the gap.
    """
    times, positions = fixes.times, fixes.positions
    if times[row + 1] - times[row] > _PASSING_GAP:
        return False, False
    first = int(np.searchsorted(times, times[row] - _SPEED_TIME))
    last = int(np.searchsorted(times, times[row + 1] + _SPEED_TIME, side="right")) - 1
    return (
        _speed(fixes, first, row) >= _DRIVING_SPEED
        and directness(positions[first], positions[row], positions[row + 1]) >= _GOES_ON,
        _speed(fixes, row + 1, last) >= _DRIVING_SPEED
        and directness(positions[row], positions[row + 1], positions[last]) >= _GOES_ON,
    )
