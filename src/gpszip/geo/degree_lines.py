"""Lines in degrees for map exports, cut where they cross the antimeridian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.antimeridian import align_antimeridian_signs, find_crossings, insert_crossings
from gpszip.geo.linear_in_degrees import densify_for_degrees
from gpszip.model import Plane

__all__ = ["DegreeLines", "cut_at_antimeridian", "lines_in_degrees"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Decimals of the position along a line, in units of a step between two points.
_SHARE_DECIMALS = 9


@dataclass(frozen=True, eq=False)
class DegreeLines:
    """Lines in degrees.

    Parameters
    ----------
    points : float64 array, shape (n, 2)
        Longitude and latitude.
    offsets : int64 array, shape (L + 1,)
        Line i has the points ``points[offsets[i]:offsets[i + 1]]``.
    cuts : int64 array, shape (c,)
        Sorted indices of points at which a line continues on the other side of the antimeridian.
    """

    points: Floats
    offsets: Ints
    cuts: Ints


def lines_in_degrees(
    positions: Floats, offsets: Ints, plane: Plane, max_deviation: float, *, decimals: int
) -> DegreeLines:
    """Convert lines on a plane to degrees, with extra points where they would deviate.

    Parameters
    ----------
    positions : float64 array, shape (n, 2)
        Metres.
    offsets : int64 array, shape (L + 1,)
        Line i has the points ``positions[offsets[i]:offsets[i + 1]]``, at least one.
    plane : Plane
        The planes of the positions.
    max_deviation : float
        Metres by which the lines may deviate.
    decimals : int
        Decimals to which degrees are rounded.

    Returns
    -------
    DegreeLines

    Examples
    --------
    >>> plane = Plane(((0, 1800000000),))
    >>> positions = np.array([[-111.32, 0.0], [111.32, 0.0]])
    >>> lines = lines_in_degrees(positions, np.array([0, 2]), plane, 0.1, decimals=5)
    >>> lines.points.tolist(), lines.cuts.tolist()
    ([[179.999, 0.0], [180.0, 0.0], [-180.0, 0.0], [-179.999, 0.0]], [2])
    """
    # The step from the end of a line to the start of the next one belongs to none.
    skipped = np.zeros(max(len(positions) - 1, 0), np.bool_)
    skipped[offsets[1:-1] - 1] = True

    # The point numbers serve as times; points in between get fractions.
    numbers = np.arange(len(positions), dtype=np.float64)
    numbers, lat, lon = densify_for_degrees(
        numbers,
        positions,
        plane,
        max_deviation,
        decimals=decimals,
        time_decimals=_SHARE_DECIMALS,
        skipped=skipped,
    )
    return cut_at_antimeridian(
        np.stack([lon, lat], axis=1), np.searchsorted(numbers, offsets), decimals=decimals
    )


def cut_at_antimeridian(points: Floats, offsets: Ints, *, decimals: int) -> DegreeLines:
    """Cut lines in degrees where they cross the antimeridian.

    Parameters
    ----------
    points : float64 array, shape (n, 2)
        Longitude and latitude.
    offsets : int64 array, shape (L + 1,)
        Line i has the points ``points[offsets[i]:offsets[i + 1]]``.
    decimals : int
        Decimals to which degrees are rounded.

    Returns
    -------
    DegreeLines

    Examples
    --------
    >>> points = np.array([[179.0, 1.0], [-179.0, 2.0]])
    >>> cut_at_antimeridian(points, np.array([0, 2]), decimals=8).points.tolist()
    [[179.0, 1.0], [180.0, 1.5], [-180.0, 1.5], [-179.0, 2.0]]
    """
    # Points on the antimeridian or behind a crossing; mostly there are none.
    is_special = np.abs(points[:, 0]) == 180.0
    is_special[1:] |= find_crossings(points[:, 0])
    if not is_special.any():
        return DegreeLines(points, offsets, np.empty(0, np.int64))

    # Cut each line that has such points; copy the points in between unchanged.
    affected = np.unique(np.searchsorted(offsets, np.flatnonzero(is_special), side="right") - 1)
    blocks, cuts = [], [np.empty(0, np.int64)]
    lengths = np.diff(offsets)
    copied = inserted = 0
    for line in affected.tolist():
        start, end = offsets[line], offsets[line + 1]
        new_points, new_cuts = _cut_line(points[start:end], decimals)
        blocks += [points[copied:start], new_points]
        cuts.append(new_cuts + start + inserted)
        lengths[line], copied = len(new_points), end
        inserted += len(new_points) - (end - start)
    blocks.append(points[copied:])
    return DegreeLines(
        np.concatenate(blocks), np.append(0, np.cumsum(lengths)), np.concatenate(cuts)
    )


def _cut_line(line: Floats, decimals: int) -> tuple[Floats, Ints]:
    """Return a line with points at its crossings, and where it continues on the other side."""
    lon = align_antimeridian_signs(line[:, 0])
    numbers = np.arange(len(line), dtype=np.float64)
    _, lat, lon = insert_crossings(numbers, line[:, 1], lon, 0.0)

    # Adding 0 turns -0.0 into 0.0.
    points = np.stack([lon, np.round(lat, decimals) + 0.0], axis=1)
    return points, np.flatnonzero(find_crossings(lon)) + 1
