"""The bytes that every part of an archive is made of: magic, form, whole numbers, sections and their checksums."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from enum import IntEnum

from gpszip.errors import CorruptArchiveError

__all__ = [
    "CHECKSUM_BYTES",
    "END_BYTES",
    "HEAD_BYTES",
    "MAGIC",
    "OLDEST_VERSION",
    "SECTION_MARKER",
    "SMALL_LIMIT",
    "VERSION",
    "Cursor",
    "Form",
    "Head",
    "SectionKind",
    "checksum",
    "encode_head",
    "encode_section",
    "encode_signed",
    "encode_varint",
    "max_sections",
    "max_tracks",
    "read_head",
]

#: First bytes of every archive. The first is no start of a character in UTF-8, so no text file begins like this.
MAGIC = b"\xa7Z"

#: Version of the format that this package writes, and the newest that it reads.
VERSION = 3

#: The oldest version that it reads: walks without the ends of their pieces.
OLDEST_VERSION = 2

#: Magic, then one byte of version and form.
HEAD_BYTES = 3

#: Bytes of a CRC-32.
CHECKSUM_BYTES = 4

#: What every section of a large archive begins with, so that a reader finds the next whole one in a torn file.
SECTION_MARKER = b"\xa7SEC"

#: Bytes of the end mark of a large archive: marker, kind, length, offset of the index, checksum of checksums, checksum.
END_BYTES = 20

#: Archives of sections that are shorter than this have one checksum among all of them.
SMALL_LIMIT = 1 << 16

_VARINT_BYTES = 10
_VARINT_LIMIT = 1 << 64


class Form(IntEnum):
    """How the rest of the archive is laid out."""

    LONE = 0  # one track named '0', one group, one checksum
    NAMED = 1  # any tracks, one group, one checksum
    ON_MAP = 2  # walks on a map kept elsewhere
    SECTIONS = 3  # sections of their own length and kind


class SectionKind(IntEnum):
    """What a section holds."""

    FRAME = 1
    NAMES = 2
    WALKS = 3
    MAP = 4
    ATTRIBUTES = 5
    INDEX = 6
    END = 7
    PROMISE = 8


@dataclass(frozen=True)
class Head:
    """The byte after the magic.

    Parameters
    ----------
    form : Form
        Layout of the rest.
    low, high : int
        Two bits and one bit whose meaning depends on the form.
    version : int, optional
        Version of the format, at most 7.
    """

    form: Form
    low: int = 0
    high: int = 0
    version: int = VERSION


def encode_head(head: Head) -> bytes:
    """Magic, version and form in three bytes."""
    return MAGIC + bytes([head.version | head.form << 3 | head.low << 5 | head.high << 7])


def read_head(data: bytes) -> Head:
    """Read the first three bytes of an archive.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no archive, or one of another version.

    Examples
    --------
    >>> read_head(encode_head(Head(Form.NAMED))).form.name
    'NAMED'
    """
    if not data:
        raise CorruptArchiveError("not a .gpsz archive: the file is empty", 0)
    if data[:2] != MAGIC[: len(data)]:
        if data[:6] == b"\xa7ROADS":
            raise CorruptArchiveError(
                "a road network that 'gpszip network' prepared, not an archive; it serves as --network",
                0,
            )
        raise CorruptArchiveError("not a .gpsz archive: it does not begin like one", 0)
    if len(data) < HEAD_BYTES:
        raise CorruptArchiveError("the archive ends within its head", len(data))
    byte = data[2]
    version = byte & 7
    if version > VERSION:
        raise CorruptArchiveError(
            f"archive of version {version}; this GPSZip reads up to version {VERSION}: upgrade gpszip",
            2,
        )
    if version < OLDEST_VERSION:
        raise CorruptArchiveError(
            f"archive of version {version}, which no release of GPSZip has written: compress the log again",
            2,
        )
    head = Head(Form(byte >> 3 & 3), byte >> 5 & 3, byte >> 7, version)
    if head.form is Form.SECTIONS and head.low > 1:
        raise CorruptArchiveError("no archive has this form", 2)
    return head


def encode_varint(value: int) -> bytes:
    """Whole number in groups of 7 bits, the lowest first, the top bit set on all but the last byte.

    Examples
    --------
    >>> encode_varint(300).hex()
    'ac02'
    """
    if not 0 <= value < _VARINT_LIMIT:
        raise ValueError(f"{value} does not fit 64 bits")
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def encode_signed(value: int) -> bytes:
    """Whole number of either sign: 0, -1, 1, -2, ... as the varints 0, 1, 2, 3, ..."""
    return encode_varint(2 * value if value >= 0 else -2 * value - 1)


def checksum(data: bytes | memoryview, start: int = 0) -> bytes:
    """CRC-32 (zlib's) in four bytes, the lowest first."""
    return zlib.crc32(data, start).to_bytes(CHECKSUM_BYTES, "little")


def encode_section(kind: int, body: bytes) -> bytes:
    """Section of a large archive: marker, kind, length, body, checksum of kind to body."""
    content = bytes([kind]) + encode_varint(len(body)) + body
    return SECTION_MARKER + content + checksum(content)


def max_tracks(size: int) -> int:
    """Most tracks that an archive of so many bytes can name."""
    return (1 << 16) + 8 * size


def max_sections(size: int) -> int:
    """Most sections before the end mark of a large archive of so many bytes."""
    return (1 << 12) + size // 1024


@dataclass
class Cursor:
    """A place in untrusted bytes that never moves past their end.

    Parameters
    ----------
    data : bytes
        What is read.
    offset : int, default 0
        Next byte.
    end : int, optional
        First byte that is not to be read; all of ``data`` where left out.
    base : int, default 0
        Where ``data`` lies in the archive, for the offset in errors.
    """

    data: bytes
    offset: int = 0
    end: int = field(default=-1)
    base: int = 0

    def __post_init__(self) -> None:
        if self.end < 0:
            self.end = len(self.data)

    @property
    def remaining(self) -> int:
        """Number of bytes before the end."""
        return self.end - self.offset

    def error(self, message: str) -> CorruptArchiveError:
        """Error that names this place."""
        return CorruptArchiveError(message, self.base + self.offset)

    def read_bytes(self, count: int, what: str) -> bytes:
        """Read the next ``count`` bytes."""
        if count > self.remaining:
            raise self.error(f"{what} takes {count} bytes, but {self.remaining} are left")
        self.offset += count
        return self.data[self.offset - count : self.offset]

    def read_byte(self, what: str) -> int:
        """Read one byte."""
        return self.read_bytes(1, what)[0]

    def read_varint(self, what: str) -> int:
        """Read a whole number; a longer form than needed is refused, so that equal contents have equal bytes."""
        value = 0
        for place in range(_VARINT_BYTES):
            byte = self.read_byte(what)
            value |= (byte & 127) << 7 * place
            if byte < 128:
                if (byte == 0 and place) or value >= _VARINT_LIMIT:
                    raise self.error(f"{what} is no number of 64 bits in its shortest form")
                return value
        raise self.error(f"{what} is longer than a number of 64 bits")

    def read_signed(self, what: str) -> int:
        """Read a whole number of either sign."""
        value = self.read_varint(what)
        return value >> 1 if value % 2 == 0 else -(value >> 1) - 1

    def read_rest(self) -> bytes:
        """Read all bytes that are left."""
        return self.read_bytes(self.remaining, "the rest")

    def expect_end(self, what: str) -> None:
        """Refuse bytes that nobody asked for."""
        if self.remaining:
            raise self.error(f"{self.remaining} bytes after the end of {what}")
