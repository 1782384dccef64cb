"""Lines that stay in position when programs interpolate them linearly in degrees.

A straight line on a metric plane is curved in latitude and longitude, and constant speed in
metres is not constant in degrees. At latitude 48 degrees the midpoint of a segment of 220 km to
the east is 1 km off. Extra points on the line reduce the error as needed: it shrinks with the
square of the distance between points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.antimeridian import wrap_degrees
from gpszip.geo.planes import plane_changes, to_geographic
from gpszip.model import Plane

__all__ = ["densify_for_degrees"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Metres; above all radii of curvature of WGS84, so that distances are never underestimated.
_MAX_EARTH_RADIUS = 6_400_000.0

#: Metres; below all radii of curvature of WGS84, so that curvature is never underestimated.
_MIN_EARTH_RADIUS = 6e6

#: Upper bound on the scale factor of a plane, at the largest distance of positions from its centre.
_MAX_SCALE_FACTOR = 1.01

#: Degrees; beyond this latitude all segments are measured, as the estimate diverges at the poles.
_POLAR_LATITUDE = 85.0

#: Shares of a segment at which its deviation is measured.
_PROBE_SHARES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])

#: A segment is split into at most this many at a time, as the error may be unevenly distributed.
_MAX_SPLITS = 64

#: Factor on a measured deviation, which may be larger between the probes.
_DEVIATION_MARGIN = 1.05


class _Subsegments(NamedTuple):
    """Intervals of segments.

    Parameters
    ----------
    segments : int64 array, shape (s,)
        Segment i leads from position i to position i + 1.
    start, end : float64 array, shape (s,)
        Shares of the segment, in [0, 1].
    """

    segments: Ints
    start: Floats
    end: Floats


def densify_for_degrees(
    times: Floats,
    positions: Floats,
    plane: Plane,
    max_deviation: float,
    *,
    decimals: int,
    time_decimals: int,
    skipped: NDArray[np.bool_] | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Add points to a line until its degrees, rounded and linear in time, deviate by little.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Increasing. For a line without times, any number that increases along it.
    positions : float64 array, shape (n, 2)
        Metres on the plane; between two positions the line is straight and the speed constant.
    plane : Plane
        The planes of the positions.
    max_deviation : float
        Metres by which the line in degrees may deviate, rounding of degrees and times included.
    decimals : int
        Decimals to which degrees are rounded.
    time_decimals : int
        Decimals to which times are rounded.
    skipped : bool array, shape (n - 1,), optional
        Segments that don't belong to the line and get no points.

    Returns
    -------
    times, lat, lon : float64 array, shape (m,), m >= n
        Rounded; the given points are among them.

    Examples
    --------
    >>> plane = Plane(((480000000, 115000000),))
    >>> times, line = np.array([0.0, 1e4]), np.array([[-100_000.0, 0.0], [100_000.0, 0.0]])
    >>> times, _, _ = densify_for_degrees(times, line, plane, 100.0, decimals=8, time_decimals=6)
    >>> times.tolist()
    [0.0, 2500.0, 5000.0, 7500.0, 10000.0]
    """
    # What the rounding of times leaves of the tolerance, but no less than a quarter of it.
    lat, lon = to_geographic(positions, plane)
    tolerance = np.maximum(
        max_deviation - _time_rounding_errors(times, positions, time_decimals), max_deviation / 4
    )

    # Segments that need to be measured.
    is_candidate = _may_deviate(positions, lat, tolerance - _rounding_error(decimals))
    is_candidate &= ~plane_changes(positions, plane)
    if skipped is not None:
        is_candidate &= ~skipped

    # Segment and share of each new point, in the order of the line.
    line = _LineOnPlane(times, positions, plane, tolerance, decimals, time_decimals)
    segments, shares = line.find_cuts(np.flatnonzero(is_candidate))
    order = np.lexsort((shares, segments))
    segments, shares = segments[order], shares[order]

    # Insert the new points behind the starts of their segments.
    new_lat, new_lon = line.to_degrees(segments, shares)
    columns = (
        (np.round(times, time_decimals), np.round(line.times_at(segments, shares), time_decimals)),
        (np.round(lat, decimals), np.round(new_lat, decimals)),
        (np.round(lon, decimals), np.round(new_lon, decimals)),
    )
    # Adding 0 turns -0.0 into 0.0.
    all_times, all_lat, all_lon = (
        np.insert(given, segments + 1, new) + 0.0 for given, new in columns
    )
    return all_times, all_lat, all_lon


