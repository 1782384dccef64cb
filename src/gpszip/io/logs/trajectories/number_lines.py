"""Lines of numbers, separated by blanks or commas, as Arrow tables that fit in memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.csv as pc

from gpszip.errors import InputError
from gpszip.io.logs.trajectories.clean_lines import clean_lines
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source

__all__ = ["NumberLines", "parse_lines", "read_blocks"]

#: Bytes that are read at a time; no line may be longer.
_BLOCK_BYTES = 1 << 22


class NumberLines(NamedTuple):
    """Lines as a table.

    Parameters
    ----------
    table : pyarrow.Table
        Columns, named by their indices.
    malformed : int
        Lines with too many or too few cells; they are not in the table.
    first_malformed : int or None
        Index of the first of them among all lines; None if there is none.
    """

    table: Any
    malformed: int
    first_malformed: int | None


class _Malformed:
    """Lets Arrow skip lines with a wrong number of cells, and notes them."""

    def __init__(self) -> None:
        self.count = 0
        self.first: int | None = None

    def __call__(self, row: Any) -> str:
        """Note a line, and tell Arrow to skip it."""
        self.count += 1
        # Arrow counts lines from 1, and from no header here.
        if self.first is None and row.number is not None:
            self.first = row.number - 1
        return "skip"


def read_blocks(source: Source) -> Iterator[bytes]:
    """Yield the lines of a file in blocks of whole lines.

    Parameters
    ----------
    source : Source
        The file or stream.

    Raises
    ------
    InputError
        If a line is longer than 4 MiB, or a gzip file is damaged.
    """
    rest = b""
    with source.open() as stream:
        while chunk := _read(stream, source.name):
            # A block ends where its last line does; what follows begins the next one.
            whole, newline, rest = (rest + chunk).rpartition(b"\n")
            if newline:
                yield whole + newline
            elif len(rest) > _BLOCK_BYTES:
                raise InputError(
                    f"a line is longer than {_BLOCK_BYTES >> 20} MiB",
                    path=source.name,
                    remedy="name a file with a pose in each line",
                )
    if rest:
        yield rest


def _read(stream: Any, where: str) -> bytes:
    try:
        return read_chunk(stream, _BLOCK_BYTES)
    except OSError as error:
        raise InputError(
            f"damaged gzip file ({error})",
            path=where,
            remedy="fetch it again, or unpack what is left of it with zcat",
        ) from None


def parse_lines(
    block: bytes, width: int, columns: Sequence[int], types: Mapping[int, Any]
) -> NumberLines:
    r"""Parse lines of numbers.

    Parameters
    ----------
    block : bytes
        The lines.
    width : int
        Number of cells in a line.
    columns : sequence of int
        Columns to return.
    types : mapping of int to pyarrow.DataType
        Types of columns; floats if left out. If a cell or a line contradicts, all are texts.

    Examples
    --------
    >>> lines = parse_lines(b"0 1 x\n1 2 3\n4 5\n", 3, [0, 2], {})
    >>> lines.table.column("2").to_pylist(), lines.malformed, lines.first_malformed
    (['x', '3'], 1, 2)
    """
    # A block of comments has no line.
    text = clean_lines(block)
    names = [str(i) for i in columns]
    if not text.strip():
        return NumberLines(pa.table({name: pa.array([], pa.float64()) for name in names}), 0, None)

    # By type, which is fast.
    chosen = {str(i): types.get(i, pa.float64()) for i in columns}
    try:
        return NumberLines(_parse(text, width, chosen, None), 0, None)
    except pa.ArrowInvalid:
        pass

    # As texts, each of which is interpreted for itself.
    malformed = _Malformed()
    table = _parse(text, width, dict.fromkeys(names, pa.string()), malformed)
    return NumberLines(table, malformed.count, malformed.first)


def _parse(text: bytes, width: int, types: Mapping[str, Any], malformed: _Malformed | None) -> Any:
    return pc.read_csv(
        pa.BufferReader(text),
        pc.ReadOptions(
            column_names=[str(i) for i in range(width)],
            encoding="latin-1",
            use_threads=False,
            block_size=max(len(text), 1),
        ),
        pc.ParseOptions(delimiter=" ", quote_char=False, invalid_row_handler=malformed),
        pc.ConvertOptions(include_columns=list(types), column_types=dict(types), null_values=[""]),
    )
