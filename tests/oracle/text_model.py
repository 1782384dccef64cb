"""A plain decoder of texts, written from docs/format.md; it takes the prime from that page."""

from __future__ import annotations

from pathlib import Path

_PAGE = Path(__file__).parents[2] / "docs" / "format.md"
_WEIGHTS = (4, 8, 4, 8, 28, 40)


def prime() -> bytes:
    block = (
        _PAGE.read_text(encoding="utf-8")
        .split("as if it had decoded it, the text\n\n")[1]
        .split("\n\n")[0]
    )
    return "".join(line[4:] + "\n" for line in block.split("\n")).encode()


class Model:
    def __init__(self):
        self.counts = {}
        self.last = (0, 0, 0)
        self.above = self.line = b""
        self.same = True
        for byte in prime():
            for place in range(7, -1, -1):
                self.count(256 + byte >> place + 1, byte >> place & 1)
            self.move(byte)
        self.above = b""

    def pairs(self, node):
        column = len(self.line)
        above = self.above[column] if column < len(self.above) else 10
        a, b, c = self.last
        keys = [
            (),
            (a,),
            (a, b),
            (a, b, c),
            (min(column, 255), self.same, above),
            (a, b, above, self.same),
        ]
        return [
            self.counts.setdefault((number, key, node), [0, 0]) for number, key in enumerate(keys)
        ]

    def probability(self, node):
        ones = zeros = 2
        for weight, pair in zip(_WEIGHTS, self.pairs(node), strict=True):
            w = weight * 4 if 0 in pair else weight
            zeros += w * pair[0]
            ones += w * pair[1]
        return min(max((ones << 16) // (ones + zeros), 32), 65504)

    def count(self, node, bit):
        for pair in self.pairs(node):
            pair[bit] = min(pair[bit] + 1, 255)
            if pair[1 - bit] > 2:
                pair[1 - bit] = pair[1 - bit] // 2 + 1

    def move(self, byte):
        self.last = (byte, *self.last[:2])
        if byte == 10:
            self.above, self.line, self.same = self.line, b"", True
        else:
            self.same = self.same and self.above[len(self.line) : len(self.line) + 1] == bytes(
                [byte]
            )
            self.line += bytes([byte])


def decode(data: bytes, lines: int) -> bytes:
    model, text = Model(), b""
    low, high = 0, 2**32 - 1
    data_bytes = iter(data)
    window = 0
    for _ in range(4):
        window = window * 256 + next(data_bytes, 0)
    while text.count(b"\n") < lines:
        node = 1
        while node < 256:
            middle = low + ((high - low) * model.probability(node) >> 16)
            bit = int(window <= middle)
            low, high = (low, middle) if bit else (middle + 1, high)
            model.count(node, bit)
            node = 2 * node + bit
            while low >> 24 == high >> 24:
                low, high, window = (
                    (low << 8) % 2**32,
                    (high << 8) % 2**32 + 255,
                    (window << 8) % 2**32 + next(data_bytes, 0),
                )
        model.move(node - 256)
        text += bytes([node - 256])
    return text
