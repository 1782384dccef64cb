"""Whether the times and places of a log can be what they are read as: the speeds that they mean tell."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.raw import GuessedUnit, RawLog, Request
from gpszip.io.values.timestamps import TIME_UNITS, numbers_to_seconds, unit_seconds
from gpszip.model.read_result import Repair

__all__ = ["check_plausible", "note_spreadsheet_days"]

#: Metres of a degree of latitude.
_DEGREE = 111_195.0

#: Steps of a window over which speeds are measured: the noise of single positions is no travel.
_WINDOW = 16

#: Metres by which a window moves at least if its speed is to count.
_MOVED = 1.0

#: Fastest speed that is no reason for doubt, in m/s: that of an aircraft.
_FASTEST = 350.0

#: Slowest speed, in m/s, that makes another reading of the times likely.
_SLOWEST = 0.01

#: A log of more than two points does not end before this many seconds.
_SHORTEST = 1e-3

#: Speeds tell of a wrong unit only where points follow each other within this many seconds: whoever has longer steps
#: and is fast may be a satellite, or several vehicles in one.
_DENSE = 0.1

#: Steps as short as this, in seconds, no receiver makes.
_TOO_DENSE = 5e-4

#: Days from 1899-12-30 to the years 1990 and 2031. Between them, modified Julian days are of times before receivers.
_SPREADSHEET = (32_874.0, 47_848.0)

#: Seconds from 1970 to the years 1980 and 2100, and of a log that counts from its own start (three years).
_RECEIVERS, _ELAPSED = (315_532_800.0, 4_102_444_800.0), 1e8

#: x and y in degrees are farther from the origin than so many times the extent of the log ...
_OFFSET = 20.0
#: ... or are spread over more than so many, 100 km; ...
_WIDE = 1.0
#: ... this extent is at least so many degrees, 100 m; ...
_EXTENT = 1e-3
#: ... most numbers of one axis have more than three decimals; ...
_DECIMALS = 3
#: ... and, read as metres, points move at less than this speed in m/s, but as degrees at one between these.
_CRAWL, _TRAVEL = 0.01, (0.3, 350.0)

#: There is no doubt where they crawl, in m/s, at less than this, which is travel of up to 120 km/h, ...
_CERTAIN_CRAWL = 3e-4
#: ... spread over so many degrees, 500 m, ...
_CERTAIN_EXTENT = 5e-3
#: ... go straight on for this share of their way in most windows, as noise does not, ...
_STRAIGHT = 0.5
#: ... and are seen every so many seconds at least: glaciers and landslides are not.
_WATCHED = 120.0

#: What messages call units whose names say little.
_SPOKEN = {"excel": "days from 1899-12-30, as spreadsheets count them", "matlab": "MATLAB's days"}

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Motion:
    """How far and how long the points of a log move, window by window.

    Parameters
    ----------
    duration : float64 array, shape (w,)
        Seconds from the first point of a window to its last.
    displacement : float64 array, shape (w,)
        Metres between these two.
    path_length : float64 array, shape (w,)
        Metres along all points between them.
    median_step : float
        Median of the seconds between points that follow each other.
    """

    duration: Floats
    displacement: Floats
    path_length: Floats
    median_step: float

    def median_speed(self, least: float = 0.0) -> float:
        """Median speed in m/s of the windows that move by more metres than the least; 0 where none does."""
        moving = (self.duration > 0) & (self.displacement > least)
        return (
            float(np.median(self.displacement[moving] / self.duration[moving]))
            if moving.any()
            else 0.0
        )


def check_plausible(raw: RawLog, request: Request) -> RawLog:
    """Check that a log's speeds are possible, and read days of a spreadsheet as such where no doubt is left.

    Nothing is doubted that the user says: a unit of times, or which columns are x and y.

    Parameters
    ----------
    raw : RawLog
        A log, or the first part of it.
    request : Request
        What the user says of times and columns.

    Returns
    -------
    RawLog
        The same, or with other times; what was changed or is to be doubted is among its repairs.

    Raises
    ------
    InputError
        If times or places are certainly something else than what they are read as.
    """
    # Points that can be used, track by track.
    good = np.isfinite(raw.times) & np.isfinite(raw.coordinates).all(axis=1)
    rows = np.flatnonzero(good)
    if len(rows) < 3:
        return raw
    if raw.codes is not None:
        rows = rows[np.argsort(raw.codes[rows], kind="stable")]
    track = np.zeros(len(rows), np.int64) if raw.codes is None else raw.codes[rows].astype(np.int64)
    times, places = raw.times[rows], raw.coordinates[rows]

    # Places, then times.
    if not raw.geographic:
        doubt = _degrees_as_metres(raw, request, times, places, track)
        return raw if doubt is None else replace(raw, repairs=(*raw.repairs, doubt))
    if (
        raw.guessed_unit is None or np.abs(places[:, 0]).max() > 90
    ):  # positions off the globe are seen to elsewhere
        return raw
    if _are_spreadsheet_days(raw.guessed_unit, times, places, track):
        return note_spreadsheet_days(
            replace(
                raw,
                times=numbers_to_seconds(raw.times, "excel"),
                guessed_unit=GuessedUnit("excel", from_name=False),
            )
        )
    _check_unit(raw, raw.guessed_unit, times, places, track)
    return raw


def note_spreadsheet_days(raw: RawLog) -> RawLog:
    """Tell that times were read as days of a spreadsheet.

    Raises
    ------
    InputError
        If some are not in the years in which there is no doubt.
    """
    low, high = numbers_to_seconds(np.array(_SPREADSHEET), "excel")
    off = ((raw.times < low) | (raw.times >= high)) & np.isfinite(raw.coordinates).all(axis=1)
    if off.any():
        row = int(off.argmax())
        raise InputError(
            f"{raw.name}: {raw.row_noun} {raw.first + row}: its time is no day of a spreadsheet as those before it; say the unit: --time-unit s"
        )
    count = int(np.isfinite(raw.times).sum())
    told = Repair(
        "times read as days from 1899-12-30, as spreadsheets count them",
        count,
        raw.name,
        drops=False,
    )
    return replace(raw, repairs=(*raw.repairs, told))


def _are_spreadsheet_days(
    guess: GuessedUnit, times: Floats, places: Floats, track: NDArray[np.int64]
) -> bool:
    """Whether numbers are days since 1899-12-30 beyond doubt: of these years, and impossible as seconds."""
    low, high = _SPREADSHEET
    if (
        guess != GuessedUnit("s", from_name=False)
        or times.min() < low
        or times.max() >= high
        or not (times % 1).any()
    ):
        return False
    as_seconds = _measure_motion(times, places, track)
    as_days = _measure_motion(numbers_to_seconds(times, "excel"), places, track)
    impossible = as_seconds.median_step < _TOO_DENSE or (
        as_seconds.median_step < _DENSE and as_seconds.median_speed(_MOVED) > _FASTEST
    )
    return impossible and as_days.median_speed(_MOVED) <= _FASTEST


def _check_unit(
    raw: RawLog, guess: GuessedUnit, times: Floats, places: Floats, track: NDArray[np.int64]
) -> None:
    """Refuse times in a unit that makes the log end at once, or everybody faster than an aircraft where another unit doesn't."""
    # Is there a reason for doubt?
    motion, span = _measure_motion(times, places, track), float(np.ptp(times))
    short = 0 < span < _SHORTEST
    fast = motion.median_step < _DENSE and motion.median_speed(_MOVED) > _FASTEST
    if not short and not fast:
        return

    # Is another unit more likely?
    values = times / unit_seconds(guess.unit)
    others = [
        unit
        for unit in TIME_UNITS
        if unit != guess.unit and _is_likely(numbers_to_seconds(values, unit), places, track)
    ]
    if not others and not short:
        return
    found = (
        f"its times last {span:.2g} s"
        if short
        else f"its points move at {motion.median_speed(_MOVED):.2g} m/s"
    )
    remedy = (
        f"if they are {_SPOKEN.get(others[0], others[0])}, say so: --time-unit {others[0]}"
        if others
        else "say the unit with --time-unit"
    )
    raise InputError(
        f"{raw.name}: read as {guess.unit}, {found}; {remedy}; if that is right: --time-unit {guess.unit}"
    )


