"""Tables of segment means."""

from __future__ import annotations

from collections.abc import Mapping

from gpszip.experiments.table import Column, Table, Value
from gpszip.model import SegmentMean, Track
from gpszip.segmentation.evaluate import distances, rmse

__all__ = ["mean_table"]


def mean_table(track: Track, means: Mapping[str, SegmentMean]) -> Table:
    """Return k, m, RMSE and maximum of segment means of a track, by the names of their pictures."""
    # k and m, and the error at all samples.
    columns = (
        Column("picture", "picture"),
        Column("points", "points"),
        Column("k", "k"),
        Column("m", "m"),
        Column("rmse_m", "RMSE m", 3),
        Column("max_m", "max m", 2),
    )

    # A row for each.
    rows: tuple[Mapping[str, Value], ...] = tuple(
        {
            "picture": name,
            "points": len(track),
            "k": mean.k,
            "m": mean.m,
            "rmse_m": rmse(mean, track),
            "max_m": float(distances(mean, track).max()),
        }
        for name, mean in means.items()
    )
    return Table("", "Segment means", columns, rows)
