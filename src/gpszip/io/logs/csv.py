"""Logs as text with columns: separated by commas, semicolons, tabs, bars or spaces.

:func:`detect_dialect` finds the encoding, the delimiter and the header from the first bytes of a
file. :func:`read_csv` then reads all columns at once; :mod:`gpszip.io.logs.csv_batches` reads
them in batches. Arrow parses the cells.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, BinaryIO, NamedTuple

import pyarrow as pa
import pyarrow.csv as pc

from gpszip.errors import InputError, NoPositionsError, UnknownFormatError
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.track_rows import TrackRows
from gpszip.io.logs.track_table import track_tables
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source
from gpszip.io.tables.quotes import check_quotes, quote_text
from gpszip.io.tables.roles import Roles, find_roles
from gpszip.io.tables.table import build_raw_log
from gpszip.io.values.arrow import looks_like_number, looks_like_time
from gpszip.model.read_result import Repair

__all__ = [
    "ATTRIBUTE_TYPES",
    "BLOCK",
    "ArrowOptions",
    "Dialect",
    "SkippedRows",
    "arrow_options",
    "confirm_encoding",
    "detect_dialect",
    "explain_table_error",
    "find_csv_roles",
    "guess_column_types",
    "malformed_rows_repair",
    "read_csv",
    "read_table",
    "sniff_csv",
    "write_csv",
]

#: Texts of cells without a value. Words such as n/a are read as text, so that a message about a
#: dropped row can show them.
NULL_TEXTS = [""]

#: Types of attributes, the first that fits all cells of a column; text keeps them letter by letter.
ATTRIBUTE_TYPES = (pa.null(), pa.int64(), pa.float64(), pa.string())

#: Bytes that Arrow reads at a time; no row may be longer.
BLOCK = 1 << 22

#: Rows that the dialect is found from, and lines among which the header is looked for.
_SAMPLE_ROWS = 50

#: Bytes of a first line that is too long for a header: all that a format is found from.
_MAX_LINE_BYTES = 1 << 18

#: Bytes at the end of a head that may be a cut-off character of UTF-8.
_MAX_CUT_BYTES = 8

#: Bytes that are decoded at a time to check an encoding.
_CHUNK_BYTES = 1 << 20

#: Control characters that text doesn't hold: all but tab, line feed, form feed, carriage return and
#: end of file.
_BINARY_CONTROLS = bytes(byte for byte in range(32) if byte not in (9, 10, 12, 13, 26))

#: Text has at most one other control character in this number of bytes.
_BYTES_PER_CONTROL = 20

#: Letters of a header and of an error that messages show.
_MAX_SHOWN_LETTERS = 60
_MAX_REASON_LETTERS = 120

#: Names by which ``--columns`` passes over a column.
_UNNAMED = ("", "-", "_")

_SEP = re.compile(r"\"?sep=(.)\"?\s*", re.IGNORECASE)
_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True)
class Dialect:
    """How a file writes its table.

    Parameters
    ----------
    encoding : str
        Name of Python's codec.
    delimiter : str
        Character between cells.
    header_lines : int
        Number of lines up to and including the header.
    names : tuple of str
        Names of the columns.
    sample_rows : tuple of tuple of str
        Cells of the first rows.
    named_by_user : bool
        Whether the user named the columns.
    trailing_cells : int
        Empty cells at the end of each row for which the header has no name.
    """

    encoding: str
    delimiter: str
    header_lines: int
    names: tuple[str, ...]
    sample_rows: tuple[tuple[str, ...], ...]
    named_by_user: bool = False
    trailing_cells: int = 0

    @property
    def width(self) -> int:
        """Number of cells in a row."""
        return len(self.names) + self.trailing_cells

    def cells(self, column: int) -> list[str]:
        """Return the cells of a column in the first rows that are not blank."""
        return [
            row[column] for row in self.sample_rows if len(row) > column and row[column].strip()
        ]

    def hint_cells(self, column: int) -> list[str]:
        """Return the cells that hint at what a column holds; none if the user named the columns."""
        return [] if self.named_by_user else self.cells(column)


class ArrowOptions(NamedTuple):
    """Options for Arrow's reader of CSV, in the order of its arguments."""

    read: Any
    parse: Any
    convert: Any


