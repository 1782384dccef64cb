"""Lines of text: CSV with a header, JSON lines, or NMEA, told apart by the first line."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gpszip.errors import InputError, OptionError
from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.apps import app_of, parse_message
from gpszip.live.formats.forwarded import is_forwarded, parse_forwarded
from gpszip.live.formats.gpsd import GpsdParser
from gpszip.live.formats.nmea import NmeaParser
from gpszip.live.formats.values import (
    Context,
    MessageError,
    clean_name,
    make_fix,
    parse_json,
    parse_time,
    to_amount,
    to_number,
)

if TYPE_CHECKING:
    from gpszip.io.tables.roles import Roles

__all__ = ["TextParser", "require_times"]

#: Separators of columns that are tried, the first one that the header has.
_SEPARATORS = ",;\t|"

#: Names of columns with accuracy and speed, without case, blanks and underscores.
_ACCURACY = ("accuracy", "acc", "hacc", "horizontalaccuracy")
_SPEED = ("speed", "spd", "velocity")

#: Classes of gpsd's reports. Objects of other classes have columns, one of which is so called.
_GPSD_CLASSES = frozenset(
    {"AIS", "ATT", "DEVICE", "DEVICES", "ERROR", "GST", "IMU", "OSC", "POLL", "PPS", "RAW"}
    | {"RTCM2", "RTCM3", "SKY", "SUBFRAME", "TOFF", "TPV", "VERSION", "WATCH"}
)

#: Columns of a table at most.
_MAX_COLUMNS = 1_000


class TextParser:
    r"""Turns lines into fixes.

    Parameters
    ----------
    agent : str
        Who is where, unless the lines say so.
    columns : mapping of str to str, optional
        Columns of a table by role, as for ``gpszip compress --columns``.
    where : str
        Name of the stream, for messages.

    Examples
    --------
    >>> parser, context = TextParser("robot"), Context(9.0, "stdin")
    >>> parser.push(b"id,time,x,y\n", context)
    []
    >>> [fix] = parser.push(b"r2,7.5,1,2\n", context)
    >>> fix.agent, fix.time, fix.position, fix.geographic
    ('r2', 7.5, (1.0, 2.0), False)
    """

    def __init__(
        self,
        agent: str,
        columns: Mapping[str, str] | None = None,
        where: str = "standard input",
    ) -> None:
        self._agent, self._columns, self._where = agent, columns, where
        self._table: _Table | None = None
        self._nmea: NmeaParser | None = None
        self._gpsd = GpsdParser()

    @property
    def pending(self) -> bool:
        """Whether a fix waits for the lines that may still belong to it."""
        return self._nmea is not None and self._nmea.pending

    def push(self, line: bytes, context: Context) -> list[Fix | Unusable]:
        """Take a line, and return what it completes.

        Raises
        ------
        InputError
            If the first line is a header without columns of time and position.
        """
        text = line.strip()
        if not text:
            return []

        # Sentences of NMEA, and objects of JSON.
        if self._nmea is None and self._table is None and text[:1] in (b"$", b"!"):
            self._nmea = NmeaParser(self._agent)
        if self._nmea is not None:
            return self._nmea.push(text, context)
        if text[:1] == b"{":
            return self._parse_object(text, context)

        # A table begins with its header.
        decoded = text.decode("utf-8-sig", "backslashreplace")
        if self._table is None:
            self._table = _Table(decoded, self._columns, self._where)
            return []
        return [self._table.parse(decoded, self._agent, context)]

    def finish(self, context: Context) -> list[Fix | Unusable]:
        """Return what the last lines hold."""
        return [] if self._nmea is None else self._nmea.finish(context)

    def _parse_object(self, text: bytes, context: Context) -> list[Fix | Unusable]:
        """Return the fixes of a message of an app, a report of gpsd, or an object of columns."""
        # Messages of apps come first: they have names of columns, too.
        try:
            message = parse_json(text)
        except MessageError as error:
            return [Unusable(self._agent, str(error))]
        app = app_of(message)
        if app is not None:
            return parse_message(app, message, context)

        # Positions that a server forwards, reports of gpsd, or columns.
        try:
            if is_forwarded(message):
                return [parse_forwarded(message, context)]
            kind = message.get("class")
            if isinstance(kind, str) and kind in _GPSD_CLASSES:
                return self._gpsd.parse(message, context)
            names = [name for name, value in message.items() if not isinstance(value, dict | list)]
            table = _Table.of_names(names[:_MAX_COLUMNS], self._columns, self._where)
            return [table.parse_cells([message[name] for name in names], self._agent, context)]
        except (MessageError, InputError, OptionError):
            reason = "objects without a time and a position left out"
            return [Unusable(self._agent, reason, text[:60].decode("utf-8", "replace"))]


class _Table:
    """Reads the rows of a table whose header is known."""

    def __init__(self, header: str, columns: Mapping[str, str] | None, where: str) -> None:
        found = [separator for separator in _SEPARATORS if separator in header]
        self._separator = found[0] if found else ","
        self._find(self._split(header), columns, where)

    @classmethod
    def of_names(
        cls, names: Sequence[str], columns: Mapping[str, str] | None, where: str
    ) -> _Table:
        """Return the table of an object of JSON."""
        table = cls.__new__(cls)
        table._find(names, columns, where)
        return table

    def _find(self, names: Sequence[str], columns: Mapping[str, str] | None, where: str) -> None:
        """Find out which column is what."""
        from gpszip.io.tables.roles import find_roles, time_unit_in_name

        if len(names) > _MAX_COLUMNS:
            raise InputError(f"more than {_MAX_COLUMNS:,} columns", path=where, location="line 1")
        given = None if columns is None else dict(columns)
        self._roles = find_roles(names, given, (), where, heading=True, times=False)
        require_times(self._roles, where)
        self._unit = time_unit_in_name(names[self._roles.time[-1]])
        plain = [name.lower().replace("_", "").replace(" ", "") for name in names]
        self._accuracy = _index_of(plain, _ACCURACY)
        self._speed = _index_of(plain, _SPEED)

    def _split(self, line: str) -> list[str]:
        try:
            return next(csv.reader([line], delimiter=self._separator))
        except (csv.Error, StopIteration):
            return []

    def parse(self, line: str, agent: str, context: Context) -> Fix | Unusable:
        """Return the fix of a row."""
        return self.parse_cells(self._split(line), agent, context)

    def parse_cells(self, cells: Sequence[Any], agent: str, context: Context) -> Fix | Unusable:
        """Return the fix of the cells of a row."""
        # A row that is cut off is none.
        roles = self._roles
        if len(cells) <= max(roles.used):
            return Unusable(agent, "rows with too few columns left out")
        try:
            own = "" if roles.id is None else cells[roles.id]
            name = clean_name(own, context.agent, agent)
        except MessageError as error:
            return Unusable(agent, str(error))

        # A time that can't be read is not replaced by that of receipt.
        time = self._time([cells[column] for column in roles.time], context)
        if time is None:
            value = str(cells[roles.time[-1]])[:60]
            return Unusable(name, "rows without a readable time left out", value)
        return make_fix(
            context,
            name,
            time,
            tuple(to_number(cells[column]) for column in roles.axes),
            kind="row",
            accuracy=_cell(cells, self._accuracy),
            heading=_cell(cells, roles.heading),
            speed=to_amount(_cell(cells, self._speed)),
            geographic=roles.geographic,
        )

    def _time(self, cells: Sequence[Any], context: Context) -> float | None:
        if len(cells) > 1:
            return parse_time(" ".join(map(str, cells)), context.timezone)
        number = to_number(cells[0])
        if number is not None and self._unit is not None:
            return number * self._unit
        return parse_time(cells[0], context.timezone)


def require_times(roles: Roles, where: str) -> None:
    """Refuse a table without times: a log may go without them, what is live can't.

    Raises
    ------
    InputError
        If no column has times.
    """
    if not roles.time:
        raise InputError(
            "no column of times", path=where, remedy="say which it is: --columns t=COLUMN"
        )


def _index_of(names: Sequence[str], synonyms: Sequence[str]) -> int | None:
    return next((names.index(name) for name in synonyms if name in names), None)


def _cell(cells: Sequence[Any], column: int | None) -> Any:
    return None if column is None or column >= len(cells) else cells[column]
