"""Predictions of the next number of a column from those before it and from other columns.

Steps (differences between neighbours) are in sixteenths of the column's step. Everything is integer
arithmetic, so that every machine predicts the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted

__all__ = [
    "GUIDE_STEPS",
    "SUBSTEP_BITS",
    "Predictor",
    "forget",
    "learn",
    "new_predictor",
    "predict",
    "steps_of_sides",
]

#: Binary digits after the point of a step.
SUBSTEP_BITS = 4

#: Steps of the column itself, and of each other column, that are remembered.
_LAGS = 8
_SIDE_LAGS = 4

#: Candidates: standing still, the last step, the same for the time that passed, a linear filter,
#: level and slope, and the last step with its change.
_PLAIN_CANDIDATES = 6

#: A guided column has two more: where the walk is, and the walk's own step.
_GUIDED_CANDIDATES = _PLAIN_CANDIDATES + 2

#: Inputs of the filter from a guide: where the walk is, its own step, and its next one.
GUIDE_STEPS = 3
_FILTER = 3
_LEVEL = 4

#: Where each kind of numbers begins in ``Predictor.lanes``. Inputs are at most 8 of the column, 4
#: of each of two others and 3 of a guide; loops of a fixed length become vector instructions.
_MAX_INPUTS = 24
_SHIFTS = _MAX_INPUTS
_ENERGIES = 2 * _MAX_INPUTS
_WEIGHTS = 3 * _MAX_INPUTS
_LANES = 4 * _MAX_INPUTS

#: Steps that filters take are at most 2**26, after the column's shift; all others at most 2**56.
_MAX_INPUT = 1 << 26
_MAX_STEP = 1 << 56

#: Corrections of the best candidate by the others are at most this: their weighted sum stays below
#: 2**62.
_MAX_CORRECTION = 1 << 48

#: Errors of candidates are averaged over 2**4 numbers, and begin with 64 steps.
_ERROR_SHIFT = 4
_FIRST_ERROR = 64 << SUBSTEP_BITS

#: Weights of filters are in units of 2**-16; energies of inputs are averaged over 2**5 numbers.
_WEIGHT_BITS = 16
_MAX_WEIGHT = 1 << 24
_ENERGY_SHIFT = 5

#: Binary digits of an input's mean square are at least 3. A float64 has its exponent above 52
#: digits: that of a number with one digit is 1023.
_MIN_DIGITS = 3
_MANTISSA_BITS = 52
_EXPONENT_BIAS = 1022

#: The filter moves by 2**-6 of the error.
_FILTER_SHIFT = 6

#: Gains of level and slope: 16 / 64 and 8 / 256 of the error.
_LEVEL_GAIN = 16
_SLOPE_GAIN = 8

#: An error beyond this many mean errors counts as so many.
_MAX_FILTER_ERROR = 6
_MAX_CANDIDATE_ERROR = 20


class Predictor(NamedTuple):
    """What has been learned of a column, and workspace for one prediction.

    Parameters
    ----------
    steps : int64 array, shape (n + 8,)
        Steps of the column: that to row i at ``i + 7``. Rows before the first have zeros, and so
        has what was forgotten.
    side_steps : int64 array, shape (sides, n + 3)
        The same of the other columns, all of which are known: that to row i at ``i + 3``.
    lanes : int64 array, shape (96,)
        Inputs of the filter, by what power of two each is divided, their mean squares in
        sixteenths, and their weights, 24 each: zeros where there are fewer inputs.
    candidates, errors : int64 array, shape (8,)
        Predictions, and their mean absolute errors in quarters.
    line : int64 array, shape (2,)
        Level (relative to the last value) and slope.
    """

    steps: NDArray[np.int64]
    side_steps: NDArray[np.int64]
    lanes: NDArray[np.int64]
    candidates: NDArray[np.int64]
    errors: NDArray[np.int64]
    line: NDArray[np.int64]


def steps_of_sides(sides: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the steps of other columns, after those of four rows before the first."""
    steps = np.clip(np.diff(sides) << SUBSTEP_BITS, -_MAX_STEP, _MAX_STEP)
    return np.pad(steps, ((0, 0), (_SIDE_LAGS, 0)))


