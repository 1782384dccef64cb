"""GeoJSON as a log format."""

from __future__ import annotations

from gpszip.io.logs.geojson.read import read_geojson, sniff_geojson
from gpszip.io.logs.geojson.write import write_geojson
from gpszip.io.logs.log_format import LogFormat

__all__ = ["GEOJSON"]

GEOJSON = LogFormat(
    name="geojson",
    suffixes=(".geojson", ".json"),
    description=(
        "LineStrings with coordTimes or times, or as shapes; Points with a time; "
        "one on each line, too"
    ),
    sniff=sniff_geojson,
    read=read_geojson,
    write=write_geojson,
)
