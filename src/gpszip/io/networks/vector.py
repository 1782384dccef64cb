"""Roads from the vector formats that GDAL reads: GeoJSON, GeoPackage, FlatGeobuf, Shapefile."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.crs import is_geographic, is_local, to_degrees
from gpszip.io.networks.lines import RoadLines, take_lines, within_globe
from gpszip.io.networks.rules import (
    NON_ROAD_CLASSES,
    clean_street_name,
    expected_speed,
    map_distinct,
    parse_directions,
    parse_speed_limit,
    road_class_speed,
    road_class_users,
)
from gpszip.io.networks.wkb import parse_wkb_lines
from gpszip.model.read_result import Repair

__all__ = ["read_vector_lines"]

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

_TEXT_ROLES = ("id", "oneway", "limit", "class", "junction", "name", "ref")


@dataclass
class _FeaturesRead:
    """Columns of what has been read so far; rows are features, lines may be several in one."""

    points: list[NDArray[np.float64]] = field(default_factory=list)
    counts: list[NDArray[np.int64]] = field(default_factory=list)
    rows: list[NDArray[np.int64]] = field(default_factory=list)
    columns: dict[str, list[Any]] = field(default_factory=dict)
    features: int = 0
    others: int = 0


def read_vector_lines(
    path: Any,
    name: str,
    *,
    metric: bool | None = None,
    metres: bool = False,
    is_geojson: bool = False,
) -> RoadLines:
    """Read the lines of a vector file, with the properties that tell direction, speed and class.

    Parameters
    ----------
    path : str or bytes
        The file, what GDAL takes for one, or what is in it.
    name : str
        What to call it in messages.
    metric : bool, optional
        Whether the log it is for is in x and y; None where it is for any.
    metres : bool
        Whether the file says that its coordinates are metres, as GPSZip's own GeoJSON does.
    is_geojson : bool
        Whether the format has no word for metres, so that people write them where degrees should be: GeoJSON.

    Returns
    -------
    RoadLines
        In degrees for a log in degrees, whatever the system of the file.

    Raises
    ------
    InputError
        If it can't be read, holds no lines, or is in degrees and the log is not.
    """
    rows, crs = _read_without_warnings(path, name, is_geojson)
    counts = np.concatenate(rows.counts) if rows.counts else np.empty(0, np.int64)
    if not len(counts):
        what = (
            f"{rows.features:,} feature(s), but no line that can be read"
            if rows.features
            else "no features"
        )
        raise InputError(
            f"{name}: holds {what}; a network needs LineStrings whose coordinates are numbers"
        )
    points = np.concatenate(rows.points)
    points, geographic, notes = _to_log_coordinates(
        points, counts, crs, name, metric or (metres or None), is_geojson=is_geojson
    )
    owner = np.concatenate(rows.rows)
    columns = {role: pa.chunked_array(parts) for role, parts in rows.columns.items()}
    forward, backward, speeds, users, closed = _parse_rules(columns, rows.features)
    if rows.others:
        first = int(np.setdiff1d(np.arange(rows.features), owner)[0])
        notes = (
            *notes,
            Repair(
                "features that are no lines dropped",
                rows.others,
                name,
                value=f"feature {first}, counted from 0",
            ),
        )
    ids = (
        columns["id"].combine_chunks()
        if "id" in columns
        else pa.array(np.arange(rows.features)).cast(pa.string())
    )
    lines = RoadLines(
        name=name,
        coordinates=points,
        offsets=np.append(0, np.cumsum(counts)),
        geographic=geographic,
        forward=forward[owner],
        backward=backward[owner],
        speeds=speeds[owner],
        users=users[owner],
        ids=ids.take(pa.array(owner)),
        names=_find_street_names(columns, rows.features).take(pa.array(owner)),
        directed=False if "oneway" in columns else None,
        repairs=notes,
    )
    return _drop_closed_roads(lines, closed[owner])


def _drop_closed_roads(lines: RoadLines, closed: NDArray[np.bool_]) -> RoadLines:
    if not closed.any():
        return lines
    kept = take_lines(lines, np.flatnonzero(~closed))
    return replace(
        kept,
        repairs=(
            *kept.repairs,
            Repair("roads that nobody may travel dropped", int(closed.sum()), lines.name),
        ),
    )


def _read_without_warnings(
    path: Any, name: str, is_geojson: bool
) -> tuple[_FeaturesRead, str | None]:
    import pyogrio

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what matters of a damaged file is said by the error
        return _read_features(pyogrio, path, name, is_geojson)


def _read_features(
    pyogrio: Any, path: Any, name: str, is_geojson: bool
) -> tuple[_FeaturesRead, str | None]:
    from pyogrio.errors import FeatureError, GeometryError

    try:
        layer = None if is_geojson else _choose_layer(pyogrio.list_layers(path).tolist())
        # all columns: to ask for their names first would read a GeoJSON twice
        with pyogrio.open_arrow(path, layer=layer, use_pyarrow=True, batch_size=65_536) as (
            meta,
            reader,
        ):
            names = _find_columns(meta["fields"].tolist())
            rows = _FeaturesRead(columns={role: [] for role in names})
            for batch in reader:
                _add_batch(rows, batch, meta["geometry_name"] or "wkb_geometry", names)
    except (
        FeatureError,
        GeometryError,
        RuntimeError,
        ValueError,
        OSError,
        pa.ArrowException,
    ) as error:
        raise InputError(
            f"{name}: can't be read as lines: {' '.join(str(error).split())[:160]}"
        ) from error
    return rows, meta["crs"]


def _choose_layer(layers: Sequence[Sequence[str | None]]) -> str | None:
    """The first layer of lines, of those that may hold them, or the first."""
    named = [(str(name), str(kind)) for name, kind in layers]
    return next(
        (name for word in ("Line", "Unknown", "") for name, kind in named if word in kind), None
    )


def _find_columns(fields: Sequence[str]) -> dict[str, str]:
    plain = {re.sub(r"\s+", "_", field.strip().lower()): field for field in reversed(fields)}
    found = {
        role: next((plain[word] for word in words if word in plain), None)
        for role, words in _COLUMN_NAMES.items()
    }
    return {role: column for role, column in found.items() if column is not None}


def _add_batch(rows: _FeaturesRead, batch: Any, geometry: str, names: dict[str, str]) -> None:
    points, offsets, own, others = parse_wkb_lines(batch.column(geometry))
    rows.points.append(np.ascontiguousarray(points))
    rows.counts.append(np.diff(offsets))
    rows.rows.append(own + rows.features)
    rows.features += batch.num_rows
    rows.others += others
    for role, column in names.items():
        values = batch.column(column)
        values.validate(full=True)  # GDAL hands on texts that are no UTF-8
        rows.columns[role].append(_to_texts(values) if role in _TEXT_ROLES else _to_numbers(values))


def _to_texts(values: Any) -> Any:
    try:
        return values.cast(pa.string())
    except pa.ArrowException:
        return pa.array(
            [None if value is None else str(value) for value in values.to_pylist()], pa.string()
        )


def _to_numbers(values: Any) -> Any:
    try:
        return values.cast(pa.float64())
    except pa.ArrowException:
        return pa.nulls(len(values), pa.float64())


def _parse_rules(columns: dict[str, Any], rows: int) -> tuple[Any, Any, Any, Any, Any]:
    nothing = [None] * rows
    oneway, junction, kind = (
        columns[role].to_pylist() if role in columns else nothing
        for role in ("oneway", "junction", "class")
    )
    if "oneway" in columns or "junction" in columns or "class" in columns:
        words = [f"{a}\0{b}\0{c}" for a, b, c in zip(oneway, junction, kind, strict=True)]
        ways = map_distinct(words, _parse_direction, np.bool_).reshape(-1, 2)
    else:
        ways = np.ones((rows, 2), np.bool_)
    typical_speed, users = (
        map_distinct(kind, road_class_speed, np.float64),
        map_distinct(kind, road_class_users, np.uint8),
    )
    closed = map_distinct(kind, lambda text: text in NON_ROAD_CLASSES, np.bool_) | ~ways.any(axis=1)
    return ways[:, 0], ways[:, 1], _combine_speeds(columns, typical_speed), users, closed


def _find_street_names(columns: dict[str, Any], rows: int) -> Any:
    """Street names of all features: the name, or the number where there is none."""
    answers = pa.nulls(rows, pa.string())
    for role in ("name", "ref"):
        if role in columns:
            answers = pc.coalesce(answers, _clean_names(columns[role].combine_chunks()))
    return answers


def _clean_names(texts: Any) -> Any:
    """Street names of texts, of which each kind is looked at once."""
    kinds = texts.dictionary_encode()
    return pa.array(
        [clean_street_name(text) for text in kinds.dictionary.to_pylist()], pa.string()
    ).take(kinds.indices)


def _parse_direction(words: str | None) -> tuple[bool, bool]:
    oneway, junction, kind = (None if word == "None" else word for word in str(words).split("\0"))
    return parse_directions(oneway, junction=junction, road=kind)


def _combine_speeds(
    columns: dict[str, Any], typical_speed: NDArray[np.float64]
) -> NDArray[np.float64]:
    speeds = typical_speed
    if "limit" in columns:
        limits = map_distinct(columns["limit"].to_pylist(), parse_speed_limit, np.float64)
        kinds = np.stack((limits, typical_speed), axis=1)
        pairs, index = np.unique(kinds, axis=0, return_inverse=True)
        speeds = np.array([expected_speed(*pair) for pair in pairs.tolist()])[index.ravel()]
    for role, unit in (("kmh", 1 / 3.6), ("speed", 1.0)):
        if role in columns:
            told = columns[role].to_numpy() * unit
            speeds = np.where((told > 0) & (told < 100), told, speeds)
    return speeds


def _to_log_coordinates(
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
    crs: str | None,
    name: str,
    metric: bool | None,
    *,
    is_geojson: bool,
) -> tuple[NDArray[np.float64], bool, tuple[Repair, ...]]:
    """Coordinates as the log has them, whether they are degrees, and what was done."""
    if metric:
        degrees = crs is not None and not is_geojson and is_geographic(crs, name)
        if degrees or (is_geojson and _looks_like_degrees(points, counts)):
            raise InputError(
                f"{name}: is in degrees, but the log in x and y; convert one of them to the coordinates of the other"
            )
        return points, False, ()
    if crs is None or (metric is None and is_geojson and not within_globe(points)):
        if within_globe(points):
            note = Repair(
                "coordinates without a system read as WGS84 degrees", len(counts), name, drops=False
            )
            return points, True, (note,)
        return points, False, ()
    if crs.upper() in ("EPSG:4326", "OGC:CRS84"):
        return points, True, ()
    if is_local(crs, name):
        return points, False, ()
    return to_degrees(points, crs, name), True, ()


def _looks_like_degrees(points: NDArray[np.float64], counts: NDArray[np.int64]) -> bool:
    """Whether roads would be shorter than anything that anybody travels, were they in metres."""
    if not within_globe(points):
        return False
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    steps[np.cumsum(counts)[:-1] - 1] = 0.0
    return bool(np.nansum(steps) / len(counts) < 0.1)
