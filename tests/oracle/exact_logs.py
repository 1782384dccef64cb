"""Plain reader of logs kept byte by byte, written from docs/format.md."""

import lzma
import zlib
from datetime import datetime, timedelta
from types import SimpleNamespace

from oracle.guides import read_guide
from oracle.lossless import ColumnDecoder

FILTERS = [{"id": lzma.FILTER_LZMA2, "dict_size": 1 << 22}]
DATES = {1: "%Y-%m-%dT%H:%M:%S", 2: "%Y-%m-%d %H:%M:%S", 3: "%Y/%m/%d %H:%M:%S", 4: "%H:%M:%S"}


class Bytes:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, count):
        self.at += count
        assert self.at <= len(self.data)
        return self.data[self.at - count : self.at]

    def u8(self):
        return self.take(1)[0]

    def varint(self):
        value = place = 0
        while True:
            byte = self.u8()
            value |= (byte & 127) << place
            place += 7
            if byte < 128:
                return value

    def signed(self):
        v = self.varint()
        return v // 2 if v % 2 == 0 else -(v + 1) // 2


def read_logs(body, trails=None):
    """Bytes of each log by its name; with trails, of a section of kind 13."""
    source = Bytes(body)
    if trails is not None:
        assert source.u8() in (0, 1)
    heads = [read_head(source, trails) for _ in range(source.varint())]

    # Logs of kind 1 are apart, all others are joined.
    logs, joined = {}, []
    for head in [*heads, SimpleNamespace(kind=1, name=None)]:
        if head.kind != 1:
            joined.append(head)
            continue
        text = b""
        while len(text) < sum(each.size for each in joined):
            text += read_sized_block(source, trails)
        for each in joined:
            logs[each.name], text = text[: each.size], text[each.size :]
        joined = []
        if head.name is not None:
            logs[head.name] = head.preamble
            while len(logs[head.name]) < head.size:
                logs[head.name] += read_span(source, head, trails)
    assert source.at == len(body)
    for head in heads:
        assert zlib.crc32(logs[head.name]) == head.crc
    return logs


def read_head(source, trails):
    name, size = source.take(source.varint()).decode(), source.varint()
    head = SimpleNamespace(name=name, size=size, crc=int.from_bytes(source.take(4), "little"))
    head.kind = 0 if trails is None else source.u8()
    if head.kind == 0:
        return head
    head.delimiter, has_header = source.u8(), source.u8()
    assert has_header in (0, 1)
    _width, track, length = source.varint(), source.varint(), source.varint()
    if head.kind == 2:
        return head
    head.preamble, head.has_tracks = source.take(length), track > 0
    if head.has_tracks:
        tracks = read_column(source, source.varint()).values
        head.cells = [
            trails.names[track - 1] if track else source.take(source.varint()) for track in tracks
        ]
    return head


def read_sized_block(source, trails):
    size = source.varint()
    block = read_block(source.take(source.varint()), trails)
    assert len(block) == size
    return block


def read_span(source, head, trails):
    """Text of a span, whose rows are sorted by track, in the order of the log."""
    size, blocks = source.varint(), source.varint()
    rows = source.varint() if head.has_tracks else 0
    if rows:
        end = source.varint()
        end += source.at
        key = source.varint() - 1
        later = read_column(source, rows).values
        assert source.at == end
    if rows and blocks > 1:
        for _ in range(blocks):
            for _ in range(source.varint()):
                source.varint(), source.varint()
    text = b"".join(read_sized_block(source, trails) for _ in range(blocks))
    assert len(text) == size
    if not rows:
        return text
    lines = split_rows(text, head.delimiter)
    ordered = lines if key < 0 else sorted(lines, key=lambda line: key_of(line[1], key))
    return b"".join(ordered[i + step][0] for i, step in enumerate(later))


def split_rows(text, delimiter):
    """Rows of a text, each with its cells."""
    rows, start, cells, cell, quoted = [], 0, [], 0, False
    for i, byte in enumerate(text):
        quoted ^= byte == 34
        if byte == delimiter and not quoted:
            cells.append(text[cell:i])
            cell = i + 1
        if (byte == 10 and not quoted) or i + 1 == len(text):
            rows.append((text[start : i + 1], [*cells, text[cell : i + 1].rstrip(b"\r\n")]))
            start, cells, cell = i + 1, [], i + 1
    return rows


def key_of(cells, column):
    digits = [byte for byte in cells[column][:32] if 48 <= byte < 58] if column < len(cells) else []
    key = int(bytes(digits) or b"0") % 2**64
    return key - 2**64 if key >= 2**63 else key


def read_block(block, trails=None):
    if block[0] == 0:
        return block[1:]
    if block[0] == 1:
        return lzma.decompress(block[1:], format=lzma.FORMAT_RAW, filters=FILTERS)
    source = Bytes(block[1:])
    count, number, size = source.varint(), source.varint(), source.varint()
    blob = Bytes(zlib.decompress(source.take(source.varint()), -15))
    shapes = [blob.take(blob.varint()) for _ in range(number)]
    assert blob.at == size
    records = read_column(source, count).values

    # Tokens of each record, from the tables.
    kinds = [bytes(part[0] for part in shape.split(b"\xff")[1:]) for shape in shapes]
    keys = kinds if number > 64 else list(range(number))
    tokens = [[] for _ in records]
    for key in dict.fromkeys(keys):
        rows = [row for row, shape in enumerate(records) if keys[shape] == key]
        fields = len(kinds[keys.index(key)])
        if rows and fields:
            columns = read_table(source, len(rows), fields, trails if block[0] == 3 else None)
            for i, row in enumerate(rows):
                tokens[row] = [column[i] for column in columns]
    return b"".join(write(shapes[s], row) for s, row in zip(records, tokens, strict=True))


