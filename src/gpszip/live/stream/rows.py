"""From lines to rows: each batch is read by the reader of its format.

What the first rows show holds for all later ones: format, columns, unit of time, order of dates.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.logs.clean import add_repair, find_usable_rows
from gpszip.io.logs.csv import (
    Dialect,
    detect_dialect,
    explain_table_error,
    find_csv_roles,
    read_table,
)
from gpszip.io.logs.globe import GlobeCheck
from gpszip.io.logs.log_file import refuse_unknown_options
from gpszip.io.logs.log_format import LogFormat
from gpszip.io.logs.mixed_files import choose_format
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.table_batches import TableBatch, TableInterpreter
from gpszip.io.storage.source import Source
from gpszip.io.tables.quotes import check_quotes
from gpszip.io.tables.roles import Roles
from gpszip.live.fix import Fix
from gpszip.live.formats.text import TextParser, require_times
from gpszip.live.formats.values import Context
from gpszip.model.read_result import Repair

__all__ = ["StreamReader", "StreamRows"]

#: Formats without a header, whose lines can be read one batch after the other.
_LINE_FORMATS = ("nmea", "tum", "carmen")

#: First bytes of files of gzip, which no lines have.
_GZIP = b"\x1f\x8b"

#: Bytes of the first lines by which the format is recognised, as for files.
_HEAD_BYTES = 1 << 18

#: How often lines of a batch that can't be read are halved, which takes 1 ms each.
_MAX_ATTEMPTS = 500

#: Lines before the first row of a table that are kept.
_MAX_WAITING = 1_000

#: Name of the track of a log that names none.
_DEFAULT_NAME = "0"

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StreamRows:
    """The rows of a batch that have a time and a position.

    Parameters
    ----------
    tracks : mapping of str to (float64 array, float64 array)
        Times in seconds, shape (n,), and coordinates, shape (n, d), of each track, as they came.
    geographic : bool
        Whether coordinates are degrees.
    repairs : tuple of Repair
        What could not be used, or was changed.
    """

    tracks: Mapping[str, tuple[Floats, Floats]]
    geographic: bool = True
    repairs: tuple[Repair, ...] = ()

    def __len__(self) -> int:
        return sum(len(times) for times, _ in self.tracks.values())


class _Lines(Protocol):
    """Lines of one kind."""

    def read(self, lines: Sequence[bytes], before: int) -> StreamRows:
        """Return the rows of some lines, of which so many came before."""
        ...


class StreamReader:
    r"""Reads batches of lines.

    Parameters
    ----------
    name : str
        Name of the stream in messages.
    request : Request
        Columns, unit of time and order of dates.
    format_ : str, optional
        Name of the format; found from the first lines if left out.
    clean : bool
        Drop positions at 0,0 that were hardly measured.

    Examples
    --------
    >>> reader = StreamReader("robot", Request())
    >>> reader.read([b"t,x,y\n", b"0,0,0\n"]).tracks["0"][0].tolist()
    [0.0]
    >>> rows = reader.read([b"1,1,0\n", b"oops,2,0\n"])
    >>> rows.tracks["0"][1].tolist(), [each.where for each in rows.repairs]
    ([[1.0, 0.0]], ['robot: line 4'])
    """

    def __init__(
        self, name: str, request: Request, format_: str | None = None, *, clean: bool = False
    ) -> None:
        self._name, self._request, self._stated, self._clean = name, request, format_, clean
        self._lines: _Lines | None = None
        self._waiting: list[bytes] = []
        self._has_rows = False
        self._read = 0

    def read(self, lines: Sequence[bytes]) -> StreamRows:
        """Read the next lines.

        Raises
        ------
        InputError
            If they can't be read. If these are the first ones, no others can be, either.
        """
        # Lines before the first row wait for it: together they tell the format.
        lines, self._waiting = [*self._waiting, *lines], []
        if self._lines is None:
            self._lines = self._begin(lines)
        if self._lines is None:
            self._waiting = lines[:_MAX_WAITING]
            return StreamRows({})

        # The first rows must be readable; of later lines, those that are.
        before, self._read = self._read, self._read + len(lines)
        if self._has_rows:
            return _joined(self._read_some(self._lines, lines, before, [_MAX_ATTEMPTS]))
        rows = self._lines.read(lines, before)
        self._has_rows = len(rows) > 0
        return rows

    def _read_some(
        self, reader: _Lines, lines: Sequence[bytes], before: int, attempts: list[int]
    ) -> Iterator[StreamRows]:
        """Yield the rows of lines that can be read; halve those that can't."""
        attempts[0] -= 1
        try:
            yield reader.read(lines, before)
        except InputError as error:
            if len(lines) == 1 or attempts[0] <= 0:
                where = f"{self._name}: line {before + 1}"
                repair = Repair("lines that can't be read left out", len(lines), where)
                yield StreamRows({}, repairs=(replace(repair, value=error.reason),))
                return
            half = len(lines) // 2
            yield from self._read_some(reader, lines[:half], before, attempts)
            yield from self._read_some(reader, lines[half:], before + half, attempts)

    def _begin(self, lines: Sequence[bytes]) -> _Lines | None:
        """Find the format from the first lines; None if they end before the first row."""
        data = b"".join(lines)[:_HEAD_BYTES]
        if data.startswith(_GZIP):
            raise InputError(
                "is compressed", path=self._name, remedy="unpack it first: zcat LOG | gpszip ..."
            )
        if not data.strip():
            return None
        if data.lstrip()[:1] == b"{" and self._stated is None:
            return _ObjectLines(self._name, self._request)

        # Formats that need all of a file can't be streamed.
        format_ = choose_format(Source(self._name, data=data), self._stated)
        refuse_unknown_options(format_, self._request, self._name)
        if format_.name in _LINE_FORMATS:
            return _FormatLines(self._name, self._request, format_, clean=self._clean)
        if format_.name != "csv":
            known = ", ".join(_LINE_FORMATS)
            raise InputError(
                f"is {format_.name}, which can't be read line by line",
                path=self._name,
                remedy=f"leave --stream out; it takes CSV, JSON lines, {known}",
            )

        # A table begins with its header.
        dialect = detect_dialect(data, self._request, self._name)
        if dialect.encoding.startswith("utf-16"):
            raise InputError(
                "is UTF-16, which can't be read line by line",
                path=self._name,
                remedy="convert it: iconv -f UTF-16 -t UTF-8",
            )
        if dialect.header_lines == len(lines) and len(lines) < _MAX_WAITING:
            return None
        return _TableLines(self._name, self._request, dialect, clean=self._clean)


