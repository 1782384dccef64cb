"""Tracks written in TUM's format, as tools for SLAM read them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.io.logs.track_rows import TrackRows, round_decimals

__all__ = ["describe_tum_losses", "write_tum"]

#: Attributes that are written as the orientation if a track has all of them.
_QUATERNION = ("qx", "qy", "qz", "qw")

#: Decimals of quaternions: an angle of about 1e-6 degrees.
_QUATERNION_DECIMALS = 9

#: The first line. Readers pass over it.
_HEADER = b"# timestamp tx ty tz qx qy qz qw\n"

Floats = NDArray[np.float64]


def write_tum(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write a track as lines of ``timestamp tx ty tz qx qy qz qw``.

    The orientation is that of the log if the track has the attributes ``qx``, ``qy``, ``qz`` and
    ``qw``. Else it is level and points along the direction of travel in x and y; where the track
    stands, it stays as before, and before the first move it is that of this move. A track without
    any move points along x. Tracks in x and y have z = 0. Pieces between gaps follow each other.

    Parameters
    ----------
    tracks : iterable of TrackRows
        Pieces of one track in metres, with times.
    sink : binary file
        The file to write to.

    Raises
    ------
    OutputError
        If there are several tracks, positions in degrees, or no times: TUM can't hold them.
    """
    sink.write(_HEADER)
    name: str | None = None
    for rows in tracks:
        # Only the pieces of one track fit.
        if name is not None and rows.track != name:
            raise OutputError(
                f"tum holds one track, but there are {name!r} and {rows.track!r}",
                remedy="write one with --track NAME, or all as CSV",
            )
        name = rows.track
        _check(rows)

        # Write its rows.
        times = rows.times
        assert times is not None
        table = pa.table(
            [pa.array(column) for column in (times, *_axes(rows), *_quaternion(rows))],
            names=list("txyzabcd"),
        )
        options = pc.WriteOptions(include_header=False, delimiter=" ", quoting_style="none")
        pc.write_csv(table, sink, options)


def describe_tum_losses(_names: Sequence[str], attributes: Sequence[str]) -> list[str]:
    """Describe what TUM can't hold of tracks.

    Parameters
    ----------
    _names : sequence of str
        Names of the tracks, which don't count.
    attributes : sequence of str
        Names of their attributes.

    Examples
    --------
    >>> describe_tum_losses(["robot"], ["qx", "qy", "qz", "qw"])
    []
    >>> describe_tum_losses(["robot"], ["speed"])
    ["tum can't hold speed; write CSV or Parquet to have them"]
    """
    is_oriented = set(_QUATERNION) <= set(attributes)
    missing = [name for name in attributes if not (is_oriented and name in _QUATERNION)]
    if not missing:
        return []
    return [f"tum can't hold {', '.join(missing)}; write CSV or Parquet to have them"]


def _check(rows: TrackRows) -> None:
    """Refuse what TUM can't hold."""
    # Each with the formats that can.
    if rows.geographic:
        reason, formats = "metres, not latitude and longitude", "CSV, GPX, GeoJSON or Parquet"
    elif rows.times is None:
        reason, formats = "times, and the track is a shape without any", "CSV, GeoJSON or Parquet"
    elif rows.coordinates.shape[1] > 3:
        reason, formats = "x, y and z, and the track has more coordinates", "CSV or Parquet"
    else:
        return
    raise OutputError(
        f"tum holds {reason}", location=f"track {rows.track!r}", remedy=f"write {formats}"
    )


def _axes(rows: TrackRows) -> list[Floats]:
    axes = list(rows.coordinates.T)
    return [*axes, *[np.zeros(len(rows))] * (3 - len(axes))]


def _quaternion(rows: TrackRows) -> list[Floats]:
    """Return the orientation of each row, from the log or from the direction of travel."""
    # That of the log, if all of it is known.
    if set(_QUATERNION) <= rows.attributes.keys():
        kept = [rows.attributes[name] for name in _QUATERNION]
        if all(np.issubdtype(values.dtype, np.number) for values in kept):
            floats = [values.astype(float) for values in kept]
            if all(np.isfinite(values).all() for values in floats):
                return floats

    # A rotation by the angle a about z is (0, 0, sin a/2, cos a/2).
    half = _directions(rows.coordinates) / 2
    zeros = np.zeros(len(rows))
    sine, cosine = (round_decimals(f(half), _QUATERNION_DECIMALS) for f in (np.sin, np.cos))
    return [zeros, zeros, sine, cosine]


def _directions(positions: Floats) -> Floats:
    """Return the direction of travel at each row, in radians from x to y."""
    # The direction of the move that follows; the last row has that of the move before.
    moves = np.diff(positions[:, :2], axis=0)
    has_moved = np.flatnonzero(moves.any(axis=1))
    if not len(has_moved):
        return np.zeros(len(positions))
    angles = np.arctan2(moves[has_moved, 1], moves[has_moved, 0])

    # Rows at rest have that of the last move before, or of the first one.
    last = np.searchsorted(has_moved, np.arange(len(positions)), side="right") - 1
    directions: Floats = angles[np.maximum(last, 0)]
    return directions
