"""Blocks of text to bytes and back, byte by byte.

Text falls into records, which are lines or parts of long ones. A record is a shape, in which its
numbers are marked, and these numbers. Records of one shape are a table, whose columns are coded
with the source's own digits: see :mod:`gpszip.lossless.tables`. Bytes that this does not suit are
packed by LZMA, or stored.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.container.expansion import deflate, inflate, pack_lzma, unpack_lzma
from gpszip.container.layout import Cursor, encode_varint
from gpszip.errors import CorruptArchiveError
from gpszip.lossless.columns import decode_column, encode_column
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.notation import decode_notation, encode_notation, find_notation
from gpszip.lossless.rows import cut_cells, has_stray_quotes
from gpszip.lossless.tables import decode_table, encode_table
from gpszip.lossless.trails import Trails

__all__ = ["MAX_BLOCK_BYTES", "decode_block", "decode_cells", "encode_block"]

#: A block is at most this long.
MAX_BLOCK_BYTES = 1 << 22

#: Methods of a block.
_STORED = 0
_LZMA = 1
_TABLES = 2
_GUIDED_TABLES = 3

#: Above this many shapes, those with the same kinds of numbers share a table; above the second
#: number, text is no tables.
_MAX_TABLES = 64
_MAX_SHAPES = 1 << 14

#: Shapes are at most so many times as long as their text, and so much longer.
_SHAPES_RATIO = 4
_SHAPES_FREE = 64

#: In a shape, this byte stands before the kind of a token; kinds are 0 to 4.
_MARK = 0xFF
_KINDS = 5

#: A token in a shape.
_TOKEN = re.compile(rb"\xff.", re.DOTALL)

#: Kinds that have a blank between date and time, and bytes that a token takes at most.
_KINDS_WITH_BLANKS = (2, 3)
_TOKEN_BYTES = 40

#: Bytes of text.
_QUOTE = 34
_BLANK = 32

_Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Records:
    """Text in parts.

    Parameters
    ----------
    shapes : tuple of bytes
        Bytes of each shape.
    record_shapes : int64 array, shape (r,)
        Number of each record's shape.
    values : int64 array, shape (t,)
        Value of each token, in units of its last digit.
    decimals, widths : uint8 array, shape (t,)
        Digits after the point, and before it.
    """

    shapes: tuple[bytes, ...]
    record_shapes: _Ints
    values: _Ints
    decimals: NDArray[np.uint8]
    widths: NDArray[np.uint8]

    def write(self, size: int) -> bytes | None:
        """Return the text, or None where it is not ``size`` bytes long."""
        text = np.zeros(size, np.uint8)
        return text.tobytes() if self._write(text) else None

    def write_within(self, capacity: int) -> bytes:
        """Return text that ends with a newline, and is at most ``capacity`` bytes long."""
        text = np.zeros(capacity, np.uint8)
        self._write(text)
        return text[: capacity - int((text[::-1] != 0).argmax())].tobytes()

    def _write(self, text: NDArray[np.uint8]) -> bool:
        """Write the text; return whether it is as long as the array."""
        from gpszip.lossless.kernels.tokens import write_records

        lengths = [len(shape) for shape in self.shapes]
        is_complete: bool = write_records(
            text,
            self.record_shapes,
            np.frombuffer(b"".join(self.shapes), np.uint8),
            np.cumsum([0, *lengths]).astype(np.int64),
            self.values,
            self.decimals,
            self.widths,
        )
        return is_complete


def encode_block(text: bytes, finder: GuideFinder) -> bytes:
    r"""Encode a block in the shortest way.

    Parameters
    ----------
    text : bytes
        At most 4 MiB; a few times as much memory is taken.
    finder : GuideFinder
        Finds what walks tell of the numbers.

    Examples
    --------
    >>> from gpszip.lossless.trails import NO_TRAILS
    >>> text = b"".join(b"%d,%.2f\n" % (i, i / 4) for i in range(1000))
    >>> data = encode_block(text, GuideFinder(NO_TRAILS))
    >>> len(text), len(data) < 120, decode_block(Cursor(data), len(text), NO_TRAILS) == text
    (10450, True, True)
    """
    candidates = [bytes([_STORED]) + text]
    tables = _encode_tables(text, finder)
    # LZMA takes long, and beats tables of numbers only where there are few.
    if tables is None or len(tables) > len(text) // 8:
        candidates.append(bytes([_LZMA]) + pack_lzma(text))
    if tables is not None:
        candidates.append(bytes([_GUIDED_TABLES]) + tables)
    return min(candidates, key=len)


def decode_block(cursor: Cursor, size: int, trails: Trails | None = None) -> bytes:
    """Undo :func:`encode_block`; the rest of the cursor's bytes are the block.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no block of ``size`` bytes of text.
    """
    # A forged size must not ask for more memory.
    if size > MAX_BLOCK_BYTES:
        raise cursor.error(f"a block of {size} bytes; at most {MAX_BLOCK_BYTES} are allowed")

    # The text, by the method that took the fewest bytes.
    method = cursor.read_byte("a block's method")
    if method == _TABLES:
        text = _decode_tables(cursor, size, None)
    elif method == _GUIDED_TABLES and trails is not None:
        text = _decode_tables(cursor, size, trails)
    elif method == _LZMA:
        text = unpack_lzma(cursor.read_rest(), size, cursor.base + cursor.offset)
    elif method == _STORED:
        text = cursor.read_rest()
    else:
        raise cursor.error(f"no block is coded by method {method}")
    if len(text) != size:
        raise cursor.error(f"a block holds {len(text)} bytes, not {size}")
    return text


def decode_cells(
    cursor: Cursor, size: int, trails: Trails, delimiter: int, columns: Sequence[int]
) -> bytes:
    r"""Decode some columns of a block of rows; others only where they predict these.

    Parameters
    ----------
    size : int
        Bytes of the block's text.
    trails : Trails
        The walks.
    delimiter : int
        The byte between cells.
    columns : sequence of int
        Numbers of the columns.

    Returns
    -------
    bytes
        Cells with the delimiter between them, and a newline after each row.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no block of so many bytes of text.

    Examples
    --------
    >>> from gpszip.lossless.trails import NO_TRAILS
    >>> text = b"".join(b"%d,%d,%.2f\n" % (i, i * i % 99, i / 4) for i in range(1000))
    >>> data = encode_block(text, GuideFinder(NO_TRAILS))
    >>> decode_cells(Cursor(data), len(text), NO_TRAILS, ord(","), [2])[:15]
    b'0.00\n0.25\n0.50\n'
    """
    # Only rows that are one record each are decoded in part.
    inside = Cursor(cursor.data, cursor.offset, cursor.end, cursor.base)
    if inside.read_byte("a block's method") == _GUIDED_TABLES:
        shapes, record_shapes = _read_records(inside, size)
        parts = [_cut_shape(shape, delimiter, columns) for shape in shapes]
        # The last row of a log may lack its newline.
        ends = np.array([shape.endswith(b"\n") for shape in shapes])
        if not ends[record_shapes[:-1]].all():
            parts = [None]
        if all(part is not None for part in parts):
            return _decode_parts(inside, shapes, record_shapes, parts, trails, size)
    return cut_cells(decode_block(cursor, size, trails), delimiter, columns)


def _decode_parts(
    cursor: Cursor,
    shapes: tuple[bytes, ...],
    record_shapes: _Ints,
    parts: Sequence[tuple[bytes, list[int]] | None],
    trails: Trails,
    size: int,
) -> bytes:
    """Decode parts of records: a shape of each, and which of its tokens stand there."""
    # Each token takes a byte of text, and parts no more than their records.
    kinds = [_kinds(shape) for shape in shapes]
    chosen = [part for part in parts if part is not None]
    all_counts = np.array([len(each) for each in kinds], np.int64)
    _check_sizes(cursor, shapes, record_shapes, all_counts, size)

    # Where each token of a part comes from: record by record, token by token.
    counts = np.array([len(tokens) for _, tokens in chosen], np.int64)
    flat = np.concatenate([np.zeros(0, np.int64), *(np.array(t, np.int64) for _, t in chosen)])
    starts = np.cumsum(all_counts[record_shapes]) - all_counts[record_shapes]
    taken = counts[record_shapes]
    within = np.arange(int(taken.sum())) - np.repeat(np.cumsum(taken) - taken, taken)
    offsets = np.cumsum(counts) - counts
    sources = np.repeat(starts, taken) + flat[np.repeat(offsets[record_shapes], taken) + within]

    # Decode the columns that hold any of them.
    tokens = int(all_counts[record_shapes].sum())
    is_wanted = np.zeros(tokens, np.bool_)
    is_wanted[sources] = True
    values = np.zeros(tokens, np.int64)
    decimals, widths = np.zeros(tokens, np.uint8), np.zeros(tokens, np.uint8)
    for places in _tables(kinds, record_shapes):
        rows, fields = places.shape
        notations = [decode_notation(cursor, rows) for _ in range(fields)]
        wanted = np.flatnonzero(is_wanted[places].any(axis=0)).tolist()
        columns = decode_table(cursor, rows, fields, trails, wanted)
        for i in wanted:
            place = places[:, i]
            values[place], decimals[place], widths[place] = notations[i].apply(columns[i])
    cursor.expect_end("the tables")

    # A row ends with a newline, so that zeros after the last one are no text.
    cut = tuple(shape for shape, _ in chosen)
    lengths = np.array([len(shape) for shape in cut], np.int64)
    capacity = int(lengths[record_shapes].sum()) + _TOKEN_BYTES * len(sources)
    records = _Records(cut, record_shapes, values[sources], decimals[sources], widths[sources])
    return records.write_within(capacity)


def _check_sizes(
    cursor: Cursor, shapes: Sequence[bytes], record_shapes: _Ints, tokens: _Ints, size: int
) -> None:
    """Refuse records that would be longer than their text: each token takes a byte at least."""
    # A mark and a kind stand for a token.
    lengths = np.array([len(shape) for shape in shapes], np.int64) - tokens
    least = int(lengths[record_shapes].sum())
    if least > size:
        raise cursor.error(f"records of {least} bytes at least in {size} bytes")


def _cut_shape(
    shape: bytes, delimiter: int, columns: Sequence[int]
) -> tuple[bytes, list[int]] | None:
    """Shape of some cells of a row, and their tokens; None for what is no single row."""
    if b"\0" in _literals(shape):
        return None
    if _QUOTE in shape and has_stray_quotes(_TOKEN.sub(b"0", shape), delimiter):
        return None
    # The cells, each with the number of its first token.
    cells, tokens, quoted = [bytearray()], [0], False
    number, i = 0, 0
    body = shape.rstrip(b"\r\n")
    while i < len(body):
        if body[i] == _MARK:
            if delimiter == _BLANK and body[i + 1] in _KINDS_WITH_BLANKS:
                return None
            cells[-1] += body[i : i + 2]
            number, i = number + 1, i + 2
            continue
        quoted ^= body[i] == _QUOTE
        if body[i] == delimiter and not quoted:
            cells.append(bytearray())
            tokens.append(number)
        else:
            cells[-1].append(body[i])
        i += 1

    # Those that are wanted; rows may have fewer.
    parts, taken = [], []
    for column in columns:
        cell = bytes(cells[column]) if column < len(cells) else b""
        parts.append(cell)
        taken += [tokens[column] + j for j in range(cell.count(_MARK))]
    return bytes([delimiter]).join(parts) + b"\n", taken


def _literals(shape: bytes) -> bytes:
    """Bytes of a shape without its tokens."""
    parts = shape.split(bytes([_MARK]))
    return parts[0] + b"".join(part[1:] for part in parts[1:])


def _encode_tables(text: bytes, finder: GuideFinder) -> bytes | None:
    """Encode records as tables; None where they are not, or would not come back."""
    if not text or _MARK in text:
        return None
    records = _split(text)
    if records is None or records.write(len(text)) != text:
        return None

    # Shapes, then which record has which.
    blob = b"".join(encode_varint(len(shape)) + shape for shape in records.shapes)
    packed = deflate(blob)
    parts = [
        encode_varint(len(records.record_shapes)),
        encode_varint(len(records.shapes)),
        encode_varint(len(blob)),
        encode_varint(len(packed)),
        packed,
        encode_column(records.record_shapes)[0],
    ]

    # The tables: notations of all columns, then their numbers.
    kinds = [_kinds(shape) for shape in records.shapes]
    for tokens in _tables(kinds, records.record_shapes):
        notations, columns = [], []
        for token in _fields(tokens):
            notation, column = find_notation(
                records.values[token], records.decimals[token], records.widths[token]
            )
            parts.append(encode_notation(notation))
            notations.append(notation)
            columns.append(column)
        decimals = [notation.decimals for notation in notations]
        parts.append(encode_table(columns, decimals, finder))
    return b"".join(parts)


def _decode_tables(cursor: Cursor, size: int, trails: Trails | None) -> bytes:
    """Undo :func:`_encode_tables`."""
    shapes, record_shapes = _read_records(cursor, size)

    # Tokens. Each takes a byte of text, too.
    kinds = [_kinds(shape) for shape in shapes]
    tokens_of_shape = np.array([len(each) for each in kinds], np.int64)
    _check_sizes(cursor, shapes, record_shapes, tokens_of_shape, size)
    tokens = int(tokens_of_shape[record_shapes].sum())
    records = _Records(
        shapes,
        record_shapes,
        np.zeros(tokens, np.int64),
        np.zeros(tokens, np.uint8),
        np.zeros(tokens, np.uint8),
    )
    for places in _tables(kinds, record_shapes):
        rows, fields = places.shape
        notations = [decode_notation(cursor, rows) for _ in range(fields)]
        columns = decode_table(cursor, rows, fields, trails)
        fields_places = _fields(places)
        for notation, column, place in zip(notations, columns, fields_places, strict=True):
            written = notation.apply(column)
            records.values[place], records.decimals[place], records.widths[place] = written
    cursor.expect_end("the tables")

    text = records.write(size)
    if text is None:
        raise cursor.error(f"the records are not {size} bytes long")
    return text


def _read_records(cursor: Cursor, size: int) -> tuple[tuple[bytes, ...], _Ints]:
    """Read the shapes, and the number of the shape of each record."""
    # Each record takes a byte of text at least.
    count = cursor.read_varint("the number of records")
    shapes = _read_shapes(cursor, size)
    if not shapes or not 0 < count <= size:
        raise cursor.error(f"{count} records of {len(shapes)} shapes in {size} bytes")
    record_shapes, _ = decode_column(cursor, count)
    if record_shapes.min() < 0 or record_shapes.max() >= len(shapes):
        raise cursor.error(f"a record has none of the {len(shapes)} shapes")
    return shapes, record_shapes


def _fields(places: _Ints) -> list[_Ints | slice]:
    """Where the numbers of each field of a table are; slices, which are faster, where they are."""
    rows, fields = places.shape
    first, last = int(places[0, 0]), int(places[-1, 0])
    if last - first > fields * (rows - 1):
        return list(places.T)
    # Each record has at least as many tokens as the table has fields: all follow one another.
    return [slice(first + i, last + i + 1, fields) for i in range(fields)]


def _split(text: bytes) -> _Records | None:
    """Split text into shapes and numbers; None where there are too many shapes."""
    from gpszip.lossless.kernels.tokens import split_records

    # Records end after newlines, commas, or at the end; tokens take a byte, and one between.
    size = len(text)
    limit = text.count(b"\n") + text.count(b",") + 2
    starts, first_tokens = np.zeros(limit, np.int64), np.zeros(limit, np.int64)
    keys = np.zeros(limit, np.uint64)
    capacity = size // 2 + 2
    kinds, values = np.zeros(capacity, np.uint8), np.zeros(capacity, np.int64)
    decimals, widths = np.zeros(capacity, np.uint8), np.zeros(capacity, np.uint8)
    token_starts, token_ends = np.zeros(capacity, np.int64), np.zeros(capacity, np.int64)
    records, tokens = split_records(
        np.frombuffer(text, np.uint8),
        starts,
        first_tokens,
        keys,
        kinds,
        values,
        decimals,
        widths,
        token_starts,
        token_ends,
    )

    # Number the shapes as they appear.
    _, first, inverse = np.unique(keys[:records], return_index=True, return_inverse=True)
    if len(first) > _MAX_SHAPES:
        return None
    order = np.argsort(first)
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))

    # The bytes of each, from its first record.
    shapes = []
    for record in first[order].tolist():
        position, parts = int(starts[record]), []
        for token in range(first_tokens[record], first_tokens[record + 1]):
            parts += [text[position : token_starts[token]], bytes([_MARK, kinds[token]])]
            position = int(token_ends[token])
        shapes.append(b"".join([*parts, text[position : starts[record + 1]]]))
    return _Records(
        tuple(shapes), number[inverse], values[:tokens], decimals[:tokens], widths[:tokens]
    )


def _read_shapes(cursor: Cursor, size: int) -> tuple[bytes, ...]:
    """Read the shapes of text of ``size`` bytes."""
    # How many there are, within what the text can have.
    count = cursor.read_varint("the number of shapes")
    length = cursor.read_varint("the length of the shapes")
    if count > min(size, _MAX_SHAPES) or length > _SHAPES_RATIO * size + _SHAPES_FREE:
        raise cursor.error(f"{count} shapes of {length} bytes for {size} bytes of text")

    # The shapes, each after its length.
    packed = cursor.read_bytes(cursor.read_varint("the length of packed shapes"), "the shapes")
    blob = Cursor(inflate(packed, length, cursor.base + cursor.offset))
    try:
        shapes = tuple(
            blob.read_bytes(blob.read_varint("a shape's length"), "a shape") for _ in range(count)
        )
        blob.expect_end("the shapes")
    except CorruptArchiveError as error:
        raise cursor.error(f"the shapes are damaged: {error}") from None
    if not all(_is_shape(shape) for shape in shapes):
        raise cursor.error("a shape marks no kind of number")
    return shapes


def _is_shape(shape: bytes) -> bool:
    """Whether each mark is followed by a kind."""
    parts = shape.split(bytes([_MARK]))
    return all(part and part[0] < _KINDS for part in parts[1:])


def _kinds(shape: bytes) -> bytes:
    """Kinds of the tokens of a shape."""
    return bytes(part[0] for part in shape.split(bytes([_MARK]))[1:])


def _tables(kinds: Sequence[bytes], record_shapes: _Ints) -> list[_Ints]:
    """Numbers of the tokens of each table, one row for each record, in the order of tables."""
    # The first token of each record.
    counts = np.array([len(each) for each in kinds], np.int64)[record_shapes]
    first = np.cumsum(counts) - counts

    # A table for each shape, or where these are many, for each sequence of kinds.
    keys = list(kinds) if len(kinds) > _MAX_TABLES else list(range(len(kinds)))
    names = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    table_of_shape = np.array([names[key] for key in keys], np.int64)
    tables = table_of_shape[record_shapes]
    fields = {names[key]: len(each) for key, each in zip(keys, kinds, strict=True)}

    # Sort records by table, in their order within each.
    order = np.argsort(tables, kind="stable")
    bounds = np.searchsorted(tables[order], np.arange(len(names) + 1))
    places = []
    for table, (begin, end) in enumerate(itertools.pairwise(bounds)):
        if fields[table] and end > begin:
            rows = first[order[begin:end]]
            places.append(rows[:, None] + np.arange(fields[table]))
    return places
