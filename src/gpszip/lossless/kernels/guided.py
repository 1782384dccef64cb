"""What a walk says of the next number of a column, and how near that usually is.

Numbers of guides are in sixteenths of the column's steps. Everything is integer arithmetic.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted
from gpszip.lossless.kernels.predictions import GUIDE_STEPS, SUBSTEP_BITS
from gpszip.lossless.setting import Guide

__all__ = ["GUIDE_CLASSES", "GuideState", "learn_guide", "look_up", "new_guide_state"]

#: Classes of what a guide says; 0 for nothing.
GUIDE_CLASSES = 8

#: Errors of a class are averaged over this many numbers at last, in units of 1/16 of a sixteenth.
_MAX_USES = 32
_ERROR_BITS = 4

#: A mean error is at least 3 sixteenths; an error counts as so many mean errors, and as 2**46, at
#: most.
_MIN_SCALE = 3
_OUTLIER = 20
_MAX_ERROR = 1 << 46

#: What a guide says is at most this far from the last number.
_MAX_STEP = 1 << 60

#: Index of each number in ``GuideState.place``: run, next and last knot of the run.
_RUN, _EVENT, _AFTER = 0, 1, 2
_PLACE_SIZE = 3


class GuideState(NamedTuple):
    """Where a guide is, and how near it was.

    Parameters
    ----------
    place : int64 array, shape (3,)
        Run, next knot and end of the run.
    steps : int64 array, shape (3,) or (0,)
        Steps to what the guide says: itself, the guide's own step, and its next one. Empty for a
        column without a guide.
    errors, uses : int64 array, shape (8,)
        Mean absolute error of each class, and of how many numbers.
    """

    place: NDArray[np.int64]
    steps: NDArray[np.int64]
    errors: NDArray[np.int64]
    uses: NDArray[np.int64]


def new_guide_state(guide: Guide, scale: int) -> GuideState:
    """Return the state before the first number; mean errors begin with ``scale``."""
    place = np.zeros(_PLACE_SIZE, np.int64)
    place[_RUN] = -1
    return GuideState(
        place,
        np.zeros(GUIDE_STEPS if len(guide.values) else 0, np.int64),
        np.full(GUIDE_CLASSES, scale << _ERROR_BITS, np.int64),
        np.zeros(GUIDE_CLASSES, np.int64),
    )


@inner_uncounted
def _next_knot(guide: Guide, state: GuideState, i: int, last: int) -> None:
    """Move on to the first knot of the row's run that is still to come after the last number."""
    place = state.place
    while place[_RUN] + 2 < len(guide.run_rows) and guide.run_rows[place[_RUN] + 1] <= i:
        place[_RUN] += 1
        place[_EVENT] = guide.run_events[place[_RUN]]
        place[_AFTER] = guide.run_events[place[_RUN] + 1]
    # The first row of a run may be at its first knot.
    if guide.run_rows[place[_RUN]] < i:
        while place[_EVENT] < place[_AFTER]:
            if guide.values[place[_EVENT]] > last + guide.slack:
                break
            place[_EVENT] += 1


@inner_uncounted
def look_up(
    guide: Guide, state: GuideState, values: NDArray[np.int64], i: int
) -> tuple[int, int, int]:
    """Enter the steps to what the guide says of row i; return its class, first step and mean error.

    Guides with runs list what is still to come; others have a number for each row. The class is 0
    where the guide says nothing.
    """
    if len(guide.values) == 0:
        return np.int64(0), np.int64(0), np.int64(_MIN_SCALE)
    steps = state.steps
    last = values[np.uint64(i - 1)] << SUBSTEP_BITS

    # The guide's number, the one before and the one after.
    if len(guide.run_rows) > 0:
        _next_knot(guide, state, i, last)
        k, end = state.place[_EVENT], state.place[_AFTER]
        before = k
    else:
        k, end = np.int64(i), np.int64(len(values))
        before = k - 1
    kind = np.int64(guide.classes[np.uint64(k)]) if k < end else np.int64(0)
    if kind == 0:
        steps[:] = 0
        return kind, np.int64(0), np.int64(_MIN_SCALE)

    # Steps to it. Of knots to come, the first two are the same.
    number = guide.values[np.uint64(k)]
    step = min(max(number - last, -_MAX_STEP), _MAX_STEP)
    steps[0] = step
    steps[1] = number - guide.values[np.uint64(before)] if before < k else step
    steps[2] = guide.values[np.uint64(k + 1)] - number if k + 1 < end else 0
    return kind, step, max(state.errors[np.uint64(kind)] >> _ERROR_BITS, _MIN_SCALE)


@inner_uncounted
def learn_guide(state: GuideState, kind: int, error: int, scale: int) -> None:
    """Learn the error of what the guide said, in sixteenths, where the mean was ``scale``."""
    errors, uses, k = state.errors, state.uses, np.uint64(kind)
    error = min(abs(error), _OUTLIER * scale, _MAX_ERROR)
    uses[k] = min(uses[k] + 1, _MAX_USES)
    errors[k] += ((error << _ERROR_BITS) - errors[k]) // uses[k]
