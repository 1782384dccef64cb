"""The projection of many positions at once, by power series fitted to the log's own region.

A transverse Mercator projection is an analytic function of one complex variable: it maps
``psi + i lambda``, of isometric latitude and longitude, to ``y + i x``. So on a disk a short power
series is as exact as float64. PROJ computes some ten trigonometric functions for each position and
takes 150 ns; a series of a town takes 25 ns. Where a series would not agree with PROJ to
:data:`MAX_DIFFERENCE`, there is none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

__all__ = ["MAX_DIFFERENCE", "MIN_POSITIONS", "from_plane", "onto_plane"]

#: Metres by which a series may differ from PROJ; float64 degrees are good to 3e-9 m.
MAX_DIFFERENCE = 1e-8

#: Positions from which on a series pays: to fit one takes as long as to project 3,000.
MIN_POSITIONS = 10_000

#: First eccentricity of WGS84, whose flattening is 1 / 298.257223563.
_ECCENTRICITY = float(np.sqrt((2 - 1 / 298.257223563) / 298.257223563))

#: Degrees in a radian.
_DEGREES = 180.0 / np.pi

#: Metres in a radian of latitude or longitude: 6.40e6 of latitude at a pole, less elsewhere.
_METRES_PER_RADIAN = 6.4e6

#: Latitude in degrees beyond which the isometric latitude grows too fast for a short series.
_MAX_LATITUDE = 80.0

#: Points on the circle, and of an interval, to which a series is fitted.
_NODES = 64
_INTERVAL_NODES = 24

#: Largest radius of a disk in metres, and in radians.
_MAX_RADIUS = 400_000.0
_MAX_ANGLE = 0.35

#: Radius of a disk, in metres or radians, below which positions differ by rounding alone.
_MIN_RADIUS = 1e-15

#: Coefficients below these, in metres and in radians, are rounding errors of PROJ: it computes
#: metres as multiples of the radius of the earth.
_NOISE = 1e-9
_ANGLE_NOISE = 2e-15

#: Points at which a series is compared with PROJ.
_CHECKS = 32

#: Positions that are projected at a time, which fit into a processor's cache.
_BLOCK = 8192

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Projection = Callable[[Floats, Floats], tuple[Floats, Floats]]


@dataclass(frozen=True)
class _Disk:
    """A disk in the complex plane."""

    center: complex
    radius: float

    @property
    def circle(self) -> Complexes:
        """Points at equal distances on its edge."""
        turns = np.arange(_NODES) / _NODES
        points: Complexes = self.center + self.radius * np.exp(2j * np.pi * turns)
        return points

    @property
    def inner_points(self) -> Complexes:
        """Points all over it, on a spiral."""
        numbers = np.arange(_CHECKS)
        radii = self.radius * np.sqrt((numbers + 0.5) / _CHECKS)
        points: Complexes = self.center + radii * np.exp(2.4j * numbers)
        return points


@dataclass(frozen=True)
class _Series:
    """A power series in ``(z - center) / radius``.

    Parameters
    ----------
    center, radius : complex or float
        The disk or the interval on which it holds.
    coefficients : array
        From the constant term on.
    """

    center: complex
    radius: float
    coefficients: NDArray[np.inexact]

    def __call__(self, values: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Evaluate it by Horner's scheme."""
        scaled = (values - self.center) * (1.0 / self.radius)
        result = np.full(len(values), self.coefficients[-1])
        for coefficient in self.coefficients[-2::-1]:
            result *= scaled
            result += coefficient
        return result


def from_plane(x: Floats, y: Floats, lon_0: float, inverse: Projection) -> tuple[Floats, Floats]:
    """Return latitude and longitude of positions on a plane.

    Parameters
    ----------
    x, y : float64 arrays, shape (n,)
        Metres to the east and north of the centre.
    lon_0 : float
        Longitude of the centre in degrees.
    inverse : callable
        PROJ's own: from x and y to longitude and latitude.

    Returns
    -------
    lat, lon : float64 arrays, shape (n,)
        Degrees.
    """
    # A series of the complex variable, and one from isometric latitude to latitude.
    fitted = _fit_inverse(x, y, lon_0, inverse) if len(x) >= MIN_POSITIONS else None
    if fitted is None:
        lon, lat = inverse(x, y)
        return lat, lon
    return _unproject(fitted, x, y, lon_0)


