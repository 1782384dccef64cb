"""Lines that cross the antimeridian, where longitude jumps between 180 and -180 degrees.

Programs that draw or interpolate such a line in degrees go the long way round the world. This
module adds two points at each crossing, one at 180 and one at -180 degrees, so that the line can
be cut between them (RFC 7946, 3.1.9).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["align_antimeridian_signs", "find_crossings", "insert_crossings", "wrap_degrees"]

Floats = NDArray[np.float64]

#: Ticks; shortest step that has space for two more points with whole ticks between all four.
_MIN_STEP_TICKS = 4


def wrap_degrees(degrees: Floats) -> Floats:
    """Wrap differences of longitudes to [-180, 180).

    Examples
    --------
    >>> wrap_degrees(np.array([359.0, -190.0, 12.0])).tolist()
    [-1.0, 170.0, 12.0]
    """
    # NumPy's remainder has the sign of the divisor: negative differences wrap, too.
    wrapped: Floats = (degrees + 180.0) % 360.0 - 180.0
    return wrapped


def find_crossings(lon: Floats) -> NDArray[np.bool_]:
    """Find the steps that cross the antimeridian.

    Parameters
    ----------
    lon : float64 array, shape (n,)
        Degrees in [-180, 180].

    Returns
    -------
    bool array, shape (n - 1,)

    Examples
    --------
    >>> find_crossings(np.array([179.0, -179.0, -178.0])).tolist()
    [True, False]
    """
    # The shorter arc between two longitudes has 180 degrees at most, so this step takes it across.
    crosses: NDArray[np.bool_] = np.abs(np.diff(lon)) > 180.0
    return crosses


def align_antimeridian_signs(lon: Floats) -> Floats:
    """Give points on the antimeridian the sign of their neighbours.

    180 and -180 degrees are the same meridian; the wrong sign looks like a crossing.

    Parameters
    ----------
    lon : float64 array, shape (n,)
        Degrees in [-180, 180].

    Returns
    -------
    float64 array, shape (n,)
        Each point on the antimeridian has the sign of the last point before it that is not on
        it, or else of the first one after it. If all points are on it, they are at 180 degrees.

    Examples
    --------
    >>> align_antimeridian_signs(np.array([-180.0, 179.0, -180.0, 180.0, -179.0])).tolist()
    [180.0, 179.0, 180.0, 180.0, -179.0]
    """
    is_on = np.abs(lon) == 180.0
    if not is_on.any():
        return lon
    if is_on.all():
        return np.full_like(lon, 180.0)

    # Index of the last point off the antimeridian; before the first one, of the first one.
    last_off = np.maximum.accumulate(np.where(is_on, -1, np.arange(len(lon))))
    last_off[last_off < 0] = np.argmin(is_on)
    return np.where(is_on, np.copysign(180.0, lon[last_off]), lon)


def insert_crossings(
    times: Floats, lat: Floats, lon: Floats, tick: float
) -> tuple[Floats, Floats, Floats]:
    """Insert two points at each crossing of the antimeridian, at 180 and at -180 degrees.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Increasing. For a line without times, any number that increases along it.
    lat, lon : float64 array, shape (n,)
        Degrees, linear in ``times`` along the shorter arc from each point to the next.
    tick : float
        Time between the two points, as times must increase; other times are rounded to multiples
        of it. Steps of less than four ticks are left unchanged. May be 0.

    Returns
    -------
    times, lat, lon : float64 array, shape (m,)

    Examples
    --------
    >>> lat, lon = np.array([1.0, 2.0]), np.array([179.0, -179.0])
    >>> times, lat, lon = insert_crossings(np.array([0.0, 4.0]), lat, lon, 0.5)
    >>> times.tolist(), lat.tolist(), lon.tolist()
    ([0.0, 2.0, 2.5, 4.0], [1.0, 1.5, 1.5, 2.0], [179.0, 180.0, -180.0, -179.0])
    """
    # Steps that cross, and are long enough.
    lon = align_antimeridian_signs(lon)
    steps = np.flatnonzero(find_crossings(lon) & (np.diff(times) >= _MIN_STEP_TICKS * tick))
    if not len(steps):
        return times, lat, lon

    # Share of each step at which the line meets the antimeridian.
    side = np.copysign(180.0, lon[steps])
    difference = wrap_degrees(lon[steps + 1] - lon[steps])
    # From 180 to -180 degrees there is no difference to divide by.
    share = np.clip((side - lon[steps]) / np.where(difference == 0, 1.0, difference), 0.0, 1.0)

    # Its time, in whole ticks, with space for both points within the step.
    start, end = times[steps], times[steps + 1]
    crossing_times = start + share * (end - start)
    if tick:
        crossing_times = np.clip(
            np.rint(crossing_times / tick) * tick, start + tick, end - 2 * tick
        )

    # a step that starts on the antimeridian needs the second point only
    is_needed = np.stack([share > 0, np.ones(len(share), np.bool_)], axis=1).ravel()

    # Columns of the new points, two for each step.
    rows = np.repeat(steps + 1, 2)[is_needed]
    new_times = np.stack([crossing_times, crossing_times + tick], axis=1).ravel()[is_needed]
    new_lat = np.repeat(lat[steps] + share * (lat[steps + 1] - lat[steps]), 2)[is_needed]
    new_lon = np.stack([side, -side], axis=1).ravel()[is_needed]
    return (
        np.insert(times, rows, new_times),
        np.insert(lat, rows, new_lat),
        np.insert(lon, rows, new_lon),
    )
