"""Whether an archive is intact, and which sections it has."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass

from gpszip.container.layout import Form, Head, SectionKind, read_head
from gpszip.container.reader import StoredSection, from_bytes, read_file, read_sections
from gpszip.container.recover import find_intact_sections
from gpszip.errors import CorruptArchiveError

__all__ = ["SectionReport", "Verdict", "verify", "verify_bytes"]


@dataclass(frozen=True)
class SectionReport:
    """A section that is intact.

    Parameters
    ----------
    kind : str
        What it holds.
    offset, size : int
        First byte in the file, and number of bytes with marker, kind, length and checksum.
    """

    kind: str
    offset: int
    size: int


@dataclass(frozen=True)
class Verdict:
    """Result of :func:`verify`.

    Parameters
    ----------
    size : int
        Bytes of the file.
    version : int or None
        Version of the format; None for a file that is no archive.
    form : str
        ``compact`` and ``small`` archives have one checksum, ``large`` ones have one for each
        section.
    sections : tuple of SectionReport
        The intact sections.
    tracks, groups : int
        Numbers of tracks and groups; 0 where there is a problem.
    problem : str or None
        The first thing that is wrong; None for an intact archive.
    offset : int or None
        Byte at which it was noticed.
    """

    size: int
    version: int | None
    form: str
    sections: tuple[SectionReport, ...]
    tracks: int
    groups: int
    problem: str | None = None
    offset: int | None = None

    @property
    def ok(self) -> bool:
        """Whether every byte is as it was written."""
        return self.problem is None


def verify(path: str | os.PathLike[str]) -> Verdict:
    """Check all checksums, lengths and counts of an archive; the walks are not decoded.

    Raises
    ------
    InputError
        If the file can't be read. A damaged archive is no error here, but a verdict.
    """
    return verify_bytes(read_file(path))


def verify_bytes(data: bytes) -> Verdict:
    """Check the bytes of an archive, see :func:`verify`.

    Examples
    --------
    >>> verify_bytes(b"walk").problem
    'not a .gpsz archive: it does not begin like one (at byte 0)'
    """
    # Is it an archive?
    try:
        head = read_head(data)
    except CorruptArchiveError as error:
        return Verdict(len(data), None, "unknown", (), 0, 0, str(error), error.offset)
    form = _form_name(head)

    # Is it intact? of a damaged one, the intact sections are listed.
    sections: tuple[SectionReport, ...] = ()
    try:
        contents = from_bytes(data)
    except CorruptArchiveError as error:
        if form == "large":
            sections = _reports(find_intact_sections(data))
        return Verdict(len(data), head.version, form, sections, 0, 0, str(error), error.offset)
    # A compact archive has no sections, so that it is reported as one.
    if form == "compact":
        sections = (SectionReport("archive", 0, len(data)),)
    else:
        sections = _reports(read_sections(data, head))
    return Verdict(len(data), head.version, form, sections, contents.tracks, len(contents.groups))


def _form_name(head: Head) -> str:
    """Name of an archive's form."""
    if head.form is not Form.SECTIONS:
        return "compact"
    return "small" if head.low else "large"


def _reports(sections: Iterable[StoredSection]) -> tuple[SectionReport, ...]:
    """Reports of sections."""
    return tuple(
        SectionReport(_kind_name(section.kind), section.offset, section.size)
        for section in sections
    )


def _kind_name(kind: int) -> str:
    """Name of a section's kind; its number if a later version has added it."""
    if kind in set(SectionKind):
        return SectionKind(kind).name.lower().replace("_", " ")
    return f"kind {kind}"
