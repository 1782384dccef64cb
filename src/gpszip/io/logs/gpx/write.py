"""Tracks written as GPX 1.1."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, BinaryIO
from xml.sax.saxutils import escape

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gpszip.errors import OutputError
from gpszip.io.logs.raw import HEIGHT_NAMES
from gpszip.io.logs.track_rows import TrackRows, group_into_lines, round_decimals

__all__ = ["describe_gpx_losses", "has_unwritable_letters", "write_gpx"]

#: Seconds from 1970 to the year 1, the first that a date can name.
_YEAR_1 = -62_135_596_800

#: Seconds from 1970 to the year 10000, the first that a date can't name.
_YEAR_10000 = 253_402_300_800

#: Decimals of heights in metres.
_HEIGHT_DECIMALS = 3

#: Letters that XML 1.0 can't hold, not even as a reference.
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_START = (
    b'<?xml version="1.0" encoding="UTF-8"?>\n'
    b'<gpx version="1.1" creator="GPSZip" xmlns="http://www.topografix.com/GPX/1/1">\n'
)


def write_gpx(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write each track as a ``trk``, with a ``trkseg`` for each gap-free piece.

    A track that crosses the antimeridian begins a new segment there. Times count from 1970; points
    of tracks without times have no ``time``. Letters that XML can't hold, see
    :func:`has_unwritable_letters`, are written as the replacement character U+FFFD.

    Parameters
    ----------
    tracks : iterable of TrackRows
        On the globe; the first attribute that is a height is written as ``ele``.
    sink : binary file
        The file to write to.

    Raises
    ------
    OutputError
        If a track is in x and y, or its times can't be dates.
    """
    sink.write(_START)
    for name, lines in group_into_lines(tracks):
        sink.write(f"<trk><name>{_xml(name)}</name>".encode())
        for line in lines:
            if not line.geographic:
                raise OutputError(
                    "GPX holds latitudes and longitudes, but this log is in x and y",
                    remedy="write CSV, Parquet or GeoJSON",
                )
            sink.write(b"<trkseg>\n")
            sink.write("\n".join(_trackpoints(line).to_pylist()).encode())
            sink.write(b"\n</trkseg>")
        sink.write(b"</trk>\n")
    sink.write(b"</gpx>\n")


def describe_gpx_losses(names: Sequence[str], attributes: Sequence[str]) -> list[str]:
    """Describe what GPX can't hold of tracks.

    Parameters
    ----------
    names : sequence of str
        Names of the tracks.
    attributes : sequence of str
        Names of their attributes.

    Examples
    --------
    >>> describe_gpx_losses(["walk"], ["ele", "speed"])
    ["gpx can't hold speed; write CSV, GeoJSON or Parquet to have them"]
    """
    losses = []

    # There is an element for one column of heights only.
    heights = [name for name in HEIGHT_NAMES if name in attributes]
    missing = [name for name in attributes if name not in heights[:1]]
    if missing:
        losses.append(
            f"gpx can't hold {', '.join(missing)}; write CSV, GeoJSON or Parquet to have them"
        )

    # XML 1.0 can't hold most control characters, not even as references.
    changed = [name for name in names if has_unwritable_letters(name)]
    if changed:
        losses.append(
            "gpx can't hold control characters: they are U+FFFD in the names of tracks, in "
            f"{len(changed):,} of them, the first {changed[0]!r}; "
            "write GeoJSON or Parquet to have them"
        )
    return losses


def has_unwritable_letters(name: str) -> bool:
    r"""Whether a name has letters that XML 1.0 can't hold, not even escaped.

    These are most control characters, U+FFFE and U+FFFF.

    Examples
    --------
    >>> has_unwritable_letters("walk <1> & \U0001f6b6"), has_unwritable_letters("bell \a")
    (False, True)
    """
    return _NOT_XML.search(name) is not None


def _xml(text: str) -> str:
    # Parsers turn a plain carriage return into a line feed.
    return escape(_NOT_XML.sub("\ufffd", text), {"\r": "&#13;"})


def _trackpoints(line: TrackRows) -> Any:
    """Return the elements of the points, as Arrow texts."""
    lat, lon = (pc.cast(pa.array(axis), pa.string()) for axis in line.coordinates.T)
    return pc.binary_join_element_wise(
        '<trkpt lat="', lat, '" lon="', lon, '">', *_heights(line), *_times(line), "</trkpt>", ""
    )


def _times(line: TrackRows) -> list[Any]:
    """Return the pieces of the element ``time``.

    Dates have milliseconds if that is all that the times have, else microseconds.
    """
    if line.times is None:
        return []
    if line.times[0] < _YEAR_1 or line.times[-1] >= _YEAR_10000:
        raise OutputError(
            "times outside the years 1 to 9999 can't be dates",
            location=f"track {line.track!r}",
            remedy="write CSV",
        )

    # Seconds (%S) are written with as many decimals as the unit of the timestamps has.
    if np.array_equal(round_decimals(line.times, 3), line.times):
        unit, per_second = "ms", 1e3
    else:
        unit, per_second = "us", 1e6
    ticks = np.rint(line.times * per_second).astype(np.int64)
    timestamps = pa.array(ticks, pa.timestamp(unit, "UTC"))
    return ["<time>", pc.strftime(timestamps, "%Y-%m-%dT%H:%M:%SZ"), "</time>"]


def _heights(line: TrackRows) -> list[Any]:
    """Return the element ``ele``, an empty text for a height that is not known."""
    name = next((name for name in HEIGHT_NAMES if name in line.attributes), None)
    if name is None:
        return []
    heights = line.attributes[name].astype(np.float64)
    rounded = pc.cast(pa.array(round_decimals(heights, _HEIGHT_DECIMALS)), pa.string())
    elements = pc.binary_join_element_wise("<ele>", rounded, "</ele>", "")
    return [pc.if_else(pa.array(np.isfinite(heights)), elements, "")]
