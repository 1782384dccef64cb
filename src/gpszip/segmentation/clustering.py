"""Initial assignment of k intervals to m segments under the pooled fitting cost.

Source: the thesis, algorithm 1, line 2.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from gpszip.kernels.sums import PrefixSums
from gpszip.segmentation.kernels import ward as kernel
from gpszip.segmentation.lines import FittedLines, best_lines, excess_costs, pooled_lines

__all__ = ["Merges", "cut_merges", "find_merges", "k_means", "ward"]

#: Pairs of intervals that are merged one after the other, shape (k - 1, 2).
Merges: TypeAlias = NDArray[np.int64]

#: Groups up to which the costs of merging all pairs are compared.
_MAX_ALL_PAIRS = 2000

#: Nearest groups that are compared where there are more groups.
_NEIGHBOURS = 12


def ward(sums: PrefixSums, boundaries: NDArray[np.int64], m: int) -> NDArray[np.int32]:
    """Label k intervals with exactly m labels by Ward's agglomeration.

    Merges the two groups of intervals whose common line increases the cost least, until m groups
    are left. Above 2000 groups only nearby ones are compared. Deterministic; the best initial
    labels found in experiments.

    Returns
    -------
    int32 array, shape (k,)
        Labels in the order of their first intervals.
    """
    return cut_merges(find_merges(sums, boundaries), m)


def cut_merges(merges: Merges, m: int) -> NDArray[np.int32]:
    """Label k intervals with exactly m labels; as :func:`ward` with merges that are known.

    Groups are the connected components of the k - m cheapest merges: each leaves one group less.
    """
    k = len(merges) + 1
    cheapest = merges[: k - m]
    links = coo_array((np.ones(len(cheapest)), (cheapest[:, 0], cheapest[:, 1])), shape=(k, k))
    return _renumber_labels(connected_components(links, directed=False)[1])


def find_merges(sums: PrefixSums, boundaries: NDArray[np.int64]) -> Merges:
    """Return all merges of k intervals down to one group, the cheapest first."""
    merges, costs = _build_dendrogram(best_lines(sums, boundaries))
    return merges[np.argsort(costs, kind="stable")]


def _build_dendrogram(lines: FittedLines) -> tuple[Merges, NDArray[np.float64]]:
    """Return all merges down to one group, as pairs of intervals, and their costs.

    Mutual nearest neighbours are merged sooner or later in any case, so all such pairs can be
    merged at once; the costs tell which merges come first.
    """
    normal, starts, slopes = lines

    # Many groups: merge all mutual neighbours at once.
    groups, merges, costs = np.arange(len(normal)), [], []
    while len(groups) > _MAX_ALL_PAIRS:
        lines_of_groups = FittedLines(normal[groups], starts[groups], slopes[groups])
        neighbours, merge_costs = _mutual_neighbours(lines_of_groups)
        pairs = groups[neighbours]
        merges.append(pairs)
        costs.append(merge_costs)
        kernel.merge_pairs(normal, starts, slopes, pairs)
        groups = np.setdiff1d(groups, pairs[:, 1], assume_unique=True)

    # The remaining ones, all pairs compared; rounding may have made a cost fall, which it can't.
    last_merges, last_costs = kernel.ward(normal[groups], starts[groups], slopes[groups])
    merges.append(groups[last_merges])
    costs.append(np.maximum.accumulate(last_costs))
    return np.concatenate(merges), np.concatenate(costs)


def _mutual_neighbours(lines: FittedLines) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return disjoint pairs (i, j), i < j, of mutual nearest neighbours, and the merge costs.

    Neighbours are searched among the groups with the nearest end points.
    """
    # Nearest neighbour of each group under the cost of merging.
    end_points = np.hstack([lines.starts, lines.starts + lines.slopes])
    _, candidates = KDTree(end_points).query(end_points, min(_NEIGHBOURS, len(end_points)))
    candidates = np.asarray(candidates, dtype=np.int64)
    groups = np.arange(len(end_points))
    costs = np.where(candidates == groups[:, None], np.inf, kernel.merge_costs(*lines, candidates))
    best = costs.argmin(axis=1)
    nearest, nearest_cost = candidates[groups, best], costs[groups, best]

    # Make at least one pair mutual, even if rounding or the tree left none.
    cheapest = int(nearest_cost.argmin())
    partner = nearest[cheapest]
    nearest[partner], nearest_cost[partner] = cheapest, nearest_cost[cheapest]

    # Take each pair of groups that are nearest to each other once.
    mutual = np.flatnonzero((nearest[nearest] == groups) & (groups < nearest))
    return np.column_stack([mutual, nearest[mutual]]), nearest_cost[mutual]


def k_means(
    sums: PrefixSums,
    boundaries: NDArray[np.int64],
    m: int,
    rng: np.random.Generator,
    *,
    rounds: int = 50,
) -> NDArray[np.int32]:
    """Label k intervals with exactly m labels by k-means under the pooled fitting cost.

    Seeds are drawn as by k-means++; Lloyd's rounds follow until no label changes.
    """
    lines = best_lines(sums, boundaries)
    seeds = _draw_seeds(lines, m, rng)
    labels = _assign_labels(lines, lines.starts[seeds], lines.slopes[seeds])

    for _ in range(rounds):
        _, starts, slopes = pooled_lines(sums, boundaries, labels, m)
        new_labels = _assign_labels(lines, starts, slopes)
        if np.array_equal(new_labels, labels):
            break
        labels = new_labels
    return _renumber_labels(labels)


def _draw_seeds(lines: FittedLines, m: int, rng: np.random.Generator) -> list[int]:
    """Draw m intervals with odds in proportion to their cost against the nearest earlier seed."""
    _, starts, slopes = lines
    seeds = [int(rng.integers(len(starts)))]
    costs = np.full(len(starts), np.inf)
    for _ in range(m - 1):
        last = seeds[-1:]
        costs = np.minimum(costs, excess_costs(lines, starts[last], slopes[last])[:, 0])
        # A seed must not be drawn twice: rounding may leave it some cost.
        costs[seeds] = 0.0

        # If all lines are alike, each interval that is no seed has the same odds.
        if costs.sum() > 0:
            odds = costs
        else:
            odds = np.isin(np.arange(len(costs)), seeds, invert=True).astype(float)
        seeds.append(int(rng.choice(len(odds), p=odds / odds.sum())))
    return seeds


def _assign_labels(
    lines: FittedLines, starts: NDArray[np.float64], slopes: NDArray[np.float64]
) -> NDArray[np.int32]:
    """Assign each interval to its nearest line.

    A line without an interval gets the interval with the highest cost whose label has others.
    """
    costs = excess_costs(lines, starts, slopes)
    labels: NDArray[np.int32] = costs.argmin(axis=1).astype(np.int32)
    lowest = costs[np.arange(len(costs)), labels]

    counts = np.bincount(labels, minlength=len(starts))
    for empty in np.flatnonzero(counts == 0):
        worst = int(np.where(counts[labels] > 1, lowest, -1.0).argmax())
        counts[labels[worst]] -= 1
        labels[worst], lowest[worst] = empty, 0.0
        counts[empty] = 1
    return labels


def _renumber_labels(labels: NDArray[np.integer]) -> NDArray[np.int32]:
    """Number labels 0, 1, ... in the order of their first intervals."""
    _, firsts, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(firsts), dtype=np.int32)
    rank[np.argsort(firsts)] = np.arange(len(firsts), dtype=np.int32)
    renumbered: NDArray[np.int32] = rank[inverse]
    return renumbered
