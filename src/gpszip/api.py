"""The public functions: read logs, compress them to an archive, open it again, and ask it.

Each function here is one call into :mod:`gpszip.pipeline`, or into the package that does the work.
"""

from __future__ import annotations

import math
import os
import pathlib
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, ArchiveSource, open_archive
from gpszip.errors import InputError, LossWarning, OptionError
from gpszip.io.frames.recognise import is_frame
from gpszip.model import (
    Likelihood,
    Listener,
    MarkovModel,
    Network,
    Options,
    Plane,
    ReadResult,
    SegmentMean,
    Track,
)
from gpszip.model.log import Log, MemoryLog
from gpszip.model.selection import make_selection
from gpszip.model.timestamps import Times
from gpszip.run.executor import Executor

if TYPE_CHECKING:
    from gpszip.history.changes.changes import Changes
    from gpszip.history.routes import PlannedRoute
    from gpszip.history.usage import Usage
    from gpszip.io.frames.source import FrameSource
    from gpszip.io.storage.source import Source
    from gpszip.model.difference import Difference
    from gpszip.model.match import Matching
    from gpszip.model.patching import Patching
    from gpszip.model.rounds import Rounds
    from gpszip.model.trips import Trips
    from gpszip.model.unusual import Unusual
    from gpszip.pipeline.diff import Side
    from gpszip.sketches.coreset import Coreset
    from gpszip.sketches.stream import CoresetStream

__all__ = [
    "LogSource",
    "Logs",
    "append",
    "changes",
    "compress",
    "coreset",
    "decompress",
    "diff",
    "join",
    "log_likelihood",
    "markov_model",
    "match",
    "merge",
    "open",
    "open_coreset",
    "patch",
    "read",
    "rounds",
    "route",
    "save_coreset",
    "segment_mean",
    "trips",
    "unusual",
    "usage",
]


class ArrowFrame(Protocol):
    """A table of another package: pyarrow, polars, pandas, GeoDataFrame, DuckDB, ibis."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Give its rows as an Arrow stream."""


#: A table of another package: one with an Arrow stream, columns by name (a dict of arrays, a
#: Dataset of xarray), or a structured array. Trajectories of movingpandas are frames, too.
Frame: TypeAlias = ArrowFrame | Mapping[Any, Any] | NDArray[np.void]

#: Where a log may come from: a path or a pattern (``walks/*.gpx``), a binary stream, or a frame.
LogSource: TypeAlias = str | os.PathLike[str] | BinaryIO | Frame

#: What functions take as a log: tracks, or files and frames to read them from.
Logs: TypeAlias = Track | LogSource | Sequence[Track] | Sequence[LogSource]


def read(
    sources: LogSource | Iterable[LogSource],
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
    skip_bad: bool = False,
    times: bool = True,
    tracks: str | Iterable[str] = (),
    since: Times | None = None,
    until: Times | None = None,
    bbox: Sequence[float] | None = None,
    topics: str | Sequence[str] = (),
    frame: str | None = None,
    times_file: str | os.PathLike[str] | None = None,
    rate: float | None = None,
    weight: str | None = None,
) -> ReadResult:
    r"""Read tracks from logs: files, or frames of other packages.

    Rows without a time or a position, and rows that repeat a time of their track, are dropped and
    counted.

    Parameters
    ----------
    sources : path, str, binary stream, frame, or iterable of these
        Files, patterns (``walks/*.gpx``), folders of Parquet, zip archives of files, ``-`` for
        standard input. A frame is a table of pyarrow, polars, pandas, geopandas, DuckDB or ibis, a
        trajectory of movingpandas, an xarray ``Dataset``, a structured array, or a dict of arrays.
        Messages number its rows from 0.
    format : str, optional
        Format of files: a name that ``gpszip formats`` lists, such as ``csv`` or ``kml``; found by
        the content where left out.
    columns : str, sequence of str, or mapping of str to str, optional
        ``t,x,y`` names the columns by position, ``t=when,x=east,y=north`` by name.
    time_unit : str, optional
        Unit of times that are numbers: ``s``, ``ms``, ``us``, ``ns``, ``days``, ``excel`` (days
        from 1899-12-30) or ``matlab`` (days from the year 0). Found by their size where left out.
    dates : str, optional
        Order of day, month and year in dates such as 03/04/2024: ``dmy``, ``mdy`` or ``ymd``. Found
        by the whole column where left out.
    clean : bool, default False
        Drop outliers, and positions at 0,0 where all others are far from there.
    sort, split : bool, default False
        What to do where time goes back: put the points in order, or start a new track.
    keep : sequence of str
        Further columns to keep, as attributes of the tracks.
    heading : bool, default False
        Keep a column of headings, if there is one, as the attribute ``heading``: degrees clockwise
        from north.
    skip_bad : bool, default False
        Leave out logs that can't be read, and features or positions that can't be used, instead of
        raising.
    times : bool, default True
        Whether a table needs a column of times. If not, the tracks of one without are shapes.
    tracks : str or iterable of str
        Names of the tracks to read; all by default.
    since, until : time, optional
        From when and until when points are read: ``datetime``, ``numpy.datetime64``, ISO 8601 text,
        or seconds as the log counts them. Tracks without times are left out.
    bbox : sequence of four floats, optional
        The area whose points are read: west, south, east, north in degrees, or x from, y from, x
        to, y to in metres. A track that leaves it and comes back starts a new track.
    topics : str or sequence of str, optional
        Topics of ROS logs to read, each as a track. A log with one topic of positions needs none.
    frame : str, optional
        Frames of ROS logs, ``map:base_link``: the positions of the second in the first, composed
        of transforms.
    times_file : path, optional
        File with a time in each line, for KITTI's poses, which have none.
    rate : float, optional
        Poses in a second, for KITTI's poses.
    weight : str, optional
        Column of the weights of the points, which are above 0; all weigh 1 where left out.
        :func:`segment_mean` and :func:`coreset` use them.

    Returns
    -------
    ReadResult
        A sequence of tracks, all on one plane, in metres and seconds. It also says what was
        repaired, lost and left out.

    Raises
    ------
    InputError
        If a log can't be read, or holds no track.
    OptionError
        If the format, the unit, the columns or a selected track don't exist.

    Warns
    -----
    LossWarning
        For each track that lost more than a tenth of its points or all of them, or has several
        points at one time.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = pathlib.Path(folder, "walk.csv")
    ...     _ = log.write_text("t,x,y\n0,0,0\n1,1,0\n2,2,0\n")
    ...     tracks = read(log)
    >>> tracks[0].coordinates.tolist()
    [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]
    >>> read({"t": [0, 1], "lat": [48.1, 48.2], "lon": [11.5, 11.5]})[0].coordinates.tolist()
    [[48.1, 11.5], [48.2, 11.5]]
    """
    # Each function imports what it needs: who opens an archive doesn't wait for readers of logs.
    from gpszip.io.logs.read import read_logs

    # Read one source and several alike, and warn of tracks that lost many of their points.
    # A text, a stream or a frame can be iterated, too, but it is one source.
    several = isinstance(sources, Iterable) and not _is_log_source(sources)
    listed = cast("Iterable[LogSource]", sources) if several else [cast("LogSource", sources)]
    result = read_logs(
        _as_names(listed),
        format=format,
        columns=columns,
        time_unit=time_unit,
        dates=dates,
        clean=clean,
        sort=sort,
        split=split,
        keep=keep,
        heading=heading,
        skip_bad=skip_bad,
        times=times,
        selection=make_selection(tracks, since, until, bbox),
        topics=topics,
        frame=frame,
        times_file=None if times_file is None else os.fspath(times_file),
        rate=rate,
        weight=weight,
    )
    _warn_of_losses(result)
    return result


