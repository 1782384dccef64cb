"""Read roads from OpenStreetMap data, PBF or XML."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError, MissingExtraError
from gpszip.io.networks.lines import RoadLines
from gpszip.io.networks.rules import (
    MAX_ROAD_SPEED,
    NON_ROAD_CLASSES,
    RoadRules,
    clean_street_name,
    find_rules,
    parse_number,
)
from gpszip.io.networks.wkb import parse_wkb_lines
from gpszip.model.read_result import Repair

__all__ = ["read_osm_lines"]

#: Longitude and latitude.
_Position = tuple[float, float]


class _Tags(NamedTuple):
    """Tags of a way that say how it is travelled: those of OpenStreetMap, and GPSZip's speed."""

    highway: str | None
    oneway: str | None
    junction: str | None
    maxspeed: str | None
    area: str | None
    speed: str | None


#: Keys of these tags. ``gpszip map`` writes the last one: the median speed on a way in m/s.
_KEYS = ("highway", "oneway", "junction", "maxspeed", "area", "gpszip:speed")


@dataclass
class _WaysRead:
    """Columns of the ways read so far.

    Parameters
    ----------
    geometries : list of bytes
        Lines in well-known binary.
    ids : list of str
        Ids of the ways; one that gives several lines stands several times.
    names : list of str or None
        Street names.
    tags : list of _Tags
        Tags that matter.
    incomplete : int
        Number of ways with nodes that the extract doesn't hold.
    skipped : int
        Number of ways that are no roads.
    """

    geometries: list[bytes] = field(default_factory=list)
    ids: list[str] = field(default_factory=list)
    names: list[str | None] = field(default_factory=list)
    tags: list[_Tags] = field(default_factory=list)
    incomplete: int = 0
    skipped: int = 0


def read_osm_lines(path: str, name: str) -> RoadLines:
    """Read the ways of an extract that have the tag ``highway``.

    Parameters
    ----------
    path : str
        ``.osm.pbf``, ``.osm``, ``.osm.gz`` or ``.osm.bz2``.
    name : str
        Name of the file in messages.

    Returns
    -------
    RoadLines
        A way that leaves the extract ends with its last node in it. Ids may be negative, as those
        of objects that editors have not uploaded.

    Raises
    ------
    MissingExtraError
        If osmium is not installed.
    InputError
        If the file can't be read, or holds no road.
    """
    # osmium comes with an extra.
    try:
        import osmium
    except ImportError:
        raise MissingExtraError("network", "reading OpenStreetMap files") from None

    # Read way by way.
    ways_read = _WaysRead()
    factory = osmium.geom.WKBFactory()
    # Nodes with negative ids take a second pass, which starts at the first way that needs them.
    new_nodes = functools.cache(lambda: _read_new_nodes(path, osmium))
    try:
        for way in _iterate_ways(path, osmium):
            _add_way(ways_read, way, factory, new_nodes, osmium)
    except (RuntimeError, ValueError, OSError, osmium.InvalidLocationError) as error:
        raise InputError(f"can't be read as OpenStreetMap data: {error}", path=name) from error
    if not ways_read.geometries:
        raise InputError("holds no way with the tag 'highway', so no road", path=name)
    return _to_road_lines(ways_read, name)


def _iterate_ways(path: str, osmium: Any) -> Iterator[Any]:
    """Iterate over the ways with the tag ``highway``; their nodes have positions."""
    # Nodes are read for their positions only. The filters run in C++ and pass on the tagged ways.
    objects = osmium.FileProcessor(path, osmium.osm.NODE | osmium.osm.WAY).with_locations()
    ways = objects.with_filter(osmium.filter.EntityFilter(osmium.osm.WAY))
    return iter(ways.with_filter(osmium.filter.KeyFilter("highway")))


def _read_new_nodes(path: str, osmium: Any) -> dict[int, _Position]:
    """Return the positions of nodes with negative ids, which osmium doesn't look up for ways."""
    return {
        node.id: (node.location.lon, node.location.lat)
        for node in osmium.FileProcessor(path, osmium.osm.NODE)
        if node.id < 0 and node.location.valid()
    }


