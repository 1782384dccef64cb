"""One feature of GeoJSON: its lines with names and times, or its point, and what can't be used.

Files are not trusted: any value may be of any type. A position that is no longitude and latitude
is dropped; a feature whose structure is wrong raises :class:`FeatureError`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.io.logs.geojson.attributes import find_attributes, find_moving_attributes
from gpszip.io.logs.geojson.crs import crs_problem
from gpszip.io.logs.geojson.json_columns import abbreviate, build_column
from gpszip.io.logs.geojson.moving import find_moving, is_moving

__all__ = [
    "BadPosition",
    "Feature",
    "FeatureError",
    "Line",
    "NoFeatureError",
    "Point",
    "PropertyNames",
    "position_table",
    "read_feature",
]

#: Properties of a line that hold the times of its positions, in order of preference.
_TIMES = ("coordTimes", "times", "datetimes", "timestamps", "coordinateTimes", "time", "t")

#: Names among these that may also hold something else than a list of times.
_MAY_BE_OTHER = ("time", "t")

#: Properties that hold the name of a track, in order of preference.
_ID = (
    "track_id",
    "id",
    "trackid",
    "traj_id",
    "trajectory_id",
    "vehicle",
    "vehicle_id",
    "trip_id",
    "name",
)

_GEOMETRIES = (
    "Point",
    "MultiPoint",
    "LineString",
    "MultiLineString",
    "Polygon",
    "MultiPolygon",
    "GeometryCollection",
)

#: Numbers of a position that are read: longitude, latitude, height and, in some files, the time.
_WIDTH = 4

#: Column of the time in a table of positions.
_TIME_COLUMN = 3

#: What to do with moving features in another coordinate system.
_TRANSFORM = "where it is written, such as transform(trip, 4326) of MobilityDB"

#: Members of an object that messages show.
_MAX_SHOWN_MEMBERS = 5

Floats = NDArray[np.float64]


class FeatureError(ValueError):
    """A feature that can't be used; the message says why."""


class NoFeatureError(FeatureError):
    """An object that is no part of GeoJSON."""


@dataclass(frozen=True)
class BadPosition:
    """A position that is dropped, as its first two items are not finite numbers.

    Parameters
    ----------
    where : str
        Such as ``feature 3, position 7``.
    value : str
        The position in the file.
    """

    where: str
    value: str


