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
    TABLE_SIZE,
    Decisions,
    code_decision,
    code_excess,
    log_ratio,
)
from gpszip.lossless.kernels.guided import GUIDE_CLASSES, GuideState, learn_guide, look_up
from gpszip.lossless.kernels.predictions import (
    SUBSTEP_BITS,
    Predictor,
    forget,
    learn,
    predict,
)
from gpszip.lossless.setting import EXACT, FEW, LAST_BIN, Guide, Setting

__all__ = ["WEIGHT_SETS", "bounds_of_bins", "code_column"]

#: Bins of a side, and their bounds: in sixteenths of the mean error, and in units of exact steps.
_BINS = LAST_BIN + 1
_NEAR_BOUNDS = np.array(
    [0, 4, 8, 12, 16, 24, 32, 40, 56, 72, 96, 128, 192, 320, 640, 1280], np.int64
)
_EXACT_BOUNDS = np.array([0] + [1 << i for i in range(_BINS - 1)], np.int64)

#: Decisions within an exact bin that have contexts; below them all numbers are equally likely.
_MAX_HALVES = 8

#: What a decision is about: the side, the first bin asked for, others, halves of a bin.
_SIDE, _FIRST_BIN, _OUTWARDS, _INWARDS, _HALVES = 0, 1, 2, 3, 4

#: Nodes of the tree: the first decision, bins of either side, halves. Each has a set of weights for
#: each of three classes of scales.
_HALF_NODE = 2 * _BINS
_NODES = _HALF_NODE + 1
WEIGHT_SETS = 3 * _NODES * GUIDE_CLASSES

#: Mean errors are in sixteenths of a step, at least 2 and at most 2**46.
_MIN_SCALE = 2
_MAX_SCALE = 1 << 46

#: Classes of errors are half octaves of 1 + 4 * error / mean error: 9 is from 24 on.
_LAST_SIZE = 9
_LARGEST = 23
_SIZES = np.array([0, 2, 3, 4, 4, 5, 5] + [6] * 4 + [7] * 4 + [8] * 8, np.int64)

#: Where the last value lies about the prediction, in quarters of the mean error: up to 9.
_STAYS = 9

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
_LOGISTIC = np.append(_LOGISTIC, _LOGISTIC[-1])
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


