"""CSV read in batches: the rows of a file come in blocks that fit in memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import pyarrow as pa
import pyarrow.csv as pc

from gpszip.io.logs.csv import (
    ATTRIBUTE_TYPES,
    Dialect,
    SkippedRows,
    arrow_options,
    confirm_encoding,
    detect_dialect,
    explain_table_error,
    find_csv_roles,
    guess_column_types,
)
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.raw import Request
from gpszip.io.logs.table_batches import TableBatch, interpret_batches
from gpszip.io.storage.source import Source
from gpszip.io.tables.quotes import check_quotes
from gpszip.io.tables.roles import Roles
from gpszip.io.values.coordinates import has_decimal_comma, has_decimal_point

__all__ = ["read_csv_batches"]


def read_csv_batches(source: Source, request: Request) -> LogBatches:
    """Open a log in text with columns, to be read in batches.

    Parameters
    ----------
    source : Source
        The file.
    request : Request
        Columns, unit of time and attributes.

    Raises
    ------
    InputError
        If there is no header, or no column for time or position.
    UnknownFormatError
        If the file is no text.
    """
    dialect = detect_dialect(source.head(), request, source.name)
    roles = find_csv_roles(dialect, request, source.name)
    reader = _CsvReader(source, dialect, roles)
    return LogBatches(
        interpret_batches(reader, request), CoordinateKind(roles.geographic, len(roles.axes))
    )


@dataclass(frozen=True)
class _CsvReader:
    """Reads batches of cells, see :class:`gpszip.io.logs.table_batches.TableReader`."""

    source: Source
    dialect: Dialect
    roles: Roles

    @property
    def name(self) -> str:
        return self.source.name

    @property
    def column_names(self) -> tuple[str, ...]:
        return self.dialect.names

    @property
    def first_row_number(self) -> int:
        return self.dialect.header_lines + 1

    def read(self) -> Iterator[TableBatch]:
        """Yield all rows, typed as far as possible.

        1. Read columns by the types that the first rows suggest.
        2. From the row on where a cell contradicts its type, read every cell as text, and skip
           rows with a wrong number of cells.
        3. Check that no quote was left open, which would have swallowed rows.
        """
        dialect = self.dialect

        # 1. By the types of the first rows.
        kept_types = self._infer_kept_types()
        types = kept_types | guess_column_types(dialect, self.roles)
        yielded_rows, is_complete = 0, False
        with suppress(pa.ArrowInvalid, UnicodeDecodeError):
            for batch in self._record_batches(dialect, types, None):
                yield TableBatch(pa.Table.from_batches([batch]))
                yielded_rows += batch.num_rows
            is_complete = True
        if is_complete:
            records = dialect.header_lines + yielded_rows
            check_quotes(self.source, dialect.encoding, dialect.delimiter, records)
            return

        # 2. As texts. Rows that were yielded already are passed over.
        skipped = SkippedRows()
        confirmed = self._with_confirmed_encoding()
        read_rows = reported = 0
        for batch in self._record_batches(confirmed, kept_types, skipped):
            new_rows = batch.slice(max(yielded_rows - read_rows, 0))
            read_rows += batch.num_rows
            yield TableBatch(pa.Table.from_batches([new_rows]), skipped.count - reported)
            reported = skipped.count

        # 3. Quotes.
        records = dialect.header_lines + read_rows + skipped.count
        check_quotes(self.source, confirmed.encoding, dialect.delimiter, records)

    def read_as_text(self) -> Iterator[Any]:
        """Yield all rows as tables of texts."""
        for batch in self._record_batches(self._with_confirmed_encoding(), {}, SkippedRows()):
            yield pa.Table.from_batches([batch])

    def uses_decimal_comma(self) -> bool:
        """Whether coordinates have decimal commas.

        Only if one of the first rows has a comma, all rows are read for the answer.
        """
        axes = self.roles.axes
        if not any("," in cell for axis in axes for cell in self.dialect.cells(axis)):
            return False

        # A comma may also separate thousands: a decimal point in any row shows that.
        has_comma = False
        confirmed = self._with_confirmed_encoding()
        for batch in self._record_batches(confirmed, {}, SkippedRows(), axes):
            columns = [pa.chunked_array([column]) for column in batch.columns]
            has_comma = has_comma or has_decimal_comma(columns)
            if has_decimal_point(columns):
                return False
        return has_comma

    def explain_error(self, error: Exception) -> str:
        return explain_table_error(error)

    def _with_confirmed_encoding(self) -> Dialect:
        return replace(self.dialect, encoding=confirm_encoding(self.source, self.dialect))

    def _infer_kept_types(self) -> dict[str, Any]:
        """Find the types of the columns to keep: for each, the first that no cell contradicts.

        All rows decide, as they do for a file that is read at once.
        """
        if not self.roles.keep:
            return {}
        confirmed = self._with_confirmed_encoding()
        return {
            str(column): next(
                kind for kind in ATTRIBUTE_TYPES if self._column_fits(confirmed, column, kind)
            )
            for column in set(self.roles.keep.values())
        }

    def _column_fits(self, dialect: Dialect, column: int, kind: Any) -> bool:
        """Whether every cell of a column can be read as a type."""
        if kind == pa.string():
            return True
        with suppress(pa.ArrowInvalid):
            for _ in self._record_batches(dialect, {str(column): kind}, SkippedRows(), [column]):
                pass
            return True
        return False

    def _record_batches(
        self,
        dialect: Dialect,
        types: Mapping[str, Any],
        skipped: SkippedRows | None,
        columns: Sequence[int] | None = None,
    ) -> Iterator[Any]:
        """Yield record batches, with columns named by their indices.

        Parameters
        ----------
        dialect : Dialect
            How the file writes its table.
        types : mapping of str to pyarrow.DataType
            Types of columns; text if left out.
        skipped : SkippedRows, optional
            Counts rows with a wrong number of cells. Without it, such a row raises
            ``pyarrow.ArrowInvalid``.
        columns : sequence of int, optional
            Columns to read; those of ``roles.used`` if left out.
        """
        wanted = [str(i) for i in (self.roles.used if columns is None else columns)]
        all_types = dict.fromkeys(wanted, pa.string()) | dict(types)
        options = arrow_options(dialect, wanted, all_types, skipped, use_threads=False)
        with self.source.open() as stream:
            yield from pc.open_csv(stream, *options)
