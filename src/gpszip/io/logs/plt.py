"""Track files of OziExplorer (.plt), as those of GeoLife.

Six header lines are followed by points: latitude, longitude, whether a section begins, altitude in
feet, and the time as days since 1899-12-30, mostly with a date and a time of day beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.point_batches import Findings, PointBatch, open_points, read_points
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.text_lines import read_lines
from gpszip.io.storage.source import Source
from gpszip.io.values.arrow import to_floats

__all__ = ["read_plt", "read_plt_batches"]

#: Lines before the points.
_HEADER_LINES = 6

#: The names of WGS 84, without spaces and hyphens.
_WGS_84 = ("WGS84", "WGS1984")

#: A point. Altitude and times may be missing.
_POINT = (
    r"^\s*(?P<lat>[^,]*),\s*(?P<lon>[^,]*),[^,]*(?:,\s*(?P<alt>[^,]*))?(?:,\s*(?P<days>[^,]*))?"
    r"(?:,\s*(?P<date>[^,]*))?(?:,\s*(?P<clock>[^,]*))?"
)

#: A date and time of day that can be read without knowing the language.
_DATE = r"^\d{4}-\d\d-\d\d \d\d:\d\d:\d\d$"

#: Metres in a foot.
_FOOT = 0.3048

#: The altitude in feet of a point without one.
_NO_ALTITUDE = -777

#: Days from 1899-12-30 to 1970.
_EPOCH = 25_569

#: Seconds in a day.
_DAY = 86_400.0

#: Decimals of seconds to which days are rounded: they have seven or ten decimals.
_TIME_DECIMALS = 3

#: Decimals of metres.
_METRE_DECIMALS = 4

#: Letters of a line that messages show.
_MAX_SHOWN_LETTERS = 40

Floats = NDArray[np.float64]


def read_plt(source: Source, request: Request) -> RawLog:
    r"""Read the points of a track file.

    The time is that of the date and time of day if these are written as in GeoLife, else the days
    since 1899-12-30, to a millisecond. Times count as UTC.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Attributes to keep: alt in metres, NaN where the file says -777 feet.

    Returns
    -------
    RawLog
        One track. Lines that can't be read are not in it, but counted.

    Raises
    ------
    InputError
        If the datum is not WGS 84, or there is no point.

    Examples
    --------
    >>> text = b"Geolife trajectory\nWGS 84\nAltitude is in Feet\nReserved 3\n0\n0\n"
    >>> text += b"40.0083,116.3198,0,492,39745.0902662037,2008-10-24,02:09:59\n"
    >>> log = read_plt(Source("a.plt", data=text), Request(keep=("alt",)))
    >>> log.times.tolist(), log.coordinates.tolist(), log.attributes["alt"].tolist()
    ([1224814199.0], [[40.0083, 116.3198]], [149.9616])
    """
    return read_points(source, request, _parse)


def read_plt_batches(source: Source, request: Request) -> LogBatches:
    """Open a track file to be read in batches; see :func:`read_plt`."""
    return open_points(source, request, _parse, CoordinateKind(geographic=True, dimension=2))


def _parse(source: Source, _request: Request, findings: Findings) -> Iterator[PointBatch]:
    findings.empty = "no point in this track file"
    to_skip = _HEADER_LINES
    for number, lines in enumerate(read_lines(source)):
        if number == 0:
            _check_datum(lines, source.name)

        # Pass over the header.
        rows = lines.slice(min(to_skip, len(lines)))
        to_skip -= len(lines) - len(rows)

        # Lines without a comma are no points.
        rows = rows.filter(pc.not_equal(pc.utf8_trim_whitespace(rows), ""))
        cells = pc.extract_regex(rows, _POINT)
        broken = rows.filter(cells.is_null())
        shown = broken[0].as_py()[:_MAX_SHOWN_LETTERS] if len(broken) else ""
        findings.count("lines that can't be read dropped", len(broken), drops=True, value=shown)

        # Read the others.
        cells = cells.filter(cells.is_valid())
        yield _batch(
            {
                name: pc.struct_field(cells, name)
                for name in ("lat", "lon", "alt", "days", "date", "clock")
            }
        )


def _check_datum(lines: Any, where: str) -> None:
    datum = lines[1].as_py().split(",")[0].strip() if len(lines) > 1 else ""
    if datum.upper().replace(" ", "").replace("-", "") not in _WGS_84:
        raise InputError(
            f"its datum is {datum[:_MAX_SHOWN_LETTERS]!r}, not WGS 84",
            path=where,
            location="line 2",
            remedy="convert it: gpsbabel -i ozi -f FILE -o gpx -F FILE.gpx",
        )


def _batch(cells: dict[str, Any]) -> PointBatch:
    """Read the cells of points."""
    numbers = {
        name: to_floats(pc.utf8_trim_whitespace(cells[name]))
        for name in ("lat", "lon", "alt", "days")
    }
    alt = np.where(numbers["alt"] == _NO_ALTITUDE, np.nan, numbers["alt"]) * _FOOT
    coordinates = np.stack([numbers["lat"], numbers["lon"]], axis=1)
    attributes: dict[str, NDArray[np.generic]] = {"alt": np.round(alt, _METRE_DECIMALS)}
    return PointBatch(_seconds(cells, numbers["days"]), coordinates, attributes)


def _seconds(cells: dict[str, Any], days: Floats) -> Floats:
    """Return times in seconds since 1970; NaN for those that are none."""
    # A day of 0 or less stands for no time.
    since_1970 = np.round((days - _EPOCH) * _DAY, _TIME_DECIMALS)
    from_days = np.where(days > 0, since_1970, np.nan)

    # Dates and times of day have whole seconds.
    date, clock = (pc.utf8_trim_whitespace(cells[name]) for name in ("date", "clock"))
    texts = pc.binary_join_element_wise(date, clock, " ")
    texts = pc.if_else(pc.match_substring_regex(texts, _DATE), texts, None)
    times = pc.strptime(texts, format="%Y-%m-%d %H:%M:%S", unit="s", error_is_null=True)
    dated = to_floats(pc.cast(times, pa.int64()))
    return np.where(np.isfinite(dated), dated, from_days)
