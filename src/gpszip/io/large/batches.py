"""Read one file of a log in batches of rows that fit in memory.

CSV and Parquet files are read block by block. Formats whose readers need the full file give one
batch. :func:`inspect_log_file` looks at the start of a file and returns a :class:`LogFile`;
:meth:`LogFile.batches` then reads its rows.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import reduce
from operator import or_
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.csv as pc

from gpszip.errors import InputError
from gpszip.io.logs import csv as csv_log
from gpszip.io.logs.formats import format_for_reading, format_named
from gpszip.io.logs.parquet import parquet_dataset
from gpszip.io.logs.plausibility import check_plausible, note_spreadsheet_days
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.storage.source import Source
from gpszip.io.tables.quotes import check_quotes
from gpszip.io.tables.roles import Roles, find_roles
from gpszip.io.tables.table import TableConventions, build_raw_log, find_conventions
from gpszip.io.tables.time_columns import find_date_order, join_time_columns
from gpszip.io.values.arrow import is_text, trimmed_text
from gpszip.io.values.coordinates import has_decimal_comma, has_decimal_point
from gpszip.io.values.dates import DateOrders, find_date_orders
from gpszip.model.read_result import Repair

__all__ = ["CoordinateKind", "LogFile", "ReadMode", "inspect_log_file"]

#: Rows of a Parquet file in one batch.
_PARQUET_BATCH_ROWS = 1 << 17

#: Letters of an error message of Arrow that are shown.
_MAX_REASON_LETTERS = 120


class ReadMode(Enum):
    """How the rows of a file are read."""

    CSV = "csv"
    PARQUET = "parquet"
    AT_ONCE = "at once"


class CoordinateKind(NamedTuple):
    """What the coordinates of a file are; files of one log have to agree.

    Parameters
    ----------
    geographic : bool
        Whether they are degrees.
    dimension : int
        Number of coordinates.
    crs : str
        Coordinate system that the file names; empty if it names none.
    """

    geographic: bool
    dimension: int
    crs: str


class _TableBatch(NamedTuple):
    """Rows of a table, and the number of rows before their end that have a wrong number of cells.

    Parameters
    ----------
    table : pyarrow.Table
        The rows, with the columns of ``roles.used``.
    malformed : int
        Rows with too many or too few cells since the batch before; they are not in ``table``.
    """

    table: Any
    malformed: int = 0


@dataclass(frozen=True, eq=False)
class LogFile:
    """One file of a log: what its start says, before its rows are read.

    Parameters
    ----------
    source : Source
        The file.
    request : Request
        Columns and unit of time.
    mode : ReadMode
        How its rows are read.
    names : tuple of str
        Names of its columns; empty for a file that is read at once.
    roles : Roles, optional
        Which column holds what; None for a file that is read at once.
    crs : str
        The coordinate system that the file names; empty if it names none.
    dialect : Dialect, optional
        How CSV is written; None for other formats.
    format : str
        Name of the format of a file that is read at once.
    """

    source: Source
    request: Request
    mode: ReadMode
    names: tuple[str, ...] = ()
    roles: Roles | None = None
    crs: str = ""
    dialect: csv_log.Dialect | None = None
    format: str = ""

    @property
    def name(self) -> str:
        """Name of the file in messages."""
        return self.source.name

    @property
    def coordinate_kind(self) -> CoordinateKind | None:
        """What its coordinates are; None if that shows only when its rows are read."""
        if self.roles is None:
            return None
        return CoordinateKind(self.roles.geographic, len(self.roles.axes), self.crs)

    def row_count(self) -> int | None:
        """Return the number of rows if the file states it, as Parquet does; else None."""
        if self.mode is not ReadMode.PARQUET or self.source.path is None:
            return None
        import pyarrow.parquet as pq

        return int(pq.ParquetFile(str(self.source.path)).metadata.num_rows)

    def batches(self) -> Iterator[RawLog]:
        """Yield the rows in the order of the file.

        Raises
        ------
        InputError
            If the file is damaged.
        """
        if self.mode is ReadMode.AT_ONCE:
            raw = format_named(self.format).read(self.source, self.request)
            yield check_plausible(raw, self.request)
            return

        try:
            yield from self._to_raw_logs(self._read_tables())
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            if self.mode is ReadMode.CSV:
                reason = csv_log.explain_table_error(error)
            else:
                reason = f"damaged: {_shorten(error)}"
            raise InputError(f"{self.name}: {reason}") from None

    def _read_tables(self) -> Iterator[_TableBatch]:
        """Yield all rows, with numbers and times parsed where Arrow can parse them."""
        return _read_parquet(self) if self.mode is ReadMode.PARQUET else _read_csv(self)

    def _to_raw_logs(self, batches: Iterator[_TableBatch]) -> Iterator[RawLog]:
        """Interpret batches of a table.

        Decimal marks, the order of dates and the unit of time are found once, so that all batches
        are read alike.
        """
        assert self.roles is not None
        roles, request = self.roles, self.request
        row_number = 1 if self.dialect is None else self.dialect.header_lines + 1
        conventions: TableConventions | None = None
        for table, malformed in batches:
            # Find what holds for all rows, from the first batch that has some.
            if request.dates is None and table.num_rows:
                request = replace(request, dates=self._find_date_order(table, roles))
            has_first_rows = conventions is None and table.num_rows > 0
            if has_first_rows:
                conventions = find_conventions(
                    table.columns,
                    self.names,
                    roles,
                    request,
                    self.name,
                    decimal_comma=self._uses_decimal_comma(),
                )

            # Interpret the columns.
            if table.num_rows or malformed:
                raw = build_raw_log(
                    table.columns,
                    self.names,
                    roles,
                    request,
                    self.name,
                    first=row_number,
                    conventions=conventions,
                    repairs=self._malformed_rows(malformed),
                    all_rows=False,
                )

                # The unit of time that the first rows suggest holds for all.
                if has_first_rows:
                    raw = check_plausible(raw, self.request)
                    unit = raw.guessed_unit.unit if raw.guessed_unit else self.request.time_unit
                    request = replace(request, time_unit=unit)
                elif request.time_unit == "excel" and self.request.time_unit is None:
                    raw = note_spreadsheet_days(raw)
                yield raw
            row_number += table.num_rows

    def _malformed_rows(self, count: int) -> tuple[Repair, ...]:
        if not count:
            return ()
        return (Repair("rows with too many or too few cells dropped", count, self.name),)

    def _uses_decimal_comma(self) -> bool | None:
        """Whether CSV has decimal commas in its coordinates; None for other formats.

        Only if one of the first rows has a comma, all rows are read for the answer.
        """
        if self.dialect is None or self.roles is None:
            return None
        cells = [cell for axis in self.roles.axes for cell in self.dialect.cells(axis)]
        if not any("," in cell for cell in cells):
            return False

        # A comma may also separate thousands: a decimal point in any row says so.
        encoding = csv_log.confirm_encoding(self.source, self.dialect)
        has_comma = False
        for batch in _read_csv_batches(self, {}, [], encoding, self.roles.axes):
            columns = [pa.chunked_array([column]) for column in batch.columns]
            has_comma = has_comma or has_decimal_comma(columns)
            if has_decimal_point(columns):
                return False
        return has_comma

    def _find_date_order(self, table: Any, roles: Roles) -> str | None:
        """Find the order of day, month and year; None if this batch has no such dates.

        It is found from all rows of the file, so that every batch is read in the same order.
        """
        assert self.names
        stated = find_date_order(self.names, roles, self.request)
        if stated is not None or not self._possible_date_orders(table).first:
            return stated
        orders = reduce(or_, (self._possible_date_orders(batch) for batch in self._text_tables()))
        return orders.decide(f"{self.name}: column {self.names[roles.time[-1]]!r}")

    def _text_tables(self) -> Iterator[Any]:
        """Yield all rows once more; every cell of CSV is a text."""
        if self.mode is ReadMode.PARQUET:
            yield from (batch.table for batch in _read_parquet(self))
            return
        assert self.dialect is not None
        encoding = csv_log.confirm_encoding(self.source, self.dialect)
        for batch in _read_csv_batches(self, {}, [], encoding):
            yield pa.Table.from_batches([batch])

    def _possible_date_orders(self, table: Any) -> DateOrders:
        """Return the orders of day, month and year in which all dates of a batch are valid."""
        assert self.roles is not None
        columns = dict(zip(self.roles.used, table.columns, strict=False))

        # Columns of type timestamp or date have no order.
        types = [columns[i].type for i in self.roles.time]
        if any(not is_text(kind) and pa.types.is_temporal(kind) for kind in types):
            return DateOrders()

        cells = join_time_columns(columns, self.names, self.roles, self.request, self.name)
        return find_date_orders(trimmed_text(cells)) if is_text(cells.type) else DateOrders()


def inspect_log_file(source: Source, format_: str | None, request: Request) -> LogFile | InputError:
    r"""Find the format and the columns of a file from its start.

    Parameters
    ----------
    source : Source
        The file.
    format_ : str, optional
        Its format; found from its content if left out.
    request : Request
        Columns and unit of time.

    Returns
    -------
    LogFile or InputError
        The error says why the file can't be read. It is returned, not raised, since a caller may
        go on with the other files of a log.

    Examples
    --------
    >>> from gpszip.io.storage.source import Source
    >>> source = Source("walk.csv", data=b"t,lat,lon\n0,48,11\n")
    >>> inspect_log_file(source, None, Request()).coordinate_kind
    CoordinateKind(geographic=True, dimension=2, crs='')
    """
    try:
        return _inspect(source, format_, request)
    except InputError as error:
        return error
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        return InputError(f"{source.name}: can't be read: {_shorten(error)}")


def _inspect(source: Source, format_: str | None, request: Request) -> LogFile:
    format_name = (format_for_reading(source) if format_ is None else format_named(format_)).name
    by_role = request.columns if isinstance(request.columns, Mapping) else None
    if format_name == "csv":
        dialect = csv_log.detect_dialect(source.head(), request, source.name)
        roles = find_roles(
            dialect.names, by_role, request.keep, source.name, cells=dialect.hint_cells
        )
        return LogFile(source, request, ReadMode.CSV, dialect.names, roles, dialect=dialect)

    # Parquet is read in batches from a plain file only: its footer has to be reached by seeking.
    if format_name == "parquet" and source.path is not None and not source.is_gzip:
        schema = parquet_dataset(source).schema
        names = _column_names(schema, request, source.name)
        roles = find_roles(names, by_role, request.keep, source.name)
        return LogFile(source, request, ReadMode.PARQUET, names, roles, _geoparquet_crs(schema))

    return LogFile(source, request, ReadMode.AT_ONCE, format=format_name)


def _column_names(schema: Any, request: Request, where: str) -> tuple[str, ...]:
    """Return the names of a table's columns, replaced by those that the user gives in order."""
    names = tuple(str(name) for name in schema.names)
    if not isinstance(request.columns, tuple):
        return names
    if len(request.columns) > len(names):
        raise InputError(
            f"{where}: has {len(names)} columns, but --columns names {len(request.columns)}"
        )
    renamed = tuple(
        old if new in ("", "-", "_") else new
        for new, old in zip(request.columns, names, strict=False)
    )
    return renamed + names[len(renamed) :]


