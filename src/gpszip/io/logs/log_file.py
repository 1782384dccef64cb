"""One file of a log: its format and coordinates, and its rows in batches.

:func:`open_log_files` looks at the start of each file; :meth:`LogFile.batches` then reads its rows.
A log that fits in memory is one batch. Whether a larger file can be read in batches is for its
format to say (``read_batches`` of :class:`gpszip.io.logs.log_format.LogFormat`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, TypeAlias

import pyarrow as pa

from gpszip.errors import InputError, OptionError
from gpszip.io.frames.source import FRAME_FORMAT, FrameSource
from gpszip.io.logs.formats import is_bundle, log_formats
from gpszip.io.logs.log_format import SPECIAL_OPTIONS, CoordinateKind, LogBatches, LogFormat
from gpszip.io.logs.mixed_files import ReadFiles, choose_format, may_be_log
from gpszip.io.logs.plausibility import check_plausible
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.storage.source import Source, expand, is_stray_file

__all__ = ["LogFile", "Sources", "mismatch_error", "open_log_files", "refuse_mismatches"]

#: Letters of an error message of Arrow that are shown.
_MAX_REASON_LETTERS = 120

#: What names logs: a file, a pattern, a stream, or several of them.
Sources: TypeAlias = "str | Path | BinaryIO | Iterable[str | Path | BinaryIO | Source | InputError]"


@dataclass(frozen=True, eq=False)
class LogFile:
    """One file of a log: what its start says, before its rows are read.

    Parameters
    ----------
    source : Source or InputError
        The file; an error if there is none.
    request : Request
        Columns and unit of time.
    format : LogFormat, optional
        Its format; None if the file can't be read.
    opened : LogBatches, optional
        The file as its format opens it; None if it is read at once.
    error : InputError, optional
        Why the file can't be read, if that shows at its start.
    skipped : str
        Why it is left out although it can be read; empty if it is read.
    """

    source: Source | InputError
    request: Request
    format: LogFormat | None = None
    opened: LogBatches | None = None
    error: InputError | None = None
    skipped: str = ""

    @property
    def collection(self) -> str:
        """Name of the folder or archive of mixed files that contains it; empty if none does."""
        return self.source.collection if isinstance(self.source, Source) else ""

    @property
    def name(self) -> str:
        """Name of the file in messages."""
        return self.source.name if isinstance(self.source, Source) else "log"

    @property
    def log(self) -> str:
        """Name of the log that the file belongs to."""
        return self.source.log if isinstance(self.source, Source) else str(self.source)

    @property
    def coordinate_kind(self) -> CoordinateKind | None:
        """What its coordinates are; None if that shows only when its rows are read."""
        return None if self.opened is None else self.opened.coordinate_kind

    @property
    def may_be_left_out(self) -> bool:
        """Whether the other files are read if this one can't be.

        One file in an export of thousands must not cost the others.
        """
        return self.request.skip_bad or bool(self.collection)

    def is_stray(self, error: InputError) -> bool:
        """Whether an error only means that a folder or archive contains a file that is no log."""
        return is_stray_file(self.source, error)

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
            If the file is damaged or can't be read.
        """
        # An error that showed at the start of the file is raised when its rows are asked for, where
        # the caller decides for all errors whether the file may be left out.
        if self.error is not None:
            raise self.error
        if self.opened is not None:
            yield from self.opened.batches
            return
        assert isinstance(self.source, Source)
        assert self.format is not None
        yield check_plausible(self.format.read(self.source, self.request), self.request)


def open_log_files(
    sources: Sources, format_: str | None, request: Request, *, in_batches: bool
) -> Iterator[LogFile]:
    r"""Find the format and the columns of each file from its start.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these
        As for :func:`gpszip.io.logs.read.read_logs`.
    format_ : str, optional
        Format of all files; found from their content if left out.
    request : Request
        Columns and unit of time.
    in_batches : bool
        Read files in batches if their formats can, rather than each at once.

    Yields
    ------
    LogFile
        Also for a file that can't be read, with its error.

    Examples
    --------
    >>> from gpszip.io.storage.source import Source
    >>> source = Source("walk.csv", data=b"t,lat,lon\n0,48,11\n")
    >>> [file] = open_log_files([source], None, Request(), in_batches=True)
    >>> file.coordinate_kind
    CoordinateKind(geographic=True, dimension=2, crs='')
    """
    before = ReadFiles()
    for source in expand(sources, unzip=is_bundle, wanted=may_be_log):
        if isinstance(source, InputError):
            yield LogFile(source, request, error=source)
        else:
            yield _open_log_file(source, format_, request, in_batches, before)


