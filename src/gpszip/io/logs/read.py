"""Read logs of any format into tracks on one common plane, in memory.

:func:`read_logs` reads and cleans all files as :mod:`gpszip.io.logs.collect` describes, puts
together the rows of each track, and projects them. The
:class:`gpszip.model.read_result.ReadResult` records all that was changed or dropped.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.geo.outliers import find_outliers
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.logs.collect import CollectedLog, collect_log
from gpszip.io.logs.file_collector import CleaningOptions
from gpszip.io.logs.log_file import Sources, open_log_files
from gpszip.io.logs.memory_rows import MemoryRows
from gpszip.io.logs.raw import HEIGHT, Request
from gpszip.io.logs.rows import Floats, LogRows, begins_run, concatenate_rows
from gpszip.io.logs.shapes import measure_points, repeated_points_repair
from gpszip.io.logs.weights import weigh
from gpszip.io.tables.roles import parse_columns
from gpszip.model import Plane, Track
from gpszip.model.read_result import ReadResult, Repair
from gpszip.model.selection import EVERYTHING, Selection
from gpszip.model.track import tracks_from_rows

__all__ = ["ReadOptions", "parse_options", "read_logs"]


class ReadOptions(TypedDict, total=False):
    """How logs are read; see :func:`read_logs`."""

    format: str | None
    columns: str | Sequence[str] | Mapping[str, str] | None
    time_unit: str | None
    dates: str | None
    clean: bool
    sort: bool
    split: bool
    keep: Sequence[str]
    heading: bool
    heights: bool
    accuracy: bool
    skip_bad: bool
    times: bool
    selection: Selection
    topics: str | Sequence[str]
    frame: str | None
    times_file: str | Path | None
    rate: float | None
    weight: str | None


def parse_options(options: ReadOptions) -> tuple[Request, CleaningOptions]:
    """Return what options ask of readers, and of cleaning.

    Raises
    ------
    OptionError
        If the columns can't be understood, or options exclude each other.
    """
    # What is asked of readers. A single name may stand for a list of them.
    keep = options.get("keep", ())
    topics = options.get("topics", ())
    times_file = options.get("times_file")
    request = Request(
        columns=parse_columns(options.get("columns")),
        time_unit=options.get("time_unit"),
        keep=(keep,) if isinstance(keep, str) else tuple(keep),
        heading=options.get("heading", False),
        heights=options.get("heights", False),
        accuracy=options.get("accuracy", False),
        dates=options.get("dates"),
        skip_bad=options.get("skip_bad", False),
        times=options.get("times", True),
        topics=(topics,) if isinstance(topics, str) else tuple(topics),
        frame=options.get("frame"),
        times_file=None if times_file is None else str(times_file),
        rate=options.get("rate"),
    )
    _check_robot_options(request)

    # What is asked of cleaning.
    cleaning = CleaningOptions(
        sort=options.get("sort", False),
        split=options.get("split", False),
        skip_bad=options.get("skip_bad", False),
        clean=options.get("clean", False),
        selection=options.get("selection", EVERYTHING),
    )
    return request, cleaning


def _check_robot_options(request: Request) -> None:
    """Refuse options for robots' logs that exclude each other, or that say nothing."""
    if request.times_file is not None and request.rate is not None:
        raise OptionError("--times and --rate were both given", remedy="give one")
    if request.rate is not None and not 0 < request.rate < math.inf:
        raise OptionError(
            f"--rate {request.rate:g}: a rate is above 0", remedy="state poses in a second"
        )


class _MemoryTrack(NamedTuple):
    """A track before it is projected.

    Parameters
    ----------
    name : str
        Its name.
    times : float64 array, shape (n,)
        Seconds.
    coordinates : float64 array, shape (n, d)
        Metres, or latitude and longitude in degrees.
    attributes : mapping of str to array, shape (n,)
        Further columns.
    where : str
        Name of the first file that has some of it.
    timed : bool
        Whether the track has times; those of a shape number its points.
    """

    name: str
    times: Floats
    coordinates: Floats
    attributes: Mapping[str, NDArray[np.generic]]
    where: str
    timed: bool

    def take(self, rows: NDArray[np.bool_]) -> _MemoryTrack:
        """Return the track with some of its samples."""
        attributes = {name: values[rows] for name, values in self.attributes.items()}
        return self._replace(
            times=self.times[rows], coordinates=self.coordinates[rows], attributes=attributes
        )


