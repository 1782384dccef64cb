"""Tracks as Arrow tables, for the formats that are tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.io.logs.track_rows import TrackRows

__all__ = ["track_tables"]

_BATCH_ROWS = 1_000_000


def track_tables(tracks: Iterable[TrackRows]) -> Iterator[pa.Table]:
    """Cut tracks into tables of about a million rows, at least one.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All of the same kind and dimension, with the same attributes.

    Yields
    ------
    pyarrow.Table
        ``track_id, t, lat, lon`` or ``track_id, t, x, y[, z]``, then the attributes. Where no track has times, there is no
        ``t``; where only some have, it is null for the others.

    Raises
    ------
    OutputError
        If the tracks are of different kinds.
    """
    timed, tracks = _any_timed(tracks)
    batch: list[TrackRows] = []
    names: list[str] | None = None
    rows = 0
    for track in tracks:
        names = _check_columns(track, names, timed)
        batch.append(track)
        rows += len(track)
        if rows >= _BATCH_ROWS:
            yield _build_table(batch, names, timed)
            batch, rows = [], 0
    if batch or names is None:
        yield _build_table(batch, names or ["track_id", "t", "x", "y"], timed)


def _any_timed(tracks: Iterable[TrackRows]) -> tuple[bool, Iterable[TrackRows]]:
    """Whether any track has times, or there is none; and all tracks."""
    rest = iter(tracks)
    untimed: list[TrackRows] = []
    for track in rest:
        if track.times is not None:
            return True, chain(untimed, [track], rest)
        untimed.append(track)
    return not untimed, untimed


def _check_columns(track: TrackRows, names: list[str] | None, timed: bool) -> list[str]:
    width = track.coordinates.shape[1]
    axes = (
        ["lat", "lon"]
        if track.geographic
        else [*"xyz", *(f"x{i}" for i in range(4, width + 1))][:width]
    )
    own = ["track_id", *(["t"] if timed else []), *axes, *track.attributes]
    if names is not None and own != names:
        raise OutputError(
            f"track {track.id!r} has columns {','.join(own)}, but those before it {','.join(names)}; write them to separate files"
        )
    return own


def _build_table(batch: Sequence[TrackRows], names: Sequence[str], timed: bool) -> pa.Table:
    lengths = [len(track) for track in batch]
    ids = pa.DictionaryArray.from_arrays(
        pa.array(np.repeat(np.arange(len(batch), dtype=np.int32), lengths)),
        pa.array([track.id for track in batch], pa.string()),
    ).cast(pa.string())

    columns = [ids]
    if timed:
        times = np.concatenate([_times(track) for track in batch] or [np.empty(0)])
        columns.append(pa.array(times, from_pandas=True))  # NaN becomes null

    width = batch[0].coordinates.shape[1] if batch else len(names) - len(columns)
    places = np.concatenate([track.coordinates for track in batch] or [np.empty((0, width))])
    columns += [pa.array(axis) for axis in places.T]
    columns += [
        pa.array(np.concatenate([track.attributes[name] for track in batch]))
        for name in names[len(columns) :]
    ]
    return pa.table(columns, names=list(names))


def _times(track: TrackRows) -> NDArray[np.float64]:
    return np.full(len(track), np.nan) if track.times is None else track.times
