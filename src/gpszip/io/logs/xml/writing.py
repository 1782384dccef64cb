"""Texts of tracks for formats in XML: names, times and heights."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.io.logs.raw import HEIGHT_NAMES
from gpszip.io.logs.track_rows import TrackRows, round_decimals

__all__ = [
    "describe_changed_names",
    "escape_xml",
    "format_heights",
    "format_times",
    "has_unwritable_letters",
    "height_name",
    "require_degrees",
]

#: Seconds from 1970 to the year 1, the first that a date can name.
_YEAR_1 = -62_135_596_800

#: Seconds from 1970 to the year 10000, the first that a date can't name.
_YEAR_10000 = 253_402_300_800

#: Decimals of heights in metres.
_HEIGHT_DECIMALS = 3

#: Letters that XML 1.0 can't hold, not even as a reference.
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def has_unwritable_letters(name: str) -> bool:
    r"""Whether a name has letters that XML 1.0 can't hold, not even escaped.

    These are most control characters, U+FFFE and U+FFFF.

    Examples
    --------
    >>> has_unwritable_letters("walk <1> & \U0001f6b6"), has_unwritable_letters("bell \a")
    (False, True)
    """
    return _NOT_XML.search(name) is not None


def escape_xml(text: str) -> str:
    r"""Return a text for an element or an attribute in double quotes.

    Letters that XML can't hold become the replacement character U+FFFD.

    Examples
    --------
    >>> escape_xml('<1> & "\r"')
    '&lt;1&gt; &amp; &quot;&#13;&quot;'
    """
    # Parsers turn a plain carriage return into a line feed.
    return escape(_NOT_XML.sub("\ufffd", text), {"\r": "&#13;", '"': "&quot;"})


def describe_changed_names(format_name: str, names: Sequence[str]) -> list[str]:
    """Describe the names that XML can't hold; an empty list if it can hold all.

    Examples
    --------
    >>> describe_changed_names("gpx", ["walk"])
    []
    """
    # XML 1.0 can't hold most control characters, not even as references.
    changed = [name for name in names if has_unwritable_letters(name)]
    if not changed:
        return []
    return [
        f"{format_name} can't hold control characters: they are U+FFFD in the names of tracks, in "
        f"{len(changed):,} of them, the first {changed[0]!r}; "
        "write GeoJSON or Parquet to have them"
    ]


def require_degrees(line: TrackRows, format_name: str) -> None:
    """Refuse a track in x and y, which the format can't hold.

    Raises
    ------
    OutputError
        If it isn't in degrees.
    """
    if not line.geographic:
        raise OutputError(
            f"{format_name} holds latitudes and longitudes, but this log is in x and y",
            remedy="write CSV, Parquet or GeoJSON",
        )


def format_times(times: NDArray[np.float64], track: str) -> Any:
    """Return times as dates of ISO 8601 in UTC, as Arrow texts.

    They have milliseconds if that is all that the times have, else microseconds.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds since 1970, increasing.
    track : str
        Name of the track, for the message.

    Raises
    ------
    OutputError
        If a time can't be a date.

    Examples
    --------
    >>> format_times(np.array([0.0, 1.5]), "walk").to_pylist()
    ['1970-01-01T00:00:00.000Z', '1970-01-01T00:00:01.500Z']
    """
    if times[0] < _YEAR_1 or times[-1] >= _YEAR_10000:
        raise OutputError(
            "times outside the years 1 to 9999 can't be dates",
            location=f"track {track!r}",
            remedy="write CSV",
        )

    # Seconds (%S) are written with as many decimals as the unit of the timestamps has.
    if np.array_equal(round_decimals(times, 3), times):
        unit, per_second = "ms", 1e3
    else:
        unit, per_second = "us", 1e6
    ticks = np.rint(times * per_second).astype(np.int64)
    return pc.strftime(pa.array(ticks, pa.timestamp(unit, "UTC")), "%Y-%m-%dT%H:%M:%SZ")


def height_name(attributes: Sequence[str]) -> str | None:
    """Return the attribute that is the height above the sea; None if there is none.

    Examples
    --------
    >>> height_name(["speed", "ele"]), height_name(["speed"])
    ('ele', None)
    """
    return next((name for name in HEIGHT_NAMES if name in attributes), None)


def format_heights(heights: NDArray[np.generic]) -> Any:
    """Return heights in metres as Arrow texts, null for those that are not known.

    Examples
    --------
    >>> format_heights(np.array([1.23456, np.nan])).to_pylist()
    ['1.235', None]
    """
    numbers = heights.astype(np.float64)
    texts = pc.cast(pa.array(round_decimals(numbers, _HEIGHT_DECIMALS)), pa.string())
    return pc.if_else(pa.array(np.isfinite(numbers)), texts, None)
