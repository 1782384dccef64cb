"""Tables and lines of unusual trips and their parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.io.history_tables import write_edge_table
from gpszip.model import Network, Plane, Track
from gpszip.model.unusual import Anomaly, Unusual, UnusualTrip

__all__ = ["write_parts", "write_trips"]

#: Decimals of bits and seconds.
_DECIMALS = 3


def write_trips(found: Unusual, tracks: Sequence[Track], target: str) -> None:
    """Write a row for each trip, in the order of the log.

    Parameters
    ----------
    found : Unusual
        The trips.
    tracks : sequence of Track
        The log, for lines.
    target : str
        Name of the file, whose suffix says the format; ``-`` is standard output, as CSV.

    Raises
    ------
    OutputError
        If there is no such format, or the file can't be written.
    """
    trips = found.trips
    columns: dict[str, NDArray[Any]] = {
        "track_id": np.array([trip.track for trip in trips], object),
        "t_start": np.round([trip.start for trip in trips], _DECIMALS),
        "t_end": np.round([trip.end for trip in trips], _DECIMALS),
        "score": np.round([trip.score for trip in trips], _DECIMALS),
        "reason": np.array([trip.reason for trip in trips], object),
    }
    _add_coded_bits(columns, trips)
    _write(columns, trips, tracks, target)


def write_parts(found: Unusual, tracks: Sequence[Track], target: str) -> None:
    """Write a row for each unusual part of a trip and each absence, the most unusual first.

    Parameters and errors are those of :func:`write_trips`.
    """
    parts = found.anomalies
    axes = ("lat", "lon") if found.geographic else ("x", "y")
    columns: dict[str, NDArray[Any]] = {
        "track_id": np.array([part.track for part in parts], object),
        "kind": np.array([part.kind for part in parts], object),
        "t_start": np.round([part.start for part in parts], _DECIMALS),
        "t_end": np.round([part.end for part in parts], _DECIMALS),
        "score": np.round([part.bits for part in parts], _DECIMALS),
        "reason": np.array([part.reason for part in parts], object),
    }
    for axis, name in enumerate(axes):
        places = [part.position[axis] if part.position else np.nan for part in parts]
        columns[name] = np.round(places, 7 if found.geographic else _DECIMALS)
    _add_coded_bits(columns, parts)
    _write(columns, parts, tracks, target)


def _add_coded_bits(
    columns: dict[str, NDArray[Any]], rows: Sequence[UnusualTrip | Anomaly]
) -> None:
    """Add the bits of the archive's coder, if they were asked for."""
    bits = np.array([row.coded_bits for row in rows], np.float64)
    if np.isfinite(bits).any():
        columns["coded_bits"] = np.round(bits, _DECIMALS)


def _write(
    columns: dict[str, NDArray[Any]],
    rows: Sequence[UnusualTrip | Anomaly],
    tracks: Sequence[Track],
    target: str,
) -> None:
    """Write a table, with the lines of the log between the times of each row."""
    by_name = {track.id: track for track in tracks}
    lines = [_line(by_name[row.track], row.start, row.end) for row in rows]
    plane = tracks[0].plane if len(tracks) else None
    write_edge_table(columns, target, "unusual", lines=lines, network=_on_plane(plane))


def _line(track: Track, start: float, end: float) -> NDArray[np.float64]:
    """Positions of a track from one time to another, with interpolated ends."""
    times = np.asarray(track.times, np.float64)
    between = times[(times > start) & (times < end)]
    at = np.clip(np.concatenate(([start], between, [end])), times[0], times[-1])
    return np.stack([np.interp(at, times, axis) for axis in track.positions.T], axis=1)


def _on_plane(plane: Plane | None) -> Network:
    """A network without roads, which tells the plane of lines."""
    none = np.zeros(0, np.int32)
    return Network(
        nodes=np.zeros((0, 2)),
        starts=none,
        ends=none,
        offsets=np.zeros(1, np.int64),
        points=np.zeros((0, 2)),
        forward=np.zeros(0, np.bool_),
        backward=np.zeros(0, np.bool_),
        speeds=np.zeros(0),
        plane=plane,
    )
