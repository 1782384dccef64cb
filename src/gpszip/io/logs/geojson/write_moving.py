"""Tracks written as moving features in JSON (OGC 19-045r3), in the form of prisms.

Of the three forms, movingpandas reads trajectories and prisms, and MobilityDB a MovingPoint, which
is what the ``temporalGeometry`` of a prism is. Hence positions have two numbers, as movingpandas
reads no third one, and heights are a temporal property.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, BinaryIO

from gpszip.io.logs.geojson.write import to_json_list, write_collection
from gpszip.io.logs.track_rows import TrackRows
from gpszip.io.logs.xml.writing import format_times

__all__ = ["write_mf_json"]

#: Names of the coordinate systems of positions and times.
_CRS = {"type": "Name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
_TRS = {"type": "Name", "properties": {"name": "urn:ogc:data:time:iso8601"}}


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
    write_collection(
        tracks,
        sink,
        lambda name, lines: [_moving_feature(name, line) for line in lines],
        {"crs": _CRS},
        {"trs": _TRS},
    )


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
