"""The thesis's segment mean of one track, with a search for the numbers that are left out."""

from __future__ import annotations

from gpszip.model import SegmentMean, Track
from gpszip.pipeline.validate import check_tracks
from gpszip.run.executor import Executor

__all__ = ["segment_mean"]

#: Fewest segments k up to which the search goes, however short the track is.
_FEWEST_SEGMENTS = 10

#: Most segments k that are searched: beyond, the search takes minutes and the elbow lies lower.
_MOST_SEGMENTS = 300

#: Most segments m that are searched.
_MOST_DISTINCT = 100


def segment_mean(
    track: Track, k: int | None = None, m: int | None = None, *, executor: Executor | None = None
) -> SegmentMean:
    """Approximate a track by k segments, of which m are distinct (thesis, algorithm 1).

    Without ``k``, it is searched up to a tenth of the samples and 300; without ``m``, up to k and
    100 (algorithms 3 and 4).
    """
    from gpszip.run import resolve_executor
    from gpszip.segmentation.em import segment_mean as with_both
    from gpszip.segmentation.search import find_parameters

    check_tracks(track)
    executor = None if executor is None else resolve_executor(executor)
    if k is not None and m is not None:
        return with_both(track, k, m, executor=executor)

    # Search what was left out between the smallest and the largest sensible number.
    most = max(
        m or 1, min(len(track), max(_FEWEST_SEGMENTS, min(len(track) // 10, _MOST_SEGMENTS)))
    )
    ks = (m or 1, most) if k is None else (k, k)
    ms = (1, min(ks[1], _MOST_DISTINCT)) if m is None else (m, m)
    return find_parameters(track, ks, ms, executor=executor).mean
