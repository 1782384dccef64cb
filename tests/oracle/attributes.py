"""A plain reader of kept attributes, written from docs/format.md."""

import lzma
import struct
import zlib


class Bytes:
    def __init__(self, data):
        self.data = data

    def take(self, count):
        taken, self.data = self.data[:count], self.data[count:]
        return taken

    def varint(self):
        value = place = 0
        while True:
            byte = self.take(1)[0]
            value |= (byte & 127) << place
            place += 7
            if byte < 128:
                return value

    def signed(self):
        value = self.varint()
        return value // 2 if value % 2 == 0 else -(value + 1) // 2

    def block(self):
        tag = self.varint()
        data = self.take(tag // 4)
        if tag % 4 == 1:
            return zlib.decompress(data, -15)
        if tag % 4 == 2:
            return lzma.decompress(
                data, lzma.FORMAT_RAW, filters=[{"id": lzma.FILTER_LZMA2, "dict_size": 1 << 22}]
            )
        return data


def signed_64(value):
    value %= 1 << 64
    return value - (1 << 64) if value >> 63 else value


def read_column(source, count):
    byte = source.take(1)[0]
    kind, order, holes = byte & 15, byte >> 4 & 3, byte >> 6
    empty = "".join(f"{one:08b}" for one in source.block()) if holes else "0" * count
    texts = []
    if kind == 12:
        number, _ = source.varint(), source.varint()
        inside = Bytes(source.block())
        texts = [inside.take(inside.varint()).decode() for _ in range(number)]
    starts = [source.signed() for _ in range(order)]
    width = source.take(1)[0]
    planes = source.block()
    length = max(count - order, 0)
    coded = [
        sum(planes[plane * length + row] << 8 * plane for plane in range(width))
        for row in range(length)
    ]
    values = [value // 2 if value % 2 == 0 else -(value + 1) // 2 for value in coded]
    for start in reversed(starts[:count]):
        sums = [start]
        for step in values:
            sums.append(sums[-1] + step)
        values = sums
    values = [signed_64(value) for value in values[:count]]
    if kind == 12:
        return [texts[value] for value in values]
    if kind == 11:
        return [struct.unpack("<d", struct.pack("<q", value))[0] for value in values]
    if kind:
        return [
            float("nan") if hole == "1" else value / 10 ** (kind - 1)
            for value, hole in zip(values, empty, strict=False)
        ]
    return values


def read_attributes(body, tracks):
    """Numbers of samples, times, and columns by name."""
    source = Bytes(body)
    counts = [source.varint() for _ in range(tracks)]
    names = [source.take(source.varint()).decode() for _ in range(source.varint())]
    times = read_column(source, sum(counts))
    return counts, times, {name: read_column(source, sum(counts)) for name in names}
