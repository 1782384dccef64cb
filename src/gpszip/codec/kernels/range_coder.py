"""A range coder on integers: 64-bit range, carries propagated in the buffer, totals up to 2**41.

One set of kernels writes and reads: ``code_interval`` takes the interval of a symbol in either direction, so that a model
is written once and can't differ between coder and decoder. No floating point number takes part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = [
    "Coder",
    "code_bits",
    "code_interval",
    "count_bits",
    "decode_cumulative",
    "finish",
    "new_decoder",
    "new_encoder",
    "new_listener",
]

_LOW, _RANGE, _CODE = 0, 1, 2
_CURSOR, _DIRECTION = 0, 1

#: Directions.
_WRITES, _READS, _LISTENS = 0, 1, 2

#: The range is kept at or above this; a total may be at most 2**41.
_FLOOR = np.uint64(1 << 48)
_TOP = np.uint64(56)
_BYTE = np.uint64(8)
_ONE = np.uint64(1)
_ZERO = np.uint64(0)
_FULL = np.uint64(0xFFFFFFFFFFFFFFFF)


class Coder(NamedTuple):
    """State of a coder: low, range and code word; cursor and direction; the bytes."""

    words: NDArray[np.uint64]
    cursor: NDArray[np.int64]
    data: NDArray[np.uint8]


def new_listener() -> Coder:
    """Return a coder that neither writes nor reads, for a model that is to learn what both sides know."""
    return Coder(
        np.array([0, 0xFFFFFFFFFFFFFFFF, 0], np.uint64),
        np.array([0, _LISTENS], np.int64),
        np.zeros(0, np.uint8),
    )


def new_encoder(capacity: int) -> Coder:
    """Return a coder that writes at most ``capacity`` bytes."""
    words = np.array([0, 0xFFFFFFFFFFFFFFFF, 0], np.uint64)
    return Coder(words, np.zeros(2, np.int64), np.zeros(capacity + 16, np.uint8))


def new_decoder(data: bytes) -> Coder:
    """Return a coder that reads ``data``; bytes past its end read as zero."""
    source = np.frombuffer(data + bytes(8), np.uint8).copy()
    words = np.array(
        [0, 0xFFFFFFFFFFFFFFFF, int.from_bytes(source[:8].tobytes(), "big")], np.uint64
    )
    return Coder(words, np.array([8, 1], np.int64), source)


@jit
def _carry(data: NDArray[np.uint8], end: int) -> None:
    # what did not fit is written anew by a writer of more room
    at = min(end, len(data)) - 1
    while at >= 0:
        data[at] += np.uint8(1)
        if data[at] != 0:
            return
        at -= 1


@jit
def _narrow(coder: Coder, start: np.uint64, width: np.uint64) -> None:
    words, cursor, data = coder
    if cursor[_DIRECTION] == _LISTENS:
        return
    if cursor[_DIRECTION] == _READS:
        words[_CODE] -= start
    else:
        low = words[_LOW] + start
        if low < start:
            _carry(data, cursor[_CURSOR])
        words[_LOW] = low
    words[_RANGE] = width
    while words[_RANGE] < _FLOOR:
        words[_RANGE] <<= _BYTE
        at = cursor[_CURSOR]
        if cursor[_DIRECTION] == _READS:
            following = np.uint64(data[at]) if at < len(data) else _ZERO
            words[_CODE] = (words[_CODE] << _BYTE) | following
        else:
            if at < len(data):
                data[at] = np.uint8(words[_LOW] >> _TOP)
            words[_LOW] <<= _BYTE
        cursor[_CURSOR] = at + 1


@jit
def decode_cumulative(coder: Coder, total: int) -> int:
    """Return where in [0, total) the code word of a reader lies."""
    words = coder.words
    share = words[_RANGE] // np.uint64(total)
    return min(np.int64(words[_CODE] // share), np.int64(total) - 1)


@jit
def code_interval(coder: Coder, start: int, width: int, total: int) -> None:
    """Code the interval [start, start + width) of [0, total), 1 <= width, total <= 2**41."""
    share = coder.words[_RANGE] // np.uint64(total)
    _narrow(coder, share * np.uint64(start), share * np.uint64(width))


@jit
def code_bits(coder: Coder, value: int, count: int) -> int:
    """Code ``count`` <= 32 equally likely bits."""
    total = np.int64(1) << np.int64(count)
    if coder.cursor[_DIRECTION] == _READS:
        value = decode_cumulative(coder, total)
    code_interval(coder, value, 1, total)
    return value


@jit
def count_bits(coder: Coder) -> float:
    """Return how many bits have been written, to a fraction of a bit."""
    return 8.0 * coder.cursor[_CURSOR] + 64.0 - np.log2(np.float64(coder.words[_RANGE]))


@jit
def _end(coder: Coder) -> int:
    words, cursor, data = coder
    low, width = words[_LOW], words[_RANGE]
    count = 0
    value = low
    while count < 8:
        mask = _FULL >> np.uint64(8 * count) if count > 0 else _FULL
        value = (low + mask) & ~mask
        # the sum may wrap, which is a carry; the distance is right all the same
        if value - low < width:
            break
        count += 1
    if value < low:
        _carry(data, cursor[_CURSOR])
    at = cursor[_CURSOR]
    for i in range(count):
        if at + i < len(data):
            data[at + i] = np.uint8((value >> np.uint64(56 - 8 * i)) & np.uint64(0xFF))
    return at + count


def finish(coder: Coder) -> bytes | None:
    """Return the bytes written, as few as decode to the same; None if they did not fit.

    Zeros at the end are left out, but for those that a reader would miss which stops 16 bytes past the end.
    """
    length = int(_end(coder))
    if length > len(coder.data):
        return None
    data = coder.data[:length].tobytes()
    return data[: max(len(data.rstrip(b"\0")), int(coder.cursor[_CURSOR]) - 8)]
