"""Bounds on how far the true course of travel may lie from a straight edge.

Between two samples the agent may have been anywhere in an ellipse about them. So the spacing of
samples bounds how far an edge may move when it is bundled with others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["corridor_bounds", "sample_spacings"]

#: Quantile of the durations of edge traversals that stands for the sampling interval if it is
#: unknown. In sparse logs nearly every traversal leads from one sample to the next; in dense logs
#: the short traversals are those on curves.
_SPACING_QUANTILE = 0.25


def sample_spacings(
    length: NDArray[np.float64],
    edges: NDArray[np.int32],
    seconds: NDArray[np.float64],
    sampling: float | None,
) -> NDArray[np.float64]:
    """Upper bound on the unobserved length of each edge.

    An edge that took several sampling intervals has samples along it, which show that it is
    straight. Only the distance travelled in one interval is unobserved.

    Parameters
    ----------
    length : float64 array, shape (E,)
        Length of each edge in metres.
    edges : int32 array, shape (t,)
        Edge of each traversal.
    seconds : float64 array, shape (t,)
        Duration of each traversal; NaN if it is unknown. An edge without any duration counts as
        unobserved over its full length.
    sampling : float or None
        Seconds between two samples. If None, it is the lower quartile of the durations.

    Returns
    -------
    float64 array, shape (E,)
        Metres.

    Examples
    --------
    >>> length = np.array([10.0, 100.0])
    >>> edges, seconds = np.array([0, 0, 0, 1]), np.array([1.0, 1.0, 1.0, 10.0])
    >>> sample_spacings(length, edges, seconds, 0.5).tolist()
    [5.0, 5.0]
    >>> sample_spacings(length, edges, seconds, None).tolist()
    [10.0, 10.0]
    """
    known = seconds > 0
    if not known.any():
        return length
    interval = (
        float(np.quantile(seconds[known], _SPACING_QUANTILE)) if sampling is None else sampling
    )

    # One interval as a fraction of the mean duration of each edge.
    count = np.bincount(edges[known], minlength=len(length))
    total = np.bincount(edges[known], weights=seconds[known], minlength=len(length))
    fraction = np.where(count > 0, interval * count / np.maximum(total, 1e-9), 1.0)
    spacing: NDArray[np.float64] = length * np.minimum(fraction, 1.0)
    return spacing


def corridor_bounds(
    length: NDArray[np.float64], spacing: NDArray[np.float64], detour: float, margin: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounds on where the path of an edge may run.

    The path between two samples stays in an ellipse with its foci at the samples. An edge of
    several sampling intervals stays as near to its straight line, up to the error of samples.

    Parameters
    ----------
    length, spacing : float64 arrays, shape (E,)
        Length of each edge, and of the travel in one sampling interval on it, in metres.
    detour : float
        Longest path between two samples, as a multiple of their distance.
    margin : float
        Error of samples in metres.

    Returns
    -------
    max_detour : float64 array, shape (E,)
        Largest sum of the distances to both ends of the edge, in metres.
    max_offset : float64 array, shape (E,)
        Largest distance from the straight line in metres.

    Examples
    --------
    >>> length, spacing = np.array([3.0, 300.0]), np.array([3.0, 3.0])
    >>> max_detour, max_offset = corridor_bounds(length, spacing, 5 / 3, 0.0)
    >>> max_detour.round(2).tolist(), max_offset.tolist()
    ([5.0, 300.03], [2.0, 2.0])
    """
    # The ellipse has the semi-minor axis sqrt(detour^2 - 1) / 2 times the spacing.
    max_offset = np.sqrt((detour**2 - 1) / 4 * np.minimum(spacing, length) ** 2 + margin**2)
    return np.sqrt(length**2 + 4 * max_offset**2), max_offset
