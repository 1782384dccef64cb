"""The points of a GPX file: from the events of an XML parser to columns of text.

Nothing is made of the texts here. The parser is expat, of Python's standard library: a tree of elements would take a
hundred times the memory of the points, and other readers of GPX make numbers of texts that hold none. Files are taken
to be hostile: no entity is ever declared, no name, text or depth grows without a limit.
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.parsers import expat

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.source import Source
from gpszip.io.xml_text import Replaced, Utf8

__all__ = ["GpxPoints", "parse_points"]

#: Bytes that the parser gets at a time.
_PIECE = 1 << 18

#: Elements within each other. Files have ten at most.
_DEEPEST = 200

#: Letters of one text, such as a name or a time.
_LONGEST_TEXT = 1 << 20

#: Bytes of one tag or comment, which the parser holds as a whole. Pictures in comments are smaller.
_LONGEST_TAG = 1 << 23

#: Different names of elements and attributes. The parser never forgets one; files have two hundred at most.
_MOST_NAMES = 10_000

#: Elements of GPX that matter around points, by their names in lower case.
_POINTS = frozenset({"trkpt", "rtept"})
_PARENTS = frozenset({"trk", "rte"})

#: Elements of a point that are no columns: what they hold is, or is a link.
_NO_COLUMNS = frozenset({"extensions", "link"})

#: How the parser says that a file ends too early.
_CUT_OFF = frozenset(
    expat.errors.codes[text]
    for text in (
        expat.errors.XML_ERROR_NO_ELEMENTS,
        expat.errors.XML_ERROR_UNCLOSED_TOKEN,
        expat.errors.XML_ERROR_PARTIAL_CHAR,
        expat.errors.XML_ERROR_UNCLOSED_CDATA_SECTION,
    )
)

#: What mends the commonest faults.
_REMEDIES = {
    expat.errors.codes[expat.errors.XML_ERROR_INVALID_TOKEN]: "write & as &amp; and < as &lt;, and remove control characters",
    expat.errors.codes[expat.errors.XML_ERROR_UNDEFINED_ENTITY]: "write the letter itself, and & as &amp;",
    expat.errors.codes[expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT]: "remove what follows the first </gpx>, or make it a file of its own",
    expat.errors.codes[expat.errors.XML_ERROR_TAG_MISMATCH]: "close each element before the one around it",
}


@dataclass(frozen=True, eq=False)
class GpxPoints:
    """All points of the tracks and routes of a file, in its order.

    Parameters
    ----------
    lat, lon : pyarrow.ChunkedArray of string, shape (n,)
        The attributes as they stand in the file; null where a point has none.
    fields : mapping of str to pyarrow.ChunkedArray of string, shape (n,)
        Elements of points that were asked for, by their names in lower case; null where a point has none or a blank one.
    present : mapping of str to str
        All elements of points: how the file spells their names, by their names in lower case.
    names : tuple of str or None
        Of each track or route that has points.
    routes : bool array, shape (number of names,)
        Whether each is a route.
    parents : int array, shape (s,)
        Track or route of each segment that has points.
    starts : int array, shape (s,)
        First point of each segment.
    waypoints : int
        Number of points that belong to no track and no route.
    replaced : Replaced
        Bytes that are no text in the file's encoding.
    """

    lat: pa.ChunkedArray
    lon: pa.ChunkedArray
    fields: Mapping[str, pa.ChunkedArray]
    present: Mapping[str, str]
    names: tuple[str | None, ...]
    routes: NDArray[np.bool_]
    parents: NDArray[np.intp]
    starts: NDArray[np.intp]
    waypoints: int
    replaced: Replaced


def parse_points(source: Source, fields: Collection[str]) -> GpxPoints:
    """Collect the points of a GPX file.

    Elements are told by their names without a prefix, in upper or lower case, whatever their namespace.

    Parameters
    ----------
    source : Source
        The file or stream; it is read in pieces.
    fields : collection of str
        Elements of the points to collect, by their names in lower case. An element may be anywhere within its point; of
        several of one name in a point, the first that holds something counts.

    Returns
    -------
    GpxPoints

    Raises
    ------
    InputError
        If the file is no well-formed XML, has a document type, or goes beyond a limit.
    """
    parser = expat.ParserCreate("utf-8")  # which makes it believe no declaration
    parser.buffer_text = True
    parser.ordered_attributes = True
    collector = _Collector(parser, fields)
    pieces = _pieces(source)
    first = next(pieces, b"")
    utf8 = Utf8(first)
    fed = 0
    try:
        for piece, final in _with_end(first, pieces):
            text = utf8.encode(piece, final=final)
            parser.Parse(text, final)
            fed += len(text)
            collector.settle(fed)
    except expat.ExpatError as error:
        where = f"{source.name}: line {error.lineno + utf8.skipped_lines}"
        raise InputError(f"{where}: {collector.told(error.code)}") from None
    except UnicodeDecodeError:
        raise InputError(f"{source.name}: damaged {utf8.encoding.upper()} text; fetch the file again, or save it as UTF-8") from None
    except _RefusedError as error:
        raise InputError(f"{source.name}: line {parser.CurrentLineNumber + utf8.skipped_lines}: {error}") from None
    return collector.points(utf8.replaced)


class _RefusedError(Exception):
    """The file goes beyond a limit; says which."""


class _Column:
    """Texts of some points, as they come; put away as Arrow's strings from time to time, which take little room."""

    __slots__ = ("_chunks", "last", "rows", "texts")

    def __init__(self) -> None:
        self.last = -1
        self.rows = array("q")
        self.texts: list[str | None] = []
        self._chunks: list[Any] = []

    def settle(self) -> None:
        chunk = pa.array(self.texts, pa.string())
        self.texts.clear()
        if len(chunk) and (pc.max(pc.binary_length(chunk)).as_py() or 0) > _LONGEST_TEXT:
            raise _RefusedError(f"a text of more than {_LONGEST_TEXT} letters in a point; remove it")
        self._chunks.append(chunk)

    def whole(self, count: int | None = None) -> Any:
        """The column; where rows are given, one of so many points with null for the others."""
        column = pa.chunked_array(self._chunks, pa.string())
        if count is None or len(column) == count:
            return column
        index = np.full(count, -1, dtype=np.int64)
        index[np.frombuffer(self.rows, dtype=np.int64)] = np.arange(len(column))
        return column.take(pa.array(index, mask=index < 0))


