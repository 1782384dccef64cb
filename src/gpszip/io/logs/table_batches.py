"""Interpret a table batch by batch, as if all its rows were read at once.

A format reads batches of cells (:class:`TableReader`); :func:`interpret_batches` makes logs of
them. Decimal marks, the order of dates and the unit of time are found once, so that all batches
are read alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import reduce
from operator import or_
from typing import Any, NamedTuple, Protocol

import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.logs.csv import malformed_rows_repair
from gpszip.io.logs.plausibility import check_plausible, note_spreadsheet_days
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.tables.roles import Roles
from gpszip.io.tables.table import TableConventions, build_raw_log, find_conventions
from gpszip.io.tables.time_columns import find_date_order, join_time_columns
from gpszip.io.values.arrow import is_text, trimmed_text
from gpszip.io.values.dates import DateOrders, find_date_orders

__all__ = ["TableBatch", "TableInterpreter", "TableReader", "interpret_batches"]


class TableBatch(NamedTuple):
    """Some rows of a table.

    Parameters
    ----------
    table : pyarrow.Table
        The rows, with the columns of ``roles.used`` in that order.
    malformed : int
        Rows with too many or too few cells since the batch before; they are not in ``table``.
    """

    table: Any
    malformed: int = 0


class TableFacts(Protocol):
    """What has to be known of a table, so that its cells can be interpreted."""

    @property
    def name(self) -> str:
        """Name of the file in messages."""

    @property
    def column_names(self) -> tuple[str, ...]:
        """Names of all columns."""

    @property
    def roles(self) -> Roles:
        """Which column holds what."""

    @property
    def first_row_number(self) -> int:
        """Number of the first row in messages."""

    def read_as_text(self) -> Iterator[Any]:
        """Yield all rows once more as tables; cells that the file holds as text stay text."""

    def uses_decimal_comma(self) -> bool | None:
        """Whether coordinates have decimal commas; None if the first rows decide."""


class TableReader(TableFacts, Protocol):
    """A file with columns that is read in batches."""

    def read(self) -> Iterator[TableBatch]:
        """Yield all rows, with numbers and times parsed where Arrow can parse them."""

    def explain_error(self, error: Exception) -> str:
        """Say what is wrong with the file when Arrow can't read it."""


def interpret_batches(reader: TableReader, request: Request) -> Iterator[RawLog]:
    """Yield the rows of a table as logs, in the order of the file.

    Parameters
    ----------
    reader : TableReader
        The file.
    request : Request
        Unit of time, order of dates and attributes.

    Raises
    ------
    InputError
        If the file is damaged, or its times are certainly in another unit.
    """
    try:
        yield from _interpret(reader, request)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise InputError(reader.explain_error(error), path=reader.name) from None


def _interpret(reader: TableReader, stated: Request) -> Iterator[RawLog]:
    interpreter = TableInterpreter(reader, stated)
    for batch in reader.read():
        raw = interpreter.interpret(batch)
        if raw is not None:
            yield raw


class TableInterpreter:
    """Interprets batches of cells; what the first rows show holds for all later ones.

    Parameters
    ----------
    table : TableFacts
        The table.
    request : Request
        Unit of time, order of dates and attributes.
    """

    def __init__(self, table: TableFacts, request: Request) -> None:
        # What the first rows show is added to the request.
        self._facts, self._stated, self._request = table, request, request
        self._conventions: TableConventions | None = None
        self._row_number = table.first_row_number

    def interpret(self, batch: TableBatch) -> RawLog | None:
        """Return the rows of the next batch; None if it has none.

        Raises
        ------
        InputError
            If times are certainly in another unit, or dates in several orders.
        """
        # Find what holds for all rows, from the first batch that has some.
        table, malformed = batch
        facts, request = self._facts, self._request
        if request.dates is None and table.num_rows:
            request = replace(request, dates=_find_date_order(facts, table, request))
        has_first_rows = self._conventions is None and table.num_rows > 0
        if has_first_rows:
            self._conventions = find_conventions(
                table.columns,
                facts.column_names,
                facts.roles,
                request,
                facts.name,
                decimal_comma=facts.uses_decimal_comma(),
            )
        self._request = request
        if not table.num_rows and not malformed:
            return None

        # Interpret the columns.
        raw = build_raw_log(
            table.columns,
            facts.column_names,
            facts.roles,
            request,
            facts.name,
            first=self._row_number,
            conventions=self._conventions,
            repairs=malformed_rows_repair(malformed, facts.name),
            all_rows=False,
        )
        self._row_number += table.num_rows

        # The unit of time that the first rows suggest holds for all.
        if has_first_rows:
            raw = check_plausible(raw, self._stated)
            unit = raw.guessed_unit.unit if raw.guessed_unit else self._stated.time_unit
            self._request = replace(request, time_unit=unit)
        elif request.time_unit == "excel" and self._stated.time_unit is None:
            raw = note_spreadsheet_days(raw)
        return raw


def _find_date_order(facts: TableFacts, table: Any, request: Request) -> str | None:
    """Find the order of day, month and year; None if this batch has no such dates.

    It is found from all rows of the file, so that every batch is read in the same order.
    """
    names, roles = facts.column_names, facts.roles
    # Most files need no second reading: the order is stated, or no date has three numbers.
    stated = find_date_order(names, roles, request)
    if stated is not None or not roles.time:
        return stated
    if not _possible_date_orders(facts, table, request).first:
        return None
    tables = facts.read_as_text()
    orders = reduce(or_, (_possible_date_orders(facts, table, request) for table in tables))
    return orders.decide(facts.name, f"column {names[roles.time[-1]]!r}")


def _possible_date_orders(facts: TableFacts, table: Any, request: Request) -> DateOrders:
    """Return the orders of day, month and year in which all dates of a batch are valid."""
    roles = facts.roles
    columns = dict(zip(roles.used, table.columns, strict=False))

    # Columns of type timestamp or date have no order.
    types = [columns[i].type for i in roles.time]
    if any(not is_text(kind) and pa.types.is_temporal(kind) for kind in types):
        return DateOrders()

    cells = join_time_columns(columns, facts.column_names, roles, request, facts.name)
    return find_date_orders(trimmed_text(cells)) if is_text(cells.type) else DateOrders()
