"""Walks of an archive as predictions of the logs that it keeps exactly."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.container.catalog import group_heads
from gpszip.lossless.trails import Trail
from gpszip.model.grid import Plane, step_size
from gpszip.model.projection import UNITS_PER_DEGREE, plane_indices

if TYPE_CHECKING:
    from gpszip.archive.archive import Archive
    from gpszip.model.walk import Walk

__all__ = ["ArchiveTrails", "plain_degrees"]

#: Groups of walks whose coordinates are kept; logs visit them in turn.
_KEPT_GROUPS = 4

#: WGS84: half the long axis in metres, and the square of the eccentricity.
_AXIS = 6_378_137.0
_E2 = 0.0066943799901413165
_EP2 = _E2 / (1 - _E2)

#: Length of a meridian from the equator, over the axis: terms in 0, 2, 4, 6 latitudes (J. P.
#: Snyder, "Map projections: a working manual", 1987, equation 3-21).
_ARC_0 = 1 - _E2 / 4 - 3 * _E2 * _E2 / 64 - 5 * _E2 * _E2 * _E2 / 256
_ARC_2 = 3 * _E2 / 8 + 3 * _E2 * _E2 / 32 + 45 * _E2 * _E2 * _E2 / 1024
_ARC_4 = 15 * _E2 * _E2 / 256 + 45 * _E2 * _E2 * _E2 / 1024
_ARC_6 = 35 * _E2 * _E2 * _E2 / 3072

#: Latitude at which a meridian has a length, terms in 2, 4, 6 rectifying latitudes (equation 3-26).
_E1 = 0.0016792203863837047
_FOOT_2 = 3 * _E1 / 2 - 27 * _E1 * _E1 * _E1 / 32
_FOOT_4 = 21 * _E1 * _E1 / 16
_FOOT_6 = 151 * _E1 * _E1 * _E1 / 96

#: Radians in a degree, and half a turn.
_RADIAN = 0.017453292519943295
_HALF_TURN = 180.0

#: Coefficients of the series of sine and cosine, up to the 23rd power.
_SINE = (
    1.0,
    -1 / 6,
    1 / 120,
    -1 / 5040,
    1 / 362880,
    -1 / 39916800,
    1 / 6227020800,
    -1 / 1307674368000,
    1 / 355687428096000,
)
_COSINE = (
    1.0,
    -1 / 2,
    1 / 24,
    -1 / 720,
    1 / 40320,
    -1 / 3628800,
    1 / 479001600,
    -1 / 87178291200,
    1 / 20922789888000,
    -1 / 6402373705728000,
)

#: A cosine is at least this where something is divided by it.
_MIN_COSINE = 1e-9

Floats = NDArray[np.float64]


class ArchiveTrails:
    """The walks of an archive, decoded where they are asked for.

    Parameters
    ----------
    archive : Archive
        With times, and with a map of its own.
    """

    def __init__(self, archive: Archive) -> None:
        self._archive = archive
        self._group = lru_cache(_KEPT_GROUPS)(self._read_group)
        heads = group_heads(archive.contents)
        self._first_tracks = [head.first_track for head in heads]

    @property
    def names(self) -> Sequence[str]:
        """Name of each track."""
        return self._archive.ids

    @property
    def axes(self) -> int:
        """Number of coordinates of positions."""
        return self._archive.grid.dimension

    @property
    def time_step(self) -> float:
        """Seconds to which times of knots are rounded."""
        return step_size(self._archive.grid.time)

    def trail(self, number: int) -> Trail | None:
        """Knots of a track; None for one without times."""
        which = bisect_right(self._first_tracks, number) - 1
        walks, positions = self._group(which)
        walk = walks[number - self._first_tracks[which]]
        if walk.times is None or not len(walk.times):
            return None
        return _make_trail(walk, positions[walk.nodes])

    def _read_group(self, number: int) -> tuple[tuple[Walk, ...], Floats]:
        """Walks of a group, and the log's own coordinates of its nodes."""
        walks, positions = self._archive.walks_of_group(number)
        plane = self._archive.grid.plane
        if plane is not None:
            # Only forged archives have positions so far off a plane that these numbers overflow.
            with np.errstate(all="ignore"):
                degrees = plain_degrees(positions[:, :2], plane)
            positions = np.column_stack([degrees, positions[:, 2:]])
        return walks, positions


