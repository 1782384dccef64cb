"""How the text of a log falls into rows and columns, and which of its rows are of which track."""

from __future__ import annotations

import csv
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import Cursor, encode_varint
from gpszip.lossless.columns import decode_column, encode_column
from gpszip.lossless.trails import Trails

__all__ = [
    "MAX_COLUMNS",
    "MAX_PREAMBLE",
    "Groups",
    "Runs",
    "TableLayout",
    "decode_groups",
    "decode_layout",
    "encode_groups",
    "encode_layout",
    "encode_runs",
    "name_of_cell",
    "read_runs",
    "rows_of_runs",
]

#: Longest text before the first row that an archive holds beside the rows, and longest cell that
#: names a track.
MAX_PREAMBLE = 1 << 16
_MAX_NAME = 1 << 6

#: Most columns.
MAX_COLUMNS = 1 << 12

#: Delimiters are letters of ASCII, but none that end a row or a quotation.
_FIRST_BEYOND = 128
_NO_DELIMITERS = b'\0\n\r"'

#: Runs of rows of one track, in a block: pairs of the number of a track and a number of rows.
Runs = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class TableLayout:
    """A text with rows and columns.

    Parameters
    ----------
    delimiter : int
        The byte between cells.
    preamble : bytes
        What stands before the first row.
    has_header : bool
        Whether its last line names the columns.
    width : int
        Number of columns.
    track_column : int, optional
        Number of the column that names the track of each row; None where all are one track.
    """

    delimiter: int
    preamble: bytes
    has_header: bool
    width: int
    track_column: int | None = None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns; empty where none are named, or their line is damaged."""
        if not self.has_header:
            return ()
        line = self.preamble.rstrip(b"\r\n").rpartition(b"\n")[2]
        text = _decode(line).lstrip("\ufeff# ")
        try:
            return tuple(next(csv.reader([text], delimiter=chr(self.delimiter)), ()))
        except csv.Error:
            return ()


@dataclass(frozen=True)
class Groups:
    """The tracks of a log's rows: their cells, in the order in which they first appear."""

    cells: tuple[bytes, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names without quotes and blanks."""
        return tuple(name_of_cell(cell) for cell in self.cells)


def name_of_cell(cell: bytes) -> str:
    """Name in a cell, without quotes and blanks around it.

    Examples
    --------
    >>> name_of_cell(b' "bus 7"'), name_of_cell(b"a b ")
    ('bus 7', 'a b')
    """
    text = _decode(cell).strip()
    if len(text) > 1 and text[0] == text[-1] == '"':
        return text[1:-1].replace('""', '"')
    return text


def encode_layout(layout: TableLayout) -> bytes:
    """Encode a layout, but for what stands before the rows: only its length."""
    track = 0 if layout.track_column is None else layout.track_column + 1
    return b"".join(
        [
            bytes([layout.delimiter, layout.has_header]),
            encode_varint(layout.width),
            encode_varint(track),
            encode_varint(len(layout.preamble)),
        ]
    )


def decode_layout(cursor: Cursor) -> tuple[TableLayout, int]:
    """Undo :func:`encode_layout`; return the length of what stands before the rows, too.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no layout.
    """
    delimiter, has_header = cursor.read_bytes(2, "a layout")
    width = cursor.read_varint("the number of columns")
    track = cursor.read_varint("a column of tracks")
    length = cursor.read_varint("the length of what stands before the rows")
    if has_header > 1 or width > MAX_COLUMNS or track > width:
        raise cursor.error("a layout is out of range")
    if delimiter >= _FIRST_BEYOND or delimiter in _NO_DELIMITERS:
        raise cursor.error(f"no cells end at byte {delimiter}")
    if length > MAX_PREAMBLE:
        raise cursor.error(f"{length} bytes before the rows")
    return (
        TableLayout(delimiter, b"", has_header == 1, width, track - 1 if track else None),
        length,
    )


def encode_groups(cells: Sequence[bytes], numbers: dict[bytes, int]) -> bytes:
    """Encode which tracks a log has; those of the archive by their number."""
    tracks = np.array([numbers.get(cell, -1) + 1 for cell in cells], np.int64)
    parts = [encode_varint(len(cells)), encode_column(tracks)[0]]
    for cell, track in zip(cells, tracks.tolist(), strict=True):
        if not track:
            parts.append(encode_varint(len(cell)) + cell)
    return b"".join(parts)


def decode_groups(cursor: Cursor, trails: Trails) -> Groups:
    """Undo :func:`encode_groups`.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no tracks.
    """
    count = cursor.read_varint("the number of tracks")
    # A forged number must not ask for memory: tracks of the archive stand one after the other.
    if count > len(trails.names) + cursor.remaining:
        raise cursor.error(f"{count} tracks in {cursor.remaining} bytes")
    tracks, _ = decode_column(cursor, count)
    if count and (tracks.min() < 0 or tracks.max() > len(trails.names)):
        raise cursor.error(f"rows are on none of {len(trails.names)} tracks")
    cells = []
    for track in tracks.tolist():
        if track:
            cells.append(trails.names[track - 1].encode())
            continue
        length = cursor.read_varint("the length of a track's name")
        if length > _MAX_NAME:
            raise cursor.error(f"a track's name of {length} bytes")
        cells.append(cursor.read_bytes(length, "a track's name"))
    return Groups(tuple(cells))


def encode_runs(groups: NDArray[np.int64]) -> bytes:
    """Encode how many rows of a block are of which tracks.

    Parameters
    ----------
    groups : int64 array, shape (n,)
        Number of the track of each row, in order.
    """
    found, counts = np.unique(groups, return_counts=True)
    gaps = np.diff(found, prepend=-1) - 1
    pairs = zip(gaps.tolist(), counts.tolist(), strict=True)
    runs = [encode_varint(gap) + encode_varint(count) for gap, count in pairs]
    return encode_varint(len(found)) + b"".join(runs)


def read_runs(cursor: Cursor, groups: int) -> Runs:
    """Undo :func:`encode_runs` in a log of so many tracks.

    Raises
    ------
    CorruptArchiveError
        If there are no such tracks.
    """
    count = cursor.read_varint("the number of tracks in a block")
    if count > groups:
        raise cursor.error(f"a block of {count} tracks of {groups}")
    group, runs = -1, []
    for _ in range(count):
        group += cursor.read_varint("a track") + 1
        if group >= groups:
            raise cursor.error(f"rows of none of {groups} tracks")
        runs.append((group, cursor.read_varint("a number of rows")))
    return tuple(runs)


def rows_of_runs(runs: Runs, wanted: Collection[int]) -> NDArray[np.bool_]:
    """Whether each row of a block is of one of the tracks with these numbers."""
    return np.repeat([group in wanted for group, _ in runs], [count for _, count in runs])


def _decode(data: bytes) -> str:
    """Text of bytes that are UTF-8, or else Latin-1."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")
