"""Tracks as Arrow tables, for the formats that are tables (CSV and Parquet)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.io.logs.track_rows import TrackRows

__all__ = ["track_tables"]

#: Rows at which a table is full, so that any number of tracks takes bounded memory.
_BATCH_ROWS = 1_000_000


def track_tables(tracks: Iterable[TrackRows]) -> Iterator[pa.Table]:
    """Yield tables of about a million rows; at least one table.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All of the same kind and dimension, with the same attributes.

    Yields
    ------
    pyarrow.Table
        ``track_id, t, lat, lon`` or ``track_id, t, x, y[, z]``, then the attributes. If no track
        has times, there is no ``t``; if some have, it is null for the others.

    Raises
    ------
    OutputError
        If the tracks have different columns.
    """
    # All tables have the same columns, so find out first whether any track has times.
    timed, tracks = _any_timed(tracks)

    # Collect tracks until their rows fill a table.
    batch: list[TrackRows] = []
    names: list[str] | None = None
    row_count = 0
    for track in tracks:
        names = _check_columns(track, names, timed)
        batch.append(track)
        row_count += len(track)
        if row_count >= _BATCH_ROWS:
            yield _build_table(batch, names, timed)
            batch, row_count = [], 0

    # The last table; it has the header of an empty log if there is no track at all.
    if batch or names is None:
        yield _build_table(batch, names or ["track_id", "t", "x", "y"], timed)


def _any_timed(tracks: Iterable[TrackRows]) -> tuple[bool, Iterable[TrackRows]]:
    """Whether any track has times, or there is no track; and an iterable of all tracks."""
    # The tracks can be read only once: those before the first timed one are kept to come again.
    remaining = iter(tracks)
    untimed: list[TrackRows] = []
    for track in remaining:
        if track.times is not None:
            return True, chain(untimed, [track], remaining)
        untimed.append(track)
    return not untimed, untimed


def _check_columns(track: TrackRows, expected: list[str] | None, timed: bool) -> list[str]:
    """Return the columns of a track; raise if they are not the expected ones."""
    # The axes of metres are x, y, z, and further ones x4, x5 and so on.
    width = track.coordinates.shape[1]
    if track.geographic:
        axes = ["lat", "lon"]
    else:
        axes = [*"xyz", *(f"x{i}" for i in range(4, width + 1))][:width]
    names = ["track_id", *(["t"] if timed else []), *axes, *track.attributes]
    if expected is not None and names != expected:
        raise OutputError(
            f"track {track.id!r} has columns {','.join(names)}, but those before it "
            f"{','.join(expected)}",
            remedy="write them to separate files",
        )
    return names


def _build_table(batch: Sequence[TrackRows], names: Sequence[str], timed: bool) -> pa.Table:
    # Names
    # A dictionary holds one text for each track; Arrow repeats it for the rows.
    lengths = [len(track) for track in batch]
    ids = pa.DictionaryArray.from_arrays(
        pa.array(np.repeat(np.arange(len(batch), dtype=np.int32), lengths)),
        pa.array([track.id for track in batch], pa.string()),
    ).cast(pa.string())
    columns = [ids]

    # Times; from_pandas turns NaN into null.
    if timed:
        times = np.concatenate([_times(track) for track in batch] or [np.empty(0)])
        columns.append(pa.array(times, from_pandas=True))

    # Coordinates
    width = batch[0].coordinates.shape[1] if batch else len(names) - len(columns)
    coordinates = np.concatenate([track.coordinates for track in batch] or [np.empty((0, width))])
    columns += [pa.array(axis) for axis in coordinates.T]

    # Attributes
    columns += [
        pa.array(np.concatenate([track.attributes[name] for track in batch]))
        for name in names[len(columns) :]
    ]
    return pa.table(columns, names=list(names))


def _times(track: TrackRows) -> NDArray[np.float64]:
    return np.full(len(track), np.nan) if track.times is None else track.times
