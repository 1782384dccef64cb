"""Logs as comma, semicolon, tab or space separated text."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.csv as pc

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.track_rows import TrackRows
from gpszip.io.logs.track_table import track_tables
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source
from gpszip.io.tables.quotes import check_quotes
from gpszip.io.tables.roles import Roles, find_roles
from gpszip.io.tables.table import build_raw_log
from gpszip.io.values.arrow import looks_like_number, looks_like_time
from gpszip.model.read_result import Repair

__all__ = [
    "ATTRIBUTE_TYPES",
    "BLOCK",
    "Dialect",
    "confirm_encoding",
    "detect_dialect",
    "explain_table_error",
    "guess_column_types",
    "read_csv",
    "sniff_csv",
    "write_csv",
]

#: An empty cell alone is no value. Words such as n/a are read as text, so that a row that is dropped for one can name it.
NULL_TEXTS = [""]

#: What a column to keep is read as, the first that all of its cells are; else its texts are kept letter by letter.
ATTRIBUTE_TYPES = (pa.null(), pa.int64(), pa.float64(), pa.string())

#: Bytes that are read at a time: no row may be longer.
BLOCK = 1 << 22

#: Rows from which the dialect is told, and lines among which the header is looked for.
_SAMPLE_ROWS = 50

#: A line as long as all that is looked at, in bytes.
_MAX_LINE_BYTES = 1 << 18

_LINE_END = re.compile(r"\r\n|\r|\n")
_SEP = re.compile(r"\"?sep=(.)\"?\s*", re.IGNORECASE)


@dataclass(frozen=True)
class Dialect:
    """How a file writes its table."""

    encoding: str
    delimiter: str
    header_lines: int  # lines up to and including the header
    names: tuple[str, ...]
    sample_rows: tuple[tuple[str, ...], ...]  # a sample of the data
    named_by_user: bool = False  # whether a user named the columns
    trailing_cells: int = 0  # empty cells at the end of each row for which the header has no name

    @property
    def width(self) -> int:
        """Number of cells in a row."""
        return len(self.names) + self.trailing_cells

    def cells(self, column: int) -> list[str]:
        """Return what the sample holds in a column."""
        return [
            row[column] for row in self.sample_rows if len(row) > column and row[column].strip()
        ]

    def hint_cells(self, column: int) -> list[str]:
        """Return the same, unless a user has said what the columns are: then what they hold is no hint."""
        return [] if self.named_by_user else self.cells(column)


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
    dialect = detect_dialect(source.head(), request, source.name)
    by_role = request.columns if isinstance(request.columns, Mapping) else None
    roles = find_roles(
        dialect.names,
        by_role,
        request.keep,
        source.name,
        heading=request.heading,
        cells=dialect.hint_cells,
        times=request.times,
    )
    table, bad = _read_table(source, dialect, roles)
    if table.num_rows == 0:
        raise InputError(
            f"{source.name}: a header, but no rows"
            if not bad
            else f"{source.name}: no row has {dialect.width} cells"
        )
    check_quotes(
        source, dialect.encoding, dialect.delimiter, dialect.header_lines + table.num_rows + bad
    )
    repairs = (
        (Repair("rows with too many or too few cells dropped", bad, source.name),) if bad else ()
    )
    return build_raw_log(
        table.columns,
        dialect.names,
        roles,
        request,
        source.name,
        first=dialect.header_lines + 1,
        repairs=repairs,
    )


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
            sink.write((",".join(_quote(name) for name in table.column_names) + "\n").encode())
        head = False
        plain = not any(_quote(name) != name for name in table.column(0).unique().to_pylist())
        texts = any(pa.types.is_string(kind) for kind in table.schema.types[1:])
        style = "none" if plain and not texts else "needed"
        pc.write_csv(table, sink, pc.WriteOptions(include_header=False, quoting_style=style))


def _quote(text: str) -> str:
    risky = (
        not text or text != text.strip() or any(mark in text for mark in ',"\n\r') or text[0] == "#"
    )
    return '"' + text.replace('"', '""') + '"' if risky else text


def detect_dialect(head: bytes, request: Request, where: str) -> Dialect:
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
        raise UnknownFormatError(
            f"{where}: neither text nor a format that is known; 'gpszip formats' lists what can be read"
        )
    encoding = _detect_encoding(head)
    text = head.decode(encoding, errors="ignore").lstrip("\ufeff")
    named = request.columns if isinstance(request.columns, tuple) else None

    # What comes before the table.
    lines = _LINE_END.split(text)
    delimiter, start = _declared_delimiter(lines)
    start = next(
        (
            i
            for i in range(start, len(lines))
            if lines[i].strip() and not lines[i].lstrip().startswith("#")
        ),
        len(lines),
    )
    if (
        start == len(lines) - 1
        and len(lines[start]) * 2 > len(text)
        and len(head) >= _MAX_LINE_BYTES
    ):
        raise InputError(
            f"{where}: its first line is longer than {_MAX_LINE_BYTES // 1024} KiB, so it has no header of a log"
        )
    if named is None:
        start = _find_header(lines, start, delimiter, request, where)
    titles = lines[start] if start < len(lines) else ""

    # The names of its columns.
    commented = (
        lines[start - 1].lstrip(" #\t") if start and lines[start - 1].startswith("#") else None
    )
    delimiter = delimiter or _detect_delimiter(titles)
    first = _split_cells(titles, delimiter)
    if not any(looks_like_number(cell) or looks_like_time(cell) for cell in first):
        names, start = first, start + 1
    elif commented is not None and len(_split_cells(commented, delimiter)) == len(
        first
    ):  # the header is a comment: '# t x y'
        names = _split_cells(commented, delimiter)
    elif named is not None:
        names = tuple(f"column {i + 1}" for i in range(len(first)))
    else:
        raise InputError(
            f"{where}: no header; its first row is {titles[:60]!r}; name the columns in their order: --columns t,x,y"
        )

    # Its first rows.
    rows = _split_rows(lines[start:], delimiter)
    names, spare = _fit_names(names, rows, where)
    return Dialect(
        encoding,
        delimiter,
        start,
        _rename_columns(names, named, where),
        rows,
        named is not None,
        spare,
    )


def _declared_delimiter(lines: Sequence[str]) -> tuple[str, int]:
    """The delimiter that a first line ``sep=;`` says, as Excel has it, and how many lines that takes."""
    said = _SEP.fullmatch(lines[0]) if lines else None
    return (said[1], 1) if said else ("", 0)


def _find_header(
    lines: Sequence[str], start: int, delimiter: str, request: Request, where: str
) -> int:
    """The line that names a time and a position, if what seems to be the header doesn't: other lines may come before it."""
    by_role = request.columns if isinstance(request.columns, Mapping) else None
    for i in range(start, min(start + _SAMPLE_ROWS, len(lines))):
        names = _split_cells(lines[i], delimiter or _detect_delimiter(lines[i]))
        if any(looks_like_number(cell) or looks_like_time(cell) for cell in names):
            continue
        with suppress(InputError):
            find_roles(names, by_role, (), where)
            return i
    return start


