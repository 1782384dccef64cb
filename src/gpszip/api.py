"""The main path: read logs, compress them to an archive, open it again, and ask it.

Each function here is one call into :mod:`gpszip.pipeline`, or into the package that does the work.
"""

from __future__ import annotations

import os
import pathlib
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from gpszip.archive import Archive, open_archive
from gpszip.errors import LossWarning
from gpszip.model import Listener, Network, Options, SegmentMean, Track
from gpszip.run.executor import Executor

if TYPE_CHECKING:
    from gpszip.model.match import Matching
    from gpszip.model.patching import Patching
    from gpszip.sketches.coreset import Coreset

__all__ = [
    "append",
    "compress",
    "coreset",
    "decompress",
    "match",
    "merge",
    "open",
    "open_coreset",
    "patch",
    "read",
    "save_coreset",
    "segment_mean",
]


def read(sources: Any, **options: Any) -> list[Track]:
    r"""Read tracks from logs.

    Parameters
    ----------
    sources : path, str or sequence of them
        Files and globs: CSV, GPX, GeoJSON, Parquet, known by their content.
    **options
        What :func:`gpszip.io.logs.read.read_logs` takes.

    Returns
    -------
    list of Track
        All on one plane, in metres and seconds.

    Raises
    ------
    InputError
        If a log can't be read, or holds no track.

    Warns
    -----
    LossWarning
        For each track that lost more than a tenth of its points, vanished, or has several points at one time.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = pathlib.Path(folder, "walk.csv")
    ...     _ = log.write_text("t,x,y\n0,0,0\n1,1,0\n2,2,0\n")
    ...     tracks = read(log)
    >>> tracks[0].positions.tolist()
    [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]
    """
    from gpszip.io.logs.read import read_logs

    reading = read_logs(sources, **options)
    for loss in reading.losses:
        warnings.warn(f"lost {loss}", LossWarning, stacklevel=2)
    return list(reading.tracks)


