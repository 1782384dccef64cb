"""Parse XML files, which may be large, damaged or hostile.

The parser is expat, which comes with Python. Files are read in chunks, and no tree of elements
is built: it would take a hundred times the memory of the points. Entities can't be declared, and
nothing outside of the file is fetched. Depth, texts, tags and names have limits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any, NoReturn, Protocol, TypeVar
from xml.parsers import expat

from gpszip.errors import InputError
from gpszip.io.logs.xml.text import ReplacedBytes, Utf8Transcoder
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source

__all__ = [
    "BATCH_POINTS",
    "MAX_DEPTH",
    "MAX_LETTERS",
    "RefusedError",
    "XmlCollector",
    "local_name",
    "parse_chunks",
    "refuse_depth",
]

#: Points of a batch: about 20 MB of texts.
BATCH_POINTS = 1 << 17

#: Depth of elements within each other, at most. Real files have about ten levels.
MAX_DEPTH = 200

#: Letters of one text, such as a time or a name, at most.
MAX_LETTERS = 1 << 20

#: Bytes that the parser gets at a time: 256 KiB.
_CHUNK_BYTES = 1 << 18

#: Bytes of one tag or comment, at most: the parser keeps them in memory.
_MAX_TAG_BYTES = 1 << 23

#: Different names of elements and attributes, at most: the parser keeps them in memory. Real files
#: have under 200.
_MAX_NAMES = 10_000

_ERROR = expat.errors

#: The errors of a file that ends too early.
_CUT_OFF = frozenset(
    _ERROR.codes[text]
    for text in (
        _ERROR.XML_ERROR_NO_ELEMENTS,
        _ERROR.XML_ERROR_UNCLOSED_TOKEN,
        _ERROR.XML_ERROR_PARTIAL_CHAR,
        _ERROR.XML_ERROR_UNCLOSED_CDATA_SECTION,
    )
)

#: Remedies for the most frequent errors.
_REMEDIES = {
    _ERROR.codes[text]: remedy
    for text, remedy in (
        (
            _ERROR.XML_ERROR_INVALID_TOKEN,
            "write & as &amp; and < as &lt;, and remove control characters",
        ),
        (_ERROR.XML_ERROR_UNDEFINED_ENTITY, "write the letter itself, and & as &amp;"),
        (_ERROR.XML_ERROR_TAG_MISMATCH, "close each element before the one around it"),
        (
            _ERROR.XML_ERROR_JUNK_AFTER_DOC_ELEMENT,
            "remove what follows the end of the first element, or move it to a file of its own",
        ),
    )
}


class RefusedError(InputError):
    """The file has something that no log needs."""


class XmlCollector(Protocol):
    """Collects points from the events of a parser."""

    @property
    def count(self) -> int:
        """Number of points so far."""

    @property
    def open_elements(self) -> tuple[str, ...]:
        """Names of the elements around points that are open, the outermost first."""

    def flush(self) -> None:
        """Store the texts so far in little memory; called after each chunk of the file."""


Collector = TypeVar("Collector", bound=XmlCollector)


def parse_chunks(
    source: Source, make_collector: Callable[[expat.XMLParserType], Collector], format_name: str
) -> Iterator[tuple[Collector, ReplacedBytes]]:
    """Parse a file chunk by chunk.

    Parameters
    ----------
    source : Source
        The file or stream.
    make_collector : callable
        Makes the collector, which sets the handlers of a parser. The parser gives attributes in
        order and joins the pieces of texts.
    format_name : str
        Name of the format for messages.

    Yields
    ------
    collector
        The same one after each chunk, at least once.
    ReplacedBytes
        Bytes so far that don't fit the encoding of the file.

    Raises
    ------
    InputError
        If the file is not well-formed XML, has a document type, or goes beyond a limit.
    """
    # Set the parser up for UTF-8, whatever the file declares.
    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    parser.ordered_attributes = True
    # A document type may declare entities; it is refused before it does.
    refuse_document_type = _document_type_refusal(format_name)
    parser.StartDoctypeDeclHandler = refuse_document_type
    parser.EntityDeclHandler = refuse_document_type
    collector = make_collector(parser)
    chunks = _chunks(source)
    first = next(chunks, b"")
    utf8 = Utf8Transcoder(first)

    # Parse, and name the line of any error.
    try:
        for _ in _feed(parser, collector, utf8, chain([first], chunks)):
            yield collector, utf8.replaced
    except expat.ExpatError as error:
        line = error.lineno + utf8.skipped_lines
        damage, remedy = _explain_damage(error.code, collector)
        raise InputError(
            f"damaged {format_name}: {damage}",
            path=source.name,
            location=f"line {line}",
            remedy=remedy,
        ) from None
    except RefusedError as error:
        line = parser.CurrentLineNumber + utf8.skipped_lines
        raise InputError(
            error.reason, path=source.name, location=f"line {line}", remedy=error.remedy
        ) from None
    except UnicodeDecodeError:
        encoding = utf8.encoding.upper()
        raise InputError(
            f"damaged {encoding} text",
            path=source.name,
            remedy="fetch the file again, or save it as UTF-8",
        ) from None


def local_name(name: str) -> str:
    """Return a name without its prefix.

    Examples
    --------
    >>> local_name("gx:Track"), local_name("Track")
    ('Track', 'Track')
    """
    return name.rpartition(":")[2]


def refuse_depth() -> NoReturn:
    """Refuse elements within each other that no log needs."""
    raise RefusedError(f"elements more than {MAX_DEPTH} deep within each other, which no log needs")


def _document_type_refusal(format_name: str) -> Callable[..., NoReturn]:
    def refuse(*_declaration: Any) -> NoReturn:
        raise RefusedError(
            f"has a document type (<!DOCTYPE), which no {format_name} file needs",
            remedy="remove it",
        )

    return refuse


def _feed(
    parser: expat.XMLParserType,
    collector: XmlCollector,
    utf8: Utf8Transcoder,
    chunks: Iterator[bytes],
) -> Iterator[None]:
    """Parse all chunks, and check after each one what the handlers can't see."""
    # Parse chunk by chunk, and compact the texts of points after each, which bounds the memory.
    fed = 0
    for chunk in chunks:
        text = utf8.encode(chunk)
        parser.Parse(text, False)
        fed += len(text)
        collector.flush()

        # The parser keeps an unfinished tag, and all names.
        if fed - parser.CurrentByteIndex > _MAX_TAG_BYTES:
            raise RefusedError(
                f"a tag or comment of more than {_MAX_TAG_BYTES} bytes", remedy="shorten it"
            )
        if len(parser.intern) > _MAX_NAMES:
            raise RefusedError(
                f"more than {_MAX_NAMES} different names of elements and attributes, "
                "which no log needs"
            )
        yield
    parser.Parse(utf8.encode(b"", final=True), True)
    collector.flush()
    yield