class _Collector:
    """Handlers of the parser's events; those within a point, which are nearly all, do as little as they can."""

    def __init__(self, parser: expat.XMLParserType, fields: Collection[str]) -> None:
        self._parser = parser
        self._lat, self._lon = _Column(), _Column()
        self._fields = {name: _Column() for name in fields}
        self._present: dict[str, str] = {}

        # Around the points: open elements, and what is known of the track or route that is open.
        self._open: list[str] = []
        self._local: dict[str, str] = {}
        self._kind, self._name, self._number = "", None, -1  # type: tuple[str, str | None, int]
        self._at_new_segment = True
        self._names: list[str | None] = []
        self._routes: list[bool] = []
        self._parents, self._starts = array("q"), array("q")
        self._waypoints = 0

        # Within a point: open elements, whether the innermost has none in it, and its text.
        self._row = -1
        self._point_names: set[str] = set()
        self._path: list[str] = []
        self._is_leaf = False
        self._text: list[str] = []
        self._columns: dict[str, dict[str, _Column | None]] = {}  # by the point's child, and itself

        parser.StartDoctypeDeclHandler = self._refuse_doctype
        parser.EntityDeclHandler = self._refuse_doctype
        self._go_outside()

    def settle(self, fed: int) -> None:
        """Put away what has been collected, and hold all limits that the handlers have no time for."""
        for column in (self._lat, self._lon, *self._fields.values()):
            column.settle()
        if sum(map(len, self._text)) > _LONGEST_TEXT:
            raise _RefusedError(f"a text of more than {_LONGEST_TEXT} letters; remove it")
        if fed - self._parser.CurrentByteIndex > _LONGEST_TAG:
            raise _RefusedError(f"a tag or comment of more than {_LONGEST_TAG} bytes; remove it")
        if len(self._parser.intern) > _MOST_NAMES:
            raise _RefusedError(f"more than {_MOST_NAMES} different names of elements and attributes, which no GPX file needs")

    def told(self, code: int) -> str:
        """Say what is wrong with the file, and how to mend it."""
        points = f"{self._row + 1} points" if self._row else "1 point"
        if code not in _CUT_OFF:
            remedy = _REMEDIES.get(code, "mend it there")
            return f"damaged GPX: {expat.ErrorString(code)}, after {points}; {remedy}; --skip-bad leaves the file out"
        if not self._open:
            return "damaged GPX: the file ends before its first element; fetch it again"
        ends = "".join(f"</{name}>" for name in reversed(self._open))
        remedy = f"fetch it again, or end it with {ends} after the last whole point"
        return f"damaged GPX: the file ends within <{self._open[-1]}>, after {points}; {remedy}; --skip-bad leaves the file out"

    def points(self, replaced: Replaced) -> GpxPoints:
        """Return what has been collected."""
        count = self._row + 1
        return GpxPoints(
            lat=self._lat.whole(),
            lon=self._lon.whole(),
            fields={name: column.whole(count) for name, column in self._fields.items() if name in self._present},
            present=self._present,
            names=tuple(self._names),
            routes=np.array(self._routes, dtype=np.bool_),
            parents=np.array(self._parents, dtype=np.intp),
            starts=np.array(self._starts, dtype=np.intp),
            waypoints=self._waypoints,
            replaced=replaced,
        )

    def _go_outside(self) -> None:
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = None

    def _start(self, name: str, attributes: list[str]) -> None:
        """Begin an element that is not within a point."""
        local = self._local.get(name) or self._local.setdefault(name, _local(name).lower())
        if local in _POINTS:
            self._point_names.add(name)
            self._start_point(local, attributes)
            return
        if local in _PARENTS:
            self._kind, self._name, self._number = local, None, -1
        elif local == "name" and self._open and self._local[self._open[-1]] in _PARENTS:
            self._text.clear()
            self._parser.CharacterDataHandler = self._text.append
        elif local == "wpt":
            self._waypoints += 1
        self._at_new_segment |= local in _PARENTS or local == "trkseg"
        self._open.append(name)
        if len(self._open) > _DEEPEST:
            raise _RefusedError(f"elements {_DEEPEST} deep within each other, which no GPX file needs")

    def _end(self, name: str) -> None:
        """End an element that is not within a point."""
        local = self._local[name]
        self._open.pop()
        if local in _PARENTS:
            self._kind, self._name, self._number = "", None, -1
        elif local == "name" and self._open and self._local[self._open[-1]] in _PARENTS:
            self._parser.CharacterDataHandler = None
            self._call("".join(self._text))
        self._at_new_segment |= local in _PARENTS or local == "trkseg"

    def _call(self, name: str) -> None:
        """Give the track or route that is open its name, which may come before its points or after."""
        if self._name is None and name.strip():
            self._name = name
            if self._number >= 0:
                self._names[self._number] = name

    def _start_point(self, local: str, attributes: list[str]) -> None:
        # Nearly all points have the two attributes in this order.
        if len(attributes) == 4 and attributes[0] == "lat" and attributes[2] == "lon":
            self._lat.texts.append(attributes[1])
            self._lon.texts.append(attributes[3])
        else:
            self._lat.texts.append(_attribute(attributes, "lat"))
            self._lon.texts.append(_attribute(attributes, "lon"))
        self._row += 1
        if self._at_new_segment:
            self._start_segment(local)
        self._parser.StartElementHandler = self._start_field
        self._parser.EndElementHandler = self._end_field
        self._parser.CharacterDataHandler = self._text.append

    def _start_segment(self, local: str) -> None:
        """Note the segment of the first point in it, so that segments and tracks without points count for nothing."""
        if self._number < 0:
            self._number = len(self._names)
            self._names.append(self._name)
            self._routes.append(self._kind == "rte" or (not self._kind and local == "rtept"))
        self._parents.append(self._number)
        self._starts.append(self._row)
        self._at_new_segment = False

    def _start_field(self, name: str, _attributes: list[str]) -> None:
        """Begin an element within a point."""
        path = self._path
        path.append(name)
        if len(path) > _DEEPEST:
            raise _RefusedError(f"elements {_DEEPEST} deep within each other, which no GPX file needs")
        self._is_leaf = True
        self._text.clear()

    def _end_field(self, name: str) -> None:
        """End an element within a point, or the point."""
        path = self._path
        if self._is_leaf:
            self._is_leaf = False
            try:
                column = self._columns[path[0]][name]
            except KeyError:
                column = self._column(name)
            if column is not None and column.last != self._row:
                text = "".join(self._text)
                if text and not text.isspace():
                    column.last = self._row
                    column.rows.append(self._row)
                    column.texts.append(text)
        elif not path:
            self._go_outside()
            return
        elif name in self._point_names:
            self._refuse_nested(name)
        path.pop()

    def _column(self, name: str) -> _Column | None:
        """Return the column of an element that comes for the first time there, if it is one that was asked for."""
        top, shown = _local(self._path[0]).lower(), _local(name)
        local = shown.lower()
        if local in _POINTS:
            self._refuse_nested(name)

        # What a link holds is no column, and the time of an extension is not the point's.
        column = self._fields.get(local)
        if top == "link" or local in _NO_COLUMNS or (local == "time" and len(self._path) > 1):
            column = None
        else:
            self._present.setdefault(local, shown)
        self._columns.setdefault(self._path[0], {})[name] = column
        return column

    def _refuse_nested(self, name: str) -> None:
        raise _RefusedError(f"a <{name}> within a point; close each point before the next")

    def _refuse_doctype(self, *_declaration: Any) -> None:
        raise _RefusedError("has a document type (<!DOCTYPE), which no GPX file needs; remove it")


def _local(name: str) -> str:
    """A name without its prefix."""
    return name.rpartition(":")[2]


def _attribute(attributes: Sequence[str], wanted: str) -> str | None:
    pairs = zip(attributes[::2], attributes[1::2], strict=True)
    return next((value for name, value in pairs if _local(name).lower() == wanted), None)


def _pieces(source: Source) -> Iterator[bytes]:
    with source.open() as stream:
        try:
            while piece := stream.read(_PIECE):
                yield piece
        except OSError as error:
            raise InputError(
                f"{source.name}: damaged gzip file ({error}); unpack what is left of it with zcat, or fetch it again"
            ) from None


def _with_end(first: bytes, others: Iterator[bytes]) -> Iterator[tuple[bytes, bool]]:
    """All pieces, and whether no other follows."""
    yield first, False
    for piece in others:
        yield piece, False
    yield b"", True
