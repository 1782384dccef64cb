"""Samples that leap far away and back: a track is matched as if they weren't there, and they are on no road."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.chain import Stretch
from gpszip.model.match import Break, Match

__all__ = ["among", "without"]


def without(stretch: Stretch, leaps: NDArray[np.bool_]) -> Stretch:
    """The same without some samples, which are neither its first nor its last.

    Examples
    --------
    >>> lane = Stretch(np.arange(8.0).reshape(4, 2), np.arange(4.0), np.array([False, True, False]), np.zeros((4, 2)))
    >>> rest = without(lane, np.array([False, False, True, False]))
    >>> rest.times.tolist(), rest.silent.tolist()
    ([0.0, 1.0, 3.0], [False, True])
    """
    if not leaps.any():
        return stretch
    kept = np.flatnonzero(~leaps)
    silent = np.logical_or.reduceat(stretch.silent, kept[:-1])
    return Stretch(stretch.positions[kept], stretch.times[kept], silent, stretch.headings[kept])


def among(match: Match, leaps: NDArray[np.bool_]) -> Match:
    """The match of a track whose other samples were matched alone; leaps between samples of one piece are breaks that it goes on behind."""
    if not leaps.any():
        return match
    kept = np.flatnonzero(~leaps)
    samples = np.append(kept, len(leaps))  # one behind the last is behind it here, too
    starts, ends = np.flatnonzero(leaps[1:] & ~leaps[:-1]), np.flatnonzero(leaps[:-1] & ~leaps[1:]) + 1
    there = [Break(int(samples[one.after]) if one.after >= 0 else -1, int(samples[one.before]), one.reason) for one in match.breaks]
    nowhere: dict[str, Any] = {"piece": -1, "leg": -1, "edge": -1, "forward": False, "confidence": 0.0}
    arrays: dict[str, Any] = {}
    for name in ("piece", "leg", "edge", "forward", "offset", "along", "distance", "confidence"):
        values = getattr(match, name)
        arrays[name] = np.full(len(leaps), nowhere.get(name, np.nan), values.dtype)
        arrays[name][kept] = values
    piece = arrays["piece"]
    within = (piece[starts] >= 0) & (piece[starts] == piece[ends])  # elsewhere a break has been told already
    there += [Break(int(after), int(before), "leap") for after, before in zip(starts[within], ends[within], strict=True)]
    pieces = tuple(replace(one, first=int(kept[one.first]), last=int(kept[one.last])) for one in match.pieces)
    return replace(match, pieces=pieces, breaks=tuple(sorted(there, key=lambda one: one.after)), **arrays)
