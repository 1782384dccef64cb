"""The error of an archive, measured at every sample of its log."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.model import Track, Walk
from gpszip.model.log import Log, LogTrack, MemoryLog
from gpszip.pipeline.slices import Slice
from gpszip.run.executor import Executor, share_value
from gpszip.walks.error import ErrorSummary, measure_errors
from gpszip.walks.shapes import assign_times_by_distance, shape_error, shape_slice_error

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
    lengths = [0.0 if track.timed else _length(log, track) for track in log.tracks]
    walks = [
        assign_times_by_distance(walk, nodes, 0.0, length) if length > 0 else walk
        for track, walk, length in zip(log.tracks, walks, lengths, strict=True)
    ]
    summaries = []
    with share_value(executor, nodes) as shared:
        work = (
            [_part_of(log, walks[each.track], lengths[each.track], each) for each in batch]
            for batch in batches
        )
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


def _length(log: Log, shape: LogTrack) -> float:
    """Length of a shape in metres: how far along it its last point is."""
    return float(log.read(shape, len(shape) - 1, len(shape)).times[0])


class _Part(NamedTuple):
    """Part of a track that is measured.

    Parameters
    ----------
    track : Track
        Samples of a slice; those of a shape reach up to the next slice.
    walk : Walk
        The knots of the track's walk about these samples; all of them for a shape of one sample.
    points : int
        Samples of the slice.
    weight : float
        Weight of the mean square error of a shape, such that the weights of its slices add up to
        its number of samples.
    """

    track: Track
    walk: Walk
    points: int
    weight: float


def _part_of(log: Log, walk: Walk, length: float, which: Slice) -> _Part:
    """Samples of a slice, and the knots of its track's walk about them.

    The length counts for shapes.
    """
    # The line between two slices belongs to the first.
    source, points = log.tracks[which.track], which.end - which.begin
    end = which.end if source.timed else min(which.end + 1, len(source))
    track = log.read(source, which.begin, end)
    if walk.times is None:
        return _Part(track, walk, points, points)

    # Two knots more on either side: samples may lie beyond the next one by rounding.
    first = max(int(np.searchsorted(walk.times, track.times[0])) - 2, 0)
    after = int(np.searchsorted(walk.times, track.times[-1])) + 2
    gaps = walk.gaps[first : after - 1]

    # Time ranges of the pieces that these knots belong to.
    piece = int(walk.gaps[:first].sum())
    time_ranges = (
        None if walk.time_ranges is None else walk.time_ranges[piece : piece + int(gaps.sum()) + 1]
    )
    piece_of_walk = Walk(
        walk.id, walk.nodes[first:after], walk.times[first:after], gaps, time_ranges
    )

    # Its share of the length of a shape.
    share = 1.0 if source.timed else float(track.times[-1] - track.times[0]) / length
    return _Part(track, piece_of_walk, points, share * len(source))


def _measure_batch(nodes: NDArray[np.float64], parts: Sequence[_Part]) -> ErrorSummary:
    """Measure the errors of a batch."""
    timed = [part for part in parts if part.track.timed]
    errors = measure_errors([part.track for part in timed], [part.walk for part in timed], nodes)
    if len(timed) == len(parts):
        return errors
    return _combined([errors, *(_measure_shape(nodes, p) for p in parts if not p.track.timed)])


def _measure_shape(nodes: NDArray[np.float64], part: _Part) -> ErrorSummary:
    """Measure the errors of a slice of a shape."""
    # A shape of one sample has no length in which its walk could have a share.
    if part.walk.times is None:
        mean_square, largest = shape_error(part.track.positions, nodes[part.walk.nodes])
    else:
        mean_square, largest = shape_slice_error(part.track, part.walk, nodes)
    rmse = math.sqrt(mean_square * part.weight / part.points)
    return ErrorSummary(rmse, largest, part.points, 0)
