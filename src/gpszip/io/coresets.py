"""Read and write coresets as Parquet files, which other tools can read, too.

There is one row for each block, in the order of the coreset. The columns are

- ``track``, a text;
- float64: ``first``, ``last`` (times of the first and last sample, s), ``weight``, ``count``,
  ``mean_time`` (since ``first``, s), ``spread`` (s^2), ``scatter`` (m^2), ``reach`` (m), ``jitter``
  (s, may be infinite), ``depth``;
- float64, for each axis: ``start_0`` (first sample, m), ``mean_0`` (from there, m) and ``drift_0``
  (m s), then ``start_1`` and so on, grouped by name.

The schema's metadata have the key ``gpszip.coreset``: JSON with ``version`` (1), ``tracks`` (names
in order) and ``plane`` (null, or the centres of the planes in 1e-7 degrees).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from gpszip.errors import InputError, OutputError
from gpszip.io.coreset_files import CORESET_KEY
from gpszip.io.storage.sink import open_sink
from gpszip.model import Plane
from gpszip.sketches.coreset import Coreset

__all__ = ["read_coreset", "write_coreset"]

#: Version of the format.
_VERSION = 1

#: Columns of numbers before those of the axes.
_COLUMN_NAMES = (
    "first",
    "last",
    "weight",
    "count",
    "mean_time",
    "spread",
    "scatter",
    "reach",
    "jitter",
    "depth",
)

#: Columns of each axis.
_AXIS_COLUMN_NAMES = ("start", "mean", "drift")

#: Index of each column of numbers.
_COLUMN = {name: i for i, name in enumerate(_COLUMN_NAMES)}

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]


def write_coreset(coreset: Coreset, sink: str | Path | BinaryIO, *, force: bool = False) -> None:
    """Write a coreset to a file, which appears once it is complete.

    Parameters
    ----------
    coreset : Coreset
        The coreset.
    sink : path or binary stream
        Where to write; ``-`` is standard output.
    force : bool, default False
        Replace an existing file.

    Raises
    ------
    OutputError
        If the file exists, or can't be written.

    Examples
    --------
    >>> import io
    >>> from gpszip import Track, coreset
    >>> file = io.BytesIO()
    >>> write_coreset(coreset(Track("lane", range(9), [[t % 5] for t in range(9)]), size=2), file)
    >>> len(read_coreset(file))
    2
    """
    # Never overwrite a file unless the user forces it.
    is_path = isinstance(sink, (str, Path)) and str(sink) != "-"
    if is_path and Path(str(sink)).exists() and not force:
        raise OutputError(
            "exists already", path=str(sink), remedy="replace it with force, or name another file"
        )

    # Metadata.
    plane = None if coreset.plane is None else [list(center) for center in coreset.plane.centers]
    metadata = json.dumps(
        {"version": _VERSION, "tracks": list(coreset.tracks), "plane": plane}, ensure_ascii=False
    )

    # Columns.
    # Codes and names make a column of texts without a loop over blocks.
    names = pa.DictionaryArray.from_arrays(
        pa.array(coreset.owners.astype(np.int32)), pa.array(coreset.tracks, pa.string())
    )
    columns = [names.cast(pa.string())]
    columns += [pa.array(np.ascontiguousarray(column)) for column in coreset.rows.T]
    table = pa.table(columns, names=["track", *_column_names(coreset.dimension)])
    table = table.replace_schema_metadata({CORESET_KEY: metadata.encode()})
    with open_sink(sink) as file:
        pq.write_table(
            table, file, compression="zstd", use_dictionary=["track"], write_statistics=False
        )


def read_coreset(source: str | Path | BinaryIO) -> Coreset:
    """Read a coreset.

    Parameters
    ----------
    source : path or binary stream
        What :func:`write_coreset` wrote.

    Raises
    ------
    InputError
        If there is no such file, it is damaged, or it holds something else.
    """
    # Name the source in messages.
    is_path = isinstance(source, (str, Path))
    where = str(source) if is_path else "stream"

    # Parse the Parquet table; a file without our metadata is something other than a coreset.
    try:
        # The bytes are read here: Arrow opens no file whose name isn't UTF-8.
        data: Any = pa.py_buffer(Path(str(source)).read_bytes()) if is_path else source
        table = pq.read_table(data)
        metadata = json.loads((table.schema.metadata or {})[CORESET_KEY])
        return _build_coreset(table, metadata, where)
    except KeyError:
        raise InputError(
            "is no coreset",
            path=where,
            remedy=f"make one with: gpszip coreset LOG -o {Path(where).name}",
        ) from None
    except (pa.ArrowException, OSError, ValueError, TypeError) as error:
        raise InputError(
            f"can't be read as a coreset: {str(error).splitlines()[0]}", path=where
        ) from None


def _column_names(dimension: int) -> list[str]:
    """Return the names of all columns of numbers."""
    # All columns of one name stand together: start_0, start_1, mean_0, mean_1 and so on.
    axis_names = [f"{name}_{axis}" for name in _AXIS_COLUMN_NAMES for axis in range(dimension)]
    return [*_COLUMN_NAMES, *axis_names]


def _build_coreset(table: Any, metadata: dict[str, Any], where: str) -> Coreset:
    # Refuse other versions of the format: their columns may mean something else.
    if metadata.get("version") != _VERSION:
        raise InputError(
            f"coreset of version {metadata.get('version')}; this GPSZip reads version {_VERSION}",
            path=where,
            remedy="install a newer one",
        )

    # Columns.
    axis_columns = table.num_columns - 1 - len(_COLUMN_NAMES)
    dimension, rest = divmod(axis_columns, len(_AXIS_COLUMN_NAMES))
    is_coreset = not rest and dimension >= 1
    if (
        not is_coreset
        or table.column_names != ["track", *_column_names(dimension)]
        or table.num_rows == 0
    ):
        raise InputError("its columns are not those of a coreset", path=where)
    columns = [table.column(name).to_numpy() for name in _column_names(dimension)]
    rows = np.column_stack(columns).astype(np.float64)

    # Tracks.
    tracks = tuple(str(name) for name in metadata["tracks"])
    index = {name: i for i, name in enumerate(tracks)}
    owners = np.array([index.get(name, -1) for name in table.column("track").to_pylist()], np.int64)
    if not (_are_grouped(owners, len(tracks)) and _is_valid(rows) and _is_in_order(rows, owners)):
        raise InputError("its blocks are damaged", path=where, remedy="make the coreset anew")

    # Restore the plane; a log in x and y has none.
    centers = metadata["plane"]
    plane = None if centers is None else Plane(tuple((int(lat), int(lon)) for lat, lon in centers))
    return Coreset(tracks, owners, rows, plane)


def _are_grouped(owners: Longs, track_count: int) -> bool:
    """Whether every block has a track, every track has blocks, and they are in its order."""
    # An owner of -1 is a name that the metadata don't list.
    is_sorted = (owners >= 0).all() and (np.diff(owners) >= 0).all()
    return bool(is_sorted and len(np.unique(owners)) == track_count)


def _is_in_order(rows: Floats, owners: Longs) -> bool:
    """Whether each block starts after the one before it of the same track."""
    starts_later = rows[1:, _COLUMN["first"]] > rows[:-1, _COLUMN["last"]]
    return bool(starts_later[owners[1:] == owners[:-1]].all())


def _is_valid(rows: Floats) -> bool:
    """Whether all numbers are in their ranges, and costs are finite."""
    # All but the jitter are finite.
    jitter = rows[:, _COLUMN["jitter"]]
    if (np.isnan(jitter) | (jitter < 0)).any():
        return False
    if not np.isfinite(np.delete(rows, _COLUMN["jitter"], axis=1)).all():
        return False

    # Check the bounds of each statistic: weights are positive, extents are not negative.
    is_in_range = (
        (rows[:, _COLUMN["weight"]] > 0).all()
        and (rows[:, _COLUMN["count"]] >= 1).all()
        and (rows[:, _COLUMN["spread"]] >= 0).all()
        and (rows[:, _COLUMN["scatter"]] >= 0).all()
        and (rows[:, _COLUMN["reach"]] >= 0).all()
        and (rows[:, _COLUMN["depth"]] >= 0).all()
        and (rows[:, _COLUMN["last"]] >= rows[:, _COLUMN["first"]]).all()
    )
    return bool(is_in_range) and _costs_are_finite(rows)


def _costs_are_finite(rows: Floats) -> bool:
    """Whether costs can be computed without an overflow."""
    # Huge values in a damaged file would make costs infinite or NaN without an error.
    with np.errstate(over="ignore", invalid="ignore"):
        weight = rows[:, _COLUMN["weight"]]
        squares = (rows[:, len(_COLUMN_NAMES) :] ** 2).sum(axis=1)
        terms = np.stack(
            [
                weight * rows[:, _COLUMN["reach"]] ** 2,
                weight * squares,
                rows[:, _COLUMN["mean_time"]] ** 2 * weight,
                squares,
            ]
        )
        return bool(np.isfinite(terms.sum()) and np.isfinite(squares.sum() ** 2))
