"""What matching and patching would do, without doing it."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpszip.model import Network, Track
from gpszip.model.track import take_samples

__all__ = ["MatchPlan", "PatchPlan", "plan_match", "plan_patch"]

#: Points that are matched for an estimate, at most, one try after the other.
_SAMPLED_POINTS = (100, 500, 2_000)

#: Points of a track that are matched, if it has as many: of fewer, roads can't be told.
_PIECE_POINTS = 100


@dataclass(frozen=True)
class MatchPlan:
    """What matching a log would find, estimated from the starts of its tracks.

    Parameters
    ----------
    points : int
        Points of the log.
    sampled : int
        Points that were matched.
    matched : int
        How many of these are on a road.
    error : float
        Scale of their distance to the roads in metres.
    cpu_seconds : float
        CPU time to match all points.
    """

    points: int
    sampled: int
    matched: int
    error: float
    cpu_seconds: float


@dataclass(frozen=True)
class PatchPlan:
    """Which gaps patching would try to fill.

    Parameters
    ----------
    points : int
        Points of the log.
    gap : float
        Seconds above which an interval is a gap.
    gaps : int
        Number of gaps.
    seconds : float
        All of them together.
    """

    points: int
    gap: float
    gaps: int
    seconds: float


def plan_match(
    tracks: Sequence[Track],
    network: Network,
    *,
    sigma: float | None = None,
    beta: float | None = None,
    gap: float | None = None,
    heading: float | None = None,
    ignore_oneway: bool = False,
) -> MatchPlan:
    """Match the starts of tracks, and estimate the rest.

    Parameters and exceptions are those of :func:`gpszip.match`.
    """
    from gpszip.pipeline.match import match

    # More and more points; the first try loads kernels and files the roads by their places.
    seconds, counts = [], []
    for most in _SAMPLED_POINTS:
        sample = _first_tracks(tracks, most)
        start = time.process_time()
        found = match(
            sample,
            network,
            sigma=sigma,
            beta=beta,
            gap=gap,
            heading=heading,
            ignore_oneway=ignore_oneway,
        )
        seconds.append(time.process_time() - start)
        counts.append(found.points)

    # What does not depend on the points is in all tries: the last two tell what a point takes.
    points = sum(map(len, tracks))
    for_point = max(seconds[2] - seconds[1], 0.0) / max(counts[2] - counts[1], 1)
    total = seconds[0] + for_point * (points - counts[0])
    return MatchPlan(points, found.points, found.matched, found.scales.error, total)


def _first_tracks(tracks: Sequence[Track], most: int) -> list[Track]:
    """Starts of tracks up to a number of samples: of all tracks, or of the first ones of many."""
    first: list[Track] = []
    share = max(math.ceil(most / max(len(tracks), 1)), _PIECE_POINTS)
    for track in tracks:
        if most <= 0:
            break
        first.append(take_samples(track, slice(min(share, most))))
        most -= len(first[-1])
    return first


def plan_patch(tracks: Sequence[Track], network: Network, *, gap: float | None = None) -> PatchPlan:
    """Find the gaps of a log.

    Parameters and exceptions are those of :func:`gpszip.patch`.
    """
    from gpszip.matching.patch import find_all_gaps

    gap, found = find_all_gaps(tracks, network, gap)
    seconds = sum(
        float(np.diff(track.times)[is_gap].sum())
        for track, is_gap in zip(tracks, found, strict=True)
    )
    return PatchPlan(sum(map(len, tracks)), gap, sum(int(each.sum()) for each in found), seconds)
