"""How far an edge may lie beside the way that was travelled: only as far as somebody could have gone unseen between two samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["corridor_bounds", "sample_spacings"]

#: Where it isn't known how far apart samples are: this share of all moves takes no longer, or hardly. Where samples are rare nearly every
#: move is a step between two of them; where they are dense, short moves are those round corners.
_SPACING_QUANTILE = 0.25


def sample_spacings(
    length: NDArray[np.float64],
    edges: NDArray[np.int32],
    seconds: NDArray[np.float64],
    sampling: float | None,
) -> NDArray[np.float64]:
    """Metres of each edge that were travelled between two samples, at most: the log itself is witness that a longer edge is straight.

    Parameters
    ----------
    length : float64 array, shape (E,)
        Of each edge in metres.
    edges : int32 array, shape (h,)
        Edge of each move.
    seconds : float64 array, shape (h,)
        How long each took; where that isn't known, an edge may be a single step.
    sampling : float or None
        Seconds between two samples. Where that isn't known, it is less than most moves take.

    Returns
    -------
    float64 array, shape (E,)

    Examples
    --------
    >>> moves = np.array([0, 0, 0, 1]), np.array([1.0, 1.0, 1.0, 10.0])
    >>> sample_spacings(np.array([10.0, 100.0]), *moves, 0.5).tolist(), sample_spacings(np.array([10.0, 100.0]), *moves, None).tolist()
    ([5.0, 5.0], [10.0, 10.0])
    """
    known = seconds > 0
    if not known.any():
        return length
    step = float(np.quantile(seconds[known], _SPACING_QUANTILE)) if sampling is None else sampling
    count = np.bincount(edges[known], minlength=len(length))
    total = np.bincount(edges[known], weights=seconds[known], minlength=len(length))
    share = np.where(count > 0, step * count / np.maximum(total, 1e-9), 1.0)
    spacing: NDArray[np.float64] = length * np.minimum(share, 1.0)
    return spacing


def corridor_bounds(
    length: NDArray[np.float64], spacing: NDArray[np.float64], detour: float, margin: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounds of the ground on which the way of an edge may run.

    A step between two samples stays in an ellipse about its ends. An edge of many steps stays as near to its straight line, or
    nearly: samples err.

    Parameters
    ----------
    length, spacing : float64 array, shape (E,)
        Of each edge, and of one step on it, in metres.
    detour : float
        The distances to both ends of a step add up to at most so many times its length.
    margin : float
        Metres that samples err.

    Returns
    -------
    far : float64 array, shape (E,)
        Metres to which the distances to both ends of the edge add up, at most.
    wide : float64 array, shape (E,)
        Largest distance from the straight line in metres.

    Examples
    --------
    >>> far, wide = corridor_bounds(np.array([3.0, 300.0]), np.array([3.0, 3.0]), 5 / 3, 0.0)
    >>> far.round(2).tolist(), wide.tolist()
    ([5.0, 300.03], [2.0, 2.0])
    """
    wide = np.sqrt((detour**2 - 1) / 4 * np.minimum(spacing, length) ** 2 + margin**2)
    return np.sqrt(length**2 + 4 * wide**2), wide