def read_logs(
    sources: Sources,
    *,
    format: str | None = None,
    columns: str | Sequence[str] | Mapping[str, str] | None = None,
    time_unit: str | None = None,
    dates: str | None = None,
    clean: bool = False,
    sort: bool = False,
    split: bool = False,
    keep: Sequence[str] = (),
    heading: bool = False,
    heights: bool = False,
    accuracy: bool = False,
    skip_bad: bool = False,
    times: bool = True,
    selection: Selection = EVERYTHING,
    topics: str | Sequence[str] = (),
    frame: str | None = None,
    times_file: str | Path | None = None,
    rate: float | None = None,
    weight: str | None = None,
) -> ReadResult:
    r"""Read position logs.

    Rows without a time or a position, and rows that repeat a time of their track, are dropped and
    counted. A log that names no tracks is track ``0``; if there are several logs, it is named after
    its file. Tracks of one name in several files are joined if their times don't overlap. If they
    do, or if names are titles (GPX), the later track becomes ``NAME-2``, and a repair records it.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these and of Source
        Files, patterns (``walks/*.gpx``), folders and zip archives of files, ``-`` for standard
        input. :func:`gpszip.io.storage.source.expand` yields sources.
    format : str, optional
        Name of a format that :func:`gpszip.io.logs.formats.log_formats` lists; found from the
        content if left out.
    columns : str, sequence of str, or mapping of str to str, optional
        ``t,x,y`` names the columns in their order, ``t=when,x=east,y=north`` by name.
    time_unit : str, optional
        Unit of times that are numbers: ``s``, ``ms``, ``us``, ``ns``, ``days``, ``excel`` (days
        from 1899-12-30) or ``matlab`` (days from the year 0); found from their size if left out.
    dates : str, optional
        ``dmy``, ``mdy`` or ``ymd``, the order of day, month and year in dates such as 03/04/2024;
        found from all dates of the column if left out.
    clean : bool
        Drop outliers, see :func:`gpszip.geo.outliers.find_outliers`, and positions at 0,0 if all
        others are far from there.
    sort, split : bool
        Where time goes back, sort the points, or start a new track.
    keep : sequence of str
        Further columns to keep, as attributes of the tracks.
    heading : bool
        Keep a column of headings (``heading``, ``bearing``, ``course``, ...; the course of GPX
        points), if there is one, as the attribute ``heading``: degrees clockwise from north, NaN
        where unknown.
    heights : bool
        Keep the heights of GPX, KML, TCX and FIT, if there are some, as the attribute ``ele``.
    accuracy : bool
        Keep a column of errors of positions (``accuracy``, ``acc``, ``eph``, ...), if there is one,
        as the attribute ``accuracy``: metres, NaN where unknown.
    skip_bad : bool
        Leave out logs that can't be read, items of logs such as features of GeoJSON, and positions
        off the globe, instead of raising. Logs in a folder or zip archive that can't be read are
        left out in any case, and files in it that are no logs are counted.
    times : bool
        Whether a table needs a column of times; without one, its tracks are read as shapes.
    selection : Selection
        Which tracks and points are read; all by default. A track that leaves the area and comes
        back starts a new track, named as with ``split``. Tracks without times are left out of a
        time range.
    topics : str or sequence of str
        Topics of ROS logs to read, each as a track. A log with one topic of positions needs none.
    frame : str, optional
        Frames of ROS logs, ``map:base_link``: the track of the second in the first.
    times_file : str or Path, optional
        File with a time in each line, for KITTI's poses.
    rate : float, optional
        Poses in a second, for KITTI's poses.
    weight : str, optional
        Column of the weights of the points, positive numbers; all weigh 1 where left out.

    Returns
    -------
    ReadResult
        Tracks on one common plane.

    Raises
    ------
    InputError
        If a log can't be read or used, or logs in degrees and in metres come together.
    OptionError
        If the format, the unit, the columns or a selected track don't exist.

    Examples
    --------
    >>> import io
    >>> result = read_logs(io.BytesIO(b"track_id,t,x,y\n007,0,0,0\n007,1,1,0\n007,1,1,0\n"))
    >>> [(track.id, len(track)) for track in result.tracks], result.points, result.lost
    ([('007', 2)], 3, 1)
    """
    options: ReadOptions = {
        "columns": columns,
        "time_unit": time_unit,
        "dates": dates,
        "clean": clean,
        "sort": sort,
        "split": split,
        "keep": keep,
        "heading": heading,
        "heights": heights,
        "accuracy": accuracy,
        "skip_bad": skip_bad,
        "times": times,
        "selection": selection,
        "topics": topics,
        "frame": frame,
        "times_file": times_file,
        "rate": rate,
    }
    if weight is not None:
        # Weights are read as an attribute, and become what they are in the end.
        names = (keep,) if isinstance(keep, str) else tuple(keep)
        options["keep"] = (*(name for name in names if name != weight), weight)
        options["format"] = format
        result = read_logs(sources, **options)
        return replace(result, tracks=tuple(weigh(track, weight) for track in result.tracks))
    request, cleaning = parse_options(options)

    # Read and clean all files, and put together the rows of each track.
    files = open_log_files(sources, format, request, in_batches=False)
    log = collect_log(files, MemoryRows(), cleaning)
    blocks = list(log.sorted_rows())
    if not clean and _may_share_rows(log, blocks):
        return log.read_result(_share_rows(log, blocks), ())
    tracks = _gather_tracks(log, blocks)
    positions, plane = _project(tracks, log.geographic)

    # Without its outliers, a log may fit on a better plane.
    repairs: list[Repair] = []
    if clean:
        tracks, any_dropped = _drop_outliers(tracks, positions, repairs)
        if any_dropped:
            positions, plane = _project(tracks, log.geographic)

    built = [
        _build_track(track, track_positions, plane, repairs)
        for track, track_positions in zip(tracks, positions, strict=True)
    ]
    return log.read_result(built, repairs)


