"""Positions on the planes of several logs, laid on planes that all of them share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import PLANE_RADIUS, plane_indices, to_geographic, to_plane
from gpszip.model import Plane

__all__ = ["max_scale_factor", "to_common_plane"]

_EARTH_RADIUS = 6_371_000.0

Floats = NDArray[np.float64]


def to_common_plane(
    planes: Sequence[Plane], positions: Sequence[Floats], starts: Sequence[NDArray[np.int64]]
) -> tuple[Plane, list[Floats], list[NDArray[np.bool_]]]:
    """Choose planes for several logs and lay them there; each piece stays on one plane.

    The planes of the largest log serve all pieces within reach; others bring their own. What stays on its plane is not changed
    but by the distance between planes.

    Parameters
    ----------
    planes : sequence of Plane
        One for each log.
    positions : sequence of float64 arrays, shape (n, 2)
        Metres on these planes.
    starts : sequence of int64 arrays
        First row of each piece of each log; the first is 0.

    Returns
    -------
    plane : Plane
    positions : list of float64 arrays, shape (n, 2)
    moved : list of bool arrays, shape (n,)
        Whether a position lies on another plane than before.

    Examples
    --------
    >>> here, there = Plane(((525000000, 134000000),)), Plane(((526000000, 134000000),))
    >>> none = np.zeros(1, np.int64)
    >>> plane, (one, two), _ = to_common_plane([here, there], [np.zeros((2, 2)), np.zeros((1, 2))], [none, none])
    >>> plane == here, two.round().tolist()
    (True, [[0.0, 11128.0]])
    """
    order = sorted(range(len(planes)), key=lambda i: (-len(positions[i]), planes[i].centers))
    centers = list(planes[order[0]].centers)
    chosen: dict[int, NDArray[np.int64]] = {}
    for i in order:
        chosen[i] = _choose_centers(planes[i], positions[i], starts[i], centers)
    laid, moved = [], []
    for i, plane in enumerate(planes):
        out, changed = _reproject(
            plane,
            positions[i],
            np.repeat(chosen[i], np.diff(np.append(starts[i], len(positions[i])))),
            centers,
        )
        laid.append(out)
        moved.append(changed)
    return Plane(tuple(centers)), laid, moved


def max_scale_factor(positions: Floats, plane: Plane) -> float:
    """How many metres of the plane one metre on the ground takes at most."""
    if not len(positions):
        return 1.0
    east = positions[:, 0] - plane_indices(positions, plane) * Plane.SPREAD
    return float(np.cosh(np.abs(east).max() / (0.995 * _EARTH_RADIUS)))


def _choose_centers(
    plane: Plane, positions: Floats, starts: NDArray[np.int64], centers: list[tuple[int, int]]
) -> NDArray[np.int64]:
    """The first centre within reach of all of each piece; centres that are lacking are added."""
    ground = np.stack(to_geographic(positions, plane), axis=1)
    chosen = np.full(len(starts), -1, np.int64)
    for number, center in enumerate(centers):
        near = np.logical_and.reduceat(
            _great_circle_distances(ground, center) <= PLANE_RADIUS, starts
        )
        chosen[(chosen < 0) & near] = number
    own = plane_indices(positions[starts], plane)
    for piece in np.flatnonzero(chosen < 0).tolist():
        center = plane.centers[own[piece]]
        if center not in centers:
            centers.append(center)
        chosen[piece] = centers.index(center)
    return chosen


def _reproject(
    plane: Plane, positions: Floats, number: NDArray[np.int64], centers: list[tuple[int, int]]
) -> tuple[Floats, NDArray[np.bool_]]:
    own, out = plane_indices(positions, plane), positions.copy()
    moved = np.zeros(len(positions), np.bool_)
    for old, new in sorted(set(zip(own.tolist(), number.tolist(), strict=True))):
        rows = (own == old) & (number == new)
        if plane.centers[old] == centers[new]:
            out[rows, 0] += (new - old) * Plane.SPREAD
        else:
            out[rows] = to_plane(*to_geographic(positions[rows], plane), Plane((centers[new],)))
            out[rows, 0] += new * Plane.SPREAD
            moved |= rows
    return out, moved


def _great_circle_distances(ground: Floats, center: tuple[int, int]) -> Floats:
    """Metres from a centre along the earth."""
    lat, lon = np.radians(ground).T
    north, east = np.radians(center[0] / 1e7), np.radians(center[1] / 1e7)
    half = (
        np.sin((lat - north) / 2) ** 2 + np.cos(lat) * np.cos(north) * np.sin((lon - east) / 2) ** 2
    )
    distances: Floats = 2 * _EARTH_RADIUS * np.arcsin(np.sqrt(np.minimum(half, 1.0)))
    return distances
