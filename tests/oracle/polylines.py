"""Distances of polylines by their definitions, on dense points."""

import numpy as np


def discrete_frechet(p, q):
    """Smallest maximum along a path through the matrix of distances, by plain recurrence."""
    far = np.linalg.norm(p[:, None] - q[None], axis=2)
    best = np.full(far.shape, np.inf)
    for i in range(len(p)):
        for j in range(len(q)):
            before = [
                best[a, b] for a, b in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if a >= 0 <= b
            ]
            best[i, j] = max(far[i, j], min(before)) if before else far[i, j]
    return best[-1, -1]


def dense_hausdorff(p, q):
    far = np.linalg.norm(p[:, None] - q[None], axis=2)
    return max(far.min(axis=0).max(), far.min(axis=1).max())


def densify(vertices, parts):
    """Cut each segment in so many parts; return the points and the longest part."""
    if len(vertices) == 1:
        return vertices, 0.0
    where = np.linspace(0, len(vertices) - 1, parts * (len(vertices) - 1) + 1)
    points = np.stack([np.interp(where, np.arange(len(vertices)), c) for c in vertices.T], axis=1)
    return points, np.linalg.norm(np.diff(points, axis=0), axis=1).max()
