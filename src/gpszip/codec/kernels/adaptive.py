"""Adaptive models over the range coder: bits, integers of any size, weighted choices, mixtures.

All arithmetic is on integers, so that every machine codes and decodes the same bytes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.integer_contexts import EXPONENT_CONTEXTS, MAX_EXPONENT, TREE_NODES
from gpszip.codec.kernels.log2 import fixed_log2
from gpszip.codec.kernels.range_coder import (
    Coder,
    code_bits,
    code_interval,
    decode_cumulative,
    is_decoding,
)
from gpszip.kernels.jit import inner, inner_uncounted

__all__ = [
    "BY_RATIO",
    "CENTERS",
    "HISTOGRAM",
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

#: Centres and scales of distributions are in sixteenths of a step.
SUBSTEPS = 16

#: Logarithm of SUBSTEPS to base two, in units of 2**-16.
_LOG_SUBSTEPS = 4 << 16

#: Weights of a mixture sum up to about this.
WEIGHT_SUM = 1 << 16

#: Probabilities are in units of 2**-24.
_PROBABILITY_BITS = 24
_CERTAIN = 1 << _PROBABILITY_BITS

#: A bit adds this to the count of its value; counts are halved once their sum is above the limit.
_BIT_INCREMENT = 20
_BIT_LIMIT = 2000

#: Rate at which weights move towards their posterior, of 65,536: at the first number, and at last.
_FIRST_RATE = 40_000
_LAST_RATE = 6_500

#: Numbers after which the first rate has halved.
_RATE_HALF_LIFE = 16

#: Weights stay at or above this, so that each distribution can come back.
_MIN_WEIGHT = 16

#: A value adds this to its count in a histogram.
_HISTOGRAM_INCREMENT = 64

#: Kinds of distributions in a mixture.
TWO_SIDED = np.int64(0)  # logistic
ONE_SIDED = np.int64(1)  # exponential, from the lowest value on
HISTOGRAM = np.int64(2)  # counts of the values so far
BY_RATIO = np.int64(3)  # logistic in the logarithm of the value

#: Rows of a mixture's table, with one column for each distribution.
KINDS = np.int64(0)
CENTERS = np.int64(1)
SCALES = np.int64(2)
_MASS_BELOW_LOW = np.int64(3)  # probability below the lowest value, which is cut off
_WEIGHTED_MASS = np.int64(4)  # weight times the probability of the value that was coded
MIXTURE_ROWS = 5

#: The tables below reach from -16 to 16 (or from 0) in steps of 1/64.
_REACH = 16
_STEPS = 64

#: L(z) = 1 / (1 + exp(-z)), 0 at its first entry and 1 at its last. No entry lies near a half.
_Z = np.arange(-_REACH * _STEPS, _REACH * _STEPS + 1) / _STEPS
_LOGISTIC = np.round(_CERTAIN / (1.0 + np.exp(-_Z))).astype(np.int64)
_LOGISTIC[0] = 0
_LOGISTIC[-1] = _CERTAIN

#: E(z) = 1 - exp(-z) for z >= 0, 1 at its last entry.
_EXPONENTIAL = np.round(_CERTAIN * -np.expm1(-np.arange(_REACH * _STEPS + 1) / _STEPS))
_EXPONENTIAL = _EXPONENTIAL.astype(np.int64)
_EXPONENTIAL[-1] = _CERTAIN

#: Binary digits of z after the point, those that index a table, and the mask of the others.
_Z_BITS = 16
_REST_BITS = 10
_REST_MASK = 1023


@inner_uncounted
def code_bit(coder: Coder, counts: NDArray[np.int32], context: int, bit: int) -> int:
    """Code a bit with the counts of zeros and ones of its context, and learn it.

    Parameters
    ----------
    coder : Coder
        In any direction.
    counts : int32 array, shape (contexts, 2)
        Counts of zeros and ones, at least 1; changed in place.
    context : int
        Row of ``counts``.
    bit : int
        The bit to encode; ignored by a decoder.
    """
    zeros, ones = np.int64(counts[context, 0]), np.int64(counts[context, 1])
    total = zeros + ones

    # Zeros own the lower end of the interval, ones the upper.
    if is_decoding(coder):
        bit = 1 if decode_cumulative(coder, total) >= zeros else 0
    if bit:
        code_interval(coder, zeros, ones, total)
    else:
        code_interval(coder, 0, zeros, total)

    # Learn, and forget slowly.
    counts[context, bit] += _BIT_INCREMENT
    if total > _BIT_LIMIT:
        counts[context, 0] = max(counts[context, 0] // 2, 1)
        counts[context, 1] = max(counts[context, 1] // 2, 1)
    return bit


@inner_uncounted
def code_unsigned(coder: Coder, counts: NDArray[np.int32], context: int, value: int) -> int:
    """Code an integer v >= 0 by adaptive Exp-Golomb bins (J. Teuhola, 1978).

    v + 1 has e binary digits after its leading one. First come e ones and a zero, then the digits,
    the highest first. The first three digits have a context by e and the digits before them; the
    others are equally likely. Takes ``INTEGER_CONTEXTS`` contexts from ``context`` on.
    """
    encodes = not is_decoding(coder)

    # The exponent e in unary.
    exponent = 0
    while exponent < MAX_EXPONENT:
        more = 1 if encodes and (value + 1) >> (exponent + 1) > 0 else 0
        if code_bit(coder, counts, context + exponent, more) == 0:
            break
        exponent += 1

    # The digits below the leading one; a binary tree of contexts for the first three.
    digits = value + 1 - (np.int64(1) << exponent) if encodes else np.int64(0)
    node = 1
    coded = np.int64(0)
    tree = context + EXPONENT_CONTEXTS + TREE_NODES * exponent
    for shift in range(exponent - 1, -1, -1):
        bit = (digits >> shift) & 1 if encodes else np.int64(0)
        if node < TREE_NODES:
            bit = code_bit(coder, counts, tree + node, bit)
            node = 2 * node + bit
        else:
            bit = code_bits(coder, bit, 1)
        coded = 2 * coded + bit
    return (np.int64(1) << exponent) + coded - 1


@inner_uncounted
def code_signed(coder: Coder, counts: NDArray[np.int32], context: int, value: int) -> int:
    """Code an integer of either sign, folded to 2 v for v >= 0 and -2 v - 1 for v < 0.

    Takes ``INTEGER_CONTEXTS`` contexts from ``context`` on.
    """
    folded = 2 * value if value >= 0 else -2 * value - 1
    folded = code_unsigned(coder, counts, context, folded)
    return folded // 2 if folded % 2 == 0 else -(folded + 1) // 2


@inner_uncounted
def code_choice(coder: Coder, weights: NDArray[np.int64], count: int, choice: int) -> int:
    """Code the index of one of ``count`` candidates, with probabilities in proportion to weights.

    Weights are at least 1, and their sum is at most 2**41.
    """
    # The sum of the weights is the denominator of all probabilities.
    total = np.int64(0)
    for i in range(count):
        total += weights[i]

    # Find the candidate whose interval holds the number.
    if is_decoding(coder):
        number = decode_cumulative(coder, total)
        choice = 0
        while choice < count - 1 and number >= weights[choice]:
            number -= weights[choice]
            choice += 1

    # Narrow to the interval of the choice, which follows those of the candidates before it.
    start = np.int64(0)
    for i in range(choice):
        start += weights[i]
    code_interval(coder, start, weights[choice], total)
    return choice


@inner_uncounted
def _log_below(value: int) -> int:
    """Logarithm of ``value`` - 1/2, in units of 2**-16; meaningless below 1."""
    return fixed_log2(max(value * SUBSTEPS - SUBSTEPS // 2, np.int64(1))) - _LOG_SUBSTEPS


@inner_uncounted
def _mass_below(value: int, log: int, low: int, mixture: NDArray[np.int64], i: int) -> int:
    """Mass of distribution i below ``value`` - 1/2, in units of 2**-24.

    With centre c and scale s, both in sixteenths, it is L((16 v - 8 - c) / s) for a two-sided
    distribution, L((log - c) * s / 2) for one by ratio, whose c is a logarithm, and
    E(16 (v - low) / s) for a one-sided one. L and E are interpolated between the entries of their
    tables.

    Parameters
    ----------
    value, low : int
        The value v, and the lowest one of the mixture.
    log : int
        Logarithm of ``value`` - 1/2, see :func:`_log_below`.
    """
    kind, center, scale = mixture[KINDS, i], mixture[CENTERS, i], mixture[SCALES, i]

    # Exponential.
    if kind == ONE_SIDED:
        z = ((value - low) * SUBSTEPS << _Z_BITS) // scale
        if z >= (_REACH << _Z_BITS):
            return np.int64(_CERTAIN)
        j = z >> _REST_BITS
        slope = _EXPONENTIAL[j + 1] - _EXPONENTIAL[j]
        return _EXPONENTIAL[j] + (slope * (z & _REST_MASK) >> _REST_BITS)

    # Logistic, in the logarithm or in the value; z counts from -16.
    if kind == BY_RATIO:
        z = ((log - center) * scale >> 1) + (_REACH << _Z_BITS)
    else:
        middle = value * SUBSTEPS - SUBSTEPS // 2
        z = ((middle - center) << _Z_BITS) // scale + (_REACH << _Z_BITS)
    if z < 0:
        return np.int64(0)
    if z >= (2 * _REACH << _Z_BITS):
        return np.int64(_CERTAIN)
    j = z >> _REST_BITS
    slope = _LOGISTIC[j + 1] - _LOGISTIC[j]
    return _LOGISTIC[j] + (slope * (z & _REST_MASK) >> _REST_BITS)


@inner_uncounted
def _cumulative(
    value: int,
    log: int,
    low: int,
    mixture: NDArray[np.int64],
    i: int,
    histogram: NDArray[np.int64],
) -> int:
    """Cumulative probability F_i(v) of distribution i below ``value``, in units of 2**-24.

    It is (G(v) - G(low)) / (1 - G(low)), with G the mass below: what lies below ``low`` is cut off.
    """
    if mixture[KINDS, i] == HISTOGRAM:
        fewer, total = np.int64(0), np.int64(0)
        for j in range(len(histogram)):
            fewer += histogram[j] if j < value - low else np.int64(0)
            total += histogram[j]
        return (fewer << _PROBABILITY_BITS) // total

    mass, base = _mass_below(value, log, low, mixture, i), mixture[_MASS_BELOW_LOW, i]
    if base == 0:
        return mass
    return ((mass - base) << _PROBABILITY_BITS) // (_CERTAIN - base)


@inner_uncounted
def _find_value(
    number: int,
    low: int,
    high: int,
    mixture: NDArray[np.int64],
    count: int,
    weights: NDArray[np.int64],
    histogram: NDArray[np.int64],
) -> int:
    """Find the largest value whose cumulative count C(v) is at most ``number``.

    Gallops from near zero, where most values lie, with steps that grow by 4; then bisects.
    """
    # Keep C(first) <= number < C(last); begin near zero where the range allows it.
    first, last = low, high
    middle, step = min(max(low + 8, np.int64(0)), (low + high) >> 1), np.int64(8)
    galloping = True
    while last - first > 1:
        # C(middle)
        start, log = middle - low, _log_below(middle)
        for i in range(count):
            start += weights[i] * _cumulative(middle, log, low, mixture, i, histogram)

        # Keep the half that holds the number; gallop on while only one bound has moved.
        if start <= number:
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


@inner_uncounted
def _set_mass_below_low(
    mixture: NDArray[np.int64], count: int, weights: NDArray[np.int64], low: int
) -> int:
    """Enter the mass of each distribution that is cut off; return the sum of the weights."""
    sum_weights, log = np.int64(0), _log_below(low)
    for i in range(count):
        sum_weights += weights[i]
        symmetric = mixture[KINDS, i] == TWO_SIDED or mixture[KINDS, i] == BY_RATIO
        # At least 64 units stay, by which masses are divided.
        mixture[_MASS_BELOW_LOW, i] = (
            min(_mass_below(low, log, low, mixture, i), np.int64(_CERTAIN - 64))
            if symmetric
            else np.int64(0)
        )
    return sum_weights


@inner
def _learn_weights(
    mixture: NDArray[np.int64],
    count: int,
    weights: NDArray[np.int64],
    sum_weights: int,
    width: int,
) -> None:
    """Move the weights towards their posterior: one step of online EM, at a rate that falls.

    With w_i p_i the weighted mass of the value that was coded and W the sum of the weights::

        w_i += rate * (W * w_i p_i / sum_j w_j p_j - w_i)
    """
    coded = len(weights) - 1
    rate = max(
        np.int64(_LAST_RATE),
        _FIRST_RATE * _RATE_HALF_LIFE // (_RATE_HALF_LIFE + weights[coded]),
    )
    weights[coded] += 1

    # Weights that are raised to their minimum would otherwise make the sum grow for ever.
    target_sum = min(sum_weights, np.int64(WEIGHT_SUM))
    for i in range(count):
        share = (mixture[_WEIGHTED_MASS, i] >> 8) * target_sum
        posterior = np.int64(share // max(width >> 8, np.int64(1)))
        weights[i] = max(
            weights[i] + (((posterior - weights[i]) * rate) >> 16), np.int64(_MIN_WEIGHT)
        )


@inner_uncounted
def code_mixture(
    coder: Coder,
    value: int,
    low: int,
    high: int,
    mixture: NDArray[np.int64],
    count: int,
    weights: NDArray[np.int64],
    histogram: NDArray[np.int64],
) -> int:
    """Code an integer in [low, high) with a mixture of ``count`` distributions, and learn.

    With weights w_i and cumulative probabilities F_i in units of 2**-24, the value v owns the
    interval from C(v) to C(v + 1), where C(v) = v - low + sum_i w_i F_i(v). The first term gives
    each value a width of at least 1.

    Parameters
    ----------
    coder : Coder
        In any direction.
    value : int
        The value to encode; ignored by a decoder.
    low, high : int
        Range of the values.
    mixture : int64 array, shape (MIXTURE_ROWS, >= count)
        Rows ``KINDS``, ``CENTERS`` and ``SCALES`` hold kind, centre and scale of each distribution,
        the last two in sixteenths. A ``TWO_SIDED`` one is logistic. A ``ONE_SIDED`` one falls
        exponentially from ``low``. A ``HISTOGRAM`` counts the values so far. One ``BY_RATIO`` is
        logistic in the logarithm of the value, which must be positive: its centre is a logarithm to
        base two in units of 2**-16, its scale the steepness, in halves for an octave. Further rows
        are scratch space.
    count : int
        Number of distributions.
    weights : int64 array
        Weights of the distributions, changed in place; their sum is about ``WEIGHT_SUM``. The last
        element counts the numbers coded: at first the weights follow each number closely, later
        slowly.
    histogram : int64 array
        Counts of ``low``, ``low`` + 1, ...; changed in place, also where no distribution uses it.

    Returns
    -------
    int
        The value.
    """
    # The total C(high) is the sum of the weights in units of 2**-24, plus 1 for each value.
    sum_weights = _set_mass_below_low(mixture, count, weights, low)
    total = (sum_weights << _PROBABILITY_BITS) + (high - low)
    if is_decoding(coder):
        number = decode_cumulative(coder, total)
        value = _find_value(number, low, high, mixture, count, weights, histogram)

    # C(v), and C(v + 1) - C(v)
    start, width = np.int64(value - low), np.int64(1)
    log, log_after = _log_below(value), _log_below(value + 1)
    for i in range(count):
        below = _cumulative(value, log, low, mixture, i, histogram)
        below_next = (
            np.int64(_CERTAIN)
            if value + 1 == high
            else _cumulative(value + 1, log_after, low, mixture, i, histogram)
        )
        mixture[_WEIGHTED_MASS, i] = weights[i] * (below_next - below)
        start += weights[i] * below
        width += mixture[_WEIGHTED_MASS, i]
    code_interval(coder, start, width, total)

    # Learn.
    _learn_weights(mixture, count, weights, sum_weights, width)
    if value - low < len(histogram):
        histogram[value - low] += _HISTOGRAM_INCREMENT
    return value
