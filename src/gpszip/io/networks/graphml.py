"""Read roads from GraphML, as osmnx and GPSZip itself write it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import BinaryIO, NamedTuple
from xml.etree.ElementTree import Element, ParseError, iterparse

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.crs import is_geographic, is_local, to_degrees
from gpszip.io.networks.lines import RoadLines, within_globe
from gpszip.io.networks.rules import (
    MAX_ROAD_SPEED,
    RoadRules,
    clean_street_name,
    find_rules,
    parse_number,
)
from gpszip.io.networks.wkb import parse_wkt_line

__all__ = ["read_graphml_lines"]

#: Attributes of edges that may hold the shape in well-known text: of osmnx, GPSZip and others.
_GEOMETRY_KEYS = ("geometry", "line", "wkt")


class _Words(NamedTuple):
    """Attributes of an edge that say how it is travelled, by their names in the file."""

    oneway: str | None
    junction: str | None
    highway: str | None
    maxspeed: str | None
    speed_kph: str | None
    speed: str | None


@dataclass
class _Graph:
    """What has been read so far.

    Parameters
    ----------
    names : dict
        Name of each key, in lower case; data refer to keys.
    attributes : dict
        Attributes of the graph by name.
    has_lon_lat : bool, optional
        Whether positions are named ``lon`` and ``lat``; None before the first node.
    directed : bool
        Whether an edge leads from its source to its target only.
    nodes : dict
        Position of each node: x or longitude, y or latitude.
    edges : list
        Source, target and attributes of each edge.
    """

    names: dict[str, str] = field(default_factory=dict)
    attributes: dict[str, str] = field(default_factory=dict)
    has_lon_lat: bool | None = None
    directed: bool = True
    nodes: dict[str, tuple[float, float]] = field(default_factory=dict)
    edges: list[tuple[str, str, dict[str, str]]] = field(default_factory=list)


def read_graphml_lines(stream: BinaryIO, name: str, *, metric: bool | None = None) -> RoadLines:
    """Read the edges of a graph.

    Nodes need ``x`` and ``y``, or ``lon`` and ``lat``. An edge is straight unless it has well-known
    text in ``geometry`` or ``line``. In a directed graph an edge may be travelled from its source
    to its target; in an undirected one both ways, unless it is ``oneway``. Speeds come from
    ``speed_kph``, ``maxspeed`` and ``highway``, or from ``speed`` in m/s; street names from
    ``name``, or ``ref``.

    Parameters
    ----------
    stream : binary file
        The file.
    name : str
        Name of the file in messages.
    metric : bool, optional
        Whether the log is in x and y; None if no log is given.

    Returns
    -------
    RoadLines

    Raises
    ------
    InputError
        If it is no GraphML, a node has no position, or an edge has no end.
    """
    graph = _Graph()
    try:
        for element in _iterate_elements(stream):
            _add_element(graph, element, name)
    # LookupError and ValueError come from unknown encodings.
    except (ParseError, LookupError, ValueError) as error:
        raise InputError(f"damaged XML: {error}", path=name) from error
    if not graph.edges:
        raise InputError("a graph without edges", path=name, remedy="a network needs some")
    return _to_road_lines(graph, name, metric)


def _iterate_elements(stream: BinaryIO) -> Iterator[Element]:
    """Yield the start of a graph, and every key, node, edge and attribute of the graph.

    Elements are dropped once they are read, so that memory stays bounded.
    """
    # Track the open elements, from the root on, to remove children that were read.
    ancestors: list[Element] = []
    for event, element in iterparse(stream, events=("start", "end")):
        if event == "start":
            ancestors.append(element)
            if element.tag.endswith("}graph"):
                yield element
            continue

        # At its end, an element is complete.
        ancestors.pop()
        if element.tag.rpartition("}")[2] in ("key", "node", "edge"):
            yield element
            element.clear()
            if ancestors:
                ancestors[-1].remove(element)
        elif element.tag.endswith("}data") and ancestors and ancestors[-1].tag.endswith("}graph"):
            yield element


def _add_element(graph: _Graph, element: Element, name: str) -> None:
    kind = element.tag.rpartition("}")[2]
    if kind == "key":
        graph.names[element.get("id", "")] = element.get("attr.name", "").lower()
    elif kind == "graph":
        graph.directed = element.get("edgedefault", "directed") == "directed"
    elif kind == "data":
        graph.attributes[graph.names.get(element.get("key", ""), "")] = element.text or ""
    elif kind == "node":
        graph.nodes[element.get("id", "")] = _read_position(graph, element, name)
    else:
        ends = element.get("source", ""), element.get("target", "")
        graph.edges.append((*ends, _read_data(graph, element)))


def _read_data(graph: _Graph, element: Element) -> dict[str, str]:
    """Return the attributes of a node or an edge by name."""
    # Data refer to a key by its id, such as "d3"; the key gives the name of the attribute.
    return {graph.names.get(data.get("key", ""), ""): data.text or "" for data in element}


def _read_position(graph: _Graph, element: Element, name: str) -> tuple[float, float]:
    data = _read_data(graph, element)
    # The first node decides for all nodes.
    if graph.has_lon_lat is None:
        graph.has_lon_lat = "lon" in data and "x" not in data
    try:
        if graph.has_lon_lat:
            return float(data["lon"]), float(data["lat"])
        return float(data["x"]), float(data["y"])
    except (KeyError, ValueError):
        raise InputError(
            f"node {element.get('id')!r} has no position",
            path=name,
            remedy="nodes need the numbers x and y, or lon and lat",
        ) from None


def _to_road_lines(graph: _Graph, name: str, metric: bool | None) -> RoadLines:
    # Interpret each edge: its shape, rules, id and street name.
    shapes, rules, ids, names = [], [], [], []
    rules_by_words: dict[_Words, RoadRules] = {}
    for number, (source, target, data) in enumerate(graph.edges):
        # Shape.
        if source not in graph.nodes or target not in graph.nodes:
            raise InputError(
                f"edge {number} leads to a node that the graph doesn't hold", path=name
            )
        shape = _read_shape(data)
        shapes.append(shape or (graph.nodes[source], graph.nodes[target]))

        # Rules, found once for each combination of attributes.
        words = _Words(*(data.get(key) for key in _Words._fields))
        if words not in rules_by_words:
            rules_by_words[words] = _find_edge_rules(words, graph.directed)
        rules.append(rules_by_words[words])

        # Id of the road in OpenStreetMap, or else the number of the edge.
        ids.append(data.get("osmid", str(number)))
        names.append(clean_street_name(data.get("name"), data.get("ref")))

    # Convert the vertices of all shapes at once to degrees, or to metres for a log in x and y.
    vertices = np.array([point for shape in shapes for point in shape])
    points, geographic = _to_log_coordinates(graph, vertices, name, metric)
    forward, backward, speeds, users = zip(*rules, strict=True)
    return RoadLines(
        name=name,
        coordinates=points,
        offsets=np.append(0, np.cumsum([len(shape) for shape in shapes])),
        geographic=geographic,
        forward=np.array(forward, np.bool_),
        backward=np.array(backward, np.bool_),
        speeds=np.array(speeds, np.float64),
        users=np.array(users, np.uint8),
        ids=pa.array(ids, pa.string()),
        names=pa.array(names, pa.string()),
    )


def _read_shape(data: Mapping[str, str]) -> tuple[tuple[float, float], ...]:
    """Return the vertices of an edge that has a shape; none of a straight one."""
    lines = (parse_wkt_line(data.get(key, "")) for key in _GEOMETRY_KEYS)
    return tuple(next((line for line in lines if line), ()))


def _find_edge_rules(words: _Words, directed: bool) -> RoadRules:
    rules = find_rules(
        road=words.highway, oneway=words.oneway, junction=words.junction, limit=words.maxspeed
    )
    # In a directed graph, the other direction is another edge.
    if directed:
        rules = rules._replace(forward=True, backward=False)
    # Speeds that osmnx estimates are in km/h, those that GPSZip measures in m/s.
    stated_speed = (
        parse_number(words.speed_kph) / 3.6 if words.speed_kph else parse_number(words.speed)
    )
    return rules._replace(speed=stated_speed) if 0 < stated_speed < MAX_ROAD_SPEED else rules


def _to_log_coordinates(
    graph: _Graph, points: NDArray[np.float64], name: str, metric: bool | None
) -> tuple[NDArray[np.float64], bool]:
    """Return the vertices in the coordinates of the log, and whether these are degrees."""
    crs = graph.attributes.get("crs", "").strip()
    in_degrees = is_geographic(crs, name) if crs else bool(graph.has_lon_lat)
    if metric:
        if in_degrees:
            raise InputError(
                "is in degrees, but the log in x and y",
                path=name,
                remedy="convert one of them to the coordinates of the other",
            )
        return points, False

    # The log is in degrees, or there is none.
    if crs and is_local(crs, name):
        return points, False
    if crs and crs.upper() != "EPSG:4326":
        return to_degrees(points, crs, name), True
    # Without a coordinate system, positions on the globe are taken for degrees.
    return points, in_degrees or (not crs and within_globe(points))