def read_column(source, count, times=None, sides=(), guide=None):
    """Integers of a column, with its shift and classes of errors."""
    if count == 0:
        return SimpleNamespace(values=[], shift=0, sizes=[])
    method = source.u8()
    if method == 5:
        runs = source.varint()
        values, lengths = read_column(source, runs).values, read_column(source, runs).values
        values = [v for v, n in zip(values, lengths, strict=True) for _ in range(n)]
        return SimpleNamespace(values=values, shift=0, sizes=[0] * count)
    first = source.signed()
    if method == 0:
        return SimpleNamespace(values=[first] * count, shift=0, sizes=[0] * count)
    usual, unit, shift, first_bin = source.signed(), source.u8(), source.u8(), source.u8()
    scale = source.varint()
    contexts, method = (3, method) if method < 5 else (2, method - 5)
    setting = SimpleNamespace(
        order=(method - 1) % 2,
        contexts=contexts,
        usual=usual,
        unit=unit,
        shift=shift,
        scale=scale,
        first_bin=first_bin,
    )
    decoder = ColumnDecoder(
        source.take(source.varint()),
        setting,
        times.values if times else [],
        [side.values for side in sides],
        [side.shift for side in sides],
        [side.sizes for side in sides],
        guide if method > 2 else None,
    )
    values, sizes = decoder.decode(first, count)
    return SimpleNamespace(values=values, shift=shift, sizes=sizes)


def read_table(source, rows, fields, trails):
    """Value, decimals and width of each token, by columns."""
    notations = [read_notation(source, rows) for _ in range(fields)]
    times_at = source.varint() - 1
    order = [i for i in range(fields) if i != times_at]
    table = read_guide(source, fields, trails) if trails is not None else None
    times, others, numbers = None, [], {}
    has_sides = trails is not None
    for i in ([times_at] if times_at >= 0 else []) + order:
        role, detail = table.roles[i] if table else (0, 0)
        if role == 255:
            numbers[i] = table.names(detail)
            continue
        others_vary = [column for column in others[::-1] if len(set(column.values)) > 1]
        has_choice = has_sides and i != times_at and others_vary
        sides = others_vary[: source.u8() if has_choice else 2]
        p, q, offset = grid = source.varint(), source.varint(), source.varint()
        exceptions, row = {}, -1
        for _ in range(source.varint()):
            row += source.varint() + 1
            exceptions[row] = source.signed()
        guide = None
        if table and i == times_at:
            guide = table.times_guide(grid)
        elif role and times:
            guide = table.positions_guide(role - 1, detail, grid, times.values)
        column = read_column(source, rows, times, sides, guide)
        numbers[i] = [
            (k * p + q // 2) // q + offset + exceptions.get(row, 0)
            for row, k in enumerate(column.values)
        ]
        if i == times_at:
            times = column
        else:
            others.append(column)
    return [apply(notations[i], numbers[i]) for i in range(fields)]


def read_notation(source, rows):
    rules, decimals = source.u8(), source.u8()
    places = read_column(source, rows).values if rules & 3 == 3 else None
    width = source.u8() if rules >> 2 & 3 == 1 else 0
    widths = read_column(source, rows).values if rules >> 2 & 3 == 2 else [width] * rows
    minus, row = set(), -1
    for skipped in read_column(source, source.varint()).values if rules >> 5 else []:
        row += skipped + 1
        minus.add(row)
    return rules, decimals, places, widths, minus


def apply(notation, numbers):
    rules, most, places, widths, minus = notation
    tokens = []
    for row, (number, width) in enumerate(zip(numbers, widths, strict=True)):
        decimals = most
        if rules & 3 == 3:
            decimals = places[row]
        elif rules & 3:
            least = 0 if rules & 3 == 1 else min(1, most)
            while decimals > least and number % 10 ** (most - decimals + 1) == 0:
                decimals -= 1
        value = number if rules >> 4 & 1 else number // 10 ** (most - decimals)
        tokens.append((value, decimals, width, row in minus))
    return tokens


def write(shape, tokens):
    parts = shape.split(b"\xff")
    text = [parts[0]]
    for part, (value, decimals, width, minus) in zip(parts[1:], tokens, strict=True):
        whole, fraction = divmod(abs(value), 10**decimals)
        if part[0] == 0:
            shown = str(whole).zfill(width)
        else:
            shown = (datetime(1970, 1, 1) + timedelta(seconds=whole)).strftime(DATES[part[0]])
        end = f".{fraction:0{decimals}}" if decimals else ""
        text.append(f"{'-' if value < 0 or minus else ''}{shown}{end}".encode() + part[1:])
    return b"".join(text)
