"""A range coder on integers, in one set of kernels for encoding, decoding and training.

Range coding (G. N. N. Martin, 1979) with a 64-bit range. Carries are propagated in the buffer, and
totals go up to 2**41. :func:`code_interval` takes the interval of a symbol whether the coder
encodes, decodes or listens. So each model is written once, and encoder and decoder cannot differ.
No floating point number decides anything.

A symbol owns the interval [start, start + width) of [0, total). With the coder's ``low`` (when it
encodes), ``code`` (when it decodes: the code word less the low of the encoder) and ``range``::

    share = range // total
    low   = low + share * start
    code  = code - share * start
    range = share * width
    while range < 2**48: shift low, code and range by one byte
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit_uncounted

__all__ = [
    "DECODES",
    "DIRECTION",
    "Coder",
    "bits_written",
    "code_binary",
    "code_bits",
    "code_interval",
    "count_bits",
    "decode_cumulative",
    "finish",
    "is_decoding",
    "is_exhausted",
    "new_decoder",
    "new_encoder",
    "new_listener",
]

#: Index of each number in ``Coder.words``.
_LOW = 0
_RANGE = 1
_CODE = 2

#: Index of each number in ``Coder.cursor``: the next byte of the buffer, and what the coder does.
_NEXT_BYTE = 0
DIRECTION = 1

#: What a coder does; one that listens neither writes nor reads.
_ENCODES = 0
DECODES = 1
_LISTENS = 2

#: The range is kept at or above this, so that a share of the largest total, 2**41, is at least 128.
_MIN_RANGE = np.uint64(1 << 48)

#: Shift that leaves the highest byte of a word.
_TOP_SHIFT = np.uint64(56)

#: Bits of a byte.
_BYTE_BITS = np.uint64(8)

#: The smallest and the largest word: the compiler must not mix unsigned words with signed ones.
_ZERO = np.uint64(0)
_ALL_ONES = np.uint64(0xFFFFFFFFFFFFFFFF)

#: Bytes of a word.
_WORD_BYTES = 8

#: A decoder may take this many bytes past the end of its data (8 for the first word, 8 more).
_EXTRA_BYTES = 16


class Coder(NamedTuple):
    """State of a coder, on arrays so that kernels change it in place.

    Parameters
    ----------
    words : uint64 array, shape (3,)
        Low, range and code word.
    cursor : int64 array, shape (2,)
        The next byte of ``data``, and whether the coder encodes, decodes or listens.
    data : uint8 array
        The bytes written, or to read.
    """

    words: NDArray[np.uint64]
    cursor: NDArray[np.int64]
    data: NDArray[np.uint8]


def new_listener() -> Coder:
    """Return a coder that neither writes nor reads, to train a model on what both sides know."""
    return Coder(
        np.array([0, 0xFFFFFFFFFFFFFFFF, 0], np.uint64),
        np.array([0, _LISTENS], np.int64),
        np.zeros(0, np.uint8),
    )


def new_encoder(capacity: int) -> Coder:
    """Return a coder that writes at most ``capacity`` bytes."""
    return Coder(
        np.array([0, 0xFFFFFFFFFFFFFFFF, 0], np.uint64),
        np.array([0, _ENCODES], np.int64),
        np.zeros(capacity + _EXTRA_BYTES, np.uint8),
    )


def new_decoder(data: bytes) -> Coder:
    """Return a coder that reads ``data``; bytes past its end read as zero."""
    padded = np.frombuffer(data + bytes(_WORD_BYTES), np.uint8).copy()
    code = int.from_bytes(padded[:_WORD_BYTES].tobytes(), "big")
    return Coder(
        np.array([0, 0xFFFFFFFFFFFFFFFF, code], np.uint64),
        np.array([_WORD_BYTES, DECODES], np.int64),
        padded,
    )


@inner_uncounted
def is_decoding(coder: Coder) -> bool:
    """Whether the coder reads symbols; otherwise it takes those that it is given."""
    return coder.cursor[DIRECTION] == DECODES


@inner_uncounted
def is_exhausted(coder: Coder) -> bool:
    """Whether a decoder has read more bytes past its end than any encoder leaves out."""
    # The buffer itself ends 8 bytes after the data.
    return coder.cursor[_NEXT_BYTE] > len(coder.data) + _WORD_BYTES


@inner_uncounted
def _carry(data: NDArray[np.uint8], end: int) -> None:
    """Add 1 to the bytes before ``end``, read as one big-endian number."""
    # a buffer that is too short is thrown away, and the symbols are encoded again in a longer one
    i = min(end, len(data)) - 1
    while i >= 0:
        data[i] += np.uint8(1)
        if data[i] != 0:
            return
        i -= 1


@inner_uncounted
def _narrow(coder: Coder, start: np.uint64, width: np.uint64) -> None:
    """Narrow the range to ``width`` from ``start`` on, and move the bytes that are certain."""
    # A listener neither writes nor reads; it only trains a model.
    words, cursor, data = coder.words, coder.cursor, coder.data
    if cursor[DIRECTION] == _LISTENS:
        return

    # Narrow the interval; where low wraps round, the bytes already written take a carry.
    if cursor[DIRECTION] == DECODES:
        words[_CODE] -= start
    else:
        low = words[_LOW] + start
        if low < start:
            _carry(data, cursor[_NEXT_BYTE])
        words[_LOW] = low
    words[_RANGE] = width

    # Shift bytes out (or in) until the range is large enough for the largest total.
    while words[_RANGE] < _MIN_RANGE:
        words[_RANGE] <<= _BYTE_BITS
        i = cursor[_NEXT_BYTE]
        if cursor[DIRECTION] == DECODES:
            byte = np.uint64(data[i]) if i < len(data) else _ZERO
            words[_CODE] = (words[_CODE] << _BYTE_BITS) | byte
        else:
            if i < len(data):
                data[i] = np.uint8(words[_LOW] >> _TOP_SHIFT)
            words[_LOW] <<= _BYTE_BITS
        cursor[_NEXT_BYTE] = i + 1


@jit_uncounted
def decode_cumulative(coder: Coder, total: int) -> int:
    """Return the number in [0, total) that the code word of a decoder points to.

    The symbol whose interval holds it is the decoded one; :func:`code_interval` then takes it out.
    """
    words = coder.words
    share = words[_RANGE] // np.uint64(total)
    return min(np.int64(words[_CODE] // share), np.int64(total) - 1)


@jit_uncounted
def code_interval(coder: Coder, start: int, width: int, total: int) -> None:
    """Code the interval [start, start + width) of [0, total), 1 <= width, total <= 2**41."""
    share = coder.words[_RANGE] // np.uint64(total)
    _narrow(coder, share * np.uint64(start), share * np.uint64(width))


@inner_uncounted
def code_binary(coder: Coder, probability: int, bit: int, digits: int) -> int:
    """Code a bit that is one with a probability in units of ``2**-digits``; return it.

    Ones own the lower end of the interval. This is :func:`decode_cumulative` and
    :func:`code_interval` without a division.
    """
    words = coder.words
    share = words[_RANGE] >> np.uint64(digits)
    ones = share * np.uint64(probability)
    if coder.cursor[DIRECTION] == DECODES:
        bit = 1 if words[_CODE] < ones else 0
    zeros = share * np.uint64((np.int64(1) << digits) - probability)
    _narrow(coder, _ZERO if bit else ones, ones if bit else zeros)
    return bit


@inner_uncounted
def code_bits(coder: Coder, value: int, count: int) -> int:
    """Code ``count`` <= 32 equally likely bits."""
    total = np.int64(1) << np.int64(count)
    if is_decoding(coder):
        value = decode_cumulative(coder, total)
    code_interval(coder, value, 1, total)
    return value


@inner_uncounted
def count_bits(coder: Coder) -> float:
    """Return how many bits have been written, to a fraction of a bit."""
    return 8.0 * coder.cursor[_NEXT_BYTE] + 64.0 - np.log2(np.float64(coder.words[_RANGE]))


def bits_written(coder: Coder) -> float:
    """Return how many bits have been written, to a fraction of a bit; for Python."""
    return 8.0 * int(coder.cursor[_NEXT_BYTE]) + 64.0 - math.log2(int(coder.words[_RANGE]))


@jit_uncounted
def _flush(coder: Coder) -> int:
    """Write the last bytes; return the number of bytes, which may be more than the buffer holds."""
    words, cursor, data = coder.words, coder.cursor, coder.data
    low, width = words[_LOW], words[_RANGE]

    # Find the number in [low, low + range) that ends in the most zero bytes.
    count = 0
    value = low
    while count < _WORD_BYTES:
        mask = _ALL_ONES >> np.uint64(8 * count) if count > 0 else _ALL_ONES
        value = (low + mask) & ~mask
        # The sum may wrap round, which is a carry; the difference is right all the same.
        if value - low < width:
            break
        count += 1
    if value < low:
        _carry(data, cursor[_NEXT_BYTE])

    # Write its bytes other than these zeros.
    end = cursor[_NEXT_BYTE]
    for i in range(count):
        if end + i < len(data):
            data[end + i] = np.uint8((value >> np.uint64(56 - 8 * i)) & np.uint64(0xFF))
    return end + count


def finish(coder: Coder) -> bytes | None:
    """Return the bytes written, as few as decode to the same; None if the buffer is too short.

    Zero bytes at the end are left out, since a decoder reads zeros there anyway. It stops 16 bytes
    past the end, so the zeros beyond that stay.
    """
    length = int(_flush(coder))
    if length > len(coder.data):
        return None
    data = coder.data[:length].tobytes()
    needed = int(coder.cursor[_NEXT_BYTE]) - _WORD_BYTES
    return data[: max(len(data.rstrip(b"\0")), needed)]
