"""Checks of times and positions by the speeds that they imply.

Numbers without a stated unit are read as what they most likely are. If the speeds that follow are
impossible, while another reading gives speeds of vehicles, the log is refused with the option that
states the unit or the columns. What a user states is never doubted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.raw import GuessedUnit, RawLog, Request
from gpszip.io.values.finite import finite_rows
from gpszip.io.values.timestamps import TIME_UNITS, numbers_to_seconds, unit_seconds
from gpszip.model.read_result import Repair

__all__ = ["check_plausible", "note_spreadsheet_days"]

#: Metres in a degree of latitude.
_METRES_PER_DEGREE = 111_195.0

#: Steps in a window over which speeds are measured: the noise of single positions is no travel.
_WINDOW_STEPS = 16

#: Metres by which a window moves at least if its speed is to count.
_MIN_DISPLACEMENT = 1.0

#: Highest speed of a vehicle, in m/s: that of an aircraft.
_MAX_SPEED = 350.0

#: Lowest speed, in m/s, that makes another unit of time likely.
_MIN_LIKELY_SPEED = 0.01

#: Seconds below which the duration of a log of more than two points is in doubt.
_MIN_DURATION = 1e-3

#: Seconds between points up to which high speeds show a wrong unit. With longer steps, a fast
#: agent may be a satellite, or several vehicles in one track.
_MAX_DENSE_STEP = 0.1

#: Seconds between points that no receiver goes below.
_MIN_RECEIVER_STEP = 5e-4

#: Days from 1899-12-30 to the years 1990 and 2031. Modified Julian days in this range are of times
#: before receivers.
_SPREADSHEET_DAYS = (32_874.0, 47_848.0)

#: Seconds from 1970 to the years 1980 and 2100.
_RECEIVER_TIMES = (315_532_800.0, 4_102_444_800.0)

#: Seconds, about three years, below which times may count from the start of a log.
_MAX_ELAPSED = 1e8

# Columns x and y look like degrees if all of the following holds.

#: They are farther from the origin than this multiple of the extent of the log, ...
_MIN_OFFSET_EXTENTS = 20.0
#: ... or spread over at least this number of degrees (about 100 km); ...
_MIN_WIDE_EXTENT = 1.0
#: ... the extent is at least this number of degrees (about 100 m); ...
_MIN_EXTENT = 1e-3
#: ... most numbers of one axis have more decimals than this; ...
_MAX_METRE_DECIMALS = 3
#: ... read as metres, points move slower than this, in m/s, ...
_MAX_CRAWL_SPEED = 0.01
#: ... and read as degrees, between these speeds, in m/s.
_TRAVEL_SPEEDS = (0.3, 350.0)

# They are certainly degrees if, moreover, all of the following holds.

#: Read as metres, points move slower than this, in m/s (as degrees, that is up to 120 km/h); ...
_CERTAIN_CRAWL_SPEED = 3e-4
#: ... they spread over at least this number of degrees (about 500 m); ...
_CERTAIN_EXTENT = 5e-3
#: ... displacement is at least this share of the path length in most windows, unlike noise; ...
_MIN_STRAIGHTNESS = 0.5
#: ... and points follow each other within this number of seconds, unlike glaciers and landslides.
_MAX_WATCHED_STEP = 120.0

#: Descriptions of units whose names are not enough.
_UNIT_DESCRIPTIONS = {
    "excel": "days from 1899-12-30, as spreadsheets count them",
    "matlab": "MATLAB's days",
}

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Motion:
    """Durations and lengths of windows of points.

    Parameters
    ----------
    duration : float64 array, shape (w,)
        Seconds from the first point of a window to the last.
    displacement : float64 array, shape (w,)
        Metres between these two points.
    path_length : float64 array, shape (w,) or (0,)
        Metres along all points between them; empty where it was not asked for.
    median_step : float
        Median of the seconds between successive points.
    """

    duration: Floats
    displacement: Floats
    path_length: Floats
    median_step: float

    def median_speed(self, min_displacement: float = 0.0) -> float:
        """Median speed in m/s of windows that move by more metres than the minimum; 0 if none."""
        # Windows at rest would pull the median to 0, whatever the unit of time.
        moving = (self.duration > 0) & (self.displacement > min_displacement)
        if not moving.any():
            return 0.0
        return float(np.median(self.displacement[moving] / self.duration[moving]))


def check_plausible(raw: RawLog, request: Request) -> RawLog:
    """Check that the speeds in a log are possible.

    Times that are certainly days of a spreadsheet, though read as seconds, are converted.

    Parameters
    ----------
    raw : RawLog
        A log, or the first rows of one.
    request : Request
        What the user states about times and columns, which is not doubted.

    Returns
    -------
    RawLog
        The same log, or one with other times. A repair records what was changed or is in doubt.

    Raises
    ------
    InputError
        If times or positions are certainly read in a wrong way.
    """
    # Take the points that can be used, track by track.
    good = np.isfinite(raw.times) & finite_rows(raw.coordinates)
    if np.count_nonzero(good) < 3:
        return raw
    times, coordinates, track = _good_points(raw, good)

    # Check positions: are metres degrees?
    if not raw.geographic:
        doubt = _degrees_as_metres(raw, request, times, coordinates, track)
        return raw if doubt is None else replace(raw, repairs=(*raw.repairs, doubt))

    # Check the unit of times. Positions off the globe are handled by clean_log.
    if raw.guessed_unit is None or _largest(coordinates[:, 0]) > 90:
        return raw
    if _are_spreadsheet_days(raw.guessed_unit, times, coordinates, track):
        converted = replace(
            raw,
            times=numbers_to_seconds(raw.times, "excel"),
            guessed_unit=GuessedUnit("excel", from_name=False),
        )
        return note_spreadsheet_days(converted)
    _check_unit(raw, raw.guessed_unit, times, coordinates, track)
    return raw


def _good_points(raw: RawLog, good: NDArray[np.bool_]) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return times, coordinates and codes of the points that can be used, track by track."""
    # Most logs need no copy: all points are good, and those of a track follow each other.
    codes = np.zeros(len(good), np.int64) if raw.codes is None else raw.codes
    rows: NDArray[np.intp] | slice = slice(None) if good.all() else np.flatnonzero(good)
    taken = codes[rows]
    if (taken[1:] < taken[:-1]).any():
        rows = np.flatnonzero(good)[np.argsort(taken, kind="stable")]
    return raw.times[rows], raw.coordinates[rows], codes[rows].astype(np.int64, copy=False)