def _may_share_rows(log: CollectedLog, blocks: Sequence[LogRows]) -> bool:
    """Whether all tracks have times and attributes of one kind, so that they may share arrays."""
    # Integers of one file would become floats beside those of another, and numbers texts.
    kinds = [{name: cells.dtype.kind for name, cells in b.attributes.items()} for b in blocks]
    return all(track.timed for track in log.tracks) and all(kind == kinds[0] for kind in kinds)


def _share_rows(log: CollectedLog, blocks: Sequence[LogRows]) -> list[Track]:
    """Make all tracks at once, in arrays that they share: there may be many short ones."""
    # Where the rows of each code are.
    rows = concatenate_rows(blocks)
    starts = np.flatnonzero(begins_run(rows.codes))
    first, count = np.zeros(log.code_count, np.int64), np.zeros(log.code_count, np.int64)
    first[rows.codes[starts]] = starts
    count[rows.codes[starts]] = np.diff(starts, append=len(rows))

    # Bring them to the order of tracks, unless they have it. A file may have brought a single row
    # at a time that another file has, too: then its code has none.
    codes = np.array([code for track in log.tracks for code in track.codes])
    order = _row_ranges(first[codes], count[codes])
    if len(order) < len(rows) or (order[1:] < order[:-1]).any():
        rows = rows.take(order)

    # Project them, and cut them into tracks.
    coordinates, plane = rows.coordinates, None
    if log.geographic:
        plane = choose_plane(coordinates[:, 0], coordinates[:, 1])
        coordinates = to_plane(coordinates[:, 0], coordinates[:, 1], plane)
    parts = np.array([len(track.codes) for track in log.tracks])
    counts = np.add.reduceat(count[codes], np.cumsum(parts) - parts)
    names = [track.name for track in log.tracks]
    return tracks_from_rows(names, counts.tolist(), rows.times, coordinates, rows.attributes, plane)


