"""Tracks written as GeoJSON: lines with the times of their positions."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.geo.planes import to_geographic
from gpszip.io.track_table import DEGREE_DIGITS, TIME_DECIMALS, decimal
from gpszip.model import Track

__all__ = ["METRES", "write_geojson"]

#: Member of a collection whose coordinates are metres on the log's own plane, as GeoJSON has no word for them.
METRES = {"gpszip": {"coordinates": "metres"}}

_HEIGHTS = ("alt", "altitude", "ele", "elevation", "height")


def write_geojson(tracks: Iterable[Track], sink: BinaryIO, decimals: int) -> None:
    """Write each track as a LineString (a single sample as a Point) with ``track_id`` and ``times`` in seconds.

    Parameters
    ----------
    tracks : iterable of Track
        All in x and y, or all on the earth. Metres are marked by the member ``gpszip``. Heights of tracks on the earth are
        written as third numbers, other attributes as lists among the properties.
    sink : binary file
        Where to.
    decimals : int
        Of metres; degrees have five more, seconds have six.
    """
    start, metric = b"", None
    for track in tracks:
        if metric is None:
            metric = track.plane is None
            member = f"{json.dumps(METRES)[1:-1]}, " if metric else ""
            sink.write(f'{{"type": "FeatureCollection", {member}"features": [\n'.encode())
        if metric != (track.plane is None):
            raise OutputError("tracks in metres and tracks in degrees can't be written together")
        sink.write(start + json.dumps(_feature(track, decimals), ensure_ascii=False).encode())
        start = b",\n"
    sink.write(b"\n]}\n" if metric is not None else b'{"type": "FeatureCollection", "features": []}\n')


def _feature(track: Track, decimals: int) -> dict[str, Any]:
    positions = decimal(track.positions, decimals)
    if track.plane is not None:
        lat, lon = to_geographic(track.positions[:, :2], track.plane)
        positions = decimal(np.stack([lon, lat], axis=1), decimals + DEGREE_DIGITS)
    times = decimal(track.times, TIME_DECIMALS).tolist()
    others = dict(track.attributes)
    height = next((name for name in _HEIGHTS if name in others), None) if track.plane is not None else None
    if height is not None and _is_known(others[height]):
        positions = np.column_stack([positions, decimal(others.pop(height).astype(np.float64), decimals)])
    coordinates = positions.tolist()
    lists = {name: _list(values) for name, values in others.items()}
    geometry = {"type": "LineString", "coordinates": coordinates} if len(track) > 1 else {"type": "Point", "coordinates": coordinates[0]}
    return {"type": "Feature", "properties": {**lists, "track_id": track.id, "times": times}, "geometry": geometry}


def _list(values: NDArray[np.generic]) -> list[Any]:
    """Values for JSON, which has no word for what is not finite."""
    plain: list[Any] = values.tolist()
    return [None if isinstance(value, float) and not math.isfinite(value) else value for value in plain]


def _is_known(heights: NDArray[np.generic]) -> bool:
    return heights.dtype.kind in "if" and bool(np.isfinite(heights.astype(np.float64)).all())
