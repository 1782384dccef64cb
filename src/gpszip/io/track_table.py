"""Tracks as Arrow tables, for the formats that are tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.geo.planes import to_geographic
from gpszip.model import Track

__all__ = ["DEGREE_DIGITS", "TIME_DECIMALS", "decimal", "track_tables"]

#: Degrees need this many decimals more than metres to be as fine.
DEGREE_DIGITS = 5

#: Decimals of seconds: microseconds, about what a float holds of an epoch.
TIME_DECIMALS = 6

_BATCH = 1_000_000


def decimal(values: NDArray[np.float64], decimals: int) -> NDArray[np.float64]:
    """Round to decimals, so that the shortest text of each number has no more of them; there is no minus zero.

    Examples
    --------
    >>> decimal(np.array([1.23456, -0.0001]), 3).tolist()
    [1.235, 0.0]
    """
    rounded: NDArray[np.float64] = np.round(values, decimals) + 0.0
    return rounded


def track_tables(tracks: Iterable[Track], decimals: int) -> Iterator[pa.Table]:
    """Cut tracks into tables of about a million rows, at least one.

    Parameters
    ----------
    tracks : iterable of Track
        All of the same kind and dimension, with the same attributes.
    decimals : int
        Of metres.

    Yields
    ------
    pyarrow.Table
        ``track_id, t, lat, lon`` or ``track_id, t, x, y[, z]``, then the attributes.

    Raises
    ------
    OutputError
        If the tracks are of different kinds.
    """
    batch: list[Track] = []
    names: list[str] | None = None
    rows = 0
    for track in tracks:
        names = _check(track, names)
        batch.append(track)
        rows += len(track)
        if rows >= _BATCH:
            yield _table(batch, names, decimals)
            batch, rows = [], 0
    if batch or names is None:
        yield _table(batch, names or _names(None), decimals)


def _names(track: Track | None) -> list[str]:
    if track is None:
        return ["track_id", "t", "x", "y"]
    axes = ["lat", "lon"] if track.plane is not None else [*"xyz", *(f"x{i}" for i in range(4, track.dimension + 1))][: track.dimension]
    return ["track_id", "t", *axes, *track.attributes]


def _check(track: Track, names: list[str] | None) -> list[str]:
    own = _names(track)
    if names is not None and own != names:
        raise OutputError(
            f"track {track.id!r} has columns {','.join(own)}, but those before it {','.join(names)}; write them to separate files"
        )
    return own


def _table(batch: Sequence[Track], names: Sequence[str], decimals: int) -> pa.Table:
    lengths = [len(track) for track in batch]
    ids = pa.DictionaryArray.from_arrays(
        pa.array(np.repeat(np.arange(len(batch), dtype=np.int32), lengths)), pa.array([track.id for track in batch], pa.string())
    ).cast(pa.string())
    times = decimal(np.concatenate([track.times for track in batch] or [np.empty(0)]), TIME_DECIMALS)
    columns = [ids, pa.array(times), *(pa.array(axis) for axis in _axes(batch, decimals, len(names) - 2))]
    columns += [pa.array(np.concatenate([track.attributes[name] for track in batch])) for name in names[len(columns) :]]
    return pa.table(columns, names=list(names))


def _axes(batch: Sequence[Track], decimals: int, width: int) -> list[NDArray[np.float64]]:
    if not batch:
        return [np.empty(0)] * width
    positions = np.concatenate([track.positions for track in batch])
    plane = batch[0].plane
    if any(track.plane != plane for track in batch):
        raise OutputError("tracks on different planes can't be written together")
    if plane is None:
        return [decimal(axis, decimals) for axis in positions.T]
    lat, lon = to_geographic(positions[:, :2], plane)
    return [decimal(lat, decimals + DEGREE_DIGITS), decimal(lon, decimals + DEGREE_DIGITS)]
