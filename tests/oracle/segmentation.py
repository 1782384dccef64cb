"""Plain twins of the (k,m)-segment mean: residuals, loops, least squares by numpy, no moments."""

from __future__ import annotations

from itertools import combinations

import numpy as np


def weights_of(track):
    return np.ones(len(track)) if track.weights is None else track.weights


def own_time(track, a, b):
    """Time of samples a to b - 1, from 0 at the first to 1 at the last."""
    t = track.times[a:b] - track.times[a]
    return t / t[-1] if t[-1] > 0 else t


def part_cost(track, a, b, start, end):
    if a == b:
        return 0.0
    away = start + own_time(track, a, b)[:, None] * (end - start) - track.positions[a:b]
    return float(weights_of(track)[a:b] @ (away**2).sum(axis=1))


def cost(track, boundaries, labels, starts, ends):
    parts = zip(boundaries[:-1], boundaries[1:], labels, strict=True)
    return sum(part_cost(track, a, b, starts[label], ends[label]) for a, b, label in parts)


def pooled_line(track, parts):
    """Start and end of the best segment of several parts (a, b), by least squares over all their samples."""
    u = np.concatenate([own_time(track, a, b) for a, b in parts])
    p = np.concatenate([track.positions[a:b] for a, b in parts])
    root = np.sqrt(np.concatenate([weights_of(track)[a:b] for a, b in parts]))[:, None]
    solved = np.linalg.lstsq(root * np.column_stack([1 - u, u]), root * p, rcond=None)[0]
    return (solved[0], solved[1]) if u.any() else (solved[0], solved[0])


def pooled_cost(track, parts):
    line = pooled_line(track, parts)
    return sum(part_cost(track, a, b, *line) for a, b in parts)


def least_label(track, a, b, starts, ends):
    costs = [part_cost(track, a, b, *segment) for segment in zip(starts, ends, strict=True)]
    return min(costs), int(np.argmin(costs))


def best_cut(track, a, b, starts, ends, min_samples=1):
    """Cost, cut and labels of the best two parts of [a, b)."""
    best = (np.inf, -1, -1, -1)
    for c in range(a + min_samples, b - min_samples + 1):
        left, right = least_label(track, a, c, starts, ends), least_label(track, c, b, starts, ends)
        if left[0] + right[0] < best[0]:
            best = (left[0] + right[0], c, left[1], right[1])
    return best


def shifted(track, boundaries, labels, starts, ends, which):
    """Cut anew at the boundaries named, one after the other, where that lowers the cost."""
    boundaries, labels = list(boundaries), list(labels)
    for j in which:
        a, c, b = boundaries[j - 1 : j + 2]
        now = part_cost(track, a, c, starts[labels[j - 1]], ends[labels[j - 1]])
        now += part_cost(track, c, b, starts[labels[j]], ends[labels[j]])
        best, at, left, right = best_cut(track, a, b, starts, ends)
        if best < now:
            boundaries[j], labels[j - 1], labels[j] = at, left, right
    return boundaries, labels


def best_partition(track, starts, ends, k, min_samples=1):
    """Least cost of k parts over all partitions, by trying each."""
    n, best = len(track), np.inf
    for inner in combinations(range(1, n), k - 1):
        cuts = [0, *inner, n]
        if min(np.diff(cuts)) >= min_samples:
            best = min(
                best,
                sum(
                    least_label(track, a, b, starts, ends)[0]
                    for a, b in zip(cuts[:-1], cuts[1:], strict=True)
                ),
            )
    return best


def penalised_cost(track, starts, ends, penalty, min_samples=1, stride=1):
    """Least cost + penalty * parts, by dynamic programming without pruning."""
    cuts = [*range(0, len(track), stride), len(track)]
    total = {0: 0.0}
    for b in cuts[1:]:
        options = [
            total[a] + least_label(track, a, b, starts, ends)[0] + penalty
            for a in cuts
            if b - a >= min_samples
        ]
        total[b] = min(options, default=np.inf)
    return total[len(track)]


def synchronised_split(track, i, j):
    """Largest distance from the chord i to j at a sample's own time, and its sample."""
    share = (track.times[i : j + 1] - track.times[i]) / (track.times[j] - track.times[i])
    chord = track.positions[i] + share[:, None] * (track.positions[j] - track.positions[i])
    away = np.sqrt(((chord - track.positions[i : j + 1]) ** 2).sum(axis=1))[1:-1]
    return float(away.max()), i + 1 + int(away.argmax())


def douglas_peucker(track, k):
    """Boundaries of k parts, always splitting the chord with the largest distance."""
    knots = [0, len(track) - 1]
    while len(knots) - 1 < k:
        chords = [
            (*synchronised_split(track, i, j),)
            for i, j in zip(knots[:-1], knots[1:], strict=True)
            if j - i > 1
        ]
        knots = sorted([*knots, max(chords)[1]])
    return [*knots[:-1], len(track)]


def bottom_up(track, k, block):
    """Boundaries of k parts, always joining the neighbours whose common line costs least more."""
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
    """Groups of parts, as a set of frozen sets, always joining the two whose common line costs least more."""
    parts = list(zip(boundaries[:-1], boundaries[1:], strict=True))
    groups = [frozenset([j]) for j in range(len(parts))]
    while len(groups) > m:
        price = {
            (g, h): pooled_cost(track, [parts[j] for j in g | h])
            - pooled_cost(track, [parts[j] for j in g])
            - pooled_cost(track, [parts[j] for j in h])
            for g, h in combinations(groups, 2)
        }
        g, h = min(price, key=price.__getitem__)
        groups = [group for group in groups if group not in {g, h}] + [g | h]
    return set(groups)
