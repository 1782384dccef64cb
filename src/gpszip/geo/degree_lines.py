"""Many lines on a plane as lines in degrees, which are cut where they cross the antimeridian."""

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

#: Decimals of the shares of a step between two points.
_SHARE_DECIMALS = 9


@dataclass(frozen=True, eq=False)
class DegreeLines:
    """Lines in degrees.

    Parameters
    ----------
    points : float64 array, shape (n, 2)
        Longitude and latitude.
    offsets : int64 array, shape (L + 1,)
        Line i runs through ``points[offsets[i]:offsets[i + 1]]``.
    cuts : int64 array, shape (c,)
        Sorted indices into ``points`` at which a line begins anew, on the other side of the antimeridian.
    """

    points: Floats
    offsets: Ints
    cuts: Ints


def lines_in_degrees(
    positions: Floats, offsets: Ints, plane: Plane, max_deviation: float, *, decimals: int
) -> DegreeLines:
    """Lay lines on a plane in degrees, with as many more points as they need to stay where they are.

    Parameters
    ----------
    positions : float64 array, shape (n, 2)
        Metres.
    offsets : int64 array, shape (L + 1,)
        Line i runs through ``positions[offsets[i]:offsets[i + 1]]``, which are one point or more.
    plane : Plane
        Where they lie on the earth.
    max_deviation : float
        Metres by which the lines may deviate.
    decimals : int
        To which degrees are rounded.

    Returns
    -------
    DegreeLines

    Examples
    --------
    >>> plane = Plane(((0, 1800000000),))
    >>> lines = lines_in_degrees(np.array([[-111.32, 0.0], [111.32, 0.0]]), np.array([0, 2]), plane, 0.1, decimals=5)
    >>> lines.points.tolist(), lines.cuts.tolist()
    ([[179.999, 0.0], [180.0, 0.0], [-180.0, 0.0], [-179.999, 0.0]], [2])
    """
    skipped = np.zeros(max(len(positions) - 1, 0), np.bool_)
    skipped[offsets[1:-1] - 1] = True

    # points are numbered, and those between two of them have numbers with a fraction
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
        Line i runs through ``points[offsets[i]:offsets[i + 1]]``.
    decimals : int
        To which degrees are rounded.

    Returns
    -------
    DegreeLines

    Examples
    --------
    >>> cut_at_antimeridian(np.array([[179.0, 1.0], [-179.0, 2.0]]), np.array([0, 2]), decimals=8).points.tolist()
    [[179.0, 1.0], [180.0, 1.5], [-180.0, 1.5], [-179.0, 2.0]]
    """
    special = np.abs(points[:, 0]) == 180.0
    special[1:] |= find_crossings(points[:, 0])
    if not special.any():
        return DegreeLines(points, offsets, np.empty(0, np.int64))

    # only few lines are near the antimeridian: each is cut by itself
    near = np.unique(np.searchsorted(offsets, np.flatnonzero(special), side="right") - 1)
    pieces, cuts, lengths, done, added = [], [np.empty(0, np.int64)], np.diff(offsets), 0, 0
    for line in near.tolist():
        first, after = offsets[line], offsets[line + 1]
        whole, own = _cut_line(points[first:after], decimals)
        pieces += [points[done:first], whole]
        cuts.append(own + first + added)
        lengths[line], done = len(whole), after
        added += len(whole) - (after - first)
    pieces.append(points[done:])
    return DegreeLines(
        np.concatenate(pieces), np.append(0, np.cumsum(lengths)), np.concatenate(cuts)
    )


def _cut_line(line: Floats, decimals: int) -> tuple[Floats, Ints]:
    """A line with points at its crossings, and where it begins anew."""
    lon = align_antimeridian_signs(line[:, 0])
    _, lat, lon = insert_crossings(np.arange(len(line), dtype=np.float64), line[:, 1], lon, 0.0)
    return np.stack([lon, np.round(lat, decimals) + 0.0], axis=1), np.flatnonzero(
        find_crossings(lon)
    ) + 1
