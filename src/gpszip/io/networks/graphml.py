"""Roads from GraphML, as osmnx and GPSZip itself write it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any
from xml.etree.ElementTree import Element, ParseError, iterparse

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError
from gpszip.geo.crs import is_geographic, to_degrees
from gpszip.io.networks.lines import RoadLines, within_globe
from gpszip.io.networks.rules import (
    clean_street_name,
    expected_speed,
    parse_directions,
    parse_speed_limit,
    road_class_speed,
    road_class_users,
)
from gpszip.io.networks.wkb import parse_wkt_line

__all__ = ["read_graphml_lines"]

_GEOMETRY_KEYS = ("geometry", "line", "wkt")


@dataclass
class _Graph:
    """What has been read so far."""

    names: dict[str, str] = field(default_factory=dict)
    defaults: dict[str, str] = field(default_factory=dict)
    attributes: dict[str, str] = field(default_factory=dict)
    degrees: bool | None = None
    directed: bool = True
    nodes: dict[str, tuple[float, float]] = field(default_factory=dict)
    edges: list[tuple[str, str, dict[str, str]]] = field(default_factory=list)


def read_graphml_lines(stream: Any, name: str, *, metric: bool | None = None) -> RoadLines:
    """Read the edges of a graph.

    Nodes need ``x`` and ``y`` (or ``lon`` and ``lat``). An edge runs straight unless it has well-known text in ``geometry`` (or
    ``line``). In a directed graph an edge may be travelled from its source to its target, in another both ways, save where
    it is ``oneway``. Speeds come from ``speed_kph``, ``maxspeed`` and ``highway``, or ``speed`` in m/s; street names from ``name``,
    or ``ref``.

    Parameters
    ----------
    stream : binary file
        The file.
    name : str
        What to call it in messages.
    metric : bool, optional
        Whether the log it is for is in x and y; None where it is for any.

    Returns
    -------
    RoadLines

    Raises
    ------
    InputError
        If it is no GraphML, nodes have no place, or an edge has no end.
    """
    graph = _Graph()
    try:
        for element in _iterate_elements(stream):
            _add_element(graph, element, name)
    except (
        ParseError,
        LookupError,
        ValueError,
    ) as error:  # the latter two of encodings that nobody knows
        raise InputError(f"{name}: damaged XML: {error}") from error
    if not graph.edges:
        raise InputError(f"{name}: a graph without edges; a network needs some")
    return _to_road_lines(graph, name, metric)


def _iterate_elements(stream: Any) -> Iterator[Element]:
    """Every element at its end; what was read is forgotten, so that memory stays bounded."""
    open_: list[Element] = []
    for event, element in iterparse(stream, events=("start", "end")):
        if event == "start":
            open_.append(element)
            if element.tag.endswith("}graph"):
                yield element
            continue
        open_.pop()
        if element.tag.rpartition("}")[2] in ("key", "node", "edge"):
            yield element
            element.clear()
            if open_:
                open_[-1].remove(element)
        elif element.tag.endswith("}data") and open_ and open_[-1].tag.endswith("}graph"):
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
        graph.edges.append(
            (element.get("source", ""), element.get("target", ""), _read_data(graph, element))
        )


def _read_data(graph: _Graph, element: Element) -> dict[str, str]:
    return {graph.names.get(data.get("key", ""), ""): data.text or "" for data in element}


def _read_position(graph: _Graph, element: Element, name: str) -> tuple[float, float]:
    data = _read_data(graph, element)
    if graph.degrees is None:
        graph.degrees = "lon" in data and "x" not in data
    try:
        return (
            (float(data["lon"]), float(data["lat"]))
            if graph.degrees
            else (float(data["x"]), float(data["y"]))
        )
    except (KeyError, ValueError):
        raise InputError(
            f"{name}: node {element.get('id')!r} has no place; nodes need the numbers x and y, or lon and lat"
        ) from None


def _to_road_lines(graph: _Graph, name: str, metric: bool | None) -> RoadLines:
    shapes, rules, ids, names = [], [], [], []
    kinds: dict[tuple[str | None, ...], tuple[bool, bool, float, int]] = {}
    for number, (source, target, data) in enumerate(graph.edges):
        if source not in graph.nodes or target not in graph.nodes:
            raise InputError(f"{name}: edge {number} leads to a node that the graph doesn't hold")
        shape = next(
            (points for key in _GEOMETRY_KEYS if (points := parse_wkt_line(data.get(key, "")))),
            None,
        )
        shapes.append(shape or (graph.nodes[source], graph.nodes[target]))
        words = tuple(
            data.get(key)
            for key in ("oneway", "junction", "highway", "maxspeed", "speed_kph", "speed")
        )
        if words not in kinds:
            kinds[words] = _parse_rules(graph.directed, *words)
        rules.append(kinds[words])
        ids.append(data.get("osmid", str(number)))
        names.append(clean_street_name(data.get("name"), data.get("ref")))
    flat = np.array([point for shape in shapes for point in shape])
    points, geographic = _to_log_coordinates(graph, flat, name, metric)
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


def _parse_rules(
    directed: bool,
    oneway: str | None,
    junction: str | None,
    road: str | None,
    limit: str | None,
    kmh: str | None,
    speed: str | None,
) -> tuple[bool, bool, float, int]:
    forward, backward = parse_directions(oneway, junction=junction, road=road)
    if directed:  # the other direction is an edge of its own
        forward, backward = True, False
    told = _parse_number(kmh) / 3.6 if kmh else _parse_number(speed)
    typical_speed = expected_speed(parse_speed_limit(limit), road_class_speed(road))
    return forward, backward, told if 0 < told < 100 else typical_speed, road_class_users(road)


def _parse_number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def _to_log_coordinates(
    graph: _Graph, points: Any, name: str, metric: bool | None
) -> tuple[Any, bool]:
    crs = graph.attributes.get("crs", "").strip()
    degrees = is_geographic(crs, name) if crs else bool(graph.degrees)
    if metric:
        if degrees:
            raise InputError(
                f"{name}: is in degrees, but the log in x and y; convert one of them to the coordinates of the other"
            )
        return points, False
    if crs and crs.upper() != "EPSG:4326":
        return to_degrees(points, crs, name), True
    return points, degrees or (not crs and within_globe(points))