def note_spreadsheet_days(raw: RawLog) -> RawLog:
    """Record that times were read as days of a spreadsheet.

    Raises
    ------
    InputError
        If some are outside the years in which there is no doubt.
    """
    # The unit was found from the first rows. A time outside of these years shows that it doesn't
    # hold for all rows.
    first, last = numbers_to_seconds(np.array(_SPREADSHEET_DAYS), "excel")
    outside = (raw.times < first) | (raw.times >= last)
    outside &= finite_rows(raw.coordinates)
    if outside.any():
        row = raw.first + int(outside.argmax())
        raise InputError(
            "its time is no day of a spreadsheet as those before it",
            path=raw.name,
            location=f"{raw.row_noun} {row}",
            remedy="say the unit: --time-unit s",
        )
    what = "times read as days from 1899-12-30, as spreadsheets count them"
    count = int(np.isfinite(raw.times).sum())
    return replace(raw, repairs=(*raw.repairs, Repair(what, count, raw.name, drops=False)))


# Units of time


def _are_spreadsheet_days(
    guess: GuessedUnit, times: Floats, coordinates: Floats, track: NDArray[np.int64]
) -> bool:
    """Whether times are certainly days since 1899-12-30: of these years, impossible as seconds."""
    # Times qualify if their size alone suggests seconds, and some are no whole days.
    first, last = _SPREADSHEET_DAYS
    if (
        guess != GuessedUnit("s", from_name=False)
        or times.min() < first
        or times.max() >= last
        or not (times % 1).any()
    ):
        return False

    # Compare the motion in both units: as seconds, steps must be too short for a receiver, or
    # speeds too high at dense steps; as days, speeds must be those of a vehicle.
    as_seconds = _measure_motion(times, coordinates, track)
    as_days = _measure_motion(numbers_to_seconds(times, "excel"), coordinates, track)
    is_too_fast = as_seconds.median_speed(_MIN_DISPLACEMENT) > _MAX_SPEED
    is_impossible = as_seconds.median_step < _MIN_RECEIVER_STEP or (
        as_seconds.median_step < _MAX_DENSE_STEP and is_too_fast
    )
    return is_impossible and as_days.median_speed(_MIN_DISPLACEMENT) <= _MAX_SPEED


