"""Reference 1-segment coreset: sums over residuals."""

from __future__ import annotations

import numpy as np


def residuals(times, positions, start, end, t0, t1):
    share = (times - t0) / (t1 - t0) if t1 != t0 else np.zeros(len(times))
    return np.asarray(start) + share[:, None] * (np.asarray(end) - np.asarray(start)) - positions


def fitting_matrix(times, positions, weights, start, end, t0, t1):
    r = residuals(times, positions, start, end, t0, t1)
    return (weights[:, None] * r).T @ r


def best_line(times, positions, weights):
    """Positions of the least-squares line at the first and the last time."""
    root = np.sqrt(weights)[:, None]
    x = times - times.mean()
    design = np.column_stack([np.ones(len(x)), x])
    solved = np.linalg.lstsq(root * design, root * positions, rcond=None)[0]
    return solved[0] + x[0] * solved[1], solved[0] + x[-1] * solved[1]
