"""Logs in text that are to be written again with rows added: every row stays as it was, letter by letter."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from functools import cached_property
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.planes import to_geographic
from gpszip.io.columns import Roles, find_roles, parse_columns
from gpszip.io.csv_log import Dialect, dialect_of, whole_encoding
from gpszip.io.raw_log import Request, unused
from gpszip.io.reading import read_logs
from gpszip.io.source import Source
from gpszip.model import Track
from gpszip.model.reading import Reading

__all__ = ["Added", "TextLog", "read_text_log"]

_ROW = "gpszip_row"

_ISO = re.compile(r"(\d{4})-(\d\d)-(\d\d)([T ])(\d\d):(\d\d):(\d\d)(?:[.,](\d+))?(.*)")

#: Decimals of seconds and metres that are added at least; degrees have five more.
_DECIMALS = 2


@dataclass(frozen=True, eq=False)
class Added:
    """Samples to add to a track.

    Parameters
    ----------
    track : int
        Number of the track.
    after : int
        Sample after which they come.
    times : float64 array, shape (n,)
        Seconds.
    positions : float64 array, shape (n, d)
        Metres on the plane of the track.
    columns : mapping of str to sequence of str
        What to write in the columns that are appended.
    """

    track: int
    after: int
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    columns: Mapping[str, Sequence[str]]


@dataclass(frozen=True, eq=False)
class TextLog:
    """A log in text as its rows, and as tracks that know their rows.

    Parameters
    ----------
    reading : Reading
        The tracks; their attribute ``gpszip_row`` numbers the record of each sample.
    records : list of str
        Everything in the file, cut in records; each with its line end.
    dialect : Dialect
        How they are written.
    roles : Roles
        Which column is what.
    first : int
        Records before the first row.
    """

    reading: Reading
    records: list[str]
    dialect: Dialect
    roles: Roles
    first: int

    def write(self, added: Sequence[Added], own: Mapping[str, str], sink: BinaryIO) -> None:
        """Write the log with samples added and columns appended.

        Parameters
        ----------
        added : sequence of Added
            Samples to add. They are written where the order of times says between the rows around them.
        own : mapping of str to str
            Columns to append, and what to write there for the log's own rows.
        sink : binary file
            Where to.
        """
        names, mark = dict(zip(own, self._titles(own), strict=True)), self.dialect.delimiter
        more: dict[int, list[str]] = {}
        for one in added:
            for row, text in self._rows(one, list(own)):
                more.setdefault(row, []).append(text)
        title = mark + mark.join(names.values())
        tail = mark + mark.join(own.values())
        out = io.TextIOWrapper(sink, encoding=self.dialect.encoding, newline="", write_through=True)
        for number, record in enumerate(self.records):
            whole = number >= self.first and record.strip()
            suffix = tail if whole else title if number == self.first - 1 and self._headed else ""
            body = record.rstrip("\r\n")
            end = record[len(body) :] or self._line_end
            out.write(body + suffix + end)
            out.writelines(row + self._line_end for row in more.get(number, ()))
        out.detach()

    @property
    def _headed(self) -> bool:
        return self.first > 0

    @cached_property
    def _line_end(self) -> str:
        found = re.search(r"\r\n|\r|\n", self.records[0])
        return found[0] if found else "\n"

    def _titles(self, own: Mapping[str, str]) -> list[str]:
        taken = {name.strip().lower() for name in self.dialect.names}
        return [name if name not in taken else unused(f"patch_{name}", taken) for name in own]

    def _rows(self, added: Added, names: Sequence[str]) -> list[tuple[int, str]]:
        """Rows to write, each with the record that it follows."""
        track = self.reading.tracks[added.track]
        numbers = track.attributes[_ROW][added.after : added.after + 2].astype(np.int64).tolist()
        cells = [self._cells(number) for number in numbers]
        blank = [""] * len(self.dialect.names)
        if self.roles.id is not None:
            blank[self.roles.id] = cells[0][self.roles.id]
        when = track.times[added.after : added.after + 2].tolist()
        clock = _Clock.of([cell[self.roles.time[-1]] for cell in cells], when, added.times)
        axes = [_decimals([cell[axis] for cell in cells], self.roles.geographic) for axis in self.roles.axes]
        places = self._places(added, numbers)
        answer = []
        for i, (time, position) in enumerate(zip(added.times.tolist(), self._positions(added, track).tolist(), strict=True)):
            row = list(blank)
            row[self.roles.time[-1]] = clock.text(time)
            for axis, value, (decimals, comma) in zip(self.roles.axes, position, axes, strict=False):
                row[axis] = _number(value, decimals, comma)
            row += [added.columns[name][i] for name in names]
            answer.append((places[i], self._joined(row)))
        return answer

    def _positions(self, added: Added, track: Track) -> NDArray[np.float64]:
        if track.plane is None:
            return added.positions
        return np.stack(to_geographic(added.positions, track.plane), axis=1)

    def _places(self, added: Added, numbers: Sequence[int]) -> list[int]:
        """Record after which each sample comes: rows of other tracks may lie in between, in the order of time."""
        first, last = numbers
        between = self._record_times[first + 1 : last] if last > first else np.empty(0)
        late = np.maximum.accumulate(np.where(np.isnan(between), -np.inf, between))
        found: list[int] = (first + np.searchsorted(late, added.times, side="right")).tolist()
        return found

    @cached_property
    def _record_times(self) -> NDArray[np.float64]:
        times = np.full(len(self.records), np.nan)
        for track in self.reading.tracks:
            times[track.attributes[_ROW].astype(np.int64)] = track.times
        return times

    def _cells(self, number: int) -> list[str]:
        return next(csv.reader([self.records[number]], delimiter=self.dialect.delimiter))

    def _joined(self, cells: Sequence[str]) -> str:
        line = io.StringIO()
        csv.writer(line, delimiter=self.dialect.delimiter, lineterminator="").writerow(cells)
        return line.getvalue()


def read_text_log(source: Source, columns: Any = None, **options: Any) -> TextLog:
    """Read a log in text so that it can be written again.

    Parameters
    ----------
    source : Source
        Text with columns.
    columns : str, sequence or mapping, optional
        As :func:`gpszip.io.reading.read_logs` takes it, as are the other options.

    Returns
    -------
    TextLog

    Raises
    ------
    InputError
        If it can't be read as text with columns.
    """
    request = Request(parse_columns(columns), options.get("time_unit"))
    dialect = dialect_of(source.head(), request, source.name)
    encoding = whole_encoding(source, dialect)
    dialect = Dialect(encoding, dialect.delimiter, dialect.header, dialect.names, dialect.rows)
    records, first = _records(source.read().decode(encoding), dialect.header)
    by_role = request.columns if isinstance(request.columns, Mapping) else None
    roles = find_roles(dialect.names, by_role, (), source.name)
    log = _Named("".join(_numbered(records, first, dialect.delimiter)).encode(encoding), source.name)
    names = [*dialect.names, _ROW] if isinstance(request.columns, tuple) else columns
    try:
        reading = read_logs(log, format="csv", columns=names, keep=(_ROW,), **options)
    except InputError:
        read_logs(_Named(source.read(), source.name), format="csv", columns=columns, **options)  # says it without our column
        raise
    return TextLog(reading, records, dialect, roles, first)


class _Named(io.BytesIO):
    """Bytes with the name of the file that they come from."""

    def __init__(self, data: bytes, name: str) -> None:
        super().__init__(data)
        self.name = name


def _records(text: str, header: int) -> tuple[list[str], int]:
    """Lines, those within quotes joined, and how many come before the first row."""
    lines = list(io.StringIO(text, newline=""))
    if '"' not in text:
        return lines, header
    records, open_ = lines[:header], False
    for line in lines[header:]:
        if open_:
            records[-1] += line
        else:
            records.append(line)
        open_ ^= line.count('"') % 2 == 1
    return records, header


def _numbered(records: Sequence[str], first: int, mark: str) -> list[str]:
    """Records with their number as a further cell."""
    answer = []
    for number, record in enumerate(records):
        body = record.rstrip("\r\n")
        if number >= first and body.strip():
            body += f"{mark}{number}"
        elif number == first - 1:
            body += f"{mark}{_ROW}"
        answer.append(body + (record[len(record.rstrip("\r\n")) :] or "\n"))
    return answer


@dataclass(frozen=True)
class _Clock:
    """Writes times as a log does."""

    start: float
    number: Decimal | None
    unit: int
    decimals: int
    comma: bool
    stamp: re.Match[str] | None

    @classmethod
    def of(cls, texts: Sequence[str], when: Sequence[float], times: NDArray[np.float64]) -> _Clock:
        """Learn from the two times around a gap."""
        rhythm = float(times[0]) - when[0] if len(times) else 1.0
        comma = "," in texts[0] and "." not in texts[0]
        try:
            one, other = (Decimal(text.strip().replace(",", ".")) for text in texts)
        except ArithmeticError:
            return cls(when[0], None, 1, _fraction(rhythm, 0), comma, _ISO.fullmatch(texts[0].strip()))
        scale = float(other - one) / (when[1] - when[0])
        unit = int(10 ** max(round(np.log10(max(scale, 1e-3)) / 3) * 3, 0))
        places = max(-int(number.as_tuple().exponent) for number in (one, other))
        return cls(when[0], one, unit, max(places, _fraction(rhythm * unit, max(places, 0))), comma, None)

    def text(self, time: float) -> str:
        """One time."""
        if self.number is not None:
            step = Decimal(repr(round((time - self.start) * self.unit, 9)))
            text = f"{(self.number + step).quantize(Decimal(1).scaleb(-self.decimals)):f}"
            return text.replace(".", ",") if self.comma else text
        if self.stamp is not None:
            return self._stamped(time)
        moment = datetime.fromtimestamp(round(time, 6), UTC).replace(tzinfo=None)
        return moment.isoformat(timespec="milliseconds" if self.decimals else "seconds") + "Z"

    def _stamped(self, time: float) -> str:
        assert self.stamp is not None
        year, month, day, between, hour, minute, second, fraction, zone = self.stamp.groups()
        moment = datetime(int(year), int(month), int(day), int(hour), int(minute), int(second))
        digits = max(len(fraction or ""), self.decimals)
        begun = float(f"0.{fraction}") if fraction else 0.0
        later = moment + timedelta(seconds=round(time - self.start + begun, min(digits, 6)))
        text = later.strftime(f"%Y-%m-%d{between}%H:%M:%S")
        return text + (f".{later.microsecond:06d}".ljust(digits + 1, "0")[: digits + 1] if digits else "") + zone


def _fraction(step: float, least: int) -> int:
    """Decimals that steps of this size need, up to three."""
    return next((digits for digits in range(least, 3) if abs(step - round(step, digits)) < 1e-4 * max(step, 1e-9)), max(least, 3))


def _decimals(texts: Sequence[str], degrees: bool) -> tuple[int, bool]:
    """Decimals to write, and whether after a comma."""
    comma = any("," in text for text in texts)
    found = [len(re.split(r"[.,]", text.strip())[1]) for text in texts if re.fullmatch(r"\s*[+-]?\d*[.,]\d+\s*", text)]
    return max([_DECIMALS + 4 * degrees, *found]), comma


def _number(value: float, decimals: int, comma: bool) -> str:
    text = f"{round(value, decimals) + 0.0:.{decimals}f}"
    return text.replace(".", ",") if comma else text