def _is_likely(times: Floats, places: Floats, track: NDArray[np.int64]) -> bool:
    """Whether times are of the age of receivers, or count from the start of a log, and speeds are those of vehicles."""
    middle = float(np.median(times))
    dated = _RECEIVERS[0] <= middle <= _RECEIVERS[1] or abs(middle) < _ELAPSED
    return (
        dated and _SLOWEST <= _measure_motion(times, places, track).median_speed(_MOVED) <= _FASTEST
    )


def _degrees_as_metres(
    raw: RawLog, request: Request, times: Floats, places: Floats, track: NDArray[np.int64]
) -> Repair | None:
    """Doubt x and y that look like longitude and latitude; refuse them where speeds leave no doubt."""
    # What the user names x and y is x and y.
    given = set(request.columns or ())
    if len(raw.axes) < 2 or {"x", "y"} <= given:
        return None

    # The numbers are those of degrees, and lie either far from the origin or far apart.
    x, y = places[:, 0], places[:, 1]
    swapped = np.abs(y).max() > 90
    lon, lat, names = (y, x, (raw.axes[1], raw.axes[0])) if swapped else (x, y, raw.axes[:2])
    extent = max(float(np.ptp(x)), float(np.ptp(y)))
    far = max(abs(float(np.median(x))), abs(float(np.median(y)))) >= _OFFSET * extent
    wide = extent >= _WIDE
    long = any(np.mean(np.abs(axis - np.round(axis, _DECIMALS)) > 1e-9) > 0.5 for axis in (x, y))
    if (
        np.abs(lat).max() > 90
        or np.abs(lon).max() > 180
        or extent < _EXTENT
        or not long
        or not (far or wide)
    ):
        return None

    # The speeds are those of a snail, or those of travel.
    crawl = _measure_motion(times, np.stack([x, y], axis=1), track, geographic=False).median_speed()
    degrees = _measure_motion(times, np.stack([lat, lon], axis=1), track)
    moving = degrees.displacement > 0
    if not (crawl < _CRAWL and _TRAVEL[0] <= degrees.median_speed() <= _TRAVEL[1]):
        return None
    straight = (
        float(np.median(degrees.displacement[moving] / degrees.path_length[moving])) >= _STRAIGHT
    )
    if not far and not straight:
        return None

    # Refuse them or warn.
    remedy = f"--columns lon={names[0]},lat={names[1]}"
    certain = (
        crawl < _CERTAIN_CRAWL and extent >= _CERTAIN_EXTENT and degrees.median_step <= _WATCHED
    )
    if certain and straight and moving.mean() > 0.5:
        raise InputError(
            f"{raw.name}: columns {raw.axes[0]!r} and {raw.axes[1]!r} are degrees: as metres, points move at {crawl:.2g} m/s, as degrees "
            f"at {degrees.median_speed():.2g} m/s; name them: {remedy}; if they are metres: --columns x={raw.axes[0]},y={raw.axes[1]}"
        )
    what = f"positions read as metres, but they look like degrees; if they are, name them: {remedy}"
    return Repair(what, len(times), raw.name, drops=False)