def new_predictor(
    rows: int, shift: int, side_steps: NDArray[np.int64], side_shifts: NDArray[np.int64]
) -> Predictor:
    """Return a predictor that knows nothing.

    Parameters
    ----------
    rows, shift : int
        Length of the column, and by what power of two its steps are divided.
    side_steps : int64 array, shape (sides, rows + 3)
        Steps of other columns, from :func:`steps_of_sides`.
    side_shifts : int64 array, shape (sides,)
        Their shifts.
    """
    # Inputs come from the column, then from the others, then from a guide.
    lanes = np.zeros(_LANES, np.int64)
    lanes[_SHIFTS : _SHIFTS + _MAX_INPUTS] = shift
    for k, side_shift in enumerate(side_shifts.tolist()):
        first = _SHIFTS + _LAGS + _SIDE_LAGS * k
        lanes[first : first + _SIDE_LAGS] = side_shift
    return Predictor(
        np.zeros(rows + _LAGS, np.int64),
        side_steps.copy(),
        lanes,
        np.zeros(_GUIDED_CANDIDATES, np.int64),
        np.full(_GUIDED_CANDIDATES, _FIRST_ERROR, np.int64),
        np.zeros(2, np.int64),
    )


@inner_uncounted
def _clip(value: int, limit: int) -> int:
    """Clip a number to [-limit, limit]."""
    return min(max(value, -limit), limit)


@inner_uncounted
def _set_inputs(predictor: Predictor, i: int, guide_steps: NDArray[np.int64]) -> None:
    """Enter the inputs of the filters for row i, before shifts.

    They are differences of order 0 to 3 of the last steps, differences of older ones, the same of
    the other columns, whose step at this row is known, and the steps of a guide, if there is one.
    Differences are less alike than steps, so that the filters learn faster.
    """
    inputs, steps, side_steps = predictor.lanes, predictor.steps, predictor.side_steps

    # The column's own steps.
    row = np.uint64(i)
    a, b = steps[row + np.uint64(6)], steps[row + np.uint64(5)]
    c, d = steps[row + np.uint64(4)], steps[row + np.uint64(3)]
    e, f = steps[row + np.uint64(2)], steps[row + np.uint64(1)]
    g, h = steps[row], steps[row - np.uint64(1)]
    inputs[0] = a
    inputs[1] = a - b
    inputs[2] = a - 2 * b + c
    inputs[3] = a - 3 * b + 3 * c - d
    inputs[4], inputs[5], inputs[6], inputs[7] = d - e, e - f, f - g, g - h

    # Those of the other columns.
    first = np.uint64(_LAGS)
    for k in range(len(side_steps)):
        a, b = side_steps[k, row + np.uint64(3)], side_steps[k, row + np.uint64(2)]
        c, d = side_steps[k, row + np.uint64(1)], side_steps[k, row]
        inputs[first] = a
        inputs[first + np.uint64(1)] = a - b
        inputs[first + np.uint64(2)] = a - 2 * b + c
        inputs[first + np.uint64(3)] = c - d
        first += np.uint64(_SIDE_LAGS)

    # Those of the guide.
    if len(guide_steps) > 0:
        inputs[first] = guide_steps[0]
        inputs[first + np.uint64(1)] = guide_steps[1]
        inputs[first + np.uint64(2)] = guide_steps[2]


@inner_uncounted
def _filtered(lanes: NDArray[np.int64]) -> int:
    """Shift and clip the inputs; return the sum of weight * input."""
    total = np.int64(0)
    for j in range(_MAX_INPUTS):
        x = _clip(lanes[j] >> lanes[_SHIFTS + j], _MAX_INPUT)
        lanes[j] = x
        total += lanes[_WEIGHTS + j] * x
    return total


