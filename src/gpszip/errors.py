"""Every error that GPSZip raises on purpose.

    GPSZipError
    ├── InputError                a file, a column or a value that can't be used
    │   ├── UnknownFormatError    no reader knows the file
    │   ├── NoPositionsError      a file of a known format without any position
    │   └── TrackError            times or positions that are no track
    ├── OptionError               options that contradict each other or the data
    │   └── UnknownTrackError     the archive has no track of this name
    ├── BoundError                the error bound asked for can't be met
    ├── CorruptArchiveError       bytes that are not a complete archive
    ├── MapError                  the map of an archive is missing, or another map was given
    ├── OutputError               the output exists or can't be written
    ├── WorkerError               a process or machine that did some of the work is gone
    └── MissingExtraError         an optional dependency is not installed

:class:`LossWarning` is a warning, not an error.

A message says where, what is wrong, and how to fix it: ``path: location: reason; remedy``. The same
four are attributes of the error, so that no caller has to take a message apart.
"""

from __future__ import annotations

import os
from typing import Self

__all__ = [
    "BoundError",
    "CorruptArchiveError",
    "GPSZipError",
    "InputError",
    "LossWarning",
    "MapError",
    "MissingExtraError",
    "NoPositionsError",
    "OptionError",
    "OutputError",
    "TrackError",
    "UnknownFormatError",
    "UnknownTrackError",
    "WorkerError",
]


class GPSZipError(Exception):
    """Root of all errors of GPSZip.

    Parameters
    ----------
    reason : str
        What is wrong. An error that is given nothing else has this as its message.
    path : str or path, optional
        File that the error is about.
    location : str, optional
        Where in the file or the data, such as ``"point 1203"``, ``"line 7"`` or ``"track 'bus'"``.
    remedy : str, optional
        What the user can do.

    Examples
    --------
    >>> error = GPSZipError("time goes back 14 s", path="walk.gpx", location="point 1203")
    >>> str(error)
    'walk.gpx: point 1203: time goes back 14 s'
    >>> error.path, error.location, error.remedy
    ('walk.gpx', 'point 1203', None)
    """

    path: str | None
    location: str | None
    reason: str
    remedy: str | None

    def __init__(
        self,
        reason: str = "",
        *,
        path: str | os.PathLike[str] | None = None,
        location: str | None = None,
        remedy: str | None = None,
    ) -> None:
        # The fields are set before the message, which is made of them.
        self.path = None if path is None else os.fspath(path)
        self.location = location
        self.reason = reason
        self.remedy = remedy
        super().__init__(self.detail if self.path is None else f"{self.path}: {self.detail}")

    @property
    def detail(self) -> str:
        """The message without the path: ``location: reason; remedy``."""
        where = "" if self.location is None else f"{self.location}: "
        return f"{where}{self.advice}"

    @property
    def advice(self) -> str:
        """The message without path and location: ``reason; remedy``."""
        return self.reason if self.remedy is None else f"{self.reason}; {self.remedy}"

    def with_path(self, path: str | os.PathLike[str]) -> Self:
        """Return the same error about a file, for callers that know which file it was.

        Examples
        --------
        >>> str(InputError("no samples", location="track 'bus'").with_path("log.csv"))
        "log.csv: track 'bus': no samples"
        """
        # Not copy.copy: libraries that pickle exceptions let the copy share its fields.
        located = type(self).__new__(type(self))
        located.__dict__.update(self.__dict__)
        located.path = os.fspath(path)
        # args[0] is the text that str() shows; others are those of the subclass.
        located.args = (f"{located.path}: {located.detail}", *self.args[1:])
        return located

    def located_at(self, path: str) -> Self:
        """Return the error about a file, unless it is about a file already.

        Examples
        --------
        >>> error = InputError("no samples").located_at("log.csv")
        >>> str(error), error is error.located_at("other.csv")
        ('log.csv: no samples', True)
        """
        return self if self.path is not None else self.with_path(path)


class InputError(GPSZipError):
    """A file, a column or a value that can't be used."""


class UnknownFormatError(InputError):
    """No reader recognises the file."""


class NoPositionsError(InputError):
    """The file is of a known format, but holds no position, as that of a workout indoors."""


class TrackError(InputError):
    """Times or positions that don't make a track."""


# A ValueError as well, as Python's own functions raise for such arguments.
class OptionError(GPSZipError, ValueError):
    """Options that contradict each other or the data."""


class UnknownTrackError(OptionError, KeyError):
    """The archive has no track of this name."""

    def __str__(self) -> str:
        # KeyError shows the repr of its message.
        return str(self.args[0])


class BoundError(GPSZipError):
    """The error bound that was asked for can't be met."""


class CorruptArchiveError(GPSZipError):
    """Bytes that are not a complete, valid archive.

    Parameters
    ----------
    reason : str
        What is wrong.
    offset : int, optional
        Byte at which it was found, counted from the start of the archive.
    path : str or path, optional
        File of the archive.
    remedy : str, optional
        What the user can do.

    Examples
    --------
    >>> error = CorruptArchiveError("the checksum is wrong", 71, remedy="fetch it again")
    >>> str(error), error.offset
    ('the checksum is wrong (at byte 71); fetch it again', 71)
    """

    def __init__(
        self,
        reason: str,
        offset: int | None = None,
        *,
        path: str | os.PathLike[str] | None = None,
        remedy: str | None = None,
    ) -> None:
        # The offset is a part of the reason, so that the message has it, too.
        place = "" if offset is None else f" (at byte {offset})"
        super().__init__(f"{reason}{place}", path=path, remedy=remedy)
        self.offset = offset


class MapError(GPSZipError):
    """The map that an archive was written with is missing, or another map was given."""


class LossWarning(UserWarning):
    """A track lost more than a tenth of its points, or all of them, while it was read."""


class OutputError(GPSZipError):
    """The output exists already or can't be written."""


class WorkerError(GPSZipError):
    """A process or machine that did some of the work is gone, and no other can take over."""


class MissingExtraError(GPSZipError, ImportError):
    """An optional dependency is not installed.

    Parameters
    ----------
    extra : str
        Name of the extra that brings it: ``pip install 'gpszip[extra]'``.
    purpose : str
        What it is needed for.
    """

    def __init__(self, extra: str, purpose: str) -> None:
        super().__init__(f"{purpose} needs the extra '{extra}': pip install 'gpszip[{extra}]'")
        self.extra = extra
        self.purpose = purpose

    # Pickle would call the class with the message, which is no extra. Errors are pickled where they
    # come from another process.
    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str]]:
        return type(self), (self.extra, self.purpose)
