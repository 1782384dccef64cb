"""Tracks written as GPX."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, BinaryIO
from xml.sax.saxutils import escape

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gpszip.errors import OutputError
from gpszip.io.logs.track_rows import TrackRows, group_into_lines, round_decimals

__all__ = ["HEIGHT_NAMES", "has_unwritable_letters", "write_gpx"]

#: What the height above the sea is called; GPX has room for one such column.
HEIGHT_NAMES = ("alt", "altitude", "ele", "elevation", "height")

#: Seconds since 1970 of the first day that a date can name, and of the first one that it can't.
_YEAR_1, _YEAR_10000 = -62_135_596_800, 253_402_300_800
#: Letters that XML 1.0 can't hold, not even as a reference.
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_gpx(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write each track as a ``trk``, with a ``trkseg`` for each piece between gaps; times count from 1970.

    A track that crosses the antimeridian begins a new segment there. Points of tracks without times have no ``time``. Letters
    that XML can't hold, see :func:`has_unwritable_letters`, are written as the replacement character U+FFFD.

    Parameters
    ----------
    tracks : iterable of TrackRows
        On the earth; an attribute ``ele`` or ``alt`` is kept.
    sink : binary file
        Where to.

    Raises
    ------
    OutputError
        If a track is in x and y, or its times can't be dates.
    """
    sink.write(
        b'<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="GPSZip" xmlns="http://www.topografix.com/GPX/1/1">\n'
    )
    for name, lines in group_into_lines(tracks):
        sink.write(f"<trk><name>{_xml(name)}</name>".encode())
        for line in lines:
            if not line.geographic:
                raise OutputError(
                    "GPX holds latitudes and longitudes, but this log is in x and y; write CSV, Parquet or GeoJSON"
                )
            sink.write(b"<trkseg>\n")
            sink.write("\n".join(_trackpoints(line).to_pylist()).encode())
            sink.write(b"\n</trkseg>")
        sink.write(b"</trk>\n")
    sink.write(b"</gpx>\n")


def has_unwritable_letters(name: str) -> bool:
    r"""Whether a name has letters that XML 1.0 can't hold, not even escaped: most control characters, and two others.

    Examples
    --------
    >>> has_unwritable_letters("walk <1> & \U0001f6b6"), has_unwritable_letters("bell \a")
    (False, True)
    """
    return _NOT_XML.search(name) is not None


def _xml(text: str) -> str:
    return escape(_NOT_XML.sub("\ufffd", text), {"\r": "&#13;"})


def _trackpoints(line: TrackRows) -> Any:
    lat, lon = (pc.cast(pa.array(axis), pa.string()) for axis in line.coordinates.T)
    return pc.binary_join_element_wise(
        '<trkpt lat="', lat, '" lon="', lon, '">', *_ele(line), *_time(line), "</trkpt>", ""
    )


def _time(line: TrackRows) -> list[Any]:
    """Dates in milliseconds where these are all that times have, else in microseconds."""
    if line.times is None:
        return []
    if line.times[0] < _YEAR_1 or line.times[-1] >= _YEAR_10000:
        raise OutputError(
            f"track {line.track!r}: times outside the years 1 to 9999 can't be dates; write CSV"
        )
    unit, per_second = (
        ("ms", 1e3) if np.array_equal(round_decimals(line.times, 3), line.times) else ("us", 1e6)
    )
    instants = pa.array(
        np.rint(line.times * per_second).astype(np.int64), pa.timestamp(unit, "UTC")
    )
    return ["<time>", pc.strftime(instants, "%Y-%m-%dT%H:%M:%SZ"), "</time>"]


def _ele(line: TrackRows) -> list[Any]:
    heights = next(
        (line.attributes[name] for name in HEIGHT_NAMES if name in line.attributes), None
    )
    if heights is None:
        return []
    known = pa.array(np.isfinite(heights.astype(np.float64)))
    text = pc.binary_join_element_wise(
        "<ele>",
        pc.cast(pa.array(round_decimals(heights.astype(np.float64), 3)), pa.string()),
        "</ele>",
        "",
    )
    return [pc.if_else(known, text, "")]
