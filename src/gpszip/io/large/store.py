"""Store logs larger than memory on disk, sorted by track and time.

:func:`store_logs` reads and cleans all files as :mod:`gpszip.io.logs.collect` describes, in batches
that fit in memory, and writes their samples to a temporary file. :class:`StoredLog` reads slices of
its tracks.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.geo.planes import to_plane
from gpszip.io.large.columns import ColumnEncoder, StoredColumn
from gpszip.io.large.disk_rows import DiskRows
from gpszip.io.large.outliers import OutlierSearch
from gpszip.io.large.plane_sample import PlaneSample
from gpszip.io.large.runs import read_rows
from gpszip.io.logs.collect import CollectedLog, collect_log
from gpszip.io.logs.log_file import Sources, open_log_files, refuse_mismatches
from gpszip.io.logs.read import ReadOptions, parse_options
from gpszip.io.logs.rows import Floats
from gpszip.io.logs.shapes import measure_points, repeated_points_repair
from gpszip.io.storage.temporary import disk_errors_as_output_errors, scratch_folder, write_numbers
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
        Whether it has times. Those of a shape are distances along it in metres.
    """

    id: str
    offset: int
    count: int
    timed: bool

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
        return Track(track.id, rows[:, 0], rows[:, 1:], plane=self.plane, timed=track.timed)

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


def count_rows(sources: Sources, **options: Unpack[ReadOptions]) -> int:
    """Estimate the number of rows of logs without reading them.

    Parameters
    ----------
    sources, **options
        As for :func:`gpszip.io.logs.read.read_logs`.

    Returns
    -------
    int
        Exact for Parquet, estimated from the size for other formats. Files that can't be read
        count nothing.
    """
    request, _ = parse_options(options)
    total = 0
    for file in open_log_files(sources, options.get("format"), request, in_batches=True):
        # Skip what can't be read: this is only an estimate, and reading reports the error.
        if isinstance(file.source, InputError) or file.error is not None:
            continue

        # Estimate from the size if the file does not state the number.
        rows = file.row_count()
        if rows is None:
            row_bytes = _PACKED_ROW_BYTES if file.source.is_gzip else _ROW_BYTES
            rows = file.source.size // row_bytes
        total += rows
    return total


def store_logs(
    sources: Sources, *, rows: int, plane: Plane | None = None, **options: Unpack[ReadOptions]
) -> StoredLog:
    r"""Sort position logs of any size into a temporary file.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these
        As for :func:`gpszip.io.logs.read.read_logs`.
    rows : int
        Rows in memory at once, at least 1000; each takes about 100 bytes.
    plane : Plane, optional
        Plane for positions on the earth; chosen for them if left out.
    **options
        As for :func:`gpszip.io.logs.read.read_logs`. Headings aren't kept.

    Returns
    -------
    StoredLog
        A context manager.

    Raises
    ------
    InputError
        As for :func:`gpszip.io.logs.read.read_logs`; also if a file names another coordinate system
        than those before it.
    OptionError
        If headings are asked for, or ``sort`` and ``split`` together.

    Examples
    --------
    >>> import io
    >>> csv = io.BytesIO(b"track_id,t,x,y\nb,0,0,0\na,5,1,1\nb,1,2,2\n")
    >>> with store_logs(csv, rows=100) as log:
    ...     [(track.id, log.read(track).times.tolist()) for track in log.tracks]
    [('b', [0.0, 1.0]), ('a', [5.0])]
    """
    # Check the start of all files before the first row is read.
    request, cleaning = parse_options(options)
    if request.heading:
        raise OptionError("headings of logs larger than memory are not kept")
    files = refuse_mismatches(
        open_log_files(sources, options.get("format"), request, in_batches=True)
    )

    with ExitStack() as stack:
        # Read, clean and sort.
        folder = stack.enter_context(scratch_folder())
        max_rows = max(rows, _MIN_ROWS)
        # Heights that nobody named take a column only where a format may have them.
        keeps_heights = any(file.format is not None and file.format.heights for file in files)
        unnamed = request.optional if keeps_heights else ()
        names = tuple(dict.fromkeys([*request.keep, *unnamed]))
        encoder = ColumnEncoder(names, _TEXT_BYTES_PER_ROW * rows, optional=request.optional)
        store = DiskRows(folder, max_rows, encoder)
        log = collect_log(files, store, cleaning)
        blocks = _blocks_of_tracks(log)

        # Drop outliers, which don't count for the plane.
        plane_sample = store.plane_sample
        repairs: list[Repair] = []
        if cleaning.clean:
            filtered = _drop_outliers(log, blocks, folder, max_rows, plane_sample)
            blocks, plane_sample, repairs = filtered

        # Write the samples on the plane.
        plane = (plane or plane_sample.plane()) if log.geographic else None
        blocks = _measure_shapes(log, _on_plane(log, blocks, plane), repairs)
        counts, kept_columns = _write_samples(log, blocks, encoder, folder)
        offsets = np.cumsum(counts) - counts
        tracks = tuple(
            StoredTrack(track.name, offset, count, track.timed)
            for track, offset, count in zip(
                log.tracks, offsets.tolist(), counts.tolist(), strict=True
            )
        )
        read_result = log.read_result((), repairs)
        # An error before this line removes the temporary folder; from here on, the log does.
        return StoredLog(
            tracks,
            read_result,
            log.dimension,
            plane,
            kept_columns,
            folder / "samples",
            stack.pop_all(),
        )


