"""Short lists of names by an adaptive model of text: each bit costs what the names so far say about it.

Counts of ones and zeros are kept for several contexts of a byte and added up with weights, as in the first PAQ; all
numbers are integers, so that every machine decodes the same text. docs/format.md specifies each step.
"""

from __future__ import annotations

from functools import lru_cache

from gpszip.errors import CorruptArchiveError

__all__ = ["MODEL_LIMIT", "encode_text", "read_text"]

#: Longest text, newlines included, that the model takes: it spends some 50 microseconds on a byte.
MODEL_LIMIT = 1 << 13

#: What the model has read before the first name: the letters, words and dates of which names are made.
PRIME = (
    b"track_1\nvehicle_02\nwalk-3\nrobot4\ntaxi_05\nbus 6\ntrip7\nroute8\ndrive_9\nride\nrun\nbike\ncar\ntruck\nship\nflight\n"
    b"sensor_a\ndevice-b\nagent\nuser01\nsession_1\ntest_2\nindoor\noutdoor\nlab\nhouse\nfield\nfarm\npark\nstation\ncampus\n"
    b"morning\nevening\ncenter\nnorth_side\nsouth\neast\nwest\nfinal_version\nmap_data\nlong_loop\nreference\nstreet\ncity\n"
    b"2019-11-05T08:30:00Z\n2023-06-17 14:25:40\nabcdefghijklmnopqrstuvwxyz\n0123456789\n"
)

_BITS = 16
_TOP = (1 << 32) - 1
_NEWLINE = 10
_WEIGHTS = (4, 8, 4, 8, 28, 40)

_Counts = dict[int, list[int]]


# the same names are written once to be measured and once to be saved
@lru_cache(maxsize=4)
def encode_text(text: bytes) -> bytes:
    r"""Code text that ends with a newline and is at most MODEL_LIMIT bytes long.

    Examples
    --------
    >>> len(encode_text(b"long_walk_home\n"))
    9
    """
    model = _Model()
    out = bytearray()
    low, high = 0, _TOP
    for byte in text:
        model.begin()
        for place in range(7, -1, -1):
            bit = byte >> place & 1
            middle = low + ((high - low) * model.chance() >> _BITS)
            low, high = (low, middle) if bit else (middle + 1, high)
            model.learn(bit)
            while not (low ^ high) >> 24:
                out.append(high >> 24)
                low, high = low << 8 & _TOP, high << 8 & _TOP | 255
    return bytes(out) + _last_bytes(low, high)


def read_text(data: bytes, lines: int, offset: int) -> bytes:
    """Undo :func:`encode_text`, given how many newlines the text holds."""
    model = _Model()
    text = bytearray()
    low, high, window = 0, _TOP, int.from_bytes(data[:4].ljust(4, b"\0"), "big")
    at = 4
    while lines:
        model.begin()
        byte = 0
        for _ in range(8):
            middle = low + ((high - low) * model.chance() >> _BITS)
            bit = int(window <= middle)
            low, high = (low, middle) if bit else (middle + 1, high)
            model.learn(bit)
            byte = byte << 1 | bit
            while not (low ^ high) >> 24:
                low, high = low << 8 & _TOP, high << 8 & _TOP | 255
                window = window << 8 & _TOP | (data[at] if at < len(data) else 0)
                at += 1
        text.append(byte)
        lines -= byte == _NEWLINE
        if len(text) > MODEL_LIMIT:
            raise CorruptArchiveError(f"names go on past {MODEL_LIMIT} bytes", offset)
    return bytes(text)


def _last_bytes(low: int, high: int) -> bytes:
    # the reader goes on with zeros, so only as many bytes are written as a number between low and high needs
    for count in range(5):
        unit = 1 << 8 * (4 - count)
        number = -(-low // unit) * unit
        if number <= high:
            return (number // unit).to_bytes(count, "big") if count else b""
    raise AssertionError("low is above high")


class _Model:
    """Chance of the next bit being 1, by what came before."""

    def __init__(self) -> None:
        self._tables: tuple[_Counts, ...] = tuple({} for _ in _WEIGHTS)
        self._above = self._line = b""
        self._same = True
        self._recent = 0
        self._contexts: tuple[int, ...] = ()
        self._node = 1
        self._cells: list[list[int]] = []
        for byte in PRIME:
            self.begin()
            for place in range(7, -1, -1):
                self._find()
                self.learn(byte >> place & 1)
        self._above = b""

    def begin(self) -> None:
        """Settle the contexts of the next byte."""
        column = len(self._line)
        above = self._above[column] if column < len(self._above) else _NEWLINE
        one, two, three = self._recent & 0xFF, self._recent & 0xFFFF, self._recent & 0xFFFFFF
        place = min(column, 255) << 9 | self._same << 8
        self._contexts = (0, one, two, three, place | above, (two << 8 | above) << 1 | self._same)
        self._node = 1

    def chance(self) -> int:
        """Chance of a 1 in 65536ths, between 32 and 65504."""
        self._find()
        ones = zeros = 2
        for weight, (zero, one) in zip(_WEIGHTS, self._cells, strict=True):
            sure = weight * (4 if not zero or not one else 1)
            ones += sure * one
            zeros += sure * zero
        return min(max((ones << _BITS) // (ones + zeros), 32), 65_504)

    def learn(self, bit: int) -> None:
        """Count the bit that came."""
        for cell in self._cells:
            cell[bit] = min(cell[bit] + 1, 255)
            if cell[1 - bit] > 2:
                cell[1 - bit] = cell[1 - bit] // 2 + 1
        self._node = self._node << 1 | bit
        if self._node > 255:
            self._end(self._node & 255)

    def _find(self) -> None:
        node = self._node
        self._cells = [
            table.setdefault(context << 8 | node, [0, 0])
            for table, context in zip(self._tables, self._contexts, strict=True)
        ]

    def _end(self, byte: int) -> None:
        self._recent = (self._recent << 8 | byte) & 0xFFFFFF
        if byte == _NEWLINE:
            self._above, self._line, self._same = self._line, b"", True
            return
        column = len(self._line)
        self._same = self._same and column < len(self._above) and self._above[column] == byte
        self._line += bytes([byte])
