"""How slow each road is: learnt from a log where it was driven, else from the network's speeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.speeds import MotionStatistics
from gpszip.model import Network, Track
from gpszip.model.match import Match

__all__ = ["estimate_road_slowness"]

#: Metres of driving as which the expected slowness of a road counts.
_PRIOR = 300.0

#: Largest ratio between the slowness of a road and that of others.
_MAX_RATIO = 4.0

Floats = NDArray[np.float64]


def estimate_road_slowness(
    tracks: Sequence[Track],
    matches: Sequence[Match],
    motion: Sequence[MotionStatistics],
    network: Network,
    gap: float,
) -> Floats:
    """Estimate the time for a metre of each directed road, as a multiple of the agent's mean.

    The network's speeds are scaled to what the log shows on roads that have one: expected speeds of
    cars don't fit bicycles. Roads that were driven from end to end are pulled towards what was seen
    there.

    Parameters
    ----------
    tracks : sequence of Track
        The log.
    matches : sequence of Match
        Where each of them lies on the roads.
    motion : sequence of MotionStatistics
        How each of their agents moves.
    network : Network
        The roads.
    gap : float
        Seconds above which a step is a gap.

    Returns
    -------
    float64 array, shape (2 E,)
        Directed road 2e leads along road e, 2e + 1 back; about 1 in the mean.
    """
    # Metres driven on each road, and the metres that the agent drives elsewhere in the same time.
    metres, mean_metres = np.zeros(2 * len(network)), np.zeros(2 * len(network))
    for track, match, statistics in zip(tracks, matches, motion, strict=True):
        road, step_metres, step_seconds = _steps_on_passed_roads(track, match, gap)
        np.add.at(metres, road, step_metres)
        np.add.at(mean_metres, road, step_seconds * statistics.mean_speed)

    # Weighted mean of what was seen and what is expected.
    expected = _expected_slowness(network, metres, mean_metres)
    slowness: Floats = np.clip(
        (mean_metres + _PRIOR * expected) / (metres + _PRIOR), 1 / _MAX_RATIO, _MAX_RATIO
    )
    return slowness


def _steps_on_passed_roads(
    track: Track, match: Match, gap: float
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Directed road, metres and seconds of each step on a road that was driven from end to end."""
    if not match.pieces:
        return np.empty(0, np.int64), np.empty(0), np.empty(0)

    # Steps on one piece, without its first and last leg.
    last_leg = np.array([len(piece.route) - 1 for piece in match.pieces])
    is_used = (
        (np.diff(track.times) <= gap)
        & (match.piece[1:] == match.piece[:-1])
        & (match.piece[1:] >= 0)
    )
    is_used &= (match.leg[:-1] > 0) & (match.leg[1:] < last_leg[match.piece[1:]])

    road = 2 * match.edge.astype(np.int64) + ~match.forward
    return road[:-1][is_used], np.diff(match.along)[is_used], np.diff(track.times)[is_used]


def _expected_slowness(network: Network, metres: Floats, mean_metres: Floats) -> Floats:
    """Slowness by the network's speeds, scaled to be right in the mean for the roads driven."""
    # Seconds for a metre.
    speeds = np.repeat(network.speeds, 2)
    is_known = np.isfinite(speeds) & (speeds > 0)
    pace = np.divide(1.0, speeds, out=np.ones_like(speeds), where=is_known)

    # Scale: by the roads driven, or by the lengths of all roads.
    is_driven = is_known & (metres > 0)
    if is_driven.any():
        seconds = float((metres[is_driven] * pace[is_driven]).sum())
        wanted = float(mean_metres[is_driven].sum())
    else:
        lengths = np.repeat(network.lengths, 2)[is_known]
        seconds = float((lengths * pace[is_known]).sum())
        wanted = float(lengths.sum())
    scale = wanted / seconds if seconds > 0 else 1.0
    return np.where(is_known, np.clip(pace * scale, 1 / _MAX_RATIO, _MAX_RATIO), 1.0)
