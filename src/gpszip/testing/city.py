"""A synthetic town: vehicles on a grid of streets, in degrees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["city", "drives"]

_METRES_PER_DEGREE = 111_320.0


def city(
    blocks: int = 6,
    *,
    vehicles: int = 10,
    period: float = 1.0,
    duration: float = 1800.0,
    seed: int = 1,
    noise: float = 4.0,
    block: float = 120.0,
    speed: float = 9.0,
    center: tuple[float, float] = (37.98, 23.73),
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Generate vehicles that drive the shortest way between random crossings, as a fleet's log would show them.

    Parameters
    ----------
    blocks : int
        Blocks along each side of the town.
    vehicles : int
        Number of tracks, named ``bus-0``, ``bus-1``, ...
    period : float
        Seconds between two samples, 1 to 60 in common fleets.
    duration : float
        Seconds that each vehicle drives.
    seed : int
        Another seed is another set of drives.
    noise : float
        Standard deviation of a position in metres.
    block : float
        Metres between two crossings.
    speed : float
        Metres a second.
    center : (float, float)
        Latitude and longitude of the town's middle in degrees.

    Returns
    -------
    dict of str to (float64 array of shape (n,), float64 array of shape (n, 2))
        Times in seconds, and latitude and longitude in degrees, for each vehicle.

    Examples
    --------
    >>> times, degrees = city(vehicles=2, period=30.0)["bus-1"]
    >>> times[:3].tolist(), degrees.shape
    ([0.0, 30.0, 60.0], (60, 2))
    """
    scale = np.array([_METRES_PER_DEGREE, _METRES_PER_DEGREE * np.cos(np.radians(center[0]))])
    metres = drives(
        blocks,
        vehicles=vehicles,
        period=period,
        duration=duration,
        seed=seed,
        noise=noise,
        block=block,
        speed=speed,
    )
    return {name: (times, center + xy[:, ::-1] / scale) for name, (times, xy) in metres.items()}


def drives(
    blocks: int = 6,
    *,
    vehicles: int = 10,
    period: float = 1.0,
    duration: float = 1800.0,
    seed: int = 1,
    noise: float = 4.0,
    block: float = 120.0,
    speed: float = 9.0,
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Generate the drives of :func:`city` in metres about the town's middle.

    Returns
    -------
    dict of str to (float64 array of shape (n,), float64 array of shape (n, 2))
        Times in seconds and positions in metres for each vehicle.

    Examples
    --------
    >>> len(drives(vehicles=3, duration=60.0))
    3
    """
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, duration, period)
    town = {}
    for vehicle in range(vehicles):
        corners = block * (_plan_drive(blocks, duration * speed / block, rng) - blocks / 2)
        along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
        at = np.column_stack([np.interp(times * speed, along, corners[:, axis]) for axis in (0, 1)])
        town[f"bus-{vehicle}"] = (times, at + rng.normal(0, noise, at.shape))
    return town


def _plan_drive(blocks: int, length: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Crossings of a drive at least so many blocks long: along one street, then along the other, to one place after another."""
    here = rng.integers(0, blocks + 1, 2)
    corners = [here]
    driven = 0.0
    while driven < length:
        there = rng.integers(0, blocks + 1, 2)
        driven += float(np.abs(there - here).sum())
        corners += [np.array([there[0], here[1]]), there]
        here = there
    return np.array(corners, dtype=np.float64)
