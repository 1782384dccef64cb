"""Adaptive bits and integers of any size; see :mod:`gpszip.codec.kernels.adaptive`."""

from __future__ import annotations

from gpszip.codec.integer_contexts import EXPONENT_CONTEXTS, MAX_EXPONENT, TREE_NODES
from gpszip.codec.plain.range_decoder import RangeDecoder

__all__ = ["read_bit", "read_signed", "read_unsigned"]

#: A bit adds this to the count of its value; counts are halved once their sum is above the limit.
_BIT_INCREMENT = 20
_BIT_LIMIT = 2000


def read_bit(decoder: RangeDecoder, counts: list[list[int]], context: int) -> int:
    """Read a bit with the counts of zeros and ones of its context, and learn it.

    Parameters
    ----------
    decoder : RangeDecoder
        The decoder.
    counts : list of [zeros, ones]
        Counts of all contexts; changed in place.
    context : int
        Index into ``counts``.
    """
    # Zeros own the lower end of the interval, ones the upper.
    pair = counts[context]
    zeros, ones = pair
    total = zeros + ones
    bit = 1 if decoder.find(total) >= zeros else 0
    decoder.take(zeros if bit else 0, pair[bit], total)

    # Learn, and forget slowly.
    pair[bit] += _BIT_INCREMENT
    if total > _BIT_LIMIT:
        pair[0], pair[1] = max(pair[0] // 2, 1), max(pair[1] // 2, 1)
    return bit


def read_unsigned(decoder: RangeDecoder, counts: list[list[int]], context: int) -> int:
    """Read an integer v >= 0 by adaptive Exp-Golomb bins (J. Teuhola, 1978).

    It takes ``INTEGER_CONTEXTS`` contexts from ``context`` on.
    """
    # The exponent e of v + 1 in unary.
    exponent = 0
    while exponent < MAX_EXPONENT and read_bit(decoder, counts, context + exponent):
        exponent += 1

    # The e digits below the leading one; the first three have contexts.
    # As the value is 1 and then the digits so far, it is also the node of a binary tree of
    # contexts.
    value = 1
    tree = context + EXPONENT_CONTEXTS + TREE_NODES * exponent
    for _ in range(exponent):
        if value < TREE_NODES:
            bit = read_bit(decoder, counts, tree + value)
        else:
            bit = decoder.read_uniform(2)
        value = 2 * value + bit
    return value - 1


def read_signed(decoder: RangeDecoder, counts: list[list[int]], context: int) -> int:
    """Read an integer of either sign, folded to 2 v for v >= 0 and -2 v - 1 for v < 0."""
    folded = read_unsigned(decoder, counts, context)
    return folded // 2 if folded % 2 == 0 else -(folded + 1) // 2
