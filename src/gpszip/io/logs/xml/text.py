"""The text of an XML file in UTF-8, and the name of its root element.

Many files declare one encoding and use another, and a parser then refuses them or reads wrong
letters. So the bytes are decoded here; the parser gets UTF-8 and ignores what the file declares.
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass
from xml.parsers import expat

__all__ = ["ReplacedBytes", "Utf8Transcoder", "detect_encoding", "root_element"]

#: Byte order marks. UTF-32 comes first, as its little-endian mark starts with that of UTF-16.
_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)

#: The start of a file without a mark that takes two or four bytes for a character.
_WIDE = (
    (re.compile(rb"(?:[ \t\r\n]\0\0\0)*<\0\0\0"), "utf-32-le"),
    (re.compile(rb"(?:\0\0\0[ \t\r\n])*\0\0\0<"), "utf-32-be"),
    (re.compile(rb"(?:[ \t\r\n]\0)*<\0"), "utf-16-le"),
    (re.compile(rb"(?:\0[ \t\r\n])*\0<"), "utf-16-be"),
)

#: The encoding that a file declares.
_DECLARED = re.compile(rb"""\s*<\?xml\s[^>]*?\bencoding\s*=\s*["']([A-Za-z][\w.:-]{0,40})["']""")

#: Codecs that a declaration may ask for. Python has others, such as zip, which are not for text.
_KNOWN = re.compile(
    r"utf-8|ascii|iso8859-\d+|cp\d+|koi8-\w|mac-\w+|tis-620"
    r"|gbk|gb2312|gb18030|big5\w*|euc_\w+|shift_jis\w*"
)

#: Letters that a declared encoding must have in the positions of ASCII: else the declaration could
#: not have been read.
_ASCII = bytes(range(0x20, 0x7F))

#: Surrogates, to which the decoder turns bytes that don't fit the encoding.
_UNDECODED = re.compile(r"[\ud800-\udfff]")

#: Letters of these bytes in Windows-1252.
_LETTERS = {0xDC00 + byte: bytes([byte]).decode("cp1252", "replace") for byte in range(0x80, 0x100)}

#: The word around such a byte, for messages.
_WORD = re.compile(r"[^\s<>]{0,20}[\ud800-\udfff][^\s<>]{0,20}")

#: The first tag of a file that is damaged within it, and comments before it.
_TAG = re.compile(r"<(\w[\w:.-]*)")
_COMMENT = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)


@dataclass(frozen=True)
class ReplacedBytes:
    """Bytes that don't fit the encoding of a file.

    Parameters
    ----------
    count : int
        How many there are.
    first : str
        The word with the first of them, as it was read.
    """

    count: int
    first: str


class Utf8Transcoder:
    r"""Turns an XML file into UTF-8, chunk by chunk.

    Bytes that don't fit the encoding of the file are read as Windows-1252, and counted.

    Parameters
    ----------
    head : bytes
        The first bytes of the file, which show the encoding.

    Attributes
    ----------
    encoding : str
        Name of Python's codec.
    replaced : ReplacedBytes
        Bytes so far that don't fit the encoding.
    skipped_lines : int
        Number of lines at the start that are left out.

    Examples
    --------
    >>> text = Utf8Transcoder(b"<name>Z\xfcrich</name>")
    >>> text.encode(b"<name>Z\xfcrich</name>").decode()
    '<name>Zürich</name>'
    >>> text.replaced
    ReplacedBytes(count=1, first='Zürich')
    """

    def __init__(self, head: bytes) -> None:
        self.encoding = detect_encoding(head)
        # A byte b that doesn't fit becomes the surrogate U+DC00 + b. UTF-16 and UTF-32 have lone
        # surrogates of their own, which are let through here and replaced later.
        wide = self.encoding.startswith(("utf-16", "utf-32"))
        self._decoder = codecs.getincrementaldecoder(self.encoding)(
            "surrogatepass" if wide else "surrogateescape"
        )
        self._at_start = True
        self.skipped_lines = 0
        self.replaced = ReplacedBytes(0, "")

    def encode(self, chunk: bytes, *, final: bool = False) -> bytes:
        """Return the next chunk of the file in UTF-8.

        A byte order mark and white space at the start of the file are left out.

        Parameters
        ----------
        chunk : bytes
            The next bytes of the file.
        final : bool, default False
            Whether the file ends with them.

        Raises
        ------
        UnicodeDecodeError
            If the file is UTF-16 or UTF-32 and ends within a character, or has an impossible one.
        """
        text = self._decoder.decode(chunk, final)
        if self._at_start and text:
            text = self._without_margin(text)
        # Surrogates have no UTF-8, so this fails for the chunks that hold some.
        try:
            return text.encode()
        except UnicodeEncodeError:
            return self._read_as_cp1252(text).encode()

    def _without_margin(self, text: str) -> str:
        """Leave out what must not stand before an XML declaration, but does in some files."""
        bare = text.lstrip("\ufeff \t\r\n")
        # White space may go on in the next chunk.
        self._at_start = not bare
        self.skipped_lines += text[: len(text) - len(bare)].count("\n")
        return bare

    def _read_as_cp1252(self, text: str) -> str:
        """Read bytes that don't fit the encoding as Windows-1252."""
        letters, count = _UNDECODED.subn(lambda byte: _LETTERS.get(ord(byte[0]), "\ufffd"), text)
        word = _WORD.search(text)
        first = self.replaced.first or (letters[word.start() : word.end()] if word else "")
        self.replaced = ReplacedBytes(self.replaced.count + count, first)
        return letters