def bounds_of_bins(setting: Setting) -> NDArray[np.int64]:
    """Return bounds of bins: in sixteenths of the mean error, or steps from the usual one."""
    return _EXACT_BOUNDS << setting.unit if setting.order == EXACT else _NEAR_BOUNDS


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
    z = min(max(z, 0), 2 * _REACH * 1024)
    j = np.uint32(z >> 4)
    here = np.int64(_LOGISTIC[j])
    slope = np.int64(_LOGISTIC[j + np.uint32(1)]) - here
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
def _near_contexts(
    center: int,
    scale: int,
    last_size: int,
    size_before: int,
    side_class: int,
    time_class: int,
    has_third: bool,
) -> tuple[int, int, int]:
    """Return the part of each context that all decisions of a number share, near a prediction.

    Parameters
    ----------
    center, scale : int
        Predicted step, and mean error, in sixteenths.
    last_size, size_before : int
        Classes of the last two errors, with their signs.
    side_class, time_class : int
        Class of the errors of other columns at this row, and that of the ratio of times.
    """
    # Classes of where the last value lies, of the last errors, and of the mean error.
    phase = (center & 15) >> 2 if scale < (4 << SUBSTEP_BITS) else np.int64(0)
    stay = min(max(_STAYS * scale - 4 * center, 0), 2 * _STAYS * scale)
    stay = np.int64(np.uint64(stay) // np.uint64(scale))
    sizes = (last_size + 10) * 12 + abs(size_before)
    third = min(_half_octaves(scale), 20) * 4 + phase if has_third else np.int64(0)
    return stay * 21 + time_class, sizes * 3 + side_class, third


@inner_uncounted
def _exact_contexts(
    last: int, before: int, side_step: int, time_class: int
) -> tuple[int, int, int]:
    """Return the same of exact steps: last steps and those of another column, near zero.

    Parameters
    ----------
    last, before, side_step : int
        Last step, that before it, and that of another column to this row, in sixteenths.
    """
    last = _clip(last >> SUBSTEP_BITS, 31) + 31
    before = _clip(before >> SUBSTEP_BITS, 31) + 31
    other = _clip(side_step >> SUBSTEP_BITS, 31) + 31
    first = (last * 64 + before + 1) * _SCATTER
    return np.int64(0), first, (other + 64 * time_class + 1) * _SCATTER_HIGH


@inner_uncounted
def _slots(
    base: tuple[int, int, int], setting: Setting, node: int, low: int, high: int
) -> tuple[int, int, int]:
    """Return the cells of a decision: of its node, or of the steps that are still possible."""
    a, b, c = base
    if setting.order == EXACT:
        key = (low - setting.usual) * _SCATTER_LOW + (high - setting.usual) * _SCATTER_HIGH
        key *= _SCATTER
        a, b, c = (a ^ key) >> 40, (b ^ key) >> 40, (c ^ key) >> 40
    else:
        a, b, c = a * 32 + node, b * 32 + node, c * 32 + node
    return a & (TABLE_SIZE - 1), b & (TABLE_SIZE - 1), c & (TABLE_SIZE - 1)


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
def _code_step(
    coder: Coder,
    decisions: Decisions,
    base: tuple[int, int, int],
    setting: Setting,
    bounds: NDArray[np.int64],
    center: int,
    scale: int,
    step: int,
    guide_class: int,
    guide_step: int,
    guide_scale: int,
) -> tuple[int, bool]:
    """Code a step; return it, and whether it lies beyond all bins.

    ``low`` and ``high`` bound the steps that are still possible. A decision whose threshold lies
    outside is not coded. The bounds of bins are at ``(origin +- (unit * bound >> 4)) >> digits``.
    """
    # The distribution divides distances by its scale.
    digits = _spare_digits(scale)
    inverse = _inverse_scale(scale, digits)
    mass_low, mass_high = np.int64(0), np.int64(_ALL)
    first_set = (0 if scale >= 16 else (1 if scale >= 4 else 2)) * _NODES
    middle = center + (1 << (SUBSTEP_BITS - 1))

    # So does that of the guide.
    guided = guide_class > 0
    guide_middle = guide_step + (1 << (SUBSTEP_BITS - 1))
    guide_digits = _spare_digits(guide_scale)
    guide_inverse = _inverse_scale(guide_scale, guide_digits)
    guide_low, guide_high, guide_mass = np.int64(0), np.int64(_ALL), np.int64(0)
    guide_ratio, guide_slot = np.int64(0), np.int64(0)
    first_set += 3 * _NODES * guide_class

    # The sides' border, which is the lower bound of the upper side's bin 0.
    is_exact = setting.order == EXACT
    unit = np.int64(16) if is_exact else scale
    shift = np.int64(0) if is_exact else np.int64(SUBSTEP_BITS)
    origin = setting.usual if is_exact else center + ((1 << SUBSTEP_BITS) - 1)
    threshold = origin >> shift

    # First the side, then bins outwards or inwards from the first one, then halves of a bin.
    low, high = np.int64(-_UNBOUNDED), np.int64(_UNBOUNDED)
    phase, node, side, bin = _SIDE, np.int64(0), np.int64(0), setting.first_bin
    halves_left = np.int64(_MAX_HALVES) if is_exact else np.int64(0)
    while True:
        # Decide, where that is not certain.
        if low < threshold < high:
            fine = threshold << SUBSTEP_BITS
            distance = _clip((fine - middle) >> digits, _MAX_DISTANCE)
            mass = _mass_below(((distance * inverse) >> 18) + _REACH * 1024)
            if guided:
                distance = _clip((fine - guide_middle) >> guide_digits, _MAX_DISTANCE)
                z = (distance * guide_inverse) >> 18
                guide_mass = _mass_below(z + _REACH * 1024)
                guide_ratio = log_ratio(guide_high - guide_mass, guide_mass - guide_low)
                relative = _clip((z * 3) >> 11, _GUIDE_REACH) + _GUIDE_REACH
                guide_slot = (relative * GUIDE_CLASSES + guide_class) * 64 + node
                guide_slot &= TABLE_SIZE - 1
            bit = code_decision(
                coder,
                decisions,
                first_set + node,
                1 if step >= threshold else 0,
                setting.contexts > FEW,
                guided,
                log_ratio(mass_high - mass, mass - mass_low),
                _slots(base, setting, node, low, high),
                guide_ratio,
                guide_slot,
            )
            if bit:
                low, mass_low, guide_low = threshold, mass, guide_mass
            else:
                high, mass_high, guide_high = threshold, mass, guide_mass
        else:
            bit = np.int64(1) if threshold <= low else np.int64(0)

        # The next bin, or whether the last one is found.
        if phase == _SIDE:
            phase, side = _FIRST_BIN, bit
            origin += np.int64(0) if is_exact or side else np.int64(1)
        elif phase != _HALVES:
            if bit == side:
                if bin == LAST_BIN:
                    excess = code_excess(coder, decisions, step - low if side else high - 1 - step)
                    return (low + excess if side else high - 1 - excess), True
                is_found = phase == _INWARDS
                phase, bin = _OUTWARDS, bin + 1
            else:
                is_found = phase == _OUTWARDS or bin == 1
                phase, bin = _INWARDS, bin - 1
            phase = _HALVES if is_found else phase

        # The next threshold.
        if phase == _HALVES:
            if halves_left == 0 or high - low <= 1:
                return _code_rest(coder, step, low, high), False
            halves_left -= 1
            threshold = (low + high) >> 1
            node = np.int64(_HALF_NODE)
        else:
            bound = (unit * bounds[np.uint32(bin)]) >> 4
            threshold = (origin + (bound if side else -bound)) >> shift
            node = side * _BINS + bin


@inner_uncounted
def _moved(scale: int, error: int, shift: int) -> int:
    """Return a mean error that moves towards an error, by at least one sixteenth."""
    difference = error - scale
    move = difference >> shift
    if abs(difference) <= 1 << shift:
        move = np.int64(1) if difference > 0 else np.int64(-1)
    return min(max(scale + move, _MIN_SCALE), _MAX_SCALE)


@inner_uncounted
def _time_ratio(elapsed: int, last: int) -> int:
    """Time since the last row by the one before, in units of 1/256, from 1/8 to 8."""
    if last <= 0 or elapsed <= 0 or elapsed == last:
        return np.int64(256)
    elapsed = min(elapsed, np.int64(1) << 40)
    return min(max(np.int64(np.uint64(elapsed << 8) // np.uint64(last)), 32), 2048)


@inner_uncounted
def _size(error: int, scale: int) -> int:
    """Class of an error: half octaves of its quotient by the mean error, up to 9."""
    quarters = 4 * min(error, _MAX_PREDICTION)
    if quarters >= _LARGEST * scale:
        return np.int64(_LAST_SIZE)
    return _SIZES[np.uint64(quarters) // np.uint64(scale)]


@jit_uncounted
def code_column(
    coder: Coder,
    decisions: Decisions,
    predictor: Predictor,
    setting: Setting,
    bounds: NDArray[np.int64],
    values: NDArray[np.int64],
    times: NDArray[np.int64],
    side_classes: NDArray[np.uint8],
    sizes: NDArray[np.uint8],
    guide: Guide,
    guide_state: GuideState,
    state: NDArray[np.int64],
    first: int,
    end: int,
) -> bool:
    """Code some numbers of a column; return whether a decoder had enough bytes.

    Parameters
    ----------
    bounds : int64 array, shape (16,)
        Bounds of bins, from :func:`bounds_of_bins`.
    values : int64 array, shape (n,)
        The column, between -2**57 and 2**57; a decoder fills in all but the first.
    times : int64 array, shape (n,) or (0,)
        The column of times, if there is one.
    side_classes, sizes : uint8 array, shape (n,)
        Class of the errors of the other columns, 0 to 2, and of this one, which is filled in.
    guide, guide_state : Guide and GuideState
        What a walk says of the column, empty if nothing.
    state : int64 array, shape (5,)
        Fast and slow mean error, classes of the last two errors, and the last elapsed time: first
        the setting's scale twice, and zeros.
    first, end : int
        First row, at least 1, and that after the last. Rows before have been coded.
    """
    is_exact, has_times = setting.order == EXACT, len(times) > 0
    shift, has_side = setting.shift, len(predictor.side_steps) > 0
    has_third = setting.contexts > FEW
    fast, slow, last_size, size_before, last_elapsed = (
        state[0],
        state[1],
        state[2],
        state[3],
        state[4],
    )
    elapsed, ratio, time_class = np.int64(0), np.int64(256), np.int64(0)
    value = values[np.uint64(first - 1)]
    for i in range(first, end):
        # What is known before the number.
        row = np.uint64(i)
        if has_times:
            elapsed = times[row] - times[row - np.uint64(1)]
            ratio = _time_ratio(elapsed, last_elapsed)
            time_class = _half_octaves(ratio)
        guide_class, guide_step, guide_scale = look_up(guide, guide_state, values, i)
        guided = guide_class > 0
        center = predict(predictor, i, ratio, shift, guide_state.steps, guided)
        center = _clip(center, _MAX_PREDICTION)

        # The number.
        scale = (fast + 2 * slow) // 3
        if is_exact:
            last = predictor.steps[row + np.uint64(6)]
            before = predictor.steps[row + np.uint64(5)]
            side_step = predictor.side_steps[0, row + np.uint64(3)] if has_side else np.int64(0)
            base = _exact_contexts(last, before, side_step, time_class)
        else:
            side_class = np.int64(side_classes[row])
            base = _near_contexts(
                center, scale, last_size, size_before, side_class, time_class, has_third
            )
        scale = max(scale, 3)
        step, is_outlier = _code_step(
            coder,
            decisions,
            base,
            setting,
            bounds,
            center,
            scale,
            values[row] - value,
            guide_class,
            guide_step,
            guide_scale,
        )
        value += step
        values[row] = value
        if is_exhausted(coder):
            return False

        # Learn its error.
        fine_step = step << SUBSTEP_BITS
        if guided:
            learn_guide(guide_state, guide_class, fine_step - guide_step, guide_scale)
        signed_error = fine_step - center
        error = abs(signed_error)
        size = _size(error, scale)
        sizes[row] = size
        last_size, size_before = size if signed_error >= 0 else -size, last_size
        if is_outlier:
            error = min(error, _OUTLIER * scale)
            fast = _moved(fast, error, _FAST_OUTLIER_SHIFT)
            slow = _moved(slow, error, _SLOW_OUTLIER_SHIFT)
            forget(predictor, i)
            continue
        fast, slow = _moved(fast, error, _FAST_SHIFT), _moved(slow, error, _SLOW_SHIFT)
        learn(predictor, i, fine_step, scale, shift, guided)
        last_elapsed = max(elapsed, 1)
    state[0], state[1], state[4] = fast, slow, last_elapsed
    state[2], state[3] = last_size, size_before
    return True
