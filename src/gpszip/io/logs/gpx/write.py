"""Tracks written as GPX 1.1."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.compute as pc

from gpszip.io.logs.track_rows import TrackRows, group_into_lines
from gpszip.io.logs.xml.writing import (
    describe_changed_names,
    escape_xml,
    format_heights,
    format_times,
    height_name,
    require_degrees,
)

__all__ = ["describe_gpx_losses", "write_gpx"]

_START = (
    b'<?xml version="1.0" encoding="UTF-8"?>\n'
    b'<gpx version="1.1" creator="GPSZip" xmlns="http://www.topografix.com/GPX/1/1">\n'
)


def write_gpx(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write each track as a ``trk``, with a ``trkseg`` for each gap-free piece.

    A track that crosses the antimeridian begins a new segment there. Times count from 1970; points
    of tracks without times have no ``time``. Letters that XML can't hold, see
    :func:`gpszip.io.logs.xml.writing.has_unwritable_letters`, are written as the replacement
    character U+FFFD.

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
        sink.write(f"<trk><name>{escape_xml(name)}</name>".encode())
        for line in lines:
            require_degrees(line, "GPX")
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
    ["gpx can't hold speed; write CSV, KML, GeoJSON or Parquet to have them"]
    """
    losses = []

    # There is an element for one column of heights only.
    height = height_name(attributes)
    missing = [name for name in attributes if name != height]
    if missing:
        losses.append(
            f"gpx can't hold {', '.join(missing)}; write CSV, KML, GeoJSON or Parquet to have them"
        )
    return [*losses, *describe_changed_names("gpx", names)]


def _trackpoints(line: TrackRows) -> Any:
    """Return the elements of the points, as Arrow texts."""
    lat, lon = (pc.cast(pa.array(axis), pa.string()) for axis in line.coordinates.T)
    return pc.binary_join_element_wise(
        '<trkpt lat="', lat, '" lon="', lon, '">', *_heights(line), *_times(line), "</trkpt>", ""
    )


def _times(line: TrackRows) -> list[Any]:
    """Return the pieces of the element ``time``."""
    if line.times is None:
        return []
    return ["<time>", format_times(line.times, line.track), "</time>"]


def _heights(line: TrackRows) -> list[Any]:
    """Return the element ``ele``, an empty text for a height that is not known."""
    name = height_name(list(line.attributes))
    if name is None:
        return []
    heights = format_heights(line.attributes[name])
    # The element is null where the height is.
    elements = pc.binary_join_element_wise("<ele>", heights, "</ele>", "")
    return [pc.fill_null(elements, "")]