def _rounding_error(decimals: int) -> float:
    """Return the most metres by which rounding of latitude and longitude moves a position."""
    # Half a unit of the last decimal to the north and to the east, at right angles.
    return float(_MAX_EARTH_RADIUS * np.radians(0.5 * 10.0**-decimals) * np.sqrt(2))


def _time_rounding_errors(times: Floats, positions: Floats, time_decimals: int) -> Floats:
    """Return the most metres by which rounding of times moves the points of each segment."""
    time_shifts = np.abs(np.round(times, time_decimals) - times)
    lengths = np.sqrt((np.diff(positions, axis=0) ** 2).sum(axis=1))
    # Speed times the larger shift of both ends.
    errors: Floats = lengths / np.diff(times) * np.maximum(time_shifts[:-1], time_shifts[1:])
    return errors


def _may_deviate(positions: Floats, lat: Floats, max_deviation: Floats) -> NDArray[np.bool_]:
    """Find the segments that may deviate by more than their tolerance: cheap, and no misses.

    A segment of length L to the east deviates by L^2 tan(lat) / 8 R in the middle, and by up to
    1.2 times that because of its uneven speed. The curvature of lines on the plane adds far less
    than 0.3 times L^2 / 8 R.
    """
    steps = np.diff(positions, axis=0)
    squares = np.einsum("ij,ij->i", steps, steps)

    # Highest latitude on the segment.
    highest = np.maximum(np.abs(lat[:-1]), np.abs(lat[1:])) + np.degrees(
        np.sqrt(squares) / _MIN_EARTH_RADIUS
    )

    # Deviation in the middle.
    bend = 1.2 * np.tan(np.radians(np.minimum(highest, _POLAR_LATITUDE))) + 0.3
    sagitta = squares * bend / (8 * _MIN_EARTH_RADIUS)
    may_deviate: NDArray[np.bool_] = (squares > 0) & (
        (sagitta > max_deviation) | (highest > _POLAR_LATITUDE)
    )
    return may_deviate


