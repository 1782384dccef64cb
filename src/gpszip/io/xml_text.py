"""The text of an XML file, whatever its encoding says; and the name of its root element.

Files declare one encoding and use another more often than one would think. So the bytes are decoded here, and the parser
gets UTF-8 and is told to believe no declaration.
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass
from xml.parsers import expat

__all__ = ["Replaced", "Utf8", "encoding_of", "root_of"]

#: Byte order marks. Those of UTF-32 come first, as one of them starts like that of UTF-16.
_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)

#: How a file without a byte order mark starts where a character takes two bytes or four.
_WIDE = (
    (re.compile(rb"(?:[ \t\r\n]\0\0\0)*<\0\0\0"), "utf-32-le"),
    (re.compile(rb"(?:\0\0\0[ \t\r\n])*\0\0\0<"), "utf-32-be"),
    (re.compile(rb"(?:[ \t\r\n]\0)*<\0"), "utf-16-le"),
    (re.compile(rb"(?:\0[ \t\r\n])*\0<"), "utf-16-be"),
)

_DECLARED = re.compile(rb"""\s*<\?xml\s[^>]*?\bencoding\s*=\s*["']([A-Za-z][\w.:-]{0,40})["']""")

#: Encodings that a declaration may ask for. Python knows more, but those are no encodings of files.
_KNOWN = re.compile(r"utf-8|ascii|iso8859-\d+|cp\d+|koi8-\w|mac-\w+|gbk|gb2312|gb18030|big5\w*|euc_\w+|shift_jis\w*|tis-620")

#: What every encoding that is told by a declaration must leave as it is: the declaration could not be read else.
_ASCII = bytes(range(0x20, 0x7F))

#: Bytes that are no text, as the decoder hands them over, and what they are in Windows-1252, where they are something.
_UNDECODED = re.compile(r"[\ud800-\udfff]")
_LETTERS = {0xDC00 + byte: bytes([byte]).decode("cp1252", "replace") for byte in range(0x80, 0x100)}

#: The word around a replaced byte, to be shown.
_WORD = re.compile(r"[^\s<>]{0,20}[\ud800-\udfff][^\s<>]{0,20}")

#: A tag, and what may hold some that don't count, for files that are damaged before the end of their first tag.
_TAG = re.compile(r"<(\w[\w:.-]*)")
_COMMENT = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)


@dataclass(frozen=True)
class Replaced:
    """Bytes that are no text in the file's encoding.

    Parameters
    ----------
    count : int
        How many there are.
    first : str
        The word that holds the first of them, as it was read.
    """

    count: int
    first: str


class Utf8:
    r"""Turns an XML file into UTF-8, piece by piece.

    A byte that is no text in the file's encoding is read as Windows-1252, and counted.

    Parameters
    ----------
    head : bytes
        The first bytes of the file, from which the encoding is told.

    Examples
    --------
    >>> text = Utf8(b"<name>Z\xfcrich</name>")
    >>> text.encode(b"<name>Z\xfcrich</name>").decode()
    '<name>Zürich</name>'
    >>> text.replaced
    Replaced(count=1, first='Zürich')
    """

    def __init__(self, head: bytes) -> None:
        self.encoding = encoding_of(head)
        wide = self.encoding.startswith(("utf-16", "utf-32"))
        self._decoder = codecs.getincrementaldecoder(self.encoding)("surrogatepass" if wide else "surrogateescape")
        self._at_start = True
        self.skipped_lines = 0
        self.replaced = Replaced(0, "")

    def encode(self, piece: bytes, *, final: bool = False) -> bytes:
        """Return the next piece of the file in UTF-8, without a byte order mark or white space at its start.

        Raises
        ------
        UnicodeDecodeError
            If the file is UTF-16 or UTF-32, and ends within a character or holds what is none.
        """
        text = self._decoder.decode(piece, final)
        if self._at_start and text:
            text = self._without_margin(text)
        try:
            return text.encode()
        except UnicodeEncodeError:
            return self._mended(text).encode()

    def _without_margin(self, text: str) -> str:
        """Take away what an XML declaration must not have before it, though files do."""
        bare = text.lstrip("\ufeff \t\r\n")
        self._at_start = not bare
        self.skipped_lines += text[: len(text) - len(bare)].count("\n")
        return bare

    def _mended(self, text: str) -> str:
        """Read what is no text in the file's encoding as Windows-1252, letter by letter."""
        mended, count = _UNDECODED.subn(lambda found: _LETTERS.get(ord(found[0]), "\ufffd"), text)
        word = _WORD.search(text)
        first = self.replaced.first or (mended[word.start() : word.end()] if word else "")
        self.replaced = Replaced(self.replaced.count + count, first)
        return mended


def encoding_of(head: bytes) -> str:
    """Tell the encoding of an XML file from its first bytes.

    A byte order mark counts more than a declaration, and the width of the characters, too. A file that declares an
    encoding which it can't have is taken to be UTF-8.

    Parameters
    ----------
    head : bytes
        With the XML declaration, if there is one.

    Returns
    -------
    str
        Name of one of Python's codecs.

    Examples
    --------
    >>> encoding_of(b'<?xml version="1.0" encoding="windows-1252"?>'), encoding_of("<gpx>".encode("utf-16-le"))
    ('cp1252', 'utf-16-le')
    >>> encoding_of(b'<?xml version="1.0" encoding="UTF-16"?>')
    'utf-8'
    """
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    for start, name in _WIDE:
        if start.match(head):
            return name
    declared = _DECLARED.match(head)
    return _usable(declared[1].decode()) if declared else "utf-8"


def root_of(head: bytes) -> str | None:
    """Find the name of an XML file's root element, without its prefix; of a file with a document type, the name of that.

    Parameters
    ----------
    head : bytes
        The first bytes of the file.

    Returns
    -------
    str or None
        None if it isn't XML; empty if the root element doesn't come within these bytes.

    Examples
    --------
    >>> root_of(b'<?xml version="1.0"?><!-- a walk --><g:gpx xmlns:g="...">'), root_of(b"t,x,y")
    ('gpx', None)
    """
    utf8 = Utf8(head)
    try:
        text = utf8.encode(head)
    except UnicodeDecodeError:
        return None
    if not text.startswith(b"<"):
        return None
    names: list[str] = []
    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler = lambda name, _attributes: _found(name, names)
    parser.StartDoctypeDeclHandler = lambda name, *_ids: _found(name, names)
    try:
        parser.Parse(text, True)
    except _FoundError:
        pass
    except expat.ExpatError:
        names = _TAG.findall(_COMMENT.sub("", text.decode()))[:1]
    if not names:
        return "" if text.startswith((b"<?", b"<!")) else None
    return names[0].rpartition(":")[2]


class _FoundError(Exception):
    """The root element has been found; nothing further is to be parsed."""


def _found(name: str, names: list[str]) -> None:
    names.append(name)
    raise _FoundError


def _usable(declared: str) -> str:
    """The codec that a declaration names, if it can be that of a file whose declaration is plain ASCII."""
    try:
        name = codecs.lookup(declared).name
        fits = _KNOWN.fullmatch(name) and _ASCII.decode(name) == _ASCII.decode()
    except (LookupError, UnicodeDecodeError):
        return "utf-8"
    return name if fits else "utf-8"