def _split_rows(lines: Sequence[str], delimiter: str) -> tuple[tuple[str, ...], ...]:
    """Cells of the first rows; the last line may be cut off."""
    full = lines[:-1] if len(lines) > 1 and lines[-1] else lines
    _allow_cell_size(max(map(len, full), default=0))
    try:
        rows = [
            row
            for row, _ in zip(
                csv.reader(full, delimiter=delimiter), range(_SAMPLE_ROWS), strict=False
            )
        ]
    except csv.Error:
        rows = []
    return tuple(tuple(row) for row in rows if row)


def _fit_names(
    names: tuple[str, ...], rows: Sequence[Sequence[str]], where: str
) -> tuple[tuple[str, ...], int]:
    """Names of the columns where header and rows differ by an empty cell at the end, and how many cells rows have more.

    Raises
    ------
    InputError
        If they differ in another way, so that nobody can tell which column is what.
    """
    widths = {len(row) for row in rows}
    if not names or len(widths) != 1 or widths == {len(names)}:
        return names, 0
    (width,) = widths
    if width == len(names) - 1 and not names[-1].strip():
        return names[:-1], 0
    if width == len(names) + 1 and all(not row[-1].strip() for row in rows):
        return names, 1
    raise InputError(
        f"{where}: its header has {len(names)} cells, but its rows have {width}; give them as many, "
        "or leave out the header and name the columns in their order: --columns t,x,y"
    )


def _detect_encoding(head: bytes) -> str:
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    try:
        head[: len(head) - 4 if len(head) > 8 else None].decode(
            "utf-8"
        )  # a letter may be cut at the end
    except UnicodeDecodeError as error:
        if error.start < len(head) - 8:
            return "latin-1"
    return "utf-8"


def _detect_delimiter(line: str) -> str:
    best = max(",;\t|", key=line.count)
    if line.count(best):
        return best
    return " " if " " in line.strip() else ","


def _split_cells(line: str, delimiter: str) -> tuple[str, ...]:
    _allow_cell_size(len(line))
    return tuple(next(csv.reader([line], delimiter=delimiter), ()))


def _allow_cell_size(size: int) -> None:
    """Let Python's reader take cells of this size: by default it refuses any above 128 KiB."""
    csv.field_size_limit(max(csv.field_size_limit(), size + 1))


