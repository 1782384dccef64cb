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
    "GUIDE_INPUT",
    "INPUTS",
    "PROBABILITY_BITS",
    "TABLE_SIZE",
    "Decisions",
    "code_decision",
    "code_excess",
    "log_ratio",
    "new_decisions",
]

#: Contexts of a decision, each with a table of so many cells.
CONTEXTS = 3
TABLE_SIZE = 1 << 14

#: Inputs of the mixture: one from a distribution, one of each context, then where a column has a
#: guide one from the guide's distribution and one of its context.
INPUTS = 3 + CONTEXTS
_PLAIN_INPUTS = 1 + CONTEXTS
GUIDE_INPUT = 1 + CONTEXTS

#: Probabilities that are coded have so many bits, those in cells and their counts so many.
PROBABILITY_BITS = 16
_CELL_BITS = 20
_COUNT_BITS = 8
_COUNT_MASK = 255

#: A cell averages over about this many decisions at last.
_MAX_COUNT = 250

#: A probability in a cell stays this far from 0 and 1, of 2**20.
_MIN_CELL = 64

#: Numbers of the logistic domain are in units of 1/256, and the mixture's at most 12.
_UNIT = 256
_REACH = 12 * _UNIT

#: ``squash`` for -12 to 12, and ``logit`` of the middles of 4,096 bins of probabilities. No
#: entry lies near a half before it is rounded, so that they are the same on every machine.
_SQUASH = np.round((1 << PROBABILITY_BITS) / (1 + np.exp(-np.arange(-_REACH, _REACH + 1) / _UNIT)))
_SQUASH = np.clip(_SQUASH, 1, (1 << PROBABILITY_BITS) - 1).astype(np.int32)
_BINS = (np.arange(4096) + 0.5) / 4096
_LOGIT = np.round(_UNIT * np.log(_BINS / (1 - _BINS))).astype(np.int16)
_LOGIT_SHIFT = _CELL_BITS - 12 + _COUNT_BITS

#: Logarithms of 1 to 65,537 in units of 1/256.
_LOG = np.round(_UNIT * np.log(np.arange(1, (1 << PROBABILITY_BITS) + 2))).astype(np.int16)

#: Rate of a cell after n decisions, 1 / (n + 1.6), in units of 2**-16.
_CELL_RATE = np.round(65536 / (np.arange(_COUNT_MASK + 1) + 1.6)).astype(np.int64)

#: Rate of weights after n decisions, in units of 2**-20; measured on logs of many kinds.
_WEIGHT_USES = 1 << 12
_WEIGHT_RATE = np.round(4 + 26 * 100 / (100 + np.arange(_WEIGHT_USES))).astype(np.int64)
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
    """What has been learned of decisions, and workspace for one.

    Parameters
    ----------
    cells : int32 array, shape (CONTEXTS + 1, TABLE_SIZE)
        Probability of a one (20 bits) and number of decisions so far (8 bits).
    weights : int64 array, shape (sets, INPUTS)
        Weights of the mixture.
    uses : int64 array, shape (sets,)
        Decisions that each set of weights has made.
    inputs : int64 array, shape (INPUTS,)
        Predictions of one decision; the caller enters those from distributions.
    slots : uint32 array, shape (CONTEXTS + 1,)
        Cell of each context, which the caller enters.
    exponents : int32 array, shape (62,)
        Cells of the exponents of excesses.
    """

    cells: NDArray[np.int32]
    weights: NDArray[np.int64]
    uses: NDArray[np.int64]
    inputs: NDArray[np.int64]
    slots: NDArray[np.uint32]
    exponents: NDArray[np.int32]


def new_decisions(sets: int) -> Decisions:
    """Return decisions of which nothing is known, with so many sets of weights."""
    weights = np.full((sets, INPUTS), _FIRST_WEIGHT, np.int64)
    weights[:, 0] = _FIRST_RATIO_WEIGHT
    return Decisions(
        np.zeros((CONTEXTS + 1, TABLE_SIZE), np.int32),
        weights,
        np.zeros(sets, np.int64),
        np.zeros(INPUTS, np.int64),
        np.zeros(CONTEXTS + 1, np.uint32),
        np.full(_EXPONENTS, 1 << (_CELL_BITS - 1 + _COUNT_BITS), np.int32),
    )


