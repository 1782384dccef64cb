"""Headings from orientations: quaternions and rotation matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["forward_of_quaternions", "heading_of_vectors", "unit_vectors"]

#: Least part of a forward vector of length 1 that lies in the plane. A vector that is steeper, up
#: to 6 degrees from the vertical, has no heading.
_MIN_LEVEL_PART = 0.1

Floats = NDArray[np.float64]


def forward_of_quaternions(x: Floats, y: Floats, z: Floats, w: Floats) -> Floats:
    """Return where the x axis of a body points: forward, by ROS's convention REP 103.

    The first column of the rotation matrix of the quaternion q = w + xi + yj + zk,
    (w^2 + x^2 - y^2 - z^2, 2 (xy + wz), 2 (xz - wy)) / |q|^2.

    Parameters
    ----------
    x, y, z, w : float64 arrays, shape (n,)
        Quaternions of any length.

    Returns
    -------
    float64 array, shape (n, 3)
        Unit vectors; NaN for quaternions that are zero or not finite.

    Examples
    --------
    A quarter turn to the left points from x to y:

    >>> half = np.array([np.sqrt(0.5)])
    >>> none = np.array([0.0])
    >>> forward_of_quaternions(none, none, half, half).round(9).tolist()
    [[0.0, 1.0, 0.0]]
    """
    # Numbers of damaged logs may overflow, and have no direction.
    with np.errstate(over="ignore", invalid="ignore"):
        forward = np.stack(
            [w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1
        )
    return unit_vectors(forward)


def unit_vectors(vectors: Floats) -> Floats:
    """Return vectors with length 1; NaN for those that are zero or not finite.

    Examples
    --------
    >>> unit_vectors(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]])).tolist()
    [[0.6, 0.8, 0.0], [nan, nan, nan]]
    """
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.sqrt((vectors**2).sum(axis=1))
        length[~((length > 0) & np.isfinite(length))] = np.nan
        unit: Floats = vectors / length[:, None]
    return unit


def heading_of_vectors(x: Floats, y: Floats, z: Floats) -> Floats:
    """Return the heading of vectors in the plane of x, to the east, and y, to the north.

    Parameters
    ----------
    x, y, z : float64 arrays, shape (n,)
        Vectors of length 1.

    Returns
    -------
    float64 array, shape (n,)
        Degrees clockwise from y, at least 0 and less than 360; NaN for vectors that stand
        perpendicular on the plane or are NaN.

    Examples
    --------
    >>> none = np.zeros(2)
    >>> heading_of_vectors(np.array([1.0, 0.0]), np.array([0.0, -1.0]), none).tolist()
    [90.0, 180.0]
    """
    heading: Floats = np.degrees(np.arctan2(x, y)) % 360.0
    # A tiny negative angle is rounded to 360.
    heading[heading == 360.0] = 0.0
    heading[~(np.hypot(x, y) >= _MIN_LEVEL_PART)] = np.nan
    heading[~np.isfinite(z)] = np.nan
    return heading
