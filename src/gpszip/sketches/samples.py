"""A coreset as a weighted subsequence of the samples (thesis, definition 4.1.6)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpszip.errors import OptionError
from gpszip.model import Track
from gpszip.sketches.coreset import Coreset
from gpszip.sketches.kernels.caratheodory import select_block_samples
from gpszip.sketches.weights import sample_weights

__all__ = ["weighted_samples"]


def weighted_samples(coreset: Coreset, tracks: Sequence[Track] | Track) -> tuple[Track, ...]:
    """Select at most 2 d + 4 weighted samples of each block that have the block's moments.

    By Carathéodory's theorem. On every block, every line costs the same as on all samples. The
    cost of a function that breaks inside a block differs, without a bound; for bounds use
    :meth:`Coreset.cost`.

    Parameters
    ----------
    coreset : Coreset
        A coreset of the tracks.
    tracks : Track or sequence of Track
        The samples.

    Returns
    -------
    tuple of Track
        Unchanged samples of each track, with positive weights.

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
    if isinstance(tracks, Track):
        tracks = (tracks,)
    return tuple(_select_track_samples(coreset, track) for track in tracks)


def _select_track_samples(coreset: Coreset, track: Track) -> Track:
    """Select the samples of one track."""
    # The blocks must have the track's samples: compare the times of their first and last ones.
    blocks = coreset.track(track.id)
    cuts = np.concatenate([[0], np.cumsum(blocks.counts)])
    # With another number of samples there are no times to compare, which never match.
    edge_times = np.empty(0)
    if cuts[-1] == len(track):
        edge_times = track.times[np.concatenate([cuts[:-1], cuts[1:] - 1])]
    if not np.array_equal(edge_times, blocks.edges.T.ravel()):
        raise OptionError(f"the coreset is not of this track {track.id!r}: samples or times differ")

    kept, new_weights = select_block_samples(
        track.times, track.positions, sample_weights(track), cuts
    )
    return Track(track.id, track.times[kept], track.positions[kept], new_weights, plane=track.plane)
