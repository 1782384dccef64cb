"""Logs of gliders and paragliders in IGC.

Fixes are lines of fixed columns with a time of day; a date stands in the header. The layout is
that of the technical specification of the FAI for flight recorders, appendix A.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.point_batches import Findings, PointBatch, open_points, read_points
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.sniff.text import IGC_FIX, decode_head
from gpszip.io.logs.text_lines import read_lines
from gpszip.io.storage.source import Source
from gpszip.io.values.arrow import to_floats

__all__ = ["read_igc", "read_igc_batches"]

#: A date: HFDTE160701 or HFDTEDATE:160701,01; O and P stand for other sources.
_DATE = re.compile(r"^H[FOP]DTE(?:DATE)?:?\s*(\d\d)(\d\d)(\d\d)")

#: Columns of a fix, from 0.
_COLUMNS = {
    "hours": (1, 3),
    "minutes": (3, 5),
    "seconds": (5, 7),
    "lat": (7, 9),
    "lat minutes": (9, 14),
    "lon": (15, 18),
    "lon minutes": (18, 23),
    "pressure_alt": (25, 30),
    "alt": (30, 35),
}
_NORTH, _EAST, _VALIDITY = 14, 23, 24

#: Thousandths of a minute in a degree.
_PER_DEGREE = 60_000.0

#: Seconds in a day.
_DAY = 86_400.0

#: Years from this one on are of the last century. The format is of 1995.
_LAST_CENTURY = 80

#: Extensions that refine a fix: digits of seconds and of minutes.
_FINER = ("TDS", "LAD", "LOD")

#: Decimals of seconds and of degrees to which refined values are rounded.
_TIME_DECIMALS = 6
_DEGREE_DECIMALS = 12

#: Extensions with a name of their own; others are kept by their code.
_NAMES = {"trt": "course", "hdt": "heading"}

#: Letters of a line that messages show.
_MAX_SHOWN_LETTERS = 40

Floats = NDArray[np.float64]


def read_igc(source: Source, request: Request) -> RawLog:
    r"""Read the fixes of a flight.

    A date holds until the next one, over midnights. Fixes that are marked V (no position, or one
    without altitude) are dropped and counted, as are lines that can't be read.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: alt (by GPS) and pressure_alt in metres, and extensions of the I record
        by their codes, such as ``fxa`` or ``enl``, as they stand in the file; TRT and HDT are
        course and heading in degrees.

    Returns
    -------
    RawLog
        One track. Times are UTC.

    Raises
    ------
    InputError
        If there is no date or no valid fix.

    Examples
    --------
    >>> text = b"HFDTE160701\nB1602405407121N00249342WA0028000421"
    >>> log = read_igc(Source("a.igc", data=text), Request(keep=("alt",)))
    >>> log.coordinates.round(6).tolist(), log.times.tolist(), log.attributes["alt"].tolist()
    ([[54.118683, -2.822367]], [995299360.0], [421.0])
    """
    return read_points(source, request, _parse)


def read_igc_batches(source: Source, request: Request) -> LogBatches:
    """Open a flight to be read in batches; see :func:`read_igc`."""
    return open_points(source, request, _parse, CoordinateKind(geographic=True, dimension=2))


def _parse(source: Source, _request: Request, findings: Findings) -> Iterator[PointBatch]:
    findings.empty = "no valid fix in this flight"
    findings.remedy = "choose another flight"
    calendar = _Calendar(_first_date(source), findings)
    extensions = _extensions(source)
    for lines in read_lines(source):
        is_fix = pc.match_substring_regex(lines, IGC_FIX)
        broken = lines.filter(pc.and_(pc.starts_with(lines, "B"), pc.invert(is_fix)))
        shown = broken[0].as_py()[:_MAX_SHOWN_LETTERS] if len(broken) else ""
        findings.count("fixes that can't be read dropped", len(broken), drops=True, value=shown)

        # Dates stand between fixes.
        rows = np.flatnonzero(is_fix.to_numpy())
        fixes = lines.filter(is_fix)
        finer = {code: _digits(fixes, *extensions[code]) for code in _FINER if code in extensions}
        seconds = _seconds_of_day(fixes, finer)
        times = calendar.to_seconds(seconds, rows, _dates_in(lines))

        # Void fixes may repeat the last position.
        is_valid = pc.equal(_slice(fixes, _VALIDITY, _VALIDITY + 1), "A").to_numpy()
        findings.count(
            "fixes marked V, without a valid position, dropped", (~is_valid).sum(), drops=True
        )
        attributes = _attributes(fixes, extensions)
        yield PointBatch(
            times[is_valid],
            _coordinates(fixes, finer)[is_valid],
            {name: values[is_valid] for name, values in attributes.items()},
        )


# Columns


def _slice(lines: Any, start: int, end: int) -> Any:
    return pc.utf8_slice_codeunits(lines, start, end)


def _numbers(lines: Any, start: int, end: int) -> Floats:
    return to_floats(pc.utf8_trim_whitespace(_slice(lines, start, end)))


def _digits(lines: Any, start: int, end: int) -> Floats:
    """Return digits after a decimal point as a fraction; 0 where there are none."""
    values = _numbers(lines, start, end) / 10.0 ** (end - start)
    return np.where((values >= 0) & (values < 1), values, 0.0)


def _seconds_of_day(fixes: Any, finer: dict[str, Floats]) -> Floats:
    """Return times of day in seconds; NaN for those that are none."""
    hours, minutes, seconds = (
        _numbers(fixes, *_COLUMNS[name]) for name in ("hours", "minutes", "seconds")
    )
    # A second that is inserted at the end of a day has the number 60.
    is_valid = (hours < 24) & (minutes < 60) & (seconds < 61)
    total = hours * 3600 + minutes * 60 + seconds + finer.get("TDS", 0.0)
    return np.where(is_valid, np.round(total, _TIME_DECIMALS), np.nan)


def _coordinates(fixes: Any, finer: dict[str, Floats]) -> Floats:
    """Return latitudes and longitudes in degrees."""
    axes = []
    for axis, side, west, more in (("lat", _NORTH, "S", "LAD"), ("lon", _EAST, "W", "LOD")):
        minutes = _numbers(fixes, *_COLUMNS[f"{axis} minutes"]) + finer.get(more, 0.0)
        degrees = _numbers(fixes, *_COLUMNS[axis]) + minutes / _PER_DEGREE
        is_negative = pc.equal(_slice(fixes, side, side + 1), west).to_numpy()
        axes.append(np.where(minutes < _PER_DEGREE, degrees, np.nan) * np.where(is_negative, -1, 1))
    return np.round(np.stack(axes, axis=1), _DEGREE_DECIMALS)


def _attributes(fixes: Any, extensions: dict[str, tuple[int, int]]) -> dict[str, Floats]:
    attributes = {name: _numbers(fixes, *_COLUMNS[name]) for name in ("alt", "pressure_alt")}
    for code, columns in extensions.items():
        if code not in _FINER:
            name = _NAMES.get(code.lower(), code.lower())
            attributes[name] = _numbers(fixes, *columns)
    return attributes


def _extensions(source: Source) -> dict[str, tuple[int, int]]:
    """Return the columns of the extensions that the first I record of a file names."""
    text = decode_head(source.head())
    record = re.search(r"^I\d\d((?:\d{4}[A-Z0-9]{3})+)", text, re.MULTILINE)
    found = re.findall(r"(\d\d)(\d\d)([A-Z0-9]{3})", record[1] if record else "")
    columns = {code: (int(start) - 1, int(end)) for start, end, code in found}
    # They follow the fix.
    first = _COLUMNS["alt"][1]
    return {code: (a, b) for code, (a, b) in columns.items() if first <= a < b}


# Dates


def _day(line: str) -> float | None:
    """Return the date of a line in days since 1970; None if it has none."""
    match = _DATE.match(line)
    if match is None:
        return None
    day, month, year = map(int, match.groups())
    century = 1900 if year >= _LAST_CENTURY else 2000
    try:
        date = np.datetime64(f"{century + year:04d}-{month:02d}-{day:02d}", "D")
    except ValueError:  # 000000, before the first fix
        return None
    return float(date.astype(np.int64))


def _dates_in(lines: Any) -> list[tuple[int, float]]:
    """Return the number of each line with a date, and the date in days since 1970."""
    rows = np.flatnonzero(pc.match_substring_regex(lines, "^H[FOP]DTE").to_numpy())
    texts = lines.take(pa.array(rows)).to_pylist()
    days = [(row, _day(text)) for row, text in zip(rows.tolist(), texts, strict=True)]
    return [(row, day) for row, day in days if day is not None]


def _first_date(source: Source) -> float:
    """Return the first date of a file."""
    for lines in read_lines(source):
        for _, day in _dates_in(lines):
            return day
    raise InputError(
        "no date (HFDTE) in this flight",
        path=source.name,
        remedy="add a line HFDTEDDMMYY, day, month and year, before the fixes",
    )


@dataclass
class _Calendar:
    """Turns seconds of the day into seconds since 1970.

    Midnights are counted: each time of day that steps back by more than half a day begins a new
    day. A date holds from the next fix on.

    Parameters
    ----------
    date : float
        Days since 1970 of the date that holds.
    findings : Findings
        Counts fixes before the first date.
    """

    date: float
    findings: Findings
    _has_date: bool = False
    _midnights: int = 0
    _last: float = np.nan
    _waiting: list[tuple[int, float]] = field(default_factory=list)

    def to_seconds(
        self, seconds: Floats, rows: NDArray[np.intp], dates: list[tuple[int, float]]
    ) -> Floats:
        """Return the times of the next fixes.

        Parameters
        ----------
        seconds : float64 array, shape (n,)
            Times of day; NaN for those that can't be read.
        rows : int array, shape (n,)
            Number of the line of each fix.
        dates : list of (int, float)
            Number of the line of each date, and the date.
        """
        # Count midnights between times that can be read.
        readable = np.isfinite(seconds)
        steps = np.diff(seconds[readable], prepend=self._last)
        midnights = np.zeros(len(seconds), np.int64)
        midnights[readable] = steps < -_DAY / 2
        midnights = self._midnights + np.cumsum(midnights)

        # A date holds from the fix after it on, which may be in the next lines.
        days = np.empty(len(seconds))
        dates = [*self._waiting, *dates]
        starts = np.searchsorted(rows, [row for row, _ in dates]).tolist()
        if not self._has_date:
            before = starts[0] if starts else len(rows)
            self.findings.count("fixes before the first date, which dates them, kept", before)
        days[: starts[0] if starts else None] = self.date
        for start, (_, date) in zip(starts, dates, strict=True):
            if start < len(rows):
                self.date = date - midnights[start]
                days[start:] = self.date
        self._waiting = [
            (-1, date) for start, (_, date) in zip(starts, dates, strict=True) if start == len(rows)
        ][-1:]

        # Keep the state for the next fixes.
        self._has_date = self._has_date or bool(dates)
        self._midnights = int(midnights[-1]) if len(midnights) else self._midnights
        self._last = float(seconds[readable][-1]) if readable.any() else self._last
        return np.asarray((days + midnights) * _DAY + seconds)
