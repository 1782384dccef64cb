"""CSV as a log format."""

from __future__ import annotations

from gpszip.io.logs.csv import read_csv, sniff_csv, write_csv
from gpszip.io.logs.csv_batches import read_csv_batches
from gpszip.io.logs.log_format import LogFormat

__all__ = ["CSV"]

CSV = LogFormat(
    name="csv",
    suffixes=(".csv", ".tsv", ".txt", ".tab"),
    description="a header with t and x,y[,z] or lat,lon, in any order; track_id",
    sniff=sniff_csv,
    read=read_csv,
    read_batches=read_csv_batches,
    write=write_csv,
    is_fallback=True,
)
