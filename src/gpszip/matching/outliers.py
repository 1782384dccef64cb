"""Outliers: samples that jump far away and back are left out of matching, and lie on no road."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.viterbi import Observations
from gpszip.model.match import Break, Match

__all__ = ["expand_match", "reinsert_outliers", "remove_samples"]

Scalar = TypeVar("Scalar", bound=np.generic)


def remove_samples(observations: Observations, is_removed: NDArray[np.bool_]) -> Observations:
    """Remove samples from a track; an interval over removed samples is a gap if it holds one.

    Examples
    --------
    >>> is_gap, headings = np.array([False, True, False]), np.zeros((4, 2))
    >>> lane = Observations(np.arange(8.0).reshape(4, 2), np.arange(4.0), is_gap, headings)
    >>> rest = remove_samples(lane, np.array([False, False, True, False]))
    >>> rest.times.tolist(), rest.is_gap.tolist()
    ([0.0, 1.0, 3.0], [False, True])
    """
    if not is_removed.any():
        return observations
    kept = np.flatnonzero(~is_removed)
    last = kept[-1] if len(kept) else 0
    is_gap = (
        np.logical_or.reduceat(observations.is_gap[:last], kept[:-1])
        if len(kept) > 1
        else np.zeros(0, np.bool_)
    )
    return Observations(
        observations.positions[kept], observations.times[kept], is_gap, observations.headings[kept]
    )


def reinsert_outliers(match: Match, is_outlier: NDArray[np.bool_]) -> Match:
    """Put outliers back into the match of the other samples.

    Outliers between samples of one piece become a break of reason ``"leap"``; the piece goes on.
    """
    if not is_outlier.any():
        return match
    match = expand_match(match, ~is_outlier)

    # Runs of outliers, by the samples before and after; elsewhere there is a break already.
    starts = np.flatnonzero(is_outlier[1:] & ~is_outlier[:-1])
    ends = np.flatnonzero(is_outlier[:-1] & ~is_outlier[1:]) + 1
    is_within_piece = (match.piece[starts] >= 0) & (match.piece[starts] == match.piece[ends])
    outlier_breaks = [
        Break(int(after), int(before), "leap")
        for after, before in zip(starts[is_within_piece], ends[is_within_piece], strict=True)
    ]
    breaks = sorted([*match.breaks, *outlier_breaks], key=lambda break_: break_.after)
    return replace(match, breaks=tuple(breaks))


def expand_match(match: Match, is_kept: NDArray[np.bool_]) -> Match:
    """Expand the match of some samples of a track to all of them; the others are on no road.

    Parameters
    ----------
    match : Match
        Match of the samples kept.
    is_kept : bool array, shape (n,)
        Samples of the track that the match has.
    """
    # Numbers of samples in the track; one past the last stays one past the last.
    numbers = np.append(np.flatnonzero(is_kept), len(is_kept))
    breaks = tuple(
        replace(
            break_,
            after=int(numbers[break_.after]) if break_.after >= 0 else -1,
            before=int(numbers[break_.before]),
        )
        for break_ in match.breaks
    )
    pieces = tuple(
        replace(piece, first=int(numbers[piece.first]), last=int(numbers[piece.last]))
        for piece in match.pieces
    )

    # Columns of all samples.
    return replace(
        match,
        pieces=pieces,
        breaks=breaks,
        piece=_expand(match.piece, is_kept, -1),
        leg=_expand(match.leg, is_kept, -1),
        edge=_expand(match.edge, is_kept, -1),
        forward=_expand(match.forward, is_kept, fill=False),
        offset=_expand(match.offset, is_kept, np.nan),
        along=_expand(match.along, is_kept, np.nan),
        distance=_expand(match.distance, is_kept, np.nan),
        confidence=_expand(match.confidence, is_kept, 0.0),
    )


def _expand(values: NDArray[Scalar], is_kept: NDArray[np.bool_], fill: float) -> NDArray[Scalar]:
    """Write the values of the samples kept among those of all samples."""
    expanded: NDArray[Scalar] = np.full(len(is_kept), fill, values.dtype)
    expanded[is_kept] = values[: int(is_kept.sum())]
    return expanded
