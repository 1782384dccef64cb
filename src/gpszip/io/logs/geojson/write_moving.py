"""Tracks written as moving features in JSON (OGC 19-045r3), in the form of prisms.

Of the three forms, movingpandas reads trajectories and prisms, and MobilityDB a MovingPoint, which
is what the ``temporalGeometry`` of a prism is. Hence positions have two numbers, as movingpandas
reads no third one, and heights are a temporal property.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, BinaryIO

from gpszip.errors import OutputError
from gpszip.io.logs.geojson.write import METRES_MEMBER, to_json_list
from gpszip.io.logs.track_rows import TrackRows, group_into_lines
from gpszip.io.logs.xml.writing import format_times

__all__ = ["write_mf_json"]

#: Names of the coordinate systems of positions and times.
_CRS = {"type": "Name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
_TRS = {"type": "Name", "properties": {"name": "urn:ogc:data:time:iso8601"}}

_EMPTY_COLLECTION = b'{"type": "FeatureCollection", "features": []}\n'


def write_mf_json(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write each piece of a track between gaps as a feature with a ``temporalGeometry``.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the globe. Metres are marked by the member ``gpszip``. Attributes
        become ``temporalProperties``. A track without times has a LineString instead.
    sink : binary file
        The file to write to.

    Raises
    ------
    OutputError
        If some tracks are in metres and some in degrees.
    """
    # Write feature by feature. The first track decides whether the collection is in metres.
    separator, geographic = b"", None
    for name, lines in group_into_lines(tracks):
        if geographic is None:
            geographic = lines[0].geographic
            members = {"crs": _CRS, "trs": _TRS} if geographic else {**METRES_MEMBER, "trs": _TRS}
            start = json.dumps({"type": "FeatureCollection", **members})[:-1]
            sink.write(f'{start}, "features": [\n'.encode())
        if geographic != lines[0].geographic:
            raise OutputError("tracks in metres and tracks in degrees can't be written together")

        for line in lines:
            feature = _moving_feature(name, line)
            sink.write(separator + json.dumps(feature, ensure_ascii=False).encode())
            separator = b",\n"

    # Without a track, no collection was begun.
    sink.write(_EMPTY_COLLECTION if geographic is None else b"\n]}\n")


def _moving_feature(name: str, line: TrackRows) -> dict[str, Any]:
    # Rows have the latitude first, GeoJSON the longitude.
    positions = (line.coordinates[:, ::-1] if line.geographic else line.coordinates).tolist()
    feature: dict[str, Any] = {"type": "Feature", "properties": {"track_id": name}}
    if line.times is None:
        kind = "LineString" if len(line) > 1 else "MultiPoint"
        return {**feature, "geometry": {"type": kind, "coordinates": positions}}

    # Positions with their times
    datetimes = format_times(line.times, name).to_pylist()
    moving = {
        "type": "MovingPoint",
        "coordinates": positions,
        "datetimes": datetimes,
        "interpolation": "Linear",
    }
    feature |= {"geometry": None, "temporalGeometry": moving}

    # Attributes at the same times
    if line.attributes:
        values = {key: {"values": to_json_list(column)} for key, column in line.attributes.items()}
        feature["temporalProperties"] = [{"datetimes": datetimes, **values}]
    return feature