@dataclass(frozen=True)
class PropertyNames:
    """The properties that hold times and names, in order of preference, and those to keep."""

    times: tuple[str, ...] = _TIMES
    id: tuple[str, ...] = _ID
    keep: tuple[str, ...] = ()

    @classmethod
    def of(cls, columns: Any, keep: tuple[str, ...] = ()) -> PropertyNames:
        """Return the names that the user gives for the roles ``t`` and ``id``, else the defaults.

        Parameters
        ----------
        columns : mapping of str to str, tuple of str, or None
            As in :class:`gpszip.io.logs.raw.Request`.
        keep : tuple of str
            Attributes to keep.
        """
        roles = columns if isinstance(columns, Mapping) else {}
        times = (roles["t"],) if "t" in roles else _TIMES
        ids = (roles["id"],) if "id" in roles else _ID
        return cls(times, ids, keep)


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a feature, without positions that can't be read.

    Parameters
    ----------
    feature : int
        Number of the feature, counted from 1.
    name : str, optional
        Name of the track.
    table : float64 array, shape (n, 4)
        Longitude, latitude, height and fourth number of each position; NaN if there is none.
    times : pyarrow.Array of length n, optional
        As the feature has them: numbers, texts or nulls; None for a line without times.
    attributes : mapping of str to pyarrow.Array of length n
        Properties to keep that have a value for each position.
    """

    feature: int
    name: str | None
    table: Floats
    times: Any
    attributes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Point:
    """A feature that is one point; its time and name are among its properties."""

    coordinates: Any
    properties: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Feature:
    """The content of a feature.

    Parameters
    ----------
    lines : tuple of Line
        Its lines with at least one position.
    point : Point, optional
        The point, if the feature is one.
    others : tuple of str
        What is left out: kinds of geometries, or ``feature without a geometry``.
    bad : int
        Number of positions that are dropped.
    first_bad : BadPosition, optional
        The first of them.
    """

    lines: tuple[Line, ...] = ()
    point: Point | None = None
    others: tuple[str, ...] = ()
    bad: int = 0
    first_bad: BadPosition | None = None


class _Members(NamedTuple):
    """The members of a feature that matter."""

    geometry: Any
    properties: Mapping[str, Any]


def read_feature(element: Any, number: int, names: PropertyNames) -> Feature:
    """Read a feature.

    1. Find its geometry and its properties.
    2. A point is a row of a table; with a list of one time, it is a track of one sample.
    3. Of other geometries, collect the lines.

    Parameters
    ----------
    element : object
        A feature, or a geometry that stands for one without properties.
    number : int
        Its number, counted from 1.
    names : PropertyNames
        Properties to look for.

    Returns
    -------
    Feature

    Raises
    ------
    FeatureError
        If it is none, or its times don't fit its positions.

    Examples
    --------
    >>> line = {"type": "LineString", "coordinates": [[8.5, 47.1], [8.6, None], [8.7, 47.3]]}
    >>> element = {"type": "Feature", "properties": {"times": [0, 1, 2]}, "geometry": line}
    >>> feature = read_feature(element, 3, PropertyNames())
    >>> feature.lines[0].table[:, :2].tolist(), feature.lines[0].times.to_pylist()
    ([[8.5, 47.1], [8.7, 47.3]], [0, 2])
    >>> feature.first_bad
    BadPosition(where='feature 3, position 2', value='[8.6, null]')
    """
    # 1. Its geometry and its properties
    if not isinstance(element, dict):
        raise FeatureError(f"is {abbreviate(element)}, not a feature")
    if is_moving(element):
        return _read_moving(element, number, names)
    geometry, properties = _find_members(element)
    if geometry is None:
        return Feature(others=("feature without a geometry",))
    if not isinstance(geometry, dict):
        raise FeatureError(f"its geometry is {abbreviate(geometry)}, not an object")
    if problem := crs_problem(element.get("crs")) or crs_problem(geometry.get("crs")):
        raise FeatureError(problem)

    # 2. A point
    is_point = geometry.get("type") == "Point"
    times = _find_times(properties, names.times, strict=not is_point)
    name = _find_name(element, properties, names.id)
    if is_point and times is not None and len(times) == 1:
        kept = find_attributes(properties, names.keep, [1])
        return _build_lines([[geometry.get("coordinates")]], times, [], number, name, kept)
    if is_point:
        return Feature(point=Point(geometry.get("coordinates"), properties))

    # 3. Lines
    coordinates: list[list[Any]] = []
    others = []
    for kind, value in _geometries(geometry):
        if kind == "LineString":
            coordinates.append(_as_list(value, kind))
        elif kind == "MultiLineString":
            lines = _as_list(value, kind)
            coordinates += [_as_list(line, "MultiLineString's line") for line in lines]
        else:
            others.append(kind)
    if not any(coordinates) and not others and not times:
        others.append("feature without a position")
    kept = find_attributes(properties, names.keep, [len(line) for line in coordinates])
    return _build_lines(coordinates, times, others, number, name, kept)


def _read_moving(element: Mapping[str, Any], number: int, names: PropertyNames) -> Feature:
    """Read a feature of MF-JSON whose positions and times are in MovingPoint objects."""
    # Its lines, which have to have times
    found = find_moving(element)
    for reference in found.references:
        if problem := crs_problem(reference, remedy=_TRANSFORM):
            raise FeatureError(problem)
    coordinates = [_as_list(line, "MovingPoint") for line in found.coordinates]
    if None in found.times:
        raise FeatureError("its MovingPoint has no 'datetimes'")

    if not any(coordinates) and not found.others:
        return Feature(others=("feature without a position",))

    # Its name, and attributes by their times
    members = element.get("properties")
    properties = members if isinstance(members, dict) else {}
    lengths = [len(line) for line in coordinates]
    kept = {
        **find_attributes(properties, names.keep, lengths),
        **find_moving_attributes(element.get("temporalProperties"), names.keep, found.times),
    }
    name = _find_name(element, properties, names.id)
    return _build_lines(coordinates, found.times, found.others, number, name, kept)


def position_table(positions: Sequence[Any]) -> Floats:
    """Turn positions into numbers.

    Parameters
    ----------
    positions : sequence
        Lists of numbers; any of them may be anything else.

    Returns
    -------
    float64 array, shape (n, 4)
        NaN for what is missing, is no number, or is not finite.

    Examples
    --------
    >>> position_table([[1, 2.5], [3, 4, 5], ["6", True], 7])[:, :3].tolist()
    [[1.0, 2.5, nan], [3.0, 4.0, 5.0], [nan, nan, nan], [nan, nan, nan]]
    """
    table = np.full((len(positions), _WIDTH), np.nan)

    # Lists of numbers are flattened, which is much faster than reading them one by one.
    numbers = _flatten(positions)
    if numbers is None:
        table[:] = [_position_row(position) for position in positions]
    else:
        # Number k of position i is at starts[i] + k, if the position has as many.
        lengths = np.fromiter(map(len, positions), np.intp, len(positions))
        starts = np.cumsum(lengths) - lengths
        for column in range(_WIDTH):
            has_number = lengths > column
            table[has_number, column] = numbers[starts[has_number] + column]

    # Python reads 1e999, which JSON allows, as infinite.
    table[~np.isfinite(table)] = np.nan
    return table


def _flatten(positions: Sequence[Any]) -> Floats | None:
    """Return all numbers of the positions; None if they are not all lists of numbers."""
    # Types are compared, as isinstance() takes True for an int.
    if not set(map(type, positions)) <= {list}:
        return None
    if not set(map(type, chain.from_iterable(positions))) <= {int, float}:
        return None
    try:
        return np.fromiter(chain.from_iterable(positions), np.float64)
    except OverflowError:  # an integer beyond all floats
        return None


def _position_row(position: Any) -> list[float]:
    items = position[:_WIDTH] if isinstance(position, list) else []
    return [*map(_to_float, items), *[math.nan] * (_WIDTH - len(items))]


def _to_float(value: Any) -> float:
    try:
        return float(value) if type(value) in (int, float) else math.nan
    except OverflowError:
        return math.nan


# Members of a feature


def _find_members(element: Mapping[str, Any]) -> _Members:
    is_geometry = element.get("type") in _GEOMETRIES and "geometry" not in element
    if is_geometry:
        return _Members(element, {})
    if "geometry" not in element and element.get("type") != "Feature":
        members = abbreviate(list(element)[:_MAX_SHOWN_MEMBERS])[1:-1] or "nothing"
        raise NoFeatureError(f"is neither a feature nor a geometry; it has: {members}")
    properties = element.get("properties")
    return _Members(element.get("geometry"), properties if isinstance(properties, dict) else {})


def _geometries(geometry: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield kind and coordinates of a geometry, or of those in a collection, however deep."""
    # Descend with a stack, not by recursion, as collections may be nested deeply. Members are
    # pushed in reverse, so that they come in the order of the file.
    waiting: list[Any] = [geometry]
    while waiting:
        current = waiting.pop()
        if current is None:
            continue
        if not isinstance(current, dict):
            raise FeatureError(
                f"its GeometryCollection holds {abbreviate(current)}, not a geometry"
            )
        kind = current.get("type")
        if kind == "GeometryCollection":
            waiting += reversed(_as_list(current.get("geometries"), "GeometryCollection"))
        elif kind in _GEOMETRIES:
            yield kind, current.get("coordinates")
        else:
            yield f"geometry of type {abbreviate(kind)}", None


