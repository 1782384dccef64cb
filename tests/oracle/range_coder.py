"""Plain twin of the range coder on Python's integers, written from docs/format.md: no carries, no machine words."""

from __future__ import annotations

FLOOR = 2**48


class Writer:
    """Collects one number ``low`` of as many bits as it takes; what is written are its bytes."""

    def __init__(self):
        self.low, self.range, self.shifts = 0, 2**64 - 1, 0

    def interval(self, start, width, total):
        share = self.range // total
        self.low += share * start
        self.range = share * width
        while self.range < FLOOR:
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


class Reader:
    """Reads bytes; those past the end are zeros."""

    def __init__(self, data):
        self.data, self.at = data, 8
        self.code, self.range = int.from_bytes(data[:8].ljust(8, b"\0"), "big"), 2**64 - 1

    @property
    def is_spent(self):
        return self.at > len(self.data) + 16

    def target(self, total):
        return min(self.code // (self.range // total), total - 1)

    def interval(self, start, width, total):
        share = self.range // total
        self.code = (self.code - share * start) % 2**64
        self.range = share * width
        while self.range < FLOOR:
            following = self.data[self.at] if self.at < len(self.data) else 0
            self.code, self.range, self.at = (
                (self.code << 8 | following) % 2**64,
                self.range << 8,
                self.at + 1,
            )

    def bits(self, count):
        value = self.target(2**count)
        self.interval(value, 1, 2**count)
        return value