class _Block(NamedTuple):
    """Rows of one or several tracks.

    Parameters
    ----------
    tracks : int array, shape (n,)
        Index of each row's track, not decreasing.
    rows : float64 array, shape (n, 1 + d + c)
        Time, coordinates, kept columns.
    """

    tracks: NDArray[np.intp]
    rows: Floats

    def add_to(self, counts: NDArray[np.int64]) -> None:
        """Add the number of rows of each track to these counts."""
        # A track begins where the index differs from that of the row before.
        starts = np.flatnonzero(np.diff(self.tracks, prepend=-1))
        np.add.at(counts, self.tracks[starts], np.diff(starts, append=len(self.tracks)))


class _Filtered(NamedTuple):
    """Rows that are no outliers, a sample of their positions, and the number of outliers."""

    blocks: Iterator[_Block]
    plane_sample: PlaneSample
    repairs: list[Repair]


def _blocks_of_tracks(log: CollectedLog) -> Iterator[_Block]:
    """Yield the sorted rows of a log, with the index of their tracks."""
    track_of_code = np.zeros(log.code_count, np.intp)
    # The rows of a track have a code of their own in each file.
    for i, track in enumerate(log.tracks):
        track_of_code[list(track.codes)] = i
    for block in log.sorted_rows():
        columns = block.attributes.values()
        rows = np.column_stack([block.times, block.coordinates, *columns])
        yield _Block(track_of_code[block.codes], rows)


def _drop_outliers(
    log: CollectedLog,
    blocks: Iterator[_Block],
    folder: Path,
    max_rows: int,
    plane_sample: PlaneSample,
) -> _Filtered:
    """Drop the outliers of tracks with times."""
    # Speeds are measured on a plane, in metres.
    speed_plane = plane_sample.plane() if log.geographic else None

    # Write all rows, as outliers are found in several passes.
    path = folder / "with-outliers"
    counts = np.zeros(len(log.tracks), np.int64)
    width = 0
    with disk_errors_as_output_errors(), path.open("wb") as file:
        for block in blocks:
            write_numbers(block.rows, file)
            block.add_to(counts)
            width = block.rows.shape[1]

    # Find the outliers of each track. They show by their speeds, and shapes have none.
    search = OutlierSearch(path, width, log.dimension, max_rows, speed_plane)
    bounds = list(pairwise([0, *np.cumsum(counts).tolist()]))
    outliers = [
        search.find(first, stop - first) if track.timed else np.zeros(0, np.int64)
        for track, (first, stop) in zip(log.tracks, bounds, strict=True)
    ]
    repairs = [
        Repair("outliers dropped", len(found), f"{track.where}: track {track.name!r}")
        for track, found in zip(log.tracks, outliers, strict=True)
        if len(found)
    ]

    # Yield the other rows, as often as they are needed.
    def remaining_blocks() -> Iterator[_Block]:
        for i, (first, stop) in enumerate(bounds):
            for rows in search.remaining_rows(first, stop - first, outliers[i]):
                yield _Block(np.full(len(rows), i, np.intp), rows)

    if log.geographic:
        plane_sample = PlaneSample()
        for block in remaining_blocks():
            plane_sample.add(block.rows[:, 1:3])
    return _Filtered(remaining_blocks(), plane_sample, repairs)