def _row_ranges(first: NDArray[np.int64], count: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of ``count[i]`` rows from ``first[i]`` on, for each i in turn."""
    shift = first - (np.cumsum(count) - count)
    rows: NDArray[np.int64] = np.arange(int(count.sum())) + np.repeat(shift, count)
    return rows


def _gather_tracks(log: CollectedLog, blocks: Sequence[LogRows]) -> list[_MemoryTrack]:
    """Put together the rows of each track, which may come from several files."""
    # Cut the sorted rows where a track starts.
    rows_by_code: dict[int, LogRows] = {}
    for block in blocks:
        starts = np.flatnonzero(begins_run(block.codes)).tolist()
        for start, stop in pairwise([*starts, len(block)]):
            rows_by_code[int(block.codes[start])] = block.take(slice(start, stop))

    # Attributes that some files lack can't be filled, so only common ones and heights stay. A file
    # may have brought a single row at a time that another file has, too.
    tracks = []
    for name, codes, where, timed in log.tracks:
        files = [rows_by_code[code] for code in codes if code in rows_by_code]
        times, coordinates = files[0].times, files[0].coordinates
        attributes = files[0].attributes
        if len(files) > 1:
            times = np.concatenate([rows.times for rows in files])
            coordinates = np.concatenate([rows.coordinates for rows in files])
            attributes = _joint_attributes(files)
        tracks.append(_MemoryTrack(name, times, coordinates, attributes, where, timed))
    return tracks


def _joint_attributes(files: Sequence[LogRows]) -> dict[str, NDArray[np.generic]]:
    """Attributes of a track that all of its files have; heights are NaN where a file has none."""
    names = dict.fromkeys(name for rows in files for name in rows.attributes)
    joint = {}
    for name in names:
        values = [
            rows.attributes.get(name, np.full(len(rows), np.nan) if name == HEIGHT else None)
            for rows in files
        ]
        present = [each for each in values if each is not None]
        if len(present) == len(values):
            joint[name] = np.concatenate(present)
    return joint


def _build_track(
    track: _MemoryTrack, positions: Floats, plane: Plane | None, repairs: list[Repair]
) -> Track:
    """Make a Track. The "times" of a shape are distances along it, so points must differ."""
    # A track with times has its points at increasing times already.
    if track.timed:
        return Track(track.name, track.times, positions, attributes=track.attributes, plane=plane)

    # Drop points that repeat the one before.
    distances, moves = measure_points(positions)
    if not moves.all():
        repairs.append(repeated_points_repair(int((~moves).sum()), track.where, track.name))
    return Track(
        track.name,
        distances[moves],
        positions[moves],
        attributes=track.take(moves).attributes,
        plane=plane,
        timed=False,
    )


def _project(tracks: Sequence[_MemoryTrack], geographic: bool) -> tuple[list[Floats], Plane | None]:
    """Project tracks onto one plane chosen for them; metres stay as they are."""
    if not geographic:
        return [track.coordinates for track in tracks], None
    degrees = np.concatenate([track.coordinates for track in tracks])
    plane = choose_plane(degrees[:, 0], degrees[:, 1])
    positions = to_plane(degrees[:, 0], degrees[:, 1], plane)
    ends = np.cumsum([len(track.times) for track in tracks])[:-1]
    return np.split(positions, ends), plane


def _drop_outliers(
    tracks: Sequence[_MemoryTrack], positions: Sequence[Floats], repairs: list[Repair]
) -> tuple[list[_MemoryTrack], bool]:
    """Drop the outliers of tracks with times.

    Returns
    -------
    list of _MemoryTrack
        The tracks.
    bool
        Whether any point was dropped.
    """
    cleaned = []
    any_dropped = False
    for track, track_positions in zip(tracks, positions, strict=True):
        # Outliers show by their speeds, and shapes have none.
        outliers = find_outliers(track.times, track_positions) if track.timed else np.zeros(0, bool)
        if outliers.any():
            where = f"{track.where}: track {track.name!r}"
            repairs.append(Repair("outliers dropped", int(outliers.sum()), where))
            cleaned.append(track.take(~outliers))
            any_dropped = True
        else:
            cleaned.append(track)
    return cleaned, any_dropped