def _geoparquet_crs(schema: Any) -> str:
    """Return the coordinate systems that GeoParquet names, as JSON; empty if it names none."""
    try:
        columns = json.loads((schema.metadata or {})[b"geo"])["columns"].values()
        return json.dumps([column.get("crs") for column in columns], sort_keys=True)
    except (KeyError, ValueError, AttributeError, TypeError):
        return ""


def _read_parquet(log_file: LogFile) -> Iterator[_TableBatch]:
    """Yield all rows of a Parquet file."""
    assert log_file.source.path is not None
    assert log_file.roles is not None
    dataset = parquet_dataset(log_file.source)
    columns = [str(dataset.schema.names[i]) for i in log_file.roles.used]
    for batch in dataset.to_batches(
        columns=columns,
        batch_size=_PARQUET_BATCH_ROWS,
        batch_readahead=1,
        fragment_readahead=1,
        use_threads=False,
    ):
        batch.validate(full=True)  # finds texts that aren't UTF-8, for instance
        yield _TableBatch(pa.Table.from_batches([batch]))


def _read_csv(log_file: LogFile) -> Iterator[_TableBatch]:
    """Yield all rows of a CSV file, typed as far as possible.

    1. Read columns by the types that the first rows suggest.
    2. From the row on where a cell contradicts its type, read every cell as text, and skip rows
       with a wrong number of cells.
    3. Check that no quote was left open, which would have swallowed rows.
    """
    assert log_file.dialect is not None
    assert log_file.roles is not None
    source, dialect = log_file.source, log_file.dialect

    # 1. By the types of the first rows.
    kept_types = _infer_kept_types(log_file)
    types = kept_types | csv_log.guess_column_types(dialect, log_file.roles)
    yielded_rows, is_complete = 0, False
    with suppress(pa.ArrowInvalid, UnicodeDecodeError):
        for batch in _read_csv_batches(log_file, types, None, dialect.encoding):
            yield _TableBatch(pa.Table.from_batches([batch]))
            yielded_rows += batch.num_rows
        is_complete = True
    if is_complete:
        lines = dialect.header_lines + yielded_rows
        check_quotes(source, dialect.encoding, dialect.delimiter, lines)
        return

    # 2. As texts. Rows that were yielded already are passed over.
    skipped: list[None] = []
    encoding = csv_log.confirm_encoding(source, dialect)
    read_rows = reported = 0
    for batch in _read_csv_batches(log_file, kept_types, skipped, encoding):
        new_rows = batch.slice(max(yielded_rows - read_rows, 0))
        read_rows += batch.num_rows
        yield _TableBatch(pa.Table.from_batches([new_rows]), len(skipped) - reported)
        reported = len(skipped)

    # 3. Quotes.
    lines = dialect.header_lines + read_rows + len(skipped)
    check_quotes(source, encoding, dialect.delimiter, lines)


