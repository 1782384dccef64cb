"""A log reduced to its coreset: few weighted samples from which a map is learned like from all."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track
from gpszip.sketches.partition import build_coreset
from gpszip.sketches.samples import weighted_samples

__all__ = ["reduce_to_coreset"]

#: Samples of a piece up to which it has no samples between its ends.
_ENDS = 2


def reduce_to_coreset(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], size: int
) -> tuple[tuple[Track, ...], tuple[NDArray[np.bool_], ...]]:
    """Weighted samples of a balanced partition of the log, and their gaps.

    The first and the last sample of every piece stay with their own weights, so that walks that
    cover the coreset cover the log. The samples between them are cut into blocks, each of which
    keeps at most 2 d + 4 samples with the moments of all.

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
    >>> (coreset,), _ = reduce_to_coreset([track], [np.zeros(999, bool)], 20)
    >>> len(coreset), round(float(coreset.weights.sum()), 6)
    (62, 1000.0)
    """
    # Build the coreset of the inner samples of all pieces.
    ranges = [_find_pieces(track, gap) for track, gap in zip(tracks, gaps, strict=True)]
    inner_pieces: list[Track] = []
    for number, (owner, first, after) in enumerate(
        (owner, *bounds) for owner, pieces in enumerate(ranges) for bounds in pieces
    ):
        if after - first > _ENDS:
            inner_pieces.append(_slice_track(tracks[owner], f"{number}", first + 1, after - 1))
    coresets = iter(
        weighted_samples(
            build_coreset(inner_pieces, size=max(size, len(inner_pieces))), inner_pieces
        )
        if inner_pieces
        else ()
    )

    # Add the ends of the pieces, and concatenate the pieces of each track.
    reduced, reduced_gaps = [], []
    for track, pieces in zip(tracks, ranges, strict=True):
        samples = [
            _add_ends(track, first, after, next(coresets) if after - first > _ENDS else None)
            for first, after in pieces
        ]
        times, positions, weights = (
            np.concatenate(values) for values in zip(*samples, strict=True)
        )
        reduced.append(Track(track.id, times, positions, weights, plane=track.plane))
        last = np.cumsum([len(piece[0]) for piece in samples])[:-1] - 1
        gap = np.zeros(len(times) - 1, np.bool_)
        gap[last] = True
        reduced_gaps.append(gap)
    return tuple(reduced), tuple(reduced_gaps)


def _find_pieces(track: Track, gap: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First sample of each piece, and the one after its last."""
    return list(pairwise([0, *(np.flatnonzero(gap) + 1).tolist(), len(track)]))


def _slice_track(track: Track, name: str, first: int, after: int) -> Track:
    weights = None if track.weights is None else track.weights[first:after]
    return Track(name, track.times[first:after], track.positions[first:after], weights)


def _add_ends(
    track: Track, first: int, after: int, inner: Track | None
) -> tuple[NDArray[np.float64], ...]:
    """Times, positions and weights of a piece's first sample, its inner coreset, and its last."""
    head, tail = (
        np.arange(first, min(first + 1, after)),
        np.arange(max(after - 1, first + 1), after),
    )
    weights = np.ones(len(track)) if track.weights is None else track.weights
    middle = (
        (np.empty(0), np.empty((0, track.dimension)), np.empty(0))
        if inner is None
        else (inner.times, inner.positions, inner.weights)
    )
    return tuple(
        np.concatenate([values[head], between, values[tail]])
        for values, between in zip((track.times, track.positions, weights), middle, strict=True)
    )