def compress(
    tracks: Sequence[Track] | Track,
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
    layer: str | None = None,
    effort: int = 5,
    coreset: int | None = None,
    map: Archive | str | os.PathLike[str] | bytes | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> Archive:
    """Learn the map that tracks repeat, and store each of them as a walk on it.

    Parameters
    ----------
    tracks : sequence of Track, or one Track
        On one plane, with different ids; they are not modified.
    rmse, max_error : float, optional
        Bound on the root mean square, or on the largest, distance in metres between a sample and the decoded position
        at its time.
    size : int, optional
        Largest number of bytes; the smallest RMSE that they allow is found.
    ratio : float, optional
        The same as a share: at most a ratio-th of what the tracks take as numbers of 8 bytes, times and coordinates. Give
        one of these, or ``rmse`` and ``max_error`` together. Without any, a sensible RMSE is estimated, and a maximum of
        four times that.
    gap : float, optional
        Silences longer than this, in seconds, claim no travel; ``math.inf`` for none. Estimated by default.
    k, m : int, optional
        Use the thesis's model of k parts on m independent segments (Algorithm 1) instead; one track only.
    times : bool, default True
        Keep the times of the knots.
    keep : sequence of str
        Attributes of the tracks to keep exactly, with the times of the samples: see :meth:`Archive.attributes`.
    keep_times : bool, default False
        Keep the times of the samples exactly, also without attributes.
    layer : str, optional
        ``"bz2"`` packs the archive once more, as the thesis did.
    effort : int, default 5
        From 1, quick, to 9, small.
    coreset : int, optional
        Learn from the weighted points of a coreset of so many blocks, for speed; the bound is measured at all samples.
    map : Archive, path or bytes, optional
        Lay the tracks as walks on the map of this archive, which is not stored again: :func:`open` needs it, too. What lies off
        the map is in :attr:`Archive.new_ways`.
    executor : Executor, optional
        Spreads the work, by default over a thread for each core; the archive is the same for any number of workers.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.

    Returns
    -------
    Archive
        Its bytes hold the bound at every sample.

    Raises
    ------
    OptionError
        If options contradict each other or the tracks.
    BoundError
        If the bound can't be held, or no archive is as small as it should be.

    Examples
    --------
    >>> track = Track("lane", range(20), [[abs(t % 8 - 4.0), 0.0] for t in range(20)])
    >>> archive = compress(track, max_error=0.1)
    >>> abs(archive.position("lane", 5.5)[0] - 1.5) < 0.1
    np.True_
    """
    from gpszip.pipeline.compress import compress as compress_tracks

    names = (keep,) if isinstance(keep, str) else tuple(keep)
    options = Options(
        rmse, max_error, size, ratio, gap, k, m, times, names, keep_times, layer, effort, coreset
    )
    there = map if map is None or isinstance(map, Archive) else open_archive(map)
    return compress_tracks(tracks, options, map=there, executor=executor, progress=progress)[0]


def append(
    archive: Archive | str | os.PathLike[str] | bytes,
    tracks: Sequence[Track] | Track,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    gap: float | None = None,
    effort: int = 5,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> Archive:
    """Add tracks to an archive: its walks stay as they are, its map grows.

    Parameters
    ----------
    archive : Archive, path or bytes
        With times and a map of its own; it is not modified.
    tracks : sequence of Track, or one Track
        One whose name is in the archive goes on there, and must begin where that one ends, or later.
    rmse, max_error : float, optional
        Bound on the error of the new tracks in metres; what the archive promises where both are left out.
    gap : float, optional
        Silences longer than this, in seconds, claim no travel. Estimated by default.
    effort : int, default 5
        From 1, quick, to 9, small.
    executor : Executor, optional
        Spreads the work.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.

    Returns
    -------
    Archive
        The old walks and the new ones on one map.

    Raises
    ------
    OptionError
        If archive and tracks don't go together.
    BoundError
        If the bound can't be held on the archive's lattice.

    Examples
    --------
    >>> monday = Track("monday", range(20), [[abs(t % 8 - 4.0), 0.0] for t in range(20)])
    >>> tuesday = Track("tuesday", range(100, 120), monday.positions)
    >>> archive = append(compress(monday, max_error=0.1), tuesday)
    >>> archive.tracks, len(archive.road_map.edges)
    (('monday', 'tuesday'), 2)
    """
    from gpszip.pipeline.append import append as grow

    there = archive if isinstance(archive, Archive) else open_archive(archive)
    return grow(
        there,
        tracks,
        Options(rmse, max_error, gap=gap, effort=effort),
        executor=executor,
        progress=progress,
    )[0]


def decompress(
    archive: Archive | str | os.PathLike[str] | bytes,
    *,
    every: float | None = None,
    at: ArrayLike | None = None,
) -> list[Track]:
    """Give back the tracks of an archive.

    Parameters
    ----------
    archive : Archive, path or bytes
        What :func:`compress` returned or saved.
    every : float, optional
        Sample at the whole multiples of so many seconds.
    at : array_like, optional
        Sample at these instants in seconds. Without any, the knots are given, between which tracks are linear in time.

    Returns
    -------
    list of Track
        Named by their ids; the pieces of a track with gaps ``id/0``, ``id/1`` and so on.

    Examples
    --------
    >>> archive = compress(Track("lane", [0, 4, 8], [[0.0], [4.0], [8.0]]), max_error=0.1)
    >>> [track.positions.round().tolist() for track in decompress(archive, every=3.0)]
    [[[0.0], [3.0], [6.0]]]
    """
    opened = archive if isinstance(archive, Archive) else open(archive)
    return opened.decompress() if every is None and at is None else opened.sample(every, at=at)


def match(
    tracks: Sequence[Track] | Track,
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
    tracks : sequence of Track, or one Track
        On one plane; they are not modified.
    network : Network, Archive or path
        The roads: a file that ``gpszip network`` reads or wrote, or an archive, for its map.
    sigma, beta : float, optional
        Scales in metres of the distance between log and roads, and of the difference between the way over roads and the
        straight line. Estimated from the log by default.
    gap : float, optional
        Silences longer than this, in seconds, break a route; ``math.inf`` for none. Estimated by default.
    heading : float, optional
        Spread in degrees of the headings that tracks have as attribute ``heading`` (``gpszip.read(..., heading=True)``), in degrees
        clockwise from north; ``math.inf`` to leave them out. Estimated by default, and left out where they don't follow the roads.
    ignore_oneway : bool, default False
        Whether all roads may be travelled both ways, as by those who walk or cycle. Otherwise points that travel against a
        one-way road are on no road, and their break has the reason ``"one-way"``.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.

    Returns
    -------
    Matching
        For each track its routes, the place of each sample on them, and where and why they break.

    Raises
    ------
    InputError
        If there are no tracks or no roads, or the roads lie elsewhere.
    OptionError
        If tracks and roads are not on one plane, or a scale is no positive number.

    Examples
    --------
    >>> walk = Track("walk", [0, 5, 10, 15, 20], [[0, 0], [5, 0], [10, 0], [10, 5], [10, 10]])
    >>> found = match(Track("again", [0, 8, 16], [[1, 0.1], [9, -0.1], [10, 7]]), compress(walk, max_error=0.1))
    >>> found.share, round(found[0].pieces[0].length)
    (1.0, 16)
    """
    from gpszip.pipeline.match import match as match_tracks

    return match_tracks(
        tracks, network, sigma=sigma, beta=beta, gap=gap, heading=heading, ignore_oneway=ignore_oneway, progress=progress
    )  # fmt: skip


def merge(
    archives: Sequence[Archive | str | os.PathLike[str] | bytes],
    *,
    deviation: float | None = None,
    max_deviation: float | None = None,
    same_id: str = "refuse",
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> Archive:
    """Unite archives on one map, without their logs.

    Places and ways that are the same become one, and every track is kept with its times. :func:`gpszip.pipeline.merge` also
    reports how far each archive's tracks were moved.

    Parameters
    ----------
    archives : sequence of Archive, path or bytes
        Two or more, all in degrees or all on one plane of x and y.
    deviation, max_deviation : float, optional
        Metres by which the tracks of each archive may be moved, in the root mean square or at any instant. Without either,
        the least that any of them promised before any merge.
    same_id : str, default "refuse"
        What becomes of tracks of one name in several archives: ``"prefix"`` names all tracks ``archive:track``, ``"join"``
        makes them one track, if their times don't overlap.
    executor : Executor, optional
        Spreads the work, by default over a thread for each core; the archive is the same for any number of workers.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.

    Returns
    -------
    Archive
        It promises what they promised and the deviation together.

    Raises
    ------
    OptionError
        If archives don't go together.
    BoundError
        If tracks would be moved farther than they may.

    Examples
    --------
    >>> one, two = (Track(name, range(20), [[abs(t % 8 - 4.0), 0.0] for t in range(20)]) for name in ("one", "two"))
    >>> both = merge([compress(one, max_error=0.1), compress(two, max_error=0.1)])
    >>> both.tracks, abs(both.position("two", 5.5)[0] - 1.5) < 0.2
    (('one', 'two'), np.True_)
    """
    from gpszip.model.merge_options import MergeOptions
    from gpszip.pipeline.merge import merge as merge_archives

    opened = [archive if isinstance(archive, Archive) else open(archive) for archive in archives]
    names = [
        pathlib.Path(one).stem if isinstance(one, str | os.PathLike) else str(number)
        for number, one in enumerate(archives, 1)
    ]
    options = MergeOptions(deviation, max_deviation, same_id)
    return merge_archives(opened, options, names=names, executor=executor, progress=progress)[0]


def open(
    source: str | os.PathLike[str] | bytes,
    map: Archive | str | os.PathLike[str] | bytes | None = None,
) -> Archive:
    """Open an archive.

    Parameters
    ----------
    source : path or bytes
        A ``.gpsz`` file, or all that is in one.
    map : Archive, path or bytes, optional
        The map, for an archive that was written on one. It is looked for in the folder of the file where left out.

    Raises
    ------
    InputError
        If there is no such file or it can't be read.
    MapError
        If another map is given than the archive was written on.
    CorruptArchiveError
        If it is no whole archive.

    Examples
    --------
    >>> data = compress(Track("lane", [0, 4, 8], [[0.0], [4.0], [8.0]]), max_error=0.1).to_bytes()
    >>> open(data).tracks
    ('lane',)
    """
    return open_archive(source, map)


def patch(
    tracks: Sequence[Track] | Track,
    network: Network | Archive | str | os.PathLike[str],
    *,
    gap: float | None = None,
    ignore_oneway: bool = False,
) -> Patching:
    """Fill the gaps of tracks with the likeliest ways over roads.

    Parameters
    ----------
    tracks : sequence of Track, or one Track
        On one plane; they are not modified.
    network : Network, Archive or path
        The roads: a file that ``gpszip network`` reads or wrote, or an archive, for its map.
    gap : float, optional
        Silences longer than this, in seconds, are gaps. Estimated by default.
    ignore_oneway : bool, default False
        Whether all roads may be travelled both ways, as by those who walk or cycle.

    Returns
    -------
    Patching
        The samples to add to each gap, or why it was left open; ``to_tracks()`` gives tracks with them.

    Raises
    ------
    InputError
        If there are no tracks or no roads, or the roads lie elsewhere.
    OptionError
        If tracks and roads are not on one plane.

    Examples
    --------
    >>> walk = Track("walk", range(0, 100, 5), [[min(5.0 * t, 50.0), max(5.0 * t - 50.0, 0.0)] for t in range(20)])
    >>> torn = Track("torn", [0, 5, 10, 15, 70, 75, 80], [[0, 0], [5, 0], [10, 0], [15, 0], [50, 20], [50, 25], [50, 30]])
    >>> patching = patch(torn, compress(walk, max_error=0.1), gap=30.0)
    >>> patching.filled, len(patching.to_tracks()[0]), round(patching.patches[0].length)
    (1, 17, 55)
    """
    from gpszip.pipeline.match import patch as patch_tracks

    return patch_tracks(tracks, network, gap=gap, ignore_oneway=ignore_oneway)


def segment_mean(
    track: Track, k: int | None = None, m: int | None = None, *, executor: Executor | None = None
) -> SegmentMean:
    """Approximate a track by k parts, each travelled along one of m segments: the thesis's Algorithm 1.

    Parameters
    ----------
    track : Track
        n samples.
    k, m : int, optional
        Numbers of parts and of segments, 1 <= m <= k <= n. Those left out are found at the elbow of the fitting cost
        (Algorithms 3 and 4).
    executor : Executor, optional
        Spreads the work.

    Returns
    -------
    SegmentMean
        Boundaries, labels, segments in metres, and the fitting cost in square metres.

    Raises
    ------
    OptionError
        If k or m don't fit the track.

    Examples
    --------
    >>> track = Track("lane", range(24), [[x] for x in 2 * [0, 2, 4, 6, 8, 10, 10, 8, 6, 4, 2, 0]])
    >>> mean = segment_mean(track, k=4, m=2)
    >>> mean.labels.tolist(), round(mean.cost, 6)
    ([0, 1, 0, 1], 0.0)
    """
    from gpszip.pipeline.segment_mean import segment_mean as mean_of

    return mean_of(track, k, m, executor=executor)


def coreset(
    tracks: Sequence[Track] | Track,
    *,
    k: int | None = None,
    eps: float | None = None,
    size: int | None = None,
    max_bytes: int | None = None,
) -> Coreset:
    """Make the (k, eps)-coreset of tracks: blocks that price any k-segment, deterministic and mergeable.

    Parameters
    ----------
    tracks : sequence of Track, or one Track
        On one plane, with different ids.
    k, eps : int and float, optional
        The estimated cost of every k-segment is to be within ``eps`` of the true one (thesis, definition 4.1.6).
    size : int, optional
        Largest number of blocks, instead.
    max_bytes : int, optional
        Largest size of the file that :func:`save_coreset` writes, instead.

    Returns
    -------
    Coreset
        Its ``cost`` prices functions, with bounds that hold whatever their breaks are.

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
    from gpszip.sketches.partition import build_coreset

    return build_coreset(tracks, k=k, eps=eps, size=size, max_bytes=max_bytes)


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
