"""Attributes of lines: properties with a value for each position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.io.logs.geojson.json_columns import concatenate_columns
from gpszip.io.logs.raw import HEIGHT_NAMES
from gpszip.io.values.arrow import to_attribute

if TYPE_CHECKING:
    from gpszip.io.logs.geojson.features import Line

__all__ = ["find_attributes", "find_moving_attributes", "join_attributes", "split_values"]

#: Values of an attribute, a list for each line.
_ValuesOfLines = list[list[Any]]


def find_attributes(
    properties: Mapping[str, Any], keep: Sequence[str], lengths: Sequence[int]
) -> dict[str, _ValuesOfLines]:
    """Find the properties to keep among those of a feature.

    Parameters
    ----------
    properties : mapping of str to object
        The properties.
    keep : sequence of str
        Names to keep; those of heights stand for each other.
    lengths : sequence of int
        Numbers of positions of the lines.

    Returns
    -------
    dict of str to list of list
        For each name that is found, values for each line.

    Examples
    --------
    >>> find_attributes({"speed": [1, 2, 3], "crew": "B"}, ["speed", "crew", "power"], [2, 1])
    {'speed': [[1, 2], [3]], 'crew': [['B', 'B'], ['B']]}
    """
    # The tool togeojson writes `coordinateProperties`, an object with a list for each property.
    beside = properties.get("coordinateProperties")
    found: dict[str, _ValuesOfLines] = {}
    for name in keep:
        for members in (properties, beside if isinstance(beside, dict) else {}):
            key = next((key for key in _synonyms(name) if key in members), None)
            values = None if key is None else split_values(members[key], lengths)
            if values is not None:
                found.setdefault(name, values)
    return found


def find_moving_attributes(
    groups: Any, keep: Sequence[str], times: Sequence[Sequence[Any]]
) -> dict[str, _ValuesOfLines]:
    """Find the attributes to keep among the ``temporalProperties`` of MF-JSON.

    A value belongs to the positions with the same time. A position without one has null.

    Parameters
    ----------
    groups : object
        A list of objects with ``datetimes``, and for each property an object with ``values``.
    keep : sequence of str
        Names to keep; those of heights stand for each other.
    times : sequence of sequence
        The times of the positions of each line, as the file has them.

    Returns
    -------
    dict of str to list of list
        For each name that is found, values for each line.

    Examples
    --------
    >>> group = {"datetimes": [0, 20], "speed": {"values": [1.5, 2.5]}}
    >>> find_moving_attributes([group], ["speed"], [[0, 10, 20]])
    {'speed': [[1.5, None, 2.5]]}
    """
    found = {}
    listed = groups if isinstance(groups, list) else [groups]
    for name in keep:
        # Collect the values of all groups by their times.
        values: dict[Any, Any] = {}
        for group in listed:
            if not isinstance(group, dict):
                continue
            member = next((group[key] for key in _synonyms(name) if key in group), None)
            own = member.get("values") if isinstance(member, dict) else None
            moments = group.get("datetimes")
            if isinstance(own, list) and isinstance(moments, list):
                pairs = zip(moments, own, strict=False)
                values |= {moment: value for moment, value in pairs if _is_key(moment)}

        # Each position gets the value at its time.
        if values:
            found[name] = [
                [values.get(moment) if _is_key(moment) else None for moment in line]
                for line in times
            ]
    return found


def split_values(value: Any, lengths: Sequence[int]) -> _ValuesOfLines | None:
    """Assign the value of a property to the positions of lines; None if it doesn't fit.

    A list of lists has one list for each line; a flat list goes through all positions. A text or
    number holds for all of them.

    Examples
    --------
    >>> split_values([1, 2, 3], [2, 1]), split_values([1], [2]), split_values({}, [2])
    ([[1, 2], [3]], None, None)
    """
    if isinstance(value, (str, int, float)):
        return [[value] * length for length in lengths]
    if not isinstance(value, list):
        return None
    if all(isinstance(item, list) for item in value):
        return value if [len(item) for item in value] == list(lengths) else None
    if len(value) != sum(lengths):
        return None
    ends = np.cumsum(lengths, dtype=np.intp).tolist()
    return [value[end - length : end] for length, end in zip(lengths, ends, strict=True)]


def join_attributes(lines: Sequence[Line], keep: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    """Return the attributes of all lines, one after the other.

    Parameters
    ----------
    lines : sequence of Line
        The lines.
    keep : sequence of str
        Names to keep.

    Returns
    -------
    dict of str to array, shape (n,)
        Those that some line has; NaN or an empty text for positions of others.
    """
    joined = {}
    for name in keep:
        if any(name in line.attributes for line in lines):
            chunks = [line.attributes.get(name, pa.nulls(len(line.table))) for line in lines]
            joined[name] = to_attribute(concatenate_columns(chunks))
    return joined


def _synonyms(name: str) -> Sequence[str]:
    """Return the names that a property may have, the given one first."""
    return list(dict.fromkeys(chain([name], HEIGHT_NAMES if name in HEIGHT_NAMES else ())))


def _is_key(moment: Any) -> bool:
    return isinstance(moment, (str, int, float))