def _measure_motion(
    times: Floats, places: Floats, track: NDArray[np.int64], *, geographic: bool = True
) -> _Motion:
    """Measure windows of points of one track each, in the order in which the log has them."""
    # Steps from point to point.
    steps = _distances(places[:-1], places[1:], geographic)
    same = np.diff(track) == 0
    gaps = np.diff(times)[same]

    # Windows begin and end every so many points, and where tracks do.
    first = np.flatnonzero(np.append(True, ~same))
    place_in_track = np.arange(len(times)) - np.repeat(first, np.diff(np.append(first, len(times))))
    marks = np.flatnonzero((place_in_track % _WINDOW == 0) | np.append(~same, True))
    begin, end = marks[:-1], marks[1:]
    begin, end = begin[track[begin] == track[end]], end[track[begin] == track[end]]

    way = np.append(0.0, np.cumsum(np.where(same, steps, 0.0)))
    return _Motion(
        duration=times[end] - times[begin],
        displacement=_distances(places[begin], places[end], geographic),
        path_length=way[end] - way[begin],
        median_step=float(np.median(gaps[gaps > 0])) if (gaps > 0).any() else np.inf,
    )


def _distances(places: Floats, others: Floats, geographic: bool) -> Floats:
    """Metres between places that are not far from each other."""
    difference = others[:, :2] - places[:, :2]
    if geographic:
        east = (difference[:, 1] + 180) % 360 - 180
        difference = _DEGREE * np.stack(
            [difference[:, 0], east * np.cos(np.radians(places[:, 0]))], axis=1
        )
    distances: Floats = np.hypot(difference[:, 0], difference[:, 1])
    return distances
