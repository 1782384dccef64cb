"""Read roads from GeoJSON, feature by feature.

GDAL reads GeoJSON, too, but it is an extra of 100 MB, and most networks that people draw or export
are GeoJSON.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np

from gpszip.errors import InputError
from gpszip.io.logs.geojson.crs import crs_problem
from gpszip.io.logs.geojson.features import position_table
from gpszip.io.logs.geojson.json_columns import build_column
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.networks.features import RoadFeatures, find_columns, road_lines
from gpszip.io.networks.lines import RoadLines
from gpszip.io.networks.wkb import WkbLines
from gpszip.io.storage.source import Source
from gpszip.io.values.json_stream import Document, read_json

__all__ = ["read_geojson_lines"]

#: Features whose lines are converted at a time. With 65,536, the search for garbage among their
#: lists doubles the time of reading.
_BATCH_FEATURES = 1024

#: The coordinate system of GeoJSON (RFC 7946).
_DEGREES = "OGC:CRS84"

#: Texts that stand for numbers that JSON doesn't have.
_NO_NUMBERS = frozenset(["NaN", "Infinity", "-Infinity"])


def read_geojson_lines(source: Source, *, metric: bool | None = None) -> RoadLines:
    """Read the lines of a GeoJSON file, with the properties that say direction, speed and class.

    Parameters
    ----------
    source : Source
        A collection, features or geometries, also one on each line.
    metric : bool, optional
        Whether the log is in x and y; None if no log is given.

    Returns
    -------
    RoadLines
        In degrees for a log in degrees, whatever the coordinate system of the file.

    Raises
    ------
    InputError
        If it is damaged, holds no lines, or is in degrees and the log is not.
    """
    # Read the features; the members of a collection come after them.
    crs, in_metres = _DEGREES, False
    features = RoadFeatures()
    batch: list[Any] = []
    with source.open() as stream:
        for part in read_json(stream, source.name):
            if not isinstance(part, Document):
                batch.append(part.value)
            else:
                in_metres |= part.members.get("gpszip") == METRES_MEMBER["gpszip"]
                crs = _find_crs(part.members, source.name) or crs
                # A document without features is itself a feature or a geometry.
                if "features" not in part.members:
                    batch.append(part.members)
            if len(batch) >= _BATCH_FEATURES:
                _add_features(features, batch)
                batch = []
    _add_features(features, batch)
    return road_lines(
        features, crs, source.name, metric=metric or (in_metres or None), is_geojson=True
    )


def _find_crs(members: Mapping[str, Any], name: str) -> str | None:
    """Return the coordinate system that a file names, as files of the older GeoJSON 2008 may."""
    # WGS 84 has many names.
    crs = members.get("crs")
    problem = crs_problem(crs)
    if not problem:
        return None

    # Another one has a name, or can't be known.
    properties = crs.get("properties") if isinstance(crs, Mapping) else None
    system = properties.get("name") if isinstance(properties, Mapping) else None
    if not isinstance(system, str):
        raise InputError(problem, path=name)
    return system


def _add_features(features: RoadFeatures, elements: Sequence[Any]) -> None:
    """Add features to those read before."""
    # Names of properties differ from feature to feature.
    properties = [_properties(element) for element in elements]
    names = dict.fromkeys(chain.from_iterable(properties))
    columns = {
        role: build_column([values.get(name) for values in properties])
        for role, name in find_columns(list(names)).items()
    }
    features.add(_lines_of([_geometry(element) for element in elements]), len(elements), columns)


def _properties(element: Any) -> Mapping[str, Any]:
    """Return the properties of a feature, with its id, which is a member of its own."""
    properties = element.get("properties") if isinstance(element, dict) else None
    properties = properties if isinstance(properties, dict) else {}
    has_id = isinstance(element, dict) and isinstance(element.get("id"), (int, str))
    # A property of the name "id" takes precedence over the id of the feature.
    return {"id": element["id"], **properties} if has_id else properties


def _geometry(element: Any) -> Any:
    """Return the geometry of a feature; a bare geometry is its own."""
    if isinstance(element, dict) and "coordinates" not in element:
        return element.get("geometry")
    return element


def _lines_of(geometries: Sequence[Any]) -> WkbLines:
    """Return the lines of geometries; what is no line is counted."""
    # Collect the coordinates of all lines. Most batches hold sound lines only.
    rows, lines, others = _collect_lines(geometries, check=False)
    if not _are_lines(lines):
        rows, lines, others = _collect_lines(geometries, check=True)

    # Convert them at once.
    counts = np.fromiter(map(len, lines), np.int64, len(lines))
    points = position_table(list(chain.from_iterable(lines)))[:, :2]
    offsets = np.append(0, np.cumsum(counts))
    return WkbLines(points, offsets, np.array(rows, np.int64), others)


def _collect_lines(
    geometries: Sequence[Any], *, check: bool
) -> tuple[list[int], list[list[Any]], int]:
    """Collect the lines of geometries.

    Parameters
    ----------
    geometries : sequence
        Anything.
    check : bool
        Look at each line; a geometry with coordinates that are no line is none.

    Returns
    -------
    list of int
        Index of the geometry to which each line belongs.
    list of lists
        Coordinates of each line.
    int
        Number of geometries that are no lines.
    """
    rows: list[int] = []
    lines: list[list[Any]] = []
    others = 0
    for row, geometry in enumerate(geometries):
        found = _coordinates(geometry)
        if not found or (check and not all(_are_lines([line]) for line in found)):
            others += 1
        else:
            lines += found
            rows += [row] * len(found)
    return rows, lines, others


def _coordinates(geometry: Any) -> list[Any]:
    """Return the coordinates of the lines of a geometry; none for other geometries."""
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind == "LineString":
        return [geometry.get("coordinates")]
    if kind == "MultiLineString":
        lines = geometry.get("coordinates")
        return lines if isinstance(lines, list) else [None]
    return []


def _are_lines(lines: Sequence[Any]) -> bool:
    """Whether all are lists of positions: lists of at least two numbers each."""
    # Most are, which is found without a loop in Python.
    if not set(map(type, lines)) <= {list}:
        return False
    positions = list(chain.from_iterable(lines))
    if not set(map(type, positions)) <= {list} or min(map(len, positions), default=2) < 2:
        return False
    if set(map(type, chain.from_iterable(positions))) <= {int, float}:
        return True
    # Only the first two values of a position have to be numbers: heights may be anything.
    return all(_is_number(value) for position in positions for value in position[:2])


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) or (isinstance(value, str) and value in _NO_NUMBERS)
