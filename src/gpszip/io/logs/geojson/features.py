"""Features of GeoJSON: the lines in one, with their names and times, and what can't be used of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.io.logs.geojson.crs import crs_problem
from gpszip.io.logs.geojson.json_columns import abbreviate, build_column

__all__ = [
    "BadPosition",
    "Feature",
    "FeatureError",
    "Line",
    "Point",
    "PropertyNames",
    "position_table",
    "read_feature",
]

#: Properties of a line that hold the times of its positions. Those of one word may also hold something else.
_TIMES = ("coordTimes", "times", "timestamps", "coordinateTimes", "time", "t")
_MAY_BE_OTHER = ("time", "t")

_ID = ("track_id", "id", "trackid", "vehicle", "vehicle_id", "trip_id", "name")

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

Floats = NDArray[np.float64]


class FeatureError(ValueError):
    """A feature that can't be used; the message says why."""


@dataclass(frozen=True)
class BadPosition:
    """A position that is dropped, as its first two items are not finite numbers.

    Parameters
    ----------
    where : str
        Such as ``feature 3, position 7``.
    value : str
        What stands there.
    """

    where: str
    value: str


@dataclass(frozen=True)
class PropertyNames:
    """The properties that hold times and names, in the order in which they are looked for."""

    times: tuple[str, ...] = _TIMES
    id: tuple[str, ...] = _ID

    @classmethod
    def of(cls, columns: Any) -> PropertyNames:
        """Return the usual ones, or those that a user names for the roles ``t`` and ``id``."""
        roles = columns if isinstance(columns, Mapping) else {}
        return cls(
            *(
                (roles[role],) if role in roles else usual
                for role, usual in (("t", _TIMES), ("id", _ID))
            )
        )


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a feature; positions that can't be read are not in it.

    Parameters
    ----------
    feature : int
        Number of the feature, counted from 1.
    name : str, optional
        Name of the track.
    table : float64 array, shape (n, 4)
        Longitude, latitude, height and fourth number of each position; NaN where there is none.
    times : pyarrow.Array of length n, optional
        As the feature has them: numbers, texts or nulls; None for a line without times.
    """

    feature: int
    name: str | None
    table: Floats
    times: Any


@dataclass(frozen=True, eq=False)
class Point:
    """A feature that is one point; its time and name are among its properties."""

    coordinates: Any
    properties: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Feature:
    """What a feature holds.

    Parameters
    ----------
    lines : tuple of Line
        Its lines with at least one position.
    point : Point, optional
        The point, if it is one.
    others : tuple of str
        What else it holds, and is left out: kinds of geometries, or ``feature without a geometry``.
    bad : int
        How many positions are dropped.
    first_bad : BadPosition, optional
        The first of them.
    """

    lines: tuple[Line, ...] = ()
    point: Point | None = None
    others: tuple[str, ...] = ()
    bad: int = 0
    first_bad: BadPosition | None = None


def read_feature(element: Any, number: int, names: PropertyNames) -> Feature:
    """Read a feature.

    Parameters
    ----------
    element : object
        A feature, or a geometry that stands for one without properties.
    number : int
        Its number, counted from 1.
    names : Names
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
    >>> feature = read_feature({"type": "Feature", "properties": {"times": [0, 1, 2]}, "geometry": line}, 3, PropertyNames())
    >>> feature.lines[0].table[:, :2].tolist(), feature.lines[0].times.to_pylist(), feature.first_bad
    ([[8.5, 47.1], [8.7, 47.3]], [0, 2], BadPosition(where='feature 3, position 2', value='[8.6, null]'))
    """
    # what it is
    if not isinstance(element, dict):
        raise FeatureError(f"is {abbreviate(element)}, not a feature")
    bare = element.get("type") in _GEOMETRIES and "geometry" not in element
    geometry = element if bare else element.get("geometry")
    found = None if bare else element.get("properties")
    properties: Mapping[str, Any] = found if isinstance(found, dict) else {}
    if geometry is None and "geometry" not in element and element.get("type") != "Feature":
        raise FeatureError(
            f"is neither a feature nor a geometry; it has: {abbreviate(list(element)[:5])[1:-1] or 'nothing'}"
        )
    if geometry is None:
        return Feature(others=("feature without a geometry",))
    if not isinstance(geometry, dict):
        raise FeatureError(f"its geometry is {abbreviate(geometry)}, not an object")
    if fault := crs_problem(element.get("crs")) or crs_problem(geometry.get("crs")):
        raise FeatureError(fault)

    # a point is a row of a table, or, with a list of one time, a track of one sample
    is_point = geometry.get("type") == "Point"
    times = _find_times(properties, names.times, strict=not is_point)
    name = _find_name(element, properties, names.id)
    if is_point and times is not None and len(times) == 1:
        return _build_lines([[geometry.get("coordinates")]], times, [], number, name)
    if is_point:
        return Feature(point=Point(geometry.get("coordinates"), properties))

    # the lines in it, and what else is in it
    coordinates: list[list[Any]] = []
    others = []
    for kind, value in _geometries(geometry):
        if kind == "LineString":
            coordinates.append(_list(value, kind))
        elif kind == "MultiLineString":
            coordinates += [_list(one, "MultiLineString's line") for one in _list(value, kind)]
        else:
            others.append(kind)
    if not any(coordinates) and not others and not times:
        others.append("feature without a position")
    return _build_lines(coordinates, times, others, number, name)


def position_table(positions: Sequence[Any]) -> Floats:
    """Turn positions into numbers.

    Parameters
    ----------
    positions : sequence
        Lists of numbers, as a file has them: any of them may be anything else.

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
    try:
        plain = set(map(type, positions)) <= {list} and set(
            map(type, chain.from_iterable(positions))
        ) <= {int, float}
        flat = np.fromiter(chain.from_iterable(positions), np.float64) if plain else None
    except OverflowError:  # an integer beyond all floats
        flat = None
    if flat is None:
        table[:] = [_position_row(position) for position in positions]
    else:
        lengths = np.fromiter(map(len, positions), np.intp, len(positions))
        starts = np.cumsum(lengths) - lengths
        for column in range(_WIDTH):
            has = lengths > column
            table[has, column] = flat[starts[has] + column]
    table[~np.isfinite(table)] = np.nan
    return table