def _explain_damage(code: int, collector: XmlCollector) -> tuple[str, str]:
    """Say what is wrong with the file, and what to do."""
    # XML that is damaged within the file: name the fault and how many points come before it.
    points = f"{collector.count} point{'' if collector.count == 1 else 's'}"
    if code not in _CUT_OFF:
        remedy = _REMEDIES.get(code, "correct it there")
        return (
            f"{expat.ErrorString(code)}, after {points}",
            f"{remedy}; --skip-bad leaves the file out",
        )

    # The file is cut off: say which tags would close it.
    elements = collector.open_elements
    if not elements:
        return "the file ends within its first element", "fetch it again"
    ends = "".join(f"</{name}>" for name in reversed(elements))
    return (
        f"the file ends within <{elements[-1]}>, after {points}",
        f"fetch it again, or end it with {ends} after the last complete point; "
        "--skip-bad leaves the file out",
    )


def _chunks(source: Source) -> Iterator[bytes]:
    with source.open() as stream:
        # A damaged gzip file fails while it is read, not when it is opened.
        try:
            while chunk := read_chunk(stream, _CHUNK_BYTES):
                yield chunk
        except OSError as error:
            raise InputError(
                f"damaged gzip file ({error})",
                path=source.name,
                remedy="unpack what is left of it with zcat, or fetch it again",
            ) from None
