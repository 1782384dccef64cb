"""Logs as comma, semicolon, tab or space separated text."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.csv as pc

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.arrow_values import looks_like_number, looks_like_time
from gpszip.io.columns import Roles, find_roles
from gpszip.io.raw_log import RawLog, Request
from gpszip.io.source import Source
from gpszip.io.table import table_log
from gpszip.io.track_rows import TrackRows
from gpszip.io.track_table import track_tables
from gpszip.model.reading import Repair

__all__ = ["KEPT_TYPES", "Dialect", "column_types", "dialect_of", "read_csv", "sniff_csv", "whole_encoding", "write_csv"]

#: What a column to keep is read as, the first that all of its cells are; else its texts are kept letter by letter.
KEPT_TYPES = (pa.null(), pa.int64(), pa.float64(), pa.string())

_SAMPLE = 50


@dataclass(frozen=True)
class Dialect:
    """How a file writes its table."""

    encoding: str
    delimiter: str
    header: int  # lines up to and including the header
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]  # a sample of the data

    def cells(self, column: int) -> list[str]:
        """Return what the sample holds in a column."""
        return [row[column] for row in self.rows if len(row) > column and row[column].strip()]


def sniff_csv(head: bytes) -> bool:
    r"""Whether a file that starts like this is text.

    Examples
    --------
    >>> sniff_csv(b"t,x,y\n"), sniff_csv(bytes(range(256)))
    (True, False)
    """
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return True
    odd = sum(head.count(byte) for byte in range(32) if byte not in (9, 10, 13, 12, 26))
    return b"\0" not in head and odd * 20 <= len(head)


def read_csv(source: Source, request: Request) -> RawLog:
    """Read a log from text with a header line, or with columns named by the request.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns, unit of time and attributes.

    Returns
    -------
    RawLog
        Rows with too many or too few cells are not in it, but counted.

    Raises
    ------
    InputError
        If there is no header, no row, or no column for time or position.
    UnknownFormatError
        If the file is no text.
    """
    dialect = dialect_of(source.head(), request, source.name)
    by_role = request.columns if isinstance(request.columns, Mapping) else None
    roles = find_roles(dialect.names, by_role, request.keep, source.name, heading=request.heading)
    comma = dialect.delimiter != "," and any(_has_decimal_comma(dialect.cells(axis)) for axis in roles.axes)
    table, bad = _table(source, dialect, roles)
    if table.num_rows == 0:
        raise InputError(f"{source.name}: a header, but no rows" if not bad else f"{source.name}: no row has {len(dialect.names)} cells")
    repairs = (Repair("rows with too many or too few cells dropped", bad, source.name),) if bad else ()
    first = dialect.header + 1
    return table_log(table.columns, dialect.names, roles, request, source.name, first=first, decimal_comma=comma, repairs=repairs)


def write_csv(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write tracks as ``track_id,t,x,y[,z]`` or ``track_id,t,lat,lon``, and their attributes.

    Tracks without times have empty cells for ``t``; where no track has times, there is no such column.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the earth.
    sink : binary file
        Where to.
    """
    head = True
    for table in track_tables(tracks):
        if head:
            sink.write((",".join(_quoted(name) for name in table.column_names) + "\n").encode())
        head = False
        plain = not any(_quoted(name) != name for name in table.column(0).unique().to_pylist())
        texts = any(pa.types.is_string(kind) for kind in table.schema.types[1:])
        style = "none" if plain and not texts else "needed"
        pc.write_csv(table, sink, pc.WriteOptions(include_header=False, quoting_style=style))


def _quoted(text: str) -> str:
    risky = not text or text != text.strip() or any(mark in text for mark in ',"\n\r') or text[0] == "#"
    return '"' + text.replace('"', '""') + '"' if risky else text


def dialect_of(head: bytes, request: Request, where: str) -> Dialect:
    """Tell from its first bytes how a file writes its table.

    Raises
    ------
    InputError
        If it is empty, or has no header and no columns are named.
    UnknownFormatError
        If it is no text.
    """
    if not head.strip():
        raise InputError(f"{where}: empty file; a log needs a header and at least one row")
    if not sniff_csv(head):
        raise UnknownFormatError(f"{where}: neither text nor a format that is known; 'gpszip formats' lists what can be read")
    encoding = _encoding(head)
    text = head.decode(encoding, errors="ignore").lstrip("\ufeff")
    lines = re.split(r"\r\n|\r|\n", text)
    start = next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), len(lines))
    titles = lines[start] if start < len(lines) else ""
    named = request.columns if isinstance(request.columns, tuple) else None
    commented = lines[start - 1].lstrip(" #\t") if start and lines[start - 1].startswith("#") else None
    delimiter = _delimiter(titles)
    first = _cells(titles, delimiter)
    if not any(looks_like_number(cell) or looks_like_time(cell) for cell in first):
        names, start = first, start + 1
    elif commented is not None and len(_cells(commented, delimiter)) == len(first):  # the header is a comment: '# t x y'
        names = _cells(commented, delimiter)
    elif named is not None:
        names = tuple(f"column {i + 1}" for i in range(len(first)))
    else:
        raise InputError(f"{where}: no header; its first row is {titles[:60]!r}; name the columns in their order: --columns t,x,y")
    rows = tuple(_cells(line, delimiter) for line in lines[start : start + _SAMPLE])
    return Dialect(encoding, delimiter, start, _renamed(names, named, where), rows)


