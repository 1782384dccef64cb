"""The points of a GPX file, collected from the events of an XML parser.

Coordinates, times and all else are kept as the texts in the file.
:mod:`gpszip.io.logs.gpx.read` interprets them, column by column.
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn
from xml.parsers.expat import XMLParserType

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError

__all__ = ["GpxPoints", "PointCollector", "RefusedError"]

#: Depth of elements within each other, at most. Real files have about ten levels.
_MAX_DEPTH = 200

#: Letters of one text, such as a time or a name, at most.
_MAX_LETTERS = 1 << 20

#: Elements that hold points, by their names in lower case.
_PARENTS = frozenset({"trk", "rte"})

#: Points of tracks and routes, by their names in lower case.
_POINTS = frozenset({"trkpt", "rtept"})

#: Children of a point that hold further elements, and no text.
_CONTAINERS = frozenset({"extensions", "link"})


class RefusedError(InputError):
    """The file has something that no GPX file needs."""


@dataclass(frozen=True, eq=False)
class GpxPoints:
    """All points of the tracks and routes in a GPX file, in the order of the file.

    Parameters
    ----------
    lat, lon : pyarrow.ChunkedArray of string, shape (n,)
        The attributes as texts; null if a point doesn't have them.
    fields : mapping of str to pyarrow.ChunkedArray of string, shape (n,)
        Texts of the elements that were asked for, by name in lower case; null if a point has no
        such element or a blank one.
    present : mapping of str to str
        All elements that the points have: names as spelled in the file, by name in lower case.
    names : tuple of str or None, length p
        Name of each track or route that has points.
    routes : bool array, shape (p,)
        Whether each of these is a route.
    parents : int array, shape (s,)
        Index of the track or route that each segment belongs to. Only segments with points count.
    starts : int array, shape (s,)
        Index of the first point of each segment.
    waypoints : int
        Number of waypoints, which belong to no track and no route.
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