def _as_list(value: Any, kind: str) -> list[Any]:
    """Return coordinates that have to be a list; null is an empty one."""
    if value is None:
        return []
    if not isinstance(value, list):
        raise FeatureError(f"its {kind} holds {abbreviate(value)}, not a list")
    return value


def _find_times(
    properties: Mapping[str, Any], names: Sequence[str], *, strict: bool
) -> list[Any] | None:
    """Return the list of times that is not all null.

    Parameters
    ----------
    properties : mapping of str to object
        The properties of the feature.
    names : sequence of str
        Names of properties that hold times.
    strict : bool
        Whether a property of such a name has to be a list, unless the name may mean something
        else.
    """
    # The tool togeojson writes `coordinateProperties`, an object with a list for each property.
    beside = properties.get("coordinateProperties")
    for members in (properties, beside if isinstance(beside, dict) else {}):
        for name in names:
            value = members.get(name)
            if isinstance(value, list):
                # Nulls alone mean that no time is known. Fourth numbers may still be times.
                return None if value and _is_all_null(value) else value
            # Any other value would turn the track into a shape without a word.
            if strict and value is not None and name not in _MAY_BE_OTHER:
                raise FeatureError(
                    f"its {name!r} is {abbreviate(value)}, not a list with a time for each position"
                )
    return None


