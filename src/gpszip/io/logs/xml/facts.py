"""What all points of a log in XML show together, before any of them is interpreted.

Which tracks there are, which of them have times, and which columns are numbers, shows only at the
end of a file. A file that is read in batches is parsed twice: for its facts, then for its points.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.raw import HEIGHT_NAMES, Request
from gpszip.io.logs.xml.log_points import LogPoints
from gpszip.io.storage.source import Source
from gpszip.io.values.arrow import to_floats
from gpszip.io.values.coordinates import has_decimal_comma, has_decimal_point

__all__ = ["LogFacts", "fields_to_collect", "find_facts", "is_unknown_number"]

#: Names of one quantity. A request for one name is met by another that the points have.
_SYNONYMS = (
    HEIGHT_NAMES,
    ("hr", "heart_rate", "heartrate", "heartratebpm"),
    ("cad", "cadence", "runcadence"),
    ("atemp", "temperature", "temp"),
    ("power", "watts"),
)

#: Elements with the direction of travel.
_COURSES = ("course", "heading")

#: How XML writes a number that is not known.
_NAN = r"(?i)^\s*[+-]?nan\s*$"

#: Names of elements that messages show.
_MAX_SHOWN_NAMES = 20

#: First points of a batch that mostly show whether coordinates have decimal points.
_HEAD_POINTS = 100

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class LogFacts:
    """What holds for all points of a file.

    Parameters
    ----------
    ids : tuple of str
        Names of tracks and shapes; empty for a single one without a name.
    codes : int32 array, shape (s,)
        Index into them for each segment of the file.
    is_shape : bool array
        Whether each track is a shape.
    has_times : bool array, shape (p,)
        Whether each track or route of the file has times that count.
    decimal_comma : bool
        Whether coordinates have decimal commas.
    kept : mapping of str to str
        The field to keep for each name that was asked for.
    numbers : frozenset of str
        Fields to keep that are numbers.
    mixed : frozenset of str
        Those of them with texts that are no numbers.
    course : str or None
        The field that is the heading.
    present : mapping of str to str
        All fields of the file, as in :class:`LogPoints`.
    """

    ids: tuple[str, ...]
    codes: NDArray[np.int32]
    is_shape: Flags
    has_times: Flags
    decimal_comma: bool
    kept: Mapping[str, str]
    numbers: frozenset[str]
    mixed: frozenset[str]
    course: str | None
    present: Mapping[str, str]

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of the fields that are not kept."""
        used = {"time", self.course, *self.kept.values()}
        return tuple(shown for field, shown in self.present.items() if field not in used)


def fields_to_collect(request: Request) -> set[str]:
    """Return the fields of points that a request needs, by name in lower case.

    Examples
    --------
    >>> sorted(fields_to_collect(Request(keep=("power",))))
    ['power', 'time', 'watts']
    """
    names = (*request.required, *request.optional)
    wanted = {field for name in names for field in _fields_named(name)}
    return wanted | {"time", *(_COURSES if request.heading else ())}


def find_facts(batches: Iterable[LogPoints], source: Source, request: Request) -> LogFacts:
    """Find what holds for all points of a file.

    The segments of a track with times are one track. A track without any times is a shape, and so
    is each planned route. How a shape goes from one segment to the next is not known, so each
    segment becomes a separate shape.

    Parameters
    ----------
    batches : iterable of LogPoints
        All points in the order of the file; the last batch has the names of all tracks.
    source : Source
        The file, for names.
    request : Request
        The fields to keep. Other common names of them are understood (``heart_rate`` for ``hr``).

    Raises
    ------
    InputError
        If no point has a field to keep.
    """
    # Collect from all batches.
    collected = _Collected()
    for points in batches:
        collected.add(points, fields_to_collect(request) - {"time"})
        last = points

    # Tell tracks from shapes, and name both.
    has_times = np.zeros(len(last.names), np.bool_)
    has_times[list(collected.timed_parents)] = True
    has_times &= ~last.plans
    parents = np.concatenate(collected.parents)
    ids, codes, is_shape = _tracks(last.names, parents, has_times, source.stem)

    # Decide on columns.
    comma = collected.has_comma and not collected.has_point
    kept = _kept_fields(last.present, request, source.name)
    optional = _optional_fields(last.present, request, collected.known_numbers)
    fields = {*kept.values(), *optional.values()}
    numbers = frozenset(field for field in fields if comma in collected.numbers[field])
    mixed = frozenset(optional.values()) - numbers - frozenset(kept.values())
    course = next((name for name in _COURSES if name in collected.known_numbers), None)
    return LogFacts(
        ids=ids,
        codes=codes,
        is_shape=is_shape,
        has_times=has_times,
        decimal_comma=comma,
        kept=kept | optional,
        numbers=numbers | mixed,
        mixed=mixed,
        course=course if request.heading else None,
        present=last.present,
    )


