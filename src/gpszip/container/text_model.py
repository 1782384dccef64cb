"""Short lists of names by an adaptive model of text, as in the first PAQ (M. Mahoney, 2002).

Counts of zeros and ones are kept for six contexts of each bit, and added up with weights. The sums
are the probabilities of a binary arithmetic coder. All numbers are integers, so that every machine
decodes the same text. docs/format.md specifies each step.
"""

from __future__ import annotations

from functools import lru_cache

from gpszip.errors import CorruptArchiveError

__all__ = ["MODEL_LIMIT", "PRIME", "encode_text", "read_text"]

#: Longest text, newlines included, that the model takes: it spends about 50 microseconds on a byte.
MODEL_LIMIT = 1 << 13

#: Text on which the model is trained: letters, words and dates of which names are made.
PRIME = (
    b"track_1\nvehicle_02\nwalk-3\nrobot4\ntaxi_05\nbus 6\ntrip7\nroute8\ndrive_9\n"
    b"ride\nrun\nbike\ncar\ntruck\nship\nflight\n"
    b"sensor_a\ndevice-b\nagent\nuser01\nsession_1\ntest_2\n"
    b"indoor\noutdoor\nlab\nhouse\nfield\nfarm\npark\nstation\ncampus\n"
    b"morning\nevening\ncenter\nnorth_side\nsouth\neast\nwest\n"
    b"final_version\nmap_data\nlong_loop\nreference\nstreet\ncity\n"
    b"2019-11-05T08:30:00Z\n2023-06-17 14:25:40\n"
    b"abcdefghijklmnopqrstuvwxyz\n0123456789\n"
)

#: Binary digits of a probability, and its bounds in units of 2**-16.
_PROBABILITY_BITS = 16
_MIN_PROBABILITY = 32
_MAX_PROBABILITY = 65_504

#: Largest value of the coder's 32-bit bounds.
_TOP = (1 << 32) - 1

_NEWLINE = 10

#: Weights of the contexts: none, one, two and three bytes, column and byte above, all of these.
_WEIGHTS = (4, 8, 4, 8, 28, 40)

#: A context in which only one value was seen weighs so many times as much.
_CERTAIN_FACTOR = 4

#: Largest count of a context.
_MAX_COUNT = 255

#: Columns beyond this count as this.
_MAX_COLUMN = 255

#: Counts (zeros, ones) by context.
_Counts = dict[int, list[int]]


# The same names are encoded once to be measured and once to be saved.
@lru_cache(maxsize=4)
def encode_text(text: bytes) -> bytes:
    r"""Encode text that ends with a newline and is at most MODEL_LIMIT bytes long.

    Examples
    --------
    >>> len(encode_text(b"long_walk_home\n"))
    9
    """
    # Narrow [low, high] by each bit (binary arithmetic coding), the highest of a byte first.
    model = _trained_model().copy()
    out = bytearray()
    low, high = 0, _TOP
    for byte in text:
        model.begin_byte()
        for place in range(7, -1, -1):
            # a 1 has the lower share of the interval
            bit = byte >> place & 1
            middle = low + ((high - low) * model.probability() >> _PROBABILITY_BITS)
            low, high = (low, middle) if bit else (middle + 1, high)
            model.learn(bit)

            # Move out the bytes in which both bounds agree.
            while not (low ^ high) >> 24:
                out.append(high >> 24)
                low, high = low << 8 & _TOP, high << 8 & _TOP | 255
    return bytes(out) + _last_bytes(low, high)


def read_text(data: bytes, lines: int, offset: int) -> bytes:
    """Undo :func:`encode_text`, given the number of newlines; ``offset`` is for errors."""
    # Repeat the encoder's intervals; the 32 bits in code always lie in [low, high].
    model = _trained_model().copy()
    text = bytearray()
    low, high, code = 0, _TOP, int.from_bytes(data[:4].ljust(4, b"\0"), "big")
    position = 4
    while lines:
        model.begin_byte()
        byte = 0
        for _ in range(8):
            middle = low + ((high - low) * model.probability() >> _PROBABILITY_BITS)
            bit = int(code <= middle)
            low, high = (low, middle) if bit else (middle + 1, high)
            model.learn(bit)
            byte = byte << 1 | bit

            # Move in a byte for each in which both bounds agree; zeros past the end.
            while not (low ^ high) >> 24:
                low, high = low << 8 & _TOP, high << 8 & _TOP | 255
                code = code << 8 & _TOP | (data[position] if position < len(data) else 0)
                position += 1
        text.append(byte)
        lines -= byte == _NEWLINE
        # Forged bytes may decode to a text in which no newline ever comes.
        if len(text) > MODEL_LIMIT:
            raise CorruptArchiveError(f"names go on past {MODEL_LIMIT} bytes", offset)
    return bytes(text)