class _TableLines:
    """Lines of a table with columns; see :class:`gpszip.io.logs.table_batches.TableFacts`."""

    def __init__(self, name: str, request: Request, dialect: Dialect, *, clean: bool) -> None:
        self._name, self._clean = name, clean
        self._dialect = dialect
        self._roles = find_csv_roles(dialect, replace(request, times=False), name)
        require_times(self._roles, name)
        self._header = b""
        self._table: Any = None
        self._interpreter = TableInterpreter(self, request)

    @property
    def name(self) -> str:
        return self._name

    @property
    def column_names(self) -> tuple[str, ...]:
        return self._dialect.names

    @property
    def roles(self) -> Roles:
        return self._roles

    @property
    def first_row_number(self) -> int:
        return 1

    def read_as_text(self) -> Iterator[Any]:
        """Yield the rows of this batch: others are not at hand."""
        yield self._table

    def uses_decimal_comma(self) -> None:
        """Let the first rows decide."""

    def read(self, lines: Sequence[bytes], before: int) -> StreamRows:
        """Return the rows of some lines, which have the first header before them."""
        # The header stands before the first rows, and is put before all later ones.
        header = self._dialect.header_lines
        if not before:
            self._header = b"".join(lines[:header])
            lines, before = lines[header:], header
        data = self._header + b"".join(lines)
        if not b"".join(lines).strip():
            return StreamRows({})

        # Interpret them; rows are named by their lines.
        source = Source(self._name, data=data)
        try:
            self._table, malformed = read_table(source, self._dialect, self._roles)
            # A quote that is never closed would have swallowed rows.
            records = self._dialect.header_lines + self._table.num_rows + malformed
            check_quotes(source, self._dialect.encoding, self._dialect.delimiter, records)
            raw = self._interpreter.interpret(TableBatch(self._table, malformed))
        except (pa.ArrowException, UnicodeDecodeError) as error:
            raise InputError(explain_table_error(error), path=self._name) from None
        if raw is None:
            return StreamRows({})
        return _usable_rows(replace(raw, first=before + 1), clean=self._clean)


class _FormatLines:
    """Lines of a format without a header."""

    def __init__(self, name: str, request: Request, format_: LogFormat, *, clean: bool) -> None:
        self._name, self._request, self._format, self._clean = name, request, format_, clean
        self._points = 0

    def read(self, lines: Sequence[bytes], before: int) -> StreamRows:
        """Return the points of some lines."""
        del before
        try:
            raw = self._format.read(Source(self._name, data=b"".join(lines)), self._request)
        except NoPositionsError:
            # A receiver may have no position yet.
            return StreamRows({})
        first, self._points = self._points, self._points + len(raw.times)
        return _usable_rows(replace(raw, first=raw.first + first), clean=self._clean)


