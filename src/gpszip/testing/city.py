"""A synthetic town: vehicles on a square grid of streets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["city", "drives"]

#: Metres in a degree of longitude at the equator.
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
    """Generate the log of a fleet in degrees.

    Its vehicles drive along shortest paths between random crossings.

    Parameters
    ----------
    blocks : int
        Number of blocks along each side of the town.
    vehicles : int
        Number of tracks, named ``bus-0``, ``bus-1``, ...
    period : float
        Seconds between two samples, 1 to 60 in common fleets.
    duration : float
        Seconds that each vehicle drives.
    seed : int
        Seed of the random generator; selects the drives.
    noise : float
        Standard deviation of a position in metres.
    block : float
        Metres between two crossings.
    speed : float
        Metres per second.
    center : (float, float)
        Latitude and longitude of the town's center in degrees.

    Returns
    -------
    dict of str to (float64 array of shape (n,), float64 array of shape (n, 2))
        Times in seconds, and latitudes and longitudes in degrees, of each vehicle.

    Examples
    --------
    >>> times, degrees = city(vehicles=2, period=30.0)["bus-1"]
    >>> times[:3].tolist(), degrees.shape
    ([0.0, 30.0, 60.0], (60, 2))
    """
    # Degrees of longitude get shorter towards the poles. A town is small enough for one scale.
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
    """Generate the drives of :func:`city` in metres from the town's center.

    The parameters are those of :func:`city`.

    Returns
    -------
    dict of str to (float64 array of shape (n,), float64 array of shape (n, 2))
        Times in seconds and positions in metres of each vehicle.

    Examples
    --------
    >>> len(drives(vehicles=3, duration=60.0))
    3
    """
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, duration, period)
    town = {}
    for vehicle in range(vehicles):
        # The course, with the distance along it at each corner.
        corners = block * (_plan_drive(blocks, duration * speed / block, rng) - blocks / 2)
        along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]

        # Positions at constant speed, with noise.
        exact = [np.interp(times * speed, along, corners[:, axis]) for axis in (0, 1)]
        positions = np.column_stack(exact)
        town[f"bus-{vehicle}"] = (times, positions + rng.normal(0, noise, positions.shape))
    return town


def _plan_drive(blocks: int, length: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Crossings of a drive from one random destination to the next, in blocks.

    Each leg follows one street and then another. The drive is at least ``length`` blocks long.
    """
    position = rng.integers(0, blocks + 1, 2)
    corners = [position]
    driven = 0.0
    while driven < length:
        destination = rng.integers(0, blocks + 1, 2)
        driven += float(np.abs(destination - position).sum())
        # First along x, then along y, as there are no diagonal streets.
        corners += [np.array([destination[0], position[1]]), destination]
        position = destination
    return np.array(corners, dtype=np.float64)