def _last_bytes(low: int, high: int) -> bytes:
    """Fewest bytes of a number between low and high; a reader goes on with zeros."""
    for count in range(5):
        unit = 1 << 8 * (4 - count)
        # Round up to a number whose last bytes are zero, since these are left out.
        number = -(-low // unit) * unit
        if number <= high:
            return (number // unit).to_bytes(count, "big") if count else b""
    raise AssertionError("low is above high")


@lru_cache(maxsize=1)
def _trained_model() -> _Model:
    """Return a model that has learned from the prime, which takes 12 ms; copy it for each text."""
    model = _Model()
    model.train(PRIME)
    return model


class _Model:
    """Probability that the next bit is 1, by the bytes before it."""

    def __init__(self) -> None:
        self._tables: tuple[_Counts, ...] = tuple({} for _ in _WEIGHTS)
        self._above = self._line = b""
        self._same = True  # so far, the line is a prefix of the one above
        self._recent = 0  # the last three bytes
        self._contexts: tuple[int, ...] = ()
        self._node = 1  # the bits of the byte so far, after a leading 1
        self._counts: list[list[int]] = []

    def train(self, text: bytes) -> None:
        """Learn from lines, of which none counts as the line above the next one."""
        for byte in text:
            self.begin_byte()
            for place in range(7, -1, -1):
                self._find_counts()
                self.learn(byte >> place & 1)
        self._above = b""

    def copy(self) -> _Model:
        """Return a model that learns on by itself; call it between two lines."""
        model = _Model()
        # Between two lines, all but tables and recent bytes is as in a new model.
        model._tables = tuple(
            {context: counts.copy() for context, counts in table.items()} for table in self._tables
        )
        model._recent = self._recent
        return model

    def begin_byte(self) -> None:
        """Set the contexts of the next byte."""
        # Beyond the end of the line above, a newline counts as the byte above.
        column = len(self._line)
        above = self._above[column] if column < len(self._above) else _NEWLINE
        one, two, three = self._recent & 0xFF, self._recent & 0xFFFF, self._recent & 0xFFFFFF
        # Each context is one number, in which each part has bits of its own.
        in_line = min(column, _MAX_COLUMN) << 9 | self._same << 8
        self._contexts = (0, one, two, three, in_line | above, (two << 8 | above) << 1 | self._same)
        self._node = 1

    def probability(self) -> int:
        """Probability of a 1 in units of 2**-16, between 32 and 65504."""
        self._find_counts()
        # Two of each make both values equally likely where nothing was seen.
        ones = zeros = 2
        for weight, (zero, one) in zip(_WEIGHTS, self._counts, strict=True):
            factor = weight * (_CERTAIN_FACTOR if not zero or not one else 1)
            ones += factor * one
            zeros += factor * zero
        probability = (ones << _PROBABILITY_BITS) // (ones + zeros)
        # A probability of 0 or 1 would leave no interval for the other value.
        return min(max(probability, _MIN_PROBABILITY), _MAX_PROBABILITY)

    def learn(self, bit: int) -> None:
        """Count a bit; the other value's count fades towards 2."""
        for counts in self._counts:
            counts[bit] = min(counts[bit] + 1, _MAX_COUNT)
            if counts[1 - bit] > 2:
                counts[1 - bit] = counts[1 - bit] // 2 + 1
        self._node = self._node << 1 | bit
        # After the leading 1 and eight bits, the byte is complete.
        if self._node > 255:
            self._end_byte(self._node & 255)

    def _find_counts(self) -> None:
        """Look up the counts of the next bit in each context."""
        # Below each context lies a tree of bits: a node of it has counts of its own.
        node = self._node
        self._counts = [
            table.setdefault(context << 8 | node, [0, 0])
            for table, context in zip(self._tables, self._contexts, strict=True)
        ]

    def _end_byte(self, byte: int) -> None:
        """Move on by a byte."""
        self._recent = (self._recent << 8 | byte) & 0xFFFFFF
        if byte == _NEWLINE:
            self._above, self._line, self._same = self._line, b"", True
            return
        column = len(self._line)
        self._same = self._same and column < len(self._above) and self._above[column] == byte
        self._line += bytes([byte])
