"""Logs of any size in bounded memory: one pass sorts all samples by track and time into a file, from which any stretch is read.

Rows of different tracks may be interleaved, and a track may be spread over several files in any order. Batches are gathered up to a
number of rows, sorted and written as a run; then the runs of each track are put one after the other, or merged where a file's
rows were not in order. The files lie in a temporary folder, which goes when the log is closed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.geo.planes import to_plane
from gpszip.io.large.batches import LogFile, inspect_log_file
from gpszip.io.large.columns import ColumnEncoder, StoredColumn
from gpszip.io.large.outliers import FilteredTracks
from gpszip.io.large.sort import ExternalSorter, coordinate_names, read_rows
from gpszip.io.logs.losses import MAX_TINY_LOG_POINTS, nearly_lost_error
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.storage.source import Source, expand, is_stray_file
from gpszip.io.storage.temporary import disk_errors_as_output_errors, scratch_folder, write_numbers
from gpszip.io.tables.roles import parse_columns
from gpszip.model import Plane, Track
from gpszip.model.read_result import ReadResult, Repair

__all__ = ["StoredLog", "StoredTrack", "count_rows", "store_logs"]

#: Times that are handed over at once, and bytes that different texts of a kept column may take for each row that may be in memory.
_CHUNK, _TEXT_BYTES = 1 << 20, 50

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class StoredTrack:
    """Where the samples of a track lie in the file: ``count`` rows from ``offset`` on."""

    id: str
    offset: int
    count: int


@dataclass(eq=False)
class StoredLog:
    """All samples of a log in a temporary file, sorted by track and time, on one common plane.

    Use it as a context: the file is removed at the end.

    Parameters
    ----------
    tracks : tuple of StoredTrack
        In the order in which the logs first name them.
    read_result : Reading
        The account of what was read, without the tracks.
    dimension : int
        Number of coordinates d.
    plane : Plane, optional
        Where positions lie on the earth.
    columns : tuple of StoredColumn
        Further columns that were to be kept, all tracks one after the other.
    """

    tracks: tuple[StoredTrack, ...]
    read_result: ReadResult
    dimension: int
    plane: Plane | None
    columns: tuple[StoredColumn, ...]
    _path: Path
    _temporary_files: ExitStack

    def __enter__(self) -> StoredLog:
        return self

    def __exit__(self, *_: object) -> None:
        self._temporary_files.close()

    @property
    def sample_count(self) -> int:
        """Number of samples of all tracks."""
        return sum(track.count for track in self.tracks)

    def read(self, track: StoredTrack, first: int = 0, last: int | None = None) -> Track:
        """Samples ``first`` to ``last - 1`` of a track; all where left out."""
        last = track.count if last is None else last
        rows = read_rows(self._path, track.offset + first, last - first, 1 + self.dimension)
        return Track(track.id, rows[:, 0], rows[:, 1:], plane=self.plane)

    def times(self, first: int = 0, count: int | None = None) -> Iterator[NDArray[np.float64]]:
        """Yield the times of so many samples from one on, one track after the other, in pieces."""
        last = self.sample_count if count is None else first + count
        for row in range(first, last, _CHUNK):
            yield read_rows(self._path, row, min(_CHUNK, last - row), 1 + self.dimension)[:, 0]


def count_rows(sources: Any, *, format: str | None = None, columns: Any = None) -> int:
    """Count the rows of logs: exactly where a file tells, else as its size lets expect. Files that can't be read count nothing."""
    total = 0
    for source in expand(sources):
        log_file = (
            source
            if isinstance(source, InputError)
            else inspect_log_file(source, format, Request(parse_columns(columns)))
        )
        if isinstance(log_file, LogFile):
            rows = log_file.row_count()
            total += (
                rows
                if rows is not None
                else log_file.source.size // (6 if log_file.source.is_gzip else 24)
            )
    return total