def onto_plane(
    lat: Floats, lon: Floats, lon_0: float, forward: Projection
) -> tuple[Floats, Floats]:
    """Return positions on a plane.

    Parameters
    ----------
    lat, lon : float64 arrays, shape (n,)
        Degrees.
    lon_0 : float
        Longitude of the centre in degrees.
    forward : callable
        PROJ's own: from longitude and latitude to x and y.

    Returns
    -------
    x, y : float64 arrays, shape (n,)
        Metres.
    """
    fitted = _fit_forward(lat, lon, lon_0, forward) if len(lat) >= MIN_POSITIONS else None
    return forward(lon, lat) if fitted is None else _project(fitted, lat, lon, lon_0)


# Evaluation


def _unproject(
    fitted: tuple[_Series, _Series], x: Floats, y: Floats, lon_0: float
) -> tuple[Floats, Floats]:
    """Evaluate an inverse projection, block by block."""
    to_isometric, to_latitude = fitted
    lat, lon = np.empty(len(x)), np.empty(len(x))
    for first in range(0, len(x), _BLOCK):
        rows = slice(first, first + _BLOCK)
        isometric = to_isometric(_complex(y[rows], x[rows]))
        np.multiply(to_latitude(isometric.real), _DEGREES, out=lat[rows])
        np.multiply(isometric.imag, _DEGREES, out=lon[rows])
        lon[rows] += lon_0
    if max(float(lon.max()), -float(lon.min())) > 180:
        beyond = np.abs(lon) > 180
        lon[beyond] -= np.copysign(360.0, lon[beyond])
    return lat, lon


def _project(
    fitted: tuple[_Series, _Series], lat: Floats, lon: Floats, lon_0: float
) -> tuple[Floats, Floats]:
    """Evaluate a projection, block by block."""
    to_isometric, to_metres = fitted
    x, y = np.empty(len(lat)), np.empty(len(lat))
    for first in range(0, len(lat), _BLOCK):
        rows = slice(first, first + _BLOCK)
        isometric = to_isometric(lat[rows] * (1.0 / _DEGREES))
        east = _turn(lon[rows], lon_0) * (1.0 / _DEGREES)
        metres = to_metres(_complex(isometric.real, east))
        x[rows], y[rows] = metres.imag, metres.real
    return x, y


def _complex(real: Floats, imaginary: Floats) -> Complexes:
    """Complex numbers of both parts."""
    values = np.empty(len(real), np.complex128)
    values.real, values.imag = real, imaginary
    return values


def _turn(lon: Floats, lon_0: float) -> Floats:
    """Degrees from a meridian to the east, from -180 to 180."""
    east = lon - lon_0
    if max(float(east.max()), -float(east.min())) > 180:
        beyond = np.abs(east) > 180
        east[beyond] -= np.round(east[beyond] / 360) * 360
    return east


# Fitting


def _fit_inverse(
    x: Floats, y: Floats, lon_0: float, inverse: Projection
) -> tuple[_Series, _Series] | None:
    """Fit series to an inverse projection about positions; None if they don't agree with it."""
    # From the plane to isometric latitude and longitude, by values on a circle.
    disk = _disk_about(y, x)
    if disk is None or disk.radius > _MAX_RADIUS:
        return None
    lon, lat = inverse(disk.circle.imag, disk.circle.real)
    if not np.abs(lat).max() < _MAX_LATITUDE:
        return None
    isometric = _isometric(np.radians(lat))
    to_isometric = _series_on(disk, isometric + 1j * np.radians(_turn(lon, lon_0)), _ANGLE_NOISE)

    # From there to latitude. The real part of an analytic function is largest on the circle.
    to_latitude = _series_between(float(isometric.min()), float(isometric.max()), _latitude)

    # Compare with PROJ.
    if to_isometric is None or to_latitude is None:
        return None
    points = disk.inner_points
    lon, lat = inverse(points.imag, points.real)
    fitted_lat, fitted_lon = _unproject(
        (to_isometric, to_latitude), points.imag, points.real, lon_0
    )
    errors = np.radians([fitted_lat - lat, _turn(fitted_lon - lon, 0.0)]) * _METRES_PER_RADIAN
    return (to_isometric, to_latitude) if np.abs(errors).max() <= MAX_DIFFERENCE else None


