"""Tracks, points and lines of a KML file, collected from the events of an XML parser.

A placemark is interpreted when it ends, since its name, times and further data may stand before or
after its geometry. Coordinates and times are stored as texts, chunk by chunk.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import NamedTuple
from xml.parsers.expat import XMLParserType

from gpszip.io.logs.kml.coordinates import cut_positions
from gpszip.io.logs.kml.rows import RowTable, TextRows, join_points
from gpszip.io.logs.kml.tracks import Track
from gpszip.io.logs.xml.log_points import LogPoints
from gpszip.io.logs.xml.parser import (
    BATCH_POINTS,
    MAX_DEPTH,
    MAX_LETTERS,
    RefusedError,
    local_name,
    refuse_depth,
)

__all__ = ["Item", "KmlCollector", "Notes"]

#: Elements that hold placemarks.
_CONTAINERS = frozenset({"document", "folder"})

#: Geometries whose positions follow each other.
_LINES = frozenset({"linestring", "linearring"})

#: Values of `<altitudeMode>` for heights above the ground.
_ABOVE_GROUND = frozenset({"relativetoground", "relativetoseafloor"})


class Item(NamedTuple):
    """A kind of items that are left out.

    Parameters
    ----------
    one, many : str
        What one of them and several are called.
    reason : str
        Why they are left out.
    """

    one: str
    many: str
    reason: str


#: Items that hold no track, by the element.
_ITEMS = {
    "polygon": Item("polygon", "polygons", "not a track"),
    "model": Item("model", "models", "not a track"),
    "networklink": Item("network link", "network links", "not followed"),
}

#: Items that are counted where they end.
_PLACE = Item("point without a time", "points without a time", "not a track")
_MARKER = Item(
    "point with a time", "points with a time", "beside tracks, such as a start or an end"
)
_OUTSIDE = Item("track without a placemark", "tracks without a placemark", "not read")
_EMPTY = Item("track without positions", "tracks without positions", "empty")

#: Descendants of a placemark that hold times and positions of something else.
_VIEWS = frozenset({"lookat", "camera", "region", "style", "model", "polygon"})


@dataclass
class Notes:
    """What the file has besides tracks, and what was repaired.

    Parameters
    ----------
    items : Counter of Item
        Number of items that hold no track.
    repairs : Counter of (str, bool)
        Number of points concerned, by the repair and whether it drops them.
    first : dict of str to int
        Number of the first placemark with each repair.
    """

    items: Counter[Item] = field(default_factory=Counter)
    repairs: Counter[tuple[str, bool]] = field(default_factory=Counter)
    first: dict[str, int] = field(default_factory=dict)

    def repair(self, what: str, count: int, placemark: int, *, drops: bool) -> None:
        """Note a repair, if it concerns any point."""
        if count:
            self.repairs[what, drops] += count
            self.first.setdefault(what, placemark)


@dataclass
class _Container:
    """An open document or folder; ``track`` is the index of its points, -1 before the first."""

    name: str | None = None
    track: int = -1


@dataclass
class _Placemark:
    """An open placemark."""

    name: str | None = None
    tracks: dict[str, int] = field(default_factory=dict)  # by `track` or `line`
    times: dict[str, str] = field(default_factory=dict)  # by `when`, `begin` or `end`
    data: dict[str, str] = field(default_factory=dict)
    points: list[tuple[str, bool]] = field(default_factory=list)  # and whether above the ground
    first_row: int = 0


class KmlCollector:
    """Handles the events of a parser and collects the points.

    Parameters
    ----------
    parser : expat parser
        It must give attributes in order and join the pieces of texts.
    wanted : collection of str
        Fields of points to store, by name in lower case.
    in_batches : bool
        Whether tracks and lines are to be taken out of ``batches`` while the file is parsed. A
        track is never cut.

    Attributes
    ----------
    notes : Notes
        What else the file has.
    batches : list of LogPoints
        Complete batches.
    """

    def __init__(
        self, parser: XMLParserType, wanted: Collection[str], *, in_batches: bool = False
    ) -> None:
        # What was collected so far. Points with times are a log only if there are no tracks.
        self.notes = Notes()
        self.batches: list[LogPoints] = []
        self._in_batches = in_batches
        self._rows_before = 0
        self._wanted = wanted
        self._tracks, self._points = RowTable(wanted), RowTable(wanted)

        # Where the parser is: open elements, by their names and by their local names in lower case.
        self._parser = parser
        self._open: list[str] = []
        self._kinds: list[str] = []
        self._local_names: dict[str, str] = {}
        self._text: list[str] = []
        self._ignored_depth = 0  # depth of an open element whose content doesn't count

        # Open items.
        self._containers: list[_Container] = [_Container()]
        self._placemark: _Placemark | None = None
        self._placemarks = 0
        self._track: Track | None = None
        self._line: TextRows | None = None
        self._rest = ""  # the end of a line's coordinates, which may go on
        self._above_ground = False
        self._data_name = ""

        # Handlers by element.
        self._starts: dict[str, Callable[[list[str]], None]] = {
            "placemark": self._start_placemark,
            "track": self._start_track,
            "linestring": self._start_line,
            "linearring": self._start_line,
            "point": self._start_point,
            "data": self._start_data,
            "simpledata": self._start_data,
            "simplearraydata": self._start_array,
        }
        self._starts |= dict.fromkeys(_CONTAINERS, self._start_container)
        self._ends: dict[str, Callable[[str], None]] = {
            "placemark": self._end_placemark,
            "track": self._end_track,
            "linestring": self._end_line,
            "linearring": self._end_line,
            "coord": self._end_coord,
            "when": self._end_when,
            "begin": self._end_span,
            "end": self._end_span,
            "angles": self._end_angles,
            "coordinates": self._end_coordinates,
            "altitudemode": self._end_altitude_mode,
            "name": self._end_name,
            "value": self._end_value,
            "simpledata": self._end_value,
        }
        self._ends |= dict.fromkeys(_CONTAINERS, self._end_container)
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end

    @property
    def count(self) -> int:
        """Number of points so far."""
        open_rows = 0 if self._track is None else len(self._track.coords)
        closed_rows = self._rows_before + len(self._tracks) + len(self._points)
        return closed_rows + open_rows + len(self._line or ())

    @property
    def is_point_log(self) -> bool:
        """Whether points with times are the log, since no track has times."""
        return len(self._points) > 0 and not self._tracks.is_timed

    @property
    def open_elements(self) -> tuple[str, ...]:
        """Names of the elements around points that are open, the outermost first."""
        # A point is a position in a line or in a track, or else a placemark.
        if self._line is not None:
            return tuple(self._open)
        if self._track is not None:
            return tuple(self._open[: self._kinds.index("track") + 1])
        is_within = self._placemark is not None
        return tuple(self._open[: self._kinds.index("placemark") if is_within else None])

    def flush(self) -> None:
        """Store the texts so far in little memory. Call it after each chunk of the file.

        Raises
        ------
        RefusedError
            If a text is too long.
        """
        # The coordinates of a line are one text of any length, of which complete positions are cut.
        if self._line is not None:
            if self._kinds[-1] == "coordinates":
                self._cut_line(final=False)
            self._line.flush()
        if self._track is not None:
            self._track.flush()
        self._tracks.flush()
        self._points.flush()

        # Other texts without an end would grow with each chunk.
        if sum(map(len, self._text)) + len(self._rest) > MAX_LETTERS:
            raise RefusedError(f"a text of more than {MAX_LETTERS} letters", remedy="shorten it")

    def finish(self) -> LogPoints:
        """Return all points.

        Points with times beside tracks are markers, such as of a start; they are noted.
        """
        tracks = self._tracks.finish()
        if self.is_point_log:
            return join_points(tracks, self._points.finish())
        if len(self._points):
            self.notes.items[_MARKER] += len(self._points)
        return tracks

    # Events

    def _start(self, name: str, attributes: list[str]) -> None:
        # Files have few different names, so each is normalised once.
        kind = self._local_names.get(name) or self._local_names.setdefault(
            name, local_name(name).lower()
        )
        self._open.append(name)
        self._kinds.append(kind)
        if len(self._open) > MAX_DEPTH:
            refuse_depth()

        # Only what a placemark or a container holds itself counts; a track may have a model.
        if kind in _ITEMS and not self._ignored_depth and self._track is None:
            self.notes.items[_ITEMS[kind]] += 1
        if not self._ignored_depth and (kind in _VIEWS or kind == "networklink"):
            self._ignored_depth = len(self._open)
        if self._ignored_depth:
            return
        handler = self._starts.get(kind)
        if handler is not None:
            handler(attributes)

        # Collect the text of elements that have one.
        if kind in self._ends:
            self._text.clear()
            self._parser.CharacterDataHandler = self._text.append

    def _end(self, _name: str) -> None:
        # Expat refuses tags that don't match, so the innermost element is the one that ends.
        if self._ignored_depth:
            self._ignored_depth *= self._ignored_depth != len(self._open)
            self._close()
            return
        handler = self._ends.get(self._kinds[-1])
        if handler is not None:
            handler("".join(self._text))
            self._text.clear()
            self._parser.CharacterDataHandler = None
        self._close()

    def _close(self) -> None:
        self._open.pop()
        self._kinds.pop()

    def _parent(self) -> str:
        """Local name of the element around the innermost one."""
        return self._kinds[-2] if len(self._kinds) > 1 else ""

    # Containers and names

    def _start_container(self, _attributes: list[str]) -> None:
        self._containers.append(_Container())

    def _end_container(self, _text: str) -> None:
        self._containers.pop()

    def _end_name(self, text: str) -> None:
        # Names of styles, schemas and views are none of a track.
        name = text.strip()
        if not name:
            return
        if self._parent() == "placemark" and self._placemark is not None:
            self._placemark.name = self._placemark.name or name
        elif self._parent() in _CONTAINERS:
            container = self._containers[-1]
            container.name = container.name or name
            if container.track >= 0:
                self._points.names[container.track] = container.name

    def _container_name(self) -> str | None:
        """Return the name of the innermost container that has one."""
        return next((c.name for c in reversed(self._containers) if c.name), None)

    # Placemarks

    def _start_placemark(self, _attributes: list[str]) -> None:
        self._placemark = _Placemark(first_row=len(self._tracks))
        self._placemarks += 1

    def _end_placemark(self, _text: str) -> None:
        placemark, self._placemark = self._placemark, None
        if placemark is None:
            return

        # The name and the data of a track or line may come after it.
        for index in placemark.tracks.values():
            self._tracks.names[index] = placemark.name or self._container_name()
        if placemark.tracks:
            for name, text in placemark.data.items():
                self._tracks.set_text(name, text, len(self._tracks) - placemark.first_row)

        # Points become rows, if they have a time; lines can't use one.
        if "line" in placemark.tracks and placemark.times:
            what = "times of lines not read, as they don't tell when each position was passed"
            self.notes.repair(what, 1, self._placemarks, drops=False)
        if placemark.points:
            self._add_points(placemark)

        # A batch ends with a placemark.
        if self._in_batches and len(self._tracks) >= BATCH_POINTS:
            self._rows_before += len(self._tracks)
            self.batches.append(self._tracks.end_batch())

    def _add_points(self, placemark: _Placemark) -> None:
        """Add points of the track that their container is, or note that they have no time."""
        # Find their time.
        times = placemark.times
        time = times.get("when") or times.get("begin") or times.get("end")
        if not time:
            self.notes.items[_PLACE] += len(placemark.points)
            return
        if "when" not in times:
            what = "time spans of points read as their beginnings"
            self.notes.repair(what, len(placemark.points), self._placemarks, drops=False)

        # The first point of a container begins its track.
        container, table = self._containers[-1], self._points
        if container.track < 0:
            container.track = table.begin_track(self._container_name())
        for coordinates, above_ground in placemark.points:
            if not table.continues(container.track, above_ground=above_ground):
                table.begin_segment(container.track, above_ground=above_ground)
            table.add_row(coordinates)
            table.set_text("time", time)
            if placemark.name:
                table.set_text("name", placemark.name)
            for name, text in placemark.data.items():
                table.set_text(name, text)

    def _placemark_track(self, placemark: _Placemark, kind: str) -> int:
        """Return the index of the track, or of the lines, that the placemark is."""
        if kind not in placemark.tracks:
            placemark.tracks[kind] = self._tracks.begin_track(None)
        return placemark.tracks[kind]

    def _end_when(self, text: str) -> None:
        if self._track is not None and self._parent() == "track":
            self._track.add_when(text)
        elif self._parent() == "timestamp":
            self._set_time("when", text)

    def _end_span(self, text: str) -> None:
        if self._parent() == "timespan":
            self._set_time(self._kinds[-1], text)

    def _set_time(self, kind: str, text: str) -> None:
        # Folders have times, too, which are those of what is shown.
        if self._placemark is not None and text.strip():
            self._placemark.times.setdefault(kind, text)

    # Data

    def _start_data(self, attributes: list[str]) -> None:
        self._data_name = _attribute(attributes, "name")

    def _start_array(self, attributes: list[str]) -> None:
        self._data_name = _attribute(attributes, "name")
        if self._track is not None:
            self._track.begin_array(self._data_name)

    def _end_value(self, text: str) -> None:
        is_array = self._parent() == "simplearraydata"
        if is_array and self._track is not None:
            if self._data_name.lower() in self._wanted:
                self._track.arrays[self._data_name].append(text)
        elif not is_array and self._placemark is not None and self._data_name:
            self._placemark.data.setdefault(self._data_name, text)

    # Geometries

    def _end_altitude_mode(self, text: str) -> None:
        self._above_ground = text.strip().lower() in _ABOVE_GROUND

    def _start_track(self, _attributes: list[str]) -> None:
        # A multitrack may state the altitude mode for all its tracks.
        if self._parent() != "multitrack":
            self._above_ground = False
        if self._placemark is not None:
            self._track = Track()
        else:
            self.notes.items[_OUTSIDE] += 1

    def _end_coord(self, text: str) -> None:
        if self._track is not None and self._parent() == "track":
            self._track.add_coord(text)

    def _end_angles(self, text: str) -> None:
        if self._track is not None and self._parent() == "track":
            self._track.angles.append(text)

    def _end_track(self, _text: str) -> None:
        track, self._track = self._track, None
        if track is None or self._placemark is None:
            return
        if not len(track.coords):
            self.notes.items[_EMPTY] += 1
            return
        index = self._placemark_track(self._placemark, "track")
        self._tracks.begin_segment(index, above_ground=self._above_ground)
        track.add_to(self._tracks, self._notes_repair)

    def _notes_repair(self, what: str, count: int, drops: bool) -> None:
        self.notes.repair(what, count, self._placemarks, drops=drops)

    def _start_point(self, _attributes: list[str]) -> None:
        self._above_ground = False

    def _start_line(self, _attributes: list[str]) -> None:
        self._above_ground = False
        if self._placemark is not None:
            self._line, self._rest = TextRows(), ""
        else:
            self.notes.items[_OUTSIDE] += 1

    def _end_coordinates(self, text: str) -> None:
        if self._line is not None and self._parent() in _LINES:
            self._cut_line(final=True)
        elif self._placemark is not None and self._parent() == "point":
            self._placemark.points.append((text, self._above_ground))

    def _cut_line(self, *, final: bool) -> None:
        """Take the positions of a line from its text so far."""
        assert self._line is not None
        positions, self._rest = cut_positions(self._rest + "".join(self._text), final=final)
        self._text.clear()
        self._line.extend(positions)

    def _end_line(self, _text: str) -> None:
        line, self._line = self._line, None
        if line is None or self._placemark is None:
            return
        if not len(line):
            self.notes.items[_EMPTY] += 1
            return
        index = self._placemark_track(self._placemark, "line")
        self._tracks.begin_segment(index, above_ground=self._above_ground)
        self._tracks.add_rows(line.to_column())


def _attribute(attributes: list[str], wanted: str) -> str:
    pairs = zip(attributes[::2], attributes[1::2], strict=True)
    return next((value for name, value in pairs if local_name(name) == wanted), "")