def detect_encoding(head: bytes) -> str:
    """Find the encoding of an XML file from its first bytes.

    A byte order mark comes first, then the number of bytes for a character, then the declaration.
    A file that declares an encoding it can't have is read as UTF-8.

    Parameters
    ----------
    head : bytes
        The first bytes of the file, with its declaration.

    Returns
    -------
    str
        Name of Python's codec.

    Examples
    --------
    >>> detect_encoding(b'<?xml version="1.0" encoding="windows-1252"?>')
    'cp1252'
    >>> detect_encoding("<gpx>".encode("utf-16-le"))
    'utf-16-le'
    >>> detect_encoding(b'<?xml version="1.0" encoding="UTF-16"?>')
    'utf-8'
    """
    # A declaration shows only if letters are single bytes, so the others are ruled out first.
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    for start, name in _WIDE:
        if start.match(head):
            return name
    declared = _DECLARED.match(head)
    return _usable_codec(declared[1].decode()) if declared else "utf-8"


def root_element(head: bytes) -> str | None:
    """Find the name of an XML file's root element, without its prefix.

    If there is a document type, it names the root element.

    Parameters
    ----------
    head : bytes
        The first bytes of the file.

    Returns
    -------
    str or None
        None if the file isn't XML; empty if the root element doesn't start within these bytes.

    Examples
    --------
    >>> root_element(b'<?xml version="1.0"?><!-- a walk --><g:gpx xmlns:g="...">')
    'gpx'
    >>> root_element(b"t,x,y") is None
    True
    """
    # Decode the bytes; pass over files that are no XML.
    try:
        text = Utf8Transcoder(head).encode(head)
    except UnicodeDecodeError:
        return None
    if not text.startswith(b"<"):
        return None

    # Parse up to the first element.
    names: list[str] = []
    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler = lambda name, _attributes: _stop_at(name, names)
    parser.StartDoctypeDeclHandler = lambda name, *_ids: _stop_at(name, names)
    try:
        parser.Parse(text, True)
    except _FoundError:
        pass
    except expat.ExpatError:  # damaged before the first element
        names = _TAG.findall(_COMMENT.sub("", text.decode()))[:1]

    # Without a root element here, a declaration, comment or document type still shows XML.
    if not names:
        return "" if text.startswith((b"<?", b"<!")) else None
    return names[0].rpartition(":")[2]


class _FoundError(Exception):
    """Stops the parser at the root element."""


def _stop_at(name: str, names: list[str]) -> None:
    names.append(name)
    raise _FoundError


def _usable_codec(declared: str) -> str:
    """Return the codec for a declared encoding, or UTF-8 if the file can't have that one."""
    # The declaration was read as ASCII, so an encoding that writes ASCII otherwise is not used.
    try:
        name = codecs.lookup(declared).name
        fits = _KNOWN.fullmatch(name) and _ASCII.decode(name) == _ASCII.decode()
    except (LookupError, UnicodeDecodeError):
        return "utf-8"
    return name if fits else "utf-8"
