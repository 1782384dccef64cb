"""A synthetic patrol, similar to the log of the thesis's ground robot (section 8.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track, Walk
from gpszip.testing.log_with_truth import LogWithTruth, one_track
from gpszip.testing.noise import drift, smooth

__all__ = ["patrol", "patrol_with_truth"]

#: Samples per second.
_RATE = 12.95

#: Metres between the vertices of the driven line.
_STEP = 0.05

#: Mean speed in metres per second.
_SPEED = 0.25

#: Mean distances between crossings along both axes, in metres.
_CELL = (9.0, 7.0)

#: Time constant of the position error, in seconds.
_DRIFT_TIME = 1.0

#: Crossings per corridor when the building begins to grow; fewer than 1 make loops.
_CROSSINGS_PER_CORRIDOR = 0.8

#: Standard deviation of crossings about the grid, in metres.
_CROSSING_NOISE = 0.7

#: Mean time between two pauses, in seconds.
_PAUSE_INTERVAL = 120

#: Steps to the four neighbours of a cell.
_DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1))


def patrol(
    points: int = 72_273,
    *,
    seed: int = 1,
    corridors: int = 25,
    jitter: float = 0.002,
    sway: float = 0.12,
    noise: float = 0.05,
    id: str = "0",
) -> Track:
    """Generate the rounds of a robot through the corridors of a building.

    The robot prefers some corridors, rounds corners, varies its speed and pauses sometimes. The
    default is a track of 93 minutes.

    Parameters
    ----------
    points : int
        Number of samples, at about 13 a second.
    seed : int
        Seed of the random generator; selects the building and the tour.
    corridors : int
        Number of corridors, each between two crossings.
    jitter : float
        Standard deviation of sample times from regular ones, in seconds.
    sway : float
        Standard deviation of the driven line from the corridor's center, in metres.
    noise : float
        Standard deviation of the position error, which drifts, in metres.
    id : str
        Name of the track.

    Returns
    -------
    Track
        Times from 0 in seconds, positions of shape (points, 2) in metres.

    Examples
    --------
    >>> track = patrol(1000)
    >>> len(track), track.dimension, round(track.times[-1])
    (1000, 2, 77)
    """
    return patrol_with_truth(
        points, seed=seed, corridors=corridors, jitter=jitter, sway=sway, noise=noise, id=id
    ).tracks[0]


def patrol_with_truth(
    points: int = 72_273,
    *,
    seed: int = 1,
    corridors: int = 25,
    jitter: float = 0.002,
    sway: float = 0.12,
    noise: float = 0.05,
    id: str = "0",
) -> LogWithTruth:
    """Generate the log of :func:`patrol` with its truth.

    The map has the corridors, straight from crossing to crossing. The walk has the time at which
    the robot passes each crossing. True positions are on the line that it drives, which rounds
    corners and sways about the corridors; it pauses within corridors, too.

    The parameters are those of :func:`patrol`.

    Returns
    -------
    LogWithTruth
        One track.

    Examples
    --------
    >>> log = patrol_with_truth(1000)
    >>> log, log.walks[0].nodes.tolist()
    (LogWithTruth(1 track, 1,000 samples, 20 nodes, 25 edges), [0, 17, 0, 1])
    """
    # The building, the sample times and the metres driven at each.
    rng = np.random.default_rng(seed)
    crossings, neighbours = _build_corridors(corridors, rng)
    times = _sample_times(points, jitter, rng)
    driven = _drive_odometer(times, rng)

    # The driven line, and the positions on it.
    route = _plan_tour(crossings, neighbours, driven[-1], rng)
    line = _add_sway(_round_corners(crossings[route]), sway, rng)
    along = np.arange(len(line)) * _STEP
    truth = np.column_stack([np.interp(driven, along, line[:, axis]) for axis in (0, 1)])
    errors = drift(len(times), noise, _DRIFT_TIME * _RATE, rng)

    # Both ends of each corridor once.
    edges = np.array([(u, v) for u, ends in enumerate(neighbours) for v in ends if u < v], np.int32)
    walk = _pass_crossings(id, route, crossings, times, driven)
    return one_track(Track(id, times, truth + errors), truth, crossings, edges, walk)


def _pass_crossings(
    name: str,
    route: list[int],
    crossings: NDArray[np.float64],
    times: NDArray[np.float64],
    driven: NDArray[np.float64],
) -> Walk:
    """Return the walk: the crossings of a route up to the one ahead at the end, with times."""
    # Metres to each crossing, as far as the one that the robot is heading for.
    nodes = np.array(route, np.int32)
    steps = np.linalg.norm(np.diff(crossings[nodes], axis=0), axis=1)
    along = np.append(0.0, np.cumsum(steps))
    count = max(int(np.searchsorted(along, driven[-1])) + 1, 2)
    nodes, along = nodes[:count], along[:count]

    # It would reach that one at the mean speed.
    passed = np.interp(along, driven, times)
    passed[-1] = times[-1] + (along[-1] - driven[-1]) / _SPEED
    gaps = np.zeros(count - 1, np.bool_)
    return Walk(name, nodes, passed, gaps, times[[0, -1]][None])


def _build_corridors(
    corridors: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], list[list[int]]]:
    """Positions of the crossings, and the neighbours of each.

    The building grows from one cell of a grid by random corridors until there are enough.
    """
    # Add corridors, with a bound on the crossings so that some corridors close loops.
    cells: list[tuple[int, int]] = [(0, 0)]
    edges: set[tuple[int, int]] = set()
    capacity = _CROSSINGS_PER_CORRIDOR * corridors
    while len(edges) < corridors:
        # Draw a corridor from a crossing to one of its four neighbours.
        start = int(rng.integers(len(cells)))
        dx, dy = _DIRECTIONS[int(rng.integers(4))]
        cell = (cells[start][0] + dx, cells[start][1] + dy)

        # New crossings need capacity, which increases slowly: a shape without further loops must
        # be able to grow.
        capacity += 0.01
        if cell not in cells:
            if len(cells) > capacity:
                continue
            cells.append(cell)
        edges.add((min(start, cells.index(cell)), max(start, cells.index(cell))))

    # List the neighbours.
    neighbours: list[list[int]] = [[] for _ in cells]
    for u, v in sorted(edges):
        neighbours[u].append(v)
        neighbours[v].append(u)
    positions = np.array(cells) * _CELL + rng.normal(0, _CROSSING_NOISE, (len(cells), 2))
    return positions, neighbours


def _plan_tour(
    crossings: NDArray[np.float64],
    neighbours: list[list[int]],
    length: float,
    rng: np.random.Generator,
) -> list[int]:
    """Crossings of a random walk at least ``length`` metres long.

    It turns back in dead ends only, and prefers some corridors.
    """
    # The fourth power makes most corridors rare and few frequent; none is impossible.
    preference = rng.random((len(crossings), len(crossings))) ** 4 + 0.02
    route, before, walked = [0], -1, 0.0
    while walked < length + 2 * _CELL[0]:
        crossing = route[-1]
        options = [v for v in neighbours[crossing] if v != before] or neighbours[crossing]
        weights = preference[crossing, options]
        before = crossing
        route.append(options[int(rng.choice(len(options), p=weights / weights.sum()))])
        walked += float(np.linalg.norm(crossings[route[-1]] - crossings[crossing]))
    return route


def _round_corners(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """The line through the corners at equal steps, with corners rounded over about 40 cm."""
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
    steps = np.arange(0, along[-1], _STEP)
    return np.column_stack(
        [smooth(np.interp(steps, along, corners[:, axis]), 8) for axis in (0, 1)]
    )


def _add_sway(
    line: NDArray[np.float64], sway: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Move a line sideways by a smooth random offset."""
    # Offsets with the given standard deviation.
    offset = smooth(rng.standard_normal(len(line)), 30)
    offset *= sway / max(float(offset.std()), 1e-12)

    # Move along the normals.
    tangent = np.gradient(line, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    length = np.linalg.norm(normal, axis=1) + 1e-12
    moved: NDArray[np.float64] = line + normal * (offset / length)[:, None]
    return moved


def _sample_times(points: int, jitter: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Increasing times with jitter, which is clipped so that they stay in order."""
    regular = np.arange(points) / _RATE
    deviation = np.clip(rng.normal(0, jitter, points), -0.4 / _RATE, 0.4 / _RATE)
    times: NDArray[np.float64] = regular + deviation
    times -= times[0]
    return times


def _drive_odometer(times: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Metres driven until each time. The speed varies by a quarter, with a pause in 2 minutes."""
    # A smooth random speed.
    variation = smooth(rng.standard_normal(len(times)), 100)
    variation = 0.25 * variation / max(float(variation.std()), 1e-12)
    speed = np.clip(_SPEED * (1 + variation), 0.05, 0.6)

    # Pauses of 5 to 60 seconds.
    for start in rng.integers(0, len(times), int(times[-1] / _PAUSE_INTERVAL)):
        speed[start : start + int(rng.integers(5, 60) * _RATE)] = 0
    driven: NDArray[np.float64] = np.r_[0, np.cumsum(speed[1:] * np.diff(times))]
    return driven
