"""Zip archives: the logs in them, read one by one. Names in an archive are names only; nothing is written under them."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

from gpszip.errors import InputError
from gpszip.io.storage.display_name import printable_name
from gpszip.io.storage.expansion import ExpansionMeter

__all__ = ["ZipMember", "find_members", "is_zip"]

#: Of an archive with members, and of one without.
_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")

#: How members are packed that are read: not at all, or as in gzip. Others may ask for any amount of memory.
_READABLE_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)

#: Documents that are zip archives by themselves, by a member of each.
_DOCUMENTS = {
    "xl/workbook.xml": "an Excel workbook; save the sheet with the log as CSV",
    "META-INF/manifest.xml": "an OpenDocument file; save the sheet with the log as CSV",
    "doc.kml": "a KMZ file; convert it to GPX",
}

#: Flag of a member that is encrypted.
_ENCRYPTED = 1

_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class ZipMember:
    """A file in an archive.

    Parameters
    ----------
    name : str
        As the archive has it.
    stored_bytes : int
        Bytes that it takes in the archive.
    chunks : callable
        Yields its bytes, while the archive is open; raises an InputError if it is damaged or expands too far.
    """

    name: str
    stored_bytes: int
    chunks: Callable[[], Iterator[bytes]]


def is_zip(head: bytes) -> bool:
    """Whether a file that starts like this is a zip archive.

    Examples
    --------
    >>> is_zip(bytes([80, 75, 3, 4])), is_zip(b"t,x,y")
    (True, False)
    """
    return head[:4] in _MAGIC


def find_members(file: BinaryIO, name: str) -> Iterator[ZipMember | InputError]:
    r"""Find the files in an archive.

    Folders, hidden files and what macOS adds are passed over.

    Parameters
    ----------
    file : binary file
        The archive; it stays open as long as members are read.
    name : str
        Its name for messages.

    Yields
    ------
    Member or InputError
        In the order of the archive; the error for a member that can't be read, or for the archive.

    Examples
    --------
    >>> with zipfile.ZipFile(file := io.BytesIO(), "w") as archive:
    ...     archive.writestr("walks/a.csv", "t,x,y\n0,0,0\n")
    >>> [(one.name, b"".join(one.chunks())) for one in find_members(file, "walks.zip")]
    [('walks/a.csv', b't,x,y\n0,0,0\n')]
    """
    counted = _CountingFile(file)
    try:
        with zipfile.ZipFile(counted) as archive:
            yield from _files_in(archive, counted, name)
    except _DAMAGE_ERRORS as error:
        yield InputError(f"{name}: damaged zip archive ({str(error)[:120]}); fetch it again")


#: What the module for zip archives raises where they are damaged.
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


def _files_in(
    archive: zipfile.ZipFile, counted: _CountingFile, name: str
) -> Iterator[ZipMember | InputError]:
    infos = archive.infolist()
    files = [info for info in infos if not info.is_dir() and not _is_hidden(info.filename)]

    # refuse an archive whose members share bytes, which makes a small file expand without end
    if sum(info.compress_size for info in infos) > counted.size:
        yield InputError(
            f"{name}: damaged zip archive: its members overlap, or it is cut short; fetch it again"
        )
        return
    if what := next(
        (what for part, what in _DOCUMENTS.items() if part in archive.NameToInfo), None
    ):
        yield InputError(f"{name}: is {what}")
        return
    if not files:
        yield InputError(f"{name}: no file in this zip archive; name one that holds a log")

    meter = ExpansionMeter(name, "unpack it yourself, and name the files")
    for info in files:
        if meter.refused:
            return  # whoever reads it has been told
        yield _read_member(archive, info, counted, meter, f"{name}/{printable_name(info.filename)}")


def _read_member(
    archive: zipfile.ZipFile,
    info: zipfile.ZipInfo,
    counted: _CountingFile,
    meter: ExpansionMeter,
    where: str,
) -> ZipMember | InputError:
    if info.flag_bits & _ENCRYPTED:
        return InputError(f"{where}: is encrypted; unpack it first")
    if info.compress_type not in _READABLE_METHODS:
        return InputError(
            f"{where}: is packed by method {info.compress_type} of zip, which isn't read; unpack it first"
        )

    def pieces() -> Iterator[bytes]:
        try:
            with archive.open(info) as stream:
                while piece := stream.read(_CHUNK_BYTES):
                    meter.count(len(piece), counted.read_in_all)
                    yield piece
        except _DAMAGE_ERRORS as error:
            raise InputError(
                f"{where}: damaged in its zip archive ({str(error)[:120]}); fetch it again"
            ) from None

    return ZipMember(info.filename, info.compress_size, pieces)


def _is_hidden(name: str) -> bool:
    parts = name.replace("\\", "/").split("/")
    return parts[0] == "__MACOSX" or any(
        part.startswith(".") and part not in (".", "..") for part in parts
    )


class _CountingFile(io.RawIOBase):
    """A file that counts the bytes that are read from it."""

    def __init__(self, file: Any) -> None:
        self._file, self.read_in_all = file, 0
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
        self.read_in_all += count
        return count
