"""Whether an archive is whole, and what it is made of."""

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
    """A section that was found whole.

    Parameters
    ----------
    kind : str
        What it holds.
    offset, size : int
        Where it begins in the file, and its bytes with all framing.
    """

    kind: str
    offset: int
    size: int


@dataclass(frozen=True)
class Verdict:
    """What :func:`verify` found.

    Parameters
    ----------
    size : int
        Bytes of the file.
    version : int or None
        Version of the format; None for a file that is no archive.
    form : str
        ``compact`` and ``small`` archives have one checksum, ``large`` ones have one for each section.
    sections : tuple of SectionReport
        The whole sections.
    tracks, groups : int
        How many there are; 0 where there is a problem.
    problem : str or None
        The first thing that is wrong; None for a whole archive.
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
    """Check all checksums, lengths and counts of an archive; the walks themselves are not decoded.

    Raises
    ------
    InputError
        If the file can't be read. A file that is no whole archive is no error here, but a verdict.
    """
    return verify_bytes(read_file(path))


def verify_bytes(data: bytes) -> Verdict:
    """Check the bytes of an archive, see :func:`verify`.

    Examples
    --------
    >>> verify_bytes(b"walk").problem
    'not a .gpsz archive: it does not begin like one (at byte 0)'
    """
    try:
        head = read_head(data)
    except CorruptArchiveError as error:
        return Verdict(len(data), None, "unknown", (), 0, 0, str(error), error.offset)
    form = _form(head)
    try:
        contents = from_bytes(data)
    except CorruptArchiveError as error:
        left = _reports(find_intact_sections(data)) if form == "large" else ()
        return Verdict(len(data), head.version, form, left, 0, 0, str(error), error.offset)
    parts = (
        _reports(read_sections(data, head))
        if form != "compact"
        else (SectionReport("archive", 0, len(data)),)
    )
    return Verdict(len(data), head.version, form, parts, contents.tracks, len(contents.groups))


def _form(head: Head) -> str:
    if head.form is not Form.SECTIONS:
        return "compact"
    return "small" if head.low else "large"


def _reports(found: Iterable[StoredSection]) -> tuple[SectionReport, ...]:
    return tuple(SectionReport(_name(piece.kind), piece.offset, piece.size) for piece in found)


def _name(kind: int) -> str:
    return (
        SectionKind(kind).name.lower().replace("_", " ")
        if kind in set(SectionKind)
        else f"kind {kind}"
    )