def store_logs(
    sources: str | Path | BinaryIO | Iterable[str | Path | BinaryIO | Source | InputError],
    *,
    rows: int,
    format: str | None = None,
    columns: str | Sequence[str] | Mapping[str, str] | None = None,
    time_unit: str | None = None,
    dates: str | None = None,
    sort: bool = False,
    split: bool = False,
    skip_bad: bool = False,
    keep: Sequence[str] = (),
    clean: bool = False,
    plane: Plane | None = None,
) -> StoredLog:
    r"""Sort position logs of any size into a temporary file.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these
        As for :func:`gpszip.io.logs.read.read_logs`.
    rows : int
        How many rows may be in memory at once; each takes about 100 bytes.
    format, columns, time_unit, dates, sort, split, skip_bad, keep, clean
        As for :func:`gpszip.io.logs.read.read_logs`.
    plane : Plane, optional
        Where positions on the earth are to be laid; chosen for them where left out.

    Returns
    -------
    StoredLog
        A context.

    Raises
    ------
    InputError
        If a file can't be read, holds other columns or another coordinate system than those before it, or the times of one
        track in two files overlap. With ``skip_bad``, such files are left out instead; of overlapping ones, those that come
        later.

    Examples
    --------
    >>> import io
    >>> with store_logs(io.BytesIO(b"track_id,t,x,y\nb,0,0,0\na,5,1,1\nb,1,2,2\n"), rows=100) as log:
    ...     [(track.id, log.read(track).times.tolist()) for track in log.tracks]
    [('b', [0.0, 1.0]), ('a', [5.0])]
    """
    if sort and split:
        raise OptionError("--sort and --split exclude each other")
    request = Request(
        parse_columns(columns), time_unit, tuple(keep), dates=dates, skip_bad=skip_bad
    )
    log_files, size, errors = _inspect_files(sources, format, request, skip_bad)
    with ExitStack() as stack:
        folder = stack.enter_context(scratch_folder())
        sorter = ExternalSorter(
            folder,
            max(rows, 1000),
            sort,
            split,
            ColumnEncoder(request.keep, _TEXT_BYTES * rows),
            skip_bad=skip_bad,
            clean=clean,
        )
        sorter.errors += errors
        alone = len({log_file.source.log for log_file in log_files}) == 1
        for log_file in log_files:
            _sort_file(sorter, log_file, alone=alone, skip_bad=skip_bad)
        if sorter.empty:
            raise sorter.errors[0] if sorter.errors else InputError("no log holds a sample")
        sorter.write_run()
        sorted_tracks, sample, repairs = (
            sorter.tracks(skip_bad),
            sorter.plane_sample,
            sorter.repairs,
        )
        if clean:
            measure = sample.plane() if sorter.geographic else None
            left = FilteredTracks(
                sorted_tracks,
                folder / "with-spikes",
                sorter.width,
                sorter.dimension,
                sorter.rows,
                measure,
            )
            sorted_tracks, sample, repairs = (
                left.tracks(),
                left.plane_sample,
                [*repairs, *left.repairs],
            )
        plane = (plane or sample.plane()) if sorter.geographic else None
        tracks, kept = _write_sorted(sorted_tracks, sorter, folder, plane)
        _check_points_left(tracks, sorter.points, repairs)
        read_result = ReadResult(
            tracks=(),
            points=sorter.points,
            bytes=size,
            geographic=sorter.geographic,
            repairs=tuple(repairs),
            left_out=tuple(sorter.left_out()),
            dropped_columns=tuple(sorter.dropped_columns),
            losses=tuple(sorter.losses),
        )
        return StoredLog(
            tracks, read_result, sorter.dimension, plane, kept, folder / "samples", stack.pop_all()
        )


