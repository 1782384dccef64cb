"""Tracks as one Arrow table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.model import Plane
from gpszip.model.timestamps import counts_from_1970

__all__ = ["Piece", "build_table"]

#: Microseconds in a second: the unit of timestamps, about as fine as float64 seconds since 1970.
_MICROSECONDS = 1e6

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Piece:
    """Rows of a track, or of a piece of one.

    Parameters
    ----------
    track : str
        Name of the track.
    number : int or None
        Number of the piece in its track; None for a track that is not cut.
    times : float64 array, shape (n,), or None
        Seconds; None for a track without times.
    coordinates : float64 array, shape (n, d)
        Latitude and longitude, or metres.
    geographic : bool
        Whether the coordinates are degrees.
    attributes : mapping of str to array, shape (n,)
        Further columns.
    """

    track: str
    number: int | None
    times: Floats | None
    coordinates: Floats
    geographic: bool
    attributes: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.coordinates)


def build_table(pieces: Sequence[Piece], *, dimension: int = 2, plane: Plane | None = None) -> Any:
    """Build a table of all rows of tracks.

    Parameters
    ----------
    pieces : sequence of Piece
        All in degrees, or all in metres.
    dimension : int, default 2
        Number of coordinates of a table without rows.
    plane : Plane, optional
        Given if a table without rows is one in degrees.

    Returns
    -------
    pyarrow.Table
        See :meth:`gpszip.Track.to_arrow`.

    Examples
    --------
    >>> piece = Piece("walk", 0, np.array([1.5]), np.array([[3.0, 4.0]]), geographic=False)
    >>> build_table([piece]).to_pydict()
    {'track_id': ['walk'], 'piece': [0], 't': [1.5], 'x': [3.0], 'y': [4.0]}
    """
    # Names
    lengths = [len(piece) for piece in pieces]
    names = list(dict.fromkeys(piece.track for piece in pieces))
    number_by_name = {name: number for number, name in enumerate(names)}
    numbers = np.array([number_by_name[piece.track] for piece in pieces], np.int32)
    ids = pa.array(np.repeat(numbers, lengths))
    columns = {"track_id": pa.DictionaryArray.from_arrays(ids, pa.array(names, pa.string()))}
    if all(piece.number is not None for piece in pieces):
        of_pieces = np.array([piece.number for piece in pieces], np.int32)
        columns["piece"] = pa.array(np.repeat(of_pieces, lengths))

    # Times and positions
    columns["t"] = _times(pieces)
    width = max((piece.coordinates.shape[1] for piece in pieces), default=dimension)
    rows = np.concatenate([np.empty((0, width)), *(piece.coordinates for piece in pieces)])
    geographic = pieces[0].geographic if pieces else plane is not None
    for name, values in zip(_axis_names(width, geographic), rows.T, strict=True):
        columns[name] = pa.array(np.ascontiguousarray(values))

    # Attributes; a column of the log that has the name of another one keeps it.
    for name in dict.fromkeys(name for piece in pieces for name in piece.attributes):
        columns[name if name not in columns else f"{name}-2"] = _attribute(name, pieces)
    return pa.table(columns)


def _axis_names(width: int, geographic: bool) -> list[str]:
    if geographic:
        return ["lat", "lon", *(f"x{i}" for i in range(3, width + 1))]
    return [*"xyz", *(f"x{i}" for i in range(4, width + 1))][:width]


def _times(pieces: Sequence[Piece]) -> Any:
    """Times of all rows: timestamps if the first one counts from 1970, else seconds."""
    # NaN stands for rows of tracks without times.
    seconds = np.concatenate(
        [np.empty(0)]
        + [np.full(len(each), np.nan) if each.times is None else each.times for each in pieces]
    )
    has_time = np.isfinite(seconds)
    if not has_time.any() or not counts_from_1970(float(seconds[has_time].min())):
        return pa.array(seconds, pa.float64(), mask=~has_time)
    micros = np.round(np.where(has_time, seconds, 0.0) * _MICROSECONDS).astype(np.int64)
    return pa.array(micros, pa.int64(), mask=~has_time).cast(pa.timestamp("us", "UTC"))


def _attribute(name: str, pieces: Sequence[Piece]) -> Any:
    """A column of attributes; null for pieces without it, and for NaN."""
    # One type for all pieces: numbers beside texts become texts.
    types = [piece.attributes[name].dtype for piece in pieces if name in piece.attributes]
    common = np.result_type(*types)
    return pa.chunked_array(
        [
            pa.array(piece.attributes[name].astype(common), from_pandas=True)
            if name in piece.attributes
            else pa.nulls(len(piece), pa.from_numpy_dtype(common))
            for piece in pieces
        ]
    )
