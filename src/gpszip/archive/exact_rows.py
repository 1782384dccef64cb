"""Rows and columns of logs that an archive keeps exactly."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from gpszip.archive.exact import find_exact_logs
from gpszip.errors import OptionError, UnknownTrackError
from gpszip.lossless.rows import find_rows

if TYPE_CHECKING:
    from gpszip.archive.archive import Archive
    from gpszip.lossless.layout import TableLayout
    from gpszip.lossless.logs import ExactLogs

__all__ = ["ChosenFrames", "ChosenRows", "choose_rows"]

#: Most names that messages list.
_MAX_LISTED = 10

#: Name of the track of a log that names none, where it is alone.
_UNNAMED = "0"


@dataclass(frozen=True, eq=False)
class ChosenRows:
    """Rows of logs with the same columns.

    Parameters
    ----------
    logs : ExactLogs
        The logs.
    numbers : tuple of int
        Which of them have such rows.
    layout : TableLayout
        How their text falls into rows and columns.
    track : str, optional
        Name of the track in a column; None for all rows.
    columns : tuple of int, optional
        Numbers of the columns; None for whole rows.
    """

    logs: ExactLogs
    numbers: tuple[int, ...]
    layout: TableLayout
    track: str | None
    columns: tuple[int, ...] | None

    @property
    def suffix(self) -> str:
        """Suffix of a file of the rows."""
        return ".csv"

    def parts(self) -> Iterator[tuple[bytes, int]]:
        """Yield the text that stands before the rows, or the header of the columns, then the rows.

        With each part of the text comes the number of rows in it.

        Raises
        ------
        CorruptArchiveError
            If a block is damaged.
        """
        if self.columns is None:
            yield self.layout.preamble, 0
        else:
            names = [_column_names(self.layout)[column] for column in self.columns]
            header = io.StringIO()
            csv.writer(header, delimiter=chr(self.layout.delimiter), lineterminator="\n").writerow(
                names
            )
            yield header.getvalue().encode(), 0
        for number in self.numbers:
            for part in self.logs.rows(number, self.track, self.columns):
                # The last row of a log may lack its newline.
                yield part, part.count(b"\n") + (not part.endswith(b"\n") and len(part) > 0)

    def table(self) -> Any:
        """The rows as a table of Arrow, whose cells are the texts in the log.

        Raises
        ------
        CorruptArchiveError
            If a block is damaged.
        OptionError
            If quotes or ends of lines within cells hide where rows and cells end.
        """
        import pyarrow as pa
        import pyarrow.csv as pc

        # All rows have as many cells then.
        names = _column_names(self.layout)
        columns = tuple(range(len(names))) if self.columns is None else self.columns
        parts = [part for n in self.numbers for part in self.logs.rows(n, self.track, columns)]
        text = b"".join(parts)
        chosen = [names[column] for column in columns]
        if not text:
            return pa.table({name: pa.array([], pa.string()) for name in chosen})
        try:
            text.decode()
        except UnicodeDecodeError:
            text = text.decode("latin-1").encode()
        try:
            table = pc.read_csv(
                pa.BufferReader(text),
                pc.ReadOptions(column_names=chosen, block_size=len(text) + 1),
                pc.ParseOptions(
                    delimiter=chr(self.layout.delimiter),
                    newlines_in_values=True,
                    ignore_empty_lines=False,
                ),
                pc.ConvertOptions(
                    column_types=dict.fromkeys(chosen, pa.string()), strings_can_be_null=False
                ),
            )
        except pa.ArrowInvalid:
            table = None
        # Arrow also ends rows at a carriage return within a cell.
        if table is None or table.num_rows != len(find_rows(text, self.layout.delimiter)):
            raise OptionError(
                f"{self.logs.logs[self.numbers[0]].name} has an end of a line within a cell",
                remedy="take its text: decompress --exact, with --track and --columns",
            )
        return table


@dataclass(frozen=True, eq=False)
class ChosenFrames:
    """Rows of logs of columns with types, such as Parquet, which have the same columns.

    Parameters
    ----------
    logs : ExactLogs
        The logs.
    numbers : tuple of int
        Which of them have such rows.
    track : str, optional
        Name of the track in a column; None for all rows.
    columns : tuple of int, optional
        Numbers of the columns; None for all.
    """

    logs: ExactLogs
    numbers: tuple[int, ...]
    track: str | None
    columns: tuple[int, ...] | None

    @property
    def suffix(self) -> str:
        """Suffix of a file of the rows."""
        return ".parquet"

    def parts(self) -> Iterator[tuple[bytes, int]]:
        """Yield the bytes of a file of Parquet, and with the first ones the number of rows.

        Raises
        ------
        CorruptArchiveError
            If a block is damaged.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        table, sink = self.table(), pa.BufferOutputStream()
        pq.write_table(table, sink, compression=self.logs.frames[self.numbers[0]].head.codec)
        yield sink.getvalue().to_pybytes(), table.num_rows

    def table(self) -> Any:
        """The rows as a table of Arrow, with the types of the log."""
        import pyarrow as pa

        schema = self.logs.frames[self.numbers[0]].head.schema
        if self.columns is not None:
            fields = [schema.field(column) for column in self.columns]
            schema = pa.schema(fields, schema.metadata)
        batches = [
            pa.Table.from_batches([batch]).cast(schema)
            for number in self.numbers
            for batch in self.logs.frames[number].batches(self.track, self.columns)
        ]
        return pa.concat_tables(batches) if batches else schema.empty_table()


