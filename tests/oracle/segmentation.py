"""Reference (k,m)-segment mean: residuals, loops, least squares by numpy, no moments."""

from __future__ import annotations

from itertools import combinations

import numpy as np


def sample_weights(track):
    return np.ones(len(track)) if track.weights is None else track.weights


def normalised_time(track, a, b):
    """Times of samples a to b - 1, scaled to run from 0 to 1."""
    t = track.times[a:b] - track.times[a]
    return t / t[-1] if t[-1] > 0 else t


def interval_cost(track, a, b, start, end):
    if a == b:
        return 0.0
    on_segment = start + normalised_time(track, a, b)[:, None] * (end - start)
    residuals = on_segment - track.positions[a:b]
    return float(sample_weights(track)[a:b] @ (residuals**2).sum(axis=1))


def cost(track, boundaries, labels, starts, ends):
    intervals = zip(boundaries[:-1], boundaries[1:], labels, strict=True)
    return sum(interval_cost(track, a, b, starts[label], ends[label]) for a, b, label in intervals)


def pooled_line(track, intervals):
    """Start and end of the best segment of several intervals (a, b), by pooled least squares."""
    u = np.concatenate([normalised_time(track, a, b) for a, b in intervals])
    p = np.concatenate([track.positions[a:b] for a, b in intervals])
    root = np.sqrt(np.concatenate([sample_weights(track)[a:b] for a, b in intervals]))[:, None]
    solved = np.linalg.lstsq(root * np.column_stack([1 - u, u]), root * p, rcond=None)[0]
    return (solved[0], solved[1]) if u.any() else (solved[0], solved[0])


def pooled_cost(track, intervals):
    line = pooled_line(track, intervals)
    return sum(interval_cost(track, a, b, *line) for a, b in intervals)


def best_label(track, a, b, starts, ends):
    costs = [interval_cost(track, a, b, *segment) for segment in zip(starts, ends, strict=True)]
    return min(costs), int(np.argmin(costs))


def best_cut(track, a, b, starts, ends, min_samples=1):
    """Cost, cut and labels of the best two intervals of [a, b)."""
    best = (np.inf, -1, -1, -1)
    for c in range(a + min_samples, b - min_samples + 1):
        left, right = best_label(track, a, c, starts, ends), best_label(track, c, b, starts, ends)
        if left[0] + right[0] < best[0]:
            best = (left[0] + right[0], c, left[1], right[1])
    return best


def shift_boundaries(track, boundaries, labels, starts, ends, indices):
    """Shift the boundaries with these indices in turn, where that lowers the cost."""
    boundaries, labels = list(boundaries), list(labels)
    for j in indices:
        a, c, b = boundaries[j - 1 : j + 2]
        current = interval_cost(track, a, c, starts[labels[j - 1]], ends[labels[j - 1]])
        current += interval_cost(track, c, b, starts[labels[j]], ends[labels[j]])
        best, cut, left, right = best_cut(track, a, b, starts, ends)
        if best < current:
            boundaries[j], labels[j - 1], labels[j] = cut, left, right
    return boundaries, labels


def best_partition(track, starts, ends, k, min_samples=1):
    """Least cost of k intervals, by trying all partitions."""
    n, best = len(track), np.inf
    for inner in combinations(range(1, n), k - 1):
        cuts = [0, *inner, n]
        if min(np.diff(cuts)) >= min_samples:
            intervals = zip(cuts[:-1], cuts[1:], strict=True)
            best = min(best, sum(best_label(track, a, b, starts, ends)[0] for a, b in intervals))
    return best


def penalised_cost(track, starts, ends, penalty, min_samples=1, stride=1):
    """Least cost + penalty * intervals, by dynamic programming without pruning."""
    cuts = [*range(0, len(track), stride), len(track)]
    best = {0: 0.0}
    for b in cuts[1:]:
        options = [
            best[a] + best_label(track, a, b, starts, ends)[0] + penalty
            for a in cuts
            if b - a >= min_samples
        ]
        best[b] = min(options, default=np.inf)
    return best[len(track)]


def synchronised_split(track, i, j):
    """Largest synchronised distance from the chord i to j, and its sample."""
    share = (track.times[i : j + 1] - track.times[i]) / (track.times[j] - track.times[i])
    chord = track.positions[i] + share[:, None] * (track.positions[j] - track.positions[i])
    distances = np.sqrt(((chord - track.positions[i : j + 1]) ** 2).sum(axis=1))[1:-1]
    return float(distances.max()), i + 1 + int(distances.argmax())


def douglas_peucker(track, k):
    """Boundaries of k intervals: split the chord with the largest distance."""
    knots = [0, len(track) - 1]
    while len(knots) - 1 < k:
        chords = [
            synchronised_split(track, i, j)
            for i, j in zip(knots[:-1], knots[1:], strict=True)
            if j - i > 1
        ]
        knots = sorted([*knots, max(chords)[1]])
    return [*knots[:-1], len(track)]


def bottom_up(track, k, block):
    """Boundaries of k intervals: merge the neighbours with the least increase of cost."""
    cuts = [*range(0, len(track), block), len(track)]
    while len(cuts) - 1 > k:
        increase = [
            pooled_cost(track, [(a, b)])
            - pooled_cost(track, [(a, c)])
            - pooled_cost(track, [(c, b)])
            for a, c, b in zip(cuts[:-2], cuts[1:-1], cuts[2:], strict=True)
        ]
        del cuts[int(np.argmin(increase)) + 1]
    return cuts


def ward(track, boundaries, m):
    """Set of groups of intervals: merge the two groups with the least increase of cost."""
    intervals = list(zip(boundaries[:-1], boundaries[1:], strict=True))
    groups = [frozenset([j]) for j in range(len(intervals))]
    while len(groups) > m:
        increase = {
            (g, h): pooled_cost(track, [intervals[j] for j in g | h])
            - pooled_cost(track, [intervals[j] for j in g])
            - pooled_cost(track, [intervals[j] for j in h])
            for g, h in combinations(groups, 2)
        }
        g, h = min(increase, key=increase.__getitem__)
        groups = [group for group in groups if group not in {g, h}] + [g | h]
    return set(groups)
