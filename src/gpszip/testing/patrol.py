"""A synthetic robot on its rounds, like the thesis's ground robot (section 8.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track

__all__ = ["patrol"]

_RATE = 12.95  # samples a second
_STEP = 0.05  # metres between the vertices of the driven line
_SPEED = 0.25  # metres a second
_CELL = (9.0, 7.0)  # metres between the corridors' crossings
_DRIFT_TIME = 1.0  # seconds after which the position error has forgotten itself


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
    """Generate a robot's rounds through the corridors of one building.

    The robot prefers some corridors, rounds corners, changes its speed, and pauses now and then. The defaults make 93 minutes.

    Parameters
    ----------
    points : int
        Number of samples, at about 13 a second.
    seed : int
        Another seed is another building and another tour.
    corridors : int
        Number of corridors between two crossings.
    jitter, sway, noise : float
        Standard deviations: of the sample times about their beat in seconds, of the driven line about the corridor's middle
        in metres, of the position's drifting error in metres.
    id : str
        Name of the track.

    Returns
    -------
    Track
        Seconds from 0, positions of shape (points, 2) in metres on a plane of its own.

    Examples
    --------
    >>> track = patrol(1000)
    >>> len(track), track.dimension, round(track.times[-1])
    (1000, 2, 77)
    """
    rng = np.random.default_rng(seed)
    crossings, ways = _building(corridors, rng)
    times = _times(points, jitter, rng)
    driven = _odometer(times, rng)
    line = _add_sway(_round_corners(_tour(crossings, ways, driven[-1], rng)), sway, rng)
    along = np.arange(len(line)) * _STEP
    positions = np.column_stack([np.interp(driven, along, line[:, axis]) for axis in (0, 1)])
    return Track(id, times, positions + _drift(len(times), noise, rng))


def _building(
    corridors: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], list[list[int]]]:
    """Crossings grown from one cell of a grid until there are enough corridors, and the neighbours of each."""
    cells: list[tuple[int, int]] = [(0, 0)]
    ways: set[tuple[int, int]] = set()
    room = 0.8 * corridors  # fewer crossings than corridors make loops
    while len(ways) < corridors:
        at = int(rng.integers(len(cells)))
        dx, dy = ((1, 0), (-1, 0), (0, 1), (0, -1))[int(rng.integers(4))]
        cell = (cells[at][0] + dx, cells[at][1] + dy)
        room += 0.01  # a shape without further loops has to grow
        if cell not in cells:
            if len(cells) > room:
                continue
            cells.append(cell)
        ways.add((min(at, cells.index(cell)), max(at, cells.index(cell))))
    neighbours: list[list[int]] = [[] for _ in cells]
    for u, v in sorted(ways):
        neighbours[u].append(v)
        neighbours[v].append(u)
    return np.array(cells) * _CELL + rng.normal(0, 0.7, (len(cells), 2)), neighbours


def _tour(
    crossings: NDArray[np.float64],
    neighbours: list[list[int]],
    length: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Corners of a walk at least so long, which turns back in dead ends only and prefers some corridors."""
    taste = rng.random((len(crossings), len(crossings))) ** 4 + 0.02
    route, before, walked = [0], -1, 0.0
    while walked < length + 2 * _CELL[0]:
        here = route[-1]
        options = [v for v in neighbours[here] if v != before] or neighbours[here]
        weights = taste[here, options]
        before = here
        route.append(options[int(rng.choice(len(options), p=weights / weights.sum()))])
        walked += float(np.linalg.norm(crossings[route[-1]] - crossings[here]))
    return crossings[route]


def _round_corners(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """The line through the corners at equal steps, its corners rounded over some 40 cm."""
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
    steps = np.arange(0, along[-1], _STEP)
    return np.column_stack(
        [_smooth(np.interp(steps, along, corners[:, axis]), 8) for axis in (0, 1)]
    )


def _add_sway(
    line: NDArray[np.float64], sway: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """The line moved sideways by a smooth random amount."""
    aside = _smooth(rng.standard_normal(len(line)), 30)
    aside *= sway / max(float(aside.std()), 1e-12)
    tangent = np.gradient(line, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    moved: NDArray[np.float64] = (
        line + normal * (aside / (np.linalg.norm(normal, axis=1) + 1e-12))[:, None]
    )
    return moved


def _times(points: int, jitter: float, rng: np.random.Generator) -> NDArray[np.float64]:
    beats = np.arange(points) / _RATE
    times: NDArray[np.float64] = beats + np.clip(
        rng.normal(0, jitter, points), -0.4 / _RATE, 0.4 / _RATE
    )
    times -= times[0]
    return times


def _odometer(times: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Metres driven at each time: a speed that wanders by a quarter, and a pause every two minutes or so."""
    wander = _smooth(rng.standard_normal(len(times)), 100)
    speed = np.clip(_SPEED * (1 + 0.25 * wander / max(float(wander.std()), 1e-12)), 0.05, 0.6)
    for start in rng.integers(0, len(times), int(times[-1] / 120)):
        speed[start : start + int(rng.integers(5, 60) * _RATE)] = 0
    driven: NDArray[np.float64] = np.r_[0, np.cumsum(speed[1:] * np.diff(times))]
    return driven


def _drift(points: int, noise: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """An error that forgets itself within a second: an autoregressive process, summed as a truncated filter."""
    memory = np.exp(-np.arange(int(8 * _DRIFT_TIME * _RATE)) / (_DRIFT_TIME * _RATE))
    shocks = rng.normal(0, noise / np.sqrt((memory**2).sum()), (points + len(memory) - 1, 2))
    return np.column_stack([np.convolve(shocks[:, axis], memory, mode="valid") for axis in (0, 1)])


def _smooth(values: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Gaussian smoothing over sigma samples, the ends continued."""
    reach = int(4 * sigma)
    window = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return np.convolve(np.pad(values, reach, mode="edge"), window / window.sum(), mode="valid")
