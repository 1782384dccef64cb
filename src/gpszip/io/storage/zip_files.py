"""Logs in zip archives, read one by one.

Names of members serve as names only; no file with such a name is written.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.storage.display_name import printable_name
from gpszip.io.storage.expansion import ExpansionMeter

__all__ = ["ExpansionLimit", "ZipMember", "find_members", "is_hidden", "is_zip", "reading_rank"]

#: First bytes of an archive with members, and of an empty one.
_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")

#: Compression methods that are read: none, and that of gzip. Others may need any amount of memory.
_READABLE_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)

#: Document formats that are zip archives, by a member of each.
_DOCUMENTS = {
    "xl/workbook.xml": "an Excel workbook; save the worksheet with the log as CSV",
    "META-INF/manifest.xml": "an OpenDocument file; save the worksheet with the log as CSV",
    "word/document.xml": "a Word document; save the table with the log as CSV",
}

#: Suffix of the files of a KMZ archive that hold places; its others are what these show.
_KML_SUFFIX = ".kml"

#: Suffixes of pictures and models, which come with the places of a KMZ archive.
_SHOWN_SUFFIXES = (".png", ".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".svg", ".dae")

#: Names of files that are read before all others, in lower case. In exports of Google, they hold
#: what devices measured, and the others what was made of it.
_FIRST_NAMES = ("records.json", "timeline edits.json")

#: Suffix of zip archives.
_ZIP_SUFFIX = ".zip"

#: Flag of an encrypted member.
_ENCRYPTED = 1

#: Bytes that are unpacked at a time: 1 MiB.
_CHUNK_BYTES = 1 << 20

#: Errors that :mod:`zipfile` raises for damaged archives.
_DAMAGE_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    ValueError,
    NotImplementedError,
    RuntimeError,
    LookupError,
)


@dataclass(frozen=True)
class ZipMember:
    """A file in an archive.

    Parameters
    ----------
    name : str
        Name in the archive.
    stored_bytes : int
        Compressed size in bytes.
    chunks : callable
        Yields its bytes while the archive is open. Raises an InputError if the member is damaged
        or expands beyond the limit.
    limit : ExpansionLimit
        The limit of the archive, against which the members of this one count, too, if it is an
        archive itself.
    """

    name: str
    stored_bytes: int
    chunks: Callable[[], Iterator[bytes]]
    limit: ExpansionLimit


class ExpansionLimit:
    """The limit on the expansion of an archive, and of those that it is in.

    Parameters
    ----------
    meter : ExpansionMeter
        Of the archive.
    file : _CountingFile
        The archive.
    outer : ExpansionLimit, optional
        Limit of the archive that it is in.
    """

    def __init__(
        self, meter: ExpansionMeter, file: _CountingFile, outer: ExpansionLimit | None
    ) -> None:
        self._meter, self._file, self._outer = meter, file, outer

    @property
    def refused(self) -> bool:
        """Whether a limit was exceeded."""
        return self._meter.refused or (self._outer is not None and self._outer.refused)

    def count(self, unpacked: int) -> None:
        """Count unpacked bytes.

        Raises
        ------
        InputError
            If the expansion exceeds a limit.
        """
        self._meter.count(unpacked, self._file.bytes_read)
        if self._outer is not None:
            self._outer.count(unpacked)


def reading_rank(path: str | Path) -> int:
    """Return the rank of a file: those of lower ranks are read first.

    A zip archive has the lowest rank of its members, since an export may come in several of them.

    Examples
    --------
    >>> sorted(["a.gpx", "b/Timeline Edits.json", "c/Records.json"], key=reading_rank)
    ['c/Records.json', 'b/Timeline Edits.json', 'a.gpx']
    """
    try:
        archive_path = Path(path).expanduser()
        # Opening a pipe would wait for who writes to it.
        if archive_path.suffix.lower() != _ZIP_SUFFIX or not archive_path.is_file():
            return _rank(str(path))
        with zipfile.ZipFile(archive_path) as archive:
            return min(map(_rank, archive.namelist()), default=len(_FIRST_NAMES))
    except _DAMAGE_ERRORS:
        return len(_FIRST_NAMES)  # reading it reports the damage


def _rank(name: str) -> int:
    """Return the rank of a file by its name alone."""
    base = name.replace("\\", "/").rsplit("/", 1)[-1].lower()
    return _FIRST_NAMES.index(base) if base in _FIRST_NAMES else len(_FIRST_NAMES)


def is_zip(head: bytes) -> bool:
    """Whether a file with these first bytes is a zip archive.

    Examples
    --------
    >>> is_zip(bytes([80, 75, 3, 4])), is_zip(b"t,x,y")
    (True, False)
    """
    return head[:4] in _MAGIC


def find_members(
    file: BinaryIO, name: str, outer: ExpansionLimit | None = None
) -> Iterator[ZipMember | InputError]:
    r"""Find the files in an archive.

    Folders, hidden files and the files that macOS adds are ignored, and beside a KML file the
    pictures and models that it shows.

    Parameters
    ----------
    file : binary file
        The archive; it must stay open while members are read.
    name : str
        Name of the archive for messages.
    outer : ExpansionLimit, optional
        Limit of the archive that it is in.

    Yields
    ------
    ZipMember or InputError
        Members in the order of the archive, but files of Google with what devices measured first;
        an error for a member that can't be read, or for the archive.

    Examples
    --------
    >>> with zipfile.ZipFile(file := io.BytesIO(), "w") as archive:
    ...     archive.writestr("walks/a.csv", "t,x,y\n0,0,0\n")
    >>> [(member.name, b"".join(member.chunks())) for member in find_members(file, "walks.zip")]
    [('walks/a.csv', b't,x,y\n0,0,0\n')]
    """
    counted = _CountingFile(file)
    try:
        with zipfile.ZipFile(counted) as archive:
            yield from _files_in(archive, counted, name, outer)
    except _DAMAGE_ERRORS as error:
        yield InputError(
            f"damaged zip archive ({str(error)[:120]})", path=name, remedy="fetch it again"
        )


def _files_in(
    archive: zipfile.ZipFile, counted: _CountingFile, name: str, outer: ExpansionLimit | None
) -> Iterator[ZipMember | InputError]:
    """Find the files in an open archive, see :func:`find_members`."""
    # Leave out folders and hidden files, such as those that macOS adds, and pictures of KMZ.
    infos = archive.infolist()
    files = [info for info in infos if not info.is_dir() and not is_hidden(info.filename)]
    if any(info.filename.lower().endswith(_KML_SUFFIX) for info in files):
        files = [info for info in files if not info.filename.lower().endswith(_SHOWN_SUFFIXES)]

    # Refuse members that share bytes: they let a small file expand without limit.
    if sum(info.compress_size for info in infos) > counted.size:
        yield InputError(
            "damaged zip archive: its members overlap, or it is cut short",
            path=name,
            remedy="fetch it again",
        )
        return

    # Refuse documents and empty archives.
    for member, description in _DOCUMENTS.items():
        if member in archive.NameToInfo:
            yield UnknownFormatError(f"is {description}", path=name)
            return
    if not files:
        yield UnknownFormatError(
            "no file in this zip archive", path=name, remedy="name one that holds a log"
        )

    # All members count against one limit, whose error ends the archive.
    meter = ExpansionMeter(name, "unpack it yourself, and name the files")
    limit = ExpansionLimit(meter, counted, outer)
    for info in sorted(files, key=lambda info: _rank(info.filename)):
        if limit.refused:
            return
        yield _read_member(archive, info, limit, f"{name}/{printable_name(info.filename)}")


def _read_member(
    archive: zipfile.ZipFile, info: zipfile.ZipInfo, limit: ExpansionLimit, where: str
) -> ZipMember | InputError:
    """A member that can be read, or the reason why it can't."""
    # Refuse what can't be unpacked: encrypted members and rare methods.
    if info.flag_bits & _ENCRYPTED:
        return InputError("is encrypted", path=where, remedy="unpack it first")
    if info.compress_type not in _READABLE_METHODS:
        return InputError(
            f"is packed by method {info.compress_type} of zip, which isn't read",
            path=where,
            remedy="unpack it first",
        )

    # Bytes are unpacked only when the member is read.
    def read_chunks() -> Iterator[bytes]:
        try:
            with archive.open(info) as stream:
                while chunk := stream.read(_CHUNK_BYTES):
                    limit.count(len(chunk))
                    yield chunk
        except _DAMAGE_ERRORS as error:
            raise InputError(
                f"damaged in its zip archive ({str(error)[:120]})",
                path=where,
                remedy="fetch it again",
            ) from None

    return ZipMember(info.filename, info.compress_size, read_chunks, limit)


def is_hidden(name: str) -> bool:
    """Whether a file or one of its folders is hidden, or was added by macOS.

    Examples
    --------
    >>> is_hidden("a/.git/b.csv"), is_hidden("__MACOSX/a.csv"), is_hidden("a/b.csv")
    (True, True, False)
    """
    # Some programs write backslashes between folders.
    names = name.replace("\\", "/").split("/")
    has_dot = any(n.startswith(".") and n not in (".", "..") for n in names)
    return "__MACOSX" in names or has_dot


class _CountingFile(io.RawIOBase):
    """A file that counts the bytes read from it."""

    def __init__(self, file: Any) -> None:
        self._file = file
        self.bytes_read = 0
        # The position after the seek is the size; zipfile seeks to where it reads.
        self.size = file.seek(0, io.SEEK_END)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        return int(self._file.seek(offset, whence))

    def tell(self) -> int:
        return int(self._file.tell())

    def readinto(self, buffer: Any) -> int:
        count = int(self._file.readinto(buffer))
        self.bytes_read += count
        return count
