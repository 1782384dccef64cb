"""Logs batch by batch: each file of a log is a shard, whose rows come in pieces that fit in memory."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce
from operator import or_
from typing import Any

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

__all__ = ["LogFile", "inspect_log_file"]

#: Rows of Parquet that are read at a time.
_PARQUET_BATCH_ROWS = 1 << 17


@dataclass(frozen=True, eq=False)
class LogFile:
    """One file of a log, not read yet; what it holds is known from its head.

    Parameters
    ----------
    source : Source
        The file.
    request : Request
        Columns and unit of time.
    kind : str
        ``csv``, ``parquet``, or ``whole`` for a format that is read at once.
    names : tuple of str
        Titles of its columns.
    roles : Roles, optional
        Which column is what; unknown of a format that is read at once.
    crs : str
        The coordinate system that the file names; empty where it names none.
    dialect : Dialect, optional
        How text is written.
    format : str
        Name of the format of a file that is read at once.
    """

    source: Source
    request: Request
    kind: str
    names: tuple[str, ...] = ()
    roles: Roles | None = None
    crs: str = ""
    dialect: csv_log.Dialect | None = None
    format: str = ""

    @property
    def name(self) -> str:
        """What messages call it."""
        return self.source.name

    @property
    def coordinate_kind(self) -> tuple[bool, int, str] | None:
        """Whether its coordinates are degrees, how many they are, and their system; None where that is not known yet."""
        return (
            None if self.roles is None else (self.roles.geographic, len(self.roles.axes), self.crs)
        )

    def rows(self) -> int | None:
        """Number of rows, where that is told before they are read."""
        if self.kind != "parquet" or self.source.path is None:
            return None
        import pyarrow.parquet as pq

        return int(pq.ParquetFile(str(self.source.path)).metadata.num_rows)

    def batches(self) -> Iterator[RawLog]:
        """Yield the rows in their order.

        Raises
        ------
        InputError
            If the file is damaged.
        """
        if self.kind == "whole":
            yield check_plausible(
                format_named(self.format).read(self.source, self.request), self.request
            )
            return
        try:
            yield from self._to_raw_logs(
                _read_parquet_tables(self) if self.kind == "parquet" else _read_csv_tables(self)
            )
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            said = (
                csv_log.explain_table_error(error)
                if self.kind == "csv"
                else f"damaged: {str(error).splitlines()[0][:120]}"
            )
            raise InputError(f"{self.name}: {said}") from None

    def _to_raw_logs(self, tables: Iterator[tuple[Any, int]]) -> Iterator[RawLog]:
        roles, request, first = (
            self.roles,
            self.request,
            1 if self.dialect is None else self.dialect.header_lines + 1,
        )
        conventions: TableConventions | None = None
        assert roles is not None
        for table, bad in tables:
            # What the first rows tell holds for all.
            if request.dates is None and table.num_rows:
                request = replace(request, dates=self._find_date_order(table, roles))
            first_rows = conventions is None and table.num_rows > 0
            if first_rows:
                conventions = find_conventions(
                    table.columns,
                    self.names,
                    roles,
                    request,
                    self.name,
                    decimal_comma=self._uses_decimal_comma(),
                )

            repairs = (
                (Repair("rows with too many or too few cells dropped", bad, self.name),)
                if bad
                else ()
            )
            if table.num_rows or bad:
                raw = build_raw_log(
                    table.columns,
                    self.names,
                    roles,
                    request,
                    self.name,
                    first=first,
                    conventions=conventions,
                    repairs=repairs,
                    all_rows=False,
                )
                if first_rows:
                    raw = check_plausible(raw, self.request)
                    request = replace(
                        request,
                        time_unit=raw.guessed_unit.unit
                        if raw.guessed_unit
                        else self.request.time_unit,
                    )
                elif request.time_unit == "excel" and self.request.time_unit is None:
                    raw = note_spreadsheet_days(raw)
                yield raw
            first += table.num_rows

    def _uses_decimal_comma(self) -> bool | None:
        """Whether numbers have decimal commas. If the first rows have some, all are looked at."""
        if self.dialect is None or self.roles is None:
            return None
        cells = [cell for axis in self.roles.axes for cell in self.dialect.cells(axis)]
        if not any("," in cell for cell in cells):
            return False
        comma = False
        for batch in _read_csv_batches(
            self, {}, [], csv_log.confirm_encoding(self.source, self.dialect), self.roles.axes
        ):
            columns = [pa.chunked_array([column]) for column in batch.columns]
            comma = comma or has_decimal_comma(columns)
            if has_decimal_point(columns):
                return False
        return comma

    def _find_date_order(self, table: Any, roles: Roles) -> str | None:
        """Order of day, month and year, from all rows, so that it is the same for all; None where this batch has no such dates."""
        assert self.names
        named = find_date_order(self.names, roles, self.request)
        if named is not None or not self._possible_date_orders(table).first:
            return named
        found = reduce(or_, (self._possible_date_orders(batch) for batch in self._tables_as_text()))
        return found.decide(f"{self.name}: column {self.names[roles.time[-1]]!r}")

    def _tables_as_text(self) -> Iterator[Any]:
        """Yield all rows once more, those of text with all cells as texts."""
        if self.kind == "parquet":
            yield from (table for table, _ in _read_parquet_tables(self))
            return
        assert self.dialect is not None
        encoding = csv_log.confirm_encoding(self.source, self.dialect)
        yield from (
            pa.Table.from_batches([batch]) for batch in _read_csv_batches(self, {}, [], encoding)
        )

    def _possible_date_orders(self, table: Any) -> DateOrders:
        """Orders in which a batch's dates can be read."""
        assert self.roles is not None
        roles, columns = self.roles, dict(zip(self.roles.used, table.columns, strict=False))
        if any(
            not is_text(columns[i].type) and pa.types.is_temporal(columns[i].type)
            for i in roles.time
        ):
            return DateOrders()
        cells = join_time_columns(columns, self.names, roles, self.request, self.name)
        return find_date_orders(trimmed_text(cells)) if is_text(cells.type) else DateOrders()


