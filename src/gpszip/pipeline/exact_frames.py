"""Parquet logs that are kept exactly: read as columns with types, and compared value by value."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager, suppress
from functools import partial
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request
from gpszip.io.storage.source import Source
from gpszip.io.tables.given_columns import find_requested_roles

if TYPE_CHECKING:
    from gpszip.lossless.frame_logs import FrameLog, FrameSource

__all__ = ["check_frames", "find_frame"]

#: Formats whose files are Parquet.
_FORMATS = frozenset({"parquet", "geoparquet"})

#: Rows of a batch that are compared at a time, and rows by which the column of tracks is found.
_BATCH_ROWS = 1 << 16
_SAMPLE_ROWS = 1 << 10

#: Tracks have so many rows on average at least, where rows are sorted by them.
_MIN_ROWS_OF_TRACK = 4


def find_frame(source: Source, tracks: Collection[str]) -> FrameSource | None:
    """Open a Parquet file to be kept as columns; None for any other log.

    Parameters
    ----------
    source : Source
        The log.
    tracks : collection of str
        Names of the archive's tracks, by which the column is found that names them.
    """
    # Logs of other formats need no Arrow for Parquet.
    try:
        if format_for_reading(source).name not in _FORMATS:
            return None
    except InputError:
        return None
    import pyarrow as pa

    from gpszip.lossless.frame_logs import FrameHead, FrameSource

    with suppress(pa.ArrowException, OSError), _opened(source) as file:
        metadata = file.metadata
        groups = tuple(metadata.row_group(i).num_rows for i in range(metadata.num_row_groups))
        codec = "snappy"
        if metadata.num_row_groups and metadata.num_columns:
            codec = metadata.row_group(0).column(0).compression.lower()
        column = _find_track_column(file, source.name, tracks)
        head = FrameHead(file.schema_arrow, codec.replace("uncompressed", "none"), groups, column)
        return FrameSource(head, partial(_batches, source))
    return None


def check_frames(source: Source, log: FrameLog) -> None:
    """Compare a Parquet file with what an archive keeps of it.

    Raises
    ------
    InputError
        If it can't be read, or its schema, row groups or any value differs.
    """
    import pyarrow as pa

    try:
        with _opened(source) as file:
            if not file.schema_arrow.equals(log.head.schema, check_metadata=True):
                raise InputError("the log has other columns than the archive", path=source.name)
            groups = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
        if tuple(groups) != log.head.row_groups:
            raise InputError("the log has other row groups than the archive", path=source.name)
    except (pa.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"damaged Parquet file: {reason}", path=source.name) from None

    # All values, in batches of the same rows.
    first = 0
    there = _even(_batches(source, _BATCH_ROWS), log.head.schema)
    here = _even(log.batches(), log.head.schema)
    for theirs, ours in zip_longest(there, here):
        if theirs is None or ours is None or theirs.num_rows != ours.num_rows:
            raise InputError("the log has other rows than the archive", path=source.name)
        for name, a, b in zip(theirs.schema.names, theirs.columns, ours.columns, strict=True):
            if not _are_same(a, b):
                raise _difference(source.name, name, a, b, first)
        first += theirs.num_rows


@contextmanager
def _opened(source: Source) -> Iterator[Any]:
    """Open a file of Parquet; one that is packed, or no file, is read into memory."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    is_plain = source.path is not None and not source.is_gzip
    # Columns are read when they are asked for, not ahead in threads that may outlive the file.
    place = str(source.path) if is_plain else pa.BufferReader(source.read())
    file = pq.ParquetFile(place, pre_buffer=False)
    with file:
        yield file


def _batches(source: Source, rows: int) -> Iterator[Any]:
    """Yield all rows in batches."""
    with _opened(source) as file:
        yield from file.iter_batches(batch_size=rows, use_threads=False)


def _find_track_column(file: Any, where: str, tracks: Collection[str]) -> int | None:
    """Number of the column that names tracks: the one of this role, or with names of tracks."""
    import pyarrow as pa

    role = None
    with suppress(InputError):
        role = find_requested_roles(tuple(file.schema_arrow.names), Request(), where).id
    with closing(file.iter_batches(batch_size=_SAMPLE_ROWS, use_threads=False)) as batches:
        sample = next(batches, None)
    if sample is None:
        return None

    # The reader's choice comes first; the user may have named another one.
    columns = range(sample.num_columns)
    for column in [*([] if role is None else [role]), *(columns if len(tracks) > 1 else ())]:
        kind = sample.schema.field(column).type
        if pa.types.is_dictionary(kind):
            kind = kind.value_type
        if not (
            pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_integer(kind)
        ):
            continue
        names = {str(value) for value in sample.column(column).to_pylist() if value is not None}
        is_named = bool(names) and names.issubset(tracks)
        is_role = column == role and not tracks
        if (is_named or is_role) and len(names) * _MIN_ROWS_OF_TRACK <= sample.num_rows:
            return int(column)
    return None


def _even(batches: Iterator[Any], schema: Any) -> Iterator[Any]:
    """Yield the same rows in batches of one size, but for the last."""
    import pyarrow as pa

    pending = pa.table([pa.array([], field.type) for field in schema], schema)
    for batch in batches:
        table = pa.Table.from_batches([batch]).cast(schema)
        pending = pa.concat_tables([pending, table])
        while pending.num_rows >= _BATCH_ROWS:
            yield pending.slice(0, _BATCH_ROWS)
            pending = pending.slice(_BATCH_ROWS)
    if pending.num_rows:
        yield pending


def _are_same(a: Any, b: Any) -> bool:
    """Whether two columns have the same values, also NaN and the sign of zeros."""
    import pyarrow as pa
    import pyarrow.compute as pc

    # Numbers of texts are any; those of missing values, too.
    if isinstance(a, pa.ChunkedArray):
        a, b = (each.unify_dictionaries().combine_chunks() for each in (a, b))
        if isinstance(a, pa.ChunkedArray):
            a, b = (pa.concat_arrays(each.chunks) for each in (a, b))
    if pa.types.is_dictionary(a.type):
        a, b = a.dictionary_decode(), b.dictionary_decode()
    if a.equals(b) and not pa.types.is_floating(a.type):
        return True
    if not a.is_valid().equals(b.is_valid()):
        return False
    if pa.types.is_struct(a.type):
        return all(_are_same(x, y) for x, y in zip(a.flatten(), b.flatten(), strict=True))
    if pa.types.is_list(a.type) or pa.types.is_large_list(a.type):
        x, y = (pc.list_value_length(each) for each in (a, b))
        return bool(x.equals(y)) and _are_same(a.flatten(), b.flatten())
    if pa.types.is_floating(a.type):
        bits = f"i{a.type.bit_width // 8}"
        x, y = (np.asarray(each.drop_null()).view(bits) for each in (a, b))
        return bool(np.array_equal(x, y))
    return False


def _difference(where: str, name: str, a: Any, b: Any, first: int) -> InputError:
    """Describe the first value of a column that differs."""
    low, high = 0, len(a)
    while high - low > 1:
        # The first half differs, or the second one does.
        middle = (low + high) // 2
        if _are_same(a.slice(low, middle - low), b.slice(low, middle - low)):
            low = middle
        else:
            high = middle
    return InputError(
        f"the log has {a[low].as_py()!r} for {name}, the archive {b[low].as_py()!r}",
        path=where,
        location=f"row {first + low + 1}",
    )
