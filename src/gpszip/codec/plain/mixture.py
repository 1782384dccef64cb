"""Mixtures of distributions of a number; see :func:`gpszip.codec.kernels.adaptive.code_mixture`."""

from __future__ import annotations

from collections.abc import Sequence
from operator import mul

from gpszip.codec.plain.distributions import CERTAIN, PROBABILITY_BITS, Distributions
from gpszip.codec.plain.range_decoder import RangeDecoder
from gpszip.codec.plain.work import WorkLimit

__all__ = ["Mixture", "read_mixture"]

#: Rate at which weights move towards their posterior, of 65,536: at the first number, and at last.
_FIRST_RATE = 40_000
_LAST_RATE = 6_500

#: Numbers after which the first rate has halved.
_RATE_HALF_LIFE = 16

#: Weights of a mixture sum up to about this, and stay at or above the other.
_WEIGHT_SUM = 1 << 16
_MIN_WEIGHT = 16

#: A value adds this to its count in a histogram, whose counts begin at the other.
_HISTOGRAM_INCREMENT = 64
_FIRST_HISTOGRAM_COUNT = 2

#: The first value that a search tries, above the lowest one, and its growth while it gallops.
_FIRST_STEP = 8
_GALLOP = 4


class Mixture:
    """Weights of the distributions of one mixture, and the counts of its shortest values.

    Parameters
    ----------
    weights : sequence of int
        Initial weights of the distributions.
    bins : int
        Values that the histogram counts, from the lowest one on.
    """

    __slots__ = ("coded", "histogram", "weights")

    def __init__(self, weights: Sequence[int], bins: int) -> None:
        self.weights = list(weights)
        self.histogram = [_FIRST_HISTOGRAM_COUNT] * bins
        self.coded = 0  # numbers so far


def read_mixture(
    decoder: RangeDecoder,
    mixture: Mixture,
    low: int,
    high: int,
    distributions: Distributions,
    work: WorkLimit,
) -> int:
    """Read an integer in [low, high), and learn it.

    With weights w_i and cumulative probabilities F_i, the value v owns the interval from C(v) to
    C(v + 1), where C(v) = v - low + sum_i w_i F_i(v).

    Parameters
    ----------
    decoder : RangeDecoder
        The decoder.
    mixture : Mixture
        Has weights for at least as many distributions; changed.
    low, high : int
        Range of the values.
    distributions : Distributions
        From the same lowest value on.
    work : WorkLimit
        Spends a unit for each distribution that is evaluated.
    """
    # The value, and the cumulative probabilities below it and up to it.
    weights = mixture.weights
    sum_weights = sum(weights[: len(distributions)])
    total = (sum_weights << PROBABILITY_BITS) + high - low
    number = decoder.find(total)
    value, below, above = _find_value(number, weights, low, high, distributions, total, work)

    # Its interval.
    # The weights of distributions that this number doesn't have are left out.
    masses = [
        weight * (after - before)
        for weight, before, after in zip(weights, below, above, strict=False)
    ]
    width = 1 + sum(masses)
    decoder.take(value - low + sum(map(mul, weights, below)), width, total)

    # Learn.
    _learn_weights(mixture, masses, sum_weights, width)
    if value - low < len(mixture.histogram):
        mixture.histogram[value - low] += _HISTOGRAM_INCREMENT
    return value


def _find_value(
    number: int,
    weights: Sequence[int],
    low: int,
    high: int,
    distributions: Distributions,
    total: int,
    work: WorkLimit,
) -> tuple[int, list[int], list[int]]:
    """Find the largest value whose cumulative count C(v) is at most ``number``.

    Gallops from near zero, where most values lie; then halves the range and interpolates in turn.

    Returns
    -------
    int
        The value.
    list of int, list of int
        Cumulative probabilities of the distributions below the value, and up to it.
    """
    # Keep C(first) <= number < C(last).
    # Any search ends at the same value, since C increases. To interpolate saves evaluations, which
    # take long here; the compiled decoder bisects.
    first, last, count_first, count_last = low, high, 0, total
    below, above = None, [CERTAIN] * len(distributions)
    middle, step = min(max(low + _FIRST_STEP, 0), (low + high) >> 1), _FIRST_STEP
    galloping, halves = True, False
    while last - first > 1:
        # The half that holds the number.
        found = distributions.below(middle)
        work.spend(len(found))
        count = middle - low + sum(map(mul, weights, found))
        if count <= number:
            first, below, count_first = middle, found, count
            galloping = galloping and last == high
            middle += step
        else:
            last, above, count_last = middle, found, count
            galloping = galloping and first == low
            middle -= step
        step *= _GALLOP

        # The next value to try.
        if galloping and first < middle < last:
            continue
        galloping, halves = False, not halves
        if halves:
            middle = (first + last) >> 1
        else:
            share = (number - count_first) * (last - first) // (count_last - count_first)
            middle = min(max(first + share, first + 1), last - 1)
    return first, distributions.below(first) if below is None else below, above


def _learn_weights(mixture: Mixture, masses: Sequence[int], sum_weights: int, width: int) -> None:
    """Move the weights towards their posterior, given the weighted masses of the value.

    See :func:`gpszip.codec.kernels.adaptive._learn_weights`.
    """
    rate = max(_LAST_RATE, _FIRST_RATE * _RATE_HALF_LIFE // (_RATE_HALF_LIFE + mixture.coded))
    mixture.coded += 1

    # Weights that are raised to their minimum would otherwise make the sum grow for ever.
    target_sum, divisor = min(sum_weights, _WEIGHT_SUM), max(width >> 8, 1)
    weights = mixture.weights

    # The lowest 8 bits are dropped, as the format has it: products then fit in 64 bits.
    for i, mass in enumerate(masses):
        weight = weights[i]
        posterior = (mass >> 8) * target_sum // divisor
        weights[i] = max(weight + ((posterior - weight) * rate >> 16), _MIN_WEIGHT)
