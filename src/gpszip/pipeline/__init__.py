"""The use cases, each composed of the rooms below: read, compress, decompress, match, patch, merge, segment_mean, warm.

Nothing here prints. Whoever wants to see how far a long computation is passes a listener, and gets
:class:`~gpszip.model.report.Progress` events.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from gpszip.archive import Archive
from gpszip.model import Executor, Listener, SegmentMean, Track
from gpszip.pipeline.compressing import compress
from gpszip.pipeline.roads import match, patch, prepare_network, read_network
from gpszip.pipeline.warming import warm

if TYPE_CHECKING:
    from gpszip.model.merge_options import MergeOptions
    from gpszip.model.merge_report import MergeReport
    from gpszip.model.reading import Reading

__all__ = [
    "compress",
    "decompress",
    "match",
    "merge",
    "patch",
    "prepare_network",
    "read",
    "read_network",
    "segment_mean",
    "warm",
]

#: How far k and m are searched where the user leaves it open.
_FEWEST_PARTS, _MOST_PARTS, _MOST_SEGMENTS = 10, 300, 100


def read(sources: Any, **options: Any) -> Reading:
    """Read logs; all that :func:`gpszip.io.reading.read_logs` takes."""
    from gpszip.io.reading import read_logs

    return read_logs(sources, **options)


def merge(
    archives: Sequence[Archive],
    options: MergeOptions | None = None,
    *,
    names: Sequence[str] | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[Archive, MergeReport]:
    """Unite archives on one map, without their logs (thesis, 2.4).

    Parameters
    ----------
    archives : sequence of Archive
        Two or more, all in degrees or all on one plane of x and y.
    options : MergeOptions, optional
        How far tracks may be moved, and what becomes of those of one name.
    names : sequence of str, optional
        What messages and prefixes call the archives; by default they are numbered from 1.
    executor, progress : optional
        As for :func:`compress`.

    Returns
    -------
    Archive
        With the tracks of all archives, in the order of their starts or of their names, whichever takes fewer bytes.
    MergeReport
        What was done; how far each archive's tracks were moved is measured on the bytes.

    Raises
    ------
    OptionError
        If archives don't go together.
    BoundError
        If tracks would be moved farther than they may.
    """
    from gpszip.model.merge_options import MergeOptions
    from gpszip.pipeline import union
    from gpszip.run import executor_of

    called = [str(number) for number in range(1, len(archives) + 1)] if names is None else names
    return union.merge(archives, options or MergeOptions(), names=called, executor=executor_of(executor), progress=progress)


def decompress(archive: Archive, *, every: float | None = None, at: ArrayLike | None = None) -> list[Track]:
    """Give back the tracks of an archive.

    Parameters
    ----------
    archive : Archive
        With times.
    every : float, optional
        Sample at the whole multiples of so many seconds.
    at : array_like, optional
        Sample at these instants in seconds. Without any, the knots of the walks are given.
    """
    return archive.decompress() if every is None and at is None else archive.sample(every, at=at)


def segment_mean(track: Track, k: int | None = None, m: int | None = None, *, executor: Executor | None = None) -> SegmentMean:
    """Approximate a track by k parts on m segments; those left out are searched.

    k is searched up to a tenth of the samples and 300, m up to k and 100.
    """
    from gpszip.run import executor_of
    from gpszip.segmentation.em import segment_mean as with_both
    from gpszip.segmentation.search import find_parameters

    executor = None if executor is None else executor_of(executor)
    if k is not None and m is not None:
        return with_both(track, k, m, executor=executor)
    most = max(m or 1, min(len(track), max(_FEWEST_PARTS, min(len(track) // 10, _MOST_PARTS))))
    ks = (m or 1, most) if k is None else (k, k)
    ms = (1, min(ks[1], _MOST_SEGMENTS)) if m is None else (m, m)
    return find_parameters(track, ks, ms, executor=executor).mean