def compress(
    tracks: Logs | Coreset | CoresetStream,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    size: int | None = None,
    ratio: float | None = None,
    gap: float | None = None,
    k: int | None = None,
    m: int | None = None,
    times: bool = True,
    keep: Sequence[str] = (),
    keep_times: bool = False,
    lossless: bool = False,
    layer: str | None = None,
    effort: int = 5,
    coreset: int | None = None,
    keep_within: Mapping[str, float] | None = None,
    heights: bool = True,
    map: Archive | ArchiveSource | None = None,
    memory: int | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> Archive:
    """Learn the map that tracks repeat, and store each track as a walk on it.

    Parameters
    ----------
    tracks : Track, path or frame, or sequence of these; Coreset or CoresetStream
        Tracks on one plane, with different ids, which are not modified; or files and frames, which
        are read as :func:`read` does. Of a coreset, the archive holds ``rmse`` at the samples of
        its log, or states what k and m have there; it takes no options but these and ``effort``.
    rmse, max_error : float, optional
        Bound on the root mean square, or on the largest, distance in metres between a sample and
        the decoded position at its time. They may be given together.
    size : int, optional
        Largest number of bytes; the smallest RMSE that it allows is found.
    ratio : float, optional
        Minimum compression ratio against the files; against times and coordinates as floats of 8
        bytes for tracks. A size or a ratio excludes all other bounds. Without any bound, a sensible
        RMSE is estimated, and a maximum of four times that.
    gap : float, optional
        Intervals longer than this, in seconds, are gaps, in which no travel is claimed;
        ``math.inf`` for none. Estimated by default.
    k, m : int, optional
        Use the thesis's model of k parts on m independent segments (Algorithm 1) instead; one track
        only.
    times : bool, default True
        Keep the times of the knots.
    keep : sequence of str
        Attributes of the tracks (columns of the files) to keep exactly, with the times of the
        samples: see :meth:`Archive.attributes`.
    keep_times : bool, default False
        Keep the times of the samples exactly, also without attributes.
    lossless : bool, default False
        Keep the files themselves, too, byte by byte: see :meth:`Archive.exact_log`. What the
        archive returns is compared with the files before this function returns.
    layer : {None, "bz2"}
        ``"bz2"`` packs the archive once more, as the thesis did.
    effort : int, default 5
        From 1, quick, to 9, small.
    coreset : int, optional
        Learn from the weighted points of a coreset of this many blocks, for speed. The bound is
        measured at all samples.
    keep_within : mapping of str to float, optional
        Attributes to keep as curves over time, each within an error at every sample, such as
        ``{"ele": 1.0}``: see :meth:`Archive.curve`.
    heights : bool, default True
        Keep the heights of GPX, KML, TCX and FIT files, and the attribute ``ele`` of tracks in
        degrees, within 3 m as the curve ``ele``, unless a size is given or ``keep`` or
        ``keep_within`` names heights.
    map : Archive, path or bytes, optional
        Store the tracks as walks on the map of this archive. The map is not stored again, and
        :func:`open` needs it, too. Lines off the map are in :attr:`Archive.off_map_lines`.
    memory : int, optional
        Bytes that the process may take, at least 400 MiB. Files that would take more are sorted
        into a temporary file, and compressed in batches.
    executor : Executor, optional
        Runs the work, by default on a thread for each core; the archive is the same for any number
        of workers.
    progress : callable, optional
        Called with :class:`Progress` events.

    Returns
    -------
    Archive
        Its bytes hold the bound at every sample. ``archive.report`` says what was done and
        measured.

    Raises
    ------
    InputError
        If a file can't be read, or with ``lossless`` would not come back byte by byte.
    OptionError
        If options contradict each other or the tracks.
    BoundError
        If the bound can't be held, or no archive is as small as it should be.

    Examples
    --------
    >>> track = Track("lane", range(20), [[abs(t % 8 - 4.0), 0.0] for t in range(20)])
    >>> archive = compress(track, max_error=0.1)
    >>> bool(abs(archive.position("lane", 5.5)[0] - 1.5) < 0.1), archive.report.points
    (True, 20)
    """
    from gpszip.io.logs.raw import name_heights
    from gpszip.pipeline.compress import compress as compress_tracks
    from gpszip.sketches.coreset import Coreset
    from gpszip.sketches.stream import CoresetStream

    # A single name would be taken for a sequence of letters.
    names = (keep,) if isinstance(keep, str) else tuple(keep)
    # By position, in the order of the fields of Options, which checks them.
    options = Options(
        rmse=rmse,
        max_error=max_error,
        size=size,
        ratio=ratio,
        gap=gap,
        k=k,
        m=m,
        times=times,
        keep=names,
        keep_times=keep_times,
        layer=layer,
        effort=effort,
        coreset=coreset,
        curves=tuple((keep_within or {}).items()),
        heights=heights,
    )

    # A coreset has no samples.
    if isinstance(tracks, Coreset | CoresetStream):
        from gpszip.pipeline.compress_coreset import compress_coreset

        if map is not None or lossless or memory is not None:
            raise OptionError(
                "map, lossless and memory don't go with a coreset", remedy="give the log"
            )
        archive, report = compress_coreset(tracks, options, executor=executor, progress=progress)
        return replace(archive, report=report)

    # The map and the tracks may still be files.
    # Positions are read onto the plane of the map, so that both can be compared.
    known_map = map if map is None or isinstance(map, Archive) else open_archive(map)
    plane = None if known_map is None else known_map.grid.plane
    columns = (*names, *(keep_within or {}))
    if lossless:
        # Tracks in memory need no readers of files.
        from gpszip.pipeline.exact_logs import exact_section, prove_exact
    with (
        _open_exactly(tracks) if lossless else nullcontext(()) as sources,
        _open_log(
            tracks,
            memory,
            plane,
            columns,
            times,
            progress,
            options.thesis,
            heights=heights and times and not name_heights(columns),
        ) as log,
    ):
        archive, report = compress_tracks(
            log,
            options,
            memory=memory,
            map=known_map,
            logs=partial(exact_section, sources) if lossless else None,
            executor=executor,
            progress=progress,
        )
        if lossless:
            prove_exact(archive, sources)

    # An archive that is opened from a file has no report; this one keeps what was measured.
    return replace(archive, report=report)


def append(
    archive: Archive | ArchiveSource,
    tracks: Logs,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    gap: float | None = None,
    effort: int = 5,
    memory: int | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> Archive:
    """Add tracks to an archive: its walks stay as they are, its map grows.

    Parameters
    ----------
    archive : Archive, path or bytes
        With times and a map of its own; it is not modified.
    tracks : Track or path, or sequence of either
        As for :func:`compress`. A track whose name is in the archive continues there, and must
        begin where that one ends, or later.
    rmse, max_error : float, optional
        Bound on the error of the new tracks in metres; the archive's own where both are left out.
    gap : float, optional
        Intervals longer than this, in seconds, are gaps. Estimated by default.
    effort : int, default 5
        From 1, quick, to 9, small.
    memory : int, optional
        Bytes that the process may take, as for :func:`compress`.
    executor : Executor, optional
        Runs the work.
    progress : callable, optional
        Called with :class:`Progress` events.

    Returns
    -------
    Archive
        The old walks and the new ones on one map.

    Raises
    ------
    OptionError
        If archive and tracks don't go together.
    BoundError
        If the bound can't be held on the archive's grid.

    Examples
    --------
    >>> monday = Track("monday", range(20), [[abs(t % 8 - 4.0), 0.0] for t in range(20)])
    >>> tuesday = Track("tuesday", range(100, 120), monday.positions)
    >>> archive = append(compress(monday, max_error=0.1), tuesday)
    >>> archive.ids, len(archive.road_map.edges)
    (('monday', 'tuesday'), 2)
    """
    from gpszip.pipeline.append import append as append_tracks

    # Files are read with the columns that the archive keeps.
    opened = archive if isinstance(archive, Archive) else open_archive(archive)
    keep, plane = (*(opened.kept_columns or ()), *opened.curve_sizes), opened.grid.plane
    # Only archives with times can be extended, so a table needs its column of times. Heights that
    # were kept unasked may be missing.
    heights = "ele" in opened.curve_sizes
    with _open_log(tracks, memory, plane, keep, True, progress, heights=heights) as log:
        extended, report = append_tracks(
            opened,
            log,
            Options(rmse, max_error, gap=gap, effort=effort),
            memory=memory,
            executor=executor,
            progress=progress,
        )
    return replace(extended, report=report)


def decompress(
    archive: Archive | ArchiveSource,
    *,
    every: float | None = None,
    at: Times | None = None,
) -> list[Track]:
    """Give back the tracks of an archive.

    Parameters
    ----------
    archive : Archive, path or bytes
        What :func:`compress` returned or saved.
    every : float, optional
        Sample at the multiples of this many seconds.
    at : array_like, optional
        Sample at these times: ``datetime``, ``numpy.datetime64``, ISO 8601 text or seconds. Without
        ``every`` and ``at``, the knots are given, between which tracks are linear in time.

    Returns
    -------
    list of Track
        Named by their ids; the pieces of a track with gaps ``id/0``, ``id/1`` and so on. Their
        ``coordinates`` are those of the log: latitude and longitude, or x, y[, z].

    Examples
    --------
    >>> archive = compress(Track("lane", [0, 4, 8], [[0.0], [4.0], [8.0]]), max_error=0.1)
    >>> [track.coordinates.round().tolist() for track in decompress(archive, every=3.0)]
    [[[0.0], [3.0], [6.0]]]
    """
    # A path is opened first, with the map in its folder if it needs one.
    opened = archive if isinstance(archive, Archive) else open(archive)

    # Knots are what is stored; positions at certain times are interpolated between them.
    return opened.decompress() if every is None and at is None else opened.sample(every, at=at)


def match(
    tracks: Logs,
    network: Network | Archive | str | os.PathLike[str],
    *,
    sigma: float | None = None,
    beta: float | None = None,
    gap: float | None = None,
    heading: float | None = None,
    ignore_oneway: bool = False,
    progress: Listener | None = None,
) -> Matching:
    """Find the roads that tracks took, by a hidden Markov model.

    Parameters
    ----------
    tracks : Track or path, or sequence of either
        Tracks on one plane, which are not modified; or files, which are read as :func:`read` does,
        with their headings.
    network : Network, Archive or path
        The roads: a file that ``gpszip network`` reads or wrote, or an archive, for its map.
    sigma, beta : float, optional
        Scales in metres of the distance between log and roads, and of the difference between the
        distance over roads and the straight line. Estimated from the log by default.
    gap : float, optional
        Intervals longer than this, in seconds, break a route; ``math.inf`` for none. Estimated by
        default.
    heading : float, optional
        Spread in degrees of the headings that tracks have as attribute ``heading``
        (``gpszip.read(..., heading=True)``), in degrees clockwise from north; ``math.inf`` to leave
        them out. Estimated by default, and left out where they don't follow the roads.
    ignore_oneway : bool, default False
        Whether all roads may be travelled both ways, as by people on foot or on bicycles. Otherwise
        points that travel against a one-way road are on no road, and their break has the reason
        ``"one-way"``.
    progress : callable, optional
        Called with :class:`Progress` events.

    Returns
    -------
    Matching
        For each track its routes, the position of each sample on them, and where and why they
        break.

    Raises
    ------
    InputError
        If there are no tracks or no roads, or the roads lie elsewhere.
    OptionError
        If tracks and roads are not on one plane, or a scale is no positive number.

    Examples
    --------
    >>> walk = Track("walk", [0, 5, 10, 15, 20], [[0, 0], [5, 0], [10, 0], [10, 5], [10, 10]])
    >>> again = Track("again", [0, 8, 16], [[1, 0.1], [9, -0.1], [10, 7]])
    >>> matching = match(again, compress(walk, max_error=0.1))
    >>> matching.share, round(matching[0].pieces[0].length)
    (1.0, 16)
    """
    from gpszip.pipeline.match import match as match_tracks

    # Headings are read from files, so that they can help where they follow the roads.
    return match_tracks(
        _read_if_paths(tracks, heading=True),
        network,
        sigma=sigma,
        beta=beta,
        gap=gap,
        heading=heading,
        ignore_oneway=ignore_oneway,
        progress=progress,
    )


def merge(
    archives: Sequence[Archive | ArchiveSource],
    *,
    deviation: float | None = None,
    max_deviation: float | None = None,
    same_id: str = "refuse",
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> Archive:
    """Merge archives into one map, without their logs.

    Nodes and edges at the same position become one, and every track is kept with its times.

    Parameters
    ----------
    archives : sequence of Archive, path or bytes
        Two or more, all in degrees or all on one plane of x and y.
    deviation, max_deviation : float, optional
        Metres by which the tracks of each archive may be moved, in the root mean square or at any
        time. Without either, the smallest error bound that any of them had before any merge.
    same_id : {"refuse", "prefix", "join"}
        What becomes of tracks of one name in several archives: ``"prefix"`` names all tracks
        ``archive:track``, ``"join"`` makes them one track, if their times don't overlap.
    executor : Executor, optional
        Runs the work, by default on a thread for each core; the archive is the same for any number
        of workers.
    progress : callable, optional
        Called with :class:`Progress` events.

    Returns
    -------
    Archive
        Its error bound is that of the archives and the deviation together. ``archive.report`` says
        how far the tracks of each archive were moved.

    Raises
    ------
    OptionError
        If archives don't go together.
    BoundError
        If tracks would be moved farther than they may.

    Examples
    --------
    >>> lane = [[abs(t % 8 - 4.0), 0.0] for t in range(20)]
    >>> north, south = (Track(name, range(20), lane) for name in ("north", "south"))
    >>> both = merge([compress(north, max_error=0.1), compress(south, max_error=0.1)])
    >>> both.ids, bool(abs(both.position("south", 5.5)[0] - 1.5) < 0.2)
    (('north', 'south'), True)
    """
    from gpszip.model.merge_options import MergeOptions
    from gpszip.pipeline.merge import merge as merge_archives

    # Archives are named after their files, or numbered.
    opened = [archive if isinstance(archive, Archive) else open(archive) for archive in archives]
    names = [
        pathlib.Path(source).stem if isinstance(source, str | os.PathLike) else str(number)
        for number, source in enumerate(archives, 1)
    ]
    # The names are used in errors, and with ``same_id="prefix"`` in those of tracks.
    options = MergeOptions(deviation, max_deviation, same_id)
    merged, report = merge_archives(
        opened, options, names=names, executor=executor, progress=progress
    )
    return replace(merged, report=report)


def diff(
    first: Archive | Logs,
    second: Archive | Logs,
    *,
    gap: float | None = None,
    worst: int = 100,
) -> Difference:
    """Compare two archives or logs; tracks of one id are compared with each other.

    A log against an archive is compared at the log's samples, two logs at the times of both. Two
    archives are compared over all time, which is exact, as positions are linear between knots.

    Parameters
    ----------
    first, second : Archive, path, stream, Track, or sequence of Track or path
        Files are archives if they begin like one, else logs.
    gap : float, optional
        Intervals of logs longer than this, in seconds, are gaps, in which there is no position to
        compare. Estimated by default.
    worst : int, default 100
        Number of places to return where the two are farthest apart.

    Returns
    -------
    Difference
        Distances in metres, of each track and of all, and what only one of them has.

    Raises
    ------
    InputError, CorruptArchiveError
        If a file can't be read.
    OptionError
        If one is in degrees and the other in metres, or they are far from each other.

    Examples
    --------
    >>> lane = Track("lane", [0, 4, 8], [[0.0], [4.0], [8.0]])
    >>> found = diff(compress(lane, max_error=0.1), lane)
    >>> found.tracks[0].compared_at, found.total.maximum <= 0.1
    ('samples', True)
    """
    from gpszip.pipeline.diff import diff as diff_sides

    return diff_sides(_side_to_compare(first, gap), _side_to_compare(second, gap), worst=worst)


def trips(
    source: Archive | Logs,
    *,
    min_stay: float = 300.0,
    max_pause: float = 900.0,
    radius: float = 100.0,
    timezone: str | None = None,
) -> Trips:
    """Find the stays and trips of a log or an archive, and the places that they join.

    Parameters
    ----------
    source : Archive, path, stream, frame, Track, or sequence of Track or path
        A file is an archive if it begins like one, else a log. Tracks may have their errors in
        metres as the attribute ``accuracy``; logs are read with them, and put in the order of time.
    min_stay : float, default 300
        Seconds; shorter stops are no stays, unless a trip turns back at them.
    max_pause : float, default 900
        Seconds; shorter stays on the way don't end a trip.
    radius : float, default 100
        Metres around the centre of a place that belong to it.
    timezone : str, optional
        Time zone of local hours, such as ``Europe/Berlin``. By default that of the place where most
        time is spent, if the package timezonefinder is there, else UTC, by which no place is taken
        for home or work.

    Returns
    -------
    Trips
        With stays, trips, places, and the number of trips between places.

    Raises
    ------
    InputError, CorruptArchiveError
        If a file can't be read.
    OptionError
        If no track has times, there is no such time zone, or a number is not positive.

    Examples
    --------
    >>> times = np.arange(0, 3001, 10)
    >>> x = np.interp(times, [0, 1000, 2000, 3000], [0, 0, 5000, 5000])
    >>> found = trips(Track("phone", times, np.stack([x, 0 * x], axis=1)))
    >>> found
    Trips(1 trip, 2 stays, 2 places)
    >>> found.matrix, round(found.trips[0].length)
    ({(1, 2): 1}, 5000)
    """
    from gpszip.history.stays.find import trips_of_archive, trips_of_log
    from gpszip.history.stays.values import Settings

    # An archive.
    settings = Settings(min_stay, max_pause, radius)
    source = _open_if_archive(source)
    if isinstance(source, Archive):
        return trips_of_archive(source, settings, timezone)

    # A log.
    files = _files_among(source)
    if files is None:
        tracks = [source] if isinstance(source, Track) else cast("Sequence[Track]", source)
        return trips_of_log(tracks, settings, timezone)
    from gpszip.io.logs.read import read_logs

    read_result = read_logs(_as_names(files), accuracy=True, sort=True)
    _warn_of_losses(read_result)
    return trips_of_log(read_result.tracks, settings, timezone)


def usage(
    source: Archive | Logs,
    *,
    by: Sequence[str] = ("hour", "weekday"),
    timezone: str | None = None,
) -> Usage:
    """Count how often, how fast and when the edges of a map are travelled.

    Parameters
    ----------
    source : Archive, path, Track, or sequence of Track or path
        A file is an archive if it begins like one, else a log; a log is compressed on the way. The
        edges are those of the clean map, in the numbers of ``match(track, archive)``.
    by : sequence of str, default ("hour", "weekday")
        Parts of local time by which rows are split: ``hour``, ``weekday`` (0 is Monday),
        ``month``, ``period``, ``date``. Empty: a row for each edge and direction.
    timezone : str, optional
        Time zone of these parts, such as ``Europe/Berlin``. By default that of the place, if the
        package timezonefinder is there, else UTC.

    Returns
    -------
    Usage
        With columns of numbers, relative speeds of the tracks, and the Markov model of the map.

    Raises
    ------
    InputError, CorruptArchiveError
        If a file can't be read, or nothing moves in it.
    OptionError
        If there is no such part or zone, or tracks have no times, which parts need.

    Examples
    --------
    >>> from gpszip.testing import ring
    >>> used = usage(compress(ring(4, laps=6).tracks, max_error=5), by=["hour"])
    >>> used.columns["traversals"].sum() >= 6
    np.True_
    """
    from gpszip.pipeline.usage import usage as usage_of_archive

    return usage_of_archive(_archive_of(source), by=by, timezone=timezone)


def route(
    source: Archive | Logs,
    *places: Sequence[float],
    by: str = "time",
    depart: str | Times | None = None,
    alternatives: int = 0,
    timezone: str | None = None,
) -> tuple[PlannedRoute, ...]:
    """Plan a route over the map of an archive, in directions that were travelled.

    Parameters
    ----------
    source : Archive, path, Track, or sequence of Track or path
        As for :func:`usage`.
    *places : sequence of float
        Where the route begins, passes and ends, as latitude and longitude, or x and y.
    by : str, default "time"
        What the route minimises: ``time``, ``length``, or ``traversals``: metres divided by the
        traversals of their edge, for the most travelled route.
    depart : str or time, optional
        Departure: a time of day such as ``08:00`` on the last day of the log, or a time as for
        :meth:`Archive.position`. By default means over the day count.
    alternatives : int, default 0
        Alternatives to look for, if there are two places.
    timezone : str, optional
        As for :func:`usage`.

    Returns
    -------
    tuple of PlannedRoute
        The best one first. With times in the log, each has its seconds and a band of 80 %.

    Raises
    ------
    InputError, CorruptArchiveError
        If a file can't be read, or nothing moves in it.
    OptionError
        If a place is far from the map, no route leads there, or times are needed and missing.

    Examples
    --------
    >>> from gpszip.testing import ring
    >>> archive = compress(ring(4, laps=6).tracks, max_error=5)
    >>> corners = archive.clean_map().points[[0, 3]]
    >>> planned = route(archive, *corners)[0]
    >>> planned.length > 0, planned.arrival.low <= planned.arrival.high
    (True, True)
    """
    from gpszip.pipeline.route import plan_route

    plan = plan_route(
        _archive_of(source),
        places,
        by=by,
        depart=depart,
        alternatives=alternatives,
        timezone=timezone,
    )
    return plan.routes


def rounds(source: Archive | Logs, *, since: Times | None = None) -> Rounds:
    """Find the usual round of a patrol, and compare all rounds with it.

    Parameters
    ----------
    source : Archive, path, Track, or sequence of Track or path
        As for :func:`usage`; of one agent, or of several with the same round.
    since : time, optional
        Only rounds and visits from this time on are told; the usual round is that of all. A time
        as for :meth:`Archive.position`.

    Returns
    -------
    Rounds
        The usual round, all rounds with their scores, and the visits of edges.

    Raises
    ------
    InputError, CorruptArchiveError
        If a file can't be read, nothing moves in it, or travel doesn't repeat in rounds.

    Examples
    --------
    >>> corners = [[0, 0], [90, 0], [90, 60], [0, 60]]
    >>> guard = Track("guard", [30.0 * i for i in range(41)], [*corners * 10, [0, 0]])
    >>> found = rounds(guard)
    >>> len(found.rounds), found.rounds[0].share
    (10, 1.0)
    """
    from gpszip.history.rounds import find_rounds
    from gpszip.history.traversals import read_history
    from gpszip.model.timestamps import to_seconds

    first = None if since is None else float(to_seconds(since)[0])
    return find_rounds(read_history(_archive_of(source)), first)


def changes(
    old: Archive | Logs,
    new: Archive | Logs | None = None,
    *,
    since: Times | None = None,
    false_alarms: float = 0.1,
    threshold: float | None = None,
    kinds: Sequence[str] = (
        "closed",
        "reopened",
        "new",
        "moved",
        "slower",
        "faster",
        "one-way",
    ),
) -> Changes:
    """Find closed, reopened, new, moved, slower, faster and one-way edges.

    Parameters
    ----------
    old : Archive, path, Track, or sequence of Track or path
        As for :func:`usage`.
    new : Archive, path, Track, or sequence of Track or path, optional
        What is compared with it, on a map learned from both.
    since : time, optional
        Instead: the time from which on ``old`` is compared with the time before, as for
        :meth:`Archive.position`.
    false_alarms : float, default 0.1
        False alarms of closures a day that the threshold of evidence is chosen for, by watching a
        part of the time before with what was learnt from another.
    threshold : float, optional
        Nats of evidence, instead.
    kinds : sequence of str
        Kinds to look for; by default all.

    Returns
    -------
    Changes
        Each change has its kind, edge and direction, time, evidence and delay.

    Raises
    ------
    InputError, CorruptArchiveError
        If a file can't be read, or nothing moves in it.
    OptionError
        If tracks have no times, or nothing was travelled before or after.

    Examples
    --------
    >>> from gpszip.testing import close_road, fleet
    >>> log = close_road(fleet(3, lines=1, points=900, blocks=3, seed=2), 7, since=2500.0)
    >>> changes(compress(log.tracks, rmse=6, effort=1), since=2500.0).since >= 2500.0
    True
    """
    from gpszip.pipeline.changes import changes as changes_of_archives

    return changes_of_archives(
        _archive_of(old),
        None if new is None else _archive_of(new),
        since=since,
        false_alarms=false_alarms,
        threshold=threshold,
        kinds=kinds,
    )


def unusual(
    log: Logs,
    archive: Archive | str | os.PathLike[str],
    *,
    timezone: str | None = None,
    coded: bool = False,
) -> Unusual:
    """Score how unusual the trips of a log are, given an archive of earlier trips there.

    Scores are bits: each doubles the surprise. They add up what the strangest part of the trip's
    route takes (rare turns, another way than usual, wrong directions), travel off the map, and
    paces and stops that one of thousands has. Trips are those of :func:`trips`.

    Parameters
    ----------
    log : Track or path, or sequence of either
        Tracks with times. Agents are known by their names: those of tracks of the archive.
    archive : Archive or path
        What is usual.
    timezone : str, optional
        Time zone of hours, such as ``Europe/Berlin``; by default that of the place, where the
        package timezonefinder is there to tell it, else UTC.
    coded : bool, default False
        Tell also what the archive's own coder takes to write the path of each trip and part, as
        ``coded_bits``. This compresses the log on the map of the archive.

    Returns
    -------
    Unusual
        Each trip with its score, reason and unusual parts, and hours at which agents always travel
        and did not.

    Raises
    ------
    InputError, CorruptArchiveError
        If a file can't be read, the log is elsewhere, or a track has no times.

    Examples
    --------
    >>> from gpszip.testing import ring
    >>> laps = ring(6, laps=9).tracks
    >>> (trip,) = unusual(laps, compress(laps, max_error=5)).trips
    >>> trip.score < 10, trip.reason
    (True, 'nothing unusual')
    """
    from gpszip.pipeline.unusual import unusual as unusual_in_archive

    tracks = _read_if_paths(log)
    tracks = [tracks] if isinstance(tracks, Track) else list(tracks)
    opened = archive if isinstance(archive, Archive) else open_archive(archive)
    return unusual_in_archive(tracks, opened, timezone=timezone, coded=coded)


def _archive_of(source: Archive | Logs) -> Archive:
    """An archive as it is, or one of a log, compressed on the way with little effort."""
    source = _open_if_archive(source)
    return source if isinstance(source, Archive) else compress(source, effort=1)


def _open_if_archive(source: Archive | Logs) -> Archive | Logs:
    """Open a file that begins as an archive does; everything else stays as it is."""
    from gpszip.pipeline.diff import holds_archive

    if isinstance(source, str | os.PathLike) and pathlib.Path(source).is_file():
        with pathlib.Path(source).open("rb") as file:
            if holds_archive(file.read(8)):
                return open_archive(source)
    return source


def join(archives: Sequence[Archive | ArchiveSource]) -> Archive:
    """Join archives that lie on one grid, such as parts of one archive; nothing is learned anew.

    Tracks of one id become one, if they follow each other in time. :func:`merge` takes archives on
    any grid.

    Parameters
    ----------
    archives : sequence of Archive, path, bytes or binary file
        At least one.

    Returns
    -------
    Archive
        It states the largest of the error bounds, if all archives state one of a kind.

    Raises
    ------
    OptionError
        If grids or known maps differ, tracks of one id overlap in time, or archives keep different
        columns.

    Examples
    --------
    >>> lane = Track("lane", range(20), [[abs(t % 8 - 4.0), 0.0] for t in range(20)])
    >>> archive = compress(lane, max_error=0.1)
    >>> whole = join([archive.select(until=9), archive.select(since=9)])
    >>> whole.to_bytes() == archive.to_bytes()
    True
    """
    from gpszip.archive.join import join as join_archives

    opened = [archive if isinstance(archive, Archive) else open(archive) for archive in archives]
    names = [
        str(source) if isinstance(source, str | os.PathLike) else f"archive {number}"
        for number, source in enumerate(archives, 1)
    ]
    return join_archives(opened, names=names)


def open(source: ArchiveSource, map: Archive | ArchiveSource | None = None) -> Archive:
    """Open an archive.

    Of a file beyond a megabyte only the index and the names are read, and then the groups of tracks
    that a question needs. Such a file must stay as it is as long as the archive is in use.

    Parameters
    ----------
    source : path, bytes or binary file
        A ``.gpsz`` file or its bytes. A binary file needs ``seek`` and ``read``.
    map : Archive, path, bytes or binary file, optional
        The map, for an archive that was written on one. Where left out, it is looked for in the
        folder of the file.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    MapError
        If another map is given than the archive was written on.
    CorruptArchiveError
        If it is not a complete archive. Damage to a group of a large file shows when the group is
        read; ``gpszip verify`` checks every byte.

    Examples
    --------
    >>> lane = Track("lane", [0, 4, 8], [[0.0], [4.0], [8.0]])
    >>> data = compress(lane, max_error=0.1).to_bytes()
    >>> open(data).ids
    ('lane',)
    """
    # This module's ``open`` hides Python's own, which is not used here.
    return open_archive(source, map)


def patch(
    tracks: Logs,
    network: Network | Archive | str | os.PathLike[str],
    *,
    gap: float | None = None,
    ignore_oneway: bool = False,
) -> Patching:
    """Fill the gaps of tracks with the likeliest routes over roads.

    Parameters
    ----------
    tracks : Track or path, or sequence of either
        Tracks on one plane, which are not modified; or files, which are read as :func:`read` does.
    network : Network, Archive or path
        The roads: a file that ``gpszip network`` reads or wrote, or an archive, for its map.
    gap : float, optional
        Intervals longer than this, in seconds, are gaps. Estimated by default.
    ignore_oneway : bool, default False
        Whether all roads may be travelled both ways, as by people on foot or on bicycles.

    Returns
    -------
    Patching
        The samples to add to each gap, or why it was left open; ``to_tracks()`` gives tracks with
        them.

    Raises
    ------
    InputError
        If there are no tracks or no roads, or the roads lie elsewhere.
    OptionError
        If tracks and roads are not on one plane.

    Examples
    --------
    >>> corner = [[min(5.0 * t, 50.0), max(5.0 * t - 50.0, 0.0)] for t in range(20)]
    >>> walk = Track("walk", range(0, 100, 5), corner)
    >>> rows = [0, 1, 2, 3, 14, 15, 16]
    >>> gappy = Track("gappy", [5 * row for row in rows], [corner[row] for row in rows])
    >>> patching = patch(gappy, compress(walk, max_error=0.1), gap=30.0)
    >>> patching.filled, len(patching.to_tracks()[0]), round(patching.patches[0].length)
    (1, 17, 55)
    """
    from gpszip.pipeline.match import patch as patch_tracks

    return patch_tracks(
        _read_if_paths(tracks, heading=True), network, gap=gap, ignore_oneway=ignore_oneway
    )


def segment_mean(
    tracks: Sequence[Track] | Track | Coreset | CoresetStream,
    k: int | tuple[int, int] | None = None,
    m: int | tuple[int, int] | None = None,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    gap: float = math.inf,
    coreset: int | None = None,
    memo: str | os.PathLike[str] | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> SegmentMean:
    """Approximate tracks by k parts, each travelled along one of m segments: Algorithm 1.

    Parameters
    ----------
    tracks : Track, sequence of Track, Coreset or CoresetStream
        n samples in all, on one plane. Parts of all tracks share the segments, and no part goes on
        from track to track. Weights of samples count. With a coreset in place of tracks, the cost
        is its estimate, boundaries count the samples of the log, and an RMSE is held at them by
        the bounds of the coreset.
    k, m : int or (int, int), optional
        Numbers of parts and of segments, 1 <= m <= k <= n. Of a range, and of those left out, the
        numbers at the elbow of the fitting cost are found (Algorithms 3 and 4).
    rmse, max_error : float, optional
        Bounds in metres on the error of the samples. Where k or m is left out, it is the least that
        holds them; where both are, few numbers describe the result.
    gap : float, default infinite
        Longer intervals between samples, in seconds, are gaps, which no part crosses.
    coreset : int, optional
        Learn from a coreset of the tracks of this many blocks. Bounds are checked at all samples.
    memo : path, optional
        Folder in which a search for the elbow keeps what it has solved.
    executor : Executor, optional
        Runs the work.
    progress : callable, optional
        Called with a :class:`Progress` for each step.

    Returns
    -------
    SegmentMean
        Boundaries, labels, segments in metres, and the fitting cost in square metres.

    Raises
    ------
    OptionError
        If k or m don't fit the tracks.
    BoundError
        If no numbers that are allowed hold the bound.

    Examples
    --------
    >>> there_and_back = [0, 2, 4, 6, 8, 10, 10, 8, 6, 4, 2, 0]
    >>> track = Track("lane", range(24), [[x] for x in 2 * there_and_back])
    >>> mean = segment_mean(track, k=4, m=2)
    >>> mean.labels.tolist(), round(mean.cost, 6)
    ([0, 1, 0, 1], 0.0)
    >>> segment_mean(track, k=4, rmse=0.1).m
    2
    """
    from gpszip.pipeline.segment_mean import segment_mean as find_segment_mean
    from gpszip.segmentation.memo import Memo

    return find_segment_mean(
        tracks,
        k,
        m,
        rmse=rmse,
        max_error=max_error,
        gap=gap,
        coreset=coreset,
        memo=None if memo is None else Memo(memo),
        executor=executor,
        progress=progress,
    )


def markov_model(
    mean: SegmentMean, tracks: Sequence[Track] | Track | Coreset | CoresetStream
) -> MarkovModel:
    """Return the Markov model of a segment mean: transitions, and the spread of samples.

    Parameters
    ----------
    mean : SegmentMean
        Of these tracks.
    tracks : Track, sequence of Track, Coreset or CoresetStream
        The tracks, or their coreset.

    Examples
    --------
    >>> there_and_back = [0, 2, 4, 6, 8, 10, 10, 8, 6, 4, 2, 0]
    >>> track = Track("lane", range(24), [[x] for x in 2 * there_and_back])
    >>> model = markov_model(segment_mean(track, k=4, m=2), track)
    >>> model.transitions.tolist(), model.counts.tolist(), model.probabilities.tolist()
    ([[0, 1], [1, 0]], [2, 1], [1.0, 1.0])
    """
    from gpszip.pipeline.segment_mean import as_signal, fit_model

    return fit_model(as_signal(tracks, math.inf), mean)[0]


def log_likelihood(
    model: MarkovModel, tracks: Sequence[Track] | Track, *, gap: float = math.inf
) -> Likelihood:
    """Return the log-likelihood of tracks under the Markov model of others.

    The tracks are cut into parts that follow the segments of the model: cost plus a price for each
    part is least.

    Parameters
    ----------
    model : MarkovModel
        The model.
    tracks : Track or sequence of Track
        On the plane of the model.
    gap : float, default infinite
        Longer intervals between samples, in seconds, are gaps.

    Raises
    ------
    OptionError
        If the tracks don't lie on the plane of the model.

    Examples
    --------
    >>> there_and_back = [0, 2, 4, 6, 8, 10, 10, 8, 6, 4, 2, 0]
    >>> track = Track("lane", range(24), [[x] for x in 2 * there_and_back])
    >>> model = markov_model(segment_mean(track, k=4, m=2), track)
    >>> away = Track("away", range(12), [[x + 1] for x in there_and_back])
    >>> log_likelihood(model, track).per_sample > log_likelihood(model, away).per_sample
    True
    """
    from gpszip.pipeline.segment_mean import find_likelihood_of

    return find_likelihood_of(model, tracks, gap)


def coreset(
    tracks: Logs,
    *,
    k: int | None = None,
    eps: float | None = None,
    size: int | None = None,
    max_bytes: int | None = None,
    memory: int | None = None,
    executor: Executor | None = None,
) -> Coreset:
    """Build the (k, eps)-coreset of tracks: blocks that give the fitting cost of any k-segment.

    A k-segment is a function of time made of k straight lines. The coreset is deterministic, and
    coresets can be merged.

    Parameters
    ----------
    tracks : Track or path, or sequence of either
        Tracks on one plane, with different ids; or files, which are read as :func:`read` does.
    k, eps : int and float, optional
        The estimated cost of every k-segment is to be within ``eps`` of the true one (thesis,
        definition 4.1.6).
    size : int, optional
        Largest number of blocks, instead.
    max_bytes : int, optional
        Largest size of the file that :func:`save_coreset` writes, instead.
    memory : int, optional
        Bytes that the process may take, as for :func:`compress`. A coreset of files that take more
        is merged from batches.
    executor : Executor, optional
        Runs the work on batches.

    Returns
    -------
    Coreset
        Its ``cost`` gives the fitting cost of a function, with bounds that hold wherever its breaks
        are.

    Raises
    ------
    OptionError
        If the size is given more than once or not at all, or is out of range.

    Examples
    --------
    >>> track = Track("lane", range(1000), [[t % 100] for t in range(1000)])
    >>> len(coreset(track, size=20))
    10
    """
    from gpszip.pipeline.coreset import sketch_log
    from gpszip.sketches.partition import build_coreset

    # No column is kept: a coreset holds moments of times and positions only.
    with _open_log(tracks, memory, None, (), True, None) as log:
        # Tracks in memory, given or read from files, get the balanced partition of all samples.
        if isinstance(log, MemoryLog | Track | Sequence):
            in_memory = log.tracks if isinstance(log, MemoryLog) else log
            return build_coreset(in_memory, k=k, eps=eps, size=size, max_bytes=max_bytes)

        # A log on disk is sketched batch by batch.
        return sketch_log(log, k=k, eps=eps, size=size, max_bytes=max_bytes, executor=executor)


def open_coreset(source: str | os.PathLike[str]) -> Coreset:
    """Load a coreset that :func:`save_coreset` or ``gpszip coreset`` wrote.

    Raises
    ------
    InputError
        If there is no such file or it is no coreset.
    """
    from gpszip.io.coresets import read_coreset

    return read_coreset(os.fspath(source))


def save_coreset(coreset: Coreset, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Save a coreset as a Parquet file, with one row for each block.

    Raises
    ------
    OutputError
        If the file exists and ``force`` is not given, or it can't be written.
    """
    from gpszip.io.coresets import write_coreset

    write_coreset(coreset, os.fspath(path), force=force)


def _is_log_source(value: object) -> bool:
    """Whether this is a single log to read: a path, a pattern, a stream or a frame."""
    # Streams are known by their method, as files, BytesIO and sockets share no class.
    return isinstance(value, str | os.PathLike) or hasattr(value, "read") or is_frame(value)


def _as_names(sources: Iterable[LogSource]) -> list[str | BinaryIO | FrameSource]:
    """Return paths of any kind as text, streams as they are, and frames as sources."""
    from gpszip.io.frames.source import frame_sources

    # Readers take text, since a pattern or - is no path.
    listed = list(sources)
    frames = iter(frame_sources([each for each in listed if is_frame(each)]))
    return [
        next(frames)
        if is_frame(each)
        else os.fspath(each)
        if isinstance(each, os.PathLike)
        else cast("str | BinaryIO", each)
        for each in listed
    ]


def _side_to_compare(source: Archive | Logs, gap: float | None) -> Side:
    """An archive or a log as what is compared; files are opened or read."""
    from gpszip.pipeline.diff import side_of_archive, side_of_log

    # An archive.
    source = _open_if_archive(source)
    if isinstance(source, Archive):
        return side_of_archive(source)

    # A log.
    tracks = _read_if_paths(source)
    return side_of_log([tracks] if isinstance(tracks, Track) else tuple(tracks), gap)


def _files_among(tracks: Logs) -> list[LogSource] | None:
    """Files and frames that were given in place of tracks; None for tracks."""
    # A track has a length and takes slices, but can't be listed as a sequence can.
    if isinstance(tracks, Track):
        return None
    if _is_log_source(tracks):
        return [cast("LogSource", tracks)]

    # A sequence of one kind.
    values = list(cast("Sequence[Track | LogSource]", tracks))
    files = [cast("LogSource", value) for value in values if _is_log_source(value)]
    if files and len(files) < len(values):
        raise OptionError("tracks and logs were given together", remedy="read the logs first")
    # An empty sequence passes for tracks: whoever takes them says that there are none.
    return files or None


def _read_if_paths(tracks: Logs, *, heading: bool = False) -> Sequence[Track] | Track:
    """Tracks as they were given, or read from the files that were given."""
    files = _files_among(tracks)
    if files is None:
        return cast("Sequence[Track] | Track", tracks)
    # What was read is a sequence of tracks itself.
    return read(files, heading=heading)


@contextmanager
def _open_log(
    tracks: Logs,
    memory: int | None,
    plane: Plane | None,
    keep: Sequence[str],
    times: bool,
    progress: Listener | None,
    thesis: bool = False,
    *,
    heights: bool = False,
) -> Iterator[Sequence[Track] | Track | Log]:
    """Tracks as they were given, or the files that were given, in memory or on disk."""
    # Tracks are passed on as they are: there is nothing to read, and nothing to close.
    files = _files_among(tracks)
    if files is None:
        yield cast("Sequence[Track] | Track", tracks)
        return

    # Readers of files are imported only now: tracks in memory don't need them.
    from gpszip.pipeline.open_log import open_log

    with open_log(
        _as_names(files),
        memory=memory,
        plane=plane,
        progress=progress,
        thesis=thesis,
        keep=keep,
        heights=heights,
        times=times,
    ) as log:
        if log.read_result is not None:
            # Warn before work that may take long.
            _warn_of_losses(log.read_result)
        # The caller compresses within this block; afterwards a log on disk is removed.
        yield log


@contextmanager
def _open_exactly(tracks: Logs) -> Iterator[Sequence[Source | InputError]]:
    """Find the files that are kept byte by byte."""
    from gpszip.io.logs.formats import is_bundle
    from gpszip.io.storage.source import spooled

    # A stream could be read only once.
    files = _files_among(tracks)
    names = None if files is None else _as_names(files)
    if names is None or not all(isinstance(name, str) and name != "-" for name in names):
        raise OptionError(
            "lossless keeps files, and was given tracks or streams", remedy="name the files"
        )
    with spooled(names, unzip=is_bundle) as sources:
        yield sources


def _warn_of_losses(result: ReadResult) -> None:
    """Warn at the line of the user, whether it reads files or compresses them."""
    # Count the frames of this module and of contextlib, which runs _open_log, between here and the
    # user's line. A warning that points into GPSZip would not tell which call lost points.
    depth, caller = 1, sys._getframe(1)
    while caller.f_back is not None and caller.f_globals.get("__name__") in {
        __name__,
        "contextlib",
    }:
        caller, depth = caller.f_back, depth + 1

    # One more frame: that of this function.
    for loss in result.losses:
        warnings.warn(f"lost {loss}", LossWarning, stacklevel=depth + 1)
