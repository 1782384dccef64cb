"""Plain twins of the costs of segments: sums over samples, one by one, in floating point."""

import numpy as np


def segment_samples(ends, a, b):
    """Indices of the samples of slots [a, b)."""
    return range(int(ends[a]), int(ends[b]))


def line_cost(times, positions, weights, start, end, t0, t1):
    """Squared error of the line from ``start`` at t0 to ``end`` at t1."""
    share = ((times - t0) / (t1 - t0))[:, None]
    offsets = np.asarray(start) + share * (np.asarray(end) - np.asarray(start)) - positions
    return float((weights[:, None] * offsets**2).sum())


def best_line_cost(times, positions, weights):
    """Squared error of the least-squares line."""
    if len(times) == 0:
        return 0.0
    root = np.sqrt(weights)[:, None]
    design = np.column_stack([np.ones(len(times)), times - times.mean()])
    solution = np.linalg.lstsq(root * design, root * positions, rcond=None)[0]
    return float(((root * (design @ solution - positions)) ** 2).sum())
