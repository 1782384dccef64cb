"""Places: stops of all tracks and days that lie together."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["group_stops"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def group_stops(
    positions: ArrayLike, weights: ArrayLike, noise: ArrayLike, radius: float
) -> tuple[Integers, Floats]:
    """Group stops to places.

    The heaviest stop that has no place yet makes one, with all stops within the radius; then each
    place moves to the mean of its stops, and each stop goes to the place nearest to it. Stops of
    large errors make no places of their own where others are within these errors.

    Parameters
    ----------
    positions : array_like, shape (n, d)
        Metres.
    weights : array_like, shape (n,)
        Positive: seconds.
    noise : array_like, shape (n,)
        Errors of the positions in metres.
    radius : float
        Metres around the centre of a place that belong to it.

    Returns
    -------
    int64 array, shape (n,)
        Number of the place of each stop. Places are numbered from 0 by their weight, the heaviest
        first.
    float64 array, shape (k, d)
        Their centres.

    Examples
    --------
    >>> places, centres = group_stops([[0.0], [500.0], [40.0]], [1, 9, 1], [10, 10, 10], 100.0)
    >>> places.tolist(), centres.tolist()
    ([1, 0, 1], [[500.0], [20.0]])
    """
    from scipy.spatial import cKDTree

    positions, weights = np.asarray(positions, np.float64), np.asarray(weights, np.float64)
    noise = np.asarray(noise, np.float64)
    if not len(positions):
        return np.zeros(0, np.int64), positions

    # The heaviest stop and those around it, exact stops first.
    label = np.full(len(positions), -1)
    tree = cKDTree(positions)
    leaders: list[int] = []
    for stop in np.lexsort((-weights, noise > radius)).tolist():
        if label[stop] >= 0:
            continue
        around = np.array(tree.query_ball_point(positions[stop], radius))
        label[around[label[around] < 0]] = len(leaders)
        leaders.append(stop)

    # Places at the means of their stops; each stop at the nearest one within its reach.
    centres = _means(positions, weights, label, len(leaders))
    distance, nearest = cKDTree(centres).query(positions)
    label = np.where(distance <= radius + noise, nearest, label)

    # Numbers by weight, without those that lost all stops.
    mass = np.bincount(label, weights, len(leaders))
    order = np.argsort(-mass, kind="stable")[: int((mass > 0).sum())]
    rank = np.zeros(len(leaders), np.int64)
    rank[order] = np.arange(len(order))
    label = rank[label]
    return label, _means(positions, weights, label, len(order))


def _means(positions: Floats, weights: Floats, label: Integers, count: int) -> Floats:
    mass = np.bincount(label, weights, count)
    sums = np.stack([np.bincount(label, weights * axis, count) for axis in positions.T], axis=1)
    means: Floats = sums / np.maximum(mass, 1e-300)[:, None]
    return means