def _make_trail(walk: Walk, positions: Floats) -> Trail:
    """Knots of a walk with times."""
    # Where pieces begin and end.
    assert walk.times is not None
    is_first, is_last = np.append(True, walk.gaps), np.append(walk.gaps, True)
    times = walk.times.copy()
    if walk.time_ranges is not None:
        times[is_first], times[is_last] = walk.time_ranges[:, 0], walk.time_ranges[:, 1]

    is_stay = np.append(False, (walk.nodes[1:] == walk.nodes[:-1]) & ~walk.gaps)
    return Trail(
        np.maximum.accumulate(times),
        positions,
        is_first | is_last,
        is_stay,
        np.append(False, walk.gaps),
    )


def plain_degrees(positions: Floats, plane: Plane) -> Floats:
    """Latitude and longitude of positions on planes, the same bits on every machine.

    The series of Snyder (1987), equations 8-17 to 8-25, by additions, multiplications, divisions
    and square roots of float64 alone. It is good to 1 cm within 300 km of a plane's centre.

    Parameters
    ----------
    positions : float64 array, shape (n, 2)
        Metres.
    plane : Plane
        The planes on which they lie.

    Returns
    -------
    float64 array, shape (n, 2)
        Degrees. Longitudes lie between -180 and 180.

    Examples
    --------
    >>> plain_degrees(np.zeros((1, 2)), Plane(((525000000, 134000000),))).round(7).tolist()
    [[52.5, 13.4]]
    """
    index = plane_indices(positions, plane)
    centers = np.array(plane.centers, np.float64)[index] / UNITS_PER_DEGREE
    x, y = positions[:, 0] - index * Plane.SPREAD, positions[:, 1]

    # The foot point: the latitude at which the central meridian has the length of y.
    middle = centers[:, 0] * _RADIAN
    sine_2, cosine_2 = _sine_and_cosine(2 * middle)
    arc = _ARC_0 * middle - _three_terms(sine_2, cosine_2, _ARC_2, -_ARC_4, _ARC_6)
    rectifying = (arc + y / _AXIS) / _ARC_0
    sine_2, cosine_2 = _sine_and_cosine(2 * rectifying)
    foot = rectifying + _three_terms(sine_2, cosine_2, _FOOT_2, _FOOT_4, _FOOT_6)

    # The series in the distance from the meridian.
    sine, cosine = _sine_and_cosine(foot)
    cosine = np.maximum(np.abs(cosine), _MIN_COSINE)
    tangent = sine / cosine
    t, c = tangent * tangent, _EP2 * cosine * cosine
    shape = 1 - _E2 * sine * sine
    d = x * np.sqrt(shape) / _AXIS
    d2 = d * d
    fourth = (5 + 3 * t + 10 * c - 4 * c * c - 9 * _EP2) * d2 / 24
    lat = foot - tangent * (shape / (1 - _E2)) * d2 * (0.5 - fourth)
    third = (1 + 2 * t + c) * d2 / 6
    fifth = (5 - 2 * c + 28 * t - 3 * c * c + 8 * _EP2 + 24 * t * t) * d2 * d2 / 120
    lon = centers[:, 1] + d * (1 - third + fifth) / cosine / _RADIAN

    # Longitudes within half a turn.
    lon = np.where(lon > _HALF_TURN, lon - 2 * _HALF_TURN, lon)
    lon = np.where(lon < -_HALF_TURN, lon + 2 * _HALF_TURN, lon)
    degrees: Floats = np.column_stack([lat / _RADIAN, lon])
    return degrees


def _three_terms(sine: Floats, cosine: Floats, a: float, b: float, c: float) -> Floats:
    """A sin(z) + b sin(2 z) + c sin(3 z), of the sine and cosine of z."""
    # sin(2 z) = 2 sin z cos z, sin(3 z) = sin z (4 cos^2 z - 1)
    return sine * (a + 2 * b * cosine + c * (4 * cosine * cosine - 1))


def _sine_and_cosine(angles: Floats) -> tuple[Floats, Floats]:
    """Sine and cosine of angles between -2 pi and 2 pi, by their power series of the quarter."""
    quarters = angles * 0.25
    square = quarters * quarters
    sine, cosine = np.zeros(len(angles)), np.zeros(len(angles))
    for coefficient in _SINE[::-1]:
        sine = sine * square + coefficient
    for coefficient in _COSINE[::-1]:
        cosine = cosine * square + coefficient
    sine = sine * quarters
    for _ in range(2):
        sine, cosine = 2 * sine * cosine, cosine * cosine - sine * sine
    return sine, cosine
