"""Adaptive models over the range coder: bits, integers of any size, weighted choices and mixtures of distributions.

All arithmetic is on integers, so that every machine codes and decodes the same bytes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.log2 import fixed_log2
from gpszip.codec.kernels.range_coder import Coder, code_bits, code_interval, decode_cumulative
from gpszip.kernels.jit import jit

__all__ = [
    "BY_RATIO",
    "CENTERS",
    "HISTOGRAM",
    "INTEGER_CONTEXTS",
    "KINDS",
    "MIXTURE_ROWS",
    "ONE_SIDED",
    "SCALES",
    "SUBSTEPS",
    "TWO_SIDED",
    "WEIGHT_SUM",
    "code_bit",
    "code_choice",
    "code_mixture",
    "code_signed",
    "code_unsigned",
]

#: Fixed-point denominators: centres and scales of a distribution, weights of a mixture, probabilities.
SUBSTEPS = 16
WEIGHT_SUM = 1 << 16
_UNIT = 24
_WHOLE = 1 << _UNIT

#: How far weights move towards their posterior, of 65,536: at the first number, in the end, and how soon that falls.
_FIRST_STEP, _LAST_STEP, _SETTLING = 40_000, 6_500, 16

#: Kinds of distributions in a mixture.
TWO_SIDED, ONE_SIDED, HISTOGRAM, BY_RATIO = np.arange(4)

#: Rows of a sheet of distributions: kinds, centres and scales, and what is worked out from them.
KINDS, CENTERS, SCALES, _BASES, _CHANCES = np.arange(5)
MIXTURE_ROWS = 5

#: Bit contexts that one integer of any size takes.
INTEGER_CONTEXTS = 48 + 8 * 48

_REACH = 16
_STEPS = 64
_Z = np.arange(-_REACH * _STEPS, _REACH * _STEPS + 1) / _STEPS
_LOGISTIC = np.round(_WHOLE / (1.0 + np.exp(-_Z))).astype(np.int64)
_LOGISTIC[0], _LOGISTIC[-1] = 0, _WHOLE
_EXPONENTIAL = np.round(_WHOLE * -np.expm1(-np.arange(_REACH * _STEPS + 1) / _STEPS)).astype(
    np.int64
)
_EXPONENTIAL[-1] = _WHOLE


@jit
def code_bit(coder: Coder, counts: NDArray[np.int32], context: int, bit: int) -> int:
    """Code a bit with the counts of its context, shape (contexts, 2), and learn it."""
    zeros, ones = np.int64(counts[context, 0]), np.int64(counts[context, 1])
    total = zeros + ones
    if coder.cursor[1] == 1:
        bit = 1 if decode_cumulative(coder, total) >= zeros else 0
    if bit:
        code_interval(coder, zeros, ones, total)
    else:
        code_interval(coder, 0, zeros, total)
    counts[context, bit] += 20
    if total > 2000:
        counts[context, 0] = max(counts[context, 0] // 2, 1)
        counts[context, 1] = max(counts[context, 1] // 2, 1)
    return bit


@jit
def code_unsigned(coder: Coder, counts: NDArray[np.int32], context: int, value: int) -> int:
    """Code an integer >= 0 by Exp-Golomb bins; it takes ``SIZES`` contexts from ``context`` on."""
    writing = coder.cursor[1] != 1
    exponent = 0
    while exponent < 47:
        more = 1 if writing and (value + 1) >> (exponent + 1) > 0 else 0
        if code_bit(coder, counts, context + exponent, more) == 0:
            break
        exponent += 1
    rest = value + 1 - (np.int64(1) << exponent) if writing else np.int64(0)
    node = 1
    coded = np.int64(0)
    for shift in range(exponent - 1, -1, -1):
        bit = (rest >> shift) & 1 if writing else np.int64(0)
        if node < 8:
            bit = code_bit(coder, counts, context + 48 + 8 * exponent + node, bit)
            node = 2 * node + bit
        else:
            bit = code_bits(coder, bit, 1)
        coded = 2 * coded + bit
    return (np.int64(1) << exponent) + coded - 1


@jit
def code_signed(coder: Coder, counts: NDArray[np.int32], context: int, value: int) -> int:
    """Code an integer of either sign; it takes ``SIZES`` contexts from ``context`` on."""
    folded = 2 * value if value >= 0 else -2 * value - 1
    folded = code_unsigned(coder, counts, context, folded)
    return folded // 2 if folded % 2 == 0 else -(folded + 1) // 2


@jit
def code_choice(coder: Coder, weights: NDArray[np.int64], count: int, choice: int) -> int:
    """Code which of ``count`` weighted things it is; weights are at least 1, their sum at most 2**41."""
    total = np.int64(0)
    for i in range(count):
        total += weights[i]
    if coder.cursor[1] == 1:
        at = decode_cumulative(coder, total)
        choice = 0
        while choice < count - 1 and at >= weights[choice]:
            at -= weights[choice]
            choice += 1
    start = np.int64(0)
    for i in range(choice):
        start += weights[i]
    code_interval(coder, start, weights[choice], total)
    return choice


@jit
def _log_below(value: int) -> int:
    """Logarithm of ``value`` - 1/2, in units of 2**-16; of no meaning below 1."""
    return fixed_log2(max(value * SUBSTEPS - SUBSTEPS // 2, np.int64(1))) - 4 * WEIGHT_SUM


@jit
def _below(value: int, log: int, low: int, sheet: NDArray[np.int64], i: int) -> int:
    """Probability, in units of 2**-24, that a distribution puts below ``value`` - 1/2, whose logarithm is ``log``."""
    kind, center, scale = sheet[KINDS, i], sheet[CENTERS, i], sheet[SCALES, i]
    if kind == ONE_SIDED:
        z = ((value - low) * SUBSTEPS << 16) // scale
        if z >= (_REACH << 16):
            return np.int64(_WHOLE)
        at = z >> 10
        return _EXPONENTIAL[at] + ((_EXPONENTIAL[at + 1] - _EXPONENTIAL[at]) * (z & 1023) >> 10)
    if kind == BY_RATIO:
        z = ((log - center) * scale >> 1) + (_REACH << 16)
    else:
        z = ((value * SUBSTEPS - SUBSTEPS // 2 - center) << 16) // scale + (_REACH << 16)
    if z < 0:
        return np.int64(0)
    if z >= (2 * _REACH << 16):
        return np.int64(_WHOLE)
    at = z >> 10
    return _LOGISTIC[at] + ((_LOGISTIC[at + 1] - _LOGISTIC[at]) * (z & 1023) >> 10)


@jit
def _share(
    value: int, log: int, low: int, sheet: NDArray[np.int64], i: int, histogram: NDArray[np.int64]
) -> int:
    """What a distribution puts below ``value``, of what it puts above the lowest one."""
    if sheet[KINDS, i] == HISTOGRAM:
        fewer, total = np.int64(0), np.int64(0)
        for j in range(len(histogram)):
            fewer += histogram[j] if j < value - low else np.int64(0)
            total += histogram[j]
        return (fewer << _UNIT) // total
    below, base = _below(value, log, low, sheet, i), sheet[_BASES, i]
    if base == 0:
        return below
    return ((below - base) << _UNIT) // (_WHOLE - base)


@jit
def _find(
    at: int,
    low: int,
    high: int,
    sheet: NDArray[np.int64],
    count: int,
    weights: NDArray[np.int64],
    histogram: NDArray[np.int64],
) -> int:
    """Find the largest value that what the mixture puts below is at most ``at``: near zero first, where most lie."""
    first, last = low, high
    middle, step = min(max(low + 8, np.int64(0)), (low + high) >> 1), np.int64(8)
    galloping = True
    while last - first > 1:
        start, log = middle - low, _log_below(middle)
        for i in range(count):
            start += weights[i] * _share(middle, log, low, sheet, i, histogram)
        if start <= at:
            first = middle
            galloping = galloping and last == high
            middle += step
        else:
            last = middle
            galloping = galloping and first == low
            middle -= step
        if not galloping or middle <= first or middle >= last:
            galloping = False
            middle = (first + last) >> 1
        step *= 4
    return first


@jit
def code_mixture(
    coder: Coder,
    value: int,
    low: int,
    high: int,
    sheet: NDArray[np.int64],
    count: int,
    weights: NDArray[np.int64],
    histogram: NDArray[np.int64],
) -> int:
    """Code an integer in [low, high) with a mixture of ``count`` distributions, and learn.

    Parameters
    ----------
    sheet : int64 array, shape (SHEET_ROWS, >= count)
        Rows ``KINDS``, ``CENTERS`` and ``SCALES`` hold shape, centre and scale of each distribution, the last two in sixteenths. A
        two-sided one is logistic, a one-sided one falls exponentially from ``low``, a histogram counts the values that came. One by
        ratio is logistic in the logarithm of the value, which must be positive: its centre is a logarithm to the base of two in units
        of 2**-16, its scale how steep it is, in halves for an octave. Further rows are scratch.
    weights : int64 array
        Weights of the distributions, changed in place; their sum is about ``WEIGHT``. The last element counts the numbers
        coded: at first the weights follow each number closely, later they settle.
    histogram : int64 array
        Counts of ``low``, ``low`` + 1, ..., changed in place; used where a kind asks for it.
    """
    sum_weights, log = np.int64(0), _log_below(low)
    for i in range(count):
        sum_weights += weights[i]
        symmetric = sheet[KINDS, i] == TWO_SIDED or sheet[KINDS, i] == BY_RATIO
        sheet[_BASES, i] = (
            min(_below(low, log, low, sheet, i), np.int64(_WHOLE - 64))
            if symmetric
            else np.int64(0)
        )
    total = (sum_weights << _UNIT) + (high - low)
    if coder.cursor[1] == 1:
        value = _find(decode_cumulative(coder, total), low, high, sheet, count, weights, histogram)
    start, width = np.int64(value - low), np.int64(1)
    log, log_after = _log_below(value), _log_below(value + 1)
    for i in range(count):
        a = _share(value, log, low, sheet, i, histogram)
        b = (
            np.int64(_WHOLE)
            if value + 1 == high
            else _share(value + 1, log_after, low, sheet, i, histogram)
        )
        sheet[_CHANCES, i] = weights[i] * (b - a)
        start += weights[i] * a
        width += sheet[_CHANCES, i]
    code_interval(coder, start, width, total)
    used = len(weights) - 1
    step = max(np.int64(_LAST_STEP), _FIRST_STEP * _SETTLING // (_SETTLING + weights[used]))
    weights[used] += 1
    # the least weights would make the sum grow for ever
    shared = min(sum_weights, np.int64(WEIGHT_SUM))
    for i in range(count):
        posterior = np.int64((sheet[_CHANCES, i] >> 8) * shared // max(width >> 8, np.int64(1)))
        weights[i] = max(weights[i] + (((posterior - weights[i]) * step) >> 16), np.int64(16))
    if value - low < len(histogram):
        histogram[value - low] += 64
    return value