def _on_plane(log: CollectedLog, blocks: Iterator[_Block], plane: Plane | None) -> Iterator[_Block]:
    """Yield blocks with positions in metres."""
    if plane is None:
        yield from blocks
        return
    last_degrees, last_metres = np.full(2, np.nan), np.full(2, np.nan)
    for block in blocks:
        # All rows of a block may be outliers.
        if not len(block.rows):
            continue

        # Find the rows at the position with which the block before ends. The same degrees may
        # differ by 1e-8 m from block to block (gpszip.model.plane_series): a shape would move.
        positions = block.rows[:, 1 : 1 + log.dimension]
        stays = np.logical_and.accumulate((positions == last_degrees).all(axis=1))
        last_degrees = positions[-1].copy()

        # Latitude and longitude give way to x and y.
        positions[:] = to_plane(positions[:, 0], positions[:, 1], plane)
        positions[stays] = last_metres
        last_metres = positions[-1].copy()
        yield block


def _measure_shapes(
    log: CollectedLog, blocks: Iterator[_Block], repairs: list[Repair]
) -> Iterator[_Block]:
    """Yield blocks in which the times of shapes are distances along them.

    Points that repeat the one before are dropped; repairs are added after the last block.
    """
    is_shape = np.array([not track.timed for track in log.tracks])
    dropped = np.zeros(len(log.tracks), np.int64)
    last: tuple[int, Floats, float] | None = None  # track, position and distance of the last point
    for tracks, rows in blocks:
        # Logs without shapes stay as they are.
        if not is_shape.any():
            yield _Block(tracks, rows)
            continue

        # Measure each shape; its first points may be in the block before.
        moves = np.ones(len(rows), np.bool_)
        starts = np.flatnonzero(np.diff(tracks, prepend=-1)).tolist()
        for start, stop in pairwise([*starts, len(rows)]):
            track = int(tracks[start])
            if not is_shape[track]:
                continue
            positions = rows[start:stop, 1 : 1 + log.dimension]
            before = last[1:] if last is not None and last[0] == track else None
            rows[start:stop, 0], moves[start:stop] = measure_points(positions, before)
            last = track, positions[-1].copy(), float(rows[stop - 1, 0])

        # Drop.
        np.add.at(dropped, tracks[~moves], 1)
        yield _Block(tracks, rows) if moves.all() else _Block(tracks[moves], rows[moves])

    repairs += [
        repeated_points_repair(count, track.where, track.name)
        for track, count in zip(log.tracks, dropped.tolist(), strict=True)
        if count
    ]


def _write_samples(
    log: CollectedLog, blocks: Iterator[_Block], encoder: ColumnEncoder, folder: Path
) -> tuple[NDArray[np.int64], tuple[StoredColumn, ...]]:
    """Write times and positions to the file ``samples``, and each kept column to its own file.

    Returns
    -------
    int array
        Number of rows of each track.
    tuple of StoredColumn
        The kept columns.
    """
    counts = np.zeros(len(log.tracks), np.int64)
    sample_width = 1 + log.dimension
    column_paths = [folder / f"column-{number}" for number in range(len(encoder.names))]
    with disk_errors_as_output_errors(), ExitStack() as stack:
        sample_file, *column_files = (
            stack.enter_context(path.open("wb")) for path in (folder / "samples", *column_paths)
        )
        for block in blocks:
            block.add_to(counts)
            rows = block.rows
            write_numbers(rows[:, :sample_width], sample_file)
            for file, values in zip(column_files, rows[:, sample_width:].T, strict=True):
                write_numbers(values, file)

    # Describe the kept columns from their files, which are complete and closed now.
    columns = [encoder.stored_column(number, path) for number, path in enumerate(column_paths)]
    return counts, tuple(columns)
