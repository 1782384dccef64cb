"""CSV logs to be written again with rows added, while every row of the log stays letter by letter.

:func:`read_for_patching` keeps the text of a log beside its tracks. Each sample knows its record
in the text, so :meth:`PatchableCsv.write` can insert samples between records, with times and
coordinates written as the log writes them.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.planes import to_geographic
from gpszip.io.logs.csv import Dialect, confirm_encoding, detect_dialect
from gpszip.io.logs.formats import CSV, format_for_reading, format_named, is_bundle
from gpszip.io.logs.mixed_files import may_be_log
from gpszip.io.logs.raw import Request, unused_name
from gpszip.io.logs.read import ReadOptions, read_logs
from gpszip.io.storage.source import Source, expand
from gpszip.io.tables.roles import Roles, find_roles, parse_columns
from gpszip.io.values.arrow import looks_like_number
from gpszip.model import Patch, Track
from gpszip.model.read_result import ReadResult

__all__ = ["PatchableCsv", "read_for_patching", "read_patchable_csv"]

#: Attribute that numbers the record of each sample.
_ROW_COLUMN = "gpszip_row"

#: Date and time in ISO 8601: year, month, day, separator, hour, minute, second, fraction, zone.
_ISO = re.compile(r"(\d{4})-(\d\d)-(\d\d)([T ])([01]\d|2[0-3]):(\d\d):([0-5]\d)(?:[.,](\d+))?(.*)")

#: A date and a time of day as one number, to which seconds can't be added.
_COMPACT = re.compile(r"\d{14}(\.\d*)?")

#: A time of day without a date.
_TIME_OF_DAY = re.compile(r"\d{1,2}:\d{2}:\d{2}")

#: Decimals of a coordinate that can be written as the log writes it.
_DECIMAL_NUMBER = re.compile(r"\s*[+-]?\d*[.,]\d+\s*")

#: Seconds of a day.
_DAY = 86_400

#: Numbers for a second below which they count days.
_MAX_DAYS_PER_SECOND = 1e-3

#: Decimals of days that are written at least: 0.1 ms.
_MIN_DAY_DECIMALS = 9

#: Decimals of metres that are written at least.
_MIN_METRE_DECIMALS = 2

#: Decimals of degrees that are written at least.
_MIN_DEGREE_DECIMALS = 6

#: Decimals of seconds that times with fractions have at most, if the log doesn't have more.
_MAX_SECOND_DECIMALS = 3

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PatchableCsv:
    """A CSV log as text, and as tracks that know their records.

    Parameters
    ----------
    read_result : ReadResult
        The tracks; their attribute ``gpszip_row`` numbers the record of each sample.
    records : list of str
        All text of the file, cut into records, each with its line end.
    dialect : Dialect
        How the file writes its table.
    roles : Roles
        Which column holds what.
    first_row : int
        Index of the record that is the first row.
    """

    read_result: ReadResult
    records: list[str]
    dialect: Dialect
    roles: Roles
    first_row: int

    def write(self, patches: Sequence[Patch], sink: BinaryIO) -> None:
        """Write the log with the samples of patches, and the columns ``source, confidence``.

        Parameters
        ----------
        patches : sequence of Patch
            Samples to add. They are written between the rows around their gap, in the order of
            time.
        sink : binary file
            The file to write to.
        """
        # Find the rows to insert, by the record that they follow.
        inserted: dict[int, list[str]] = {}
        for patch in patches:
            for row in self._rows_of(patch) if len(patch.times) else ():
                inserted.setdefault(row.after, []).append(row.text)

        # Write record by record.
        delimiter = self.dialect.delimiter
        title = delimiter + delimiter.join(self._new_column_names())
        out = io.TextIOWrapper(sink, encoding=self.dialect.encoding, newline="", write_through=True)
        for index, record in enumerate(self.records):
            # Rows and the header get two more cells; lines before the header and blank ones don't.
            suffix = ""
            if index >= self.first_row and record.strip():
                suffix = f"{delimiter}log{delimiter}1"
            elif index == self.first_row - 1:
                suffix = title
            body = record.rstrip("\r\n")
            out.write(body + suffix + (record[len(body) :] or self._line_end))
            out.writelines(text + self._line_end for text in inserted.get(index, ()))
        # The wrapper would close the sink when it is deleted.
        out.detach()

    @cached_property
    def _line_end(self) -> str:
        first = re.search(r"\r\n|\r|\n", self.records[0])
        return first[0] if first else "\n"

    def _new_column_names(self) -> list[str]:
        # Readers of tables ignore case, so a column `Source` takes the name as well.
        taken = {name.strip().lower() for name in self.dialect.names}
        return [
            name if name not in taken else unused_name(f"patch_{name}", taken)
            for name in ("source", "confidence")
        ]

    def _rows_of(self, patch: Patch) -> list[_NewRow]:
        """Return the rows of a patch."""
        # Look at the records before and after the gap.
        track, roles = self.read_result.tracks[patch.track], self.roles
        around = slice(patch.after, patch.after + 2)
        records = track.attributes[_ROW_COLUMN][around].astype(np.int64).tolist()
        cells = [self._cells(record) for record in records]
        times = track.times[around].tolist()

        # Learn how they write times and coordinates.
        time_column = roles.time[-1]
        if len(roles.time) == 1:
            texts = [record_cells[time_column] for record_cells in cells]
            clock = _TimeWriter.learn(texts, times, patch.times)
        else:  # of the columns for date and time of day, the latter may hold both
            step = float(patch.times[0]) - times[0]
            clock = _TimeWriter(times[0], decimals=_needed_decimals(step, 0))
        number_formats = [
            _NumberFormat.learn([record_cells[axis] for record_cells in cells], roles.geographic)
            for axis in roles.axes
        ]

        # Write the samples.
        row = [""] * len(self.dialect.names)
        if roles.id is not None:
            row[roles.id] = cells[0][roles.id]
        rows = []
        for time, position, confidence, after in zip(
            patch.times.tolist(),
            _coordinates(patch, track).tolist(),
            patch.confidence.tolist(),
            self._records_before(patch, records),
            strict=True,
        ):
            row[time_column] = clock.format(time)
            for axis, value, number_format in zip(
                roles.axes, position, number_formats, strict=False
            ):
                row[axis] = number_format.format(value)
            rows.append(_NewRow(after, self._join([*row, "patched", f"{confidence:.3f}"])))
        return rows

    def _records_before(self, patch: Patch, records: Sequence[int]) -> list[int]:
        """Return the record that each sample follows.

        Rows of other tracks may lie between those around the gap. All rows there stay in the order
        of time, as far as they are in that order.
        """
        # The search needs sorted times. The running maximum is sorted even where time goes back,
        # and -inf for records without a sample leaves it unchanged.
        first, last = records
        between = self._record_times[first + 1 : last] if last > first else np.empty(0)
        latest = np.maximum.accumulate(np.where(np.isnan(between), -np.inf, between))
        before: list[int] = (first + np.searchsorted(latest, patch.times, side="right")).tolist()
        return before

    @cached_property
    def _record_times(self) -> Floats:
        """Time of each record; NaN for records that are no sample."""
        times = np.full(len(self.records), np.nan)
        for track in self.read_result.tracks:
            times[track.attributes[_ROW_COLUMN].astype(np.int64)] = track.times
        return times

    def _cells(self, record: int) -> list[str]:
        return next(csv.reader([self.records[record]], delimiter=self.dialect.delimiter))

    def _join(self, cells: Sequence[str]) -> str:
        line = io.StringIO()
        csv.writer(line, delimiter=self.dialect.delimiter, lineterminator="").writerow(cells)
        return line.getvalue()


class _NewRow(NamedTuple):
    """A row to insert after a record."""

    after: int
    text: str


def read_for_patching(
    sources: str | Path | BinaryIO | Iterable[str | Path | BinaryIO],
    **options: Unpack[ReadOptions],
) -> tuple[ReadResult, PatchableCsv | None]:
    """Read logs, and keep the text of a log that is alone and CSV.

    Parameters
    ----------
    sources, **options
        As for :func:`gpszip.io.logs.read.read_logs`.

    Returns
    -------
    ReadResult
        The tracks.
    PatchableCsv or None
        The text; None for several logs and for other formats.
    """
    # Streams can be read only once.
    expanded = list(expand(sources, unzip=is_bundle, wanted=may_be_log))
    if len(expanded) == 1 and isinstance(expanded[0], Source):
        source, name = expanded[0], options.get("format")
        chosen = format_for_reading(source) if name is None else format_named(name)
        if chosen is CSV:
            log = read_patchable_csv(source, **options)
            return log.read_result, log
    return read_logs(expanded, **options), None


def read_patchable_csv(source: Source, **options: Unpack[ReadOptions]) -> PatchableCsv:
    """Read a CSV log so that it can be written again.

    Parameters
    ----------
    source : Source
        Text with columns.
    **options
        As for :func:`gpszip.io.logs.read.read_logs`.

    Raises
    ------
    InputError
        If it can't be read as text with columns, or no row can be added to its table.
    """
    # Find the records and the columns.
    columns = options.get("columns")
    request = Request(parse_columns(columns), options.get("time_unit"), dates=options.get("dates"))
    dialect = detect_dialect(source.head(), request, source.name)
    dialect = replace(dialect, encoding=confirm_encoding(source, dialect))
    text = source.read().decode(dialect.encoding)
    records, first_row = _split_records(text, dialect.header_lines)
    by_role = request.columns if isinstance(request.columns, Mapping) else None
    roles = find_roles(dialect.names, by_role, (), source.name, cells=dialect.hint_cells)
    _check_plain(dialect, roles, records[first_row - 1] if first_row else "", source.name)

    # Read the log with a column that numbers its records.
    numbered = "".join(_number_records(records, first_row, dialect.delimiter))
    if isinstance(request.columns, tuple):
        columns = [*dialect.names, _ROW_COLUMN]
    plain_options: ReadOptions = {**options, "format": CSV.name}
    row_options: ReadOptions = {**plain_options, "columns": columns, "keep": (_ROW_COLUMN,)}
    try:
        data = _NamedBytes(numbered.encode(dialect.encoding), source.name)
        read_result = read_logs(data, **row_options)
    except InputError:
        # Read the log without that column, so that the error doesn't show it.
        read_logs(_NamedBytes(source.read(), source.name), **plain_options)
        raise
    return PatchableCsv(read_result, records, dialect, roles, first_row)


def _check_plain(dialect: Dialect, roles: Roles, header: str, where: str) -> None:
    """Refuse tables to which no row can be added in the way the table is written."""
    # Header and rows need the same number of cells.
    titles = next(csv.reader([header.rstrip("\r\n")], delimiter=dialect.delimiter), [])
    has_empty_title = len(titles) == dialect.width + 1 and not titles[-1].strip()
    if dialect.trailing_cells or has_empty_title:
        raise InputError(
            "its header and its rows differ by an empty cell",
            path=where,
            remedy="give them as many cells, and rows can be added",
        )

    # Coordinates have to be plain numbers.
    cells = [cell for axis in roles.axes for cell in dialect.cells(axis)]
    odd = next((cell for cell in cells if not looks_like_number(cell.replace(",", "."))), None)
    if roles.hemispheres:
        problem = "hemispheres in columns of their own"
    elif odd is not None and odd.strip()[-1:] in "NSEWnsew\"'":
        problem = f"coordinates such as {odd!r}"
    else:
        return
    raise InputError(
        f"has {problem}", path=where, remedy="rows can only be added to a table of plain numbers"
    )


def _coordinates(patch: Patch, track: Track) -> Floats:
    if track.plane is None:
        return patch.positions
    return np.stack(to_geographic(patch.positions, track.plane), axis=1)


class _NamedBytes(io.BytesIO):
    """Bytes with the name of their file."""

    def __init__(self, data: bytes, name: str) -> None:
        super().__init__(data)
        self.name = name


def _split_records(text: str, header_lines: int) -> tuple[list[str], int]:
    """Cut a text into records: lines, or several lines if a line break is within quotes.

    Returns
    -------
    list of str
        The records.
    int
        Number of records before the first row.
    """
    lines = list(io.StringIO(text, newline=""))
    if '"' not in text:
        return lines, header_lines

    # A quote within quotes is written twice, so an odd number of quotes opens or closes a cell.
    records, is_quoted = lines[:header_lines], False
    for line in lines[header_lines:]:
        if is_quoted:
            records[-1] += line
        else:
            records.append(line)
        is_quoted ^= line.count('"') % 2 == 1
    return records, header_lines


def _number_records(records: Sequence[str], first_row: int, delimiter: str) -> list[str]:
    """Return the records, each with its number as a further cell."""
    # The number is the last cell, so that no other column moves. A blank line with a number would
    # become a row.
    numbered = []
    for number, record in enumerate(records):
        body = record.rstrip("\r\n")
        line_end = record[len(body) :] or "\n"
        if number >= first_row and body.strip():
            body += f"{delimiter}{number}"
        elif number == first_row - 1:
            body += f"{delimiter}{_ROW_COLUMN}"
        numbered.append(body + line_end)
    return numbered


# Numbers and times as the log writes them


@dataclass(frozen=True)
class _TimeWriter:
    """Writes times as a log does, by the time before a gap.

    Parameters
    ----------
    start : float
        Seconds of the time before the gap.
    decimals : int
        Decimals to write.
    number : Decimal, optional
        The time before the gap, if times are numbers.
    unit : float
        Units of these numbers in a second.
    comma : bool
        Whether numbers have a decimal comma.
    stamp : re.Match, optional
        The time before the gap, if times are ISO 8601.
    is_time_of_day : bool
        Whether times have no date. Times that are none of these are written as ISO 8601 in UTC.
    """

    start: float
    decimals: int
    number: Decimal | None = None
    unit: float = 1.0
    comma: bool = False
    stamp: re.Match[str] | None = None
    is_time_of_day: bool = False

    @classmethod
    def learn(cls, texts: Sequence[str], around: Sequence[float], times: Floats) -> _TimeWriter:
        """Learn from the times around a gap.

        Parameters
        ----------
        texts : sequence of str, length 2
            The times around the gap, in the log.
        around : sequence of float, length 2
            The same in seconds.
        times : float64 array, shape (n,)
            Seconds of the samples to write.
        """
        # Find the decimals of seconds that the step to the first sample needs.
        start = around[0]
        step = float(times[0]) - start if len(times) else 1.0
        decimals = _needed_decimals(step, 0)

        # Times that are no numbers
        if any(_COMPACT.fullmatch(text.strip()) for text in texts):
            return cls(start, decimals)
        try:
            first, second = (Decimal(text.strip().replace(",", ".")) for text in texts)
        except ArithmeticError:
            text = texts[0].strip()
            is_time_of_day = _TIME_OF_DAY.match(text) is not None
            return cls(start, decimals, stamp=_ISO.fullmatch(text), is_time_of_day=is_time_of_day)

        # Numbers: days, or seconds and their thousandths
        # How many units a second has: 1000 if they are milliseconds, 1/86400 if days. Times of
        # the log are rounded, so the nearest power of 1000 counts.
        scale = float(second - first) / (around[1] - start)
        if scale < _MAX_DAYS_PER_SECOND:
            unit, min_decimals = 1 / _DAY, _MIN_DAY_DECIMALS
        else:
            unit, min_decimals = 10.0 ** max(round(np.log10(scale) / 3) * 3, 0), 0
        written = max(-int(number.as_tuple().exponent) for number in (first, second))
        needed = _needed_decimals(step * unit, max(written, 0))
        comma = "," in texts[0] and "." not in texts[0]
        return cls(start, max(written, min_decimals, needed), number=first, unit=unit, comma=comma)

    def format(self, time: float) -> str:
        """Return the text of a time in seconds."""
        if self.number is not None:
            # A float can't hold nanoseconds since 1970, a Decimal holds all digits of the log.
            step = Decimal(repr(round((time - self.start) * self.unit, 9)))
            text = f"{(self.number + step).quantize(Decimal(1).scaleb(-self.decimals)):f}"
            return text.replace(".", ",") if self.comma else text
        if self.stamp is not None:
            return self._format_stamp(self.stamp, time)

        # Times of day are seconds from midnight, and so fall on the first day of 1970.
        moment = datetime.fromtimestamp(round(time, 6), UTC).replace(tzinfo=None)
        timespec = "milliseconds" if self.decimals else "seconds"
        if self.is_time_of_day:
            return moment.time().isoformat(timespec=timespec)
        return moment.isoformat(timespec=timespec) + "Z"

    def _format_stamp(self, stamp: re.Match[str], time: float) -> str:
        """Add seconds to an ISO timestamp; separator, zone and number of decimals stay."""
        year, month, day, separator, hour, minute, second, fraction, zone = stamp.groups()
        moment = datetime(int(year), int(month), int(day), int(hour), int(minute), int(second))
        digits = max(len(fraction or ""), self.decimals)
        seconds = float(f"0.{fraction}") if fraction else 0.0
        moment += timedelta(seconds=round(time - self.start + seconds, min(digits, 6)))

        # Datetimes hold microseconds. Where the log has more digits, zeros follow.
        text = moment.strftime(f"%Y-%m-%d{separator}%H:%M:%S")
        if digits:
            text += f".{moment.microsecond:06d}".ljust(digits + 1, "0")[: digits + 1]
        return text + zone


def _needed_decimals(step: float, least: int) -> int:
    """Return the decimals that multiples of a step need, from the least up to three."""
    # Steps of 0.5 s need one decimal, steps of 1/30 s all three.
    for decimals in range(least, _MAX_SECOND_DECIMALS):
        if abs(step - round(step, decimals)) < 1e-4 * max(step, 1e-9):
            return decimals
    return max(least, _MAX_SECOND_DECIMALS)


class _NumberFormat(NamedTuple):
    """How a log writes a coordinate.

    Parameters
    ----------
    decimals : int
        Decimals to write.
    comma : bool
        Whether they follow a comma.
    """

    decimals: int
    comma: bool

    @classmethod
    def learn(cls, texts: Sequence[str], is_degrees: bool) -> _NumberFormat:
        """Learn from the coordinates around a gap."""
        written = [
            len(re.split(r"[.,]", text.strip())[1])
            for text in texts
            if _DECIMAL_NUMBER.fullmatch(text)
        ]
        least = _MIN_DEGREE_DECIMALS if is_degrees else _MIN_METRE_DECIMALS
        return cls(max([least, *written]), any("," in text for text in texts))

    def format(self, value: float) -> str:
        """Return the text of a coordinate."""
        text = f"{round(value, self.decimals) + 0.0:.{self.decimals}f}"
        return text.replace(".", ",") if self.comma else text