@dataclass(frozen=True, eq=False)
class _LineOnPlane:
    """A line on a plane that is converted to degrees.

    Parameters
    ----------
    times, positions, plane, decimals, time_decimals
        As for :func:`densify_for_degrees`.
    max_deviation : float64 array, shape (n - 1,)
        Metres by which each segment may deviate.
    """

    times: Floats
    positions: Floats
    plane: Plane
    max_deviation: Floats
    decimals: int
    time_decimals: int

    def find_cuts(self, segments: Ints) -> tuple[Ints, Floats]:
        """Return segment and share of each point to add."""
        subsegments = _Subsegments(segments, np.zeros(len(segments)), np.ones(len(segments)))
        cut_segments, cut_shares = [np.empty(0, np.int64)], [np.empty(0)]
        # Split again until none deviates too much.
        while len(subsegments.segments):
            new_segments, new_shares, subsegments = self._split(subsegments)
            cut_segments.append(new_segments)
            cut_shares.append(new_shares)
        return np.concatenate(cut_segments), np.concatenate(cut_shares)

    def times_at(self, segments: Ints, shares: Floats) -> Floats:
        """Return the times at shares of segments."""
        start = self.times[segments]
        times: Floats = start + shares * (self.times[segments + 1] - start)
        return times

    def to_degrees(self, segments: Ints, shares: Floats) -> tuple[Floats, Floats]:
        """Return latitude and longitude at shares of segments."""
        start = self.positions[segments]
        return to_geographic(
            start + shares[:, None] * (self.positions[segments + 1] - start), self.plane
        )

    def _split(self, subsegments: _Subsegments) -> tuple[Ints, Floats, _Subsegments]:
        """Split the subsegments that deviate too much.

        Returns segment and share of each cut, and the new subsegments, to be measured in turn.
        """
        # Those that deviate too much.
        deviation = self._measure_deviation(subsegments)
        is_wide = deviation > self.max_deviation[subsegments.segments]
        segments = subsegments.segments[is_wide]
        start, end = subsegments.start[is_wide], subsegments.end[is_wide]
        deviation = deviation[is_wide]

        # Number of new subsegments: the error shrinks with the square of it.
        max_deviation = self.max_deviation[segments]
        allowed = np.maximum(max_deviation - _rounding_error(self.decimals), max_deviation / 3)
        counts = np.clip(np.ceil(np.sqrt(_DEVIATION_MARGIN * deviation / allowed)), 2, _MAX_SPLITS)

        # Each lasts two units of the rounded times or more; otherwise times would not increase.
        durations = (end - start) * np.diff(self.times)[segments]
        longest = np.floor(durations * 10.0**self.time_decimals / 2)
        counts = np.minimum(counts, longest).astype(np.int64)
        is_split = counts > 1
        segments, counts = segments[is_split], counts[is_split]
        start, end = start[is_split], end[is_split]

        # Shares at which they start, equally spaced, moved to rounded times.
        first = np.cumsum(counts) - counts
        number = np.arange(counts.sum()) - np.repeat(first, counts)
        segments = np.repeat(segments, counts)
        starts = np.repeat(start, counts) + number * np.repeat((end - start) / counts, counts)
        is_cut = number > 0
        starts[is_cut] = self._round_to_time(segments[is_cut], starts[is_cut])

        # Each ends where the next one starts.
        ends = np.append(starts[1:], 0.0)
        ends[first + counts - 1] = end
        return segments[is_cut], starts[is_cut], _Subsegments(segments, starts, ends)

    def _round_to_time(self, segments: Ints, shares: Floats) -> Floats:
        """Return the shares at which the rounded times of points lie."""
        start = self.times[segments]
        rounded = np.round(self.times_at(segments, shares), self.time_decimals)
        rounded_shares: Floats = (rounded - start) / (self.times[segments + 1] - start)
        return rounded_shares

    def _measure_deviation(self, subsegments: _Subsegments) -> Floats:
        """Return the largest distance in metres between the line and its chord in degrees."""
        # True latitude and longitude at the probes; shape (probes, subsegments).
        segments, start, end = subsegments
        shares = start + _PROBE_SHARES[:, None] * (end - start)
        lat, lon = (
            axis.reshape(shares.shape)
            for axis in self.to_degrees(np.tile(segments, len(_PROBE_SHARES)), shares.ravel())
        )

        # The chord between the rounded ends, along the shorter arc round the earth.
        first_lat, last_lat = np.round(lat[0], self.decimals), np.round(lat[-1], self.decimals)
        first_lon, last_lon = np.round(lon[0], self.decimals), np.round(lon[-1], self.decimals)
        north = first_lat + _PROBE_SHARES[:, None] * (last_lat - first_lat) - lat
        chord_lon = first_lon + _PROBE_SHARES[:, None] * wrap_degrees(last_lon - first_lon)
        east = wrap_degrees(chord_lon - lon) * np.cos(np.radians(lat))

        # Convert degrees to metres on the plane, by the greatest radius and scale factor.
        distances: Floats = (
            _MAX_SCALE_FACTOR
            * _MAX_EARTH_RADIUS
            * np.radians(np.hypot(north, east)).max(axis=0, initial=0.0)
        )
        return distances
