"""Curves through tunnels with the fewest knots, and the coding of their knots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.integer_contexts import INTEGER_CONTEXTS
from gpszip.codec.kernels.adaptive import code_signed, code_unsigned
from gpszip.codec.kernels.range_coder import Coder, is_decoding, is_exhausted
from gpszip.kernels.jit import inner_uncounted, jit_uncounted

__all__ = ["BEGINS_RUN", "BEGINS_TRACK", "CURVE_CONTEXTS", "GOES_ON", "code_knots", "find_knots"]

#: What a knot is: the first of a track, the first after a hole, or another one.
BEGINS_TRACK = np.int64(2)
BEGINS_RUN = np.int64(1)
GOES_ON = np.int64(0)

#: Classes of durations: below 4, below 16, and others.
_CLASSES = 3

#: Contexts: durations by the class before, and after the first knots, values by the sign of the
#: step before and the class of the duration, first values, counts of runs and knots.
_VALUES = _CLASSES * INTEGER_CONTEXTS
_STARTS = _VALUES + 3 * _CLASSES * INTEGER_CONTEXTS
CURVE_CONTEXTS = _STARTS + 5 * INTEGER_CONTEXTS


@inner_uncounted
def _from_middle(first: int, last: int, turn: int) -> int:
    """Number that comes at a turn, from the middle of a range outwards: curves lean to no side."""
    away = (turn + 1) // 2
    return (first + last) // 2 + (away if turn % 2 else -away)


@jit_uncounted
def find_knots(
    times: NDArray[np.int64],
    values: NDArray[np.float64],
    bound: float,
    max_samples: int,
    lowest: NDArray[np.int64],
    parents: NDArray[np.int64],
    queue: NDArray[np.int64],
) -> int:
    """Find a polyline with the fewest knots within ``bound`` of every sample.

    Knots lie at times of samples and have whole values. The state (i, u) is a knot of value u at
    sample i. A line from it to (j, v) passes all samples between where its slope s is in the cone

        max_k (y_k - bound - u) / (t_k - t_i) <= s <= min_k (y_k + bound - u) / (t_k - t_i)

    with i < k <= j, which narrows from sample to sample (the cone of Williams 1978; tunnels of Imai
    and Iri 1986). States are visited breadth first, so that the first one at the last sample has
    the fewest knots.

    Parameters
    ----------
    times : int64 array, shape (n,)
        Increasing.
    values : float64 array, shape (n,)
        The samples y.
    bound : float
        Largest distance from them.
    max_samples : int
        Lines pass over at most so many samples, which bounds the work.
    lowest : int64 array, shape (n,)
        Filled in: smallest value of a knot at each sample.
    parents : int64 array, shape (n, w)
        Filled in: the state before each one; -1 for none, -2 where it was not reached.
    queue : int64 array, shape (n * w,)
        Workspace.

    Returns
    -------
    int
        Number of the last state, i * w + u - lowest_i; -1 if no polyline was found.
    """
    # The values that a knot may have; the first sample's are the beginning.
    n, width = parents.shape
    for i in range(n):
        lowest[i] = np.int64(np.ceil(values[i] - bound))
        for k in range(width):
            parents[i, k] = -2
    filled, first = 0, 0
    highest = min(np.int64(np.floor(values[0] + bound)) - lowest[0], width - 1)
    for turn in range(highest + 1):
        k = _from_middle(0, highest, turn)
        parents[0, k] = -1
        queue[filled] = k
        filled += 1
        if n == 1:
            return k

    # Follow the cone of each state, in the order in which they were reached.
    while first < filled:
        state = queue[first]
        first += 1
        i = state // width
        u = lowest[i] + state % width
        low, high = -np.inf, np.inf
        for j in range(i + 1, min(n, i + 1 + max_samples)):
            duration = np.float64(times[j] - times[i])
            low = max(low, (values[j] - bound - u) / duration)
            high = min(high, (values[j] + bound - u) / duration)
            if low > high:
                break
            # States that are reached for the first time.
            begin = max(np.int64(np.ceil(u + low * duration)), lowest[j])
            end = min(np.int64(np.floor(u + high * duration)), lowest[j] + width - 1)
            for turn in range(end - begin + 1):
                k = _from_middle(begin, end, turn) - lowest[j]
                if parents[j, k] == -2:
                    parents[j, k] = state
                    if j == n - 1:
                        return j * width + k
                    queue[filled] = j * width + k
                    filled += 1
    return -1


@inner_uncounted
def _class_of(duration: int) -> int:
    """Class of a duration."""
    return 0 if duration < 4 else 1 if duration < 16 else 2


@inner_uncounted
def _count_runs(kinds: NDArray[np.int64], row: int) -> int:
    """Number of runs of the track that begins at a row."""
    if kinds[row] < 0:
        return np.int64(0)
    runs, end = np.int64(1), row + 1
    while end < len(kinds) and kinds[end] >= 0 and kinds[end] != BEGINS_TRACK:
        runs += 1 if kinds[end] == BEGINS_RUN else 0
        end += 1
    return runs


@inner_uncounted
def _count_more(kinds: NDArray[np.int64], row: int) -> int:
    """Number of knots after the first one of the run that begins at a row."""
    more = np.int64(0)
    while row + more + 1 < len(kinds) and kinds[row + more + 1] == GOES_ON:
        more += 1
    return more


@inner_uncounted
def _code_first_of_track(
    coder: Coder,
    times: NDArray[np.int64],
    values: NDArray[np.int64],
    counts: NDArray[np.int32],
    row: int,
    before: int,
) -> None:
    """Code the first knot of a track, relative to that in the row ``before``; -1 for none."""
    start_time = times[before] if before >= 0 else np.int64(0)
    start_value = values[before] if before >= 0 else np.int64(0)
    context = _STARTS + 2 * INTEGER_CONTEXTS
    times[row] = start_time + code_signed(coder, counts, context, times[row] - start_time)
    context = _STARTS + 3 * INTEGER_CONTEXTS
    values[row] = start_value + code_signed(coder, counts, context, values[row] - start_value)


@inner_uncounted
def _code_first_of_run(
    coder: Coder,
    times: NDArray[np.int64],
    values: NDArray[np.int64],
    counts: NDArray[np.int32],
    row: int,
) -> None:
    """Code the first knot of a later run, relative to the knot before the hole."""
    hole = times[row] - times[row - 1] - 1
    context = _STARTS + 4 * INTEGER_CONTEXTS
    times[row] = times[row - 1] + 1 + code_unsigned(coder, counts, context, hole)
    step = values[row] - values[row - 1]
    context = _STARTS + 3 * INTEGER_CONTEXTS
    values[row] = values[row - 1] + code_signed(coder, counts, context, step)


@inner_uncounted
def _code_rest_of_run(
    coder: Coder,
    kinds: NDArray[np.int64],
    times: NDArray[np.int64],
    values: NDArray[np.int64],
    counts: NDArray[np.int32],
    first: int,
    end: int,
) -> bool:
    """Code the knots from a row on; return whether a decoder had enough bytes."""
    class_before, sign = 2, 1
    for row in range(first, end):
        # The duration, by the class of the one before.
        kinds[row] = GOES_ON
        duration = times[row] - times[row - 1]
        context = class_before * INTEGER_CONTEXTS
        duration = 1 + code_unsigned(coder, counts, context, duration - 1)
        times[row] = times[row - 1] + duration

        # The step of the value, by the sign of the one before and the class of the duration.
        class_before = _class_of(duration)
        context = _VALUES + (sign * _CLASSES + class_before) * INTEGER_CONTEXTS
        step = code_signed(coder, counts, context, values[row] - values[row - 1])
        values[row] = values[row - 1] + step
        sign = 0 if step < 0 else 1 if step == 0 else 2
        if is_decoding(coder) and is_exhausted(coder):
            return False
    return True


@jit_uncounted
def code_knots(
    coder: Coder,
    kinds: NDArray[np.int64],
    times: NDArray[np.int64],
    values: NDArray[np.int64],
    counts: NDArray[np.int32],
    tracks: int,
) -> int:
    """Code the knots of all tracks in place.

    Of each track the number of runs is coded, of each run that of its knots. The first knot of a
    track has a time and a value relative to the first one of the track before; the first one of a
    later run a duration less 1, and a value relative to the knot before. Others have a duration
    less 1, by the class of the duration before, and a step of the value, by the sign of the step
    before and the class of the duration.

    Parameters
    ----------
    coder : Coder
        In any direction.
    kinds, times, values : int64 arrays, shape (n,)
        ``BEGINS_TRACK``, ``BEGINS_RUN`` or ``GOES_ON``; a decoder fills all in. A track without
        knots takes a row of kind -1, time 0 and value 0.
    counts : int32 array, shape (CURVE_CONTEXTS, 2)
        Counts of zeros and ones; changed in place.
    tracks : int
        Number of tracks.

    Returns
    -------
    int
        Number of rows; -1 if what is read has more than fit, or is none.
    """
    decodes = is_decoding(coder)
    row, before = 0, -1
    for _ in range(tracks):
        # Number of runs; a track without any takes a row that says so.
        runs = np.int64(0) if decodes else _count_runs(kinds, row)
        runs = code_unsigned(coder, counts, _STARTS, runs)
        if decodes and (is_exhausted(coder) or row + max(runs, 1) > len(kinds)):
            return -1
        if runs == 0:
            kinds[row], times[row], values[row] = -1, 0, 0
            row += 1
            continue

        for run in range(runs):
            # Number of knots less one.
            more = np.int64(0) if decodes else _count_more(kinds, row)
            more = code_unsigned(coder, counts, _STARTS + INTEGER_CONTEXTS, more)
            if decodes and (is_exhausted(coder) or row + more >= len(kinds)):
                return -1

            # The first knot, and those after it.
            kinds[row] = BEGINS_RUN if run else BEGINS_TRACK
            if run:
                _code_first_of_run(coder, times, values, counts, row)
            else:
                _code_first_of_track(coder, times, values, counts, row, before)
                before = row
            end = row + 1 + more
            if not _code_rest_of_run(coder, kinds, times, values, counts, row + 1, end):
                return -1
            row = end
    return row
