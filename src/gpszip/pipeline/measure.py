"""The error of an archive, measured at every sample of its log."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.model import Track, Walk
from gpszip.model.log import Log, MemoryLog
from gpszip.pipeline.slices import Slice
from gpszip.run.executor import Executor, share_value
from gpszip.walks.error import ErrorSummary, measure_errors

__all__ = ["measure"]


def measure(
    log: Log,
    archive: Archive,
    batches: Sequence[Sequence[Slice]],
    executor: Executor,
    report: Callable[[float], None],
) -> ErrorSummary:
    """Compare the walks of an archive with every sample.

    Parameters
    ----------
    log : Log
        All its tracks are in the archive.
    archive : Archive
        Read back from its bytes.
    batches : sequence of sequences of Slice
        All samples of the log.
    executor : Executor
        Where batches of a log on disk are measured.
    report : callable
        Called with the share that is done.
    """
    # Measure a log in memory at once.
    report(0.0)
    nodes = archive.road_map.nodes
    walks = [archive.walk(track.id) for track in log.tracks]
    if isinstance(log, MemoryLog):
        errors = measure_errors(log.tracks, walks, nodes)
        report(1.0)
        return errors

    # Batch by batch, each with the knots about its samples.
    summaries = []
    with share_value(executor, nodes) as shared:
        work = ([_with_walk(log, walks[each.track], each) for each in batch] for batch in batches)
        for summary in shared.map(_measure_batch, work):
            summaries.append(summary)
            report(len(summaries) / len(batches))
    return _combined(summaries)


def _combined(summaries: Sequence[ErrorSummary]) -> ErrorSummary:
    """The errors of all batches together."""
    points = sum(each.points for each in summaries)
    uncovered = sum(each.uncovered for each in summaries)
    squares = 0.0
    for each in summaries:
        squares += each.rmse**2 * (each.points - each.uncovered)
    return ErrorSummary(
        rmse=math.sqrt(squares / max(points - uncovered, 1)),
        max_error=max((each.max_error for each in summaries), default=0.0),
        points=points,
        uncovered=uncovered,
    )


def _with_walk(log: Log, walk: Walk, which: Slice) -> tuple[Track, Walk]:
    """Samples of a slice, and the knots of its track's walk about them."""
    track = log.read(log.tracks[which.track], which.begin, which.end)
    assert walk.times is not None

    # Two knots more on either side: samples may lie beyond the next one by rounding.
    first = max(int(np.searchsorted(walk.times, track.times[0])) - 2, 0)
    after = int(np.searchsorted(walk.times, track.times[-1])) + 2
    gaps = walk.gaps[first : after - 1]

    # Time ranges of the pieces that these knots belong to.
    piece = int(walk.gaps[:first].sum())
    time_ranges = (
        None if walk.time_ranges is None else walk.time_ranges[piece : piece + int(gaps.sum()) + 1]
    )
    return track, Walk(walk.id, walk.nodes[first:after], walk.times[first:after], gaps, time_ranges)


def _measure_batch(nodes: NDArray[np.float64], work: Sequence[tuple[Track, Walk]]) -> ErrorSummary:
    return measure_errors([track for track, _ in work], [walk for _, walk in work], nodes)
