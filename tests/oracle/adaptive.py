"""Plain adaptive models, written from docs/format.md; tables come from 50-digit arithmetic."""

from __future__ import annotations

from decimal import Decimal, localcontext
from functools import cache

# Constants of docs/format.md, "Adaptive models".
PROBABILITY_BITS = 24
CERTAIN = 1 << PROBABILITY_BITS
BIT_INCREMENT = 20
BIT_LIMIT = 2000
TREE_BITS = 3
FIRST_RATE = 40_000
LAST_RATE = 6_500
RATE_HALF_LIFE = 16
WEIGHT_SUM = 65_536
MIN_WEIGHT = 16
HISTOGRAM_INCREMENT = 64
REACH = 16
STEPS = 64

TWO_SIDED, ONE_SIDED, HISTOGRAM, BY_RATIO = "two-sided", "one-sided", "histogram", "by ratio"


def exact_logistic():
    """Values to round, for z = -16 ... 16 in sixty-fourths."""
    with localcontext(prec=50):
        return [
            CERTAIN / (1 + (Decimal(-i) / STEPS).exp())
            for i in range(-REACH * STEPS, REACH * STEPS + 1)
        ]


def exact_exponential():
    with localcontext(prec=50):
        return [CERTAIN * (1 - (Decimal(-i) / STEPS).exp()) for i in range(REACH * STEPS + 1)]


@cache
def tables():
    logistic = [int(x.to_integral_value()) for x in exact_logistic()]
    exponential = [int(x.to_integral_value()) for x in exact_exponential()]
    logistic[0], logistic[-1], exponential[-1] = 0, CERTAIN, CERTAIN
    return logistic, exponential


@cache
def exact_fractions():
    """Logarithms to the base of two of 1 ... 2 in 1024ths, times 2**16."""
    with localcontext(prec=50):
        return [(1 + Decimal(i) / 1024).ln() / Decimal(2).ln() * 65536 for i in range(1025)]


@cache
def fractions():
    return [int(x.to_integral_value()) for x in exact_fractions()]


def log2_of(value):
    """In units of 2**-16."""
    exponent = value.bit_length() - 1
    mantissa = (value << 30) >> exponent
    i, rest = (mantissa >> 20) - 1024, mantissa % 2**20
    slope = fractions()[i + 1] - fractions()[i]
    return (exponent << 16) + fractions()[i] + (slope * rest >> 20)


class Bit:
    """Counts of one context."""

    def __init__(self, zeros=10, ones=10):
        self.counts = [zeros, ones]

    def read(self, coder):
        zeros, ones = self.counts
        total = zeros + ones
        bit = int(coder.decode_cumulative(total) >= zeros)
        coder.interval(zeros if bit else 0, self.counts[bit], total)
        self.counts[bit] += BIT_INCREMENT
        if total > BIT_LIMIT:
            self.counts = [max(count // 2, 1) for count in self.counts]
        return bit


class Unsigned:
    """Contexts of an integer >= 0 of any size."""

    def __init__(self):
        self.exponent = [Bit() for _ in range(47)]
        self.digits = {}

    def read(self, coder):
        exponent = 0
        while exponent < 47 and self.exponent[exponent].read(coder):
            exponent += 1
        value = 1
        for place in range(exponent):
            bit = (
                self.digits.setdefault((exponent, value), Bit()).read(coder)
                if place < TREE_BITS
                else coder.bits(1)
            )
            value = 2 * value + bit
        return value - 1


class Signed:
    """Contexts of an integer of either sign."""

    def __init__(self):
        self.unsigned = Unsigned()

    def read(self, coder):
        folded = self.unsigned.read(coder)
        return folded // 2 if folded % 2 == 0 else -(folded + 1) // 2


def read_choice(coder, weights):
    total = sum(weights)
    number, choice, start = coder.decode_cumulative(total), 0, 0
    while number >= start + weights[choice]:
        start += weights[choice]
        choice += 1
    coder.interval(start, weights[choice], total)
    return choice


def mass_below(value, kind, center, scale, low):
    """Mass below value - 1/2 in units of 2**-24."""
    logistic, exponential = tables()
    if kind == ONE_SIDED:
        table, z, end = exponential, ((value - low) * 16 << 16) // scale, REACH << 16
    elif kind == BY_RATIO:
        table, z, end = (
            logistic,
            ((log2_of(16 * value - 8) - (4 << 16) - center) * scale >> 1) + (REACH << 16),
            2 * REACH << 16,
        )
    else:
        table, z, end = (
            logistic,
            ((value * 16 - 8 - center) << 16) // scale + (REACH << 16),
            2 * REACH << 16,
        )
    if z < 0:
        return 0
    if z >= end:
        return CERTAIN
    i, rest = z >> 10, z & 1023
    return table[i] + ((table[i + 1] - table[i]) * rest >> 10)


class Mixture:
    """Weights of one mixture, and its histogram."""

    def __init__(self, weights, bins=48, bin=2):
        self.weights = list(weights)
        self.coded = 0
        self.histogram = [bin] * bins

    def cumulatives(self, value, low, distributions):
        """Cumulative probability of each distribution below ``value``."""
        out = []
        for kind, center, scale in distributions:
            if kind == HISTOGRAM:
                out.append(
                    (sum(self.histogram[: value - low]) << PROBABILITY_BITS) // sum(self.histogram)
                )
                continue
            mass = mass_below(value, kind, center, scale, low)
            base = (
                min(mass_below(low, kind, center, scale, low), CERTAIN - 64)
                if kind in (TWO_SIDED, BY_RATIO)
                else 0
            )
            out.append(((mass - base) << PROBABILITY_BITS) // (CERTAIN - base))
        return out

    def cumulative(self, value, low, high, distributions):
        cumulatives = (
            [CERTAIN] * len(distributions)
            if value == high
            else self.cumulatives(value, low, distributions)
        )
        return value - low + sum(w * s for w, s in zip(self.weights, cumulatives, strict=False))

    def read(self, coder, low, high, distributions):
        weights = self.weights[: len(distributions)]
        total = (sum(weights) << PROBABILITY_BITS) + high - low
        number = coder.decode_cumulative(total)
        first, last = low, high
        while last - first > 1:
            middle = (first + last) >> 1
            if self.cumulative(middle, low, high, distributions) <= number:
                first = middle
            else:
                last = middle
        self.code(coder, first, low, high, distributions)
        return first

    def code(self, coder, value, low, high, distributions):
        """Encode a value, or decode past it, and learn it."""
        count = len(distributions)
        weights = self.weights[:count]
        total = (sum(weights) << PROBABILITY_BITS) + high - low
        start = self.cumulative(value, low, high, distributions)
        width = self.cumulative(value + 1, low, high, distributions) - start
        coder.interval(start, width, total)
        below = self.cumulatives(value, low, distributions)
        below_next = [CERTAIN] * count
        if value + 1 < high:
            below_next = self.cumulatives(value + 1, low, distributions)
        rate = max(LAST_RATE, FIRST_RATE * RATE_HALF_LIFE // (RATE_HALF_LIFE + self.coded))
        self.coded += 1
        target_sum = min(sum(weights), WEIGHT_SUM)
        for i, weight in enumerate(weights):
            posterior = (
                (weight * (below_next[i] - below[i]) >> 8) * target_sum // max(width >> 8, 1)
            )
            self.weights[i] = max(weight + ((posterior - weight) * rate >> 16), MIN_WEIGHT)
        if value - low < len(self.histogram):
            self.histogram[value - low] += HISTOGRAM_INCREMENT