def _open_log_file(
    source: Source, format_: str | None, request: Request, in_batches: bool, before: ReadFiles
) -> LogFile:
    # An error is kept with its file. Raised here, it would end the generator, and with it the files
    # after this one.
    try:
        chosen = _choose_format(source, format_)
        if skipped := before.why_not(source, chosen):
            error = InputError(f"one {skipped}", path=source.name)
            return LogFile(source, request, error=error, skipped=skipped)
        refuse_unknown_options(chosen, request, source.name)
        opened = None
        if in_batches and chosen.read_batches is not None:
            opened = chosen.read_batches(source, request)
        return LogFile(source, request, chosen, opened)
    except InputError as error:
        return LogFile(source, request, error=error)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0][:_MAX_REASON_LETTERS]
        return LogFile(
            source, request, error=InputError(f"can't be read: {reason}", path=source.name)
        )


def refuse_unknown_options(format_: LogFormat, request: Request, where: str) -> None:
    """Refuse options that the format of a file doesn't know, rather than pass over them.

    Raises
    ------
    OptionError
        If the request has a field of :data:`SPECIAL_OPTIONS` that isn't among ``takes``.
    """
    for field, option in SPECIAL_OPTIONS.items():
        if not getattr(request, field) or field in format_.takes:
            continue
        knowing = [other.name for other in log_formats() if field in other.takes]
        raise OptionError(
            f"{option} is not for {format_.name}",
            path=where,
            remedy=f"leave it out; it is for {' and '.join(knowing)}",
        )


def _choose_format(source: Source, format_: str | None) -> LogFormat:
    """Return the format that the user states, or that the content of a file has."""
    if isinstance(source, FrameSource):
        return FRAME_FORMAT
    return choose_format(source, format_)


def refuse_mismatches(files: Iterable[LogFile]) -> list[LogFile]:
    """Check that files fit together by what their starts say, before any row is read.

    Returns
    -------
    list of LogFile
        All files; those that don't fit the files before them, and may be left out, have an error.

    Raises
    ------
    InputError
        If a file can't be read or doesn't fit, and may not be left out.
    """
    checked: list[LogFile] = []
    for file in files:
        error = file.error or _find_mismatch(file, checked)
        if error is not None and not file.may_be_left_out:
            raise error
        checked.append(replace(file, error=error))
    return checked


def _find_mismatch(file: LogFile, before: Sequence[LogFile]) -> InputError | None:
    """Return what is wrong if a file has other coordinates than the files before it."""
    # Compare with the first file whose coordinates are known; unknown ones fit any.
    kind = file.coordinate_kind
    known = (other for other in before if not other.error and other.coordinate_kind is not None)
    first = next(known, None)
    first_kind = None if first is None else first.coordinate_kind
    if kind is None or first is None or first_kind is None or kind == first_kind:
        return None

    # Say what differs: the names of the coordinate systems, or the columns.
    if kind._replace(crs=first_kind.crs) == first_kind:
        return InputError(
            f"names another coordinate system than {first.name}",
            path=file.name,
            remedy="bring them to one, or read them apart",
        )
    return mismatch_error(file.name, kind, first.name, first_kind)


def mismatch_error(
    name: str, kind: CoordinateKind, first_name: str, first_kind: CoordinateKind
) -> InputError:
    """Return the error for a file whose coordinates are not those of the first one."""
    return InputError(
        f"holds {coordinate_names(kind)}, but {first_name} {coordinate_names(first_kind)}",
        path=name,
        remedy="read them apart",
    )


def coordinate_names(kind: CoordinateKind) -> str:
    """Return what messages call coordinates.

    Examples
    --------
    >>> coordinate_names(CoordinateKind(geographic=False, dimension=2))
    'x,y'
    """
    if kind.geographic:
        return "lat,lon"
    names = [*"xyz", *(f"x{axis}" for axis in range(4, kind.dimension + 1))]
    return ",".join(names[: kind.dimension])