class SkippedRows:
    """Lets Arrow skip rows with a wrong number of cells, and counts them."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, _row: Any) -> str:
        """Count a row, and tell Arrow to skip it."""
        self.count += 1
        return "skip"


def sniff_csv(head: bytes) -> bool:
    r"""Whether a file that starts like this is text.

    Examples
    --------
    >>> sniff_csv(b"t,x,y\n"), sniff_csv(bytes(range(256)))
    (True, False)
    """
    if head.startswith(_UTF16_MARKS):
        return True
    controls = len(head) - len(head.translate(None, _BINARY_CONTROLS))
    return b"\0" not in head and controls * _BYTES_PER_CONTROL <= len(head)


# Reading


def read_csv(source: Source, request: Request) -> RawLog:
    """Read a log from text with a header, or with columns that the request names.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns, unit of time and attributes.

    Returns
    -------
    RawLog
        Rows with a wrong number of cells are not in it, but counted.

    Raises
    ------
    InputError
        If there is no header, no row, or no column for time or position.
    UnknownFormatError
        If the file is no text.
    """
    # Find the columns and read them.
    dialect = detect_dialect(source.head(), request, source.name)
    roles = find_csv_roles(dialect, request, source.name)
    table, malformed = read_table(source, dialect, roles)
    if table.num_rows == 0:
        problem = f"no row has {dialect.width} cells" if malformed else "a header, but no rows"
        raise InputError(problem, path=source.name)

    # A quote that is never closed would have swallowed rows.
    records = dialect.header_lines + table.num_rows + malformed
    check_quotes(source, dialect.encoding, dialect.delimiter, records)

    # Interpret the cells; row numbers in messages count the lines of the header, too.
    return build_raw_log(
        table.columns,
        dialect.names,
        roles,
        request,
        source.name,
        first=dialect.header_lines + 1,
        repairs=malformed_rows_repair(malformed, source.name),
    )


def find_csv_roles(dialect: Dialect, request: Request, where: str) -> Roles:
    """Find out which column of a file holds what.

    Parameters
    ----------
    dialect : Dialect
        How the file writes its table.
    request : Request
        Columns that the user names, and columns to keep.
    where : str
        Name of the log.
    """
    return find_roles(
        dialect.names,
        request.columns if isinstance(request.columns, Mapping) else None,
        request.keep,
        where,
        heading=request.heading,
        accuracy=request.accuracy,
        cells=dialect.hint_cells,
        times=request.times,
        optional=request.optional,
    )


def malformed_rows_repair(count: int, where: str) -> tuple[Repair, ...]:
    """Return the record of rows with a wrong number of cells; empty if there are none."""
    if not count:
        return ()
    return (Repair("rows with too many or too few cells dropped", count, where),)


def read_table(source: Source, dialect: Dialect, roles: Roles) -> tuple[Any, int]:
    """Read the columns that are used.

    Attributes that are neither numbers nor text for Arrow, such as dates, are read again as texts,
    since those are kept letter by letter.

    Returns
    -------
    pyarrow.Table
        The columns, named by their indices.
    int
        Number of rows with a wrong number of cells.
    """
    text_columns = (*roles.axes, *roles.time, *roles.hemispheres)
    types = dict.fromkeys(map(str, text_columns), pa.string())
    table, malformed = _parse_typed(source, dialect, roles, types)
    other_types = {
        str(column): pa.string()
        for column in roles.keep.values()
        if table.column(str(column)).type not in ATTRIBUTE_TYPES
    }
    if other_types:
        return _parse_typed(source, dialect, roles, types | other_types)
    return table, malformed


def _parse_typed(
    source: Source, dialect: Dialect, roles: Roles, types: Mapping[str, Any]
) -> tuple[Any, int]:
    """Read times and coordinates as the numbers that the first rows suggest, or else as texts."""
    # By the types of the first rows: this is fast, but fails if any cell or row is different.
    with suppress(pa.ArrowInvalid, UnicodeDecodeError):
        typed = {**types, **guess_column_types(dialect, roles)}
        return _parse(source, dialect, roles, typed, None), 0

    # As texts, each of which is interpreted for itself.
    skipped = SkippedRows()
    confirmed = replace(dialect, encoding=confirm_encoding(source, dialect))
    try:
        return _parse(source, confirmed, roles, types, skipped), skipped.count
    except (pa.ArrowInvalid, UnicodeDecodeError) as error:
        raise InputError(explain_table_error(error), path=source.name) from None


def _parse(
    source: Source,
    dialect: Dialect,
    roles: Roles,
    types: Mapping[str, Any],
    skipped: SkippedRows | None,
) -> Any:
    if roles.id is not None:
        types = {**types, str(roles.id): pa.dictionary(pa.int32(), pa.string())}
    options = arrow_options(dialect, list(map(str, roles.used)), types, skipped)
    with source.open() as stream:
        try:
            return pc.read_csv(stream, *options)
        except OSError as error:
            raise InputError(
                f"damaged gzip file ({error})",
                path=source.name,
                remedy="fetch it again, or unpack what is left of it with zcat",
            ) from None


def arrow_options(
    dialect: Dialect,
    columns: Sequence[str],
    types: Mapping[str, Any],
    skipped: SkippedRows | None,
    *,
    use_threads: bool = True,
) -> ArrowOptions:
    """Return the options by which Arrow reads a file.

    Parameters
    ----------
    dialect : Dialect
        How the file writes its table.
    columns : sequence of str
        Columns to read; a column is named by its index.
    types : mapping of str to pyarrow.DataType
        Types of columns; Arrow finds those that are left out.
    skipped : SkippedRows, optional
        Counts rows with a wrong number of cells. Without it, such a row raises
        ``pyarrow.ArrowInvalid``.
    use_threads : bool
        Whether Arrow parses blocks in several threads.
    """
    return ArrowOptions(
        pc.ReadOptions(
            column_names=[str(i) for i in range(dialect.width)],
            skip_rows=dialect.header_lines,
            encoding=dialect.encoding,
            block_size=BLOCK,
            use_threads=use_threads,
        ),
        pc.ParseOptions(
            delimiter=dialect.delimiter, newlines_in_values=True, invalid_row_handler=skipped
        ),
        pc.ConvertOptions(
            include_columns=list(columns), column_types=dict(types), null_values=NULL_TEXTS
        ),
    )


def guess_column_types(dialect: Dialect, roles: Roles) -> dict[str, Any]:
    """Guess the types of coordinates and times from the first rows.

    Parameters
    ----------
    dialect : Dialect
        How the file writes its table, with its first rows.
    roles : Roles
        Which column holds what.

    Returns
    -------
    dict of str to pyarrow.DataType
        Types of the columns that hold numbers, by the index of the column.
    """
    # Coordinates are plain numbers if they have no decimal comma and no hemisphere.
    has_comma = any("," in cell for axis in roles.axes for cell in dialect.cells(axis))
    types = {}
    if not has_comma and not roles.hemispheres:
        types = {str(axis): pa.float64() for axis in roles.axes}

    # Times are, unless they have a leading zero: 080100 may be a time of day.
    if len(roles.time) != 1:
        return types
    column = str(roles.time[0])
    cells = [cell.strip() for cell in dialect.cells(roles.time[0])]
    if any(re.match(r"0\d", cell) for cell in cells):
        return types
    if cells and all(cell.isdigit() for cell in cells):
        types[column] = pa.int64()
    elif cells and all(looks_like_number(cell) for cell in cells):
        types[column] = pa.float64()
    return types


def explain_table_error(error: Exception) -> str:
    """Say why Arrow can't read text as a table."""
    if "straddling" in str(error):
        return (
            f"a row is longer than {BLOCK >> 20} MiB; if a quote before it is not closed, close it"
        )
    return f"can't be read as a table: {str(error).splitlines()[0][:_MAX_REASON_LETTERS]}"