def _infer_kept_types(log_file: LogFile) -> dict[str, Any]:
    """Find the types of the columns to keep: for each, the first that no cell contradicts.

    All rows decide, as they do for a file that is read at once.
    """
    assert log_file.roles is not None
    if not log_file.roles.keep:
        return {}
    assert log_file.dialect is not None
    encoding = csv_log.confirm_encoding(log_file.source, log_file.dialect)
    return {
        str(column): next(
            kind
            for kind in csv_log.ATTRIBUTE_TYPES
            if _column_fits(log_file, column, kind, encoding)
        )
        for column in set(log_file.roles.keep.values())
    }


def _column_fits(log_file: LogFile, column: int, kind: Any, encoding: str) -> bool:
    """Whether every cell of a column can be read as a type."""
    if kind == pa.string():
        return True
    with suppress(pa.ArrowInvalid):
        for _ in _read_csv_batches(log_file, {str(column): kind}, [], encoding, [column]):
            pass
        return True
    return False


def _read_csv_batches(
    log_file: LogFile,
    types: Mapping[str, Any],
    skipped: list[None] | None,
    encoding: str,
    columns: Sequence[int] | None = None,
) -> Iterator[Any]:
    """Yield record batches of CSV, with columns named by their index.

    Parameters
    ----------
    log_file : LogFile
        The file.
    types : mapping of str to pyarrow.DataType
        Types of columns; text if left out.
    skipped : list, optional
        Gets an item for each row with a wrong number of cells. Without it, such a row raises
        ``pyarrow.ArrowInvalid``.
    encoding : str
        Encoding of the file.
    columns : sequence of int, optional
        Columns to read; those of ``roles.used`` if left out.
    """
    dialect, roles = log_file.dialect, log_file.roles
    assert dialect is not None
    assert roles is not None
    wanted = [str(i) for i in (roles.used if columns is None else columns)]
    texts = dict.fromkeys(wanted, pa.string())

    def skip(_row: Any) -> str:
        assert skipped is not None
        skipped.append(None)
        return "skip"

    with log_file.source.open() as stream:
        yield from pc.open_csv(
            stream,
            pc.ReadOptions(
                column_names=[str(i) for i in range(dialect.width)],
                skip_rows=dialect.header_lines,
                encoding=encoding,
                block_size=csv_log.BLOCK,
                use_threads=False,
            ),
            pc.ParseOptions(
                delimiter=dialect.delimiter,
                newlines_in_values=True,
                invalid_row_handler=None if skipped is None else skip,
            ),
            pc.ConvertOptions(
                include_columns=wanted,
                column_types=texts | dict(types),
                null_values=csv_log.NULL_TEXTS,
            ),
        )


def _shorten(error: Exception) -> str:
    """Return the first line of an error message."""
    return str(error).splitlines()[0][:_MAX_REASON_LETTERS]
