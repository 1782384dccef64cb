"""Roads of OpenStreetMap, from PBF or XML."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError, MissingExtraError
from gpszip.io.networks.lines import RoadLines
from gpszip.io.networks.rules import NO_ROADS, class_speed, class_users, directions, expected_speed, speed_limit, street_name
from gpszip.io.networks.wkb import lines_of_wkb
from gpszip.model.read_result import Repair

__all__ = ["read_osm_lines"]

_TAGS = ("highway", "oneway", "junction", "maxspeed", "area")


@dataclass
class _Found:
    """What has been read so far, by columns."""

    geometries: list[bytes] = field(default_factory=list)
    ids: list[str] = field(default_factory=list)
    names: list[str | None] = field(default_factory=list)
    tags: list[tuple[str | None, ...]] = field(default_factory=list)
    torn: int = 0
    areas: int = 0


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
    found = _Found()
    try:
        import osmium
    except ImportError:
        raise MissingExtraError("network", "reading OpenStreetMap files") from None
    factory = osmium.geom.WKBFactory()
    try:
        for way in _ways(path, osmium):
            _add(found, way, factory, osmium)
    except (RuntimeError, ValueError, OSError, osmium.InvalidLocationError) as error:
        raise InputError(f"{name}: can't be read as OpenStreetMap data: {error}") from error
    if not found.geometries:
        raise InputError(f"{name}: holds no way with the tag 'highway', so no road")
    return _lines(found, name)


def _ways(path: str, osmium: Any) -> Iterator[Any]:
    everything = osmium.FileProcessor(path, osmium.osm.NODE | osmium.osm.WAY).with_locations()
    roads = everything.with_filter(osmium.filter.EntityFilter(osmium.osm.WAY)).with_filter(osmium.filter.KeyFilter("highway"))
    return iter(roads)


def _add(found: _Found, way: Any, factory: Any, osmium: Any) -> None:
    tags = tuple(way.tags.get(tag) for tag in _TAGS)
    if tags[0] in NO_ROADS or tags[4] == "yes":
        found.areas += 1
        return
    name = street_name(way.tags.get("name"), way.tags.get("ref"))
    try:
        stretches = [bytes.fromhex(factory.create_linestring(way))]
    except (RuntimeError, osmium.InvalidLocationError):
        stretches = list(_known_stretches(way))
        found.torn += bool(stretches)
    for geometry in stretches:
        found.geometries.append(geometry)
        found.ids.append(str(way.id))
        found.names.append(name)
        found.tags.append(tags)


def _known_stretches(way: Any) -> Iterator[bytes]:
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


def _lines(found: _Found, name: str) -> RoadLines:
    points, offsets, rows, _ = lines_of_wkb(pa.array(found.geometries, pa.large_binary()))
    kinds: dict[tuple[str | None, ...], tuple[bool, bool, float, int]] = {}
    for tags in found.tags:
        if tags not in kinds:
            kinds[tags] = _rules(tags)
    columns = list(zip(*(kinds[tags] for tags in found.tags), strict=True))
    repairs = []
    if found.torn:
        repairs.append(Repair("roads cut where the extract ends", found.torn, name, drops=False))
    if found.areas:
        repairs.append(Repair("ways that are no roads (areas, planned, gone) dropped", found.areas, name))
    return RoadLines(
        name=name,
        coordinates=points,
        offsets=offsets,
        geographic=True,
        forward=np.array(columns[0], np.bool_)[rows],
        backward=np.array(columns[1], np.bool_)[rows],
        speeds=np.array(columns[2], np.float64)[rows],
        users=np.array(columns[3], np.uint8)[rows],
        ids=pa.array(found.ids, pa.string()).take(pa.array(rows)),
        names=pa.array(found.names, pa.string()).take(pa.array(rows)),
        repairs=tuple(repairs),
    )


def _rules(tags: tuple[str | None, ...]) -> tuple[bool, bool, float, int]:
    road, oneway, junction, limit = tags[:4]
    forward, backward = directions(oneway, junction=junction, road=road)
    return forward, backward, expected_speed(speed_limit(limit), class_speed(road)), class_users(road)
