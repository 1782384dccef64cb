"""Lines that cross the antimeridian, where longitudes jump between 180 and -180 degrees.

Whoever draws or interpolates such a line in degrees goes round the world instead. A line is therefore brought to the
antimeridian on one side and goes on from it on the other, so that it can be cut between the two (RFC 7946, 3.1.9).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["align_antimeridian_signs", "find_crossings", "insert_crossings", "wrap_degrees"]

Floats = NDArray[np.float64]

#: A leg in time this many ticks long has room for two more points; shorter ones are left as they are.
_MIN_STEP_TICKS = 4


def wrap_degrees(degrees: Floats) -> Floats:
    """Bring differences of longitudes into [-180, 180).

    Examples
    --------
    >>> wrap_degrees(np.array([359.0, -190.0, 12.0])).tolist()
    [-1.0, 170.0, 12.0]
    """
    between: Floats = (degrees + 180.0) % 360.0 - 180.0
    return between


def find_crossings(lon: Floats) -> NDArray[np.bool_]:
    """Find the steps that lead across the antimeridian.

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
    far: NDArray[np.bool_] = np.abs(np.diff(lon)) > 180.0
    return far


def align_antimeridian_signs(lon: Floats) -> Floats:
    """Give points that lie on the antimeridian the sign of their neighbours, as 180 and -180 are the same place.

    Parameters
    ----------
    lon : float64 array, shape (n,)
        Degrees in [-180, 180].

    Returns
    -------
    float64 array, shape (n,)
        The side of the last point before that lies off the antimeridian, or else of the first one behind.

    Examples
    --------
    >>> align_antimeridian_signs(np.array([-180.0, 179.0, -180.0, 180.0, -179.0])).tolist()
    [180.0, 179.0, 180.0, 180.0, -179.0]
    """
    on = np.abs(lon) == 180.0
    if not on.any() or on.all():
        return lon if not on.any() else np.full_like(lon, 180.0)

    # index of the last point off the antimeridian, at the start that of the first one
    last = np.maximum.accumulate(np.where(on, -1, np.arange(len(lon))))
    last[last < 0] = np.argmin(on)
    return np.where(on, np.copysign(180.0, lon[last]), lon)


def insert_crossings(
    times: Floats, lat: Floats, lon: Floats, tick: float
) -> tuple[Floats, Floats, Floats]:
    """Add two points at each crossing of the antimeridian: at 180 degrees on the one side and on the other.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Increasing; any number that tells where on the line a point is will do.
    lat, lon : float64 array, shape (n,)
        Degrees, linear in ``times`` on the shorter way from one point to the next.
    tick : float
        The two points lie this much apart in time, as times have to increase. Steps of less than four ticks are left as
        they are.

    Returns
    -------
    times, lat, lon : float64 array, shape (m,)

    Examples
    --------
    >>> insert_crossings(np.array([0.0, 4.0]), np.array([1.0, 2.0]), np.array([179.0, -179.0]), 0.5)
    (array([0. , 2. , 2.5, 4. ]), array([1. , 1.5, 1.5, 2. ]), array([ 179.,  180., -180., -179.]))
    """
    lon = align_antimeridian_signs(lon)
    across = np.flatnonzero(find_crossings(lon) & (np.diff(times) >= _MIN_STEP_TICKS * tick))
    if not len(across):
        return times, lat, lon

    # where the line meets the antimeridian, as a share of the step
    side = np.copysign(180.0, lon[across])
    step = wrap_degrees(lon[across + 1] - lon[across])
    share = np.clip((side - lon[across]) / np.where(step == 0, 1.0, step), 0.0, 1.0)

    # when, on whole ticks, with room for both points within the step
    start, end = times[across], times[across + 1]
    when = start + share * (end - start)
    if tick:
        when = np.clip(np.rint(when / tick) * tick, start + tick, end - 2 * tick)

    # a step that starts on the antimeridian needs no more than the point on the other side
    wanted = np.stack([share > 0, np.ones(len(share), np.bool_)], axis=1).ravel()

    where = np.repeat(across + 1, 2)[wanted]
    there = np.repeat(lat[across] + share * (lat[across + 1] - lat[across]), 2)[wanted]
    instants = np.stack([when, when + tick], axis=1).ravel()[wanted]
    sides = np.stack([side, -side], axis=1).ravel()[wanted]
    return (
        np.insert(times, where, instants),
        np.insert(lat, where, there),
        np.insert(lon, where, sides),
    )
