"""Coding of a column of integers, each from those before it and from other columns.

A number is found by bisection: each decision asks whether the step from the last number is at least
a threshold. Two orders of thresholds suit different columns:

- *near the prediction*: the sides of the prediction, then 16 bins on that side, whose bounds are
  multiples of the mean error;
- *exact*: the sides of a usual step, 16 bins whose bounds are powers of two, then halves of a bin.
  Steps that come back have decisions of their own.

The probability of a decision comes from a logistic distribution about the prediction, whose scale
is the mean error, and from decisions in the same contexts before. Where a walk on the map says
something of the number, a second distribution lies about that, with contexts of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.range_coder import (
    Coder,
    code_bits,
    code_interval,
    decode_cumulative,
    is_decoding,
    is_exhausted,
)
from gpszip.kernels.jit import inner_uncounted, jit_uncounted
from gpszip.lossless.kernels.decisions import (
    CONTEXTS,
    GUIDE_INPUT,
    TABLE_SIZE,
    Decisions,
    code_decision,
    code_excess,
    log_ratio,
)
from gpszip.lossless.kernels.guided import (
    CLASS,
    GUIDE_CLASSES,
    SCALE,
    STEP,
    GuideState,
    learn_guide,
    look_up,
)
from gpszip.lossless.kernels.predictions import (
    SUBSTEP_BITS,
    Predictor,
    forget,
    learn,
    predict,
    set_inputs,
)
from gpszip.lossless.setting import EXACT, LAST_BIN, NEAR, Guide, Setting

__all__ = ["WEIGHT_SETS", "code_column"]

#: Bins of a side, and their bounds: in sixteenths of the mean error, and in units of exact steps.
_BINS = LAST_BIN + 1
_NEAR_BOUNDS = np.array(
    [0, 4, 8, 12, 16, 24, 32, 40, 56, 72, 96, 128, 192, 320, 640, 1280], np.int64
)
_EXACT_BOUNDS = np.array([0] + [1 << i for i in range(_BINS - 1)], np.int64)

#: Decisions within an exact bin that have contexts; below them all numbers are equally likely.
_MAX_HALVES = 8

#: Nodes of the tree: the first decision, bins of either side, halves. Each has a set of weights for
#: each of three classes of scales.
_HALF_NODE = 2 * _BINS
_NODES = _HALF_NODE + 1
WEIGHT_SETS = 3 * _NODES * GUIDE_CLASSES

#: Mean errors are in sixteenths of a step, at least 2 and at most 2**46.
_MIN_SCALE = 2
_MAX_SCALE = 1 << 46

#: Rates of the fast and the slow mean error, 1/8 and 1/32.
_FAST_SHIFT = 3
_SLOW_SHIFT = 5

#: An outlier counts as an error of 20 mean errors, and moves the means more slowly.
_OUTLIER = 20
_FAST_OUTLIER_SHIFT = 4
_SLOW_OUTLIER_SHIFT = 6

#: A prediction is at most 2**57 sixteenths, a step without bounds 2**60.
_MAX_PREDICTION = 1 << 57
_UNBOUNDED = 1 << 60

#: The logistic distribution from -16 to 16 in steps of 1/64; interpolated at steps of 1/1024. A
#: distribution with mean absolute error e has the scale e / 1.386. No entry lies near a half
#: before it is rounded.
_REACH = 16
_LOGISTIC = np.round(65536 / (1 + np.exp(-np.arange(-_REACH * 64, _REACH * 64 + 1) / 64)))
_LOGISTIC = _LOGISTIC.astype(np.int32)
_LOGISTIC[0] = 0
_LOGISTIC[-1] = 65536
_ALL = 65536
_SCALED = 1420  # 1024 * 1.386

#: Places of a threshold about what a guide says have contexts up to 15 * 0.48 of its scales.
_GUIDE_REACH = 15

#: Digits of a scale that matter for z, and the largest distance that is divided by it.
_SCALE_DIGITS = 16
_MAX_DISTANCE = 1 << 24

#: Odd factors that scatter contexts over their table (golden ratio and others, any would do).
_SCATTER = np.int64(0x5851F42D4C957F2D)
_SCATTER_LOW = np.int64(0x9E3779B1)
_SCATTER_HIGH = np.int64(0x2545F4914F6CDD1D)


#: Logarithms of 0 to 255 to base two, rounded down.
_DIGITS = np.array([max(value.bit_length() - 1, 0) for value in range(256)], np.int64)


@inner_uncounted
def _half_octaves(value: int) -> int:
    """Return twice the logarithm of ``value`` >= 1 to base two, rounded down to 0, 1, 2, ..."""
    digits, rest = np.int64(0), value
    while rest >= 256:
        rest >>= 8
        digits += 8
    digits += _DIGITS[np.uint32(rest)]
    half = ((value << 1) >> digits) & 1 if digits > 0 else 0
    return 2 * digits + half


@inner_uncounted
def _clip(value: int, limit: int) -> int:
    """Clip a number to [-limit, limit]."""
    return min(max(value, -limit), limit)


@inner_uncounted
def _mass_below(z: int) -> int:
    """Mass of a logistic distribution, of 65,536, below z 1024ths of its scale past -16 scales."""
    if z <= 0:
        return np.int64(0)
    if z >= 2 * _REACH * 1024:
        return np.int64(_ALL)
    j = z >> 4
    here = np.int64(_LOGISTIC[np.uint32(j)])
    slope = np.int64(_LOGISTIC[np.uint32(j + 1)]) - here
    return here + ((slope * (z & 15)) >> 4)


@inner_uncounted
def _spare_digits(scale: int) -> int:
    """Binary digits of a scale beyond those that matter."""
    digits = 0
    while scale >> digits >= np.int64(1) << _SCALE_DIGITS:
        digits += 1
    return digits


@inner_uncounted
def _inverse_scale(scale: int, digits: int) -> int:
    """2**28 * 1420 / scale, of a scale without its last digits."""
    return (np.int64(_SCALED) << 18) // max(scale >> digits, 1)


@inner_uncounted
def _set_contexts(
    base: NDArray[np.int64],
    setting: Setting,
    predictor: Predictor,
    center: int,
    scales: NDArray[np.int64],
    signed_sizes: NDArray[np.int64],
    side_size: int,
    side_step: int,
    time_class: int,
) -> None:
    """Enter the part of each context that all decisions of a number share.

    Parameters
    ----------
    base : int64 array, shape (3,)
        Filled in.
    center : int
        Predicted step, in sixteenths.
    scales : int64 array, shape (2,)
        Fast and slow mean error.
    signed_sizes : int64 array, shape (2,)
        Classes of the last two errors, with their signs.
    side_size, side_step : int
        Class of the error, and the step, that the other columns have at this row.
    time_class : int
        Class of the ratio of times.
    """
    # Last steps and those of another column, where they are near zero.
    if setting.order == EXACT:
        last = _clip(predictor.steps[0] >> SUBSTEP_BITS, 31) + 31
        before = _clip(predictor.steps[1] >> SUBSTEP_BITS, 31) + 31
        other = _clip(side_step, 31) + 31
        base[0] = 0
        base[1] = (last * 64 + before + 1) * _SCATTER
        base[2] = (other + 64 * time_class + 1) * _SCATTER_HIGH
        return

    # Classes of the mean error, of where the last value lies, and of the last errors.
    scale = (scales[0] + 2 * scales[1]) // 3
    phase = (center & 15) >> 2 if scale < (4 << SUBSTEP_BITS) else np.int64(0)
    stay = _clip(-4 * center // scale, 9) + 9
    base[0] = min(_half_octaves(scale), 20) * 4 + phase
    base[1] = stay * 21 + time_class
    base[2] = ((signed_sizes[0] + 10) * 12 + abs(signed_sizes[1])) * 3 + min(side_size // 3, 2)


@inner_uncounted
def _set_slots(
    decisions: Decisions,
    base: NDArray[np.int64],
    setting: Setting,
    node: int,
    low: int,
    high: int,
) -> None:
    """Enter the cells of a decision: of its node, or of the steps that are still possible."""
    if setting.order == EXACT:
        key = (low - setting.usual) * _SCATTER_LOW + (high - setting.usual) * _SCATTER_HIGH
        for k in range(CONTEXTS):
            decisions.slots[k] = ((base[k] ^ key * _SCATTER) >> 40) & (TABLE_SIZE - 1)
        return
    for k in range(CONTEXTS):
        decisions.slots[k] = (base[k] * 32 + node) & (TABLE_SIZE - 1)


@inner_uncounted
def _code_rest(coder: Coder, value: int, low: int, high: int) -> int:
    """Code an integer in [low, high), all equally likely."""
    width = high - low
    if width <= 1:
        return low
    # The coder takes totals up to 2**32; wider intervals have lower digits apart.
    digits = 0
    while (width - 1) >> digits >= np.int64(1) << 32:
        digits += 16
    total = ((width - 1) >> digits) + 1
    offset = value - low
    part = offset >> digits
    if is_decoding(coder):
        part = decode_cumulative(coder, total)
    code_interval(coder, part, 1, total)
    while digits > 0:
        digits -= 16
        part = (part << 16) | code_bits(coder, (offset >> digits) & 65535, 16)
    return low + part


@inner_uncounted
def _threshold(setting: Setting, center: int, scale: int, side: int, bin: int) -> int:
    """Step at which a bin of a side begins, counted outwards; of bin 0, the sides' border."""
    if setting.order == EXACT:
        bound = _EXACT_BOUNDS[bin] << setting.unit
        return setting.usual + bound if side else setting.usual - bound
    bound = (scale * _NEAR_BOUNDS[bin]) >> 4
    half = (1 << SUBSTEP_BITS) - 1
    if side:
        return (center + bound + half) >> SUBSTEP_BITS
    return 1 - ((bound - center + half) >> SUBSTEP_BITS)


