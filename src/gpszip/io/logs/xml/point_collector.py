"""Points that are elements of their own, as in GPX and TCX, collected from the events of a parser.

Coordinates, times and all else are kept as the texts in the file.
:mod:`gpszip.io.logs.xml.interpret` interprets them, column by column.
"""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers.expat import XMLParserType

import numpy as np

from gpszip.io.logs.xml.log_points import LogPoints, TextColumn
from gpszip.io.logs.xml.parser import (
    BATCH_POINTS,
    MAX_DEPTH,
    MAX_LETTERS,
    RefusedError,
    local_name,
    parse_chunks,
    refuse_depth,
)
from gpszip.io.logs.xml.text import ReplacedBytes
from gpszip.io.storage.source import Source

__all__ = ["PointCollector", "Vocabulary", "collect_points"]


@dataclass(frozen=True, kw_only=True)
class Vocabulary:
    """Names of elements in a format, in lower case and without prefixes.

    Parameters
    ----------
    format_name : str
        Name of the format for messages.
    points : frozenset of str
        Points of tracks and routes.
    parents : frozenset of str
        Elements that hold the points of one track or route.
    plans : frozenset of str
        Of these and of points, those of planned routes.
    segment : str
        The element between a parent and its points.
    titles : frozenset of str
        Children of a parent that name it.
    waypoint : str
        A place that belongs to no track.
    containers : frozenset of str
        Children of points that hold further elements, and no text.
    no_fields : frozenset of str
        Children of points whose texts are no fields.
    renamed : mapping of str to str
        Fields by other names: by the name of the element, or by ``child/element``.
    has_attributes : bool
        Whether the position of a point is in its attributes ``lat`` and ``lon``, rather than in
        fields of these names.
    """

    format_name: str
    points: frozenset[str]
    parents: frozenset[str]
    plans: frozenset[str]
    segment: str
    titles: frozenset[str]
    waypoint: str
    containers: frozenset[str] = frozenset({"extensions"})
    no_fields: frozenset[str] = frozenset()
    renamed: Mapping[str, str] = field(default_factory=dict)
    has_attributes: bool = True


def collect_points(
    source: Source, vocabulary: Vocabulary, fields: Collection[str]
) -> tuple[PointCollector, ReplacedBytes]:
    """Collect the points of a file.

    Elements are known by their names, in upper or lower case. Prefixes and namespaces don't matter.

    Parameters
    ----------
    source : Source
        The file or stream.
    vocabulary : Vocabulary
        Names of elements.
    fields : collection of str
        Elements of points to collect, by name in lower case, children of the points or deeper
        within them. If a point has several of one name, the first one that isn't blank counts.

    Returns
    -------
    PointCollector
        With all points.
    ReplacedBytes
        Bytes that don't fit the encoding of the file.

    Raises
    ------
    InputError
        If the file is not well-formed XML, has a document type, or goes beyond a limit.
    """
    chunks = parse_chunks(
        source, lambda parser: PointCollector(parser, vocabulary, fields), vocabulary.format_name
    )
    [parsed] = deque(chunks, maxlen=1)
    return parsed


