"""Folders and zip archives of mixed files, such as exports of Strava, Garmin and Google.

Which of their files are logs, and which of several files with the same positions is read. Files
that users name themselves are always read.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import PurePosixPath

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.logs.formats import (
    GOOGLE,
    GOOGLE_PATHS,
    format_for_reading,
    format_named,
    log_formats,
)
from gpszip.io.logs.google.entries import RAW_LISTS
from gpszip.io.logs.log_format import LogFormat
from gpszip.io.logs.sniff.json import history_list
from gpszip.io.storage.source import Source

__all__ = ["ReadFiles", "choose_format", "may_be_log"]

#: What messages call the files that are left out because another file has their positions.
_REPEATED = "with the same bytes as another one"
_SAME_HISTORY = "of the same history as {name} (--format google-paths reads its paths)"
_NO_PATHS = "of positions instead of paths"

#: Name of a part of an archive of Takeout: the time of the export, and numbers.
_PART = re.compile(r"(takeout-\d{8}T\d{6}Z)(?:-\d+)*\.zip", re.IGNORECASE)

#: Lists of histories with what devices measured, in files without paths.
_MEASURED = ("locations", "timelineEdits")


def may_be_log(name: str, head: bytes) -> bool:
    """Whether a file may be a log, by its name and its first bytes.

    Examples
    --------
    >>> may_be_log("a.csv", b"t,x,y"), may_be_log("a.bin", b"<gpx>"), may_be_log("a.mp4", b"ftyp")
    (True, True, False)
    """
    # A file of a known name that nothing recognises may be read by a stated format.
    formats = log_formats()
    return _is_named_as_log(name, formats) or any(
        format_.sniff(head) for format_ in formats if not format_.is_fallback
    )


def choose_format(source: Source, name: str | None) -> LogFormat:
    """Return the format that the user states, or that the content of a file has.

    Raises
    ------
    UnknownFormatError
        If a file of a folder or archive is not of the stated format, or of none that is known.
    InputError
        If it can't be read.
    """
    if name is None:
        return format_for_reading(source)
    stated = format_named(name)
    if not source.collection or _is_of(stated, source):
        return stated
    raise UnknownFormatError(f"is not of the format {stated.name}", path=source.name)


def _is_of(stated: LogFormat, source: Source) -> bool:
    """Whether a file of a collection is of a format, as far as its name and its start show."""
    if _is_named_as_log(source.name, (stated,)):
        return True
    # Only a stated format reads the paths of a history.
    sniff = GOOGLE.sniff if stated is GOOGLE_PATHS else stated.sniff
    return not stated.is_fallback and sniff(source.head())


def _is_named_as_log(name: str, formats: tuple[LogFormat, ...]) -> bool:
    plain = name.lower().removesuffix(".gz")
    return any(format_.suffixes and plain.endswith(format_.suffixes) for format_ in formats)


@dataclass
class ReadFiles:
    """What the files of collections hold that were read so far.

    Parameters
    ----------
    digests : set of bytes
        Of these files.
    histories : dict
        The first file with a history of Google of each export: its list, and its name.
    """

    digests: set[bytes] = field(default_factory=set)
    histories: dict[str, tuple[str, str]] = field(default_factory=dict)

    def why_not(self, source: Source, format_: LogFormat) -> str:
        """Return why a file is left out because of those before it; empty if it is read.

        Raises
        ------
        InputError
            If it has what devices measured, and paths of the same history were read before.
        """
        # A folder is read by one file, which says little about the others.
        if not source.collection or source.folder is not None:
            return ""
        digest = source.digest()
        if digest in self.digests:
            return _REPEATED
        self.digests.add(digest)
        return self._why_not_history(source, format_)

    def _why_not_history(self, source: Source, format_: LogFormat) -> str:
        """Return why a history is left out: exports hold the same positions in several lists."""
        if format_ not in (GOOGLE, GOOGLE_PATHS):
            return ""
        # A list without entries says nothing of the others.
        found = history_list(source.head())
        if found is None:
            return ""
        if format_ is GOOGLE_PATHS and found in _MEASURED:
            return _NO_PATHS

        # The first list that is met is read.
        export = _export_of(source.collection)
        chosen, name = self.histories.setdefault(export, (found, source.name))
        if chosen == found:
            return ""
        first = PurePosixPath(name).name

        # Paths say less than what they were made of, so this is a loss.
        if format_ is GOOGLE and found in RAW_LISTS and chosen not in RAW_LISTS:
            raise InputError(
                f"has what devices measured, but comes after {first}, which has paths of the same "
                "history",
                path=source.name,
                remedy="name it alone, or before the other",
            )
        return _SAME_HISTORY.format(name=first)


def _export_of(collection: str) -> str:
    """Return the name of the export that a folder or archive is, or is a part of."""
    part = _PART.fullmatch(PurePosixPath(collection).name)
    return collection if part is None else part[1]
