"""Coding of durations: how many cells a part takes, given how far it goes and how fast the way was gone before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.adaptive import HISTOGRAM, ONE_SIDED, PARTS, TWO_SIDED, code_mixture
from gpszip.kernels.jit import jit
from gpszip.kernels.range_coder import Coder
from gpszip.kernels.spread import MOST, REACH, code_far, fill
from gpszip.kernels.walk_model import PACE, PACE_SLOW, STEP_LENGTH, WalkModel

__all__ = ["T_GAP", "T_KNOWN", "T_LINK", "T_NEW", "T_STAY", "code_span", "guess_spans", "pace_of", "reach_of"]

#: Mixtures of durations, by kind of step.
T_KNOWN, T_LINK, T_NEW, T_STAY, T_GAP = 0, 1, 2, 3, 4

#: A pace is in units of this power of a half.
_PACE_UNIT = 20


@jit
def code_span(coder: Coder, model: WalkModel, mixture: int, expected: NDArray[np.int64], known: int, cells: int) -> int:
    """Code a duration in cells; ``expected`` holds ``known`` guesses in sixteenths of a cell."""
    kinds, centers, scales = np.empty(28, np.int64), np.empty(28, np.int64), np.empty(28, np.int64)
    count = fill(0, HISTOGRAM, 0, 16, kinds, centers, scales)
    for i in range(9):
        count = fill(count, ONE_SIDED, 0, PARTS << (i if i < 5 else 2 * i - 4), kinds, centers, scales)
    for i in range(known):
        for shift in range(1, 5):
            count = fill(count, TWO_SIDED, expected[i], expected[i] >> shift, kinds, centers, scales)
    far = cells >= REACH
    cells_near = min(cells, REACH - 1)
    coded = code_mixture(coder, cells_near, 1, REACH, kinds, centers, scales, count, model.weights[mixture], model.histograms[mixture])
    if coded == REACH - 1:
        return coded + code_far(coder, model, 0, cells - coded if far else np.int64(0))
    return coded


@jit
def guess_spans(model: WalkModel, half: int, far: int, expected: NDArray[np.int64]) -> int:
    """Durations to expect on a known way, from its own pace, the reverse one, the last and the usual one."""
    own = model.pace[half] if model.pace[half] > 0 else model.pace[half ^ 1]
    paces = (own if own > 0 else model.scalars[PACE_SLOW], model.scalars[PACE], model.scalars[PACE_SLOW])
    known = 0
    for pace in paces:
        if pace > 0:
            expected[known] = min((far * pace) >> _PACE_UNIT, np.int64(1) << 30)
            known += 1
    return known


@jit
def pace_of(far: int, cells: int) -> int:
    """Sixteenths of a cell for a sixteenth of a quantum, in units of 2**-20; 0 if unknown."""
    if far == 0 or cells == 0:
        return np.int64(0)
    return min(max(((min(cells, MOST) * PARTS) << _PACE_UNIT) // far, np.int64(1)), np.int64(1) << 26)


@jit
def reach_of(model: WalkModel, cells: int, timed: bool) -> int:
    """Length in sixteenths that a step of this duration has at the usual pace."""
    pace = model.scalars[PACE_SLOW]
    if not timed or pace == 0:
        return max(model.scalars[STEP_LENGTH], np.int64(64))
    return max(min(((min(cells, MOST) * PARTS) << _PACE_UNIT) // pace, np.int64(1) << 34), np.int64(32))