def _encoding(head: bytes) -> str:
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    try:
        head[: len(head) - 4 if len(head) > 8 else None].decode("utf-8")  # a letter may be cut at the end
    except UnicodeDecodeError as error:
        if error.start < len(head) - 8:
            return "latin-1"
    return "utf-8"


def _delimiter(line: str) -> str:
    best = max(",;\t|", key=line.count)
    if line.count(best):
        return best
    return " " if " " in line.strip() else ","


def _cells(line: str, delimiter: str) -> tuple[str, ...]:
    return tuple(next(csv.reader(io.StringIO(line), delimiter=delimiter), ()))


def _renamed(names: Sequence[str], named: tuple[str, ...] | None, where: str) -> tuple[str, ...]:
    if named is None:
        return tuple(names)
    if len(named) > len(names):
        raise InputError(f"{where}: has {len(names)} columns, but --columns names {len(named)}")
    given = [name if name not in ("", "-", "_") else f"column {i + 1}" for i, name in enumerate(named)]
    return (*given, *(f"column {i + 1}" for i in range(len(named), len(names))))


def _has_decimal_comma(cells: Sequence[str]) -> bool:
    return any("," in cell and looks_like_number(cell.replace(",", ".", 1)) for cell in cells)


def _table(source: Source, dialect: Dialect, roles: Roles, kept: Mapping[str, Any] | None = None) -> tuple[Any, int]:
    text = {str(i): pa.string() for i in (*roles.axes, *roles.time)} | dict(kept or {})
    table, bad = _parsed(source, dialect, roles, text)
    if kept is None and (others := {str(i): pa.string() for i in roles.keep.values() if table.column(str(i)).type not in KEPT_TYPES}):
        return _table(source, dialect, roles, others)
    return table, bad


def _parsed(source: Source, dialect: Dialect, roles: Roles, text: Mapping[str, Any]) -> tuple[Any, int]:
    try:
        return _parse(source, dialect, roles, {**text, **column_types(dialect, roles)}, None), 0
    except (pa.ArrowInvalid, UnicodeDecodeError):
        pass  # some row or cell is not like the others: read texts, and let each speak for itself
    skipped: list[None] = []

    def skip(_row: Any) -> str:
        skipped.append(None)
        return "skip"

    try:
        return _parse(source, replace(dialect, encoding=whole_encoding(source, dialect)), roles, text, skip), len(skipped)
    except (pa.ArrowInvalid, UnicodeDecodeError) as error:
        raise InputError(f"{source.name}: can't be read as a table: {str(error).splitlines()[0][:120]}") from None


def whole_encoding(source: Source, dialect: Dialect) -> str:
    """Look through all of the log: the first letter that is not UTF-8 may come late."""
    decoder = codecs.getincrementaldecoder(dialect.encoding)()
    with source.open() as stream:
        try:
            while block := stream.read(1 << 20):
                decoder.decode(block)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return "latin-1"
    return dialect.encoding


def column_types(dialect: Dialect, roles: Roles) -> dict[str, Any]:
    """Types that a sample of the rows tells for the columns of numbers, by the columns' indices as texts."""
    fast = {str(axis): pa.float64() for axis in roles.axes if not _has_decimal_comma(dialect.cells(axis))}
    if len(roles.time) == 1:
        cells = [cell.strip() for cell in dialect.cells(roles.time[0])]
        if cells and all(cell.isdigit() for cell in cells):
            fast[str(roles.time[0])] = pa.int64()
        elif cells and all(looks_like_number(cell) for cell in cells):
            fast[str(roles.time[0])] = pa.float64()
    return fast


def _parse(source: Source, dialect: Dialect, roles: Roles, types: Mapping[str, Any], skip: Callable[[Any], str] | None) -> Any:
    if roles.id is not None:
        types = {**types, str(roles.id): pa.dictionary(pa.int32(), pa.string())}
    names = [str(i) for i in range(len(dialect.names))]
    with source.open() as stream:
        try:
            return pc.read_csv(
                stream,
                pc.ReadOptions(column_names=names, skip_rows=dialect.header, encoding=dialect.encoding, block_size=1 << 22),
                pc.ParseOptions(delimiter=dialect.delimiter, newlines_in_values=True, invalid_row_handler=skip),
                pc.ConvertOptions(include_columns=[str(i) for i in roles.used], column_types=types),
            )
        except OSError as error:
            raise InputError(
                f"{source.name}: damaged gzip file ({error}); fetch it again, or unpack what is left of it with zcat"
            ) from None
