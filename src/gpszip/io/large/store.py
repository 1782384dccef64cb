"""Read logs of any size in bounded memory: sort all samples into a temporary file.

Rows of different tracks may be interleaved, and a track may be spread over several files in any
order. Batches of rows are buffered up to a number of rows, sorted and written as a run. Then the
runs of each track are concatenated, or merged if the rows of a file were not in order. The files
are in a temporary folder, which is removed when the log is closed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.geo.planes import to_plane
from gpszip.io.large.batches import LogFile, inspect_log_file
from gpszip.io.large.columns import ColumnEncoder, StoredColumn
from gpszip.io.large.outliers import FilteredTracks
from gpszip.io.large.runs import read_rows
from gpszip.io.large.sort import ExternalSorter, coordinate_names
from gpszip.io.logs.formats import is_bundle
from gpszip.io.logs.losses import MAX_TINY_LOG_POINTS, nearly_lost_error
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.storage.source import Source, expand, is_stray_file
from gpszip.io.storage.temporary import disk_errors_as_output_errors, scratch_folder, write_numbers
from gpszip.io.tables.roles import parse_columns
from gpszip.model import Plane, Track
from gpszip.model.read_result import ReadResult, Repair

__all__ = ["StoredLog", "StoredTrack", "count_rows", "store_logs"]

#: Times that are read at once.
_CHUNK_TIMES = 1 << 20

#: Bytes for the distinct texts of kept columns, for each row that may be in memory.
_TEXT_BYTES_PER_ROW = 50

#: Rows in memory at least: fewer would make runs of a few kilobytes.
_MIN_ROWS = 1000

#: Bytes of a row of text, for an estimate of the number of rows: a CSV row with t, x and y.
_ROW_BYTES = 24

#: The same in a gzip file.
_PACKED_ROW_BYTES = 6

Floats = NDArray[np.float64]
Sources: TypeAlias = "str | Path | BinaryIO | Iterable[str | Path | BinaryIO | Source | InputError]"
ColumnNames: TypeAlias = str | Sequence[str] | Mapping[str, str]


@dataclass(frozen=True)
class StoredTrack:
    """Rows of a track in the file of samples.

    Parameters
    ----------
    id : str
        Name of the track.
    offset : int
        Index of its first row.
    count : int
        Number of its rows.
    timed : bool
        Whether it has times; a stored track always has.
    """

    id: str
    offset: int
    count: int
    timed: bool = True

    def __len__(self) -> int:
        return self.count


@dataclass(eq=False)
class StoredLog:
    """All samples of a log in a temporary file, sorted by track and time, on one common plane.

    Use it as a context manager: the file is removed at the end.

    Parameters
    ----------
    tracks : tuple of StoredTrack
        In the order in which the logs first name them.
    read_result : ReadResult
        What was read, repaired and left out; its tracks are empty.
    dimension : int
        Number of coordinates d.
    plane : Plane, optional
        Plane of the positions, if they are on the earth.
    columns : tuple of StoredColumn
        Kept columns; the rows of all tracks follow each other in the order of ``tracks``.
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
        """Return the samples ``first`` to ``last - 1`` of a track; by default all."""
        last = track.count if last is None else last
        rows = read_rows(self._path, track.offset + first, last - first, 1 + self.dimension)
        return Track(track.id, rows[:, 0], rows[:, 1:], plane=self.plane)

    def times(self, first: int = 0, count: int | None = None) -> Iterator[Floats]:
        """Yield times in chunks; the tracks follow each other.

        Parameters
        ----------
        first : int
            Index of the first sample.
        count : int, optional
            Number of samples; all up to the end if left out.
        """
        last = self.sample_count if count is None else first + count
        for row in range(first, last, _CHUNK_TIMES):
            count = min(_CHUNK_TIMES, last - row)
            yield read_rows(self._path, row, count, 1 + self.dimension)[:, 0]


def count_rows(
    sources: Sources, *, format: str | None = None, columns: ColumnNames | None = None
) -> int:
    """Estimate the number of rows of logs without reading them.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these
        As for :func:`gpszip.io.logs.read.read_logs`.
    format, columns
        As for :func:`gpszip.io.logs.read.read_logs`.

    Returns
    -------
    int
        Exact for Parquet, estimated from the size for other formats. Files that can't be read
        count nothing.
    """
    # Skip what can't be read: this is only an estimate, and reading reports the error.
    total = 0
    request = Request(parse_columns(columns))
    for source in expand(sources, unzip=is_bundle):
        if isinstance(source, InputError):
            continue
        log_file = inspect_log_file(source, format, request)
        if isinstance(log_file, InputError):
            continue

        # Estimate from the size if the file does not state the number.
        rows = log_file.row_count()
        if rows is None:
            row_bytes = _PACKED_ROW_BYTES if log_file.source.is_gzip else _ROW_BYTES
            rows = log_file.source.size // row_bytes
        total += rows
    return total


