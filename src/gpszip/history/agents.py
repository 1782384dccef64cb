"""Agents by their speeds: how much faster or slower than others on the same edges each track is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.history.traversals import Traversals

__all__ = ["AgentSpeed", "cluster_agents", "cluster_values"]

#: Traversals with a speed that a track needs for a place in a cluster.
_MIN_TRAVERSALS = 5

#: Most clusters.
_MAX_CLUSTERS = 4

#: Smallest standard deviation of relative speeds within a cluster: agents that differ by less are
#: alike.
_MIN_SPREAD = 0.05

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class AgentSpeed:
    """Speed of one track against all others.

    Parameters
    ----------
    track : str
        Its name.
    traversals : int
        Traversals with a speed.
    relative_speed : float
        Median of its speed over the median of all tracks on the same edge in the same direction.
    cluster : int
        Number of its cluster, 0 for the slowest; -1 for a track with few traversals.
    """

    track: str
    traversals: int
    relative_speed: float
    cluster: int


def cluster_agents(
    traversals: Traversals, speeds: Floats, medians: Floats
) -> tuple[AgentSpeed, ...]:
    """Group tracks by their relative speeds.

    Parameters
    ----------
    traversals : Traversals
        All traversals.
    speeds : float64 array, shape (n,)
        Their speeds; NaN is none.
    medians : float64 array, shape (n,)
        Median speed of all tracks on the same edge in the same direction.

    Returns
    -------
    tuple of AgentSpeed
        One for each track with a speed, in the order of ``traversals.ids``.
    """
    # Median of the ratios of each track.
    ratio = speeds / medians
    known = np.flatnonzero(np.isfinite(ratio))
    order = known[np.lexsort((ratio[known], traversals.track[known]))]
    tracks, first, counts = np.unique(
        traversals.track[order], return_index=True, return_counts=True
    )
    relative = 0.5 * (ratio[order[first + (counts - 1) // 2]] + ratio[order[first + counts // 2]])

    # Clusters of those that have enough.
    cluster = np.full(len(tracks), -1)
    enough = counts >= _MIN_TRAVERSALS
    cluster[enough] = cluster_values(np.log(relative[enough]))
    return tuple(
        AgentSpeed(traversals.ids[track], int(count), float(value), int(number))
        for track, count, value, number in zip(tracks, counts, relative, cluster, strict=True)
    )


def cluster_values(values: Floats) -> NDArray[np.int64]:
    """Split numbers into clusters that are as tight as they are few.

    Among all splits of the sorted numbers into k runs, the one with the least sum of squares about
    the means is found by dynamic programming: ``C(k, j) = min over i of C(k - 1, i) + S(i, j)``,
    with the sum of squares S of the numbers from i to j. The number of clusters, up to 4, is the
    one with the least n ln(C / n) + 2 k ln n (Bayes's information criterion).

    Returns
    -------
    int64 array, shape (n,)
        Number of the cluster of each value, 0 for the smallest ones.

    Examples
    --------
    >>> cluster_values(np.array([1.0, 5.1, 1.1, 5.0, 0.9, 4.9])).tolist()
    [0, 1, 0, 1, 0, 1]
    """
    # Sums of squares of all runs of the sorted values.
    count = len(values)
    if not count:
        return np.zeros(0, np.int64)
    order = np.argsort(values, kind="stable")
    ordered = values[order] - values.mean()
    sums = np.append(0.0, np.cumsum(ordered))
    squares = np.append(0.0, np.cumsum(ordered**2))
    begin, end = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
    size = np.maximum(end - begin, 1)
    cost = squares[end] - squares[begin] - (sums[end] - sums[begin]) ** 2 / size
    cost = np.where(end > begin, np.maximum(cost, 0.0), np.inf)

    # Best splits into one run, two, and so on; choose their number.
    best, cuts, chosen, least = cost[0], [], 1, np.inf
    for clusters in range(1, min(_MAX_CLUSTERS, count) + 1):
        if clusters > 1:
            options = best[:, None] + cost
            cuts.append(options.argmin(axis=0))
            best = options.min(axis=0)
        variance = max(best[count] / count, _MIN_SPREAD**2)
        criterion = count * np.log(variance) + 2 * clusters * np.log(count)
        if criterion < least - 1e-9:
            chosen, least = clusters, criterion

    # Follow the cuts back.
    number, last = np.zeros(count, np.int64), count
    for cluster in range(chosen - 1, 0, -1):
        first = int(cuts[cluster - 1][last])
        number[first:last] = cluster
        last = first
    result = np.empty(count, np.int64)
    result[order] = number
    return result
