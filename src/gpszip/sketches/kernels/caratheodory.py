"""Few samples of a block, with new weights, that have the same moments: Carathéodory's theorem, made by elimination."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["select_block_samples", "select_samples"]

#: Share of the largest entry below which a pivot is rounding.
_PIVOT = 1e-13


@jit
def _features(t: float, p: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """1, t, t^2, |p|^2, p and t p."""
    d = len(p)
    out[0], out[1], out[2], out[3] = 1.0, t, t * t, 0.0
    for c in range(d):
        out[3] += p[c] * p[c]
        out[4 + c] = p[c]
        out[4 + d + c] = t * p[c]


@jit
def _null_vector(matrix: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Weights of the columns that sum up to zero; there is one column more than rows. The matrix is overwritten."""
    rows, columns = matrix.shape
    order = np.arange(columns)
    largest, rank = 0.0, 0
    for r in range(rows):
        best, at, along = -1.0, r, r
        for i in range(r, rows):
            for j in range(r, columns):
                if abs(matrix[i, j]) > best:
                    best, at, along = abs(matrix[i, j]), i, j
        largest = max(largest, best)
        if best <= _PIVOT * largest:
            break
        for j in range(columns):
            matrix[r, j], matrix[at, j] = matrix[at, j], matrix[r, j]
        for i in range(rows):
            matrix[i, r], matrix[i, along] = matrix[i, along], matrix[i, r]
        order[r], order[along] = order[along], order[r]
        for i in range(r + 1, rows):
            factor = matrix[i, r] / matrix[r, r]
            for j in range(r, columns):
                matrix[i, j] -= factor * matrix[r, j]
        rank += 1
    out[:] = 0.0
    out[order[rank]] = 1.0
    for r in range(rank - 1, -1, -1):
        value = matrix[r, rank]
        for j in range(r + 1, rank):
            value += matrix[r, j] * out[order[j]]
        out[order[r]] = -value / matrix[r, r]


@jit
def select_samples(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    weights: NDArray[np.float64],
    a: int,
    b: int,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose at most 2 d + 4 of the samples a to b - 1, and positive weights, that have the same 2 d + 4 moments.

    Samples come in one by one. When there is one too many, the null vector of their features tells how to shift weight
    until one of them has none left. Features are about the block's middle and of its size, so that nothing is lost far
    from zero. Time (b - a) (2 d + 4)^3.
    """
    d = places.shape[1]
    r = 2 * d + 4
    middle, size = np.empty(d), 1e-300
    for c in range(d):
        low, high = places[a:b, c].min(), places[a:b, c].max()
        middle[c] = low + (high - low) / 2
        size = max(size, (high - low) / 2)
    start, half = (
        times[a] + (times[b - 1] - times[a]) / 2,
        max((times[b - 1] - times[a]) / 2, 1e-300),
    )
    kept, weight = np.empty(r + 1, np.int64), np.empty(r + 1)
    columns, matrix, shift = np.empty((r, r + 1)), np.empty((r, r + 1)), np.empty(r + 1)
    count = 0
    for i in range(a, b):
        _features((times[i] - start) / half, (places[i] - middle) / size, columns[:, count])
        kept[count], weight[count] = i, weights[i]
        count += 1
        if count > r:
            matrix[:] = columns
            _null_vector(matrix, shift)
            count = _drop_one(kept, weight, columns, shift, count)
    order = np.argsort(kept[:count])
    return kept[:count][order], weight[:count][order]


@jit
def _drop_one(
    kept: NDArray[np.int64],
    weight: NDArray[np.float64],
    columns: NDArray[np.float64],
    shift: NDArray[np.float64],
    count: int,
) -> int:
    """Move weight along the null vector until one sample has none; samples with none go."""
    least, out = np.inf, 0
    for q in range(count):
        if shift[q] > 0 and weight[q] / shift[q] < least:
            least, out = weight[q] / shift[q], q
    for q in range(count):
        weight[q] -= least * shift[q]
    weight[out] = 0.0
    at = 0
    for q in range(count):
        if weight[q] > 0:
            kept[at], weight[at] = kept[q], weight[q]
            columns[:, at] = columns[:, q]
            at += 1
    return at


@jit
def select_block_samples(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    weights: NDArray[np.float64],
    cuts: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose at most 2 d + 4 samples of each block between cuts."""
    most = min(len(times), (2 * places.shape[1] + 4) * (len(cuts) - 1))
    kept, weight = np.empty(most, np.int64), np.empty(most)
    count = 0
    for j in range(len(cuts) - 1):
        some, new = select_samples(times, places, weights, cuts[j], cuts[j + 1])
        kept[count : count + len(some)] = some
        weight[count : count + len(some)] = new
        count += len(some)
    return kept[:count].copy(), weight[:count].copy()
