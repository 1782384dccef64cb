"""Rows and columns of logs that are kept exactly: found as the reader of CSV finds them."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress

from gpszip.errors import InputError
from gpszip.io.logs.csv import Dialect, detect_dialect, find_csv_roles
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request
from gpszip.io.storage.source import Source
from gpszip.lossless.layout import MAX_COLUMNS, MAX_PREAMBLE, TableLayout

__all__ = ["find_layout"]


#: Bytes from this on are parts of letters in UTF-8.
_FIRST_BEYOND_ASCII = 128

#: Name of the track of a log that names none; others begin with it where time goes back.
_UNNAMED = "0"


def find_layout(source: Source, tracks: Collection[str], *, is_only: bool) -> TableLayout | None:
    """Find out how a log falls into rows and columns; None where it does not.

    Parameters
    ----------
    source : Source
        The log.
    tracks : collection of str
        Names of the archive's tracks, by which the column is found that names them.
    is_only : bool
        Whether no other log has any of these tracks.
    """
    # The dialect; columns that the user named are found without their names.
    try:
        if format_for_reading(source).name != "csv":
            return None
        dialect, has_names = _detect(source)
    except InputError:
        return None

    # Rows of bytes: no text of two bytes a letter, and a line feed after the header.
    head = source.head()
    lines = head.split(b"\n", dialect.header_lines)
    preamble = b"".join(line + b"\n" for line in lines[: dialect.header_lines])
    is_text = dialect.encoding != "utf-16" and ord(dialect.delimiter) < _FIRST_BEYOND_ASCII
    if dialect.width > MAX_COLUMNS:
        return None
    if not is_text or len(lines) <= dialect.header_lines or len(preamble) > MAX_PREAMBLE:
        return None

    # The header is the last line before the rows.
    layout = TableLayout(ord(dialect.delimiter), preamble, True, dialect.width)
    has_header = has_names and bool(preamble) and len(layout.columns) >= len(dialect.names)
    column = _find_track_column(dialect, source.name, tracks, is_only=is_only)
    return TableLayout(layout.delimiter, preamble, has_header, dialect.width, column)


def _detect(source: Source) -> tuple[Dialect, bool]:
    """Find the dialect, and whether the log names its columns."""
    try:
        return detect_dialect(source.head(), Request(), source.name), True
    except InputError:
        dialect = detect_dialect(source.head(), Request(columns=()), source.name)
        return dialect, False


def _find_track_column(
    dialect: Dialect, where: str, tracks: Collection[str], *, is_only: bool
) -> int | None:
    """Number of the column that names tracks: the one of this role, or with names of tracks."""
    role = None
    with suppress(InputError):
        role = find_csv_roles(dialect, Request(), where).id
    if role is not None and (not tracks or _holds_names(dialect, role, tracks)):
        return role

    # The user may have named another one.
    unnamed = all(track == _UNNAMED or track.startswith(f"{_UNNAMED}-") for track in tracks)
    if is_only and not unnamed:
        for column in range(len(dialect.names)):
            if _holds_names(dialect, column, tracks):
                return column
    return role


def _holds_names(dialect: Dialect, column: int, tracks: Collection[str]) -> bool:
    """Whether the first cells of a column are names of tracks."""
    cells = dialect.cells(column)
    return bool(cells) and all(cell.strip() in tracks for cell in cells)
