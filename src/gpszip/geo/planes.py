"""Metric planes for positions in degrees: transverse Mercator on WGS84, as many as the data needs.

One plane carries everything within :data:`PLANE_RADIUS` of its centre, where lengths are true to 0.2 %. Data that is wider lies on
several planes side by side in x, see :class:`gpszip.model.Plane`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError
from gpszip.model import Plane, Track
from gpszip.model.projection import (
    UNITS_PER_DEGREE,
    plane_indices,
    projection,
    to_geographic,
)

__all__ = [
    "PLANE_RADIUS",
    "choose_plane",
    "plane_changes",
    "plane_indices",
    "reproject_track",
    "to_geographic",
    "to_plane",
]

#: Distance in metres from a plane's centre within which positions lie on it.
PLANE_RADIUS = 400_000.0

_EARTH_RADIUS = 6_371_000.0

Floats = NDArray[np.float64]


def choose_plane(lat: ArrayLike, lon: ArrayLike) -> Plane:
    """Find planes on which all of the samples lie.

    Plane 0 is centred on the median of the samples, taken as directions from the earth's centre: one stray sample doesn't
    move it, and neither the poles nor the antimeridian are special. The first sample that is out of reach of every
    centre opens a plane of its own, and so on.

    Parameters
    ----------
    lat, lon : array_like, shape (n,)
        Degrees, finite, n >= 1.

    Returns
    -------
    Plane

    Examples
    --------
    >>> choose_plane([52.5, 52.5, 52.5], [13.3, 13.4, 13.5])
    Plane(centers=((525000000, 134000000),))
    >>> choose_plane([52.5, 52.5, -33.9], [13.4, 13.4, 151.2]).centers
    ((525000000, 134000000), (-339000000, 1512000000))
    """
    lat, lon = np.asarray(lat, dtype=np.float64), np.asarray(lon, dtype=np.float64)
    directions = _unit_vectors(lat, lon)
    centers = _median_center(directions)
    rest = np.flatnonzero(~_in_radius(directions, centers[0])) if centers else np.arange(len(lat))
    if centers and len(rest) == len(
        lat
    ):  # the middle of far-off clusters is nowhere near any of them
        centers = []
    while len(rest):
        centers.append(_round_center(lat[rest[0]], lon[rest[0]]))
        rest = rest[1:][~_in_radius(directions[rest[1:]], centers[-1])]
    return Plane(tuple(centers))


def to_plane(lat: ArrayLike, lon: ArrayLike, plane: Plane) -> Floats:
    """Project degrees to metres.

    A sample lies on the first plane within reach, or on the nearest one.

    Parameters
    ----------
    lat, lon : array_like, shape (n,)
        Degrees.
    plane : Plane
        Of :func:`choose_plane`.

    Returns
    -------
    float64 array, shape (n, 2)
        Metres to the east and north of the centre; on plane i moved by ``i * Plane.SPREAD`` in x.

    Examples
    --------
    >>> plane = choose_plane([0.0], [0.0])
    >>> to_plane([0.0, 0.001], [0.0, 0.0], plane).round(1).tolist()
    [[0.0, 0.0], [0.0, 110.6]]
    """
    lat, lon = np.asarray(lat, dtype=np.float64), np.asarray(lon, dtype=np.float64)
    positions = np.empty((len(lat), 2))
    if len(plane.centers) == 1:
        positions[:, 0], positions[:, 1] = projection(plane.centers[0]).transform(lon, lat)
        return positions
    index = _assign_planes(_unit_vectors(lat, lon), plane)
    for i in np.unique(index).tolist():
        here = index == i
        x, y = projection(plane.centers[i]).transform(lon[here], lat[here])
        positions[here, 0], positions[here, 1] = x + i * Plane.SPREAD, y
    return positions


def reproject_track(track: Track, plane: Plane) -> Track:
    """Lay a track in degrees on other planes than its own.

    Parameters
    ----------
    track : Track
        With a plane.
    plane : Plane
        The planes of a map, say.

    Returns
    -------
    Track
        The same instants and attributes.

    Raises
    ------
    OptionError
        If any sample lies out of reach of all the planes.

    Examples
    --------
    >>> berlin = choose_plane([52.5], [13.4])
    >>> track = Track("a", [0.0], to_plane([52.6], [13.5], berlin), plane=berlin)
    >>> moved = reproject_track(track, choose_plane([52.61], [13.5]))
    >>> [round(float(value[0]), 9) for value in to_geographic(moved.positions, moved.plane)]
    [52.6, 13.5]
    """
    if track.plane is None or track.plane == plane:
        return track
    lat, lon = to_geographic(track.positions, track.plane)
    directions = _unit_vectors(lat, lon)
    if not np.any([_in_radius(directions, center) for center in plane.centers], axis=0).all():
        raise OptionError(
            f"track {track.id!r} lies more than {PLANE_RADIUS / 1000:.0f} km from the map; give a map of the same place"
        )
    return replace(track, positions=to_plane(lat, lon, plane), plane=plane)


def plane_changes(positions: ArrayLike, plane: Plane | None) -> NDArray[np.bool_]:
    """Steps from one plane to another: no way on the planes leads along them, so they are gaps.

    Parameters
    ----------
    positions : array_like, shape (n, d)
        Metres.
    plane : Plane or None
        The planes; None for a log in x and y.

    Returns
    -------
    bool array, shape (n - 1,)

    Examples
    --------
    >>> plane_changes([[5.0, 0.0], [6.0, 0.0], [Plane.SPREAD, 0.0]], Plane(((0, 0), (0, 900000000)))).tolist()
    [False, True]
    """
    if plane is None or len(plane.centers) == 1:
        return np.zeros(max(len(np.asarray(positions)) - 1, 0), dtype=np.bool_)
    changed: NDArray[np.bool_] = np.diff(plane_indices(positions, plane)) != 0
    return changed


def _unit_vectors(lat: Floats, lon: Floats) -> Floats:
    north, east = np.radians(lat), np.radians(lon)
    flat = np.cos(north)
    return np.stack([flat * np.cos(east), flat * np.sin(east), np.sin(north)], axis=1)


def _round_center(lat: float, lon: float) -> tuple[int, int]:
    # hundredths of a degree take fewer bytes in an archive, and a plane a kilometre off is as good
    return round(float(lat) * 100) * int(UNITS_PER_DEGREE // 100), round(float(lon) * 100) * int(
        UNITS_PER_DEGREE // 100
    )


def _median_center(directions: Floats) -> list[tuple[int, int]]:
    x, y, z = np.median(directions, axis=0)
    if np.hypot(np.hypot(x, y), z) < 0.5:  # all over the globe: there is no middle
        return []
    return [_round_center(np.degrees(np.arctan2(z, np.hypot(x, y))), np.degrees(np.arctan2(y, x)))]


def _cosines(directions: Floats, center: tuple[int, int]) -> Floats:
    axis = _unit_vectors(
        np.array([center[0] / UNITS_PER_DEGREE]), np.array([center[1] / UNITS_PER_DEGREE])
    )[0]
    cosines: Floats = directions @ axis
    return cosines


def _in_radius(directions: Floats, center: tuple[int, int]) -> NDArray[np.bool_]:
    near: NDArray[np.bool_] = _cosines(directions, center) >= np.cos(PLANE_RADIUS / _EARTH_RADIUS)
    return near


def _assign_planes(directions: Floats, plane: Plane) -> NDArray[np.int64]:
    index = np.full(len(directions), -1, dtype=np.int64)
    for i, center in enumerate(plane.centers):
        open_ = np.flatnonzero(index < 0)
        index[open_[_in_radius(directions[open_], center)]] = i
    lost = np.flatnonzero(index < 0)
    if len(lost):
        index[lost] = np.argmax(
            np.stack([_cosines(directions[lost], center) for center in plane.centers]), axis=0
        )
    return index
