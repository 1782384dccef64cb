"""Plain twin of the adaptive models, written from docs/format.md; its tables come from 50-digit arithmetic."""

from __future__ import annotations

from decimal import Decimal, localcontext
from functools import cache

# Constants of docs/format.md, "Adaptive models".
UNIT = 24
WHOLE = 1 << UNIT
BIT_STEP, BIT_LIMIT = 20, 2000
TREE_BITS = 3
FIRST_STEP, LAST_STEP, SETTLING = 40_000, 6_500, 16
WEIGHT_SUM, LEAST_WEIGHT = 65_536, 16
HISTOGRAM_STEP = 64
REACH, STEPS = 16, 64

TWO_SIDED, ONE_SIDED, HISTOGRAM, BY_RATIO = "two-sided", "one-sided", "histogram", "by ratio"


def exact_logistic():
    """Values to round, for z = -16 ... 16 in sixty-fourths."""
    with localcontext(prec=50):
        return [
            WHOLE / (1 + (Decimal(-i) / STEPS).exp())
            for i in range(-REACH * STEPS, REACH * STEPS + 1)
        ]


def exact_exponential():
    with localcontext(prec=50):
        return [WHOLE * (1 - (Decimal(-i) / STEPS).exp()) for i in range(REACH * STEPS + 1)]


@cache
def tables():
    logistic = [int(x.to_integral_value()) for x in exact_logistic()]
    exponential = [int(x.to_integral_value()) for x in exact_exponential()]
    logistic[0], logistic[-1], exponential[-1] = 0, WHOLE, WHOLE
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
    at, part = (mantissa >> 20) - 1024, mantissa % 2**20
    return (
        (exponent << 16) + fractions()[at] + ((fractions()[at + 1] - fractions()[at]) * part >> 20)
    )


class Bit:
    """Counts of one context."""

    def __init__(self, zeros=10, ones=10):
        self.counts = [zeros, ones]

    def read(self, coder):
        zeros, ones = self.counts
        total = zeros + ones
        bit = int(coder.target(total) >= zeros)
        coder.interval(zeros if bit else 0, self.counts[bit], total)
        self.counts[bit] += BIT_STEP
        if total > BIT_LIMIT:
            self.counts = [max(count // 2, 1) for count in self.counts]
        return bit


class Size:
    """Contexts of an integer >= 0 of any size."""

    def __init__(self):
        self.more = [Bit() for _ in range(47)]
        self.rest = {}

    def read(self, coder):
        exponent = 0
        while exponent < 47 and self.more[exponent].read(coder):
            exponent += 1
        value = 1
        for place in range(exponent):
            bit = (
                self.rest.setdefault((exponent, value), Bit()).read(coder)
                if place < TREE_BITS
                else coder.bits(1)
            )
            value = 2 * value + bit
        return value - 1


class Whole:
    """Contexts of an integer of either sign."""

    def __init__(self):
        self.size = Size()

    def read(self, coder):
        folded = self.size.read(coder)
        return folded // 2 if folded % 2 == 0 else -(folded + 1) // 2


def read_choice(coder, weights):
    total = sum(weights)
    at, choice, start = coder.target(total), 0, 0
    while at >= start + weights[choice]:
        start += weights[choice]
        choice += 1
    coder.interval(start, weights[choice], total)
    return choice


def below(value, kind, center, scale, low):
    """Probability below value - 1/2 in units of 2**-24."""
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
        return WHOLE
    at, part = z >> 10, z & 1023
    return table[at] + ((table[at + 1] - table[at]) * part >> 10)


class Mixture:
    """Weights of one mixture, and its histogram."""

    def __init__(self, weights, bins=48, bin=2):
        self.weights = list(weights)
        self.used = 0
        self.histogram = [bin] * bins

    def shares(self, value, low, distributions):
        """What each distribution puts below ``value``."""
        out = []
        for kind, center, scale in distributions:
            if kind == HISTOGRAM:
                out.append((sum(self.histogram[: value - low]) << UNIT) // sum(self.histogram))
                continue
            here = below(value, kind, center, scale, low)
            base = (
                min(below(low, kind, center, scale, low), WHOLE - 64)
                if kind in (TWO_SIDED, BY_RATIO)
                else 0
            )
            out.append(((here - base) << UNIT) // (WHOLE - base))
        return out

    def cumulative(self, value, low, high, distributions):
        shares = (
            [WHOLE] * len(distributions)
            if value == high
            else self.shares(value, low, distributions)
        )
        return value - low + sum(w * s for w, s in zip(self.weights, shares, strict=False))

    def read(self, coder, low, high, distributions):
        weights = self.weights[: len(distributions)]
        total = (sum(weights) << UNIT) + high - low
        at = coder.target(total)
        first, last = low, high
        while last - first > 1:
            middle = (first + last) >> 1
            if self.cumulative(middle, low, high, distributions) <= at:
                first = middle
            else:
                last = middle
        self.code(coder, first, low, high, distributions)
        return first

    def code(self, coder, value, low, high, distributions):
        """Write or read past a value, and learn it."""
        count = len(distributions)
        weights = self.weights[:count]
        total = (sum(weights) << UNIT) + high - low
        start = self.cumulative(value, low, high, distributions)
        width = self.cumulative(value + 1, low, high, distributions) - start
        coder.interval(start, width, total)
        a = self.shares(value, low, distributions)
        b = [WHOLE] * count if value + 1 == high else self.shares(value + 1, low, distributions)
        step = max(LAST_STEP, FIRST_STEP * SETTLING // (SETTLING + self.used))
        self.used += 1
        shared = min(sum(weights), WEIGHT_SUM)
        for i, weight in enumerate(weights):
            posterior = (weight * (b[i] - a[i]) >> 8) * shared // max(width >> 8, 1)
            self.weights[i] = max(weight + ((posterior - weight) * step >> 16), LEAST_WEIGHT)
        if value - low < len(self.histogram):
            self.histogram[value - low] += HISTOGRAM_STEP
