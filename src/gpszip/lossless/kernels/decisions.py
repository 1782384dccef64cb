"""Binary decisions whose probability is a mixture of several predictions.

Each prediction is a number of the logistic domain, ``logit(p) = ln(p / (1 - p))``. The mixture is
``squash(sum of weight * prediction)``, and the weights descend the gradient of the code length
(M. Mahoney, "Adaptive weighing of context models for lossless data compression", 2005). Everything
is integer arithmetic, so that every machine codes and decodes the same bytes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.range_coder import Coder, code_binary, code_bits
from gpszip.kernels.jit import inner_uncounted

__all__ = [
    "CONTEXTS",
    "PROBABILITY_BITS",
    "TABLE_SIZE",
    "Decisions",
    "code_decision",
    "code_excess",
    "log_ratio",
    "new_decisions",
]

#: Contexts of a decision at most, each with a table of so many cells.
CONTEXTS = 3
TABLE_SIZE = 1 << 14

#: A set has a weight for each input: one from a distribution, one of each context, then where a
#: column has a guide one from the guide's distribution and one of its context. The number of its
#: decisions follows; eight numbers are a cache line.
_USES = 6
_SET_SIZE = 8

#: Probabilities that are coded have so many bits, those in cells and their counts so many.
PROBABILITY_BITS = 16
_CELL_BITS = 20
_COUNT_BITS = 8
_COUNT_MASK = 255

#: A cell averages over about this many decisions at last.
_MAX_COUNT = 250

#: A cell that has seen nothing: a half, whose logit is rounded to 0.
_NEW_CELL = 1 << (_CELL_BITS - 1 + _COUNT_BITS)

#: A probability in a cell stays this far from 0 and 1, of 2**20.
_MIN_CELL = 64

#: Numbers of the logistic domain are in units of 1/256, and the mixture's at most 12.
_UNIT = 256
_REACH = 12 * _UNIT

#: ``squash`` for -12 to 12, and ``logit`` of the middles of 4,096 bins of probabilities. No
#: entry lies near a half before it is rounded, so that they are the same on every machine.
_SQUASH = np.round((1 << PROBABILITY_BITS) / (1 + np.exp(-np.arange(-_REACH, _REACH + 1) / _UNIT)))
_SQUASH = np.clip(_SQUASH, 1, (1 << PROBABILITY_BITS) - 1).astype(np.uint16)
_BINS = (np.arange(4096) + 0.5) / 4096
_LOGIT = np.round(_UNIT * np.log(_BINS / (1 - _BINS))).astype(np.int16)
_LOGIT_SHIFT = _CELL_BITS - 12 + _COUNT_BITS

#: Logarithms of 1 to 65,537 in units of 1/256.
_LOG = np.round(_UNIT * np.log(np.arange(1, (1 << PROBABILITY_BITS) + 2))).astype(np.int16)

#: Rate of a cell after n decisions, 1 / (n + 1.6), in units of 2**-16.
_CELL_RATE = np.round(65536 / (np.arange(_COUNT_MASK + 1) + 1.6)).astype(np.uint16)

#: Rate of weights after n decisions, in units of 2**-20; measured on logs of many kinds.
_WEIGHT_USES = 1 << 12
_WEIGHT_RATE = np.round(4 + 26 * 100 / (100 + np.arange(_WEIGHT_USES))).astype(np.uint8)
_WEIGHT_SHIFT = 20
_WEIGHT_HALF = 1 << 19

#: Weights are in units of 2**-16; that of the distribution begins with 0.6, others with 0.25.
_WEIGHT_BITS = 16
_FIRST_RATIO_WEIGHT = 39322
_FIRST_WEIGHT = 16384

#: Exponents of the numbers past the last bin, and bits that are coded at once.
_EXPONENTS = 62
_CHUNK_BITS = 32


class Decisions(NamedTuple):
    """What has been learned of decisions.

    Parameters
    ----------
    cells : int32 array, shape ((CONTEXTS + 1) * TABLE_SIZE,)
        Probability of a one (20 bits) and number of decisions so far (8 bits), of one context after
        the other.
    weights : int64 array, shape (8 * sets,)
        For each set six weights of the mixture, and how many decisions it has made.
    exponents : int32 array, shape (62,)
        Cells of the exponents of excesses.
    """

    cells: NDArray[np.int32]
    weights: NDArray[np.int64]
    exponents: NDArray[np.int32]


def new_decisions(sets: int) -> Decisions:
    """Return decisions of which nothing is known, with so many sets of weights."""
    weights = np.full((sets, _SET_SIZE), _FIRST_WEIGHT, np.int64)
    weights[:, 0] = _FIRST_RATIO_WEIGHT
    weights[:, _USES] = 0
    return Decisions(
        np.full((CONTEXTS + 1) * TABLE_SIZE, _NEW_CELL, np.int32),
        weights.ravel(),
        np.full(_EXPONENTS, _NEW_CELL, np.int32),
    )


@inner_uncounted
def log_ratio(above: int, below: int) -> int:
    """Return ``logit`` of the probability above / (above + below), both at most 65,536."""
    return np.int64(_LOG[np.uint32(above)]) - np.int64(_LOG[np.uint32(below)])


@inner_uncounted
def _moved(cell: int, probability: int, bit: int) -> int:
    """Return a cell that has learned a bit: p + (bit - p) / (n + 1.6), and n + 1.

    One that has seen nothing begins with the probability of the mixture.
    """
    count = cell & _COUNT_MASK
    p = cell >> _COUNT_BITS if count > 0 else probability << (_CELL_BITS - PROBABILITY_BITS)
    p += (((bit << _CELL_BITS) - p) * np.int64(_CELL_RATE[np.uint32(count)])) >> 16
    p = min(max(p, _MIN_CELL), (1 << _CELL_BITS) - _MIN_CELL)
    return (p << _COUNT_BITS) | min(count + 1, _MAX_COUNT)


@inner_uncounted
def _input_of(cell: int) -> int:
    """What a cell predicts; 0 where it has seen nothing, since it begins with a half."""
    return np.int64(_LOGIT[np.uint32(cell >> _LOGIT_SHIFT)])


@inner_uncounted
def code_decision(
    coder: Coder,
    decisions: Decisions,
    weight_set: int,
    bit: int,
    has_third: bool,
    guided: bool,
    ratio: int,
    slots: tuple[int, int, int],
    guide_ratio: int,
    guide_slot: int,
) -> int:
    """Code a decision, and learn it.

    With inputs x and weights w, p = squash(w . x). Then w += rate * (bit - p) * x. A cell that has
    seen nothing has the input 0, and begins with p.

    Parameters
    ----------
    coder : Coder
        Encodes or decodes.
    decisions : Decisions
        What has been learned.
    weight_set : int
        Row of the weights.
    bit : int
        The bit to encode; ignored by a decoder.
    has_third, guided : bool
        Whether there is a third context, and whether there are inputs of a guide. Without a third
        one, the guide's context stands in place of the second.
    ratio, slots : int and tuple of int
        Input from the distribution, and the cell of each context.
    guide_ratio, guide_slot : int
        The same from a guide.
    """
    cells, weights = decisions.cells, decisions.weights
    first = np.uint32(weight_set) * np.uint32(_SET_SIZE)
    second, third, use_at = first + np.uint32(1), first + np.uint32(2), first + np.uint32(_USES)
    fourth, fifth, sixth = first + np.uint32(3), first + np.uint32(4), first + np.uint32(5)
    slot_d = np.uint32(guide_slot + 3 * TABLE_SIZE)
    slot, slot_c = np.uint32(slots[0]), np.uint32(slots[2] + 2 * TABLE_SIZE)
    slot_b = np.uint32(slots[1] + TABLE_SIZE)
    if guided and not has_third:
        slot_b = slot_d

    # Predictions of the contexts, and their mixture. Scalars: arrays would go through memory.
    a, b = np.int64(cells[slot]), np.int64(cells[slot_b])
    x, y = _input_of(a), _input_of(b)
    dot = weights[first] * ratio + weights[second] * x + weights[third] * y
    c, z = np.int64(0), np.int64(0)
    if has_third:
        c = np.int64(cells[slot_c])
        z = _input_of(c)
        dot += weights[fourth] * z
    d, v = np.int64(0), np.int64(0)
    if guided:
        dot += weights[fifth] * guide_ratio
        if has_third:
            d = np.int64(cells[slot_d])
            v = _input_of(d)
            dot += weights[sixth] * v
    dot = min(max(dot >> _WEIGHT_BITS, -_REACH), _REACH)
    probability = np.int64(_SQUASH[np.uint32(dot + _REACH)])
    bit = code_binary(coder, probability, bit, PROBABILITY_BITS)

    # Learn the weights.
    use = weights[use_at]
    error = ((np.int64(bit) << PROBABILITY_BITS) - probability) * np.int64(
        _WEIGHT_RATE[np.uint32(use)]
    )
    weights[first] += (ratio * error + _WEIGHT_HALF) >> _WEIGHT_SHIFT
    weights[second] += (x * error + _WEIGHT_HALF) >> _WEIGHT_SHIFT
    weights[third] += (y * error + _WEIGHT_HALF) >> _WEIGHT_SHIFT
    weights[use_at] = min(use + 1, _WEIGHT_USES - 1)

    # Learn the cells.
    cells[slot] = _moved(a, probability, bit)
    cells[slot_b] = _moved(b, probability, bit)
    if guided:
        weights[fifth] += (guide_ratio * error + _WEIGHT_HALF) >> _WEIGHT_SHIFT
    if has_third:
        weights[fourth] += (z * error + _WEIGHT_HALF) >> _WEIGHT_SHIFT
        cells[slot_c] = _moved(c, probability, bit)
        if guided:
            weights[sixth] += (v * error + _WEIGHT_HALF) >> _WEIGHT_SHIFT
            cells[slot_d] = _moved(d, probability, bit)
    return bit


@inner_uncounted
def _code_chunks(coder: Coder, value: int, count: int) -> int:
    """Code ``count`` equally likely bits."""
    coded = np.int64(0)
    while count > 0:
        chunk = min(count, _CHUNK_BITS)
        count -= chunk
        part = (value >> count) & ((np.int64(1) << chunk) - 1)
        coded = (coded << chunk) | code_bits(coder, part, chunk)
    return coded


@inner_uncounted
def code_excess(coder: Coder, decisions: Decisions, value: int) -> int:
    """Code an integer in [0, 2**62): its number of digits in unary, the digits as they are."""
    exponents = decisions.exponents
    exponent = np.int64(0)
    while exponent < _EXPONENTS - 1:
        cell = np.int64(exponents[exponent])
        probability = max(cell >> (_COUNT_BITS + _CELL_BITS - PROBABILITY_BITS), 1)
        bit = 1 if (value + 1) >> (exponent + 1) else 0
        more = code_binary(coder, probability, bit, PROBABILITY_BITS)
        exponents[exponent] = _moved(cell, probability, more)
        if more == 0:
            break
        exponent += 1
    one = np.int64(1) << exponent
    return one - 1 + _code_chunks(coder, value + 1 - one, exponent)
