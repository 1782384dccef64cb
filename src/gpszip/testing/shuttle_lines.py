"""Synthetic shuttle buses: lines that share roads, and vehicles that change between lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model import Walk
from gpszip.testing.log_with_truth import LogWithTruth, join_truth
from gpszip.testing.roads import Roads, build_roads, end_at, record

__all__ = ["shuttles"]

#: Seconds of a day.
_DAY = 86_400.0

#: Midnight of 2024-01-01, a Monday, in UTC.
_FIRST_DAY = 1_704_067_200.0

#: Seconds after midnight at which the first vehicle leaves, and the last one returns.
_SERVICE = (7 * 3600.0, 19 * 3600.0)

#: Seconds after which a vehicle may be sent to another line.
_DUTY = 3 * 3600.0

#: Stops of a line besides the terminal, which all lines share.
_STOPS = 4

#: Crossings that have a stop, for each line: few, so that lines share stops and roads.
_STOP_POOL = 2

#: Share of the stops at which nobody waits; the vehicle takes the shortest path to the next one.
_SKIPPED = 0.08

#: Share of the legs on which a vehicle goes by some other crossing, as for fuel.
_ERRANDS = 0.02

#: Share of the duties on the line that the vehicle drives most.
_LOYALTY = 0.6

#: Least and mean seconds that a vehicle stands at a stop.
_DWELL = (8.0, 20.0)

#: Least and largest speed of a road in one direction, relative to the mean.
_ROAD_SPEEDS = (0.6, 1.3)

#: Standard deviation of the logarithm of the pace of a duty, and of one road on one lap.
_PACE = (0.08, 0.12)

#: Hours at which roads are crowded, and the speed in these hours.
_RUSH_HOURS, _RUSH_SPEED = (7, 8, 16, 17), 0.65

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Service:
    """What all vehicles share: roads, lines (nodes of their stops), and speeds of the roads."""

    roads: Roads
    lines: list[NDArray[np.int64]]
    speeds: dict[tuple[int, int], float]


def shuttles(
    vehicles: int = 6,
    *,
    lines: int = 5,
    days: int = 4,
    seed: int = 1,
    blocks: int = 10,
    block: float = 250.0,
    speed: float = 9.0,
    period: float = 10.0,
    noise: float = 4.0,
) -> LogWithTruth:
    """Generate shuttle buses whose lines share a terminal, stops and roads.

    Each line is a round from the terminal over a few stops and back, along shortest paths. A
    vehicle drives rounds from 7 to 19 h and may change its line every 3 h; each line has its
    vehicles and its hours. Vehicles stand at stops for a while, skip stops at which nobody waits,
    and rarely go by some other crossing. Each road has a speed in each direction; all are slow at
    7, 8, 16 and 17 h. The receiver is off at night.

    Parameters
    ----------
    vehicles : int
        Number of tracks, named ``shuttle-0``, ``shuttle-1``, ...
    lines : int
        Number of lines, at least 1.
    days : int
        Number of days, at least 1.
    seed : int
        Seed of the random generator; selects the town, the lines, the drives and the errors.
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
        A track for each vehicle. Times begin on 2024-01-01, a Monday, at 7 h UTC.

    Raises
    ------
    OptionError
        If a number is below the least one.

    Examples
    --------
    >>> shuttles(2, days=1, period=60.0)
    LogWithTruth(2 tracks, 1,442 samples, 121 nodes, 205 edges)
    """
    if min(vehicles, lines, days, blocks) < 1:
        raise OptionError(
            f"no log has {vehicles} vehicles on {lines} lines for {days} days in a town of "
            f"{blocks} blocks",
            remedy="give 1 or more of each",
        )

    # Vehicles on their lines, with a sample in each period of the service.
    rng = np.random.default_rng(seed)
    service = _plan_service(lines, blocks, block, speed, rng)
    in_day = np.arange(*_SERVICE, period)
    midnights = _FIRST_DAY + _DAY * np.arange(days)
    times = (midnights[:, None] + np.append(in_day, _SERVICE[1])).ravel()
    recorded = []
    for vehicle in range(vehicles):
        walk = _drive_days(f"shuttle-{vehicle}", service, vehicle, days, rng)
        errors = rng.normal(0, noise, (len(times), 2))
        recorded.append(record(walk, service.roads.nodes, times, errors))

    # Join them on their map.
    tracks, truths, walks = map(list, zip(*recorded, strict=True))
    return join_truth(tracks, truths, service.roads.nodes, service.roads.edges, walks)


def _plan_service(
    lines: int, blocks: int, block: float, speed: float, rng: np.random.Generator
) -> _Service:
    """Build the town, choose the stops of each line, and the speed of each road."""
    roads = build_roads(blocks, block, rng)
    nodes = len(roads.nodes)

    # Lines share the terminal, which is near the middle, and stops from a small pool.
    terminal = int(np.argmin(np.linalg.norm(roads.nodes, axis=1)))
    others = np.delete(np.arange(nodes), terminal)
    size = min(len(others), _STOP_POOL * lines + _STOPS)
    pool = rng.choice(others, size, replace=False)
    rounds = [
        np.append(terminal, rng.choice(pool, min(_STOPS, size), replace=False))
        for _ in range(lines)
    ]

    # Both directions of a road have speeds of their own.
    speeds = {}
    for u, v in roads.edges.tolist():
        speeds[u, v], speeds[v, u] = (speed * rng.uniform(*_ROAD_SPEEDS, 2)).tolist()
    return _Service(roads, rounds, speeds)


def _drive_days(
    name: str, service: _Service, vehicle: int, days: int, rng: np.random.Generator
) -> Walk:
    """Return the walk of a vehicle over all days; it stays at the terminal at night."""
    terminal = int(service.lines[0][0])
    nodes, times = [terminal], [_FIRST_DAY]
    for day in range(days):
        # Duties until the end of the service, each on one line; the last one may end later.
        midnight = _FIRST_DAY + day * _DAY
        end = midnight + _SERVICE[1]
        nodes.append(nodes[-1])
        times.append(midnight + _SERVICE[0] + float(rng.uniform(0.0, 600.0)))
        while times[-1] < end:
            line = _choose_line(service, vehicle, times[-1], rng)
            pace = float(np.exp(rng.normal(0.0, _PACE[0])))
            until = min(end, times[-1] + _DUTY)
            while times[-1] < until:
                _drive_round(service, line, pace, nodes, times, rng)
    last_sample = _FIRST_DAY + (days - 1) * _DAY + _SERVICE[1]
    return end_at(name, np.array(nodes, np.int32), np.array(times), last_sample)


def _choose_line(
    service: _Service, vehicle: int, time: float, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Return the stops of the line of a duty: the vehicle's own, or one that runs at this hour."""
    count = len(service.lines)
    if rng.random() < _LOYALTY:
        return service.lines[vehicle % count]
    evening = (time % _DAY) > 0.5 * sum(_SERVICE)
    return service.lines[
        int(rng.integers(count // 2)) if evening and count > 1 else int(rng.integers(count))
    ]


def _drive_round(
    service: _Service,
    line: NDArray[np.int64],
    pace: float,
    nodes: list[int],
    times: list[float],
    rng: np.random.Generator,
) -> None:
    """Append the nodes and times of one round over the stops of a line and back."""
    # Some stops are skipped, and some legs go by another crossing.
    stops = [int(stop) for stop in line[1:] if rng.random() >= _SKIPPED]
    for stop in [*stops, int(line[0])]:
        if rng.random() < _ERRANDS:
            _drive_leg(
                service, int(rng.integers(len(service.roads.nodes))), pace, nodes, times, rng
            )
        _drive_leg(service, stop, pace, nodes, times, rng)

        # Stand at the stop.
        nodes.append(nodes[-1])
        times.append(times[-1] + _DWELL[0] + float(rng.exponential(_DWELL[1] - _DWELL[0])))


def _drive_leg(
    service: _Service,
    target: int,
    pace: float,
    nodes: list[int],
    times: list[float],
    rng: np.random.Generator,
) -> None:
    """Append the shortest path to a target, with the speeds of the roads at this hour."""
    positions = service.roads.nodes
    while nodes[-1] != target:
        u, v = nodes[-1], int(service.roads.onward[target, nodes[-1]])
        hour = int(times[-1] % _DAY // 3600)
        crowd = _RUSH_SPEED if hour in _RUSH_HOURS else 1.0
        speed = service.speeds[u, v] * pace * crowd * float(np.exp(rng.normal(0.0, _PACE[1])))
        nodes.append(v)
        times.append(times[-1] + float(np.linalg.norm(positions[v] - positions[u])) / speed)