class _ObjectLines:
    """Objects of JSON, one a line: columns, messages of apps, or reports of gpsd."""

    def __init__(self, name: str, request: Request) -> None:
        columns = request.columns
        if isinstance(columns, tuple):
            raise InputError(
                "has objects, whose columns have names",
                path=name,
                remedy="name them: --columns t=when,x=east,y=north",
            )
        self._name = name
        self._parser = TextParser(_DEFAULT_NAME, columns, name)
        self._kind: tuple[bool, int] | None = None

    def read(self, lines: Sequence[bytes], before: int) -> StreamRows:
        """Return the fixes of some lines."""
        # Parse them.
        context = Context(time.time(), "stdin")
        found: dict[str, list[Fix]] = {}
        unusable: dict[str, Repair] = {}
        for number, line in enumerate(lines, before + 1):
            for item in self._parser.push(line, context):
                if isinstance(item, Fix) and self._fits(item):
                    found.setdefault(item.agent, []).append(item)
                    continue
                reason, value = _OTHER_COORDINATES, ""
                if not isinstance(item, Fix):
                    reason, value = item.reason, item.value
                where = f"{self._name}: line {number}"
                known = unusable.get(reason) or Repair(reason, 0, where, value=value)
                unusable[reason] = replace(known, count=known.count + 1)

        # Heights above degrees are left out.
        geographic, dimension = self._kind or (True, 2)
        tracks = {
            agent: (
                np.array([fix.time for fix in fixes]),
                np.array([fix.position[:dimension] for fix in fixes], np.float64),
            )
            for agent, fixes in found.items()
        }
        return StreamRows(tracks, geographic, tuple(unusable.values()))

    def _fits(self, fix: Fix) -> bool:
        """Whether a fix has the coordinates of the first one, and numbers that can be used."""
        own = fix.geographic, 2 if fix.geographic else len(fix.position)
        if self._kind is None:
            self._kind = own
        is_finite = bool(np.isfinite([fix.time, *fix.position]).all())
        return own == self._kind and is_finite and _is_on_globe(fix)


#: What is said of objects whose coordinates don't go with those before.
_OTHER_COORDINATES = "objects with other coordinates than before, or off the globe, left out"


def _joined(pieces: Iterable[StreamRows]) -> StreamRows:
    """Join the rows of lines that were read apart."""
    # Most batches are one piece.
    found = list(pieces)
    if len(found) == 1:
        return found[0]

    # Rows of each track, and repairs of each kind.
    tracks: dict[str, list[tuple[Floats, Floats]]] = {}
    repairs: list[Repair] = []
    for each in found:
        for name, rows in each.tracks.items():
            tracks.setdefault(name, []).append(rows)
        for repair in each.repairs:
            add_repair(repairs, repair)

    # Pieces without a row say nothing of the coordinates.
    joined = {
        name: (np.concatenate([row[0] for row in rows]), np.concatenate([row[1] for row in rows]))
        for name, rows in tracks.items()
    }
    geographic = any(each.geographic for each in found if each.tracks)
    return StreamRows(joined, geographic, tuple(repairs))


def _is_on_globe(fix: Fix) -> bool:
    if not fix.geographic:
        return True
    lat, lon = fix.position[:2]
    return abs(lat) <= 90 and -180 <= lon <= 360


def _usable_rows(raw: RawLog, *, clean: bool) -> StreamRows:
    """Return the rows that have a time and a position, track by track."""
    # Positions off the globe are dropped and counted: no row may end the stream.
    repairs = [each for each in raw.repairs if each.count]
    rows = find_usable_rows(raw, GlobeCheck(), repairs, clean=clean)
    if not len(rows):
        return StreamRows({}, raw.geographic, tuple(repairs))
    if raw.codes is None:
        whole = {_DEFAULT_NAME: (raw.times[rows], raw.coordinates[rows])}
        return StreamRows(whole, raw.geographic, tuple(repairs))

    # Rows of one track keep their order.
    codes = raw.codes[rows]
    order = np.argsort(codes, kind="stable")
    cuts = np.flatnonzero(np.diff(codes[order])) + 1
    tracks = {
        raw.ids[int(raw.codes[part[0]])]: (raw.times[part], raw.coordinates[part])
        for part in np.split(rows[order], cuts)
    }
    return StreamRows(tracks, raw.geographic, tuple(repairs))
