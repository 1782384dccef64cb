"""Samples that leap far away and back: a track is matched as if they weren't there, and they are on no road."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.viterbi import Observations
from gpszip.model.match import Break, Match

__all__ = ["expand_match", "reinsert_outliers", "remove_samples"]


def remove_samples(stretch: Observations, leaps: NDArray[np.bool_]) -> Observations:
    """The same without some samples.

    Examples
    --------
    >>> lane = Observations(np.arange(8.0).reshape(4, 2), np.arange(4.0), np.array([False, True, False]), np.zeros((4, 2)))
    >>> rest = remove_samples(lane, np.array([False, False, True, False]))
    >>> rest.times.tolist(), rest.is_gap.tolist()
    ([0.0, 1.0, 3.0], [False, True])
    """
    if not leaps.any():
        return stretch
    kept = np.flatnonzero(~leaps)
    last = kept[-1] if len(kept) else 0
    is_gap = (
        np.logical_or.reduceat(stretch.is_gap[:last], kept[:-1])
        if len(kept) > 1
        else np.zeros(0, np.bool_)
    )
    return Observations(
        stretch.positions[kept], stretch.times[kept], is_gap, stretch.headings[kept]
    )


def reinsert_outliers(match: Match, leaps: NDArray[np.bool_]) -> Match:
    """The match of a track whose other samples were matched alone; leaps between samples of one piece are breaks that it goes on behind."""
    if not leaps.any():
        return match
    match = expand_match(match, ~leaps)
    starts, ends = (
        np.flatnonzero(leaps[1:] & ~leaps[:-1]),
        np.flatnonzero(leaps[:-1] & ~leaps[1:]) + 1,
    )
    piece = match.piece
    within = (piece[starts] >= 0) & (
        piece[starts] == piece[ends]
    )  # elsewhere a break has been told already
    leapt = [
        Break(int(after), int(before), "leap")
        for after, before in zip(starts[within], ends[within], strict=True)
    ]
    return replace(match, breaks=tuple(sorted([*match.breaks, *leapt], key=lambda one: one.after)))


def expand_match(match: Match, kept: NDArray[np.bool_]) -> Match:
    """The match of some samples of a track as one of all of them, of which the others are on no road.

    Parameters
    ----------
    match : Match
        Of the samples kept.
    kept : bool array, shape (n,)
        Samples of the track that the match has.
    """
    # numbers of samples; one behind the last is behind it here, too
    numbers = np.append(np.flatnonzero(kept), len(kept))
    breaks = tuple(
        replace(
            one,
            after=int(numbers[one.after]) if one.after >= 0 else -1,
            before=int(numbers[one.before]),
        )
        for one in match.breaks
    )
    pieces = tuple(
        replace(one, first=int(numbers[one.first]), last=int(numbers[one.last]))
        for one in match.pieces
    )

    # what is told of each sample
    nowhere: dict[str, Any] = {
        "piece": -1,
        "leg": -1,
        "edge": -1,
        "forward": False,
        "confidence": 0.0,
    }
    arrays: dict[str, Any] = {}
    for name in ("piece", "leg", "edge", "forward", "offset", "along", "distance", "confidence"):
        values = getattr(match, name)
        arrays[name] = np.full(len(kept), nowhere.get(name, np.nan), values.dtype)
        arrays[name][kept] = values[: int(kept.sum())]
    return replace(match, pieces=pieces, breaks=breaks, **arrays)
