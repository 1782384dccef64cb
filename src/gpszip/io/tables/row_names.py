"""Columns that name each row of a table, and so are no names of tracks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["names_each_row"]

#: Fewer rows than this tell nothing: two vehicles may have one position each.
_MIN_ROWS = 3

#: Points that tracks must have on average so that their names are believed.
_MIN_POINTS_PER_TRACK = 2

#: Faster than any aircraft that keeps a log, in metres a second: successive rows are of different vehicles.
_MAX_SPEED = 350.0

_METRES_PER_DEGREE = 111_195.0

Floats = NDArray[np.float64]


def names_each_row(ids: int, times: Floats, coordinates: Floats, *, geographic: bool) -> bool:
    """Whether the values of a column name each row: nearly all differ, while the rows make sense as a single track.

    They make sense so if times never go back, mostly increase, and mostly not faster than an aircraft goes. A list of many
    vehicles with a position each isn't like that.

    Parameters
    ----------
    ids : int
        How many different values the column has.
    times : float64 array, shape (n,)
        Seconds; NaN where not known.
    coordinates : float64 array, shape (n, d)
        Metres, or latitude and longitude in degrees; NaN where not known.
    geographic : bool
        Whether they are degrees.

    Examples
    --------
    >>> times = np.arange(3.0)
    >>> names_each_row(3, times, np.zeros((3, 2)), geographic=False), names_each_row(3, times[::-1], np.zeros((3, 2)), geographic=False)
    (True, False)
    """
    if len(times) < _MIN_ROWS or ids * _MIN_POINTS_PER_TRACK <= len(times):
        return False
    known = np.isfinite(times) & np.isfinite(coordinates).all(axis=1)
    steps = np.diff(times[known])
    if not len(steps) or (steps < 0).any() or np.median(steps) <= 0:
        return False
    return (
        float(np.median(_lengths(coordinates[known], geographic) / np.maximum(steps, 1e-3)))
        <= _MAX_SPEED
    )


def _lengths(coordinates: Floats, geographic: bool) -> Floats:
    """Metres from each position to the next, roughly."""
    moves = np.diff(coordinates, axis=0)
    if geographic:
        moves[:, 1] = ((moves[:, 1] + 180) % 360 - 180) * np.cos(np.radians(coordinates[1:, 0]))
        moves *= _METRES_PER_DEGREE
    lengths: Floats = np.linalg.norm(moves, axis=1)
    return lengths