def choose_rows(
    archive: Archive,
    track: str | None = None,
    columns: Sequence[str] | None = None,
    log: str | None = None,
) -> ChosenRows | ChosenFrames:
    """Find the logs that have some rows and columns; nothing is decoded.

    Parameters
    ----------
    archive : Archive
        Keeps the logs exactly.
    track : str, optional
        Name of a track; by default all.
    columns : sequence of str, optional
        Names of columns; by default all.
    log : str, optional
        Name of a log; by default all that have the track.

    Raises
    ------
    UnknownTrackError
        If there is no such track.
    OptionError
        If no log is kept exactly, a log has no rows or no such column, rows of the track can't be
        told apart, or logs with other columns have rows of it, too.
    """
    # The logs.
    logs = find_exact_logs(archive)
    if logs is None:
        raise OptionError(
            "the archive keeps no log exactly", remedy="compress the log with --lossless"
        )
    names = [each.name for each in logs.logs]
    if log is not None and log not in names:
        raise OptionError(f"no log {log!r} is kept exactly", remedy=f"there are {_listed(names)}")
    numbers = range(len(names)) if log is None else [names.index(log)]

    # Those with the track, and how their text falls into columns.
    in_column = False
    if track is not None:
        numbers, in_column = _logs_with(archive, logs, numbers, track)
    if any(number in logs.frames for number in numbers):
        return _choose_frames(logs, numbers, track if in_column else None, columns)
    layouts = [logs.layout(number) for number in numbers]
    lacking = [names[n] for n, layout in zip(numbers, layouts, strict=True) if layout is None]
    if lacking:
        raise OptionError(
            f"{lacking[0]} has no rows with columns, such as those of CSV",
            remedy=f"decompress all of it: --exact --log {lacking[0]}",
        )
    first = layouts[0]
    assert first is not None
    for number, layout in zip(numbers, layouts, strict=True):
        assert layout is not None
        if (layout.columns, layout.delimiter) != (first.columns, first.delimiter):
            raise _different_columns(names[numbers[0]], names[number])

    # The columns.
    chosen = None if columns is None else _find_columns(_column_names(first), columns)
    return ChosenRows(logs, tuple(numbers), first, track if in_column else None, chosen)


def _logs_with(
    archive: Archive, logs: ExactLogs, numbers: Sequence[int], track: str
) -> tuple[list[int], bool]:
    """Numbers of the logs with rows of a track, and whether a column names it."""
    names = {number: logs.tracks(number) for number in numbers}
    found = [number for number in numbers if track in (names[number] or ())]
    if found:
        return found, True

    # A log without a column of tracks is one track, which has its name.
    unnamed = [number for number in numbers if names[number] is None]
    is_alone = len(logs.logs) == 1 and track == _UNNAMED
    found = [n for n in unnamed if is_alone or PurePath(logs.logs[n].name).stem == track]
    if found and len(found) == 1:
        return found, False
    if track not in archive.ids:
        raise UnknownTrackError(
            f"there is no track {track!r} in the logs; there are {_listed(archive.ids)}"
        )
    raise OptionError(
        f"no column tells which rows are of track {track!r}",
        remedy=f"decompress a whole log: --exact --log {logs.logs[numbers[0]].name}",
    )


def _column_names(layout: TableLayout) -> tuple[str, ...]:
    """Names of the columns, or their numbers from 1 where the log names none."""
    return layout.columns or tuple(str(number + 1) for number in range(layout.width))


def _find_columns(names: Sequence[str], wanted: Sequence[str]) -> tuple[int, ...]:
    """Numbers of the columns with these names."""
    for name in wanted:
        if name not in names:
            raise OptionError(
                f"the log has no column {name!r}", remedy=f"it has {', '.join(names)}"
            )
    return tuple(names.index(name) for name in wanted)


def _choose_frames(
    logs: ExactLogs, numbers: Sequence[int], track: str | None, columns: Sequence[str] | None
) -> ChosenFrames:
    """Choose rows and columns of logs of columns with types."""
    first = logs.frames.get(numbers[0])
    for number in numbers:
        other = logs.frames.get(number)
        if first is None or other is None or not other.head.schema.equals(first.head.schema):
            raise _different_columns(logs.logs[numbers[0]].name, logs.logs[number].name)
    assert first is not None
    chosen = None if columns is None else _find_columns(first.head.schema.names, columns)
    return ChosenFrames(logs, tuple(numbers), track, chosen)


def _different_columns(first: str, other: str) -> OptionError:
    """The error if two logs can't be one table."""
    return OptionError(
        f"{first} and {other} have other columns", remedy="name one of them with --log"
    )


def _listed(names: Sequence[str]) -> str:
    """Some names, for messages."""
    more = ", ..." if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more
