"""Distances along shapes, which are tracks without times."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gpszip.io.logs.rows import Flags, Floats
from gpszip.model.read_result import Repair

__all__ = ["ShapePoints", "measure_points", "repeated_points_repair"]


class ShapePoints(NamedTuple):
    """Points of a shape.

    Parameters
    ----------
    distances : float64 array, shape (n,)
        Metres along the shape.
    moves : bool array, shape (n,)
        Which points are farther along than the point before, so that the shape keeps them.
    """

    distances: Floats
    moves: Flags


def measure_points(positions: Floats, before: tuple[Floats, float] | None = None) -> ShapePoints:
    """Measure how far along a shape its points are.

    Parameters
    ----------
    positions : float64 array, shape (n, d)
        Metres on a plane.
    before : (float64 array of shape (d,), float), optional
        Position and distance of the point before, if the shape began in an earlier block. The
        result doesn't depend on where blocks end.

    Examples
    --------
    >>> points = measure_points(np.array([[0.0], [3.0], [3.0]]))
    >>> points.distances.tolist(), points.moves.tolist()
    ([0.0, 3.0, 3.0], [True, True, False])
    """
    # Add up the steps in the order of travel.
    position, distance = (positions[0], 0.0) if before is None else before
    steps = np.sqrt((np.diff(positions, axis=0, prepend=position[np.newaxis]) ** 2).sum(axis=1))
    distances = np.cumsum(np.append(distance, steps))

    # The first point of a shape repeats none.
    moves = np.diff(distances) > 0
    moves[0] |= before is None
    return ShapePoints(distances[1:], moves)


def repeated_points_repair(count: int, where: str, track: str) -> Repair:
    """Return the repair for points that don't move along their shape."""
    what = "points that repeat the one before, of a track without times, dropped"
    return Repair(what, count, f"{where}: track {track!r}")
