"""A coreset as a weighted subsequence of the samples (thesis, definition 4.1.6), for those who need points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpszip.errors import OptionError
from gpszip.model import Track
from gpszip.sketches.coreset import Coreset
from gpszip.sketches.kernels.caratheodory import select_block_samples

__all__ = ["weighted_samples"]


def weighted_samples(coreset: Coreset, tracks: Sequence[Track] | Track) -> tuple[Track, ...]:
    """Keep at most 2 d + 4 samples of each block, with weights, that have the block's moments (Carathéodory).

    The cost of every line on every block is the same as on all samples; of a function that breaks within a block it is not,
    and has no bound: :meth:`Coreset.cost` has.

    Parameters
    ----------
    coreset : Coreset
        Of these tracks.
    tracks : Track or sequence of Track
        The samples.

    Returns
    -------
    tuple of Track
        Samples of each track as they were, with positive weights.

    Raises
    ------
    OptionError
        If the coreset is of other tracks.

    Examples
    --------
    >>> from gpszip import coreset
    >>> track = Track("lane", range(100), [[t % 50] for t in range(100)])
    >>> (few,) = weighted_samples(coreset(track, size=2), track)
    >>> len(few) <= 2 * 6, round(float(few.weights.sum()), 9)
    (True, 100.0)
    """
    whole = (tracks,) if isinstance(tracks, Track) else tuple(tracks)
    return tuple(_select_track_samples(coreset, track) for track in whole)


def _select_track_samples(coreset: Coreset, track: Track) -> Track:
    own = coreset.track(track.id)
    cuts = np.concatenate([[0], np.cumsum(own.counts)])
    times = (
        track.times[np.concatenate([cuts[:-1], cuts[1:] - 1])]
        if cuts[-1] == len(track)
        else np.empty(0)
    )
    if not np.array_equal(times, own.edges.T.ravel()):
        raise OptionError(f"the coreset is not of this track {track.id!r}: samples or times differ")
    weights = np.ones(len(track)) if track.weights is None else track.weights
    kept, heavy = select_block_samples(track.times, track.positions, weights, cuts)
    return Track(track.id, track.times[kept], track.positions[kept], heavy, plane=track.plane)
