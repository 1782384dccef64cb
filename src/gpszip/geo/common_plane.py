"""Reprojection of several logs, each on planes of its own, to planes that all share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import PLANE_RADIUS, plane_indices, to_geographic, to_plane
from gpszip.model import Plane

__all__ = ["max_scale_factor", "to_common_plane"]

#: Metres; mean radius of the earth.
_EARTH_RADIUS = 6_371_000.0

#: Share of the mean radius that bounds the radii of curvature of WGS84 from below (6,335 km).
_MIN_RADIUS_SHARE = 0.995

#: Units of a plane's centre in one degree.
_UNITS_PER_DEGREE = 1e7

Floats = NDArray[np.float64]


def to_common_plane(
    planes: Sequence[Plane], positions: Sequence[Floats], starts: Sequence[NDArray[np.int64]]
) -> tuple[Plane, list[Floats], list[NDArray[np.bool_]]]:
    """Choose common planes for several logs and reproject the logs to them.

    The planes of the largest log serve all pieces within their radius. A piece that none of them
    reaches brings its own plane. Each piece stays on one plane. A piece whose plane becomes one
    of the common planes is only shifted in x, by a multiple of ``Plane.SPREAD``.

    Parameters
    ----------
    planes : sequence of Plane
        The planes of each log.
    positions : sequence of float64 arrays, shape (n, 2)
        Metres on these planes.
    starts : sequence of int64 arrays
        First row of each piece of each log; the first one is 0.

    Returns
    -------
    plane : Plane
        The common planes.
    positions : list of float64 arrays, shape (n, 2)
        Metres on the common planes.
    moved : list of bool arrays, shape (n,)
        Positions that were projected to a plane with another centre.

    Examples
    --------
    >>> planes = [Plane(((525000000, 134000000),)), Plane(((526000000, 134000000),))]
    >>> starts = [np.zeros(1, np.int64)] * 2
    >>> positions = [np.zeros((2, 2)), np.zeros((1, 2))]
    >>> common, (first, second), _ = to_common_plane(planes, positions, starts)
    >>> common == planes[0], second.round().tolist()
    (True, [[0.0, 11128.0]])
    """
    # Largest log first; ties are broken by the centres, so that the order of logs doesn't matter.
    order = sorted(range(len(planes)), key=lambda i: (-len(positions[i]), planes[i].centers))
    centers = list(planes[order[0]].centers)
    chosen: dict[int, NDArray[np.int64]] = {}
    for i in order:
        chosen[i] = _choose_centers(planes[i], positions[i], starts[i], centers)

    # Reproject the logs in the order in which they were given.
    reprojected, moved = [], []
    for i, plane in enumerate(planes):
        piece_lengths = np.diff(np.append(starts[i], len(positions[i])))
        common_positions, has_moved = _reproject(
            plane, positions[i], np.repeat(chosen[i], piece_lengths), centers
        )
        reprojected.append(common_positions)
        moved.append(has_moved)
    return Plane(tuple(centers)), reprojected, moved


def max_scale_factor(positions: Floats, plane: Plane) -> float:
    """Return an upper bound on metres on the plane per metre on the ground.

    The scale factor of transverse Mercator is ``cosh(x / R)`` at distance x from the central
    meridian of a sphere with radius R.

    Parameters
    ----------
    positions : float64 array, shape (n, 2)
        Metres on the planes.
    plane : Plane
        The planes.
    """
    if not len(positions):
        return 1.0
    # Planes lie side by side in x: subtract the shift of each.
    x = positions[:, 0] - plane_indices(positions, plane) * Plane.SPREAD
    return float(np.cosh(np.abs(x).max() / (_MIN_RADIUS_SHARE * _EARTH_RADIUS)))


def _choose_centers(
    plane: Plane, positions: Floats, starts: NDArray[np.int64], centers: list[tuple[int, int]]
) -> NDArray[np.int64]:
    """Return the index of a centre for each piece; append centres that are missing.

    It is the first centre whose radius covers the entire piece.
    """
    # The first centre within whose radius all positions of a piece lie.
    degrees = np.stack(to_geographic(positions, plane), axis=1)
    chosen = np.full(len(starts), -1, np.int64)
    for index, center in enumerate(centers):
        is_covered = np.logical_and.reduceat(
            _great_circle_distances(degrees, center) <= PLANE_RADIUS, starts
        )
        chosen[(chosen < 0) & is_covered] = index

    # Pieces that no centre covers bring the centre of their own plane.
    current = plane_indices(positions[starts], plane)
    for piece in np.flatnonzero(chosen < 0).tolist():
        center = plane.centers[current[piece]]
        if center not in centers:
            centers.append(center)
        chosen[piece] = centers.index(center)
    return chosen


def _reproject(
    plane: Plane, positions: Floats, chosen: NDArray[np.int64], centers: list[tuple[int, int]]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Bring each position to its chosen centre; return the positions, and which were projected."""
    current = plane_indices(positions, plane)
    reprojected = positions.copy()
    moved = np.zeros(len(positions), np.bool_)
    for old, new in sorted(set(zip(current.tolist(), chosen.tolist(), strict=True))):
        rows = (current == old) & (chosen == new)
        if plane.centers[old] == centers[new]:
            # The same plane with another index: no projection, hence no rounding.
            reprojected[rows, 0] += (new - old) * Plane.SPREAD
        else:
            lat, lon = to_geographic(positions[rows], plane)
            reprojected[rows] = to_plane(lat, lon, Plane((centers[new],)))
            reprojected[rows, 0] += new * Plane.SPREAD
            moved |= rows
    return reprojected, moved


def _great_circle_distances(degrees: Floats, center: tuple[int, int]) -> Floats:
    """Return the metres from each latitude and longitude to a centre (haversine formula)."""
    lat, lon = np.radians(degrees).T
    center_lat = np.radians(center[0] / _UNITS_PER_DEGREE)
    center_lon = np.radians(center[1] / _UNITS_PER_DEGREE)
    haversine = (
        np.sin((lat - center_lat) / 2) ** 2
        + np.cos(lat) * np.cos(center_lat) * np.sin((lon - center_lon) / 2) ** 2
    )
    # Rounding may lift the haversine of opposite points above 1.
    distances: Floats = 2 * _EARTH_RADIUS * np.arcsin(np.sqrt(np.minimum(haversine, 1.0)))
    return distances
