"""Several tracks as one sequence of samples, cut into runs that no interval leaves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track

__all__ = ["join_tracks"]

#: Seconds from the end of a track to the next one. No cost depends on it.
_BETWEEN = 1.0


def join_tracks(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]] | None = None
) -> tuple[Track, NDArray[np.int64]]:
    """Join tracks to one sequence of samples, one after the other.

    Parameters
    ----------
    tracks : sequence of Track
        On one plane. A single track stays as it is; the times of others are shifted, so that time
        increases.
    gaps : sequence of bool arrays, shape (n - 1,), optional
        For each track, the steps that are gaps.

    Returns
    -------
    Track
        All samples.
    int64 array, shape (r,)
        First sample of each run: of a track, or after a gap.

    Examples
    --------
    >>> bus = Track("bus", [0, 1], [[0.0], [5.0]])
    >>> cab = Track("cab", [0, 1, 99], [[0.0], [5.0], [0.0]])
    >>> joined, begins = join_tracks([bus, cab], [np.array([False]), np.array([False, True])])
    >>> joined.times.tolist(), begins.tolist()
    ([0.0, 1.0, 2.0, 3.0, 101.0], [0, 2, 4])
    """
    # Tracks begin one after the other, each after the gaps of those before.
    firsts = np.cumsum([0, *map(len, tracks)])[:-1]
    begins = [np.asarray([first], np.int64) for first in firsts]
    if gaps is not None:
        begins += [first + 1 + np.flatnonzero(gap) for first, gap in zip(firsts, gaps, strict=True)]
    all_begins = np.sort(np.concatenate(begins))
    if len(tracks) == 1:
        return tracks[0], all_begins

    # Times since the first sample of each, after the end of the track before.
    durations = np.array([track.times[-1] - track.times[0] + _BETWEEN for track in tracks])
    starts = np.cumsum(durations) - durations
    times = [
        start + (track.times - track.times[0]) for start, track in zip(starts, tracks, strict=True)
    ]

    # Tracks without weights have weight 1 each, if others have some.
    weights = None
    if any(track.weights is not None for track in tracks):
        weights = np.concatenate(
            [np.ones(len(track)) if track.weights is None else track.weights for track in tracks]
        )
    positions = np.concatenate([track.positions for track in tracks])
    joined = Track("tracks", np.concatenate(times), positions, weights, plane=tracks[0].plane)
    return joined, all_begins
