"""Blocks of text to bytes and back, byte by byte.

Text falls into records, which are lines or parts of long ones. A record is a shape, in which its
numbers are marked, and these numbers. Records of one shape are a table, whose columns are coded
with the source's own digits: see :mod:`gpszip.lossless.tables`. Bytes that this does not suit are
packed by LZMA, or stored.
"""

from __future__ import annotations

import itertools
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
from gpszip.lossless.tables import decode_table, encode_table
from gpszip.lossless.trails import Trails

__all__ = ["MAX_BLOCK_BYTES", "decode_block", "encode_block"]

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
        from gpszip.lossless.kernels.tokens import write_records

        text = np.zeros(size, np.uint8)
        lengths = [len(shape) for shape in self.shapes]
        is_complete = write_records(
            text,
            self.record_shapes,
            np.frombuffer(b"".join(self.shapes), np.uint8),
            np.cumsum([0, *lengths]).astype(np.int64),
            self.values,
            self.decimals,
            self.widths,
        )
        return text.tobytes() if is_complete else None


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
    # Shapes. Each record takes a byte of text at least.
    count = cursor.read_varint("the number of records")
    shapes = _read_shapes(cursor, size)
    if not shapes or not 0 < count <= size:
        raise cursor.error(f"{count} records of {len(shapes)} shapes in {size} bytes")
    record_shapes, _ = decode_column(cursor, count)
    if record_shapes.min() < 0 or record_shapes.max() >= len(shapes):
        raise cursor.error(f"a record has none of the {len(shapes)} shapes")

    # Tokens. Each takes a byte of text, too.
    kinds = [_kinds(shape) for shape in shapes]
    tokens_of_shape = np.array([len(each) for each in kinds], np.int64)
    tokens = int(tokens_of_shape[record_shapes].sum())
    if tokens > size:
        raise cursor.error(f"{tokens} numbers in {size} bytes")
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