def store_logs(
    sources: Sources,
    *,
    rows: int,
    format: str | None = None,
    columns: ColumnNames | None = None,
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

    1. Inspect all files; refuse those that don't fit together.
    2. Sort the rows of each file by track and time.
    3. With ``clean``, drop outliers.
    4. Choose a plane, and write the samples on it.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these
        As for :func:`gpszip.io.logs.read.read_logs`.
    rows : int
        Rows in memory at once, at least 1000; each takes about 100 bytes.
    format, columns, time_unit, dates, sort, split, skip_bad, keep, clean
        As for :func:`gpszip.io.logs.read.read_logs`.
    plane : Plane, optional
        Plane for positions on the earth; chosen for them if left out.

    Returns
    -------
    StoredLog
        A context manager.

    Raises
    ------
    InputError
        If a file can't be read, holds other columns or another coordinate system than those before
        it, or its times of a track overlap with those of an earlier file. With ``skip_bad``, such
        files are left out instead; of overlapping ones, the later file.

    Examples
    --------
    >>> import io
    >>> csv = io.BytesIO(b"track_id,t,x,y\nb,0,0,0\na,5,1,1\nb,1,2,2\n")
    >>> with store_logs(csv, rows=100) as log:
    ...     [(track.id, log.read(track).times.tolist()) for track in log.tracks]
    [('b', [0.0, 1.0]), ('a', [5.0])]
    """
    # Check the options and inspect all files before the first row is read.
    if sort and split:
        raise OptionError("--sort and --split exclude each other")
    request = Request(
        parse_columns(columns), time_unit, tuple(keep), dates=dates, skip_bad=skip_bad
    )
    inspected = _inspect_files(sources, format, request)
    with ExitStack() as stack:
        folder = stack.enter_context(scratch_folder())

        # Sort.
        sorter = ExternalSorter(
            folder,
            max(rows, _MIN_ROWS),
            sort,
            split,
            ColumnEncoder(request.keep, _TEXT_BYTES_PER_ROW * rows),
            skip_bad=skip_bad,
            clean=clean,
        )
        sorter.errors += inspected.errors
        is_one_log = len({log_file.source.log for log_file in inspected.log_files}) == 1
        for log_file in inspected.log_files:
            _sort_file(sorter, log_file, "0" if is_one_log else log_file.source.stem)
        if sorter.is_empty:
            raise _no_sample_error(sorter)
        sorted_tracks = sorter.tracks()
        plane_sample = sorter.plane_sample
        repairs = sorter.repairs  # more are added while the tracks are read

        # Drop outliers.
        if clean:
            speed_plane = plane_sample.plane() if sorter.geographic else None
            filtered = FilteredTracks(
                sorted_tracks,
                folder / "with-outliers",
                sorter.width,
                sorter.dimension,
                sorter.max_rows,
                speed_plane,
            )
            sorted_tracks = filtered.tracks()
            plane_sample = filtered.plane_sample
            repairs = [*repairs, *filtered.repairs]

        # Write on the plane.
        plane = (plane or plane_sample.plane()) if sorter.geographic else None
        tracks, kept_columns = _write_sorted(sorted_tracks, sorter, folder, plane)
        _check_points_left(tracks, sorter.points, repairs)
        read_result = ReadResult(
            tracks=(),
            points=sorter.points,
            bytes=inspected.bytes,
            geographic=sorter.geographic,
            repairs=tuple(repairs),
            left_out=tuple(sorter.left_out()),
            dropped_columns=tuple(sorter.dropped_columns),
            losses=tuple(sorter.losses),
        )
        return StoredLog(
            tracks,
            read_result,
            sorter.dimension,
            plane,
            kept_columns,
            folder / "samples",
            stack.pop_all(),
        )


class _InspectedFiles(NamedTuple):
    """Files that fit together, their size in bytes, and why the others don't."""

    log_files: list[LogFile]
    bytes: int
    errors: list[InputError]


def _inspect_files(sources: Sources, format_: str | None, request: Request) -> _InspectedFiles:
    """Inspect all files, before any row is read.

    Raises
    ------
    InputError
        If a file can't be read or doesn't fit the others, or there is none. With
        ``request.skip_bad``, only if no file can be read.
    """
    # Collect the files that can be read, their size in bytes, and the errors of the others.
    log_files: list[LogFile] = []
    errors: list[InputError] = []
    size = 0
    for source in expand(sources, unzip=is_bundle):
        # Inspect.
        if isinstance(source, InputError):
            log_file: LogFile | InputError = source
        else:
            log_file = inspect_log_file(source, format_, request)
        if isinstance(log_file, InputError):
            error: InputError | None = log_file
        else:
            error = _find_mismatch(log_file, log_files)

        # Refuse, leave out or take.
        if error is not None and not (request.skip_bad or is_stray_file(source, error)):
            raise error
        if error is not None:
            name = source.name if isinstance(source, Source) else "log"
            errors.append(error.located_at(name))
        elif isinstance(log_file, LogFile):
            log_files.append(log_file)
            size += log_file.source.size
    if not log_files:
        if errors:
            raise errors[0]
        raise InputError("no log given; name a file, a folder of Parquet or a pattern")
    return _InspectedFiles(log_files, size, errors)


def _find_mismatch(log_file: LogFile, before: Sequence[LogFile]) -> InputError | None:
    """Return what is wrong if a file has other coordinates than the files before it."""
    # Compare with the first file whose coordinates are known; unknown ones fit any.
    kind = log_file.coordinate_kind
    first = next((other for other in before if other.coordinate_kind is not None), None)
    first_kind = None if first is None else first.coordinate_kind
    if kind is None or first is None or first_kind is None or kind == first_kind:
        return None

    # Say what differs: the names of the coordinate systems, or the columns.
    if kind.geographic == first_kind.geographic and kind.dimension == first_kind.dimension:
        return InputError(
            f"{log_file.name}: names another coordinate system than {first.name}; "
            "bring them to one, or read them apart"
        )
    return InputError(
        f"{log_file.name}: holds {coordinate_names(kind)}, "
        f"but {first.name} {coordinate_names(first_kind)}; read them apart"
    )


def _sort_file(sorter: ExternalSorter, log_file: LogFile, stem: str) -> None:
    """Add all rows of a file to the sorter, or leave the file out if it is bad."""
    sorter.begin_file(log_file, stem)
    try:
        for raw in log_file.batches():
            _check_times(raw)
            sorter.add(raw)
        sorter.end_file()
    except InputError as error:
        if not sorter.skip_bad:
            raise
        sorter.errors.append(error.located_at(log_file.source.name))
        sorter.drop_file()


def _check_times(raw: RawLog) -> None:
    """Refuse tracks that have no times by which they could be sorted."""
    if raw.untimed:
        name = raw.ids[min(raw.untimed)] if raw.ids else "0"
        raise InputError(
            f"{raw.name}: track {name!r} has no times, by which logs larger than memory are "
            "sorted; leave out --memory, or allow more of it"
        )


def _write_sorted(
    sorted_tracks: Iterator[tuple[str, Iterator[Floats]]],
    sorter: ExternalSorter,
    folder: Path,
    plane: Plane | None,
) -> tuple[tuple[StoredTrack, ...], tuple[StoredColumn, ...]]:
    """Write times and positions to the file ``samples``, and each kept column to its own file."""
    # A row has time and coordinates, then a number for each column.
    tracks: list[StoredTrack] = []
    sample_width = 1 + sorter.dimension
    offset = 0
    encoder = sorter.column_encoder
    column_paths = [folder / f"column-{number}" for number in range(len(encoder.names))]
    with disk_errors_as_output_errors(), ExitStack() as stack:
        sample_file, *column_files = (
            stack.enter_context(path.open("wb")) for path in (folder / "samples", *column_paths)
        )

        # Tracks follow each other in all files.
        for name, blocks in sorted_tracks:
            count = 0
            for block in blocks:
                if plane is not None:
                    block[:, 1:sample_width] = to_plane(block[:, 1], block[:, 2], plane)
                write_numbers(block[:, :sample_width], sample_file)
                for file, values in zip(column_files, block[:, sample_width:].T, strict=True):
                    write_numbers(values, file)
                count += len(block)
            tracks.append(StoredTrack(name, offset, count))
            offset += count

    # Describe the kept columns from their files, which are complete and closed now.
    if not tracks:
        raise _no_sample_error(sorter)
    columns = [encoder.stored_column(number, path) for number, path in enumerate(column_paths)]
    return tuple(tracks), tuple(columns)


def _no_sample_error(sorter: ExternalSorter) -> InputError:
    return sorter.errors[0] if sorter.errors else InputError("no log holds a sample")


def _check_points_left(
    tracks: Sequence[StoredTrack], points: int, repairs: Sequence[Repair]
) -> None:
    """Refuse a log if only one of many points can be used."""
    if sum(track.count for track in tracks) < 2 and points > MAX_TINY_LOG_POINTS:
        raise nearly_lost_error("the logs", points, "row", repairs)
