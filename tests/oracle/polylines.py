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


def far_from_segments(points, vertices):
    """Largest distance of a point from the segments between successive vertices."""
    start, chord = vertices[:-1], np.diff(vertices, axis=0)
    length = np.maximum((chord**2).sum(axis=1), 1e-300)
    farthest = 0.0
    for point in points:
        along = np.clip(((point - start) * chord).sum(axis=1) / length, 0, 1)
        nearest = np.linalg.norm(start + along[:, None] * chord - point, axis=1).min()
        farthest = max(farthest, float(nearest))
    return farthest