class PointCollector:
    """Handles the events of a parser and collects the points.

    Nearly all events happen within points. So there are two sets of handlers: one for elements
    around points, and one for elements within them, which does as little as it can.

    Parameters
    ----------
    parser : expat parser
        It must give attributes in order and join the pieces of texts.
    vocabulary : Vocabulary
        Names of elements.
    fields : collection of str
        Elements of points to collect, by name in lower case.
    in_batches : bool
        Whether points are to be taken out of ``batches`` while the file is parsed.

    Attributes
    ----------
    waypoints : int
        Number of waypoints, which belong to no track and no route.
    repeated_positions : int
        Number of positions after the first one of a point.
    batches : list of LogPoints
        Complete batches, to be taken out; none unless points come in batches.
    """

    def __init__(
        self,
        parser: XMLParserType,
        vocabulary: Vocabulary,
        fields: Collection[str],
        *,
        in_batches: bool = False,
    ) -> None:
        # Columns of the points so far, and the text and row of the current point.
        self._parser = parser
        self._vocabulary = vocabulary
        self._wanted = tuple(fields)
        self._present: dict[str, str] = {}
        self._text: list[str] = []
        self._begin_columns()

        # Batches.
        self.batches: list[LogPoints] = []
        self._last_row = BATCH_POINTS - 1 if in_batches else None  # it completes a batch
        self._rows_before = 0
        self._continues = False

        # Around points: the open elements, and the open track or route. A track gets its index with
        # its first point, so that tracks without points don't count.
        self._open: list[str] = []
        self._local_names: dict[str, str] = {}
        self._parent_kind = ""
        self._parent_name: str | None = None
        self._parent_index = -1
        self._at_new_segment = True
        self._names: list[str | None] = []
        self._plans: list[bool] = []
        self.waypoints = 0
        self.repeated_positions = 0

        # Within a point: the open elements, and whether the innermost one is a leaf so far. A
        # column is found by the outermost element, then by the innermost.
        self._path: list[str] = []
        self._is_leaf = False
        self._point_names: set[str] = set()
        self._leave_point()

    def _begin_columns(self) -> None:
        """Begin columns without rows; they are found by the elements of points once more."""
        self._lat, self._lon = TextColumn(), TextColumn()
        self._fields = {name: TextColumn() for name in self._wanted}
        self._positions = {"lat": self._lat, "lon": self._lon}
        self._columns: dict[str, dict[str, TextColumn | None]] = {}
        self._row = -1
        self._parents, self._starts = array("q"), array("q")

    @property
    def count(self) -> int:
        """Number of points so far."""
        return self._rows_before + self._row + 1

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
        if sum(map(len, self._text)) > MAX_LETTERS:
            raise RefusedError(f"a text of more than {MAX_LETTERS} letters", remedy="shorten it")

    def finish(self) -> LogPoints:
        """Return all points; those of the last batch if they come in batches."""
        count = self._row + 1
        present = self._fields.keys() & self._present.keys()
        return LogPoints(
            lat=self._lat.to_column(count),
            lon=self._lon.to_column(count),
            fields={name: self._fields[name].to_column(count) for name in present},
            present=self._present,
            names=tuple(self._names),
            plans=np.array(self._plans, dtype=np.bool_),
            parents=np.array(self._parents, dtype=np.intp),
            starts=np.array(self._starts, dtype=np.intp),
            continues=self._continues,
        )

    def _end_batch(self) -> None:
        """Complete a batch before the next point; its segment may go on in the next batch."""
        self.flush()
        self.batches.append(self.finish())
        self._rows_before += self._row + 1
        self._begin_columns()
        self._continues = not self._at_new_segment
        if self._continues:
            self._parents.append(self._parent_index)
            self._starts.append(0)

    # Handlers for elements around points

    def _start(self, name: str, attributes: list[str]) -> None:
        # A point gets handlers of its own.
        # Files have few different names, so each is normalised once.
        kind = self._local_names.get(name) or self._local_names.setdefault(
            name, local_name(name).lower()
        )
        words = self._vocabulary
        if kind in words.points:
            self._enter_point(name, kind, attributes)
            return

        # Other elements change what the next points belong to.
        if kind in words.parents:
            self._begin_parent(kind)
        elif kind == words.segment:
            self._at_new_segment = True
        elif kind == words.waypoint:
            self.waypoints += 1
        elif self._is_title(kind):
            self._text.clear()
            self._parser.CharacterDataHandler = self._text.append

        # Record the open element, and refuse nesting that no log needs.
        self._open.append(name)
        if len(self._open) > MAX_DEPTH:
            refuse_depth()

    def _end(self, name: str) -> None:
        # Expat refuses tags that don't match, so the innermost element is the one that ends.
        self._open.pop()
        kind = self._local_names[name]
        if kind in self._vocabulary.parents:
            self._begin_parent("")  # points from here on are outside of any track
        elif kind == self._vocabulary.segment:
            self._at_new_segment = True
        elif self._is_title(kind):
            self._parser.CharacterDataHandler = None
            self._name_parent("".join(self._text))

    def _begin_parent(self, kind: str) -> None:
        self._parent_kind, self._parent_name, self._parent_index = kind, None, -1
        self._at_new_segment = True

    def _is_title(self, kind: str) -> bool:
        """Whether an element is the name of a track or route, rather than of something else."""
        words = self._vocabulary
        if kind not in words.titles or not self._open:
            return False
        return self._local_names[self._open[-1]] in words.parents

    def _name_parent(self, title: str) -> None:
        """Name the open track or route. The name comes before its points, or after them."""
        if self._parent_name is None and title.strip():
            self._parent_name = title
            if self._parent_index >= 0:
                self._names[self._parent_index] = title

    def _enter_point(self, name: str, kind: str, attributes: list[str]) -> None:
        if self._row == self._last_row:
            self._end_batch()

        # Nearly all points of GPX have these two attributes in this order.
        if not self._vocabulary.has_attributes:
            pass
        elif len(attributes) == 4 and attributes[0] == "lat" and attributes[2] == "lon":
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
            self._plans.append((self._parent_kind or kind) in self._vocabulary.plans)
        self._parents.append(self._parent_index)
        self._starts.append(self._row)
        self._at_new_segment = False

    # Handlers for elements within points, and for the end of a point

    def _start_field(self, name: str, _attributes: list[str]) -> None:
        path = self._path
        path.append(name)
        if len(path) > MAX_DEPTH:
            refuse_depth()
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
            if column is not None:
                text = "".join(self._text)
                if not text or text.isspace():
                    pass
                elif column.last_row != self._row:
                    column.add(self._row, text)
                elif column is self._lat:
                    self.repeated_positions += 1
        elif not path:
            # The point itself ends.
            self._leave_point()
            return
        elif name in self._point_names:
            _refuse_nested(name)
        path.pop()

    def _new_column(self, name: str) -> TextColumn | None:
        """Return the column for an element that is new there; None if it isn't wanted."""
        words = self._vocabulary
        top, shown = local_name(self._path[0]).lower(), local_name(name)
        field = shown.lower()
        if field in words.points:
            _refuse_nested(name)

        # Some fields go by another name.
        renamed = words.renamed.get(f"{top}/{field}") or words.renamed.get(field)
        if renamed is not None:
            field = shown = renamed

        # The text of a link is no column, and the time of an extension is not the point's time.
        column = None
        is_other_time = field == "time" and len(self._path) > 1
        if not words.has_attributes and field in self._positions:
            column = self._positions[field]
        elif not (top in words.no_fields or field in words.containers or is_other_time):
            self._present.setdefault(field, shown)
            column = self._fields.get(field)
        self._columns.setdefault(self._path[0], {})[name] = column
        return column

    def _leave_point(self) -> None:
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = None


def _attribute(attributes: Sequence[str], wanted: str) -> str | None:
    pairs = zip(attributes[::2], attributes[1::2], strict=True)
    return next((value for name, value in pairs if local_name(name).lower() == wanted), None)


def _refuse_nested(name: str) -> NoReturn:
    raise RefusedError(f"a <{name}> within a point", remedy="close each point before the next")
