"""Carathéodory's theorem by elimination: few weighted samples with the moments of a block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.copying import copy_values
from gpszip.kernels.jit import inner, inner_uncounted, jit

__all__ = ["select_block_samples", "select_samples"]

#: A pivot up to this share of the largest one is rounding.
_PIVOT = 1e-13

#: Smallest extent and duration by which samples are scaled, for blocks that have none.
_MIN_SCALE = 1e-300


@inner_uncounted
def _features(t: float, p: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Write the features 1, t, t^2, |p|^2, p and t p of a sample."""
    d = len(p)
    out[0], out[1], out[2], out[3] = 1.0, t, t * t, 0.0
    for c in range(d):
        out[3] += p[c] * p[c]
        out[4 + c] = p[c]
        out[4 + d + c] = t * p[c]


@inner
def _null_vector(matrix: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Write a vector x != 0 with ``matrix @ x = 0``, by Gaussian elimination with full pivoting.

    The matrix has one column more than rows, and is overwritten.
    """
    # Columns are swapped too; order tells which variable each of them is.
    rows, columns = matrix.shape
    order = np.arange(columns)
    largest, rank = 0.0, 0
    for r in range(rows):
        # Largest entry of the remaining rows and columns.
        pivot, pivot_row, pivot_column = -1.0, r, r
        for i in range(r, rows):
            for j in range(r, columns):
                if abs(matrix[i, j]) > pivot:
                    pivot, pivot_row, pivot_column = abs(matrix[i, j]), i, j
        largest = max(largest, pivot)
        if pivot <= _PIVOT * largest:
            break

        # Move it to the diagonal.
        for j in range(columns):
            matrix[r, j], matrix[pivot_row, j] = matrix[pivot_row, j], matrix[r, j]
        for i in range(rows):
            matrix[i, r], matrix[i, pivot_column] = matrix[i, pivot_column], matrix[i, r]
        order[r], order[pivot_column] = order[pivot_column], order[r]

        # Eliminate the entries below it.
        for i in range(r + 1, rows):
            factor = matrix[i, r] / matrix[r, r]
            for j in range(r, columns):
                matrix[i, j] -= factor * matrix[r, j]
        rank += 1

    # Set the first free variable to 1, the others to 0, and substitute back.
    out[:] = 0.0
    out[order[rank]] = 1.0
    for r in range(rank - 1, -1, -1):
        value = matrix[r, rank]
        for j in range(r + 1, rank):
            value += matrix[r, j] * out[order[j]]
        out[order[r]] = -value / matrix[r, r]


@inner
def select_samples(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    weights: NDArray[np.float64],
    a: int,
    b: int,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose at most 2 d + 4 of samples a to b - 1, with positive weights that keep the moments.

    Samples are added one by one. When there are 2 d + 5, a null vector of their features says how
    to shift weight between them until one has none. Features are about the centre of the block
    and scaled by its extent, so that nothing is lost far from zero. Time (b - a) (2 d + 4)^3.

    Returns
    -------
    kept : int64 array
        Indices of the samples, sorted.
    kept_weights : float64 array
        Their new weights.
    """
    # Number of moments to keep, and so of samples that suffice.
    d = positions.shape[1]
    moments = 2 * d + 4

    # Centre and half extent of the block, in space and time.
    center, scale = np.empty(d), _MIN_SCALE
    for c in range(d):
        low = high = positions[a, c]
        for i in range(a + 1, b):
            low, high = min(low, positions[i, c]), max(high, positions[i, c])
        center[c] = low + (high - low) / 2
        scale = max(scale, (high - low) / 2)
    half_duration = (times[b - 1] - times[a]) / 2
    center_time, time_scale = times[a] + half_duration, max(half_duration, _MIN_SCALE)

    # Add samples; drop one whenever there are too many.
    kept, kept_weights = np.empty(moments + 1, np.int64), np.empty(moments + 1)
    columns, matrix = np.empty((moments, moments + 1)), np.empty((moments, moments + 1))
    shift, p = np.empty(moments + 1), np.empty(d)
    count = 0
    for i in range(a, b):
        for c in range(d):
            p[c] = (positions[i, c] - center[c]) / scale
        _features((times[i] - center_time) / time_scale, p, columns[:, count])
        kept[count], kept_weights[count] = i, weights[i]
        count += 1
        if count > moments:
            for row in range(moments):
                copy_values(columns[row], matrix[row])
            _null_vector(matrix, shift)
            count = _drop_one(kept, kept_weights, columns, shift, count)

    # Put the samples in order of time, by insertion.
    for q in range(1, count):
        place, index, weight = q, kept[q], kept_weights[q]
        while place > 0 and kept[place - 1] > index:
            kept[place], kept_weights[place] = kept[place - 1], kept_weights[place - 1]
            place -= 1
        kept[place], kept_weights[place] = index, weight
    return kept[:count], kept_weights[:count]


@inner
def _drop_one(
    kept: NDArray[np.int64],
    kept_weights: NDArray[np.float64],
    columns: NDArray[np.float64],
    shift: NDArray[np.float64],
    count: int,
) -> int:
    """Shift weight along the null vector until a sample has none; remove those without weight.

    Returns the number of samples that are left.
    """
    # The first sample whose weight reaches zero.
    ratio, emptied = np.inf, 0
    for q in range(count):
        if shift[q] > 0 and kept_weights[q] / shift[q] < ratio:
            ratio, emptied = kept_weights[q] / shift[q], q

    # Shift weight along the null vector, which leaves all moments as they are.
    for q in range(count):
        kept_weights[q] -= ratio * shift[q]
    kept_weights[emptied] = 0.0

    # Close the gaps.
    remaining = 0
    for q in range(count):
        if kept_weights[q] > 0:
            kept[remaining], kept_weights[remaining] = kept[q], kept_weights[q]
            copy_values(columns[:, q], columns[:, remaining])
            remaining += 1
    return remaining


@jit
def select_block_samples(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    weights: NDArray[np.float64],
    cuts: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose at most 2 d + 4 samples of each block between consecutive cuts.

    Returns
    -------
    kept : int64 array
        Indices of the samples, sorted.
    kept_weights : float64 array
        Their new weights.
    """
    capacity = min(len(times), (2 * positions.shape[1] + 4) * (len(cuts) - 1))
    kept, kept_weights = np.empty(capacity, np.int64), np.empty(capacity)
    count = 0
    for j in range(len(cuts) - 1):
        indices, new_weights = select_samples(times, positions, weights, cuts[j], cuts[j + 1])
        copy_values(indices, kept[count : count + len(indices)])
        copy_values(new_weights, kept_weights[count : count + len(indices)])
        count += len(indices)
    return kept[:count].copy(), kept_weights[:count].copy()
