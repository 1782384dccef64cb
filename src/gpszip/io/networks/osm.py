"""Roads of OpenStreetMap, from PBF or XML."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError, MissingExtraError
from gpszip.io.networks.lines import RoadLines
from gpszip.io.networks.rules import (
    NON_ROAD_CLASSES,
    clean_street_name,
    expected_speed,
    parse_directions,
    parse_speed_limit,
    road_class_speed,
    road_class_users,
)
from gpszip.io.networks.wkb import parse_wkb_lines
from gpszip.model.read_result import Repair

__all__ = ["read_osm_lines"]

_TAGS = ("highway", "oneway", "junction", "maxspeed", "area")


@dataclass
class _WaysRead:
    """What has been read so far, by columns."""

    geometries: list[bytes] = field(default_factory=list)
    ids: list[str] = field(default_factory=list)
    names: list[str | None] = field(default_factory=list)
    tags: list[tuple[str | None, ...]] = field(default_factory=list)
    incomplete: int = 0
    skipped: int = 0


def read_osm_lines(path: str, name: str) -> RoadLines:
    """Read the ways with ``highway`` of an extract.

    Parameters
    ----------
    path : str
        ``.osm.pbf``, ``.osm``, ``.osm.gz`` or ``.osm.bz2``.
    name : str
        What to call it in messages.

    Returns
    -------
    RoadLines
        Where an extract ends, ways end with the last node that it holds.

    Raises
    ------
    MissingExtraError
        If osmium is not installed.
    InputError
        If it can't be read, or holds no road.
    """
    ways_read = _WaysRead()
    try:
        import osmium
    except ImportError:
        raise MissingExtraError("network", "reading OpenStreetMap files") from None
    factory = osmium.geom.WKBFactory()
    try:
        for way in _iterate_ways(path, osmium):
            _add_way(ways_read, way, factory, osmium)
    except (RuntimeError, ValueError, OSError, osmium.InvalidLocationError) as error:
        raise InputError(f"{name}: can't be read as OpenStreetMap data: {error}") from error
    if not ways_read.geometries:
        raise InputError(f"{name}: holds no way with the tag 'highway', so no road")
    return _to_road_lines(ways_read, name)


def _iterate_ways(path: str, osmium: Any) -> Iterator[Any]:
    everything = osmium.FileProcessor(path, osmium.osm.NODE | osmium.osm.WAY).with_locations()
    roads = everything.with_filter(osmium.filter.EntityFilter(osmium.osm.WAY)).with_filter(
        osmium.filter.KeyFilter("highway")
    )
    return iter(roads)


def _add_way(ways_read: _WaysRead, way: Any, factory: Any, osmium: Any) -> None:
    tags = tuple(way.tags.get(tag) for tag in _TAGS)
    if tags[0] in NON_ROAD_CLASSES or tags[4] == "yes":
        ways_read.skipped += 1
        return
    name = clean_street_name(way.tags.get("name"), way.tags.get("ref"))
    try:
        stretches = [bytes.fromhex(factory.create_linestring(way))]
    except (RuntimeError, osmium.InvalidLocationError):
        stretches = list(_located_runs(way))
        ways_read.incomplete += bool(stretches)
    for geometry in stretches:
        ways_read.geometries.append(geometry)
        ways_read.ids.append(str(way.id))
        ways_read.names.append(name)
        ways_read.tags.append(tags)


def _located_runs(way: Any) -> Iterator[bytes]:
    """Runs of nodes whose places the extract holds."""
    run: list[tuple[float, float]] = []
    for node in [*way.nodes, None]:
        if node is not None and node.location.valid():
            run.append((node.location.lon, node.location.lat))
            continue
        if len(run) > 1:
            head = b"\x01" + np.array([2, len(run)], "<u4").tobytes()
            yield head + np.array(run, "<f8").tobytes()
        run = []


def _to_road_lines(ways_read: _WaysRead, name: str) -> RoadLines:
    points, offsets, rows, _ = parse_wkb_lines(pa.array(ways_read.geometries, pa.large_binary()))
    kinds: dict[tuple[str | None, ...], tuple[bool, bool, float, int]] = {}
    for tags in ways_read.tags:
        if tags not in kinds:
            kinds[tags] = _parse_rules(tags)
    columns = list(zip(*(kinds[tags] for tags in ways_read.tags), strict=True))
    repairs = []
    if ways_read.incomplete:
        repairs.append(
            Repair("roads cut where the extract ends", ways_read.incomplete, name, drops=False)
        )
    if ways_read.skipped:
        repairs.append(
            Repair("ways that are no roads (areas, planned, gone) dropped", ways_read.skipped, name)
        )
    return RoadLines(
        name=name,
        coordinates=points,
        offsets=offsets,
        geographic=True,
        forward=np.array(columns[0], np.bool_)[rows],
        backward=np.array(columns[1], np.bool_)[rows],
        speeds=np.array(columns[2], np.float64)[rows],
        users=np.array(columns[3], np.uint8)[rows],
        ids=pa.array(ways_read.ids, pa.string()).take(pa.array(rows)),
        names=pa.array(ways_read.names, pa.string()).take(pa.array(rows)),
        repairs=tuple(repairs),
    )


def _parse_rules(tags: tuple[str | None, ...]) -> tuple[bool, bool, float, int]:
    road, oneway, junction, limit = tags[:4]
    forward, backward = parse_directions(oneway, junction=junction, road=road)
    return (
        forward,
        backward,
        expected_speed(parse_speed_limit(limit), road_class_speed(road)),
        road_class_users(road),
    )
