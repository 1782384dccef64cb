"""Every error that GPSZip raises on purpose.

    GPSZipError
    ├── InputError                a file, a column or a value that can't be used
    │   ├── UnknownFormatError    no reader knows the file
    │   └── TrackError            times or positions that are no track
    ├── OptionError               options that contradict each other or the data
    ├── BoundError                the error bound asked for can't be met
    ├── CorruptArchiveError       bytes that are no whole archive
    ├── MapError                  the map an archive needs is missing or another one
    ├── OutputError               the output exists or can't be written
    ├── WorkerError               a process or machine that did some of the work is gone
    └── MissingExtraError         an optional dependency is not installed

:class:`LossWarning` is a warning, not an error.

A message says what is wrong, where, and how to mend it.
"""

from __future__ import annotations

__all__ = [
    "BoundError",
    "CorruptArchiveError",
    "GPSZipError",
    "InputError",
    "LossWarning",
    "MapError",
    "MissingExtraError",
    "OptionError",
    "OutputError",
    "TrackError",
    "UnknownFormatError",
    "WorkerError",
]


class GPSZipError(Exception):
    """Root of all errors of GPSZip."""


class InputError(GPSZipError):
    """A file, a column or a value that can't be used."""


class UnknownFormatError(InputError):
    """No reader recognises the file."""


class TrackError(InputError):
    """Times or positions that don't make a track."""


class OptionError(GPSZipError, ValueError):
    """Options that contradict each other or the data."""


class BoundError(GPSZipError):
    """The error bound that was asked for can't be met."""


class CorruptArchiveError(GPSZipError):
    """Bytes that are no whole, valid archive.

    Parameters
    ----------
    message : str
        What is wrong.
    offset : int, optional
        Byte at which it was noticed, counted from the start of the archive.
    """

    def __init__(self, message: str, offset: int | None = None) -> None:
        super().__init__(message if offset is None else f"{message} (at byte {offset})")
        self.offset = offset


class MapError(GPSZipError):
    """The map that an archive was written with is missing, or another one was given."""


class LossWarning(UserWarning):
    """A track lost more than a tenth of its points while it was read, or all of them."""


class OutputError(GPSZipError):
    """The output exists already or can't be written."""


class WorkerError(GPSZipError):
    """A process or machine that did some of the work is gone, and nobody can take over."""


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

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str]]:
        return type(self), (self.extra, str(self).split(" needs the extra ", 1)[0])
