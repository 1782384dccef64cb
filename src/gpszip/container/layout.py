"""The building blocks of an archive: magic, form, integers, sections and their checksums."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from enum import IntEnum

from gpszip.errors import CorruptArchiveError

__all__ = [
    "CHECKSUM_BYTES",
    "CURVE_KINDS",
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

#: First bytes of every archive. No character of UTF-8 starts with the first, so no text file does.
MAGIC = b"\xa7Z"

#: Version of the format that this package writes, and the newest that it reads.
VERSION = 3

#: The oldest version that it reads: walks without the ends of their pieces.
OLDEST_VERSION = 2

#: Magic, then one byte of version and form.
HEAD_BYTES = 3

#: Bytes of a CRC-32.
CHECKSUM_BYTES = 4

#: First bytes of every section of a large archive, by which the intact ones of a damaged file are
#: found.
SECTION_MARKER = b"\xa7SEC"

#: Bytes of the end mark of a large archive: marker, kind, length, offset of the index, checksum of
#: checksums, checksum.
END_BYTES = 20

#: An archive of sections with fewer bytes than this has one checksum for all of them.
SMALL_LIMIT = 1 << 16

#: Integers are below this, and take at most so many bytes.
_VARINT_LIMIT = 1 << 64
_VARINT_BYTES = 10

#: First bytes of a road network that ``gpszip network`` wrote.
_NETWORK_MAGIC = b"\xa7ROADS"

#: An archive names at most this many tracks, and so many more for each byte.
_FREE_TRACKS = 1 << 16
_TRACKS_PER_BYTE = 8

#: An archive has at most this many sections, and one more for so many bytes.
_FREE_SECTIONS = 1 << 12
_BYTES_PER_SECTION = 1024


class Form(IntEnum):
    """Layout of the rest of the archive."""

    LONE = 0  # one track named '0', one group, one checksum
    NAMED = 1  # any tracks, one group, one checksum
    ON_MAP = 2  # walks on a known map
    SECTIONS = 3  # sections, each with its kind and length


class SectionKind(IntEnum):
    """What a section holds."""

    GRID = 1  # the quantisation grid
    NAMES = 2  # ids of all tracks
    WALKS = 3  # one group of walks
    MAP = 4  # which known map the walks lie on
    ATTRIBUTES = 5  # kept times and columns
    INDEX = 6  # where each group lies
    END = 7  # offset of the index, checksum of checksums
    ERROR_BOUND = 8  # error bound and sampling
    EXACT_LOGS = 9  # the logs, byte by byte, by themselves
    CODED_ATTRIBUTES = 10  # kept times and columns, by the coder of lossless columns
    CURVES = 11  # columns kept within an error
    SHORT_CURVES = 12  # the same, with bounds of two bytes
    GUIDED_LOGS = 13  # the logs, byte by byte, predicted by the walks


#: Kinds of sections that hold curves, of which there is at most one.
CURVE_KINDS = (SectionKind.CURVES, SectionKind.SHORT_CURVES)

#: Kinds of sections that hold logs byte by byte, of which there is at most one.
EXACT_KINDS = (SectionKind.EXACT_LOGS, SectionKind.GUIDED_LOGS)


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
    """Encode magic, version and form in three bytes."""
    # Three bits of version, two of form, two low ones and a high one.
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
    # Is it an archive?
    if not data:
        raise CorruptArchiveError("not a .gpsz archive: the file is empty", 0)
    # A file that ends within the magic may be the start of an archive.
    if data[: len(MAGIC)] != MAGIC[: len(data)]:
        if data.startswith(_NETWORK_MAGIC):
            raise CorruptArchiveError(
                "a road network that 'gpszip network' prepared, not an archive;"
                " it serves as --network",
                0,
            )
        raise CorruptArchiveError("not a .gpsz archive: it does not begin like one", 0)
    if len(data) < HEAD_BYTES:
        raise CorruptArchiveError("the archive ends within its head", len(data))

    # The version.
    byte = data[len(MAGIC)]
    version = byte & 7
    if version > VERSION:
        raise CorruptArchiveError(
            f"archive of version {version};"
            f" this GPSZip reads up to version {VERSION}: upgrade gpszip",
            2,
        )
    if version < OLDEST_VERSION:
        raise CorruptArchiveError(
            f"archive of version {version}, which no release of GPSZip has written:"
            " compress the log again",
            2,
        )

    # The form.
    head = Head(Form(byte >> 3 & 3), byte >> 5 & 3, byte >> 7, version)
    if head.form is Form.SECTIONS and head.low > 1:
        raise CorruptArchiveError("no archive has this form", 2)
    return head


def encode_varint(value: int) -> bytes:
    """Encode an integer >= 0 in groups of 7 bits, the lowest first.

    All bytes but the last have their top bit set.

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
    """Encode an integer of either sign: 0, -1, 1, -2, ... as the varints 0, 1, 2, 3, ..."""
    return encode_varint(2 * value if value >= 0 else -2 * value - 1)


def checksum(data: bytes | memoryview, start: int = 0) -> bytes:
    """CRC-32 (zlib's) in four bytes, the lowest first."""
    return zlib.crc32(data, start).to_bytes(CHECKSUM_BYTES, "little")


def encode_section(kind: int, body: bytes) -> bytes:
    """Encode a section of a large archive: marker, kind, length, body, checksum of kind to body."""
    content = bytes([kind]) + encode_varint(len(body)) + body
    return SECTION_MARKER + content + checksum(content)


def max_tracks(size: int) -> int:
    """Most tracks that an archive of ``size`` bytes can name."""
    return _FREE_TRACKS + _TRACKS_PER_BYTE * size


def max_sections(size: int) -> int:
    """Most sections before the end mark of a large archive of ``size`` bytes."""
    return _FREE_SECTIONS + size // _BYTES_PER_SECTION


@dataclass
class Cursor:
    """A position in untrusted bytes that never moves past their end.

    Parameters
    ----------
    data : bytes
        The bytes to read.
    offset : int, default 0
        Next byte.
    end : int, optional
        First byte that is not to be read; by default, all of ``data`` is.
    base : int, default 0
        Offset of ``data`` in the archive, for errors.
    """

    data: bytes
    offset: int = 0
    end: int = field(default=-1)
    base: int = 0

    def __post_init__(self) -> None:
        # A negative end is the default: that of the data.
        if self.end < 0:
            self.end = len(self.data)

    @property
    def remaining(self) -> int:
        """Number of bytes before the end."""
        return self.end - self.offset

    def error(self, message: str) -> CorruptArchiveError:
        """Return an error that names this position."""
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
        """Read an integer >= 0.

        A longer form than needed is refused, so that equal contents have equal bytes.
        """
        value = 0
        for place in range(_VARINT_BYTES):
            byte = self.read_byte(what)
            value |= (byte & 127) << 7 * place
            if byte < 128:
                # A last byte of 0 adds nothing, so that there is a shorter form.
                if (byte == 0 and place) or value >= _VARINT_LIMIT:
                    raise self.error(f"{what} is no number of 64 bits in its shortest form")
                return value
        raise self.error(f"{what} is longer than a number of 64 bits")

    def read_signed(self, what: str) -> int:
        """Read an integer of either sign."""
        value = self.read_varint(what)
        return value >> 1 if value % 2 == 0 else -(value >> 1) - 1

    def read_rest(self) -> bytes:
        """Read all remaining bytes."""
        return self.read_bytes(self.remaining, "the rest")

    def expect_end(self, what: str) -> None:
        """Refuse further bytes."""
        if self.remaining:
            raise self.error(f"{self.remaining} bytes after the end of {what}")