def _is_all_null(times: list[Any]) -> bool:
    flat = chain.from_iterable(item if isinstance(item, list) else (item,) for item in times)
    return set(map(type, flat)) <= {type(None)}


def _find_name(
    element: Mapping[str, Any], properties: Mapping[str, Any], names: Sequence[str]
) -> str | None:
    # The id of the feature itself (RFC 7946, 3.2) comes after its properties.
    values = (*(properties.get(name) for name in names), element.get("id"))
    return next((str(value) for value in values if type(value) in (str, int, float)), None)


# Lines


def _build_lines(
    coordinates: list[list[Any]],
    times: list[Any] | None,
    others: list[str],
    number: int,
    name: str | None,
    attributes: Mapping[str, list[list[Any]]],
) -> Feature:
    """Build the lines of a feature.

    Parameters
    ----------
    coordinates : list of list
        Positions of each line.
    times : list, optional
        Times of the feature.
    others : list of str
        What else the feature holds.
    number : int
        Number of the feature.
    name : str, optional
        Name of the track.
    attributes : mapping of str to list of list
        Values for the positions of each line.
    """
    # Assign the times of the feature to its lines.
    line_times: Sequence[list[Any] | None] = [None] * len(coordinates)
    if times is not None:
        line_times = _split_times(times, [len(line) for line in coordinates])

    # Read each line, with its usable positions and their times.
    lines: list[Line] = []
    bad, first_bad = 0, None
    for index, (positions, own_times) in enumerate(zip(coordinates, line_times, strict=True)):
        if not positions:
            continue

        # Drop positions that can't be read.
        table = position_table(positions)
        good: NDArray[np.bool_] = np.asarray(np.isfinite(table[:, :2]).all(axis=1))
        if not good.all():
            row = int(good.argmin())
            line = f", line {index + 1}" if len(coordinates) > 1 else ""
            first_bad = first_bad or BadPosition(
                f"feature {number}{line}, position {row + 1}", abbreviate(positions[row])
            )
            bad += int((~good).sum())

        # Keep the times of the others.
        column = _times_column(positions, table, good, own_times)
        if good.any():
            mask = pa.array(good)
            kept_times = None if column is None else column.filter(mask)
            kept = {
                key: build_column(values[index]).filter(mask)
                for key, values in attributes.items()
                if len(values[index]) == len(positions)
            }
            lines.append(Line(number, name, table[good], kept_times, kept))

    # Single unreadable positions are counted, but a feature without any other can't be used.
    if first_bad is not None and not lines:
        raise FeatureError(
            f"none of its {bad} positions is a longitude and a latitude, such as {first_bad.value}"
        )
    return Feature(tuple(lines), None, tuple(others), bad, first_bad)


def _times_column(
    positions: list[Any], table: Floats, good: NDArray[np.bool_], times: list[Any] | None
) -> Any:
    """Return the times of a line: those of the feature, else the fourth numbers of positions."""
    if times is not None:
        return build_column(times)
    # RFC 7946 gives a fourth number no meaning; writers of logs put the time there.
    if np.isfinite(table[good, _TIME_COLUMN]).any():
        return pa.array(table[:, _TIME_COLUMN])
    if any(isinstance(position, list) and len(position) > _TIME_COLUMN for position in positions):
        raise FeatureError(
            f"no fourth number of its positions is a time, such as {abbreviate(positions[0])}"
        )
    return None


def _split_times(times: list[Any], lengths: list[int]) -> list[list[Any]]:
    """Split times into those of each line.

    A list of lists has one list for each line; a flat list goes through all positions.
    """
    if times and all(isinstance(item, list) for item in times):
        if len(times) != len(lengths):
            raise FeatureError(f"has {len(lengths)} lines, but {len(times)} lists of times")
        for number, (line_times, length) in enumerate(zip(times, lengths, strict=True), 1):
            if len(line_times) != length:
                raise FeatureError(
                    f"line {number} has {length} positions, but {len(line_times)} times"
                )
        return times
    if len(times) != sum(lengths):
        raise FeatureError(f"has {sum(lengths)} positions, but {len(times)} times")
    ends = np.cumsum(lengths, dtype=np.intp).tolist()
    return [times[end - length : end] for length, end in zip(lengths, ends, strict=True)]
