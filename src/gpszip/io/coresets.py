"""Coresets as Parquet files, for other tools to read as well.

One row for each block, in the order of the coreset. Columns: ``track``, a text; then float64: ``first``, ``last`` (times of the
first and last sample, s), ``weight``, ``count``, ``mean_time`` (since ``first``, s), ``spread`` (s^2), ``scatter`` (m^2), ``reach``
(m), ``jitter`` (s, may be infinite), ``depth``; then for each axis ``start_0`` (first sample, m), ``mean_0`` (from there, m) and
``drift_0`` (m s), ``start_1`` and so on grouped by name. The schema's metadata has the key ``gpszip.coreset``: JSON with
``version`` (1), ``tracks`` (names in order) and ``plane`` (null, or the centres of the planes in 1e-7 degrees).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from gpszip.errors import InputError, OutputError
from gpszip.io.storage.sink import open_sink
from gpszip.model import Plane
from gpszip.sketches.coreset import Coreset

__all__ = ["read_coreset", "write_coreset"]

_METADATA_KEY = b"gpszip.coreset"
_VERSION = 1
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


def write_coreset(coreset: Coreset, sink: str | Path | BinaryIO, *, force: bool = False) -> None:
    """Save a coreset; the file appears whole or not at all.

    Parameters
    ----------
    coreset : Coreset
        What to save.
    sink : path or binary stream
        Where to; ``-`` is standard output.
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
    if isinstance(sink, (str, Path)) and str(sink) != "-" and Path(sink).exists() and not force:
        raise OutputError(f"{sink}: exists already; replace it with force, or name another file")
    plane = None if coreset.plane is None else [list(center) for center in coreset.plane.centers]
    head = json.dumps(
        {"version": _VERSION, "tracks": list(coreset.tracks), "plane": plane}, ensure_ascii=False
    )
    names = pa.DictionaryArray.from_arrays(
        pa.array(coreset.owners.astype(np.int32)), pa.array(coreset.tracks, pa.string())
    )
    columns = [
        names.cast(pa.string()),
        *(pa.array(np.ascontiguousarray(column)) for column in coreset.rows.T),
    ]
    table = pa.table(
        columns, names=["track", *_column_names(coreset.dimension)]
    ).replace_schema_metadata({_METADATA_KEY: head.encode()})
    with open_sink(sink) as file:
        pq.write_table(
            table, file, compression="zstd", use_dictionary=["track"], write_statistics=False
        )


def read_coreset(source: str | Path | BinaryIO) -> Coreset:
    """Load a coreset.

    Parameters
    ----------
    source : path or binary stream
        What :func:`write_coreset` wrote.

    Raises
    ------
    InputError
        If there is no such file, it is damaged, or holds something else.
    """
    where = str(source) if isinstance(source, (str, Path)) else "stream"
    try:
        # Arrow opens no file whose name is not UTF-8
        table = pq.read_table(
            pa.py_buffer(Path(source).read_bytes()) if isinstance(source, (str, Path)) else source
        )
        head = json.loads((table.schema.metadata or {})[_METADATA_KEY])
        return _build_coreset(table, head, where)
    except KeyError:
        raise InputError(
            f"{where}: is no coreset; make one with: gpszip coreset LOG -o {Path(where).name}"
        ) from None
    except (pa.ArrowException, OSError, ValueError, TypeError) as error:
        raise InputError(
            f"{where}: can't be read as a coreset: {str(error).splitlines()[0]}"
        ) from None


def _column_names(dimension: int) -> list[str]:
    return [
        *_COLUMN_NAMES,
        *(f"{what}_{axis}" for what in ("start", "mean", "drift") for axis in range(dimension)),
    ]


def _build_coreset(table: Any, head: dict[str, Any], where: str) -> Coreset:
    if head.get("version") != _VERSION:
        raise InputError(
            f"{where}: coreset of version {head.get('version')}; this GPSZip reads version {_VERSION}; install a newer one"
        )
    dimension, rest = divmod(table.num_columns - 1 - len(_COLUMN_NAMES), 3)
    if (
        rest
        or dimension < 1
        or table.column_names != ["track", *_column_names(dimension)]
        or table.num_rows == 0
    ):
        raise InputError(f"{where}: its columns are not those of a coreset")
    rows = np.column_stack(
        [table.column(name).to_numpy() for name in _column_names(dimension)]
    ).astype(np.float64)
    tracks = tuple(str(name) for name in head["tracks"])
    number = {name: i for i, name in enumerate(tracks)}
    owners = np.array(
        [number.get(name, -1) for name in table.column("track").to_pylist()], np.int64
    )
    _check_rows(rows, owners, len(tracks), where)
    plane = (
        None
        if head["plane"] is None
        else Plane(tuple((int(lat), int(lon)) for lat, lon in head["plane"]))
    )
    return Coreset(tracks, owners, rows, plane)


def _check_rows(rows: Any, owners: Any, tracks: int, where: str) -> None:
    jitter = _COLUMN_NAMES.index("jitter")
    finite = (
        np.isfinite(np.delete(rows, jitter, axis=1)).all()
        and not (np.isnan(rows[:, jitter]) | (rows[:, jitter] < 0)).any()
    )
    positive = (
        finite
        and (rows[:, 2] > 0).all()
        and (rows[:, 3] >= 1).all()
        and (rows[:, 5:8] >= 0).all()
        and (rows[:, 1] >= rows[:, 0]).all()
    )
    positive = positive and (rows[:, 9] >= 0).all() and _costs_are_finite(rows)
    same = owners[1:] == owners[:-1]
    whole = (
        (owners >= 0).all() and (np.diff(owners) >= 0).all() and len(np.unique(owners)) == tracks
    )
    if not (positive and whole and (rows[1:, 0] > rows[:-1, 1])[same].all()):
        raise InputError(f"{where}: its blocks are damaged; make the coreset anew")


def _costs_are_finite(rows: Any) -> bool:
    """Whether costs can be computed without an overflow."""
    with np.errstate(over="ignore", invalid="ignore"):
        squares = (rows[:, 10:] ** 2).sum(axis=1)
        terms = np.stack(
            [
                rows[:, 2] * rows[:, 7] ** 2,
                rows[:, 2] * squares,
                rows[:, 4] ** 2 * rows[:, 2],
                squares,
            ]
        )
        return bool(np.isfinite(terms.sum()) and np.isfinite(squares.sum() ** 2))