def inspect_log_file(source: Source, format_: str | None, request: Request) -> LogFile | InputError:
    """Return a file of a log with what its head says, or what is wrong with it.

    Parameters
    ----------
    source : Source
        The file.
    format_ : str, optional
        Its format; told from the content where left out.
    request : Request
        Columns and unit of time.
    """
    try:
        return _inspect(source, format_, request)
    except InputError as error:
        return error
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        return InputError(f"{source.name}: can't be read: {str(error).splitlines()[0][:120]}")


def _inspect(source: Source, format_: str | None, request: Request) -> LogFile:
    kind = (format_named(format_) if format_ is not None else format_for_reading(source)).name
    by_role = request.columns if isinstance(request.columns, Mapping) else None
    if kind == "csv":
        dialect = csv_log.detect_dialect(source.head(), request, source.name)
        roles = find_roles(
            dialect.names, by_role, request.keep, source.name, cells=dialect.hint_cells
        )
        return LogFile(source, request, kind, dialect.names, roles, dialect=dialect)
    if kind == "parquet" and source.path is not None and not source.is_gzip:
        schema = parquet_dataset(source).schema
        names = tuple(str(name) for name in schema.names)
        if isinstance(request.columns, tuple):
            if len(request.columns) > len(names):
                raise InputError(
                    f"{source.name}: has {len(names)} columns, but --columns names {len(request.columns)}"
                )
            names = (*(new if new not in ("", "-", "_") else old for new, old in zip(request.columns, names, strict=False)),
                     *names[len(request.columns) :])  # fmt: skip
        return LogFile(
            source,
            request,
            kind,
            names,
            find_roles(names, by_role, request.keep, source.name),
            _geoparquet_crs(schema),
        )
    return LogFile(source, request, "whole", format=kind)


def _geoparquet_crs(schema: Any) -> str:
    """The coordinate system that GeoParquet names."""
    try:
        columns = json.loads((schema.metadata or {})[b"geo"])["columns"].values()
        return json.dumps([column.get("crs") for column in columns], sort_keys=True)
    except (KeyError, ValueError, AttributeError, TypeError):
        return ""


def _read_parquet_tables(log_file: LogFile) -> Iterator[tuple[Any, int]]:
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
        batch.validate(full=True)  # texts that are no UTF-8, for instance
        yield pa.Table.from_batches([batch]), 0


def _read_csv_tables(log_file: LogFile) -> Iterator[tuple[Any, int]]:
    """Read text by types that its first rows tell; from where that fails on, each cell as a text that speaks for itself."""
    assert log_file.dialect is not None
    assert log_file.roles is not None
    done, whole, kept = 0, False, _infer_kept_types(log_file)
    with suppress(pa.ArrowInvalid, UnicodeDecodeError):
        for batch in _read_csv_batches(
            log_file,
            kept | csv_log.guess_column_types(log_file.dialect, log_file.roles),
            None,
            log_file.dialect.encoding,
        ):
            yield pa.Table.from_batches([batch]), 0
            done += batch.num_rows
        whole = True
    if whole:
        check_quotes(
            log_file.source,
            log_file.dialect.encoding,
            log_file.dialect.delimiter,
            log_file.dialect.header_lines + done,
        )
        return
    skipped: list[None] = []
    encoding = csv_log.confirm_encoding(log_file.source, log_file.dialect)
    seen = told = 0
    for batch in _read_csv_batches(log_file, kept, skipped, encoding):
        fresh = batch.slice(max(done - seen, 0))
        seen += batch.num_rows
        yield pa.Table.from_batches([fresh]), len(skipped) - told
        told = len(skipped)
    check_quotes(
        log_file.source,
        encoding,
        log_file.dialect.delimiter,
        log_file.dialect.header_lines + seen + len(skipped),
    )


def _infer_kept_types(log_file: LogFile) -> dict[str, Any]:
    """Types of the columns to keep, which only the whole file tells: the first that no cell contradicts."""
    assert log_file.roles is not None
    if not log_file.roles.keep:
        return {}
    assert log_file.dialect is not None
    encoding = csv_log.confirm_encoding(log_file.source, log_file.dialect)
    return {
        str(i): next(
            kind for kind in csv_log.ATTRIBUTE_TYPES if _column_fits(log_file, i, kind, encoding)
        )
        for i in set(log_file.roles.keep.values())
    }


def _column_fits(log_file: LogFile, column: int, kind: Any, encoding: str) -> bool:
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
    """Yield rows; those with another number of cells are an error, or gathered where there is a list for them."""
    dialect, roles = log_file.dialect, log_file.roles
    assert dialect is not None
    assert roles is not None
    wanted = [str(i) for i in (roles.used if columns is None else columns)]

    def skip(_row: Any) -> str:
        assert skipped is not None
        skipped.append(None)
        return "skip"

    texts = dict.fromkeys(wanted, pa.string())
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