def _check_unit(
    raw: RawLog, guess: GuessedUnit, times: Floats, coordinates: Floats, track: NDArray[np.int64]
) -> None:
    """Refuse a unit that makes the log too short, or its points faster than aircraft.

    High speeds alone are no reason: another unit has to be likely, too.
    """
    # Is there a reason for doubt?
    motion, duration = _measure_motion(times, coordinates, track), float(np.ptp(times))
    speed = motion.median_speed(_MIN_DISPLACEMENT)
    is_short = 0 < duration < _MIN_DURATION
    is_fast = motion.median_step < _MAX_DENSE_STEP and speed > _MAX_SPEED
    if not is_short and not is_fast:
        return

    # Is another unit more likely?
    values = times / unit_seconds(guess.unit)
    others = [
        unit
        for unit in TIME_UNITS
        if unit != guess.unit and _is_likely(numbers_to_seconds(values, unit), coordinates, track)
    ]
    if not others and not is_short:
        return

    # Name both units.
    problem = (
        f"its times last {duration:.2g} s" if is_short else f"its points move at {speed:.2g} m/s"
    )
    remedy = "say the unit with --time-unit"
    if others:
        unit = others[0]
        remedy = f"if they are {_UNIT_DESCRIPTIONS.get(unit, unit)}, say so: --time-unit {unit}"
    raise InputError(
        f"read as {guess.unit}, {problem}",
        path=raw.name,
        remedy=f"{remedy}; if that is right: --time-unit {guess.unit}",
    )


def _is_likely(times: Floats, coordinates: Floats, track: NDArray[np.int64]) -> bool:
    """Whether times are of the age of receivers or of the log, and speeds those of vehicles."""
    # Times count from 1970 and lie in the years of receivers, or count from the start of the log.
    middle = float(np.median(times))
    first, last = _RECEIVER_TIMES
    if not (first <= middle <= last or abs(middle) < _MAX_ELAPSED):
        return False
    speed = _measure_motion(times, coordinates, track).median_speed(_MIN_DISPLACEMENT)
    return _MIN_LIKELY_SPEED <= speed <= _MAX_SPEED


# Degrees that were read as metres


def _degrees_as_metres(
    raw: RawLog, request: Request, times: Floats, coordinates: Floats, track: NDArray[np.int64]
) -> Repair | None:
    """Doubt x and y that look like longitude and latitude.

    Returns
    -------
    Repair or None
        The warning; None if they look like metres, or the user names them x and y.

    Raises
    ------
    InputError
        If the speeds show that they are certainly degrees.
    """
    # Believe a user who names the columns x and y.
    stated = set(request.columns or ())
    if len(raw.axes) < 2 or {"x", "y"} <= stated:
        return None

    # Are the numbers possible as degrees, and either far from the origin or far apart?
    x, y = coordinates[:, 0], coordinates[:, 1]
    is_swapped = _largest(y) > 90
    lon, lat = (y, x) if is_swapped else (x, y)
    extent = max(float(np.ptp(x)), float(np.ptp(y)))
    if _largest(lat) > 90 or _largest(lon) > 180 or extent < _MIN_EXTENT:
        return None
    is_far = _are_far(x, y, extent)
    is_wide = extent >= _MIN_WIDE_EXTENT
    if not (is_far or is_wide) or not (_has_many_decimals(x) or _has_many_decimals(y)):
        return None

    # Are the speeds in metres those of a snail, and the speeds in degrees those of travel?
    as_metres = _measure_motion(times, np.stack([x, y], axis=1), track, geographic=False)
    degrees = np.stack([lat, lon], axis=1)
    as_degrees = _measure_motion(times, degrees, track, with_paths=True)
    crawl, speed = as_metres.median_speed(), as_degrees.median_speed()
    if not (crawl < _MAX_CRAWL_SPEED and _TRAVEL_SPEEDS[0] <= speed <= _TRAVEL_SPEEDS[1]):
        return None
    moving = as_degrees.displacement > 0
    straightness = as_degrees.displacement[moving] / as_degrees.path_length[moving]
    is_straight = float(np.median(straightness)) >= _MIN_STRAIGHTNESS
    if not is_far and not is_straight:
        return None

    # Refuse them or warn.
    first, second = raw.axes[:2]
    lon_name, lat_name = (second, first) if is_swapped else (first, second)
    remedy = f"--columns lon={lon_name},lat={lat_name}"
    is_certain = (
        crawl < _CERTAIN_CRAWL_SPEED
        and extent >= _CERTAIN_EXTENT
        and as_degrees.median_step <= _MAX_WATCHED_STEP
    )
    if is_certain and is_straight and moving.mean() > 0.5:
        raise InputError(
            f"columns {first!r} and {second!r} are degrees: as metres, points move at {crawl:.2g} "
            f"m/s, as degrees at {speed:.2g} m/s",
            path=raw.name,
            remedy=f"name them: {remedy}; if they are metres: --columns x={first},y={second}",
        )
    what = f"positions read as metres, but they look like degrees; if they are, name them: {remedy}"
    return Repair(what, len(times), raw.name, drops=False)


