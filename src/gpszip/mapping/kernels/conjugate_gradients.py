"""The M-step's equations of many nodes, solved step by step from positions that are near."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit

__all__ = ["improve_positions"]


@inner_uncounted
def _row_product(
    offsets: NDArray[np.int32],
    columns: NDArray[np.int32],
    values: NDArray[np.float64],
    row: int,
    vector: NDArray[np.float64],
) -> float:
    """Scalar product of a row of the matrix with a vector."""
    total = 0.0
    for i in range(offsets[row], offsets[row + 1]):
        total += values[i] * vector[columns[i]]
    return total


@inner_uncounted
def _improve_axis(
    offsets: NDArray[np.int32],
    columns: NDArray[np.int32],
    values: NDArray[np.float64],
    diagonal: NDArray[np.float64],
    right: NDArray[np.float64],
    x: NDArray[np.float64],
    residual: NDArray[np.float64],
    direction: NDArray[np.float64],
    product: NDArray[np.float64],
    tolerance: float,
    max_steps: int,
) -> None:
    """Take the steps of :func:`improve_positions` on one axis; three arrays are scratch space."""
    # The first direction is the residual by the diagonal.
    square, largest = 0.0, 0.0
    for v in range(len(x)):
        residual[v] = right[v] - _row_product(offsets, columns, values, v, x)
        direction[v] = residual[v] / diagonal[v]
        square += residual[v] * direction[v]
        largest = max(largest, abs(direction[v]))

    for _ in range(max_steps):
        if largest <= tolerance:
            return

        # The step that is best along this direction.
        curvature = 0.0
        for v in range(len(x)):
            product[v] = _row_product(offsets, columns, values, v, direction)
            curvature += product[v] * direction[v]
        length = square / curvature

        # Go there; the next direction is conjugate to all before.
        last_square, square, largest = square, 0.0, 0.0
        for v in range(len(x)):
            x[v] += length * direction[v]
            residual[v] -= length * product[v]
            square += residual[v] * residual[v] / diagonal[v]
            largest = max(largest, abs(residual[v] / diagonal[v]))
        for v in range(len(x)):
            direction[v] = residual[v] / diagonal[v] + square / last_square * direction[v]


@jit
def improve_positions(
    offsets: NDArray[np.int32],
    columns: NDArray[np.int32],
    values: NDArray[np.float64],
    right: NDArray[np.float64],
    positions: NDArray[np.float64],
    tolerance: float,
    max_steps: int,
) -> None:
    """Bring positions x near to the solution of K x = r, in place.

    Conjugate gradients (M. R. Hestenes, E. Stiefel, 1952), preconditioned by the diagonal D of K.
    With z = D^-1 (r - K x), the directions p and steps a are::

        a = r'z / p'Kp;  x += a p;  r -= a K p;  p = z' + (r''z' / r'z) p

    Parameters
    ----------
    offsets, columns, values : arrays
        The symmetric positive definite matrix K in CSR form.
    right : float64 array, shape (V, d)
        The right-hand side r.
    positions : float64 array, shape (V, d)
        Positions from which to begin, in grid steps.
    tolerance : float
        Ends where no node would move farther than this alone, in grid steps.
    max_steps : int
        Largest number of steps on each axis.
    """
    # The diagonal; a matrix may hold a sum in several parts.
    nodes = len(positions)
    diagonal = np.zeros(nodes)
    for v in range(nodes):
        for i in range(offsets[v], offsets[v + 1]):
            diagonal[v] += values[i] if columns[i] == v else 0.0

    # Axis by axis.
    residual, direction, product = np.empty(nodes), np.empty(nodes), np.empty(nodes)
    for axis in range(positions.shape[1]):
        x = positions[:, axis].copy()
        _improve_axis(
            offsets,
            columns,
            values,
            diagonal,
            right[:, axis].copy(),
            x,
            residual,
            direction,
            product,
            tolerance,
            max_steps,
        )
        positions[:, axis] = x
