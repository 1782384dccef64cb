"""Quotes in text that are opened and never closed: they would swallow all rows up to the next quote, without a word."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from typing import Any

from gpszip.errors import InputError
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source

__all__ = ["check_quotes"]

#: Bytes that are looked at a time, and the longest cell within quotes.
_BLOCK_BYTES, _MAX_CELL_BYTES = 1 << 22, 1 << 24


def check_quotes(source: Source, encoding: str, delimiter: str, rows: int) -> None:
    """Make sure that no quote swallows rows.

    Parameters
    ----------
    source : Source
        The text.
    encoding : str
        Its encoding.
    delimiter : str
        What stands between cells.
    rows : int
        How many records were found in it, with those of the header. Where there are as many lines, all is well.

    Raises
    ------
    InputError
        If a quote is not closed, or text follows after it.
    """
    lines, quoted, last = 0, False, b"\n"
    for block in _blocks(source, encoding):
        quoted = quoted or b'"' in block
        lines += (
            block.count(b"\n")
            + block.count(b"\r")
            - block.count(b"\r\n")
            - (last == b"\r" and block[:1] == b"\n")
        )
        last = block[-1:]
    lines += last not in (b"\n", b"\r")
    if quoted and lines != rows:
        _check_cells(source, encoding, delimiter)


def _check_cells(source: Source, encoding: str, delimiter: str) -> None:
    """Go through all cells: what is left when no more is a whole cell must be the last one."""
    mark = re.escape(delimiter.encode())
    cell = rb'(?:"(?:[^"]++|"")*+"|[^"' + mark + rb"\r\n][^" + mark + rb"\r\n]*+)?+"
    cells = re.compile(rb"(?:" + cell + rb"(?:" + mark + rb"|\r\n|\r(?!\Z)|\n))*+")
    rest, line = b"", 1
    for block in _blocks(source, encoding):
        text = rest + block
        end = cells.match(text).end()  # type: ignore[union-attr]  # matches the empty text at least
        line += len(re.findall(rb"\r\n|\r|\n", text[:end]))
        rest = text[end:]
        if len(rest) > _MAX_CELL_BYTES:
            break
    if re.fullmatch(cell + rb"\r?", rest) is None:
        raise InputError(
            f"{source.name}: row {line}: a quote is not closed, or text follows after it; close it, or write it twice"
        )


def _blocks(source: Source, encoding: str) -> Iterator[bytes]:
    """Yield the text in an encoding of which each mark is one byte."""
    wide = codecs.getincrementaldecoder(encoding)("replace") if encoding == "utf-16" else None
    with source.open() as stream:
        while block := _read(stream):
            yield block if wide is None else wide.decode(block).encode()


def _read(stream: Any) -> bytes:
    return read_chunk(stream, _BLOCK_BYTES)