class PointCollector:
    """Handles the events of a parser and collects the points.

    Nearly all events happen within points. So there are two sets of handlers: one for elements
    around points, and one for elements within them, which does as little as it can.

    Parameters
    ----------
    parser : expat parser
        It must give attributes in order and join the pieces of texts.
    fields : collection of str
        Elements of points to collect, by name in lower case.
    """

    def __init__(self, parser: XMLParserType, fields: Collection[str]) -> None:
        # Columns of the points so far, and the text and row of the current point.
        self._parser = parser
        self._lat, self._lon = _TextColumn(), _TextColumn()
        self._fields = {name: _TextColumn() for name in fields}
        self._present: dict[str, str] = {}
        self._text: list[str] = []
        self._row = -1

        # Around points: the open elements, and the open track or route. A track gets its index with
        # its first point, so that tracks without points don't count.
        self._open: list[str] = []
        self._local_names: dict[str, str] = {}
        self._parent_kind = ""
        self._parent_name: str | None = None
        self._parent_index = -1
        self._at_new_segment = True
        self._names: list[str | None] = []
        self._routes: list[bool] = []
        self._parents, self._starts = array("q"), array("q")
        self._waypoints = 0

        # Within a point: the open elements, and whether the innermost one is a leaf so far. A
        # column is found by the outermost element, then by the innermost.
        self._path: list[str] = []
        self._is_leaf = False
        self._columns: dict[str, dict[str, _TextColumn | None]] = {}
        self._point_names: set[str] = set()

        # A document type may declare entities; it is refused before it does.
        parser.StartDoctypeDeclHandler = _refuse_document_type
        parser.EntityDeclHandler = _refuse_document_type
        self._leave_point()

    @property
    def count(self) -> int:
        """Number of points so far."""
        return self._row + 1

    @property
    def open_elements(self) -> tuple[str, ...]:
        """Names of the elements around points that are open, the outermost first."""
        return tuple(self._open)

    def flush(self) -> None:
        """Store the texts so far in little memory. Call it after each chunk of the file.

        Raises
        ------
        RefusedError
            If a text is too long.
        """
        for column in (self._lat, self._lon, *self._fields.values()):
            column.flush()
        # A text without an end would grow with each chunk.
        if sum(map(len, self._text)) > _MAX_LETTERS:
            raise RefusedError(f"a text of more than {_MAX_LETTERS} letters", remedy="shorten it")

    def finish(self) -> GpxPoints:
        """Return all points."""
        present = self._fields.keys() & self._present.keys()
        return GpxPoints(
            lat=self._lat.to_column(self.count),
            lon=self._lon.to_column(self.count),
            fields={name: self._fields[name].to_column(self.count) for name in present},
            present=self._present,
            names=tuple(self._names),
            routes=np.array(self._routes, dtype=np.bool_),
            parents=np.array(self._parents, dtype=np.intp),
            starts=np.array(self._starts, dtype=np.intp),
            waypoints=self._waypoints,
        )

    # Handlers for elements around points

    def _start(self, name: str, attributes: list[str]) -> None:
        # A point gets handlers of its own.
        # Files have few different names, so each is normalised once.
        kind = self._local_names.get(name) or self._local_names.setdefault(
            name, _local(name).lower()
        )
        if kind in _POINTS:
            self._enter_point(name, kind, attributes)
            return

        # Other elements change what the next points belong to.
        if kind in _PARENTS:
            self._begin_parent(kind)
        elif kind == "trkseg":
            self._at_new_segment = True
        elif kind == "wpt":
            self._waypoints += 1
        elif self._is_title(kind):
            self._text.clear()
            self._parser.CharacterDataHandler = self._text.append

        # Record the open element, and refuse nesting that no GPX file needs.
        self._open.append(name)
        if len(self._open) > _MAX_DEPTH:
            _refuse_depth()

    def _end(self, name: str) -> None:
        # Expat refuses tags that don't match, so the innermost element is the one that ends.
        self._open.pop()
        kind = self._local_names[name]
        if kind in _PARENTS:
            self._begin_parent("")  # points from here on are outside of any track
        elif kind == "trkseg":
            self._at_new_segment = True
        elif self._is_title(kind):
            self._parser.CharacterDataHandler = None
            self._name_parent("".join(self._text))

    def _begin_parent(self, kind: str) -> None:
        self._parent_kind, self._parent_name, self._parent_index = kind, None, -1
        self._at_new_segment = True

    def _is_title(self, kind: str) -> bool:
        """Whether an element is the name of a track or route, rather than of something else."""
        return kind == "name" and bool(self._open) and self._local_names[self._open[-1]] in _PARENTS

    def _name_parent(self, title: str) -> None:
        """Name the open track or route. The name comes before its points, or after them."""
        if self._parent_name is None and title.strip():
            self._parent_name = title
            if self._parent_index >= 0:
                self._names[self._parent_index] = title

    def _enter_point(self, name: str, kind: str, attributes: list[str]) -> None:
        # Nearly all points have these two attributes in this order.
        if len(attributes) == 4 and attributes[0] == "lat" and attributes[2] == "lon":
            self._lat.texts.append(attributes[1])
            self._lon.texts.append(attributes[3])
        else:
            self._lat.texts.append(_attribute(attributes, "lat"))
            self._lon.texts.append(_attribute(attributes, "lon"))

        # The first point after the start of a track, route or segment begins a segment.
        self._row += 1
        if self._at_new_segment:
            self._begin_segment(kind)
            self._point_names.add(name)

        # Until the point ends, elements are its fields.
        self._parser.StartElementHandler = self._start_field
        self._parser.EndElementHandler = self._end_field
        self._parser.CharacterDataHandler = self._text.append

    def _begin_segment(self, kind: str) -> None:
        """Record a segment at its first point."""
        if self._parent_index < 0:
            self._parent_index = len(self._names)
            self._names.append(self._parent_name)
            # A point outside of any track or route tells by its own name which it belongs to.
            self._routes.append(
                self._parent_kind == "rte" or (not self._parent_kind and kind == "rtept")
            )
        self._parents.append(self._parent_index)
        self._starts.append(self._row)
        self._at_new_segment = False

    # Handlers for elements within points, and for the end of a point

    def _start_field(self, name: str, _attributes: list[str]) -> None:
        path = self._path
        path.append(name)
        if len(path) > _MAX_DEPTH:
            _refuse_depth()
        # The end of a child clears the flag, so an element with children is no leaf.
        self._is_leaf = True
        self._text.clear()

    def _end_field(self, name: str) -> None:
        # Only a leaf has a text to take. With no element open within the point, the point ends.
        path = self._path
        if self._is_leaf:
            # Take the text, if the element is wanted and the point has none of this name yet.
            self._is_leaf = False
            try:
                column = self._columns[path[0]][name]
            except KeyError:
                column = self._new_column(name)
            if column is not None and column.last_row != self._row:
                text = "".join(self._text)
                if text and not text.isspace():
                    column.add(self._row, text)
        elif not path:
            # The point itself ends.
            self._leave_point()
            return
        elif name in self._point_names:
            _refuse_nested(name)
        path.pop()

    def _new_column(self, name: str) -> _TextColumn | None:
        """Return the column for an element that is new there; None if it isn't wanted."""
        top, shown = _local(self._path[0]).lower(), _local(name)
        field = shown.lower()
        if field in _POINTS:
            _refuse_nested(name)

        # The text of a link is no column, and the time of an extension is not the point's time.
        column = None
        is_other_time = field == "time" and len(self._path) > 1
        if top != "link" and field not in _CONTAINERS and not is_other_time:
            self._present.setdefault(field, shown)
            column = self._fields.get(field)
        self._columns.setdefault(self._path[0], {})[name] = column
        return column

    def _leave_point(self) -> None:
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = None


