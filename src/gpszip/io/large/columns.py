"""Further columns of logs larger than memory: each value takes 64 bits, texts as numbers into a list of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.storage.temporary import read_numbers

__all__ = ["ColumnEncoder", "StoredColumn"]

#: What a column may hold; of two kinds in one column, the later one holds both, as when NumPy joins arrays.
_INTEGERS, _FLOATS, _TEXTS = range(3)

#: Values that are converted at a time, and bytes that a different text takes besides its letters.
_CHUNK, _TEXT_BYTES = 1 << 20, 200

Values = NDArray[np.generic]
Rows = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StoredColumn:
    """A column in a file, 64 bits for each row.

    Parameters
    ----------
    name : str
        Its name.
    kind : str
        Kind of its values as NumPy calls it: ``i`` whole numbers, ``f`` numbers, ``U`` texts.
    texts : tuple of str
        All texts in it in alphabetical order, for numbers into which it is stored.
    """

    name: str
    kind: str
    path: Path
    texts: tuple[str, ...] = ()
    _ranks: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def chunks(self, first: int = 0, count: int | None = None) -> Iterator[Values]:
        """Yield so many values from a row on, in pieces; numbers into ``texts`` where it holds texts."""
        last = self.path.stat().st_size // 8 if count is None else first + count
        for row in range(first, last, _CHUNK):
            found = read_numbers(
                self.path,
                np.float64 if self.kind == "f" else np.int64,
                row,
                min(_CHUNK, last - row),
            )
            yield self._ranks[found] if self.kind == "U" else found


class ColumnEncoder:
    """Turns batches of columns into rows of 64 bits a value, and at last all of them into one kind for each column.

    Parameters
    ----------
    names : sequence of str
        The columns.
    text_capacity : int
        Bytes that different texts may take.
    """

    def __init__(self, names: Sequence[str], text_capacity: int) -> None:
        self.names, self.text_capacity = tuple(names), text_capacity
        self.kinds = (_INTEGERS,) * len(self.names)
        self._text_codes: list[dict[str, int]] = [{} for _ in names]
        self._reserved = 0

    def encode(
        self, attributes: Mapping[str, Values], good: NDArray[np.bool_], where: str
    ) -> tuple[Rows, tuple[int, ...]]:
        """Rows of the values that are to be kept, and what each column of them holds."""
        lacking = next((name for name in self.names if name not in attributes), None)
        if lacking is not None:
            there = ", ".join(attributes) or "none"
            raise InputError(f"{where}: has no column {lacking!r} to keep; it has {there}")
        columns = [attributes[name][good] for name in self.names]
        kinds = tuple(
            {"i": _INTEGERS, "f": _FLOATS}.get(values.dtype.kind, _TEXTS) for values in columns
        )
        encoded = [
            self._encode_column(number, values, kind)
            for number, (values, kind) in enumerate(zip(columns, kinds, strict=True))
        ]
        return _stack_columns(encoded, int(good.sum())), kinds

    def join(self, kinds: Sequence[tuple[int, ...]]) -> None:
        """Take note that batches of these kinds are to stay."""
        self.kinds = tuple(max(each) for each in zip(self.kinds, *kinds, strict=True))

    def convert(self, rows: Rows, kinds: Sequence[int]) -> Rows:
        """Rows of some kinds as those that hold all batches."""
        if tuple(kinds) == self.kinds:
            return rows
        encoded = [
            self._convert_column(i, rows[:, i], old, new)
            for i, (old, new) in enumerate(zip(kinds, self.kinds, strict=True))
        ]
        return _stack_columns(encoded, len(rows))

    def stored_column(self, number: int, path: Path) -> StoredColumn:
        """Return a column of which all rows are in a file."""
        name, kind = self.names[number], "ifU"[self.kinds[number]]
        if kind != "U":
            return StoredColumn(name, kind, path)
        every, used = (
            list(self._text_codes[number]),
            np.zeros(len(self._text_codes[number]), np.bool_),
        )
        for codes in StoredColumn(name, "i", path).chunks():
            used[codes] = True
        order = sorted(np.flatnonzero(used).tolist(), key=every.__getitem__)
        ranks = np.zeros(len(every), np.int64)
        ranks[order] = np.arange(len(order))
        return StoredColumn(name, kind, path, tuple(every[i] for i in order), ranks)

    def _encode_column(self, number: int, values: Values, kind: int) -> NDArray[np.float64]:
        if kind == _TEXTS:
            return self._encode_texts(number, values)
        return values.astype(np.int64 if kind == _INTEGERS else np.float64).view(np.float64)

    def _convert_column(self, number: int, slot: Rows, old: int, new: int) -> NDArray[np.float64]:
        if old == new:
            return np.ascontiguousarray(slot)
        values = np.ascontiguousarray(slot).view(np.int64 if old == _INTEGERS else np.float64)
        return (
            values.astype(np.float64)
            if new == _FLOATS
            else self._encode_texts(number, values.astype(np.str_))
        )

    def _encode_texts(self, number: int, values: Values) -> NDArray[np.float64]:
        """Numbers for texts, new ones for those that are new."""
        found = pa.array(values.tolist(), pa.string()).dictionary_encode()
        codes, there = np.zeros(len(found.dictionary), np.int64), self._text_codes[number]
        for i, text in enumerate(found.dictionary.to_pylist()):
            if text not in there:
                self._reserve(len(text), self.names[number])
            codes[i] = there.setdefault(text, len(there))
        encoded: NDArray[np.float64] = codes[found.indices.to_numpy()].view(np.float64)
        return encoded

    def _reserve(self, letters: int, name: str) -> None:
        self._reserved += letters + _TEXT_BYTES
        if self._reserved > self.text_capacity:
            raise InputError(
                f"column {name!r} holds more different texts than there is memory for; allow more memory, or don't keep it"
            )


def _stack_columns(encoded: Sequence[NDArray[np.float64]], rows: int) -> Rows:
    return np.stack(encoded, axis=1) if encoded else np.empty((rows, 0))