def _are_far(x: Floats, y: Floats, extent: float) -> bool:
    """Whether the medians are farther from the origin than a multiple of the extent."""
    # No median is farther than the farthest number, which takes less time to find.
    limit = _MIN_OFFSET_EXTENTS * extent
    if max(_largest(x), _largest(y)) < limit:
        return False
    return max(abs(float(np.median(x))), abs(float(np.median(y)))) >= limit


def _largest(axis: Floats) -> float:
    """Largest absolute value."""
    return max(float(axis.max()), -float(axis.min()))


def _has_many_decimals(axis: Floats) -> bool:
    """Whether most numbers have more decimals than positions in metres."""
    # Float64 holds degrees to 1e-13, so a larger excess comes from decimals.
    excess = np.abs(axis - np.round(axis, _MAX_METRE_DECIMALS))
    return bool(np.mean(excess > 1e-9) > 0.5)


# Speeds


def _measure_motion(
    times: Floats,
    coordinates: Floats,
    track: NDArray[np.int64],
    *,
    geographic: bool = True,
    with_paths: bool = False,
) -> _Motion:
    """Measure windows of successive points of one track."""
    # Windows begin and end at every 16th point of a track, and where tracks begin and end.
    same_track = track[1:] == track[:-1]
    first_of_track = np.flatnonzero(np.append(True, ~same_track))
    lengths = np.diff(np.append(first_of_track, len(times)))
    index_in_track = np.arange(len(times)) - np.repeat(first_of_track, lengths)
    is_last_of_track = np.append(~same_track, True)
    bounds = np.flatnonzero((index_in_track % _WINDOW_STEPS == 0) | is_last_of_track)
    begin, end = bounds[:-1], bounds[1:]
    in_one_track = track[begin] == track[end]
    begin, end = begin[in_one_track], end[in_one_track]

    # Add up steps from point to point.
    path_length = np.zeros(0)
    if with_paths:
        steps = _distances(coordinates[:-1], coordinates[1:], geographic)
        path = np.append(0.0, np.cumsum(np.where(same_track, steps, 0.0)))
        path_length = path[end] - path[begin]

    # Measure the windows. Steps back in time and repeated times don't count for the median step.
    durations = np.diff(times)[same_track]
    positive = durations[durations > 0]
    return _Motion(
        duration=times[end] - times[begin],
        displacement=_distances(coordinates[begin], coordinates[end], geographic),
        path_length=path_length,
        median_step=float(np.median(positive)) if len(positive) else np.inf,
    )


def _distances(starts: Floats, ends: Floats, geographic: bool) -> Floats:
    """Metres between positions that are near each other."""
    difference = ends[:, :2] - starts[:, :2]
    if geographic:
        # A degree of longitude is cos(latitude) times a degree of latitude. The difference is
        # wrapped to [-180, 180), so that a step over the antimeridian is short.
        east = (difference[:, 1] + 180) % 360 - 180
        difference = _METRES_PER_DEGREE * np.stack(
            [difference[:, 0], east * np.cos(np.radians(starts[:, 0]))], axis=1
        )
    distances: Floats = np.hypot(difference[:, 0], difference[:, 1])
    return distances
