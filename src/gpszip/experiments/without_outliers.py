"""Logs without the samples that jump away and back."""

from __future__ import annotations

from gpszip.geo.outliers import find_outliers
from gpszip.model import Track

__all__ = ["without_outliers"]


def without_outliers(track: Track) -> Track:
    """Return a track without outliers (:func:`gpszip.geo.outliers.find_outliers`).

    Examples
    --------
    >>> track = Track("a", range(7), [[x, 0.0] for x in (0, 1, 2, 900, 4, 5, 6)])
    >>> without_outliers(track).times.tolist()
    [0.0, 1.0, 2.0, 4.0, 5.0, 6.0]
    """
    kept = ~find_outliers(track.times, track.positions)
    return Track(track.id, track.times[kept], track.positions[kept], plane=track.plane)
