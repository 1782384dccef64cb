"""Opening window and dead reckoning: one sample after the other, as a device would."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track

__all__ = ["dead_reckoning", "opening_window"]

#: Ends of windows that are tried at once.
_BATCH = 32

#: Samples that are compared with a prediction at once, at first.
_CHUNK = 16

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def opening_window(track: Track, tolerance: float, longest: int = 2_000) -> Ints:
    """Return the samples that the opening window keeps (Meratnia and de By, EDBT 2004: OPW-TR).

    A window grows from the last sample kept until the line to its end passes one of its samples
    farther than the tolerance, at that sample's time. Then the sample before the end is kept.

    Parameters
    ----------
    track : Track
        n samples.
    tolerance : float
        Metres.
    longest : int
        Samples of a window at most, as the work grows with the square of its length.

    Returns
    -------
    int64 array
        Indices of the samples kept, among them both ends.

    Examples
    --------
    >>> opening_window(Track("a", range(5), [[0, 0], [1, 0], [2, 0], [3, 2], [4, 4]]), 0.5).tolist()
    [0, 2, 4]
    """
    kept, anchor = [0], 0
    while anchor < len(track) - 1:
        anchor = _last_end(track, anchor, tolerance, min(anchor + longest, len(track) - 1))
        kept.append(anchor)
    return np.array(kept, np.int64)


def _last_end(track: Track, anchor: int, tolerance: float, limit: int) -> int:
    """Return the last end of a window whose samples are within the tolerance, as are earlier ones.

    The first sample after the anchor is always one.
    """
    for begin in range(anchor + 2, limit + 1, _BATCH):
        # A row for each end, a column for each sample between the anchor and the last end.
        ends = np.arange(begin, min(begin + _BATCH, limit + 1))
        inner = np.arange(anchor + 1, ends[-1])
        moved = track.positions[ends] - track.positions[anchor]
        shares = (track.times[inner] - track.times[anchor]) / (
            track.times[ends] - track.times[anchor]
        )[:, None]
        squares = np.zeros(shares.shape)
        for axis in range(track.dimension):
            offsets = track.positions[inner, axis] - track.positions[anchor, axis]
            squares += (offsets - shares * moved[:, axis, None]) ** 2

        # The first end of which a sample before it is too far.
        is_far = (squares > tolerance**2) & (inner < ends[:, None])
        wrong = np.flatnonzero(is_far.any(axis=1))
        if len(wrong):
            return int(ends[wrong[0]]) - 1
    return limit


def dead_reckoning(track: Track, tolerance: float) -> Ints:
    """Return the samples that dead reckoning sends (Trajcevski et al., MobiDE 2006).

    The last sample sent and the velocity to the one after it predict where the agent is. A sample
    farther than the tolerance from there is sent.

    Parameters
    ----------
    track : Track
        n samples.
    tolerance : float
        Metres.

    Returns
    -------
    int64 array
        Indices of the samples sent, among them both ends.

    Examples
    --------
    >>> dead_reckoning(Track("a", range(5), [[0, 0], [1, 0], [2, 0], [3, 2], [4, 4]]), 0.5).tolist()
    [0, 3, 4]
    """
    kept, last, end = [0], 0, len(track) - 1
    while last < end:
        found = _first_far(track, last, tolerance)
        if found > end:
            break
        kept.append(found)
        last = found
    if kept[-1] != end:
        kept.append(end)
    return np.array(kept, np.int64)


def _first_far(track: Track, last: int, tolerance: float) -> int:
    """Return the first sample that is far from its prediction; n if there is none."""
    # The sample after the last one gives the velocity, and is where it is predicted to be.
    begin, size = last + 2, _CHUNK
    if begin >= len(track):
        return len(track)
    step = track.times[last + 1] - track.times[last]
    velocity = (track.positions[last + 1] - track.positions[last]) / step

    # Chunks that double, so that the work is at most twice what is needed.
    while begin < len(track):
        chunk = slice(begin, begin + size)
        since = (track.times[chunk] - track.times[last])[:, None]
        predicted = track.positions[last] + since * velocity
        is_far = np.linalg.norm(track.positions[chunk] - predicted, axis=1) > tolerance
        if is_far.any():
            return begin + int(is_far.argmax())
        begin, size = begin + size, 2 * size
    return len(track)
