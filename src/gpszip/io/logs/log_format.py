"""The description of one log format: how its files are recognised, read and written.

A format is one :class:`LogFormat`. Those of GPSZip stand in the table of
:mod:`gpszip.io.logs.formats`; other packages register theirs by an entry point of the group
``gpszip.formats``. The table is also read for help texts, so this module imports nothing heavy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

if TYPE_CHECKING:
    from gpszip.io.logs.raw import RawLog, Request
    from gpszip.io.logs.track_rows import TrackRows
    from gpszip.io.storage.source import Source

__all__ = ["SPECIAL_OPTIONS", "CoordinateKind", "LogBatches", "LogFormat"]

#: Fields of a request that only some formats know, and their options on the command line.
SPECIAL_OPTIONS = {
    "topics": "--topic",
    "frame": "--frame",
    "times_file": "--times",
    "rate": "--rate",
}


class CoordinateKind(NamedTuple):
    """What the coordinates of a file are; files of one log have to agree.

    Parameters
    ----------
    geographic : bool
        Whether they are degrees.
    dimension : int
        Number of coordinates.
    crs : str
        Coordinate system that the file names; empty if it names none.
    """

    geographic: bool
    dimension: int
    crs: str = ""


@dataclass(frozen=True, eq=False)
class LogBatches:
    """A log that is read in batches, so that it may be larger than memory.

    Parameters
    ----------
    batches : iterable of RawLog
        The rows in the order of the file; all batches name their tracks by the same ids. The file
        is read while they are iterated, once.
    coordinate_kind : CoordinateKind, optional
        What the coordinates are; None if only the rows show that.
    count_rows : callable, optional
        Returns the number of rows if the file states it; None if it doesn't.
    """

    batches: Iterable[RawLog]
    coordinate_kind: CoordinateKind | None = None
    count_rows: Callable[[], int] | None = None


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    r"""A format of logs.

    Parameters
    ----------
    name : str
        Name for the option ``--format``, in lower case.
    suffixes : tuple of str
        Suffixes of file names, in lower case; the first one is shown as an example. None if names
        say nothing, and files of the format are only read.
    description : str
        What is read, in one line.
    sniff : callable
        Whether a file may be of this format. It gets the first 256 KiB of the file, decompressed;
        names don't count.
    read : callable
        Reads a log.
    read_batches : callable, optional
        Opens a log to be read in batches; returns None for a file that has to be read at once.
        The first batch must be checked by :func:`gpszip.io.logs.plausibility.check_plausible` if
        units are guessed.
    write : callable, optional
        Writes tracks to a binary file; None for a format that is only read.
    describe_losses : callable, optional
        Describes what its files can't hold, one text for each loss. It gets the names of the tracks
        and of their attributes.
    time_decimals : int, optional
        Decimals of seconds to write if these are fine enough, for a format whose readers often
        know no more; six by default.
    is_binary : bool
        Whether its files are no text, and are not written to a terminal.
    is_fallback : bool
        Whether ``sniff`` accepts nearly any text. Such a format is asked last, and for files of a
        zip archive only if the name has one of its suffixes.
    extra : str
        The optional dependency that it needs: ``pip install 'gpszip[EXTRA]'``. ``read`` raises
        :class:`gpszip.errors.MissingExtraError` if it isn't installed.
    takes : tuple of str
        Fields of :class:`gpszip.io.logs.raw.Request` that only some formats know, of those in
        :data:`SPECIAL_OPTIONS`. Other formats refuse their options.
    heights : bool
        Whether it keeps heights unasked, see :attr:`gpszip.io.logs.raw.Request.heights`.

    Examples
    --------
    A format that is only read:

    >>> import numpy as np
    >>> from gpszip.io.logs.raw import RawLog, Request
    >>> from gpszip.io.storage.source import Source
    >>> def read_pairs(source, request):
    ...     rows = np.array([line.split() for line in source.read().splitlines()[1:]], float)
    ...     return RawLog(source.name, (), None, rows[:, 0], rows[:, 1:], geographic=True)
    >>> pairs = LogFormat(
    ...     name="pairs",
    ...     suffixes=(".pairs",),
    ...     description="time, latitude and longitude in each line",
    ...     sniff=lambda head: head.startswith(b"PAIRS"),
    ...     read=read_pairs,
    ... )
    >>> pairs.read(Source("a.pairs", data=b"PAIRS\n0 48.1 11.5\n"), Request()).coordinates.tolist()
    [[48.1, 11.5]]
    """

    name: str
    suffixes: tuple[str, ...]
    description: str
    sniff: Callable[[bytes], bool]
    read: Callable[[Source, Request], RawLog]
    read_batches: Callable[[Source, Request], LogBatches | None] | None = None
    write: Callable[[Iterable[TrackRows], BinaryIO], None] | None = None
    describe_losses: Callable[[Sequence[str], Sequence[str]], list[str]] | None = None
    time_decimals: int | None = None
    is_binary: bool = False
    is_fallback: bool = False
    extra: str = ""
    takes: tuple[str, ...] = ()
    heights: bool = False
