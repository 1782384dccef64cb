"""Douglas-Peucker and TD-TR: keep the sample that is farthest from the line, on both sides anew."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track

__all__ = ["from_segment", "significances", "synchronised"]

#: Least squared length of a segment, in place of zero.
_MIN_SQUARE = 1e-300

Floats = NDArray[np.float64]


def from_segment(track: Track, a: int, b: int) -> Floats:
    """Return the distances of the samples between a and b from the segment between both.

    Examples
    --------
    >>> from_segment(Track("a", [0, 1, 9], [[0, 0], [3, 4], [6, 0]]), 0, 2).tolist()
    [4.0]
    """
    start, line = track.positions[a], track.positions[b] - track.positions[a]
    moved = track.positions[a + 1 : b] - start
    along = np.clip(moved @ line / max(float(line @ line), _MIN_SQUARE), 0.0, 1.0)
    distances: Floats = np.linalg.norm(moved - along[:, None] * line, axis=1)
    return distances


def synchronised(track: Track, a: int, b: int) -> Floats:
    """Return the distances of the samples between a and b from where the line is at their times.

    Examples
    --------
    >>> synchronised(Track("a", [0, 1, 2], [[0, 0], [3, 4], [6, 0]]), 0, 2).tolist()
    [4.0]
    """
    start, line = track.positions[a], track.positions[b] - track.positions[a]
    shares = (track.times[a + 1 : b] - track.times[a]) / (track.times[b] - track.times[a])
    distances: Floats = np.linalg.norm(
        track.positions[a + 1 : b] - start - shares[:, None] * line, axis=1
    )
    return distances


def significances(track: Track, *, by_time: bool) -> Floats:
    """Return for each sample the tolerance from which on the algorithm drops it.

    The sample that is farthest from the line between the ends of a range is kept where its distance
    exceeds the tolerance, and cuts the range in two (Douglas and Peucker 1973). So a sample is kept
    if its own distance and those of all cuts above it exceed the tolerance: its significance is
    the least of these.

    Parameters
    ----------
    track : Track
        n samples.
    by_time : bool
        Whether distances are synchronised, which is TD-TR (Meratnia and de By, EDBT 2004).

    Returns
    -------
    float64 array, shape (n,)
        Metres; infinite for both ends.

    Examples
    --------
    >>> track = Track("a", range(5), [[0, 0], [1, 1], [2, 3], [3, 0], [4, 0]])
    >>> significances(track, by_time=True).round(2).tolist()
    [inf, 0.5, 3.0, 1.5, inf]
    """
    # The ends stay.
    found = np.zeros(len(track))
    found[[0, -1]] = np.inf
    distances_of = synchronised if by_time else from_segment
    ranges = [(0, len(track) - 1, np.inf)]

    # Cut ranges at their farthest samples.
    while ranges:
        a, b, limit = ranges.pop()
        if b - a < 2:
            continue
        distances = distances_of(track, a, b)
        farthest = int(distances.argmax())
        limit = min(limit, float(distances[farthest]))
        middle = a + 1 + farthest
        found[middle] = limit
        ranges += [(a, middle, limit), (middle, b, limit)]
    return found
