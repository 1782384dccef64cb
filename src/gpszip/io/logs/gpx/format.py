"""GPX as a log format."""

from __future__ import annotations

from gpszip.io.logs.gpx.read import read_gpx, sniff_gpx
from gpszip.io.logs.gpx.write import describe_gpx_losses, write_gpx
from gpszip.io.logs.log_format import LogFormat

__all__ = ["GPX"]

GPX = LogFormat(
    name="gpx",
    suffixes=(".gpx",),
    description="tracks and routes; extensions with --keep",
    sniff=sniff_gpx,
    read=read_gpx,
    write=write_gpx,
    describe_losses=describe_gpx_losses,
    time_decimals=3,
)