def _fit_forward(
    lat: Floats, lon: Floats, lon_0: float, forward: Projection
) -> tuple[_Series, _Series] | None:
    """Fit series to a projection about positions; None if they don't agree with it."""
    # From latitude to isometric latitude, on an interval that holds the disk below.
    lowest, highest = float(lat.min()), float(lat.max())
    is_finite = np.isfinite([lon.min(), lon.max()]).all()
    if not (is_finite and max(-lowest, highest) < _MAX_LATITUDE):
        return None
    low, high = _isometric(np.radians(np.array([lowest, highest])))
    disk = _disk_about(np.array([low, high]), np.radians(_turn(lon, lon_0)))
    if disk is None or disk.radius > _MAX_ANGLE:
        return None
    to_isometric = _series_between(np.radians(lowest), np.radians(highest), _isometric)

    # From isometric latitude and longitude to the plane, by values on a circle.
    circle = disk.circle
    x, y = forward(np.degrees(circle.imag) + lon_0, np.degrees(_latitude(circle.real)))
    to_metres = _series_on(disk, y + 1j * x, _NOISE)

    # Compare with PROJ.
    if to_isometric is None or to_metres is None:
        return None
    # Points north or south of the interval move to its ends, so that a narrow one has all of them.
    points = disk.inner_points
    at_lat = np.clip(np.degrees(_latitude(points.real)), lowest, highest)
    at_lon = np.degrees(points.imag) + lon_0
    errors = np.subtract(
        _project((to_isometric, to_metres), at_lat, at_lon, lon_0), forward(at_lon, at_lat)
    )
    return (to_isometric, to_metres) if np.abs(errors).max() <= MAX_DIFFERENCE else None


def _disk_about(real: Floats, imaginary: Floats) -> _Disk | None:
    """The disk about the rectangle that holds all values.

    None if a value is not finite, or all are one to rounding.
    """
    corners = np.array([real.min(), real.max(), imaginary.min(), imaginary.max()])
    if not np.isfinite(corners).all():
        return None
    low, high = complex(corners[0], corners[2]), complex(corners[1], corners[3])
    radius = abs(high - low) / 2
    return _Disk((low + high) / 2, radius) if radius > _MIN_RADIUS else None


def _series_on(disk: _Disk, values: Complexes, noise: float) -> _Series | None:
    """Power series of an analytic function by its values on a circle; None if it is too long.

    The coefficients are ``c_j = 1 / N sum_k f(z_k) exp(-2 pi i j k / N)`` (Cauchy's integral).
    """
    coefficients = np.fft.fft(values)[: _NODES // 2] / _NODES
    return _shortened(disk.center, disk.radius, coefficients, noise)


def _series_between(
    low: float, high: float, function: Callable[[Floats], Floats]
) -> _Series | None:
    """Power series of a function on an interval, by interpolation at Chebyshev points.

    None if the interval is a point, or the series is too long.
    """
    center, radius = (low + high) / 2, (high - low) / 2
    if radius <= _MIN_RADIUS:
        return None

    # Without its middle, values are smaller, and so are rounding errors.
    middle = function(np.array([center]))
    points = chebyshev.chebpts1(_INTERVAL_NODES)
    values = function(center + radius * points) - middle
    fitted = chebyshev.chebfit(points, values, _INTERVAL_NODES - 1)
    shortened = _shortened(center, radius, fitted, _ANGLE_NOISE)
    if shortened is None:
        return None
    coefficients = chebyshev.cheb2poly(shortened.coefficients)
    coefficients[0] += middle[0]
    return _Series(center, radius, coefficients)


def _shortened(
    center: complex, radius: float, coefficients: NDArray[np.inexact], noise: float
) -> _Series | None:
    """Leave out the last coefficients, which are rounding errors; None if there are none of these.

    The next one is kept, as it may be nearly as large as a rounding error.
    """
    large = np.flatnonzero(np.abs(coefficients) > noise)
    last = int(large[-1]) if len(large) else 0
    if last >= len(coefficients) - 3:
        return None
    return _Series(center, radius, coefficients[: last + 2])


def _isometric(lat: Floats) -> Floats:
    """Isometric latitude, ``asinh(tan phi) - e atanh(e sin phi)``; radians."""
    values: Floats = np.arcsinh(np.tan(lat)) - _ECCENTRICITY * np.arctanh(
        _ECCENTRICITY * np.sin(lat)
    )
    return values


def _latitude(isometric: Floats) -> Floats:
    """Latitude of an isometric latitude by fixed-point iteration; radians.

    ``phi = atan(sinh(psi + e atanh(e sin phi)))`` gains two digits with each round.
    """
    lat: Floats = np.arctan(np.sinh(isometric))
    for _ in range(10):
        lat = np.arctan(
            np.sinh(isometric + _ECCENTRICITY * np.arctanh(_ECCENTRICITY * np.sin(lat)))
        )
    return lat