class _TextColumn:
    """Texts of some points. Arrow's strings take a fifth of the memory of Python's."""

    __slots__ = ("_chunks", "last_row", "rows", "texts")

    def __init__(self) -> None:
        self.texts: list[str | None] = []
        self.rows = array("q")
        self.last_row = -1
        self._chunks: list[Any] = []

    def add(self, row: int, text: str) -> None:
        self.texts.append(text)
        self.rows.append(row)
        self.last_row = row

    def flush(self) -> None:
        chunk = pa.array(self.texts, pa.string())
        self.texts.clear()
        if (pc.max(pc.utf8_length(chunk)).as_py() or 0) > _MAX_LETTERS:
            raise RefusedError(
                f"a text of more than {_MAX_LETTERS} letters in a point", remedy="shorten it"
            )
        self._chunks.append(chunk)

    def to_column(self, count: int) -> Any:
        """Return one text for each of ``count`` points; null for those without."""
        column = pa.chunked_array(self._chunks, pa.string())
        if len(column) == count:
            return column

        # Place the texts at the rows of their points. The mask makes the other rows null.
        index = np.full(count, -1, dtype=np.int64)
        index[np.frombuffer(self.rows, dtype=np.int64)] = np.arange(len(column))
        return column.take(pa.array(index, mask=index < 0))


def _local(name: str) -> str:
    """Return a name without its prefix."""
    return name.rpartition(":")[2]


def _attribute(attributes: Sequence[str], wanted: str) -> str | None:
    pairs = zip(attributes[::2], attributes[1::2], strict=True)
    return next((value for name, value in pairs if _local(name).lower() == wanted), None)


def _refuse_depth() -> NoReturn:
    raise RefusedError(
        f"elements more than {_MAX_DEPTH} deep within each other, which no GPX file needs"
    )


def _refuse_nested(name: str) -> NoReturn:
    raise RefusedError(f"a <{name}> within a point", remedy="close each point before the next")


def _refuse_document_type(*_declaration: Any) -> NoReturn:
    raise RefusedError(
        "has a document type (<!DOCTYPE), which no GPX file needs", remedy="remove it"
    )
