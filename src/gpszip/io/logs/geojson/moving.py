"""Moving features in JSON (OGC 19-045r3): positions and times of MovingPoint objects.

There are three ways to write them. A trajectory is a feature whose line has ``datetimes`` among its
properties; it is read as any feature. A prism is a feature with a ``temporalGeometry``. A
MovingPoint may also stand by itself, as MobilityDB writes it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

__all__ = ["MovingLines", "find_moving", "is_moving"]

#: Types of moving points: of the standard, and of MobilityDB.
_POINTS = ("MovingPoint", "MovingGeomPoint", "MovingGeogPoint")

#: Type of an object that holds several, and its member.
_COLLECTION, _MEMBERS = "MovingGeometryCollection", "prisms"

#: Prefix of all types of moving geometries.
_PREFIX = "Moving"


class MovingLines(NamedTuple):
    """The lines of moving points, not checked yet.

    Parameters
    ----------
    coordinates : list
        The positions of each line.
    times : list
        The times of each line.
    others : list of str
        What else there is, such as moving polygons.
    references : list
        Members that name coordinate systems.
    """

    coordinates: list[Any]
    times: list[Any]
    others: list[str]
    references: list[Any]


def is_moving(element: Mapping[str, Any]) -> bool:
    """Whether an object is a prism, or a moving geometry by itself.

    Examples
    --------
    >>> is_moving({"type": "MovingPoint"}), is_moving({"type": "Feature", "geometry": None})
    (True, False)
    """
    return isinstance(element.get("temporalGeometry"), (dict, list)) or _is_geometry(element)


def find_moving(element: Mapping[str, Any]) -> MovingLines:
    """Find the lines of an object.

    Parameters
    ----------
    element : mapping of str to object
        A prism, or a moving geometry by itself.

    Examples
    --------
    >>> point = {"type": "MovingPoint", "coordinates": [[8, 50], [8, 51]], "datetimes": [0, 9]}
    >>> find_moving({"type": "Feature", "temporalGeometry": point})[:2]
    ([[[8, 50], [8, 51]]], [[0, 9]])
    """
    found = MovingLines([], [], [], [element.get("crs")])
    for geometry in _geometries(element if _is_geometry(element) else element["temporalGeometry"]):
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        if kind not in _POINTS:
            is_named = isinstance(kind, str) and kind.startswith(_PREFIX)
            found.others.append(str(kind) if is_named else "moving geometry of unknown type")
            continue

        # MobilityDB writes a sequence for each line if there are several.
        found.references.append(geometry.get("crs"))
        sequences = geometry.get("sequences")
        for part in sequences if isinstance(sequences, list) else [geometry]:
            coordinates, times = _coordinates_and_times(part)
            found.coordinates.append(coordinates)
            found.times.append(times)
    return found


def _is_geometry(element: Mapping[str, Any]) -> bool:
    kind = element.get("type")
    return isinstance(kind, str) and kind.startswith(_PREFIX)


def _geometries(geometry: Any) -> Iterator[Any]:
    """Yield the geometries in lists and collections, however deep, in the order of the file."""
    waiting = [geometry]
    while waiting:
        current = waiting.pop()
        if isinstance(current, list):
            waiting += reversed(current)
        elif isinstance(current, dict) and current.get("type") == _COLLECTION:
            members = current.get(_MEMBERS)
            waiting.append(members if isinstance(members, list) else [members])
        else:
            yield current


def _coordinates_and_times(part: Any) -> tuple[Any, Any]:
    """Return positions and times; one position by itself becomes a list of one."""
    members = part if isinstance(part, dict) else {}
    coordinates, times = members.get("coordinates"), members.get("datetimes")
    is_single = isinstance(coordinates, list) and not any(
        isinstance(item, list) for item in coordinates
    )
    if is_single and coordinates:
        coordinates = [coordinates]
    return coordinates, times if isinstance(times, list) or times is None else [times]
