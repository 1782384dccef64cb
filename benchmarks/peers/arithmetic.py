"""Adaptive arithmetic coding of a table of integers, with the integer coder of GPSZip itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.integer_contexts import INTEGER_CONTEXTS
from gpszip.codec.kernels.adaptive import code_signed
from gpszip.codec.kernels.range_coder import Coder, finish, new_decoder, new_encoder
from gpszip.kernels.jit import jit_uncounted

from .log import Integers

#: Classes of the number before, by the digits of its magnitude; the last holds all larger ones.
CLASSES = 6

#: Digits of a magnitude that one class spans.
DIGITS_OF_CLASS = 3

#: Count of zeros and of ones that a new context begins with.
FIRST_COUNT = 10

#: Bytes that a number takes at most.
BYTES_OF_NUMBER = 16


def encode(table: Integers) -> bytes:
    """Code row by row, in one context for each column, or in several by the number before."""
    coded = []
    for classes in (1, CLASSES):
        coder = new_encoder(64 + BYTES_OF_NUMBER * table.size)
        _code_table(coder, new_counts(table.shape[1], classes), table.copy(), classes)
        coded.append(bytes([classes]) + (finish(coder) or b""))
    return min(coded, key=len)


def decode(data: bytes, rows: int, columns: int) -> Integers:
    table = np.zeros((rows, columns), np.int64)
    _code_table(new_decoder(data[1:]), new_counts(columns, data[0]), table, data[0])
    return table


def new_counts(columns: int, classes: int) -> NDArray[np.int32]:
    return np.full((columns * classes * INTEGER_CONTEXTS, 2), FIRST_COUNT, np.int32)


@jit_uncounted
def _code_table(coder: Coder, counts: NDArray[np.int32], table: Integers, classes: int) -> None:
    """Code all numbers, the class of each by the number before it in its row or the row above."""
    columns = table.shape[1]
    previous = np.int64(0)
    for row in range(table.shape[0]):
        for column in range(columns):
            # The class of the number before.
            magnitude, digits = abs(previous), 0
            while magnitude > 0:
                magnitude >>= 1
                digits += 1
            of_class = min((digits + 1) // DIGITS_OF_CLASS, classes - 1)

            context = (column * classes + of_class) * INTEGER_CONTEXTS
            previous = code_signed(coder, counts, context, table[row, column])
            table[row, column] = previous
