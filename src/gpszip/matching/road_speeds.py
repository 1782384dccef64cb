"""How slow each road is: learnt from a log where it was driven, and guessed from speeds that are known elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.speeds import MotionStatistics
from gpszip.model import Network, Track
from gpszip.model.match import Match

__all__ = ["estimate_road_slowness"]

#: What is known beforehand of a road counts as much as having been driven for so many metres.
_PRIOR = 300.0

#: A road is at most so many times as quick, or as slow, as others.
_FACTOR = 4.0


def estimate_road_slowness(
    tracks: Sequence[Track],
    matches: Sequence[Match],
    motion: Sequence[MotionStatistics],
    network: Network,
    gap: float,
) -> NDArray[np.float64]:
    """Time that an agent takes for a metre of each directed road, as a multiple of what it usually takes for a metre.

    Speeds of the network are scaled to what the log shows on roads that have one: expected speeds of cars don't fit bicycles. Roads that
    were driven from end to end are pulled towards what was seen there.

    Parameters
    ----------
    tracks : sequence of Track
        The log.
    matches : sequence of Match
        Where each of them lies on the roads.
    motion : sequence of Habits
        How each of their agents goes.
    network : Network
        The roads.
    gap : float
        Seconds above which a step is a gap.

    Returns
    -------
    float64 array, shape (2 E,)
        Directed road 2e leads along road e, 2e + 1 back; about 1 in the mean.
    """
    metres, worth = np.zeros(2 * len(network)), np.zeros(2 * len(network))
    for track, found, own in zip(tracks, matches, motion, strict=True):
        road, along, seconds = _passed(track, found, gap)
        np.add.at(metres, road, along)
        np.add.at(worth, road, seconds * own.mean_speed)
    expected = _expected(network, metres, worth)
    learnt: NDArray[np.float64] = np.clip(
        (worth + _PRIOR * expected) / (metres + _PRIOR), 1 / _FACTOR, _FACTOR
    )
    return learnt


def _passed(
    track: Track, found: Match, gap: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Directed road, metres and seconds of the steps, save those on roads of which only a part was seen."""
    if not found.pieces:
        return np.empty(0, np.int64), np.empty(0), np.empty(0)
    last = np.array([len(piece.route) - 1 for piece in found.pieces])
    used = (
        (np.diff(track.times) <= gap)
        & (found.piece[1:] == found.piece[:-1])
        & (found.piece[1:] >= 0)
    )
    used &= (found.leg[:-1] > 0) & (found.leg[1:] < last[found.piece[1:]])
    road = 2 * found.edge.astype(np.int64) + ~found.forward
    return road[:-1][used], np.diff(found.along)[used], np.diff(track.times)[used]


def _expected(
    network: Network, metres: NDArray[np.float64], worth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What the network's speeds say, so scaled that it is right in the mean for the roads that were driven."""
    told = np.repeat(network.speeds, 2)
    known = np.isfinite(told) & (told > 0)
    pace = np.divide(1.0, told, out=np.ones_like(told), where=known)
    driven = known & (metres > 0)
    weights = metres[driven] if driven.any() else np.repeat(network.lengths, 2)[known]
    sum_ = float((weights * pace[driven if driven.any() else known]).sum())
    seen = float(worth[driven].sum()) if driven.any() else float(weights.sum())
    return np.where(
        known, np.clip(pace * (seen / sum_ if sum_ > 0 else 1.0), 1 / _FACTOR, _FACTOR), 1.0
    )