@inner_uncounted
def log_ratio(above: int, below: int) -> int:
    """Return ``logit`` of the probability above / (above + below), both at most 65,536."""
    return np.int64(_LOG[np.uint32(above)]) - np.int64(_LOG[np.uint32(below)])


@inner_uncounted
def _moved(cell: int, bit: int) -> int:
    """Return a cell that has learned a bit: p + (bit - p) / (n + 1.6), and n + 1."""
    count = cell & _COUNT_MASK
    p = cell >> _COUNT_BITS
    p += (((bit << _CELL_BITS) - p) * _CELL_RATE[np.uint32(count)]) >> 16
    p = min(max(p, _MIN_CELL), (1 << _CELL_BITS) - _MIN_CELL)
    return (p << _COUNT_BITS) | min(count + 1, _MAX_COUNT)


@inner_uncounted
def _input_of(cell: int) -> int:
    """What a cell predicts: nothing, where it has seen nothing."""
    return np.int64(_LOGIT[np.uint32(cell >> _LOGIT_SHIFT)]) if cell & _COUNT_MASK else np.int64(0)


@inner_uncounted
def code_decision(
    coder: Coder, decisions: Decisions, weight_set: int, bit: int, guided: bool
) -> int:
    """Code a decision, and learn it.

    With inputs x and weights w, p = squash(w . x). Then w += rate * (bit - p) * x. A cell that has
    seen nothing has the input 0, and begins with p.

    Parameters
    ----------
    coder : Coder
        Encodes or decodes.
    decisions : Decisions
        Slots and the first input are entered.
    weight_set : int
        Row of the weights.
    bit : int
        The bit to encode; ignored by a decoder.
    guided : bool
        Whether the inputs and the slot of a guide are entered, too.
    """
    cells, weights, uses = decisions.cells, decisions.weights, decisions.uses
    inputs, slots = decisions.inputs, decisions.slots
    row = np.uint32(weight_set)

    # Predictions of the contexts, and their mixture.
    dot = weights[row, 0] * inputs[0]
    for k in range(CONTEXTS):
        cell = np.int64(cells[k, slots[k]])
        x = _input_of(cell)
        inputs[1 + k] = x
        dot += weights[row, 1 + k] * x
    if guided:
        cell = np.int64(cells[CONTEXTS, slots[CONTEXTS]])
        x = _input_of(cell)
        inputs[GUIDE_INPUT + 1] = x
        dot += weights[row, GUIDE_INPUT] * inputs[GUIDE_INPUT] + weights[row, GUIDE_INPUT + 1] * x
    dot = min(max(dot >> _WEIGHT_BITS, -_REACH), _REACH)
    probability = np.int64(_SQUASH[np.uint32(dot + _REACH)])
    bit = code_binary(coder, probability, bit, PROBABILITY_BITS)

    # Learn the weights.
    use = uses[row]
    error = ((np.int64(bit) << PROBABILITY_BITS) - probability) * _WEIGHT_RATE[np.uint32(use)]
    for k in range(INPUTS if guided else _PLAIN_INPUTS):
        weights[row, k] += (inputs[k] * error + _WEIGHT_HALF) >> _WEIGHT_SHIFT
    uses[row] = min(use + 1, _WEIGHT_USES - 1)

    # Learn the cells.
    for k in range(CONTEXTS + 1 if guided else CONTEXTS):
        cell = np.int64(cells[k, slots[k]])
        if cell & _COUNT_MASK == 0:
            cell = probability << (_CELL_BITS - PROBABILITY_BITS + _COUNT_BITS)
        cells[k, slots[k]] = _moved(cell, bit)
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
        exponents[exponent] = _moved(cell, more)
        if more == 0:
            break
        exponent += 1
    one = np.int64(1) << exponent
    return one - 1 + _code_chunks(coder, value + 1 - one, exponent)
