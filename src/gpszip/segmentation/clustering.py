"""Initial clustering of k parts to m segments under the pooled fitting cost (thesis, algorithm 1, line 2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from gpszip.kernels.sums import PrefixSums
from gpszip.segmentation.kernels import ward as kernel
from gpszip.segmentation.lines import FittedLines, best_lines, excess_costs, pooled_lines

__all__ = ["k_means", "ward"]

#: Groups up to which all pairs are weighed.
_MAX_ALL_PAIRS = 2000

#: Near groups that are weighed where there are more.
_NEIGHBOURS = 12


def ward(sums: PrefixSums, boundaries: NDArray[np.int64], m: int) -> NDArray[np.int32]:
    """Label k parts with exactly m labels by joining, again and again, the two groups whose common line costs least more.

    Above 2000 groups only near ones are weighed against each other. Deterministic; the best start found in experiments.

    Returns
    -------
    int32 array, shape (k,)
        Labels in the order of their first parts.
    """
    pairs, costs = _build_dendrogram(best_lines(sums, boundaries))
    k = len(boundaries) - 1
    cheapest = pairs[np.argsort(costs, kind="stable")[: k - m]]
    links = coo_array((np.ones(len(cheapest)), (cheapest[:, 0], cheapest[:, 1])), shape=(k, k))
    return _renumber_labels(connected_components(links, directed=False)[1])


def _build_dendrogram(lines: FittedLines) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """All joins down to one group, as pairs of parts, and what each costs.

    Groups that are each other's nearest join sooner or later in any case, so all such pairs can be joined at once; the
    costs tell which joins come first.
    """
    normal, starts, slopes = lines
    left, pairs, costs = np.arange(len(normal)), [], []
    while len(left) > _MAX_ALL_PAIRS:
        nearest, gaps = _mutual_neighbours((normal[left], starts[left], slopes[left]))
        pairs.append(left[nearest])
        costs.append(gaps)
        kernel.merge_pairs(normal, starts, slopes, pairs[-1])
        left = np.setdiff1d(left, pairs[-1][:, 1], assume_unique=True)
    last, gaps = kernel.ward(normal[left], starts[left], slopes[left])
    return np.concatenate([*pairs, left[last]]), np.concatenate(
        [*costs, np.maximum.accumulate(gaps)]
    )


def _mutual_neighbours(lines: FittedLines) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Disjoint pairs (i, j), i < j, of mutual nearest neighbours among those with near end points; and their costs."""
    _, starts, slopes = lines
    ends = np.hstack([starts, starts + slopes])
    near = np.asarray(KDTree(ends).query(ends, min(_NEIGHBOURS, len(ends)))[1], dtype=np.int64)
    groups = np.arange(len(ends))
    cost = np.where(near == groups[:, None], np.inf, kernel.merge_costs(*lines, near))
    best = cost.argmin(axis=1)
    nearest, gap = near[groups, best], cost[groups, best]
    cheapest = int(gap.argmin())
    nearest[nearest[cheapest]], gap[nearest[cheapest]] = (
        cheapest,
        gap[cheapest],
    )  # at least one pair is mutual, even where rounding or the tree made none
    mutual = np.flatnonzero((nearest[nearest] == groups) & (groups < nearest))
    return np.column_stack([mutual, nearest[mutual]]), gap[mutual]


def k_means(
    sums: PrefixSums,
    boundaries: NDArray[np.int64],
    m: int,
    rng: np.random.Generator,
    *,
    rounds: int = 50,
) -> NDArray[np.int32]:
    """Label k parts with exactly m labels: k-means++ seeds, then Lloyd's rounds, under the pooled fitting cost."""
    lines = best_lines(sums, boundaries)
    centers = _draw_seeds(lines, m, rng)
    labels = _assign_labels(lines, lines[1][centers], lines[2][centers])
    for _ in range(rounds):
        _, starts, slopes = pooled_lines(sums, boundaries, labels, m)
        again = _assign_labels(lines, starts, slopes)
        if np.array_equal(again, labels):
            break
        labels = again
    return _renumber_labels(labels)


def _draw_seeds(lines: FittedLines, m: int, rng: np.random.Generator) -> list[int]:
    """Parts drawn one by one with odds in proportion to what they cost against the nearest drawn before."""
    _, starts, slopes = lines
    seeds = [int(rng.integers(len(starts)))]
    cost = np.full(len(starts), np.inf)
    for _ in range(m - 1):
        cost = np.minimum(cost, excess_costs(lines, starts[seeds[-1:]], slopes[seeds[-1:]])[:, 0])
        cost[seeds] = 0.0
        odds = (
            cost
            if cost.sum() > 0
            else np.isin(np.arange(len(cost)), seeds, invert=True).astype(float)
        )
        seeds.append(int(rng.choice(len(odds), p=odds / odds.sum())))
    return seeds


def _assign_labels(
    lines: FittedLines, starts: NDArray[np.float64], slopes: NDArray[np.float64]
) -> NDArray[np.int32]:
    """Nearest line of each part; a line without a part takes the worst part of a label that has others."""
    cost = excess_costs(lines, starts, slopes)
    labels: NDArray[np.int32] = cost.argmin(axis=1).astype(np.int32)
    least = cost[np.arange(len(cost)), labels]
    count = np.bincount(labels, minlength=len(starts))
    for empty in np.flatnonzero(count == 0):
        worst = int(np.where(count[labels] > 1, least, -1.0).argmax())
        count[labels[worst]] -= 1
        labels[worst], least[worst] = empty, 0.0
        count[empty] = 1
    return labels


def _renumber_labels(labels: NDArray[np.integer]) -> NDArray[np.int32]:
    """Labels 0, 1, ... in the order of their first parts."""
    _, firsts, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(firsts), dtype=np.int32)
    rank[np.argsort(firsts)] = np.arange(len(firsts), dtype=np.int32)
    renumbered: NDArray[np.int32] = rank[inverse]
    return renumbered
