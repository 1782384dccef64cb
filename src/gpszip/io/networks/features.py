"""From features with properties, as vector formats have them, to roads.

Each format reads its features into :class:`RoadFeatures`; :func:`road_lines` finds out what their
columns say of direction, speed, class and name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.crs import is_geographic, is_local, to_degrees
from gpszip.io.networks.lines import RoadLines, take_lines, within_globe
from gpszip.io.networks.rules import (
    MAX_ROAD_SPEED,
    NON_ROAD_CLASSES,
    Directions,
    clean_street_name,
    expected_speed,
    map_distinct,
    parse_directions,
    parse_speed_limit,
    road_class_speed,
    road_class_users,
)
from gpszip.io.networks.wkb import WkbLines
from gpszip.model.read_result import Repair

__all__ = ["RoadFeatures", "find_columns", "road_lines"]

#: Names of columns by what they hold, in the order of preference.
_COLUMN_NAMES = {
    "id": (
        "edge",
        "edge_id",
        "road_id",
        "way_id",
        "link_id",
        "osm_id",
        "osmid",
        "@id",
        "id",
        "linkid",
        "fid",
    ),
    "oneway": (
        "oneway",
        "one_way",
        "one-way",
        "is_oneway",
        "isoneway",
        "direction",
        "dir_travel",
        "traffic_dir",
    ),
    "limit": ("maxspeed", "max_speed", "speed_limit", "speedlimit", "limit"),
    "kmh": ("speed_kph", "speed_kmh", "kmh", "kph"),
    "speed": ("speed",),
    "class": ("highway", "fclass", "road_class", "class", "roadclass", "type"),
    "junction": ("junction",),
    "name": (
        "name",
        "street",
        "street_name",
        "streetname",
        "road_name",
        "roadname",
        "st_name",
        "full_name",
        "fullname",
        "label",
    ),
    "ref": ("ref", "road_ref", "road_number", "route"),
}

#: Roles whose columns are read as texts; the others are numbers.
_TEXT_ROLES = ("id", "oneway", "limit", "class", "junction", "name", "ref")

#: Roles of columns with speeds, with the metres per second of their unit.
_SPEED_ROLES = {"kmh": 1 / 3.6, "speed": 1.0}

#: Mean length of a line in metres below which its coordinates are degrees, whatever the file says:
#: no road is a decimetre long.
_MIN_MEAN_LENGTH = 0.1

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass
class RoadFeatures:
    """Features of a file, read batch by batch. A feature may have several lines.

    Parameters
    ----------
    points : list of float64 array
        Vertices of all lines.
    counts : list of int64 array
        Number of vertices of each line.
    rows : list of int64 array
        Feature of each line.
    columns : dict of str to list of pyarrow arrays
        Columns of the features by role.
    features : int
        Number of features.
    others : int
        Number of features that are no lines.
    """

    points: list[Floats] = field(default_factory=list)
    counts: list[Longs] = field(default_factory=list)
    rows: list[Longs] = field(default_factory=list)
    columns: dict[str, list[Any]] = field(default_factory=dict)
    features: int = 0
    others: int = 0

    def add(self, lines: WkbLines, count: int, columns: Mapping[str, Any]) -> None:
        """Add a batch of features.

        Parameters
        ----------
        lines : WkbLines
            Their lines.
        count : int
            Number of features.
        columns : mapping of str to pyarrow.Array
            Their columns by role; a batch may lack some that others have.
        """
        # Batches may differ in their columns.
        # Nulls stand for a new column in the batches before.
        for role in columns.keys() - self.columns.keys():
            self.columns[role] = [_missing(role, self.features)] if self.features else []
        for role, batches in self.columns.items():
            convert = _to_texts if role in _TEXT_ROLES else _to_numbers
            has = role in columns
            batches.append(convert(columns[role]) if has else _missing(role, count))

        # Lines.
        self.points.append(np.ascontiguousarray(lines.points))
        self.counts.append(np.diff(lines.offsets))
        self.rows.append(lines.rows + self.features)
        self.features += count
        self.others += lines.others


def _missing(role: str, count: int) -> Any:
    return pa.nulls(count, pa.string() if role in _TEXT_ROLES else pa.float64())


class _FeatureRules(NamedTuple):
    """What the columns of all features say, each of shape (n,)."""

    forward: Bools
    backward: Bools
    speeds: Floats
    users: NDArray[np.uint8]
    is_closed: Bools  # nobody may travel there


class _LogCoordinates(NamedTuple):
    """Vertices in the coordinates of the log, whether these are degrees, and what was assumed."""

    points: Floats
    geographic: bool
    repairs: tuple[Repair, ...] = ()


def road_lines(
    features: RoadFeatures,
    crs: str | None,
    name: str,
    *,
    metric: bool | None = None,
    is_geojson: bool = False,
) -> RoadLines:
    """Find the roads among features.

    Parameters
    ----------
    features : RoadFeatures
        All features of a file.
    crs : str, optional
        Its coordinate system.
    name : str
        Name of the file in messages.
    metric : bool, optional
        Whether coordinates are in x and y, as the log is; None if no log is given.
    is_geojson : bool
        Whether it is GeoJSON. This format can't say that coordinates are metres, so people write
        metres where degrees belong.

    Returns
    -------
    RoadLines
        In degrees for a log in degrees, whatever the coordinate system of the file.

    Raises
    ------
    InputError
        If there are no lines, or the file is in degrees and the log is not.
    """
    # A file without any line is no network.
    counts = np.concatenate(features.counts) if features.counts else np.empty(0, np.int64)
    if not len(counts):
        what = (
            f"{features.features:,} feature(s), but no line that can be read"
            if features.features
            else "no features"
        )
        raise InputError(
            f"holds {what}",
            path=name,
            remedy="a network needs LineStrings whose coordinates are numbers",
        )

    # Coordinates.
    points, geographic, repairs = _to_log_coordinates(
        np.concatenate(features.points),
        counts,
        crs,
        name,
        metric,
        is_geojson=is_geojson,
    )

    # Attributes of the features.
    columns = {role: pa.chunked_array(batches) for role, batches in features.columns.items()}
    rules = _find_rules(columns, features.features)
    if "id" in columns:
        ids = columns["id"].combine_chunks()
    else:
        ids = pa.array(np.arange(features.features)).cast(pa.string())

    # Attributes of their lines.
    owner = np.concatenate(features.rows)
    if features.others:
        first = int(np.setdiff1d(np.arange(features.features), owner)[0])
        value = f"feature {first}, counted from 0"
        what = "features that are no lines dropped"
        repairs = (*repairs, Repair(what, features.others, name, value=value))
    lines = RoadLines(
        name=name,
        coordinates=points,
        offsets=np.append(0, np.cumsum(counts)),
        geographic=geographic,
        forward=rules.forward[owner],
        backward=rules.backward[owner],
        speeds=rules.speeds[owner],
        users=rules.users[owner],
        ids=ids.take(pa.array(owner)),
        names=_find_street_names(columns, features.features).take(pa.array(owner)),
        directed=False if "oneway" in columns else None,
        repairs=repairs,
    )
    return _drop_closed_roads(lines, rules.is_closed[owner])


def _drop_closed_roads(lines: RoadLines, is_closed: Bools) -> RoadLines:
    if not is_closed.any():
        return lines
    kept = take_lines(lines, np.flatnonzero(~is_closed))
    what = "roads that nobody may travel dropped"
    repair = Repair(what, int(is_closed.sum()), lines.name)
    return replace(kept, repairs=(*kept.repairs, repair))


def find_columns(fields: Sequence[str]) -> dict[str, str]:
    """Return the column of each role that the file has."""
    # Of two columns with the same plain name, the first counts, so it is entered last.
    by_plain_name = {
        re.sub(r"\s+", "_", field.strip().lower()): field for field in reversed(fields)
    }
    columns = {}
    for role, names in _COLUMN_NAMES.items():
        name = next((name for name in names if name in by_plain_name), None)
        if name is not None:
            columns[role] = by_plain_name[name]
    return columns


def _to_texts(values: Any) -> Any:
    try:
        return values.cast(pa.string())
    except pa.ArrowException:
        # Some types, such as lists of texts, have no cast to text in Arrow.
        texts = [None if value is None else str(value) for value in values.to_pylist()]
        return pa.array(texts, pa.string())


def _to_numbers(values: Any) -> Any:
    try:
        return values.cast(pa.float64())
    except pa.ArrowException:
        return pa.nulls(len(values), pa.float64())


def _find_rules(columns: Mapping[str, Any], count: int) -> _FeatureRules:
    """Interpret the columns of all features; each distinct value is interpreted once."""
    # Words of each feature on direction and class; None where the file has no such column.
    oneway, junction, road_class = (
        columns[role].to_pylist() if role in columns else [None] * count
        for role in ("oneway", "junction", "class")
    )

    # Directions, found once for each combination of words.
    if "oneway" in columns or "junction" in columns or "class" in columns:
        words = [f"{a}\0{b}\0{c}" for a, b, c in zip(oneway, junction, road_class, strict=True)]
        directions = map_distinct(words, _parse_directions, np.bool_).reshape(-1, 2)
    else:
        directions = np.ones((count, 2), np.bool_)

    # Speeds and users, by class.
    typical_speeds = map_distinct(road_class, road_class_speed, np.float64)
    is_no_road = map_distinct(road_class, lambda text: text in NON_ROAD_CLASSES, np.bool_)
    return _FeatureRules(
        forward=directions[:, 0],
        backward=directions[:, 1],
        speeds=_combine_speeds(columns, typical_speeds),
        users=map_distinct(road_class, road_class_users, np.uint8),
        is_closed=is_no_road | ~directions.any(axis=1),
    )


def _parse_directions(words: str | None) -> Directions:
    """Parse the one-way rule, the junction and the class of a road, separated by zero bytes."""
    oneway, junction, road = (None if word == "None" else word for word in str(words).split("\0"))
    return parse_directions(oneway, junction=junction, road=road)


def _find_street_names(columns: Mapping[str, Any], count: int) -> Any:
    """Return the street names of all features: the name, or the number if there is none."""
    names = pa.nulls(count, pa.string())
    for role in ("name", "ref"):
        if role in columns:
            names = pc.coalesce(names, _clean_names(columns[role].combine_chunks()))
    return names


def _clean_names(texts: Any) -> Any:
    """Clean street names; each distinct text is cleaned once."""
    distinct = texts.dictionary_encode()
    names = [clean_street_name(text) for text in distinct.dictionary.to_pylist()]
    return pa.array(names, pa.string()).take(distinct.indices)


def _combine_speeds(columns: Mapping[str, Any], typical_speeds: Floats) -> Floats:
    """Return the expected speeds: those stated, else from the limit, else those of the class."""
    speeds = typical_speeds
    if "limit" in columns:
        limits = map_distinct(columns["limit"].to_pylist(), parse_speed_limit, np.float64)
        speeds = _expected_speeds(limits, typical_speeds)
    for role, unit in _SPEED_ROLES.items():
        if role in columns:
            stated = columns[role].to_numpy() * unit
            speeds = np.where((stated > 0) & (stated < MAX_ROAD_SPEED), stated, speeds)
    return speeds


def _expected_speeds(limits: Floats, typical_speeds: Floats) -> Floats:
    """Apply the rule for speeds once to each pair of a limit and a typical speed."""
    # Number both columns by themselves: of one column, np.unique merges all NaN, but no rows that
    # hold NaN.
    of_limits, limit = np.unique(limits, return_inverse=True)
    of_classes, road_class = np.unique(typical_speeds, return_inverse=True)
    pairs, index = np.unique(limit * len(of_classes) + road_class, return_inverse=True)

    # Apply the rule.
    of_pairs = [
        expected_speed(float(of_limits[i]), float(of_classes[j]))
        for i, j in zip(*np.divmod(pairs, max(len(of_classes), 1)), strict=True)
    ]
    return np.array(of_pairs, np.float64)[index]


def _to_log_coordinates(
    points: Floats,
    counts: Longs,
    crs: str | None,
    name: str,
    metric: bool | None,
    *,
    is_geojson: bool,
) -> _LogCoordinates:
    """Transform vertices to the coordinates of the log."""
    # The log is in x and y: degrees can't be turned into them.
    if metric:
        states_degrees = crs is not None and not is_geojson and is_geographic(crs, name)
        if states_degrees or (is_geojson and _looks_like_degrees(points, counts)):
            raise InputError(
                "is in degrees, but the log in x and y",
                path=name,
                remedy="convert one of them to the coordinates of the other",
            )
        return _LogCoordinates(points, False)

    # The file names no coordinate system; GeoJSON that names none is in degrees, which can't be
    # true of positions off the globe.
    is_wgs84 = crs is not None and crs.upper() in ("EPSG:4326", "OGC:CRS84")
    is_doubtful = metric is None and is_geojson and is_wgs84
    if crs is None or (is_doubtful and not within_globe(points)):
        if not within_globe(points):
            return _LogCoordinates(points, False)
        what = "coordinates without a system read as WGS84 degrees"
        return _LogCoordinates(points, True, (Repair(what, len(counts), name, drops=False),))

    # The file names a coordinate system.
    if is_wgs84:
        return _LogCoordinates(points, True)
    if is_local(crs, name):
        return _LogCoordinates(points, False)
    return _LogCoordinates(to_degrees(points, crs, name), True)


def _looks_like_degrees(points: Floats, counts: Longs) -> bool:
    """Whether lines would be shorter than any road if their coordinates were metres."""
    if not within_globe(points):
        return False
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    steps[np.cumsum(counts)[:-1] - 1] = 0.0  # from one line to the next
    return bool(np.nansum(steps) / len(counts) < _MIN_MEAN_LENGTH)
