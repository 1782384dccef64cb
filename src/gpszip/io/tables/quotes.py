"""Quotes in CSV text: where cells need them, and detection of unclosed ones.

Parsers read an unclosed quote as a cell that extends to the next quote, and lose all rows between
without an error.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator

import numpy as np

from gpszip.errors import InputError
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source

__all__ = ["check_quotes", "quote_text"]

#: Bytes that are read at a time: 4 MiB.
_BLOCK_BYTES = 1 << 22

#: Longest cell within quotes in bytes, 16 MiB; a longer one counts as not closed.
_MAX_CELL_BYTES = 1 << 24


def check_quotes(source: Source, encoding: str, delimiter: str, rows: int) -> None:
    """Check that no quote hides rows.

    Parameters
    ----------
    source : Source
        The text.
    encoding : str
        Its encoding.
    delimiter : str
        Separator of cells.
    rows : int
        Number of records that a parser has found, including the header. If there are as many lines,
        no quote hides any.

    Raises
    ------
    InputError
        If a quote is not closed, or text follows after it.
    """
    # Count the lines of the text. An empty one has none, as if a line had just ended.
    lines, has_quotes, last = 0, False, b"\n"
    for block in _blocks(source, encoding):
        has_quotes = has_quotes or b'"' in block

        # Count \n, \r and \r\n once each, also where \r\n is split between two blocks.
        is_split = last == b"\r" and block[:1] == b"\n"
        lines += _count_line_ends(block) - is_split
        last = block[-1:]
    # The last line may lack its end.
    lines += last not in (b"\n", b"\r")

    # Most files have as many lines as records. Only others need a closer look.
    if has_quotes and lines != rows:
        _check_cells(source, encoding, delimiter)


def _count_line_ends(block: bytes) -> int:
    r"""Count \n, \r and \r\n once each."""
    # NumPy counts single bytes several times as fast as bytes.count does.
    feeds = int(np.count_nonzero(np.frombuffer(block, np.uint8) == ord("\n")))
    returns = block.count(b"\r") - block.count(b"\r\n") if b"\r" in block else 0
    return feeds + returns


def _check_cells(source: Source, encoding: str, delimiter: str) -> None:
    """Match all cells with a regular expression; the text that remains must be the last cell.

    Raises
    ------
    InputError
        If a quote is not closed, or text follows after it.
    """
    # A cell is quoted text, or text that doesn't start with a quote.
    mark = re.escape(delimiter.encode())
    # Possessive repetitions (`*+`, `++`) never give back what they matched, so hostile text can't
    # make the match try many ways. A CR at the end of a block may be half of a CRLF, so it waits
    # for the next block.
    cell = rb'(?:"(?:[^"]++|"")*+"|[^"' + mark + rb"\r\n][^" + mark + rb"\r\n]*+)?+"
    cells = re.compile(rb"(?:" + cell + rb"(?:" + mark + rb"|\r\n|\r(?!\Z)|\n))*+")

    # Match block by block; an incomplete cell goes on in the next block.
    rest, line = b"", 1
    for block in _blocks(source, encoding):
        # Remove complete cells, counting their lines.
        text = rest + block
        end = cells.match(text).end()  # type: ignore[union-attr]  # matches the empty text at least
        line += len(re.findall(rb"\r\n|\r|\n", text[:end]))
        rest = text[end:]
        if len(rest) > _MAX_CELL_BYTES:
            break

    # The text that remains must be a whole cell, maybe with the CR of the last line break.
    if re.fullmatch(cell + rb"\r?", rest) is None:
        raise InputError(
            "a quote is not closed, or text follows after it",
            path=source.name,
            location=f"row {line}",
            remedy="close it, or write it twice",
        )


def _blocks(source: Source, encoding: str) -> Iterator[bytes]:
    """Yield the text in an encoding in which quotes, delimiters and line ends are single bytes."""
    # Of the encodings of tables, only UTF-16 takes two bytes for these letters.
    decoder = codecs.getincrementaldecoder(encoding)("replace") if encoding == "utf-16" else None
    with source.open() as stream:
        while block := read_chunk(stream, _BLOCK_BYTES):
            yield block if decoder is None else decoder.decode(block).encode()


def quote_text(text: str) -> str:
    """Quote a text that would be read as something else.

    Examples
    --------
    >>> quote_text("bus 7"), quote_text("7, 8")
    ('bus 7', '"7, 8"')
    """
    has_mark = any(mark in text for mark in ',"\n\r')
    if text and text == text.strip() and not has_mark and text[0] != "#":
        return text
    return '"' + text.replace('"', '""') + '"'
