"""Plain twins of the coreset: costs in exact fractions, moments by sums, the best k-segment by dynamic programming."""

from __future__ import annotations

from fractions import Fraction

import numpy as np


def exact_cost(times, positions, weights, pieces):
    """Fitting cost of pieces as a fraction: each sample against the line of the piece that its time falls in."""
    exact = [Fraction(float(t)) for t in times]
    breaks = [Fraction(float(x)) for x in pieces.breaks]
    total = Fraction(0)
    for i, t in enumerate(exact):
        j = sum(1 for x in breaks if x <= t)
        begin, end = Fraction(float(pieces.begins[j])), Fraction(float(pieces.ends[j]))
        for axis in range(positions.shape[1]):
            a, b = Fraction(float(pieces.starts[j, axis])), Fraction(float(pieces.stops[j, axis]))
            there = a + (b - a) * (t - begin) / (end - begin) if end > begin else a
            total += (
                Fraction(float(weights[i])) * (there - Fraction(float(positions[i, axis]))) ** 2
            )
    return total


def plain_cost(times, positions, weights, pieces):
    """The same in floats, for many samples."""
    j = np.searchsorted(pieces.breaks, times, side="right")
    there = pieces.starts[j] + pieces.speeds[j] * (times - pieces.begins[j])[:, None]
    return float((weights * ((there - positions) ** 2).sum(axis=1)).sum())


def free_cost(times, positions, weights):
    """Cost of samples against their own best line, by least squares."""
    if len(times) < 2:
        return 0.0
    root = np.sqrt(weights)[:, None]
    x = (times - times.mean()) / max(np.ptp(times), 1e-300)
    design = root * np.column_stack([np.ones(len(x)), x])
    centred = root * (positions - positions.mean(axis=0))
    solved = np.linalg.lstsq(design, centred, rcond=None)[0]
    return float(((design @ solved - centred) ** 2).sum())


def best_cost(times, positions, weights, k):
    """Least cost of any k-segment, O(k n^2) after n^2 line fits."""
    n = len(times)
    best = np.full((k + 1, n + 1), np.inf)
    best[0, 0] = 0
    fits = {
        (a, b): free_cost(times[a:b], positions[a:b], weights[a:b])
        for b in range(1, n + 1)
        for a in range(b)
    }
    for j in range(1, k + 1):
        for b in range(1, n + 1):
            best[j, b] = min(best[j - 1, a] + fits[a, b] for a in range(b))
    return float(best[:, n].min())


def moments(times, positions, weights):
    """The 2 d + 4 moments of each sample about the block's mean, and of its size; their weighted sums are the block's."""
    x = (times - times.mean()) / max(np.ptp(times), 1e-300)
    r = (positions - positions.mean(axis=0)) / max(np.ptp(positions, axis=0).max(), 1e-300)
    return np.column_stack([np.ones(len(x)), x, x * x, (r * r).sum(axis=1), r, x[:, None] * r])


def greedy_cuts(times, positions, weights, limit):
    """Balanced partition, one sample at a time."""
    cuts = [0]
    for b in range(1, len(times) + 1):
        if free_cost(times[cuts[-1] : b], positions[cuts[-1] : b], weights[cuts[-1] : b]) > limit:
            cuts.append(b - 1)
    return [*cuts, len(times)]
