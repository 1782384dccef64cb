"""Projection of latitude and longitude to metric planes: transverse Mercator on WGS84.

A plane holds positions within :data:`PLANE_RADIUS` of its centre, where lengths are true to 0.2 %.
Data that extends farther lies on several planes side by side in x, see
:class:`gpszip.model.Plane`.
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
    project,
    to_geographic,
)

__all__ = [
    "PLANE_RADIUS",
    "choose_plane",
    "plane_changes",
    "plane_indices",
    "reproject_positions",
    "reproject_track",
    "to_geographic",
    "to_plane",
]

#: Metres from a plane's centre within which positions lie on it.
PLANE_RADIUS = 400_000.0

#: Metres; mean radius of the earth.
_EARTH_RADIUS = 6_371_000.0

#: Centres are rounded to this fraction of a degree: they take fewer bytes in an archive, and a
#: centre that is a kilometre off serves as well.
_CENTERS_PER_DEGREE = 100

#: A median direction shorter than this belongs to samples all over the globe, without a middle.
_MIN_MEDIAN_LENGTH = 0.5

#: Samples from which on the centre is first sought in single precision.
_MIN_ROUGH_SAMPLES = 10_000

#: Errors of single precision at most: degrees of a median direction, and cosines. Directions are
#: good to 5e-7 each; longitudes of directions near a pole are not, nor are short medians.
_ROUGH_DEGREES = 5e-4
_ROUGH_COSINE = 1e-5
_MIN_ROUGH_EQUATORIAL = 0.1
_MIN_ROUGH_LENGTH = 0.6

Floats = NDArray[np.float64]


def choose_plane(lat: ArrayLike, lon: ArrayLike) -> Plane:
    """Choose planes that cover all samples.

    Plane 0 is centred on the median of the samples, as unit vectors from the earth's centre: a
    single distant sample doesn't move it, and poles and antimeridian need no special case. The
    first sample outside the radius of all planes becomes the centre of the next one, until all
    samples are covered.

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
    rough = _choose_roughly(lat, lon)
    if rough is not None:
        return Plane((rough,))

    # Directions from the earth's centre as unit vectors.
    directions = _unit_vectors(lat, lon)
    uncovered = np.arange(len(lat))
    centers = []

    # Plane 0; the median of distant clusters may be near none of them and is dropped then.
    median = _median_center(directions)
    if median is not None:
        outside = np.flatnonzero(~_in_radius(directions, median))
        if len(outside) < len(lat):
            centers, uncovered = [median], outside

    # Further planes.
    while len(uncovered):
        centers.append(_round_center(lat[uncovered[0]], lon[uncovered[0]]))
        uncovered = uncovered[1:][~_in_radius(directions[uncovered[1:]], centers[-1])]
    return Plane(tuple(centers))


def to_plane(lat: ArrayLike, lon: ArrayLike, plane: Plane) -> Floats:
    """Project latitude and longitude to metres.

    A sample lies on the first plane within whose radius it is, or else on the nearest one.

    Parameters
    ----------
    lat, lon : array_like, shape (n,)
        Degrees.
    plane : Plane
        The planes, see :func:`choose_plane`.

    Returns
    -------
    float64 array, shape (n, 2)
        Metres to the east and north of the centre; on plane i shifted by ``i * Plane.SPREAD`` in
        x.

    Examples
    --------
    >>> plane = choose_plane([0.0], [0.0])
    >>> to_plane([0.0, 0.001], [0.0, 0.0], plane).round(1).tolist()
    [[0.0, 0.0], [0.0, 110.6]]
    """
    lat, lon = np.asarray(lat, dtype=np.float64), np.asarray(lon, dtype=np.float64)
    positions = np.empty((len(lat), 2))
    if len(plane.centers) == 1:
        positions[:, 0], positions[:, 1] = project(lat, lon, plane.centers[0])
        return positions

    # Several planes, side by side in x.
    assigned = _assign_planes(_unit_vectors(lat, lon), plane)
    for i in np.unique(assigned).tolist():
        is_on = assigned == i
        x, y = project(lat[is_on], lon[is_on], plane.centers[i])
        positions[is_on, 0], positions[is_on, 1] = x + i * Plane.SPREAD, y
    return positions