def _write_sorted(
    sorted_tracks: Iterator[tuple[str, Iterator[NDArray[np.float64]]]],
    sorter: ExternalSorter,
    folder: Path,
    plane: Plane | None,
) -> tuple[tuple[StoredTrack, ...], tuple[StoredColumn, ...]]:
    """Write the sorted samples on their plane, and each further column to a file of its own."""
    tracks: list[StoredTrack] = []
    own, offset = 1 + sorter.dimension, 0
    paths = [folder / f"column-{number}" for number in range(len(sorter.column_encoder.names))]
    with disk_errors_as_output_errors(), ExitStack() as stack:
        samples, *columns = (
            stack.enter_context(path.open("wb")) for path in (folder / "samples", *paths)
        )
        for name, blocks in sorted_tracks:
            count = 0
            for block in blocks:
                if plane is not None:
                    block[:, 1:own] = to_plane(block[:, 1], block[:, 2], plane)
                write_numbers(block[:, :own], samples)
                for column, values in zip(columns, block[:, own:].T, strict=True):
                    write_numbers(values, column)
                count += len(block)
            tracks.append(StoredTrack(name, offset, count))
            offset += count
    if not tracks:
        raise sorter.errors[0] if sorter.errors else InputError("no log holds a sample")
    return tuple(tracks), tuple(
        sorter.column_encoder.stored_column(number, path) for number, path in enumerate(paths)
    )


def _check_points_left(
    tracks: Sequence[StoredTrack], points: int, repairs: Sequence[Repair]
) -> None:
    """Refuse a log of which one point is left of many."""
    if sum(track.count for track in tracks) < 2 and points > MAX_TINY_LOG_POINTS:
        raise nearly_lost_error("the logs", points, "row", repairs)


def _inspect_files(
    sources: Any, format_: str | None, request: Request, skip_bad: bool
) -> tuple[list[LogFile], int, list[InputError]]:
    """All files whose heads can be read and fit together; refused before any row is read."""
    log_files: list[LogFile] = []
    errors: list[InputError] = []
    size = 0
    for source in expand(sources):
        log_file = (
            source if isinstance(source, InputError) else inspect_log_file(source, format_, request)
        )
        error = (
            log_file if isinstance(log_file, InputError) else _find_mismatch(log_file, log_files)
        )
        if error is not None and not (skip_bad or is_stray_file(source, error)):
            raise error
        if error is not None:
            errors.append(error)
        elif isinstance(log_file, LogFile):
            log_files.append(log_file)
            size += log_file.source.size
    if not log_files:
        raise (
            errors[0]
            if errors
            else InputError("no log given; name a file, a folder of Parquet or a pattern")
        )
    return log_files, size, errors


def _find_mismatch(log_file: LogFile, before: Sequence[LogFile]) -> InputError | None:
    first = next((other for other in before if other.coordinate_kind is not None), None)
    if (
        first is None
        or log_file.coordinate_kind is None
        or first.coordinate_kind is None
        or log_file.coordinate_kind == first.coordinate_kind
    ):
        return None
    if log_file.coordinate_kind[:2] == first.coordinate_kind[:2]:
        return InputError(
            f"{log_file.name}: names another coordinate system than {first.name}; bring them to one, or read them apart"
        )
    return InputError(
        f"{log_file.name}: holds {coordinate_names(log_file.coordinate_kind)}, but {first.name} {coordinate_names(first.coordinate_kind)}; read them apart"
    )


def _check_times(raw: RawLog) -> None:
    """Refuse tracks that have no times by which they could be sorted."""
    if raw.untimed:
        name = raw.ids[min(raw.untimed)] if raw.ids else "0"
        raise InputError(
            f"{raw.name}: track {name!r} has no times, by which logs larger than memory are sorted; leave out --memory, or allow more of it"
        )


def _sort_file(sorter: ExternalSorter, log_file: LogFile, *, alone: bool, skip_bad: bool) -> None:
    sorter.begin_file(log_file, "0" if alone else log_file.source.stem)
    try:
        for raw in log_file.batches():
            _check_times(raw)
            sorter.add(raw)
        sorter.end_file()
    except InputError as error:
        if not skip_bad:
            raise
        sorter.errors.append(error)
        sorter.drop_file()
