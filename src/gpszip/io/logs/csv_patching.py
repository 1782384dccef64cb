"""Logs in text that are to be written again with rows added: every row stays as it was, letter by letter."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from functools import cached_property
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.planes import to_geographic
from gpszip.io.logs.csv import Dialect, confirm_encoding, detect_dialect
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request, unused_name
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source, expand
from gpszip.io.tables.roles import Roles, find_roles, parse_columns
from gpszip.io.values.arrow import looks_like_number
from gpszip.model import Patch, Track
from gpszip.model.read_result import ReadResult

__all__ = ["PatchableCsv", "read_for_patching", "read_patchable_csv"]

_ROW_COLUMN = "gpszip_row"

_ISO = re.compile(r"(\d{4})-(\d\d)-(\d\d)([T ])([01]\d|2[0-3]):(\d\d):([0-5]\d)(?:[.,](\d+))?(.*)")

# A date and time of day in numbers without marks, which can't be counted up, and a time of day without a date.
_COMPACT, _OF_DAY = re.compile(r"\d{14}(\.\d*)?"), re.compile(r"\d{1,2}:\d{2}:\d{2}")

#: Seconds of a day, numbers for a second below which they are days, and decimals of days that are written at least.
_DAY, _DAILY, _DAY_DECIMALS = 86_400, 1e-3, 9

#: Decimals of seconds and metres that are added at least; degrees have five more.
_DECIMALS = 2


@dataclass(frozen=True, eq=False)
class PatchableCsv:
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

    reading: ReadResult
    records: list[str]
    dialect: Dialect
    roles: Roles
    first: int

    def write(self, patches: Sequence[Patch], sink: BinaryIO) -> None:
        """Write the log with the samples of patches added, and the columns ``source`` and ``confidence`` appended.

        Parameters
        ----------
        patches : sequence of Patch
            Samples to add. They are written where the order of times says between the rows around them.
        sink : binary file
            Where to.
        """
        mark = self.dialect.delimiter
        more: dict[int, list[str]] = {}
        for patch in patches:
            for row, text in self._rows(patch) if len(patch.times) else ():
                more.setdefault(row, []).append(text)
        title = mark + mark.join(self._titles())
        out = io.TextIOWrapper(sink, encoding=self.dialect.encoding, newline="", write_through=True)
        for number, record in enumerate(self.records):
            whole = number >= self.first and record.strip()
            suffix = f"{mark}log{mark}1" if whole else title if number == self.first - 1 else ""
            body = record.rstrip("\r\n")
            out.write(body + suffix + (record[len(body) :] or self._line_end))
            out.writelines(row + self._line_end for row in more.get(number, ()))
        out.detach()

    @cached_property
    def _line_end(self) -> str:
        found = re.search(r"\r\n|\r|\n", self.records[0])
        return found[0] if found else "\n"

    def _titles(self) -> list[str]:
        taken = {name.strip().lower() for name in self.dialect.names}
        return [
            name if name not in taken else unused_name(f"patch_{name}", taken)
            for name in ("source", "confidence")
        ]

    def _rows(self, patch: Patch) -> list[tuple[int, str]]:
        """Rows to write, each with the record that it follows."""
        track, roles = self.reading.tracks[patch.track], self.roles
        numbers = (
            track.attributes[_ROW_COLUMN][patch.after : patch.after + 2].astype(np.int64).tolist()
        )
        cells = [self._cells(number) for number in numbers]
        row = [""] * len(self.dialect.names)
        if roles.id is not None:
            row[roles.id] = cells[0][roles.id]
        when = track.times[patch.after : patch.after + 2].tolist()
        if len(roles.time) == 1:
            clock = _TimeWriter.of([cell[roles.time[-1]] for cell in cells], when, patch.times)
        else:  # of a date and a time of day, the latter may hold both
            clock = _TimeWriter(
                when[0], None, 1, _needed_decimals(float(patch.times[0]) - when[0], 0), False, None
            )
        axes = [
            _written_decimals([cell[axis] for cell in cells], roles.geographic)
            for axis in roles.axes
        ]
        answer = []
        columns = (
            patch.times.tolist(),
            _coordinates(patch, track).tolist(),
            patch.confidence.tolist(),
            self._places(patch, numbers),
        )
        for time, position, confidence, place in zip(*columns, strict=True):
            row[roles.time[-1]] = clock.text(time)
            for axis, value, (decimals, comma) in zip(roles.axes, position, axes, strict=False):
                row[axis] = _format_number(value, decimals, comma)
            answer.append((place, self._joined([*row, "patched", f"{confidence:.3f}"])))
        return answer

    def _places(self, patch: Patch, numbers: Sequence[int]) -> list[int]:
        """Record after which each sample comes: rows of other tracks may lie in between, in the order of time."""
        first, last = numbers
        between = self._record_times[first + 1 : last] if last > first else np.empty(0)
        late = np.maximum.accumulate(np.where(np.isnan(between), -np.inf, between))
        found: list[int] = (first + np.searchsorted(late, patch.times, side="right")).tolist()
        return found

    @cached_property
    def _record_times(self) -> NDArray[np.float64]:
        times = np.full(len(self.records), np.nan)
        for track in self.reading.tracks:
            times[track.attributes[_ROW_COLUMN].astype(np.int64)] = track.times
        return times

    def _cells(self, number: int) -> list[str]:
        return next(csv.reader([self.records[number]], delimiter=self.dialect.delimiter))

    def _joined(self, cells: Sequence[str]) -> str:
        line = io.StringIO()
        csv.writer(line, delimiter=self.dialect.delimiter, lineterminator="").writerow(cells)
        return line.getvalue()


def read_for_patching(sources: Any, **options: Any) -> tuple[ReadResult, PatchableCsv | None]:
    """Read logs, and keep the text of a log that is alone and is text with columns.

    Parameters
    ----------
    sources, **options
        As :func:`gpszip.io.logs.read.read_logs` takes them.
    """
    several = list(expand(sources))
    alone = several[0] if len(several) == 1 else None
    if (
        isinstance(alone, Source)
        and (format_for_reading(alone).name if options.get("format") is None else options["format"])
        == "csv"
    ):
        options.pop("format", None)
        log = read_patchable_csv(alone, **options)
        return log.reading, log
    return read_logs(several, **options), None  # streams can be read once only


def read_patchable_csv(source: Source, columns: Any = None, **options: Any) -> PatchableCsv:
    """Read a log in text so that it can be written again.

    Parameters
    ----------
    source : Source
        Text with columns.
    columns : str, sequence or mapping, optional
        As :func:`gpszip.io.logs.read.read_logs` takes it, as are the other options.

    Returns
    -------
    TextLog

    Raises
    ------
    InputError
        If it can't be read as text with columns.
    """
    request = Request(parse_columns(columns), options.get("time_unit"), dates=options.get("dates"))
    dialect = detect_dialect(source.head(), request, source.name)
    encoding = confirm_encoding(source, dialect)
    dialect = replace(dialect, encoding=encoding)
    records, first = _split_records(source.read().decode(encoding), dialect.header_lines)
    by_role = request.columns if isinstance(request.columns, Mapping) else None
    roles = find_roles(dialect.names, by_role, (), source.name, cells=dialect.hint_cells)
    _check_plain(dialect, roles, records[first - 1] if first else "", source.name)
    log = _NamedBytes(
        "".join(_number_records(records, first, dialect.delimiter)).encode(encoding), source.name
    )
    names = [*dialect.names, _ROW_COLUMN] if isinstance(request.columns, tuple) else columns
    try:
        reading = read_logs(log, format="csv", columns=names, keep=(_ROW_COLUMN,), **options)
    except InputError:
        read_logs(
            _NamedBytes(source.read(), source.name), format="csv", columns=columns, **options
        )  # says it without our column
        raise
    return PatchableCsv(reading, records, dialect, roles, first)


def _check_plain(dialect: Dialect, roles: Roles, header: str, where: str) -> None:
    """Refuse tables to which no row can be added in the way in which they are written."""
    titles = next(csv.reader([header.rstrip("\r\n")], delimiter=dialect.delimiter), [])
    if dialect.trailing_cells or (len(titles) == dialect.width + 1 and not titles[-1].strip()):
        raise InputError(
            f"{where}: its header and its rows differ by an empty cell; give them as many cells, and rows can be added"
        )
    cells = [cell for axis in roles.axes for cell in dialect.cells(axis)]
    odd = next((cell for cell in cells if not looks_like_number(cell.replace(",", "."))), None)
    if roles.hemispheres or (odd is not None and odd.strip()[-1:] in "NSEWnsew\"'"):
        what = (
            "hemispheres in columns of their own"
            if roles.hemispheres
            else f"coordinates such as {odd!r}"
        )
        raise InputError(f"{where}: has {what}; rows can only be added to a table of plain numbers")


def _coordinates(patch: Patch, track: Track) -> NDArray[np.float64]:
    if track.plane is None:
        return patch.positions
    return np.stack(to_geographic(patch.positions, track.plane), axis=1)


class _NamedBytes(io.BytesIO):
    """Bytes with the name of the file that they come from."""

    def __init__(self, data: bytes, name: str) -> None:
        super().__init__(data)
        self.name = name


def _split_records(text: str, header: int) -> tuple[list[str], int]:
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


def _number_records(records: Sequence[str], first: int, mark: str) -> list[str]:
    """Records with their number as a further cell."""
    answer = []
    for number, record in enumerate(records):
        body = record.rstrip("\r\n")
        if number >= first and body.strip():
            body += f"{mark}{number}"
        elif number == first - 1:
            body += f"{mark}{_ROW_COLUMN}"
        answer.append(body + (record[len(record.rstrip("\r\n")) :] or "\n"))
    return answer


@dataclass(frozen=True)
class _TimeWriter:
    """Writes times as a log does."""

    start: float
    number: Decimal | None
    unit: float
    decimals: int
    comma: bool
    stamp: re.Match[str] | None
    of_day: bool = False  # whether times are those of a day without a date

    @classmethod
    def of(
        cls, texts: Sequence[str], when: Sequence[float], times: NDArray[np.float64]
    ) -> _TimeWriter:
        """Learn from the two times around a gap."""
        rhythm = float(times[0]) - when[0] if len(times) else 1.0
        comma = "," in texts[0] and "." not in texts[0]
        if any(re.fullmatch(_COMPACT, text.strip()) for text in texts):
            return cls(when[0], None, 1, _needed_decimals(rhythm, 0), comma, None)
        try:
            one, other = (Decimal(text.strip().replace(",", ".")) for text in texts)
        except ArithmeticError:
            of_day = _OF_DAY.match(texts[0].strip()) is not None
            return cls(
                when[0],
                None,
                1,
                _needed_decimals(rhythm, 0),
                comma,
                _ISO.fullmatch(texts[0].strip()),
                of_day,
            )
        scale = float(other - one) / (when[1] - when[0])
        if scale < _DAILY:
            unit, least = 1 / _DAY, _DAY_DECIMALS
        else:
            unit, least = 10.0 ** max(round(np.log10(scale) / 3) * 3, 0), 0
        places = max(-int(number.as_tuple().exponent) for number in (one, other))
        return cls(
            when[0],
            one,
            unit,
            max(places, least, _needed_decimals(rhythm * unit, max(places, 0))),
            comma,
            None,
        )

    def text(self, time: float) -> str:
        """One time."""
        if self.number is not None:
            step = Decimal(repr(round((time - self.start) * self.unit, 9)))
            text = f"{(self.number + step).quantize(Decimal(1).scaleb(-self.decimals)):f}"
            return text.replace(".", ",") if self.comma else text
        if self.stamp is not None:
            return self._stamped(time)
        moment = datetime.fromtimestamp(round(time, 6), UTC).replace(tzinfo=None)
        if self.of_day:
            return moment.time().isoformat(timespec="milliseconds" if self.decimals else "seconds")
        return moment.isoformat(timespec="milliseconds" if self.decimals else "seconds") + "Z"

    def _stamped(self, time: float) -> str:
        assert self.stamp is not None
        year, month, day, between, hour, minute, second, fraction, zone = self.stamp.groups()
        moment = datetime(int(year), int(month), int(day), int(hour), int(minute), int(second))
        digits = max(len(fraction or ""), self.decimals)
        begun = float(f"0.{fraction}") if fraction else 0.0
        later = moment + timedelta(seconds=round(time - self.start + begun, min(digits, 6)))
        text = later.strftime(f"%Y-%m-%d{between}%H:%M:%S")
        return (
            text
            + (f".{later.microsecond:06d}".ljust(digits + 1, "0")[: digits + 1] if digits else "")
            + zone
        )


def _needed_decimals(step: float, least: int) -> int:
    """Decimals that steps of this size need, up to three."""
    return next(
        (
            digits
            for digits in range(least, 3)
            if abs(step - round(step, digits)) < 1e-4 * max(step, 1e-9)
        ),
        max(least, 3),
    )


def _written_decimals(texts: Sequence[str], degrees: bool) -> tuple[int, bool]:
    """Decimals to write, and whether after a comma."""
    comma = any("," in text for text in texts)
    found = [
        len(re.split(r"[.,]", text.strip())[1])
        for text in texts
        if re.fullmatch(r"\s*[+-]?\d*[.,]\d+\s*", text)
    ]
    return max([_DECIMALS + 4 * degrees, *found]), comma


def _format_number(value: float, decimals: int, comma: bool) -> str:
    text = f"{round(value, decimals) + 0.0:.{decimals}f}"
    return text.replace(".", ",") if comma else text