@inner_uncounted
def _code_step(
    coder: Coder,
    decisions: Decisions,
    base: NDArray[np.int64],
    setting: Setting,
    center: int,
    scales: NDArray[np.int64],
    step: int,
    guide_place: NDArray[np.int64],
) -> tuple[int, bool]:
    """Code a step; return it, and whether it lies beyond all bins.

    ``low`` and ``high`` bound the steps that are still possible. A decision whose threshold lies
    outside is not coded.
    """
    scale = max((scales[0] + 2 * scales[1]) // 3, 3)
    class_of_scale = 0 if scale >= 16 else (1 if scale >= 4 else 2)

    # The distribution divides distances by its scale.
    digits = _spare_digits(scale)
    inverse = _inverse_scale(scale, digits)
    mass_low, mass_high = np.int64(0), np.int64(_ALL)

    # So does that of the guide.
    guide_class, guide_center, guide_scale = (
        guide_place[CLASS],
        guide_place[STEP],
        guide_place[SCALE],
    )
    guided = guide_class > 0
    guide_digits = _spare_digits(guide_scale)
    guide_inverse = _inverse_scale(guide_scale, guide_digits)
    guide_low, guide_high, guide_mass = np.int64(0), np.int64(_ALL), np.int64(0)

    # First the side, then bins outwards or inwards from the first one, then halves of a bin.
    low, high = np.int64(-_UNBOUNDED), np.int64(_UNBOUNDED)
    first_bin, last_bin = 0, _BINS
    side, node, halves = -1, 0, 0
    while True:
        middle = first_bin + 1 if first_bin > 0 else last_bin - 1
        if last_bin - first_bin == _BINS:
            middle = setting.first_bin
        if side < 0:
            threshold = _threshold(setting, center, scale, 1, 0)
        elif last_bin - first_bin > 1:
            threshold = _threshold(setting, center, scale, side, middle)
            node = side * _BINS + middle
        else:
            threshold = (low + high) >> 1
            node = _HALF_NODE

        # Decide, where that is not certain.
        if low < threshold < high:
            distance = (threshold << SUBSTEP_BITS) - (1 << (SUBSTEP_BITS - 1)) - center
            distance = _clip(distance >> digits, _MAX_DISTANCE)
            mass = _mass_below(((distance * inverse) >> 18) + _REACH * 1024)
            decisions.inputs[0] = log_ratio(mass_high - mass, mass - mass_low)
            _set_slots(decisions, base, setting, node, low, high)
            weight_set = class_of_scale * _NODES + node
            if guided:
                distance = (threshold << SUBSTEP_BITS) - (1 << (SUBSTEP_BITS - 1)) - guide_center
                distance = _clip(distance >> guide_digits, _MAX_DISTANCE)
                z = (distance * guide_inverse) >> 18
                guide_mass = _mass_below(z + _REACH * 1024)
                ratio = log_ratio(guide_high - guide_mass, guide_mass - guide_low)
                decisions.inputs[GUIDE_INPUT] = ratio
                relative = _clip((z * 3) >> 11, _GUIDE_REACH) + _GUIDE_REACH
                slot = (relative * GUIDE_CLASSES + guide_class) * 64 + node
                decisions.slots[CONTEXTS] = slot & (TABLE_SIZE - 1)
                weight_set += 3 * _NODES * guide_class
            bit = code_decision(coder, decisions, weight_set, 1 if step >= threshold else 0, guided)
            if bit:
                low, mass_low, guide_low = threshold, mass, guide_mass
            else:
                high, mass_high, guide_high = threshold, mass, guide_mass
        else:
            bit = 1 if threshold <= low else 0

        # The next decision.
        if side < 0:
            side = bit
        elif last_bin - first_bin > 1:
            if bit == side:
                first_bin = middle
            else:
                last_bin = middle
        else:
            halves += 1
        if side >= 0 and last_bin - first_bin == 1:
            is_outside = first_bin == _BINS - 1
            if is_outside or setting.order == NEAR or high - low <= 1 or halves == _MAX_HALVES:
                break

    # What no decision tells.
    if first_bin == _BINS - 1:
        excess = code_excess(coder, decisions, step - low if side else high - 1 - step)
        return (low + excess if side else high - 1 - excess), True
    return _code_rest(coder, step, low, high), False


@inner_uncounted
def _move_scale(scales: NDArray[np.int64], k: int, error: int, shift: int) -> None:
    """Move a mean error towards an error, by at least one sixteenth."""
    difference = error - scales[k]
    move = difference >> shift
    if abs(difference) <= 1 << shift:
        move = np.int64(1) if difference > 0 else np.int64(-1)
    scales[k] = min(max(scales[k] + move, _MIN_SCALE), _MAX_SCALE)


@inner_uncounted
def _time_ratio(times: NDArray[np.int64], i: int, last: int) -> int:
    """Time since the last row by the one before, in units of 1/256, from 1/8 to 8."""
    elapsed = times[i] - times[i - 1]
    if last <= 0 or elapsed <= 0:
        return np.int64(256)
    elapsed = min(elapsed, np.int64(1) << 40)
    return min(max((elapsed << 8) // last, 32), 2048)


@jit_uncounted
def code_column(
    coder: Coder,
    decisions: Decisions,
    predictor: Predictor,
    setting: Setting,
    values: NDArray[np.int64],
    times: NDArray[np.int64],
    sides: NDArray[np.int64],
    side_shifts: NDArray[np.int64],
    side_sizes: NDArray[np.uint8],
    sizes: NDArray[np.uint8],
    scratch: NDArray[np.int64],
    guide: Guide,
    guide_state: GuideState,
) -> bool:
    """Code all numbers of a column but the first; return whether a decoder had enough bytes.

    Parameters
    ----------
    values : int64 array, shape (n,)
        The column, between -2**57 and 2**57; a decoder fills in all but the first.
    times : int64 array, shape (n,) or (0,)
        The column of times, if there is one.
    sides : int64 array, shape (k, n)
        Other columns, which both sides know.
    side_shifts : int64 array, shape (k,)
        Shifts of these columns.
    side_sizes, sizes : uint8 array, shape (k, n) and (n,)
        Classes of the errors of the other columns, and of this one, which is filled in.
    scratch : int64 array, shape (10,)
        Workspace.
    guide, guide_state : Guide and GuideState
        What a walk says of the column, empty if nothing.
    """
    base, scales, signed_sizes = scratch[:CONTEXTS], scratch[6:8], scratch[8:10]
    scales[:] = setting.scale
    last_elapsed = np.int64(0)
    for i in range(1, len(values)):
        # What is known before the number.
        ratio = _time_ratio(times, i, last_elapsed) if len(times) > 0 else np.int64(256)
        time_class = _half_octaves(ratio) if len(times) > 0 else 0
        guided = look_up(guide, guide_state, values, i) > 0
        set_inputs(predictor, sides, i, setting.shift, side_shifts, guide_state.steps)
        center = predict(predictor, ratio, setting.shift, guide_state.steps, guided)
        center = _clip(center, _MAX_PREDICTION)
        side_size, side_step = 0, np.int64(0)
        for k in range(len(sides)):
            side_size = max(side_size, np.int64(side_sizes[k, i]))
        if len(sides) > 0:
            side_step = sides[0, i] - sides[0, i - 1]

        # The number.
        _set_contexts(
            base, setting, predictor, center, scales, signed_sizes, side_size, side_step, time_class
        )
        step = values[i] - values[i - 1]
        step, is_outlier = _code_step(
            coder, decisions, base, setting, center, scales, step, guide_state.place
        )
        values[i] = values[i - 1] + step
        if is_exhausted(coder):
            return False

        # Learn its error.
        fine_step = step << SUBSTEP_BITS
        if guided:
            learn_guide(guide_state, fine_step)
        error = fine_step - center
        scale = max((scales[0] + 2 * scales[1]) // 3, 3)
        size = min(_half_octaves(min(abs(error), _MAX_PREDICTION) * 4 // scale + 1), 9)
        sizes[i] = size
        signed_sizes[1] = signed_sizes[0]
        signed_sizes[0] = size if error >= 0 else -size
        if is_outlier:
            limited = min(abs(error), _OUTLIER * scale)
            _move_scale(scales, 0, limited, _FAST_OUTLIER_SHIFT)
            _move_scale(scales, 1, limited, _SLOW_OUTLIER_SHIFT)
            forget(predictor)
            continue
        _move_scale(scales, 0, abs(error), _FAST_SHIFT)
        _move_scale(scales, 1, abs(error), _SLOW_SHIFT)
        learn(predictor, fine_step, scale, setting.shift, guided)
        if len(times) > 0:
            last_elapsed = max(times[i] - times[i - 1], 1)
    return True
