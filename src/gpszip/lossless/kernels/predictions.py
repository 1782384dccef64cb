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
    "set_inputs",
]

#: Binary digits after the point of a step.
SUBSTEP_BITS = 4

#: Steps of the column itself, and of each other column, that are remembered.
_LAGS = 8
_SIDE_LAGS = 4

#: Candidates: standing still, the last step, the same for the time that passed, a linear filter,
#: level and slope, and the last step with its change.
_CANDIDATES = 6

#: A guided column has two more: where the walk is, and the walk's own step.
_GUIDED_CANDIDATES = _CANDIDATES + 2

#: Inputs of the filter from a guide: where the walk is, its own step, and its next one.
GUIDE_STEPS = 3
_FILTER = 3
_LEVEL = 4

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
    steps : int64 array, shape (8,)
        Last steps of the column, the latest first.
    side_steps : int64 array, shape (sides, 4)
        Last steps of the other columns.
    inputs : int64 array, shape (m,)
        Inputs of the filters.
    energies, digits : int64 array, shape (m,)
        Mean square of each input, in sixteenths, and its number of binary digits.
    weights : int64 array, shape (m,)
        Weights of the filter.
    candidates, errors : int64 array, shape (6,) or (8,)
        Predictions, and their mean absolute errors in quarters.
    line : int64 array, shape (2,)
        Level (relative to the last value) and slope.
    """

    steps: NDArray[np.int64]
    side_steps: NDArray[np.int64]
    inputs: NDArray[np.int64]
    energies: NDArray[np.int64]
    digits: NDArray[np.int64]
    weights: NDArray[np.int64]
    candidates: NDArray[np.int64]
    errors: NDArray[np.int64]
    line: NDArray[np.int64]


def new_predictor(sides: int, *, guided: bool) -> Predictor:
    """Return a predictor that knows nothing, for a column beside so many others, and a guide."""
    inputs = _LAGS + _SIDE_LAGS * sides + (GUIDE_STEPS if guided else 0)
    candidates = _GUIDED_CANDIDATES if guided else _CANDIDATES
    return Predictor(
        np.zeros(_LAGS, np.int64),
        np.zeros((sides, _SIDE_LAGS), np.int64),
        np.zeros(inputs, np.int64),
        np.zeros(inputs, np.int64),
        np.full(inputs, 3, np.int64),
        np.zeros(inputs, np.int64),
        np.zeros(candidates, np.int64),
        np.full(candidates, _FIRST_ERROR, np.int64),
        np.zeros(2, np.int64),
    )


@inner_uncounted
def _clip(value: int, limit: int) -> int:
    """Clip a number to [-limit, limit]."""
    return min(max(value, -limit), limit)


@inner_uncounted
def set_inputs(
    predictor: Predictor,
    sides: NDArray[np.int64],
    i: int,
    shift: int,
    side_shifts: NDArray[np.int64],
    guide_steps: NDArray[np.int64],
) -> None:
    """Enter the inputs of the filters for row i.

    They are differences of order 0 to 3 of the last steps, differences of older ones, the same of
    the other columns, whose step at this row is known, and the steps of a guide, if there is one.
    Differences are less alike than steps, so that the filters learn faster.
    """
    steps, inputs = predictor.steps, predictor.inputs

    # The column's own steps.
    a, b, c, d = steps[0], steps[1], steps[2], steps[3]
    inputs[0] = _clip(a >> shift, _MAX_INPUT)
    inputs[1] = _clip((a - b) >> shift, _MAX_INPUT)
    inputs[2] = _clip((a - 2 * b + c) >> shift, _MAX_INPUT)
    inputs[3] = _clip((a - 3 * b + 3 * c - d) >> shift, _MAX_INPUT)
    for j in range(4, _LAGS):
        inputs[j] = _clip((steps[j - 1] - steps[j]) >> shift, _MAX_INPUT)

    # Those of the other columns.
    for k in range(len(sides)):
        before = predictor.side_steps[k]
        first, side_shift = _LAGS + _SIDE_LAGS * k, side_shifts[k]
        now = _clip((sides[k, i] - sides[k, i - 1]) << SUBSTEP_BITS, _MAX_STEP)
        inputs[first] = _clip(now >> side_shift, _MAX_INPUT)
        inputs[first + 1] = _clip((now - before[0]) >> side_shift, _MAX_INPUT)
        inputs[first + 2] = _clip((now - 2 * before[0] + before[1]) >> side_shift, _MAX_INPUT)
        inputs[first + 3] = _clip((before[1] - before[2]) >> side_shift, _MAX_INPUT)
        for j in range(_SIDE_LAGS - 1, 0, -1):
            before[j] = before[j - 1]
        before[0] = now

    # Those of the guide.
    for k in range(len(guide_steps)):
        inputs[_LAGS + _SIDE_LAGS * len(sides) + k] = _clip(guide_steps[k] >> shift, _MAX_INPUT)


@inner_uncounted
def predict(
    predictor: Predictor,
    ratio: int,
    shift: int,
    guide_steps: NDArray[np.int64],
    guided: bool,
) -> int:
    """Return the predicted step, in sixteenths.

    With candidates c, their mean errors e and the smallest one, e0, the weights are
    ((e0 + 4) / (e + 4))**4, and the prediction is the weighted mean of c.

    Parameters
    ----------
    predictor : Predictor
        With the inputs of this row.
    ratio : int
        Time since the last row by that before it, in units of 1/256.
    shift : int
        The column's shift.
    guide_steps : int64 array, shape (3,) or (0,)
        What the guide says: the step to it, and its own step, are candidates, too.
    guided : bool
        Whether it says anything of this row.
    """
    steps, inputs, candidates, errors = (
        predictor.steps,
        predictor.inputs,
        predictor.candidates,
        predictor.errors,
    )

    # The candidates.
    last = steps[0]
    candidates[0] = 0
    candidates[1] = last
    candidates[2] = (_clip(last, _MAX_STEP >> 8) * ratio) >> 8
    total = np.int64(0)
    for j in range(len(inputs)):
        total += predictor.weights[j] * inputs[j]
    candidates[_FILTER] = _clip(total >> _WEIGHT_BITS, _MAX_STEP >> shift) << shift
    candidates[_LEVEL] = _clip(predictor.line[0] + predictor.line[1], _MAX_STEP)
    candidates[5] = 2 * last - steps[1]
    count = _GUIDED_CANDIDATES if guided else _CANDIDATES
    for k in range(_CANDIDATES, count):
        candidates[k] = guide_steps[k - _CANDIDATES]

    # Their weighted mean.
    best = 0
    for k in range(1, count):
        if errors[k] < errors[best]:
            best = k
    total, weights = np.int64(0), np.int64(0)
    smallest = errors[best] + 4
    for k in range(count):
        # The weight of an error this large is below 2**-12.
        if errors[k] + 4 > 8 * smallest:
            continue
        quotient = (smallest << 10) // (errors[k] + 4)
        square = (quotient * quotient) >> 10
        weight = (square * square) >> 10
        total += weight * _clip(candidates[k] - candidates[best], _MAX_CORRECTION)
        weights += weight
    return candidates[best] + total // weights


@inner_uncounted
def _learn_filter(predictor: Predictor, step: int, scale: int, shift: int) -> None:
    """Move the weights of the filter: w += rate * error * x / (mean of x**2) for each input x."""
    inputs, energies, digits = predictor.inputs, predictor.energies, predictor.digits
    error = _clip(step - predictor.candidates[_FILTER], _MAX_FILTER_ERROR * scale) >> shift
    error = _clip(error, _MAX_INPUT)
    for j in range(len(inputs)):
        # The mean becomes a power of two, so that nothing is divided.
        x = inputs[j]
        energies[j] += (((x * x) << 4) - energies[j]) >> _ENERGY_SHIFT
        while energies[j] >> (digits[j] + 4) > 0:
            digits[j] += 1
        while digits[j] > 3 and energies[j] >> (digits[j] + 3) == 0:
            digits[j] -= 1
        # Error and input are at most 2**26.
        move = (error * x) << 8 >> max(digits[j] - 8 + _FILTER_SHIFT, 0)
        predictor.weights[j] = _clip(predictor.weights[j] + move, _MAX_WEIGHT)


@inner_uncounted
def learn(predictor: Predictor, step: int, scale: int, shift: int, guided: bool) -> None:
    """Learn the step that came, in sixteenths, where the mean error is ``scale``.

    ``guided`` tells whether the guide said anything of it.
    """
    steps, errors, line = predictor.steps, predictor.errors, predictor.line

    # Errors of the candidates, and the filter.
    for k in range(_GUIDED_CANDIDATES if guided else _CANDIDATES):
        error = min(abs(step - predictor.candidates[k]), _MAX_CANDIDATE_ERROR * scale)
        errors[k] += (4 * error - errors[k]) >> _ERROR_SHIFT
    _learn_filter(predictor, step, scale, shift)

    # Level and slope; the level counts from the new value.
    expected = predictor.candidates[_LEVEL]
    error = _clip(step - expected, _MAX_STEP)
    line[0] = expected + (error * _LEVEL_GAIN >> 6) - step
    line[1] = _clip(line[1] + (error * _SLOPE_GAIN >> 8), _MAX_STEP)

    # The step itself.
    for j in range(_LAGS - 1, 0, -1):
        steps[j] = steps[j - 1]
    steps[0] = _clip(step, _MAX_STEP)


@inner_uncounted
def forget(predictor: Predictor) -> None:
    """Forget the last steps after an outlier or a gap, which say nothing of the next one."""
    predictor.steps[:] = 0
    predictor.side_steps[:] = 0
    predictor.line[:] = 0
