"""Distributions of numbers in a mixture; see :mod:`gpszip.codec.kernels.adaptive`.

Centres and scales are in sixteenths of a step, masses and probabilities in units of 2**-24. Most of
a decoder's time is spent here, in one loop for each kind of distribution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import itemgetter
from typing import Protocol

from gpszip.codec.plain.log2 import fixed_log2

__all__ = ["CERTAIN", "PROBABILITY_BITS", "Distributions", "Durations", "Offsets"]

#: Binary digits of probabilities, and a probability of 1.
PROBABILITY_BITS = 24
CERTAIN = 1 << PROBABILITY_BITS

#: At most this is cut off below the lowest value: masses are divided by what is left.
_MAX_CUT = CERTAIN - 64

#: Scales of logistic and exponential distributions are at least this, and at most the other.
_MIN_SCALE = 6
_MAX_SCALE = 1 << 36

#: Logarithm of 16 to base two, in units of 2**-16.
_LOG_SUBSTEPS = 4 << 16

#: The tables below reach from -16 to 16 (or from 0) in steps of 1/64.
_REACH = 16
_STEPS = 64

#: L(z) = 1 / (1 + exp(-z)), 0 at its first entry and 1 at its last. No entry lies near a half.
_LOGISTIC = [
    0,
    *(
        round(CERTAIN / (1 + math.exp(-i / _STEPS)))
        for i in range(1 - _REACH * _STEPS, _REACH * _STEPS)
    ),
    CERTAIN,
]

#: E(z) = 1 - exp(-z) for z >= 0, 1 at its last entry.
_EXPONENTIAL = [
    *(round(CERTAIN * -math.expm1(-i / _STEPS)) for i in range(_REACH * _STEPS)),
    CERTAIN,
]

#: Where the tables end: z - their first z, with 16 binary digits after the point.
_LOGISTIC_END = 2 * _REACH << 16
_EXPONENTIAL_END = _REACH << 16

#: Octaves of the scales of exponential distributions, in time steps.
_OCTAVES = (0, 1, 2, 3, 4, 6, 8, 10, 12)


class Distributions(Protocol):
    """The distributions of one number, in the order of their weights."""

    def __len__(self) -> int:
        """Number of distributions."""

    def below(self, value: int) -> list[int]:
        """Cumulative probability of each distribution below a value."""


class Offsets:
    """Logistic distributions, cut off below the lowest value.

    With centre c and scale s, the mass below v - 1/2 is L((16 v - 8 - c) / s).

    Parameters
    ----------
    pairs : sequence of (int, int)
        Centre and scale of each.
    low : int
        The lowest value.

    Examples
    --------
    >>> offsets = Offsets([(0, 16), (160, 16)], -1000)
    >>> [round(below / 2**24, 3) for below in offsets.below(1)]
    [0.622, 0.0]
    """

    __slots__ = ("_entries",)

    def __init__(self, pairs: Sequence[tuple[int, int]], low: int) -> None:
        # Scale, and what to subtract before the division, so that z counts from -16.
        # With c and s, z = ((16 v - 8 - c) << 16) / s + (16 << 16), which counts from -16. All but
        # v is in the shift: z = (((16 v - 8) << 16) - shift) / s.
        entries = []
        for center, scale in pairs:
            bounded = min(max(scale, _MIN_SCALE), _MAX_SCALE)
            entries.append((bounded, (center << 16) - (bounded * _REACH << 16), 0))

        # What is cut off: nothing of distributions that don't reach down to the lowest value.
        # Without cuts at first, by which they are computed.
        self._entries: list[tuple[int, int, int]] = entries
        if min(entries, key=itemgetter(1))[1] <= (16 * low - 8) << 16:
            self._entries = [
                (scale, shift, min(cut, _MAX_CUT))
                for (scale, shift, _), cut in zip(entries, self.below(low), strict=True)
            ]

    def __len__(self) -> int:
        return len(self._entries)

    def below(self, value: int) -> list[int]:
        """Cumulative probability of each distribution below a value."""
        middle, table, out = (16 * value - 8) << 16, _LOGISTIC, []
        for scale, shift, cut in self._entries:
            # Interpolate between two entries of the table.
            # z has 16 digits after the point. Entries are 1/64 apart: 6 of the digits are in the
            # index, 10 say where z lies between two entries.
            z = (middle - shift) // scale
            if z < 0:
                mass = 0
            elif z >= _LOGISTIC_END:
                mass = CERTAIN
            else:
                mass = table[z >> 10]
                mass += (table[(z >> 10) + 1] - mass) * (z & 1023) >> 10
            out.append(((mass - cut) << PROBABILITY_BITS) // (CERTAIN - cut) if cut else mass)
        return out


class Durations:
    """A histogram, exponential distributions, and logistic ones in the logarithm of the value.

    With the lowest value l, an exponential distribution of scale s has the mass
    E(16 (v - l) / s) below v - 1/2. One by ratio, with a logarithm c as its centre and a steepness
    s, has L((log2(v - 1/2) - c) * s / 2), cut off below the lowest value.

    Parameters
    ----------
    histogram : sequence of int
        Counts of the lowest value and those that follow.
    guesses : sequence of (int, int)
        Logarithm to base two in units of 2**-16, and steepness in halves for an octave.
    low : int
        The lowest value, at least 1.

    Examples
    --------
    >>> durations = Durations([1, 3], [(3 << 16, 4)], 1)
    >>> [round(below / 2**24, 2) for below in durations.below(2)]
    [0.25, 0.63, 0.39, 0.22, 0.12, 0.06, 0.02, 0.0, 0.0, 0.0, 0.01]
    """

    __slots__ = ("_entries", "_histogram", "_low", "_total")

    def __init__(
        self, histogram: Sequence[int], guesses: Sequence[tuple[int, int]], low: int
    ) -> None:
        self._low, self._histogram, self._total = low, histogram, sum(histogram)
        self._entries = [(center, steepness, 0) for center, steepness in guesses]
        # What lies below the lowest value, of the entries without a cut; then the same with it.
        cuts = self._by_ratio_below(low)
        self._entries = [
            (center, steepness, min(cut, _MAX_CUT))
            for (center, steepness), cut in zip(guesses, cuts, strict=True)
        ]

    def __len__(self) -> int:
        return 1 + len(_OCTAVES) + len(self._entries)

    def below(self, value: int) -> list[int]:
        """Cumulative probability of each distribution below a value."""
        # The histogram.
        offset = value - self._low
        out = [(sum(self._histogram[:offset]) << PROBABILITY_BITS) // self._total]

        # Exponential.
        table, scaled = _EXPONENTIAL, offset << 16
        for octave in _OCTAVES:
            # 16 (v - l) / s in units of 2**-16, as scales are 16 times a power of two.
            z = scaled >> octave
            if z >= _EXPONENTIAL_END:
                out.append(CERTAIN)
            else:
                mass = table[z >> 10]
                out.append(mass + ((table[(z >> 10) + 1] - mass) * (z & 1023) >> 10))
        return out + self._by_ratio_below(value)

    def _by_ratio_below(self, value: int) -> list[int]:
        """Cumulative probability of each distribution by ratio below a value."""
        # log2(v - 1/2): of 16 v - 8, less the logarithm of 16.
        log = fixed_log2(max(16 * value - 8, 1)) - _LOG_SUBSTEPS
        table, out = _LOGISTIC, []
        for center, steepness, cut in self._entries:
            # Interpolate between two entries of the table; z counts from -16.
            z = ((log - center) * steepness >> 1) + _EXPONENTIAL_END
            if z < 0:
                mass = 0
            elif z >= _LOGISTIC_END:
                mass = CERTAIN
            else:
                mass = table[z >> 10]
                mass += (table[(z >> 10) + 1] - mass) * (z & 1023) >> 10
            out.append(((mass - cut) << PROBABILITY_BITS) // (CERTAIN - cut) if cut else mass)
        return out