def _rename_columns(
    names: Sequence[str], named: tuple[str, ...] | None, where: str
) -> tuple[str, ...]:
    if named is None:
        return tuple(names)
    if len(named) > len(names):
        raise InputError(f"{where}: has {len(names)} columns, but --columns names {len(named)}")
    given = [
        name if name not in ("", "-", "_") else f"column {i + 1}" for i, name in enumerate(named)
    ]
    return (*given, *(f"column {i + 1}" for i in range(len(named), len(names))))


def _read_table(
    source: Source, dialect: Dialect, roles: Roles, kept: Mapping[str, Any] | None = None
) -> tuple[Any, int]:
    text = dict.fromkeys(
        map(str, (*roles.axes, *roles.time, *roles.hemispheres)), pa.string()
    ) | dict(kept or {})
    table, bad = _parse_typed(source, dialect, roles, text)
    if kept is None and (
        others := {
            str(i): pa.string()
            for i in roles.keep.values()
            if table.column(str(i)).type not in ATTRIBUTE_TYPES
        }
    ):
        return _read_table(source, dialect, roles, others)
    return table, bad


def _parse_typed(
    source: Source, dialect: Dialect, roles: Roles, text: Mapping[str, Any]
) -> tuple[Any, int]:
    try:
        return _parse_with_types(
            source, dialect, roles, {**text, **guess_column_types(dialect, roles)}, None
        ), 0
    except (pa.ArrowInvalid, UnicodeDecodeError):
        pass  # some row or cell is not like the others: read texts, and let each speak for itself
    skipped: list[None] = []

    def skip(_row: Any) -> str:
        skipped.append(None)
        return "skip"

    try:
        return _parse_with_types(
            source, replace(dialect, encoding=confirm_encoding(source, dialect)), roles, text, skip
        ), len(skipped)
    except (pa.ArrowInvalid, UnicodeDecodeError) as error:
        raise InputError(f"{source.name}: {explain_table_error(error)}") from None


def explain_table_error(error: Exception) -> str:
    """Say why text can't be read as a table."""
    if "straddling" in str(error):
        return (
            f"a row is longer than {BLOCK >> 20} MiB; if a quote before it is not closed, close it"
        )
    return f"can't be read as a table: {str(error).splitlines()[0][:120]}"


def confirm_encoding(source: Source, dialect: Dialect) -> str:
    """Look through all of the log: the first letter that is not UTF-8 may come late."""
    decoder = codecs.getincrementaldecoder(dialect.encoding)()
    with source.open() as stream:
        try:
            while block := read_chunk(stream, 1 << 20):
                decoder.decode(block)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            if dialect.encoding == "utf-16":
                raise InputError(
                    f"{source.name}: damaged text: not all of it is UTF-16; bring it to UTF-8"
                ) from None
            return "latin-1"
    return dialect.encoding


def guess_column_types(dialect: Dialect, roles: Roles) -> dict[str, Any]:
    """Types that a sample of the rows tells for the columns of numbers, by the columns' indices as texts."""
    plain = (
        not any("," in cell for axis in roles.axes for cell in dialect.cells(axis))
        and not roles.hemispheres
    )
    fast = {str(axis): pa.float64() for axis in roles.axes} if plain else {}
    if len(roles.time) == 1:
        cells = [cell.strip() for cell in dialect.cells(roles.time[0])]
        padded = any(
            re.match(r"0\d", cell) for cell in cells
        )  # 080100 may be a time of day: only its text tells
        if padded:
            return fast
        if cells and all(cell.isdigit() for cell in cells):
            fast[str(roles.time[0])] = pa.int64()
        elif cells and all(looks_like_number(cell) for cell in cells):
            fast[str(roles.time[0])] = pa.float64()
    return fast


def _parse_with_types(
    source: Source,
    dialect: Dialect,
    roles: Roles,
    types: Mapping[str, Any],
    skip: Callable[[Any], str] | None,
) -> Any:
    if roles.id is not None:
        types = {**types, str(roles.id): pa.dictionary(pa.int32(), pa.string())}
    names = [str(i) for i in range(dialect.width)]
    with source.open() as stream:
        try:
            return pc.read_csv(
                stream,
                pc.ReadOptions(
                    column_names=names,
                    skip_rows=dialect.header_lines,
                    encoding=dialect.encoding,
                    block_size=BLOCK,
                ),
                pc.ParseOptions(
                    delimiter=dialect.delimiter, newlines_in_values=True, invalid_row_handler=skip
                ),
                pc.ConvertOptions(
                    include_columns=[str(i) for i in roles.used],
                    column_types=types,
                    null_values=NULL_TEXTS,
                ),
            )
        except OSError as error:
            raise InputError(
                f"{source.name}: damaged gzip file ({error}); fetch it again, or unpack what is left of it with zcat"
            ) from None
