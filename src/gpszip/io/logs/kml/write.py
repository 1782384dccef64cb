"""Tracks written as KML 2.2 with Google's extension ``gx:Track``, and as KMZ."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.io.logs.track_rows import TrackRows, group_into_lines
from gpszip.io.logs.xml.writing import (
    describe_changed_names,
    escape_xml,
    format_heights,
    format_times,
    height_name,
    require_degrees,
)

__all__ = ["describe_kml_losses", "write_kml", "write_kmz"]

#: Identifier of the schema that lists the columns.
_SCHEMA = "columns"

#: Types of KML for the kinds of NumPy's types; text for all others.
_TYPES = {"i": "int", "u": "uint", "f": "double", "b": "bool"}

#: The time that the file in a KMZ archive has, the first that zip can name: the same tracks give
#: the same bytes.
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)

_START = (
    b'<?xml version="1.0" encoding="UTF-8"?>\n'
    b'<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">\n'
    b"<Document>\n"
)


def write_kml(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write each track as a placemark with a ``gx:Track``, and each shape as one with a LineString.

    A track of several gap-free pieces is a ``gx:MultiTrack``, which tells readers not to connect
    them; a shape of several is a MultiGeometry. A track that crosses the antimeridian is cut there.
    Times count from 1970. Letters that XML can't hold are written as U+FFFD.

    Parameters
    ----------
    tracks : iterable of TrackRows
        On the globe. The first attribute that is a height is the third number of positions; those
        of tracks are ``SimpleArrayData`` besides. Shapes have no further attributes.
    sink : binary file
        The file to write to.

    Raises
    ------
    OutputError
        If a track is in x and y, or its times can't be dates.
    """
    sink.write(_START)
    has_schema = False
    for name, lines in group_into_lines(tracks):
        # All tracks have the same columns, which the schema lists before the first one.
        columns = _columns(lines[0])
        if columns and not has_schema:
            sink.write(_schema(columns).encode())
            has_schema = True

        # One geometry for all lines.
        sink.write(f"<Placemark><name>{escape_xml(name)}</name>\n".encode())
        before, after = _group(lines)
        sink.write(before)
        for line in lines:
            require_degrees(line, "KML")
            _write_line(line, sink)
        sink.write(after + b"</Placemark>\n")
    sink.write(b"</Document>\n</kml>\n")


def write_kmz(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write tracks as KMZ: a zip archive with the KML file ``doc.kml``.

    Parameters
    ----------
    tracks, sink
        As for :func:`write_kml`.

    Raises
    ------
    OutputError
        If a track is in x and y, or its times can't be dates.
    """
    member = zipfile.ZipInfo("doc.kml", _ZIP_TIME)
    member.compress_type = zipfile.ZIP_DEFLATED
    with (
        zipfile.ZipFile(sink, "w") as archive,
        archive.open(member, "w", force_zip64=True) as file,
    ):
        write_kml(tracks, file)  # type: ignore[arg-type]


def describe_kml_losses(names: Sequence[str], _attributes: Sequence[str]) -> list[str]:
    """Describe what KML can't hold of tracks.

    Parameters
    ----------
    names : sequence of str
        Names of the tracks.

    Examples
    --------
    >>> describe_kml_losses(["walk"], ["ele", "speed"])
    []
    """
    return describe_changed_names("kml", names)


def _columns(line: TrackRows) -> Mapping[str, NDArray[np.generic]]:
    """Return the attributes that are arrays of a track."""
    if line.times is None:
        return {}
    height = height_name(list(line.attributes))
    return {name: values for name, values in line.attributes.items() if name != height}


def _schema(columns: Mapping[str, NDArray[np.generic]]) -> str:
    fields = "".join(
        f'<gx:SimpleArrayField name="{escape_xml(name)}" '
        f'type="{_TYPES.get(values.dtype.kind, "string")}"/>'
        for name, values in columns.items()
    )
    return f'<Schema id="{_SCHEMA}">{fields}</Schema>\n'


def _group(lines: Sequence[TrackRows]) -> tuple[bytes, bytes]:
    """Return what comes before and after the lines of a placemark, if there are several."""
    if len(lines) == 1:
        return b"", b""
    if lines[0].times is None:
        return b"<MultiGeometry>\n", b"</MultiGeometry>\n"
    return b"<gx:MultiTrack><gx:interpolate>0</gx:interpolate>\n", b"</gx:MultiTrack>\n"


def _write_line(line: TrackRows, sink: BinaryIO) -> None:
    """Write a track, or a shape."""
    # A shape is one text of positions.
    has_heights = height_name(list(line.attributes)) is not None
    mode = "<altitudeMode>absolute</altitudeMode>" if has_heights else ""
    if line.times is None:
        positions = "\n".join(_positions(line, ",").to_pylist())
        text = f"<LineString>{mode}<coordinates>\n{positions}\n</coordinates></LineString>\n"
        sink.write(text.encode())
        return

    # Times, then positions, then arrays: the order that the schema of KML asks for.
    sink.write(f"<gx:Track>{mode}\n".encode())
    for element, texts in (
        ("when", format_times(line.times, line.track)),
        ("gx:coord", _positions(line, " ")),
    ):
        _write_elements(element, texts, sink)
    _write_arrays(line, sink)
    sink.write(b"</gx:Track>\n")


def _positions(line: TrackRows, separator: str) -> Any:
    """Return longitude, latitude, and the height if it is known, as Arrow texts."""
    lat, lon = (pc.cast(pa.array(axis), pa.string()) for axis in line.coordinates.T)
    height = height_name(list(line.attributes))
    if height is None:
        return pc.binary_join_element_wise(lon, lat, separator)
    heights = format_heights(line.attributes[height])
    return pc.binary_join_element_wise(lon, lat, heights, separator, null_handling="skip")


def _write_arrays(line: TrackRows, sink: BinaryIO) -> None:
    """Write the attributes, with a value for each position."""
    columns = _columns(line)
    if not columns:
        return
    sink.write(f'<ExtendedData><SchemaData schemaUrl="#{_SCHEMA}">\n'.encode())
    for name, values in columns.items():
        sink.write(f'<gx:SimpleArrayData name="{escape_xml(name)}">\n'.encode())
        _write_elements("gx:value", pa.array(_texts(values), pa.string()), sink)
        sink.write(b"</gx:SimpleArrayData>\n")
    sink.write(b"</SchemaData></ExtendedData>\n")


def _write_elements(element: str, texts: Any, sink: BinaryIO) -> None:
    """Write an element for each text, one a line."""
    elements = pc.binary_join_element_wise(f"<{element}>", texts, f"</{element}>\n", "")
    sink.write("".join(elements.to_pylist()).encode())


def _texts(values: NDArray[np.generic]) -> list[str]:
    """Return values as texts; a number that is not known has none."""
    if values.dtype.kind in "fiub":
        return ["" if value != value else str(value) for value in values.tolist()]  # noqa: PLR0124
    return [escape_xml(str(value)) for value in values.tolist()]
