"""A synthetic quadrotor that flies laps in the wind, similar to the thesis's (section 8.2)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model import Track, Walk
from gpszip.testing.log_with_truth import LogWithTruth, one_track
from gpszip.testing.noise import drift
from gpszip.testing.roads import positions_on

__all__ = ["quadrotor"]

#: Samples per second, as in the thesis.
_RATE = 20.0

#: Mean distance of waypoints from the middle of the courtyard, in metres.
_RADIUS = 40.0

#: Seconds for which a gust lasts.
_GUST_TIME = 4.0

#: Seconds for which the receiver's error lasts.
_DRIFT_TIME = 2.0

#: Mean height above the ground in metres, and the reach of heights about it.
_HEIGHT = (15.0, 8.0)

#: Share by which the speed differs from leg to leg.
_SPEED_NOISE = 0.15


def quadrotor(
    points: int = 12_000,
    *,
    seed: int = 1,
    waypoints: int = 8,
    speed: float = 4.0,
    wind: float = 1.5,
    noise: float = 0.5,
    dimension: Literal[2, 3] = 2,
    id: str = "0",
) -> LogWithTruth:
    """Generate the laps of a quadrotor about a courtyard.

    It flies from waypoint to waypoint, and the wind moves it off the straight line. The default is
    a flight of 10 minutes.

    Parameters
    ----------
    points : int
        Number of samples, at 20 a second; at least 2.
    seed : int
        Seed of the random generator; selects the waypoints, the wind and the errors.
    waypoints : int
        Number of waypoints of a lap, at least 3.
    speed : float
        Mean metres per second. Each leg has a speed of its own.
    wind : float
        Standard deviation of the true position from the straight line along each axis, in metres.
    noise : float
        Standard deviation of the position error, which drifts, in metres.
    dimension : {2, 3}
        Number of coordinates; the third is the height.
    id : str
        Name of the track.

    Returns
    -------
    LogWithTruth
        One track. True positions hold the wind; the walk is what the pilot intends.

    Raises
    ------
    OptionError
        If a number is below the least one.

    Examples
    --------
    >>> log = quadrotor(2000, dimension=3)
    >>> log, log.walks[0].nodes[:10].tolist()
    (LogWithTruth(1 track, 2,000 samples, 8 nodes, 8 edges), [0, 1, 2, 3, 4, 5, 6, 7, 0, 1])
    """
    if points < 2 or waypoints < 3 or dimension not in (2, 3):
        raise OptionError(
            f"no flight has {points} points about {waypoints} waypoints in {dimension} dimensions",
            remedy="give 2 points or more, 3 waypoints or more, and 2 or 3 dimensions",
        )

    # The course, and enough laps for all samples.
    rng = np.random.default_rng(seed)
    nodes = _place_waypoints(waypoints, rng)[:, :dimension]
    times = np.arange(points) / _RATE
    walk = _fly_laps(id, nodes, speed, times, rng)

    # Wind moves the craft, the receiver errs.
    blown = drift(points, wind, _GUST_TIME * _RATE, rng, dimension)
    truth = positions_on(walk, nodes, times) + blown
    errors = drift(points, noise, _DRIFT_TIME * _RATE, rng, dimension)
    ring = np.arange(waypoints, dtype=np.int32)
    edges = np.stack((ring, np.roll(ring, -1)), axis=1)
    return one_track(Track(id, times, truth + errors), truth, nodes, edges, walk)


def _place_waypoints(count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return waypoints about the middle in the order of their bearing, shape (count, 3)."""
    bearings = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    radius = _RADIUS * rng.uniform(0.6, 1.4, count)
    heights = _HEIGHT[0] + rng.uniform(-1, 1, count) * _HEIGHT[1]
    return np.column_stack([radius * np.cos(bearings), radius * np.sin(bearings), heights])


def _fly_laps(
    name: str,
    nodes: NDArray[np.float64],
    speed: float,
    times: NDArray[np.float64],
    rng: np.random.Generator,
) -> Walk:
    """Return the walk of whole laps that last as long as the samples, each leg at its own speed."""
    # More legs than the time allows even at the highest speed.
    legs = np.linalg.norm(np.roll(nodes, -1, axis=0) - nodes, axis=1)
    fastest = speed * (1 + _SPEED_NOISE)
    laps = int(times[-1] * fastest / legs.sum()) + 2
    speeds = speed * rng.uniform(1 - _SPEED_NOISE, 1 + _SPEED_NOISE, laps * len(nodes))
    passed = np.append(0.0, np.cumsum(np.tile(legs, laps) / speeds))

    # Those up to the waypoint ahead at the end.
    count = int(np.searchsorted(passed, times[-1])) + 1
    visited = (np.arange(count) % len(nodes)).astype(np.int32)
    gaps = np.zeros(count - 1, np.bool_)
    return Walk(name, visited, passed[:count], gaps, times[[0, -1]][None])
