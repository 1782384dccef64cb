"""Kept columns of logs larger than memory.

Each value takes 64 bits on disk. Texts are stored as codes, which are indices into a list of all
texts of the column. :class:`ColumnEncoder` encodes batches; :class:`StoredColumn` reads the result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.storage.temporary import read_numbers

__all__ = ["ColumnEncoder", "ColumnKind", "EncodedBatch", "StoredColumn"]

#: Values that are read and converted at a time: 8 MiB.
_CHUNK_VALUES = 1 << 20

#: Bytes that a text takes in memory besides its letters: the string object and its entry in a dict.
_TEXT_OVERHEAD_BYTES = 200

Values = NDArray[np.generic]
Floats = NDArray[np.float64]


class ColumnKind(IntEnum):
    """What a column holds. The larger of two kinds can hold both, as when NumPy joins arrays."""

    INTEGERS = 0
    FLOATS = 1
    TEXTS = 2


#: Kinds of columns, as :attr:`numpy.dtype.kind` writes them.
_DTYPE_KINDS = {
    ColumnKind.INTEGERS: "i",
    ColumnKind.FLOATS: "f",
    ColumnKind.TEXTS: "U",
}

Kinds = tuple[ColumnKind, ...]


class EncodedBatch(NamedTuple):
    """Columns of a batch of rows.

    Parameters
    ----------
    values : float64 array, shape (n, k)
        64 bits for each value. Integers and codes of texts are stored as their bits.
    kinds : tuple of ColumnKind
        What each column holds.
    """

    values: Floats
    kinds: Kinds


@dataclass(frozen=True, eq=False)
class StoredColumn:
    """A column in a file, 64 bits for each row.

    Parameters
    ----------
    name : str
        Its name.
    kind : str
        Kind of its values as NumPy writes it: ``i`` integers, ``f`` floats, ``U`` texts.
    path : Path
        The file.
    texts : tuple of str
        All texts of the column in alphabetical order; empty for numbers.
    """

    name: str
    kind: str
    path: Path
    texts: tuple[str, ...] = ()
    _text_index: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def chunks(self, first: int = 0, count: int | None = None) -> Iterator[Values]:
        """Yield values in chunks; for texts, indices into ``texts``.

        Parameters
        ----------
        first : int
            Index of the first row.
        count : int, optional
            Number of rows; all up to the end if left out.
        """
        # Each row takes 8 bytes; codes of texts are integers.
        last = self.path.stat().st_size // 8 if count is None else first + count
        dtype = np.float64 if self.kind == "f" else np.int64
        for row in range(first, last, _CHUNK_VALUES):
            stored = read_numbers(self.path, dtype, row, min(_CHUNK_VALUES, last - row))
            yield self._text_index[stored] if self.kind == "U" else stored


class ColumnEncoder:
    """Encodes batches of columns, and finds one kind for each column that holds all batches.

    Parameters
    ----------
    names : sequence of str
        Names of the columns.
    text_capacity : int
        Bytes of memory for distinct texts.
    optional : sequence of str
        Names of columns of numbers that may be missing: NaN there.
    """

    def __init__(
        self, names: Sequence[str], text_capacity: int, *, optional: Sequence[str] = ()
    ) -> None:
        self.names = tuple(names)
        self.optional = tuple(optional)
        self.text_capacity = text_capacity
        self.kinds: Kinds = (ColumnKind.INTEGERS,) * len(self.names)
        self._text_codes: list[dict[str, int]] = [{} for _ in names]
        self._text_bytes = 0

    def encode(self, attributes: Mapping[str, Values], rows: int, where: str) -> EncodedBatch:
        """Encode the columns of a batch.

        Parameters
        ----------
        attributes : mapping of str to array, shape (n,)
            All columns of the batch.
        rows : int
            Number of rows n.
        where : str
            Name of the log in messages.

        Raises
        ------
        InputError
            If a column is missing, or there are more distinct texts than fit in memory.
        """
        # Files may differ in their columns, but each needs those to keep unless they are optional.
        lacking = [name for name in self.optional if name not in attributes]
        attributes = {**attributes, **dict.fromkeys(lacking, np.full(rows, np.nan))}
        missing = next((name for name in self.names if name not in attributes), None)
        if missing is not None:
            available = ", ".join(attributes) or "none"
            raise InputError(
                f"has no column {missing!r} to keep", path=where, remedy=f"it has {available}"
            )

        columns = [attributes[name] for name in self.names]
        kinds = tuple(map(_kind_of, columns))
        encoded = [
            self._encode_column(number, values, kind)
            for number, (values, kind) in enumerate(zip(columns, kinds, strict=True))
        ]
        return EncodedBatch(_stack_columns(encoded, rows), kinds)

    def join(self, batches: Sequence[Kinds]) -> None:
        """Widen the kinds of the columns so that they can hold batches of these kinds."""
        self.kinds = tuple(max(kinds) for kinds in zip(self.kinds, *batches, strict=True))

    def convert(self, batch: EncodedBatch) -> Floats:
        """Return the values of a batch, converted to the kinds that hold all batches."""
        if batch.kinds == self.kinds:
            return batch.values
        converted = [
            self._convert_column(i, batch.values[:, i], old, new)
            for i, (old, new) in enumerate(zip(batch.kinds, self.kinds, strict=True))
        ]
        return _stack_columns(converted, len(batch.values))

    def stored_column(self, number: int, path: Path) -> StoredColumn:
        """Return the column of this number, whose converted values are in a file."""
        # Numbers need no index of texts.
        name, kind = self.names[number], self.kinds[number]
        if kind != ColumnKind.TEXTS:
            return StoredColumn(name, _DTYPE_KINDS[kind], path)

        # Find the texts in use: rows that were dropped later may have brought others.
        texts = list(self._text_codes[number])
        is_used = np.zeros(len(texts), np.bool_)
        for codes in StoredColumn(name, _DTYPE_KINDS[ColumnKind.INTEGERS], path).chunks():
            is_used[codes] = True

        # Number them in alphabetical order.
        order = sorted(np.flatnonzero(is_used).tolist(), key=texts.__getitem__)
        text_index = np.zeros(len(texts), np.int64)
        text_index[order] = np.arange(len(order))
        sorted_texts = tuple(texts[i] for i in order)
        return StoredColumn(name, _DTYPE_KINDS[kind], path, sorted_texts, text_index)

    def _encode_column(self, number: int, values: Values, kind: ColumnKind) -> Floats:
        if kind == ColumnKind.TEXTS:
            return self._encode_texts(number, values)
        dtype = np.int64 if kind == ColumnKind.INTEGERS else np.float64
        # The bits of an int64 pass for a float64, so that all columns of a row share one array.
        return values.astype(dtype).view(np.float64)

    def _convert_column(
        self, number: int, encoded: Floats, old: ColumnKind, new: ColumnKind
    ) -> Floats:
        # A column of a table is not contiguous, as the view of its bits requires.
        encoded = np.ascontiguousarray(encoded)
        if old == new:
            return encoded
        # Texts are the widest kind, so that a column to convert holds numbers.
        values = encoded.view(np.int64 if old == ColumnKind.INTEGERS else np.float64)
        if new == ColumnKind.FLOATS:
            return values.astype(np.float64)
        return self._encode_texts(number, values.astype(np.str_))

    def _encode_texts(self, number: int, values: Values) -> Floats:
        """Return the codes of texts as bits; a new text gets the next free code."""
        # Arrow finds the distinct texts, so that the loop is over these alone.
        batch = pa.array(values.tolist(), pa.string()).dictionary_encode()
        known_codes = self._text_codes[number]
        codes = np.zeros(len(batch.dictionary), np.int64)
        for i, text in enumerate(batch.dictionary.to_pylist()):
            if text not in known_codes:
                self._reserve(len(text), self.names[number])
            codes[i] = known_codes.setdefault(text, len(known_codes))
        encoded: Floats = codes[batch.indices.to_numpy()].view(np.float64)
        return encoded

    def _reserve(self, letters: int, name: str) -> None:
        """Count the memory of a new text."""
        self._text_bytes += letters + _TEXT_OVERHEAD_BYTES
        if self._text_bytes > self.text_capacity:
            raise InputError(
                f"column {name!r} holds more distinct texts than there is memory for",
                remedy="allow more memory, or don't keep it",
            )


def _kind_of(values: Values) -> ColumnKind:
    """Return the kind of a column's values; booleans and times are kept as texts."""
    by_dtype = {"i": ColumnKind.INTEGERS, "f": ColumnKind.FLOATS}
    return by_dtype.get(values.dtype.kind, ColumnKind.TEXTS)


def _stack_columns(encoded: Sequence[Floats], rows: int) -> Floats:
    return np.stack(encoded, axis=1) if encoded else np.empty((rows, 0))