def reproject_track(track: Track, plane: Plane) -> Track:
    """Reproject a track to other planes.

    Parameters
    ----------
    track : Track
        A track; one without planes is returned unchanged.
    plane : Plane
        The new planes, such as those of a map.

    Returns
    -------
    Track
        The same times and attributes.

    Raises
    ------
    OptionError
        If a sample lies outside the radius of all planes.

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
    positions = reproject_positions(track.positions, track.plane, plane, f"track {track.id!r}")
    return replace(track, positions=positions, plane=plane)


def reproject_positions(positions: ArrayLike, own: Plane, plane: Plane, name: str) -> Floats:
    """Reproject positions to other planes.

    Parameters
    ----------
    positions : array_like, shape (n, 2)
        Metres on the planes ``own``.
    own, plane : Plane
        Their planes, and the new ones.
    name : str
        What they belong to, for the error.

    Returns
    -------
    float64 array, shape (n, 2)
        Metres on the planes ``plane``.

    Raises
    ------
    OptionError
        If a position lies outside the radius of all planes.

    Examples
    --------
    >>> here, east = Plane(((0, 0),)), Plane(((0, 10_000_000),))
    >>> reproject_positions(np.zeros((1, 2)), here, east, "the log").round().tolist()
    [[-111325.0, 0.0]]
    """
    if own == plane:
        return np.asarray(positions, np.float64)

    # All positions must be covered.
    lat, lon = to_geographic(positions, own)
    directions = _unit_vectors(lat, lon)
    if not np.any([_in_radius(directions, center) for center in plane.centers], axis=0).all():
        raise OptionError(
            f"{name} lies more than {PLANE_RADIUS / 1000:.0f} km from the map",
            remedy="give a map of the same place",
        )
    return to_plane(lat, lon, plane)


def plane_changes(positions: ArrayLike, plane: Plane | None) -> NDArray[np.bool_]:
    """Find steps from one plane to another: the path is unknown there, so they are gaps.

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
    >>> planes = Plane(((0, 0), (0, 900000000)))
    >>> plane_changes([[5.0, 0.0], [6.0, 0.0], [Plane.SPREAD, 0.0]], planes).tolist()
    [False, True]
    """
    if plane is None or len(plane.centers) == 1:
        return np.zeros(max(len(np.asarray(positions)) - 1, 0), dtype=np.bool_)
    changed: NDArray[np.bool_] = np.diff(plane_indices(positions, plane)) != 0
    return changed


def _choose_roughly(lat: Floats, lon: Floats) -> tuple[int, int] | None:
    """Choose the centre of plane 0 in single precision, five times as fast.

    None if there are few samples, if other planes may be needed, or if the rounding of single
    precision may matter.
    """
    # All directions, and their median.
    if len(lat) < _MIN_ROUGH_SAMPLES or not (np.isfinite(lat).all() and np.isfinite(lon).all()):
        return None
    lat_32, lon_32 = np.radians(lat.astype(np.float32)), np.radians(lon.astype(np.float32))
    equatorial = np.cos(lat_32)
    directions = equatorial * np.cos(lon_32), equatorial * np.sin(lon_32), np.sin(lat_32)
    x, y, z = (float(np.median(axis)) for axis in directions)
    if np.hypot(x, y) < _MIN_ROUGH_EQUATORIAL or np.hypot(np.hypot(x, y), z) < _MIN_ROUGH_LENGTH:
        return None

    # The centre must not be next to where rounding goes the other way.
    middle = np.degrees([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)])
    low, high = (_round_center(*(middle + error)) for error in (-_ROUGH_DEGREES, _ROUGH_DEGREES))
    axis = _unit_vectors(*(np.array([degrees / UNITS_PER_DEGREE]) for degrees in low))[0]
    cosines = sum(np.float32(a) * component for a, component in zip(axis, directions, strict=True))
    is_near = float(np.min(cosines)) > np.cos(PLANE_RADIUS / _EARTH_RADIUS) + _ROUGH_COSINE
    return low if low == high and is_near else None


def _unit_vectors(lat: Floats, lon: Floats) -> Floats:
    """Return directions from the earth's centre, taken as a sphere; shape (n, 3)."""
    lat, lon = np.radians(lat), np.radians(lon)
    equatorial = np.cos(lat)
    components = np.stack([equatorial * np.cos(lon), equatorial * np.sin(lon), np.sin(lat)])
    return components.T


def _round_center(lat: float, lon: float) -> tuple[int, int]:
    """Round a position to hundredths of a degree; return a centre in its integer units."""
    unit = int(UNITS_PER_DEGREE // _CENTERS_PER_DEGREE)
    return (
        round(float(lat) * _CENTERS_PER_DEGREE) * unit,
        round(float(lon) * _CENTERS_PER_DEGREE) * unit,
    )


def _median_center(directions: Floats) -> tuple[int, int] | None:
    """Return the centre at the componentwise median of directions; None if it is near zero."""
    x, y, z = (np.median(axis) for axis in directions.T)
    equatorial = np.hypot(x, y)
    if np.hypot(equatorial, z) < _MIN_MEDIAN_LENGTH:
        return None
    return _round_center(np.degrees(np.arctan2(z, equatorial)), np.degrees(np.arctan2(y, x)))


def _cosines(directions: Floats, center: tuple[int, int]) -> Floats:
    """Return the cosines of the angles between directions and a centre."""
    axis = _unit_vectors(
        np.array([center[0] / UNITS_PER_DEGREE]), np.array([center[1] / UNITS_PER_DEGREE])
    )[0]
    # The cosine of the angle between unit vectors is their product.
    cosines: Floats = directions @ axis
    return cosines


def _in_radius(directions: Floats, center: tuple[int, int]) -> NDArray[np.bool_]:
    """Whether each direction lies within the radius of a centre."""
    # An arc has the angle length / radius, and the cosine falls with the angle.
    min_cosine = np.cos(PLANE_RADIUS / _EARTH_RADIUS)
    is_inside: NDArray[np.bool_] = _cosines(directions, center) >= min_cosine
    return is_inside


def _assign_planes(directions: Floats, plane: Plane) -> NDArray[np.int64]:
    """Return the first plane within whose radius each direction is, or else the nearest one."""
    assigned = np.full(len(directions), -1, dtype=np.int64)
    for i, center in enumerate(plane.centers):
        unassigned = np.flatnonzero(assigned < 0)
        assigned[unassigned[_in_radius(directions[unassigned], center)]] = i

    outside = np.flatnonzero(assigned < 0)
    if len(outside):
        cosines = np.stack([_cosines(directions[outside], center) for center in plane.centers])
        assigned[outside] = np.argmax(cosines, axis=0)
    return assigned