def confirm_encoding(source: Source, dialect: Dialect) -> str:
    """Return the encoding of the full log: the first letter that isn't UTF-8 may come late."""
    decoder = codecs.getincrementaldecoder(dialect.encoding)()
    with source.open() as stream:
        try:
            while chunk := read_chunk(stream, _CHUNK_BYTES):
                decoder.decode(chunk)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            if dialect.encoding == "utf-16":
                raise InputError(
                    "damaged text: not all of it is UTF-16",
                    path=source.name,
                    remedy="bring it to UTF-8",
                ) from None
            return "latin-1"
    return dialect.encoding


# The dialect


class _Header(NamedTuple):
    """The header of a table.

    Parameters
    ----------
    names : tuple of str
        Names of the columns.
    delimiter : str
        Character between cells.
    first_row : int
        Index of the line of the first row.
    """

    names: tuple[str, ...]
    delimiter: str
    first_row: int


def detect_dialect(head: bytes, request: Request, where: str) -> Dialect:
    """Find out from its first bytes how a file writes its table.

    1. Detect the encoding.
    2. Pass over blank lines, comments and other text before the table.
    3. Read the header and the first rows.

    Raises
    ------
    InputError
        If the file is empty, or has no header and the request names no columns.
    UnknownFormatError
        If it is no text.
    """
    # 1. The encoding
    if not head.strip():
        raise NoPositionsError(
            "empty file", path=where, remedy="a log needs a header and at least one row"
        )
    if not sniff_csv(head):
        raise UnknownFormatError(
            "neither text nor a format that is known",
            path=where,
            remedy="'gpszip formats' lists what can be read",
        )
    encoding = _detect_encoding(head)
    text = head.decode(encoding, errors="ignore").lstrip("\ufeff")

    # 2. What comes before the table
    names_by_user = request.columns if isinstance(request.columns, tuple) else None
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    delimiter, start = _declared_delimiter(lines)
    start = _skip_comments(lines, start)
    is_last_line = start == len(lines) - 1
    if is_last_line and len(lines[start]) * 2 > len(text) and len(head) >= _MAX_LINE_BYTES:
        raise InputError(
            f"its first line is longer than {_MAX_LINE_BYTES // 1024} KiB, so it has no header of "
            "a log",
            path=where,
        )
    if names_by_user is None:
        start = _find_header(lines, start, delimiter, request, where)

    # 3. The header and the first rows
    header = _read_header(lines, start, delimiter, where, is_required=names_by_user is None)
    rows = _split_rows(lines[header.first_row :], header.delimiter)
    names, trailing_cells = _fit_names(header.names, rows, where)
    return Dialect(
        encoding=encoding,
        delimiter=header.delimiter,
        header_lines=header.first_row,
        names=_rename_columns(names, names_by_user, where),
        sample_rows=rows,
        named_by_user=names_by_user is not None,
        trailing_cells=trailing_cells,
    )