def _add_way(
    ways_read: _WaysRead,
    way: Any,
    factory: Any,
    new_nodes: Callable[[], dict[int, _Position]],
    osmium: Any,
) -> None:
    # Count areas and classes that are no roads, without building their geometry.
    tags = _Tags(*(way.tags.get(key) for key in _KEYS))
    if tags.highway in NON_ROAD_CLASSES or tags.area == "yes":
        ways_read.skipped += 1
        return

    # osmium makes a line only of ways whose nodes have positive ids and are all in the extract.
    try:
        geometries = [bytes.fromhex(factory.create_linestring(way))]
    except (RuntimeError, osmium.InvalidLocationError):
        positions = [_find_position(node, new_nodes) for node in way.nodes]
        geometries = list(_located_runs(positions))
        ways_read.incomplete += bool(geometries) and None in positions

    # Where the extract cuts a road into several lines, each has its id, name and tags.
    name = clean_street_name(way.tags.get("name"), way.tags.get("ref"))
    for geometry in geometries:
        ways_read.geometries.append(geometry)
        ways_read.ids.append(str(way.id))
        ways_read.names.append(name)
        ways_read.tags.append(tags)


def _find_position(node: Any, new_nodes: Callable[[], dict[int, _Position]]) -> _Position | None:
    """Return the position of a node of a way; None if the extract doesn't hold it."""
    if node.location.valid():
        return node.location.lon, node.location.lat
    return new_nodes().get(node.ref) if node.ref < 0 else None


def _located_runs(positions: Sequence[_Position | None]) -> Iterator[bytes]:
    """Yield runs of nodes whose positions the extract holds, in well-known binary."""
    # The None at the end closes the last run. A run of a single node is no line.
    run: list[_Position] = []
    for position in [*positions, None]:
        if position is not None:
            run.append(position)
            continue
        if len(run) > 1:
            # Little-endian (1), LineString (2), number of points, points.
            header = b"\x01" + np.array([2, len(run)], "<u4").tobytes()
            yield header + np.array(run, "<f8").tobytes()
        run = []


def _to_road_lines(ways_read: _WaysRead, name: str) -> RoadLines:
    # Decode all lines at once; each knows the row of its geometry, and so its tags.
    lines = parse_wkb_lines(pa.array(ways_read.geometries, pa.large_binary()))

    # Apply the rules once to each combination of tags.
    rules_by_tags: dict[_Tags, RoadRules] = {}
    for tags in ways_read.tags:
        if tags not in rules_by_tags:
            rules_by_tags[tags] = _find_way_rules(tags)
    forward, backward, speeds, users = zip(
        *(rules_by_tags[tags] for tags in ways_read.tags), strict=True
    )

    # Report cut roads, which stay, and dropped ways; assign the attributes of a road to its lines.
    repairs = []
    if ways_read.incomplete:
        what = "roads cut where the extract ends"
        repairs.append(Repair(what, ways_read.incomplete, name, drops=False))
    if ways_read.skipped:
        what = "ways that are no roads (areas, planned, gone) dropped"
        repairs.append(Repair(what, ways_read.skipped, name))
    rows = lines.rows
    return RoadLines(
        name=name,
        coordinates=lines.points,
        offsets=lines.offsets,
        geographic=True,
        forward=np.array(forward, np.bool_)[rows],
        backward=np.array(backward, np.bool_)[rows],
        speeds=np.array(speeds, np.float64)[rows],
        users=np.array(users, np.uint8)[rows],
        ids=pa.array(ways_read.ids, pa.string()).take(pa.array(rows)),
        names=pa.array(ways_read.names, pa.string()).take(pa.array(rows)),
        repairs=tuple(repairs),
    )


def _find_way_rules(tags: _Tags) -> RoadRules:
    rules = find_rules(
        road=tags.highway, oneway=tags.oneway, junction=tags.junction, limit=tags.maxspeed
    )
    # A speed that GPSZip measured on this way counts more than its limit and class.
    speed = parse_number(tags.speed)
    return rules._replace(speed=speed) if 0 < speed < MAX_ROAD_SPEED else rules
