"""A log as its coreset: few weighted samples with the moments of all, from which a map is learnt as from the log itself."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track
from gpszip.sketches.partition import build_coreset
from gpszip.sketches.samples import weighted_samples

__all__ = ["reduce_to_coreset"]


def reduce_to_coreset(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], size: int
) -> tuple[tuple[Track, ...], tuple[NDArray[np.bool_], ...]]:
    """Weighted samples of a balanced partition of the log, and their gaps.

    The first and the last sample of every piece between gaps stay with their own weights, so that walks that cover the few
    cover all. What is between them is cut into blocks, each of which keeps at most 2 d + 4 samples.

    Parameters
    ----------
    tracks : sequence of Track
        The log.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, the steps that are gaps.
    size : int
        Blocks of all tracks together; every piece has at least one, however small this is.

    Returns
    -------
    tuple of Track, tuple of bool array
        The same tracks with fewer samples, and their gaps.

    Examples
    --------
    >>> track = Track("a", range(1000), [[t % 100.0] for t in range(1000)])
    >>> (few,), _ = reduce_to_coreset([track], [np.zeros(999, bool)], 20)
    >>> len(few), round(float(few.weights.sum()), 6)
    (62, 1000.0)
    """
    inner, ends = _pieces(tracks, gaps)
    pieces = [
        _cut(tracks[owner], f"{number}", a + 1, b - 1)
        for number, (owner, a, b) in enumerate(ends)
        if b - a > 2
    ]
    few = iter(
        weighted_samples(build_coreset(pieces, size=max(size, len(pieces))), pieces)
        if pieces
        else ()
    )
    thinned, flags = [], []
    for owner, track in enumerate(tracks):
        parts = [_with_ends(track, a, b, next(few) if b - a > 2 else None) for a, b in inner[owner]]
        joined = [np.concatenate(values) for values in zip(*parts, strict=True)]
        thinned.append(Track(track.id, joined[0], joined[1], joined[2], plane=track.plane))
        last = np.cumsum([len(part[0]) for part in parts])[:-1] - 1
        flag = np.zeros(len(joined[0]) - 1, np.bool_)
        flag[last] = True
        flags.append(flag)
    return tuple(thinned), tuple(flags)


def _pieces(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]
) -> tuple[list[list[tuple[int, int]]], list[tuple[int, int, int]]]:
    """Sample ranges of the pieces of each track, and of all of them with their owners."""
    inner = []
    for track, gap in zip(tracks, gaps, strict=True):
        bounds = [0, *(np.flatnonzero(gap) + 1).tolist(), len(track)]
        inner.append(list(pairwise(bounds)))
    return inner, [(owner, a, b) for owner, ranges in enumerate(inner) for a, b in ranges]


def _cut(track: Track, name: str, a: int, b: int) -> Track:
    weights = None if track.weights is None else track.weights[a:b]
    return Track(name, track.times[a:b], track.positions[a:b], weights)


def _with_ends(track: Track, a: int, b: int, few: Track | None) -> tuple[NDArray[np.float64], ...]:
    """Times, positions and weights of a piece's first sample, the few between, and its last."""
    first, last = np.arange(a, min(a + 1, b)), np.arange(max(b - 1, a + 1), b)
    own = np.ones(len(track)) if track.weights is None else track.weights
    middle = (
        (np.empty(0), np.empty((0, track.dimension)), np.empty(0))
        if few is None
        else (few.times, few.positions, few.weights)
    )
    return tuple(
        np.concatenate([values[first], between, values[last]])
        for values, between in zip((track.times, track.positions, own), middle, strict=True)
    )
