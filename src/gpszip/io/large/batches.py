"""One file of a log, to be read in batches of rows that fit in memory.

:func:`inspect_log_file` looks at the start of a file and returns a :class:`LogFile`;
:meth:`LogFile.batches` then reads its rows. Whether a file can be read in batches is for its
format to say (``read_batches`` of :class:`gpszip.io.logs.log_format.LogFormat`); other files give
one batch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading, format_named
from gpszip.io.logs.log_format import CoordinateKind, LogBatches, LogFormat
from gpszip.io.logs.plausibility import check_plausible
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.storage.source import Source

__all__ = ["CoordinateKind", "LogFile", "inspect_log_file"]

#: Letters of an error message of Arrow that are shown.
_MAX_REASON_LETTERS = 120


@dataclass(frozen=True, eq=False)
class LogFile:
    """One file of a log: what its start says, before its rows are read.

    Parameters
    ----------
    source : Source
        The file.
    request : Request
        Columns and unit of time.
    format : LogFormat
        Its format.
    opened : LogBatches, optional
        The file as its format opens it; None if it has to be read at once.
    """

    source: Source
    request: Request
    format: LogFormat
    opened: LogBatches | None = None

    @property
    def name(self) -> str:
        """Name of the file in messages."""
        return self.source.name

    @property
    def coordinate_kind(self) -> CoordinateKind | None:
        """What its coordinates are; None if that shows only when its rows are read."""
        return None if self.opened is None else self.opened.coordinate_kind

    def row_count(self) -> int | None:
        """Return the number of rows if the file states it, as Parquet does; else None."""
        if self.opened is None or self.opened.count_rows is None:
            return None
        return self.opened.count_rows()

    def batches(self) -> Iterator[RawLog]:
        """Yield the rows in the order of the file, once.

        Raises
        ------
        InputError
            If the file is damaged.
        """
        if self.opened is None:
            yield check_plausible(self.format.read(self.source, self.request), self.request)
        else:
            yield from self.opened.batches


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
        chosen = format_for_reading(source) if format_ is None else format_named(format_)
        opened = None if chosen.read_batches is None else chosen.read_batches(source, request)
        return LogFile(source, request, chosen, opened)
    except InputError as error:
        return error
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0][:_MAX_REASON_LETTERS]
        return InputError(f"{source.name}: can't be read: {reason}")