def is_unknown_number(texts: Any) -> Flags:
    """Whether each text is missing, or NaN, which in XML is a number that is not known."""
    unknown: Flags = (
        pc.fill_null(pc.match_substring_regex(texts, _NAN), True)
        .to_numpy(zero_copy_only=False)
        .astype(np.bool_)
    )
    return unknown


class _Collected:
    """What batches show."""

    def __init__(self) -> None:
        self.parents: list[NDArray[np.intp]] = []  # of segments
        self.timed_parents: set[int] = set()
        self.has_comma = self.has_point = False
        # The decimal commas, true or false, with which all texts of a field are numbers.
        self.numbers: dict[str, set[bool]] = {}
        self.known_numbers: set[str] = set()  # fields with a finite number

    def add(self, points: LogPoints, fields: Iterable[str]) -> None:
        """Add the points of a batch, and of their fields those that are asked for."""
        # Segments, and tracks that have times, readable or not.
        self.parents.append(points.parents[int(points.continues) :])
        has_time = points.field("time").is_valid().to_numpy()
        self.timed_parents.update(np.unique(points.parent_of_points[has_time]).tolist())

        # A decimal point anywhere rules out decimal commas; nearly all files begin with one.
        axes = [points.lat, points.lon]
        if not self.has_point:
            head = [axis.slice(0, _HEAD_POINTS) for axis in axes]
            self.has_point = has_decimal_point(head) or has_decimal_point(axes)
        if not self.has_point:
            self.has_comma = self.has_comma or has_decimal_comma(axes)

        # Fields that are numbers.
        for name in fields:
            self._add_field(name, points.field(name))

    def _add_field(self, name: str, texts: Any) -> None:
        marks = self.numbers.setdefault(name, {False, True})
        unknown = is_unknown_number(texts)
        for comma in (False, True):
            # A field that has a number, and a text that is none, shows nothing more.
            if comma not in marks and name in self.known_numbers:
                continue
            is_finite = np.isfinite(to_floats(texts, comma))
            if is_finite.any():
                self.known_numbers.add(name)
            if not (is_finite | unknown).all():
                marks.discard(comma)


def _tracks(
    names: Sequence[str | None], parents: NDArray[np.intp], has_times: Flags, stem: str
) -> tuple[tuple[str, ...], NDArray[np.int32], Flags]:
    """Name tracks and shapes.

    Returns
    -------
    tuple of str
        Their names; empty for a single one without a name.
    int array, shape (s,)
        Index into them for each segment.
    bool array
        Whether each is a shape.
    """
    # The segments of a track with times are one track; each segment of a shape is one. Tracks are
    # numbered in the order of their first segments.
    numbers = len(names) + np.arange(len(parents))
    keys = np.where(has_times[parents], parents, numbers)
    _, first, track_of_segment = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order))
    parent_of_track = parents[first[order]]
    is_shape: Flags = ~has_times[parent_of_track]

    # A track without a name is named after the file, unless it is the only one.
    if tuple(names) == (None,):
        titles = [stem]
        is_single = len(parent_of_track) == 1
    else:
        titles = [
            f"{stem}-{number}" if name is None else name for number, name in enumerate(names, 1)
        ]
        is_single = False
    ids = _distinct_names([titles[parent] for parent in parent_of_track.tolist()])
    return () if is_single else ids, rank[track_of_segment], is_shape


def _distinct_names(names: Sequence[str]) -> tuple[str, ...]:
    """Number names that occur twice: the second ``a`` becomes ``a-2``, or the next free one."""
    # Going on from the last number keeps the search short if many tracks share a name.
    distinct: dict[str, None] = {}
    last_number: dict[str, int] = {}
    for name in names:
        new, number = name, last_number.get(name, 1)
        while new in distinct:
            number += 1
            new = f"{name}-{number}"
        last_number[name] = number
        distinct[new] = None
    return tuple(distinct)


def _fields_named(name: str) -> list[str]:
    """Return the elements that a name may stand for, itself first."""
    field = name.lower()
    synonyms = next((group for group in _SYNONYMS if field in group), ())
    return list(dict.fromkeys((field, *synonyms)))


def _kept_fields(present: Mapping[str, str], request: Request, where: str) -> dict[str, str]:
    """Return the element to keep for each name that was asked for."""
    found = {field: shown for field, shown in present.items() if field != "time"}
    kept = {}
    for name in request.required:
        field = next((field for field in _fields_named(name) if field in found), None)
        if field is None:
            names = ", ".join(list(found.values())[:_MAX_SHOWN_NAMES])
            shown = names or "position and time only"
            raise InputError(f"no {name!r} to keep", path=where, remedy=f"its points have: {shown}")
        kept[name] = field
    return kept


def _optional_fields(
    present: Mapping[str, str], request: Request, known_numbers: Set[str]
) -> dict[str, str]:
    """Return the elements to keep where points have them, and some of their texts are numbers."""
    found = {}
    for name in request.optional:
        fields = [field for field in _fields_named(name) if field in present]
        if fields and fields[0] in known_numbers:
            found[name] = fields[0]
    return found
