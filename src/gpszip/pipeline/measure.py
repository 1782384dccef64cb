"""What the archive of a log larger than memory decodes to, compared with every sample."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, open_archive
from gpszip.io.large.store import StoredLog
from gpszip.model import Track, Walk
from gpszip.pipeline.slices import Stretch
from gpszip.run.executor import Executor, share_value
from gpszip.walks.error import ErrorSummary, measure_errors

__all__ = ["measured"]


def measured(
    log: StoredLog,
    archive: Archive,
    batches: Sequence[Sequence[Stretch]],
    executor: Executor,
    tell: Callable[[float], None],
) -> ErrorSummary:
    """Decode the archive's bytes and compare them with every sample, batch by batch.

    Parameters
    ----------
    log : StoredLog
        The log, of which all tracks are in the archive.
    archive : Archive
        With times.
    batches : sequence of sequences of Stretch
        All of the log.
    executor : Executor
        Where batches are measured.
    tell : callable
        Told which share is done.
    """
    read_back = open_archive(archive.to_bytes(), archive.map)
    walks = [read_back.walk(track.id) for track in log.tracks]
    points, squares, worst, uncovered = 0, 0.0, 0.0, 0
    with share_value(executor, read_back.road_map.nodes) as shared:
        work = (
            [_with_walk(log, walks[stretch.track], stretch) for stretch in batch]
            for batch in batches
        )
        for number, found in enumerate(shared.map(_measure_batch, work), 1):
            points, uncovered, worst = (
                points + found.points,
                uncovered + found.uncovered,
                max(worst, found.max_error),
            )
            squares += found.rmse**2 * (found.points - found.uncovered)
            tell(number / len(batches))
    return ErrorSummary(math.sqrt(squares / max(points - uncovered, 1)), worst, points, uncovered)


def _with_walk(log: StoredLog, walk: Walk, stretch: Stretch) -> tuple[Track, Walk]:
    """Samples of a stretch, and the knots of its track's walk about them."""
    track = log.read(log.tracks[stretch.track], stretch.begin, stretch.end)
    assert walk.times is not None
    first = max(int(np.searchsorted(walk.times, track.times[0])) - 2, 0)
    after = int(np.searchsorted(walk.times, track.times[-1])) + 2
    gaps = walk.gaps[first : after - 1]
    pieces = int(walk.gaps[:first].sum())
    spans = None if walk.spans is None else walk.spans[pieces : pieces + int(gaps.sum()) + 1]
    return track, Walk(walk.id, walk.nodes[first:after], walk.times[first:after], gaps, spans)


def _measure_batch(nodes: NDArray[np.float64], work: Sequence[tuple[Track, Walk]]) -> ErrorSummary:
    return measure_errors([track for track, _ in work], [walk for _, walk in work], nodes)