def _detect_encoding(head: bytes) -> str:
    if head.startswith(_UTF16_MARKS):
        return "utf-16"
    try:
        # The last character may be cut.
        head[: len(head) - 4 if len(head) > _MAX_CUT_BYTES else None].decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start < len(head) - _MAX_CUT_BYTES:
            return "latin-1"
    return "utf-8"


def _declared_delimiter(lines: Sequence[str]) -> tuple[str, int]:
    """Return the delimiter that a first line ``sep=;`` declares, as Excel writes it.

    Returns
    -------
    str
        The delimiter; empty if none is declared.
    int
        Number of lines that the declaration takes.
    """
    declared = _SEP.fullmatch(lines[0]) if lines else None
    return (declared[1], 1) if declared else ("", 0)


def _skip_comments(lines: Sequence[str], start: int) -> int:
    """Return the index of the first line that is neither blank nor a comment."""
    for i in range(start, len(lines)):
        line = lines[i].lstrip()
        if line and not line.startswith("#"):
            return i
    return len(lines)


def _find_header(
    lines: Sequence[str], start: int, delimiter: str, request: Request, where: str
) -> int:
    """Find the line that names a time and a position: other text may come before it.

    Returns
    -------
    int
        Index of the line; ``start`` if no line names them.
    """
    by_role = request.columns if isinstance(request.columns, Mapping) else None
    for i in range(start, min(start + _SAMPLE_ROWS, len(lines))):
        names = _split_cells(lines[i], delimiter or _detect_delimiter(lines[i]))
        if _holds_values(names):
            continue
        with suppress(InputError):
            find_roles(names, by_role, (), where)
            return i
    return start


