"""Tracks written as GPX, with times to the millisecond."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, BinaryIO
from xml.sax.saxutils import escape

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.geo.planes import to_geographic
from gpszip.io.track_table import DEGREE_DIGITS, decimal
from gpszip.model import Track

__all__ = ["HEIGHTS", "write_gpx"]

#: What the height above the sea is called; GPX has room for one such column.
HEIGHTS = ("alt", "altitude", "ele", "elevation", "height")
_YEAR_1, _YEAR_10000 = -62_135_596_800_000, 253_402_300_800_000  # milliseconds


def write_gpx(tracks: Iterable[Track], sink: BinaryIO, decimals: int) -> None:
    """Write each track as a ``trk`` of one segment; times count from 1970.

    Parameters
    ----------
    tracks : iterable of Track
        On the earth; an attribute ``ele`` or ``alt`` is kept.
    sink : binary file
        Where to.
    decimals : int
        Of metres; degrees have five more, seconds have three.

    Raises
    ------
    OutputError
        If a track is in x and y.
    """
    sink.write(b'<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="GPSZip" xmlns="http://www.topografix.com/GPX/1/1">\n')
    for track in tracks:
        if track.plane is None:
            raise OutputError("GPX holds latitudes and longitudes, but this log is in x and y; write CSV, Parquet or GeoJSON")
        sink.write(f"<trk><name>{_xml(track.id)}</name><trkseg>\n".encode())
        lines = _trackpoints(track, decimals + DEGREE_DIGITS)
        sink.write("\n".join(lines.to_pylist()).encode())
        sink.write(b"\n</trkseg></trk>\n")
    sink.write(b"</gpx>\n")


def _xml(text: str) -> str:
    return escape("".join(letter for letter in text if letter >= " " or letter in "\t\n\r"), {"\r": "&#13;"})


def _trackpoints(track: Track, digits: int) -> Any:
    lat, lon = to_geographic(track.positions[:, :2], track.plane)  # type: ignore[arg-type]
    milliseconds = np.rint(track.times * 1000)
    if milliseconds[0] < _YEAR_1 or milliseconds[-1] >= _YEAR_10000:
        raise OutputError(f"track {track.id!r}: times outside the years 1 to 9999 can't be dates; write CSV")
    when = pc.strftime(pa.array(milliseconds.astype(np.int64), pa.timestamp("ms", "UTC")), "%Y-%m-%dT%H:%M:%SZ")
    parts = ['<trkpt lat="', _digits(lat, digits), '" lon="', _digits(lon, digits), '">', *_ele(track), "<time>", when, "</time></trkpt>"]
    return pc.binary_join_element_wise(*parts, "")


def _digits(degrees: NDArray[np.float64], digits: int) -> Any:
    return pc.cast(pa.array(decimal(degrees, digits)), pa.string())


def _ele(track: Track) -> list[Any]:
    heights = next((track.attributes[name] for name in HEIGHTS if name in track.attributes), None)
    if heights is None:
        return []
    known = pa.array(np.isfinite(heights.astype(np.float64)))
    text = pc.binary_join_element_wise("<ele>", pc.cast(pa.array(decimal(heights.astype(np.float64), 3)), pa.string()), "</ele>", "")
    return [pc.if_else(known, text, "")]