def _build_lines(
    coordinates: list[list[Any]],
    times: list[Any] | None,
    others: list[str],
    number: int,
    name: str | None,
) -> Feature:
    """Make the lines, each with its times and without its positions that can't be read."""
    parts = (
        [None] * len(coordinates)
        if times is None
        else _split_times(times, [len(line) for line in coordinates])
    )
    lines: list[Line] = []
    bad, first_bad = 0, None
    for index, (positions, own) in enumerate(zip(coordinates, parts, strict=True)):
        if not positions:
            continue

        # positions that are none
        table = position_table(positions)
        good = np.isfinite(table[:, :2]).all(axis=1)
        if not good.all():
            at = int(good.argmin())
            line = f", line {index + 1}" if len(coordinates) > 1 else ""
            first_bad = first_bad or BadPosition(
                f"feature {number}{line}, position {at + 1}", abbreviate(positions[at])
            )
            bad += int((~good).sum())

        # the times of the others
        if own is not None:
            times_of = build_column(own)
        elif np.isfinite(table[good, 3]).any():
            times_of = pa.array(table[:, 3])
        elif any(isinstance(position, list) and len(position) > 3 for position in positions):
            raise FeatureError(
                f"no fourth number of its positions is a time, such as {abbreviate(positions[0])}"
            )
        else:
            times_of = None
        if good.any():
            lines.append(
                Line(
                    number,
                    name,
                    table[good],
                    None if times_of is None else times_of.filter(pa.array(good)),
                )
            )
    if first_bad is not None and not lines:
        raise FeatureError(
            f"none of its {bad} positions is a longitude and a latitude, such as {first_bad.value}"
        )
    return Feature(tuple(lines), None, tuple(others), bad, first_bad)


def _position_row(position: Any) -> list[float]:
    items = position[:_WIDTH] if isinstance(position, list) else []
    return [*map(_number, items), *[math.nan] * (_WIDTH - len(items))]


def _number(value: Any) -> float:
    try:
        return float(value) if type(value) in (int, float) else math.nan
    except OverflowError:
        return math.nan


def _geometries(geometry: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Kind and coordinates of a geometry, or of those in a collection, however deep."""
    waiting: list[Any] = [geometry]
    while waiting:
        one = waiting.pop()
        if isinstance(one, dict) and one.get("type") == "GeometryCollection":
            waiting += reversed(_list(one.get("geometries"), "GeometryCollection"))
        elif isinstance(one, dict):
            kind = one.get("type")
            yield (
                (kind, one.get("coordinates"))
                if kind in _GEOMETRIES
                else (f"geometry of type {abbreviate(kind)}", None)
            )
        elif one is not None:
            raise FeatureError(f"its GeometryCollection holds {abbreviate(one)}, not a geometry")


def _list(value: Any, kind: str) -> list[Any]:
    """Coordinates, of which null are none."""
    if value is None:
        return []
    if not isinstance(value, list):
        raise FeatureError(f"its {kind} holds {abbreviate(value)}, not a list")
    return value


def _find_times(
    properties: Mapping[str, Any], names: Sequence[str], *, strict: bool
) -> list[Any] | None:
    """The list of times, if there is one that holds something else than null; strictly, names of times hold no other value."""
    beside = properties.get("coordinateProperties")
    for place in (properties, beside if isinstance(beside, dict) else {}):
        for name in names:
            value = place.get(name)
            if isinstance(value, list):
                return None if value and _all_null(value) else value
            if strict and value is not None and name not in _MAY_BE_OTHER:
                raise FeatureError(
                    f"its {name!r} is {abbreviate(value)}, not a list with a time for each position"
                )
    return None


def _all_null(times: list[Any]) -> bool:
    flat = chain.from_iterable(one if isinstance(one, list) else (one,) for one in times)
    return set(map(type, flat)) <= {type(None)}


def _split_times(times: list[Any], lengths: list[int]) -> list[list[Any]]:
    """Give each line its times: a list of lists has one for each line, a flat one goes through all positions."""
    if times and all(isinstance(one, list) for one in times):
        if len(times) != len(lengths):
            raise FeatureError(f"has {len(lengths)} lines, but {len(times)} lists of times")
        for number, (own, length) in enumerate(zip(times, lengths, strict=True), 1):
            if len(own) != length:
                raise FeatureError(f"line {number} has {length} positions, but {len(own)} times")
        return times
    if len(times) != sum(lengths):
        raise FeatureError(f"has {sum(lengths)} positions, but {len(times)} times")
    ends = np.cumsum(lengths, dtype=np.intp).tolist()
    return [times[end - length : end] for length, end in zip(lengths, ends, strict=True)]


def _find_name(
    element: Mapping[str, Any], properties: Mapping[str, Any], names: Sequence[str]
) -> str | None:
    values = (*(properties.get(name) for name in names), element.get("id"))
    return next((str(value) for value in values if type(value) in (str, int, float)), None)
