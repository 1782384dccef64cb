"""Reference coreset: costs in exact fractions, moments by sums, the best k-segment by search."""

from __future__ import annotations

from fractions import Fraction

import numpy as np


def exact_cost(times, positions, weights, pieces):
    """Fitting cost of a piecewise linear function, as an exact fraction."""
    exact = [Fraction(float(t)) for t in times]
    breaks = [Fraction(float(x)) for x in pieces.breaks]
    total = Fraction(0)
    for i, t in enumerate(exact):
        j = sum(1 for x in breaks if x <= t)
        start_time = Fraction(float(pieces.start_times[j]))
        end_time = Fraction(float(pieces.end_times[j]))
        for axis in range(positions.shape[1]):
            start = Fraction(float(pieces.starts[j, axis]))
            end = Fraction(float(pieces.ends[j, axis]))
            value = start
            if end_time > start_time:
                value += (end - start) * (t - start_time) / (end_time - start_time)
            residual = value - Fraction(float(positions[i, axis]))
            total += Fraction(float(weights[i])) * residual**2
    return total


def float_cost(times, positions, weights, pieces):
    """The same in floats, for many samples."""
    j = np.searchsorted(pieces.breaks, times, side="right")
    values = pieces.starts[j] + pieces.velocities[j] * (times - pieces.start_times[j])[:, None]
    return float((weights * ((values - positions) ** 2).sum(axis=1)).sum())


def free_cost(times, positions, weights):
    """Cost of samples against their best line, by least squares."""
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
    """2 d + 4 features of each sample, centred and scaled; their weighted sums are the moments."""
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
