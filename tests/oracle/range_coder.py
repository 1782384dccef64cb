"""Plain range coder on Python's integers, written from docs/format.md: no carries, no words."""

from __future__ import annotations

#: The range is kept at or above this.
MIN_RANGE = 2**48


class Encoder:
    """Collects one number ``low`` of any size, whose bytes are written."""

    def __init__(self):
        self.low, self.range, self.shifts = 0, 2**64 - 1, 0

    def interval(self, start, width, total):
        share = self.range // total
        self.low += share * start
        self.range = share * width
        while self.range < MIN_RANGE:
            self.low, self.range, self.shifts = self.low << 8, self.range << 8, self.shifts + 1

    def finish(self):
        for kept in range(9):
            mask = 2 ** (64 - 8 * kept) - 1
            value = (self.low + mask) & ~mask
            if value - self.low < self.range:
                break
        data = value.to_bytes(self.shifts + 9, "big")
        assert data[0] == 0
        data = data[1:]
        return data[: max(len(data.rstrip(b"\0")), self.shifts - 8)]


class Decoder:
    """Reads bytes; those past the end are zeros."""

    def __init__(self, data):
        self.data, self.position = data, 8
        self.code, self.range = int.from_bytes(data[:8].ljust(8, b"\0"), "big"), 2**64 - 1

    @property
    def is_exhausted(self):
        return self.position > len(self.data) + 16

    def decode_cumulative(self, total):
        return min(self.code // (self.range // total), total - 1)

    def interval(self, start, width, total):
        share = self.range // total
        self.code = (self.code - share * start) % 2**64
        self.range = share * width
        while self.range < MIN_RANGE:
            following = self.data[self.position] if self.position < len(self.data) else 0
            self.code, self.range, self.position = (
                (self.code << 8 | following) % 2**64,
                self.range << 8,
                self.position + 1,
            )

    def bits(self, count):
        value = self.decode_cumulative(2**count)
        self.interval(value, 1, 2**count)
        return value