def _read_header(
    lines: Sequence[str], start: int, delimiter: str, where: str, *, is_required: bool
) -> _Header:
    """Read the names of the columns, from a line or from the comment before it.

    Parameters
    ----------
    lines : sequence of str
        The lines of the file.
    start : int
        Index of the line with the header, or with the first row if there is none.
    delimiter : str
        The delimiter that the file declares; empty if it declares none.
    where : str
        Name of the log.
    is_required : bool
        Whether a missing header is an error; else columns are numbered.
    """
    # Take the line as the header, unless its cells are values.
    line = lines[start] if start < len(lines) else ""
    delimiter = delimiter or _detect_delimiter(line)
    cells = _split_cells(line, delimiter)
    if not _holds_values(cells):
        return _Header(cells, delimiter, start + 1)

    # The header may be a comment: '# t x y'.
    if start and lines[start - 1].startswith("#"):
        comment = _split_cells(lines[start - 1].lstrip(" #\t"), delimiter)
        if len(comment) == len(cells):
            return _Header(comment, delimiter, start)

    # Without a header, the user has to name the columns.
    if is_required:
        raise InputError(
            f"no header; its first row is {line[:_MAX_SHOWN_LETTERS]!r}",
            path=where,
            remedy="name the columns in their order: --columns t,x,y",
        )
    return _Header(tuple(f"column {i + 1}" for i in range(len(cells))), delimiter, start)


def _holds_values(cells: Sequence[str]) -> bool:
    """Whether any cell is a number or a time, so that the line is no header."""
    return any(looks_like_number(cell) or looks_like_time(cell) for cell in cells)


def _detect_delimiter(line: str) -> str:
    best = max(",;\t|", key=line.count)
    if line.count(best):
        return best
    return " " if " " in line.strip() else ","


def _split_rows(lines: Sequence[str], delimiter: str) -> tuple[tuple[str, ...], ...]:
    """Return the cells of the first rows; the last line is passed over, as it may be cut off."""
    complete = lines[:-1] if len(lines) > 1 and lines[-1] else lines
    _allow_cell_size(max(map(len, complete), default=0))
    reader = csv.reader(complete, delimiter=delimiter)
    try:
        rows = [row for row, _ in zip(reader, range(_SAMPLE_ROWS), strict=False)]
    except csv.Error:
        rows = []
    return tuple(tuple(row) for row in rows if row)


def _split_cells(line: str, delimiter: str) -> tuple[str, ...]:
    _allow_cell_size(len(line))
    return tuple(next(csv.reader([line], delimiter=delimiter), ()))


def _allow_cell_size(size: int) -> None:
    """Let Python's reader take cells of this size; by default it refuses more than 128 KiB."""
    csv.field_size_limit(max(csv.field_size_limit(), size + 1))


def _fit_names(
    names: tuple[str, ...], rows: Sequence[Sequence[str]], where: str
) -> tuple[tuple[str, ...], int]:
    """Make up for an empty cell at the end of the header or of all rows.

    Returns
    -------
    tuple of str
        Names of the columns.
    int
        Number of empty cells at the end of each row that have no name.

    Raises
    ------
    InputError
        If header and rows differ in another way, so that columns can't be named.
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
        f"its header has {len(names)} cells, but its rows have {width}",
        path=where,
        remedy="give them as many, or leave out the header and name the columns in their order: "
        "--columns t,x,y",
    )


def _rename_columns(
    names: Sequence[str], names_by_user: tuple[str, ...] | None, where: str
) -> tuple[str, ...]:
    """Return the names that the user gives; other columns are numbered."""
    if names_by_user is None:
        return tuple(names)
    if len(names_by_user) > len(names):
        raise InputError(
            f"has {len(names)} columns, but --columns names {len(names_by_user)}", path=where
        )
    unnamed = len(names) - len(names_by_user)
    return tuple(
        name if name not in _UNNAMED else f"column {number}"
        for number, name in enumerate((*names_by_user, *[""] * unnamed), 1)
    )


# Writing


def write_csv(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write tracks as ``track_id,t,x,y[,z]`` or ``track_id,t,lat,lon``, and their attributes.

    Tracks without times have empty cells for ``t``; if no track has times, there is no such
    column.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the globe.
    sink : binary file
        The file to write to.
    """
    is_first = True
    for table in track_tables(tracks):
        if is_first:
            header = ",".join(quote_text(name) for name in table.column_names)
            sink.write((header + "\n").encode())
        is_first = False

        # Arrow quotes all texts or none: quote them only if one needs it.
        names = table.column(0).unique().to_pylist()
        has_texts = any(pa.types.is_string(kind) for kind in table.schema.types[1:])
        needs_quotes = has_texts or any(quote_text(name) != name for name in names)
        style = "needed" if needs_quotes else "none"
        pc.write_csv(table, sink, pc.WriteOptions(include_header=False, quoting_style=style))
