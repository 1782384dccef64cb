"""Synthetic taxis and fleets on the roads of a city."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model import Walk
from gpszip.testing.log_with_truth import LogWithTruth, join_truth
from gpszip.testing.roads import Roads, build_roads, drive, record

__all__ = ["fleet", "taxis"]

#: Mean seconds between the calls for two fares of a taxi.
_FARE_INTERVAL = 900.0

#: Seconds of a shift.
_SHIFT = 10 * 3600.0

#: Seconds after each shift in which the receiver is off.
_BREAK = 14 * 3600.0

#: Share by which intervals between samples of taxis vary.
_JITTER = 0.2

#: Largest and smallest share of the speed on one drive: lights and traffic.
_TRAFFIC = (0.7, 1.2)

#: Seconds for which a vehicle of a fleet waits at each stop.
_DWELL = 30.0

#: Number of stops of a line of a fleet.
_STOPS = 5

Floats = NDArray[np.float64]


def taxis(
    vehicles: int = 4,
    *,
    points: int = 4_281,
    seed: int = 1,
    blocks: int = 16,
    block: float = 300.0,
    speed: float = 10.0,
    period: float = 60.0,
    noise: float = 8.0,
) -> LogWithTruth:
    """Generate taxis that take fares across a city, with about one sample a minute.

    Each fare is driven along a shortest path. Some destinations are popular, most are not. A taxi
    waits for its next fare where the last one ended. Its receiver is off for 14 of 24 hours, in
    which another driver takes the taxi on.

    Parameters
    ----------
    vehicles : int
        Number of tracks, named ``taxi-0``, ``taxi-1``, ...
    points : int
        Number of samples of each, at least 2. By default as many as the thesis's taxi has, in 7
        days.
    seed : int
        Seed of the random generator; selects the city, the fares and the errors.
    blocks : int
        Number of blocks along each side of the city.
    block : float
        Mean metres between two crossings.
    speed : float
        Mean metres per second.
    period : float
        Mean seconds between two samples, which vary by a fifth.
    noise : float
        Standard deviation of the position error in metres.

    Returns
    -------
    LogWithTruth
        A track for each taxi.

    Raises
    ------
    OptionError
        If a number is below the least one.

    Examples
    --------
    >>> taxis(2, points=500)
    LogWithTruth(2 tracks, 1,000 samples, 289 nodes, 493 edges)
    """
    _check(vehicles, points, blocks)
    rng = np.random.default_rng(seed)
    roads = build_roads(blocks, block, rng)

    # The fourth power makes few crossings popular; none is impossible.
    popularity = rng.random(len(roads.nodes)) ** 4 + 0.02
    recorded = []
    for vehicle in range(vehicles):
        # Samples in shifts, and fares until the last of them.
        steps = period * rng.uniform(1 - _JITTER, 1 + _JITTER, points)
        times = np.cumsum(steps) - steps[0]
        times += np.floor(times / _SHIFT) * _BREAK
        walk = _take_fares(f"taxi-{vehicle}", roads, popularity, times[-1], speed, rng)
        recorded.append(record(walk, roads.nodes, times, rng.normal(0, noise, (points, 2))))

    # Join them on their map.
    tracks, truths, walks = map(list, zip(*recorded, strict=True))
    return join_truth(tracks, truths, roads.nodes, roads.edges, walks)


def _check(vehicles: int, points: int, blocks: int) -> None:
    """Raise OptionError if a number is below the least one."""
    if vehicles < 1 or points < 2 or blocks < 1:
        raise OptionError(
            f"no log has {vehicles} vehicles with {points} points in a town of {blocks} blocks",
            remedy="give 1 vehicle or more, 2 points or more, and 1 block or more",
        )


def _take_fares(
    name: str,
    roads: Roads,
    popularity: Floats,
    duration: float,
    speed: float,
    rng: np.random.Generator,
) -> Walk:
    """Return the walk of a taxi that waits and drives by turns for a duration in seconds."""
    # Fares from one destination to the next.
    fares = int(duration / _FARE_INTERVAL) + 1
    stops = _different(rng.choice(len(popularity), fares + 1, p=popularity / popularity.sum()))

    # A fare comes some time after the one before, or as soon as that one has ended.
    count = len(stops) - 1
    departures = np.cumsum(rng.exponential(_FARE_INTERVAL, count))
    speeds = speed * rng.uniform(*_TRAFFIC, count)
    return drive(name, roads, stops, departures - departures[0], speeds, until=duration)


def _different(stops: NDArray[np.int64]) -> NDArray[np.int32]:
    """Drop stops that repeat the one before; keep two in any case.

    Examples
    --------
    >>> _different(np.array([3, 3, 5, 3])).tolist(), _different(np.array([2, 2])).tolist()
    ([3, 5, 3], [2, 0])
    """
    kept = stops[np.append(True, np.diff(stops) != 0)]
    if len(kept) == 1:
        kept = np.append(kept, 0 if kept[0] else 1)
    different: NDArray[np.int32] = kept.astype(np.int32)
    return different


def fleet(
    vehicles: int = 12,
    *,
    lines: int = 4,
    points: int = 3_000,
    seed: int = 1,
    blocks: int = 10,
    block: float = 250.0,
    speed: float = 8.0,
    period: float = 5.0,
    noise: float = 4.0,
) -> LogWithTruth:
    """Generate a fleet whose vehicles share lines, and whose lines share roads.

    Each line leads from one depot over a few stops and back. A vehicle drives its line all day.

    Parameters
    ----------
    vehicles : int
        Number of tracks, named ``van-0``, ``van-1``, ...; vehicle v drives line v modulo lines.
    lines : int
        Number of lines, at least 1.
    points : int
        Number of samples of each vehicle, at least 2.
    seed : int
        Seed of the random generator; selects the town, the lines and the errors.
    blocks : int
        Number of blocks along each side of the town.
    block : float
        Mean metres between two crossings.
    speed : float
        Mean metres per second.
    period : float
        Seconds between two samples.
    noise : float
        Standard deviation of the position error in metres.

    Returns
    -------
    LogWithTruth
        A track for each vehicle.

    Raises
    ------
    OptionError
        If a number is below the least one.

    Examples
    --------
    >>> log = fleet(3, lines=1, points=200)
    >>> log, log.walks[0].nodes[0] == log.walks[2].nodes[0]
    (LogWithTruth(3 tracks, 600 samples, 121 nodes, 205 edges), np.True_)
    """
    _check(vehicles, points, blocks)
    if lines < 1:
        raise OptionError(f"a fleet has no {lines} lines", remedy="give 1 or more")

    # The depot and the stops of each line.
    rng = np.random.default_rng(seed)
    roads = build_roads(blocks, block, rng)
    depot = int(rng.integers(len(roads.nodes)))
    courses = [np.append(depot, rng.integers(0, len(roads.nodes), _STOPS)) for _ in range(lines)]
    times = np.arange(points, dtype=np.float64) * period

    # Each vehicle on its line, and all on their map.
    recorded = []
    for vehicle in range(vehicles):
        course = courses[vehicle % lines]
        walk = _drive_line(f"van-{vehicle}", roads, course, times[-1], speed, rng)
        recorded.append(record(walk, roads.nodes, times, rng.normal(0, noise, (points, 2))))
    tracks, truths, walks = map(list, zip(*recorded, strict=True))
    return join_truth(tracks, truths, roads.nodes, roads.edges, walks)


def _drive_line(
    name: str,
    roads: Roads,
    course: NDArray[np.int64],
    duration: float,
    speed: float,
    rng: np.random.Generator,
) -> Walk:
    """Return the walk of a vehicle that repeats a line for a duration in seconds."""
    # Each drive leads to another node and then waits: so many of them take longer than that.
    block = float(np.linalg.norm(np.diff(roads.nodes[roads.edges], axis=1), axis=2).min())
    drives = int(duration / (_DWELL + block / (speed * _TRAFFIC[1]))) + 2
    stops = _different(np.tile(course, drives))[: drives + 1]

    # Each begins when the one before has ended and the vehicle has waited.
    count = len(stops) - 1
    speeds = speed * rng.uniform(*_TRAFFIC, count)
    return drive(name, roads, stops, np.zeros(count), speeds, wait=_DWELL, until=duration)
