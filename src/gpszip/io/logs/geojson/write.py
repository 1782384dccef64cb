"""Tracks written as GeoJSON: lines with the times of their positions."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.io.logs.track_rows import TrackRows, group_into_lines, round_decimals

__all__ = ["METRES_MEMBER", "write_geojson"]

#: Member of a collection whose coordinates are metres on the log's own plane, as GeoJSON has no word for them.
METRES_MEMBER = {"gpszip": {"coordinates": "metres"}}

_HEIGHT_NAMES = ("alt", "altitude", "ele", "elevation", "height")

#: Decimals of metres of heights.
_HEIGHT_DECIMALS = 3


def write_geojson(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write each track as a LineString with ``track_id`` and ``times`` in seconds, one for each position.

    A track with gaps, or one that crosses the antimeridian, is a MultiLineString, of which ``times`` has a list for each line. As a
    line has two positions or more, a lone one is a Point among the features of its track.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the earth. Metres are marked by the member ``gpszip``. Heights of tracks on the earth are
        written as third numbers, other attributes as lists among the properties. Tracks without times have no ``times``.
    sink : binary file
        Where to.

    Raises
    ------
    OutputError
        If some tracks are in metres and some in degrees.
    """
    start, geographic = b"", None
    for name, lines in group_into_lines(tracks):
        if geographic is None:
            geographic = lines[0].geographic
            member = "" if geographic else f"{json.dumps(METRES_MEMBER)[1:-1]}, "
            sink.write(f'{{"type": "FeatureCollection", {member}"features": [\n'.encode())
        if geographic != lines[0].geographic:
            raise OutputError("tracks in metres and tracks in degrees can't be written together")
        for feature in _track_features(name, lines):
            sink.write(start + json.dumps(feature, ensure_ascii=False).encode())
            start = b",\n"
    sink.write(
        b"\n]}\n" if geographic is not None else b'{"type": "FeatureCollection", "features": []}\n'
    )


def _track_features(name: str, lines: Sequence[TrackRows]) -> Iterator[dict[str, Any]]:
    """A feature for the lines of a track; where positions lie alone among them, several in the order of travel."""
    for long, some in groupby(lines, key=lambda line: len(line) > 1):
        parts = [_line_columns(line) for line in some]
        for group in [parts] if long else [[part] for part in parts]:
            yield _track_feature(name, group, "LineString" if long else "Point")


def _track_feature(
    name: str, parts: Sequence[tuple[list[Any], dict[str, list[Any]]]], kind: str
) -> dict[str, Any]:
    coordinates = [positions for positions, _ in parts]
    columns = {key: [own[key] for _, own in parts] for key in parts[0][1]}
    geometry: dict[str, Any] = {"type": f"Multi{kind}", "coordinates": coordinates}
    if len(parts) == 1:
        columns = {key: values[0] for key, values in columns.items()}
        geometry = {
            "type": kind,
            "coordinates": coordinates[0][0] if kind == "Point" else coordinates[0],
        }
    times = {"times": columns.pop("times")} if "times" in columns else {}
    return {
        "type": "Feature",
        "properties": {**columns, "track_id": name, **times},
        "geometry": geometry,
    }


def _line_columns(line: TrackRows) -> tuple[list[Any], dict[str, list[Any]]]:
    """Positions of a line, and the properties that have a value for each."""
    positions = line.coordinates[:, ::-1] if line.geographic else line.coordinates
    others = dict(line.attributes)
    height = (
        next((name for name in _HEIGHT_NAMES if name in others), None) if line.geographic else None
    )
    if height is not None and _is_known(others[height]):
        positions = np.column_stack(
            [positions, round_decimals(others.pop(height).astype(np.float64), _HEIGHT_DECIMALS)]
        )
    columns = {name: _list(values) for name, values in others.items()}
    if line.times is not None:
        columns["times"] = line.times.tolist()
    return positions.tolist(), columns


def _list(values: NDArray[np.generic]) -> list[Any]:
    """Values for JSON, which has no word for what is not finite."""
    plain: list[Any] = values.tolist()
    return [
        None if isinstance(value, float) and not math.isfinite(value) else value for value in plain
    ]


def _is_known(heights: NDArray[np.generic]) -> bool:
    return heights.dtype.kind in "if" and bool(np.isfinite(heights.astype(np.float64)).all())