@inner_uncounted
def _weighted_mean(candidates: NDArray[np.int64], errors: NDArray[np.int64], count: int) -> int:
    """Mean of the candidates, by their errors."""
    # The first candidate that has the least error.
    best = np.uint64(0)
    for k in range(np.uint64(1), np.uint64(count)):
        if errors[k] < errors[best]:
            best = k
    middle, smallest = candidates[best], errors[best] + 4

    # The weight of an error beyond 8 times the least is below 2**-12.
    total, weights = np.int64(0), np.int64(0)
    for k in range(np.uint64(count)):
        error = errors[k] + 4
        if error > 8 * smallest:
            continue
        quotient = np.int64(np.uint64(smallest << 10) // np.uint64(error))
        square = (quotient * quotient) >> 10
        weight = (square * square) >> 10
        total += weight * _clip(candidates[k] - middle, _MAX_CORRECTION)
        weights += weight
    return middle + total // weights if total != 0 else middle


@inner_uncounted
def predict(
    predictor: Predictor,
    i: int,
    ratio: int,
    shift: int,
    guide_steps: NDArray[np.int64],
    guided: bool,
) -> int:
    """Return the predicted step to row i, in sixteenths.

    With candidates c, their mean errors e and the smallest one, e0, the weights are
    ((e0 + 4) / (e + 4))**4, and the prediction is the weighted mean of c.

    Parameters
    ----------
    predictor : Predictor
        What has been learned of the column.
    ratio : int
        Time since the last row by that before it, in units of 1/256.
    shift : int
        The column's shift.
    guide_steps : int64 array, shape (3,) or (0,)
        What the guide says: the step to it, and its own step, are candidates, too.
    guided : bool
        Whether it says anything of this row.
    """
    _set_inputs(predictor, i, guide_steps)
    candidates, line, row = predictor.candidates, predictor.line, np.uint64(i)
    last, before = predictor.steps[row + np.uint64(6)], predictor.steps[row + np.uint64(5)]
    candidates[0] = 0
    candidates[1] = last
    candidates[2] = (_clip(last, _MAX_STEP >> 8) * ratio) >> 8
    filtered = _filtered(predictor.lanes) >> _WEIGHT_BITS
    candidates[_FILTER] = _clip(filtered, _MAX_STEP >> shift) << shift
    candidates[_LEVEL] = _clip(line[0] + line[1], _MAX_STEP)
    candidates[5] = 2 * last - before
    if guided:
        candidates[6] = guide_steps[0]
        candidates[7] = guide_steps[1]
    count = _GUIDED_CANDIDATES if guided else _PLAIN_CANDIDATES
    return _weighted_mean(candidates, predictor.errors, count)


@inner_uncounted
def _learn_filter(lanes: NDArray[np.int64], error: int) -> None:
    """Move the weights of the filter: w += rate * error * x / (mean of x**2) for each input x."""
    for j in range(_MAX_INPUTS):
        # The mean becomes a power of two, so that nothing is divided: its binary digits are in the
        # exponent of a float64.
        x, energy = lanes[j], lanes[_ENERGIES + j]
        energy += (((x * x) << 4) - energy) >> _ENERGY_SHIFT
        digits = (np.float64(energy >> 4).view(np.int64) >> _MANTISSA_BITS) - _EXPONENT_BIAS
        # Error and input are at most 2**26.
        move = ((error * x) << 8) >> (max(digits, _MIN_DIGITS) - 8 + _FILTER_SHIFT)
        lanes[_ENERGIES + j] = energy
        lanes[_WEIGHTS + j] = _clip(lanes[_WEIGHTS + j] + move, _MAX_WEIGHT)


@inner_uncounted
def learn(predictor: Predictor, i: int, step: int, scale: int, shift: int, guided: bool) -> None:
    """Learn the step to row i, in sixteenths, where the mean error is ``scale``.

    ``guided`` tells whether the guide said anything of it.
    """
    candidates, errors, line = predictor.candidates, predictor.errors, predictor.line

    # The filter.
    error = _clip(step - candidates[_FILTER], _MAX_FILTER_ERROR * scale) >> shift
    _learn_filter(predictor.lanes, _clip(error, _MAX_INPUT))

    # Level and slope; the level counts from the new value.
    expected = candidates[_LEVEL]
    error = _clip(step - expected, _MAX_STEP)
    line[0] = expected + (error * _LEVEL_GAIN >> 6) - step
    line[1] = _clip(line[1] + (error * _SLOPE_GAIN >> 8), _MAX_STEP)

    # Errors of the candidates. A loop over all becomes vector instructions.
    count = _GUIDED_CANDIDATES if guided else _PLAIN_CANDIDATES
    limit = _MAX_CANDIDATE_ERROR * scale
    for k in range(len(errors)):
        error = 4 * min(abs(step - candidates[k]), limit) - errors[k]
        errors[k] += error >> _ERROR_SHIFT if k < count else 0

    # The step itself.
    predictor.steps[np.uint64(i + 7)] = _clip(step, _MAX_STEP)


@inner_uncounted
def forget(predictor: Predictor, i: int) -> None:
    """Forget the last steps after an outlier or a gap at row i: they say nothing of the next."""
    predictor.steps[i : i + _LAGS] = 0
    predictor.side_steps[:, i : i + _SIDE_LAGS] = 0
    predictor.line[:] = 0
