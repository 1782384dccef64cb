"""The range decoder on Python's integers; see :mod:`gpszip.codec.kernels.range_coder`."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["RangeDecoder"]

#: The range is kept at or above this.
_MIN_RANGE = 1 << 48

#: Largest word.
_ALL_ONES = (1 << 64) - 1

#: Bytes of a word.
_WORD_BYTES = 8

#: A decoder may take this many bytes past the end of its data (8 for the first word, 8 more).
_EXTRA_BYTES = 16


class RangeDecoder:
    """Reads symbols by their intervals.

    Parameters
    ----------
    data : bytes
        Those past its end read as zeros.

    Examples
    --------
    >>> decoder = RangeDecoder(bytes([200]))
    >>> [decoder.read_uniform(4) for _ in range(3)]
    [3, 0, 2]
    """

    __slots__ = ("_code", "_data", "_next_byte", "_range")

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._next_byte = _WORD_BYTES
        self._code = int.from_bytes(data[:_WORD_BYTES].ljust(_WORD_BYTES, b"\0"), "big")
        self._range = _ALL_ONES

    @property
    def is_exhausted(self) -> bool:
        """Whether more bytes were read past the end than any encoder leaves out."""
        return self._next_byte > len(self._data) + _EXTRA_BYTES

    def find(self, total: int) -> int:
        """Return the number in [0, total) that the code word points to.

        The symbol whose interval holds it is the next one; :meth:`take` then takes it out.
        """
        # The range is rarely a multiple of the total. What is left at its upper end, which no
        # encoder uses, counts as the last number.
        return min(self._code // (self._range // total), total - 1)

    def take(self, start: int, width: int, total: int) -> None:
        """Take out the symbol that owns the interval [start, start + width) of [0, total)."""
        share = self._range // total
        # Forged bytes may point below the interval, where a word wraps round.
        self._code = (self._code - share * start) & _ALL_ONES
        self._range = share * width
        while self._range < _MIN_RANGE:
            # An encoder leaves out zeros at the end, so that bytes past it are zeros.
            i = self._next_byte
            byte = self._data[i] if i < len(self._data) else 0
            self._code = (self._code << 8 | byte) & _ALL_ONES
            self._range <<= 8
            self._next_byte = i + 1

    def read_uniform(self, total: int) -> int:
        """Read a number below ``total``, all of which are equally likely."""
        number = self.find(total)
        self.take(number, 1, total)
        return number

    def read_choice(self, weights: Sequence[int]) -> int:
        """Read which of some candidates is chosen, with probabilities in proportion to weights."""
        total = sum(weights)
        number, choice, start = self.find(total), 0, 0
        while number >= start + weights[choice]:
            start += weights[choice]
            choice += 1
        self.take(start, weights[choice], total)
        return choice
