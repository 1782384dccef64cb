"""The lines of a text file in batches, as Arrow columns."""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from typing import Any

import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.logs.sniff.text import text_encoding
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source

__all__ = ["read_lines"]

#: Bytes that are read at a time.
_CHUNK_BYTES = 1 << 22

#: Letters of a line, at most.
_MAX_LINE_LETTERS = 1 << 22


def read_lines(source: Source) -> Iterator[Any]:
    r"""Yield the lines of a file without their ends.

    Parameters
    ----------
    source : Source
        The file or stream, in UTF-8, or in UTF-16 with a byte order mark. Lines end with a line
        feed, a carriage return, or both.

    Yields
    ------
    pyarrow.ChunkedArray of str

    Raises
    ------
    InputError
        If a line is longer than 4 million letters.

    Examples
    --------
    >>> source = Source("a", data=b"one\r\ntwo")
    >>> [line for lines in read_lines(source) for line in lines.to_pylist()]
    ['one', 'two']
    """
    # Decode chunk by chunk.
    decoder = codecs.getincrementaldecoder(text_encoding(source.head()))("replace")
    rest = ""
    number = 1
    with source.open() as stream:
        is_at_end = False
        while not is_at_end:
            chunk = read_chunk(stream, _CHUNK_BYTES)
            is_at_end = not chunk
            text = rest + decoder.decode(chunk, is_at_end)

            # The last line in memory may go on in the next chunk. A carriage return at its end may
            # be the first half of a line end.
            held = "\r" if text.endswith("\r") and not is_at_end else ""
            lines = _split(text.removesuffix("\r") if held else text)
            rest = "" if is_at_end else lines.pop() + held
            number += len(lines)

            # A line without an end would fill the memory.
            if len(rest) > _MAX_LINE_LETTERS:
                raise InputError(
                    "a line of more than 4 million letters",
                    path=source.name,
                    location=f"line {number}",
                    remedy="check that the file is of this format",
                )
            if lines:
                yield pa.chunked_array([pa.array(lines, pa.string())])


def _split(text: str) -> list[str]:
    # str.splitlines() also splits at letters that may stand within a line.
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
