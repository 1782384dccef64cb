"""Detection of columns that name each row of a table, such as UUIDs, and so are no track ids."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["names_each_row"]

#: Least number of rows for a decision; in fewer, two vehicles may have one position each.
_MIN_ROWS = 3

#: Mean number of points per track from which names are certainly track ids.
_MIN_POINTS_PER_TRACK = 2

#: Speed of the fastest aircraft with a log, in metres per second. Successive rows that imply a
#: higher one belong to different vehicles.
_MAX_SPEED = 350.0

#: Shortest step in seconds when speeds are computed.
_MIN_STEP = 1e-3

#: Metres in a degree of latitude.
_METRES_PER_DEGREE = 111_195.0

Floats = NDArray[np.float64]


def names_each_row(ids: int, times: Floats, coordinates: Floats, *, geographic: bool) -> bool:
    """Whether a column names each row rather than each track.

    It does if nearly all its values differ, while the rows form a plausible single track: times
    never decrease, mostly increase, and speeds are mostly below those of aircraft. A list of
    vehicles with a position each isn't plausible as a track.

    Parameters
    ----------
    ids : int
        Number of distinct values in the column.
    times : float64 array, shape (n,)
        Seconds; NaN if unknown.
    coordinates : float64 array, shape (n, d)
        Metres, or latitude and longitude in degrees; NaN if unknown.
    geographic : bool
        Whether coordinates are degrees.

    Examples
    --------
    >>> times, positions = np.arange(3.0), np.zeros((3, 2))
    >>> names_each_row(3, times, positions, geographic=False)
    True
    >>> names_each_row(3, times[::-1], positions, geographic=False)
    False
    """
    if len(times) < _MIN_ROWS or ids * _MIN_POINTS_PER_TRACK <= len(times):
        return False

    # Times must not decrease.
    known = np.isfinite(times) & np.isfinite(coordinates).all(axis=1)
    steps = np.diff(times[known])
    if not len(steps) or (steps < 0).any() or np.median(steps) <= 0:
        return False

    # Rows of different vehicles are far apart, which would be too fast for a single one.
    speeds = _step_lengths(coordinates[known], geographic) / np.maximum(steps, _MIN_STEP)
    return float(np.median(speeds)) <= _MAX_SPEED


def _step_lengths(coordinates: Floats, geographic: bool) -> Floats:
    """Approximate distance in metres from each position to the next."""
    moves = np.diff(coordinates, axis=0)
    if geographic:
        # A degree of longitude is cos(latitude) times a degree of latitude. Differences are wrapped
        # to [-180, 180), so that a step over the antimeridian is short.
        moves[:, 1] = ((moves[:, 1] + 180) % 360 - 180) * np.cos(np.radians(coordinates[1:, 0]))
        moves *= _METRES_PER_DEGREE
    lengths: Floats = np.linalg.norm(moves, axis=1)
    return lengths
