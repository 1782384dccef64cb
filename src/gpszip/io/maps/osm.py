"""Write a map as OpenStreetMap XML, for JOSM, osmium and osmnx."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from gpszip.io.maps.table import MapTable

__all__ = ["write_map_osm"]

#: Decimals of degrees in OpenStreetMap's database, about a centimetre.
_DECIMALS = 7

#: Nodes that a way may have, the limit of OpenStreetMap's API 0.6.
_MAX_WAY_NODES = 2000

#: Start of the keys of tags that are no tags of OpenStreetMap.
_PREFIX = "gpszip:"

#: Columns of a map that ways have in another form: nodes, and counts along and against the way.
_COLUMNS_BY_DIRECTION = ("u", "v", "forward", "backward")

#: JOSM uploads nothing of a file with ``upload="never"``: it was learned, not surveyed.
_HEADER = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<osm version="0.6" generator="GPSZip" upload="never">\n'
)


class _Nodes(NamedTuple):
    """Nodes of a file.

    Parameters
    ----------
    ids : int64 array, shape (N,)
        Their ids, from -1 downwards.
    points : float64 array, shape (N, 2)
        Longitude and latitude.
    vertex_ids : int64 array, shape (n,)
        Id of the node at each vertex of the lines of the map.
    """

    ids: NDArray[np.int64]
    points: NDArray[np.float64]
    vertex_ids: NDArray[np.int64]


def write_map_osm(table: MapTable, path: Path) -> None:
    """Write a way for each edge that was travelled, with the tag ``highway=road``.

    A way that was travelled in one direction only leads in that direction and has the tag
    ``oneway=yes``. The columns of the edge are tags whose keys start with ``gpszip:``; counts and
    ``forward`` refer to the direction of the way. Ways share the nodes of the map at which they
    meet. An edge with more than 2000 nodes, or one that crosses the antimeridian, is several ways
    with the same tags.

    Ids are negative, as editors number objects that the server of OpenStreetMap doesn't have. JOSM
    refuses positive ids without the version that the server gave, and takes those with one for
    objects of the server. Node k of the map has the id -(k + 1).

    Parameters
    ----------
    table : MapTable
        The map, in degrees.
    path : Path
        The file.
    """
    with path.open("w", encoding="utf-8") as file:
        file.writelines(_iterate_xml(table))


def _iterate_xml(table: MapTable) -> Iterator[str]:
    """Yield the file line by line: bounds, nodes, ways."""
    yield _HEADER
    nodes = _find_nodes(table)

    # An empty map has no bounds.
    if len(nodes.ids):
        (west, south), (east, north) = nodes.points.min(axis=0), nodes.points.max(axis=0)
        yield (
            f'<bounds minlat="{_degrees(south)}" minlon="{_degrees(west)}" '
            f'maxlat="{_degrees(north)}" maxlon="{_degrees(east)}"/>\n'
        )

    # Nodes.
    for node, (lon, lat) in zip(nodes.ids.tolist(), nodes.points.tolist(), strict=True):
        yield f'<node id="{node}" lat="{_degrees(lat)}" lon="{_degrees(lon)}"/>\n'

    # Ways.
    yield from _iterate_ways(table, nodes.vertex_ids)
    yield "</osm>\n"


def _find_nodes(table: MapTable) -> _Nodes:
    """Return the nodes of edges that were travelled, each once."""
    # A vertex is a node of its own, numbered after those of the map, unless the edge ends there.
    node_count, vertex_count = len(table.node_positions), len(table.points)
    numbers = node_count + np.arange(vertex_count)
    numbers[table.offsets[:-1]] = table.properties["u"]
    numbers[table.offsets[1:] - 1] = table.properties["v"]

    # A node on the antimeridian has a twin for edges that come from the other side, since a way
    # from 179 to -180 degrees would lead around the earth.
    points = table.points.round(_DECIMALS)
    is_twin = (points[:, 0] == -180.0) & (numbers < node_count)
    numbers[is_twin] += node_count + vertex_count

    # Take those of edges that were travelled, in the order of their numbers.
    vertices = np.flatnonzero(np.repeat(table.traversals > 0, np.diff(table.offsets)))
    used, first = np.unique(numbers[vertices], return_index=True)
    return _Nodes(-1 - used, points[vertices[first]], -1 - numbers)


def _iterate_ways(table: MapTable, vertex_ids: NDArray[np.int64]) -> Iterator[str]:
    """Yield the ways of each edge that was travelled, with ids from -1 downwards."""
    way = 0
    forward, backward = (table.properties[name].tolist() for name in ("forward", "backward"))
    for edge, (fragments, tags) in enumerate(
        zip(table.fragments, _iterate_tags(table), strict=True)
    ):
        # An edge that nobody travelled is in no direction of the map.
        if not (forward[edge] or backward[edge]):
            continue

        # Cut it into ways; against the edge if nobody went along it.
        parts = [vertex_ids[part] for fragment in fragments for part in _split(fragment)]
        if not forward[edge]:
            parts = [part[::-1] for part in reversed(parts)]
        # Each way of the edge gets the same tags.
        directions = _direction_tags(forward[edge], backward[edge])
        for part in parts:
            way -= 1
            refs = "".join(f'<nd ref="{node}"/>' for node in part.tolist())
            yield f'<way id="{way}">{refs}{directions}{tags}</way>\n'


def _split(fragment: slice) -> Iterator[slice]:
    """Split a slice of vertices into slices that a way can hold; neighbours share a vertex."""
    # The last node of a way is the first one of the next, so that a step is one node shorter.
    for start in range(fragment.start, fragment.stop - 1, _MAX_WAY_NODES - 1):
        yield slice(start, min(start + _MAX_WAY_NODES, fragment.stop))


def _direction_tags(forward: int, backward: int) -> str:
    """Return the class of a way, which the format asks for, and how often it was travelled."""
    road = '<tag k="highway" v="road"/>'
    # The way leads where it was travelled, so that its only count is that of "forward".
    if not (forward and backward):
        return f'{road}<tag k="oneway" v="yes"/>{_traversals("forward", forward or backward)}'
    return road + _traversals("forward", forward) + _traversals("backward", backward)


def _traversals(direction: str, count: int) -> str:
    return f'<tag k="{_PREFIX}traversals:{direction}" v="{count}"/>'


def _iterate_tags(table: MapTable) -> Iterator[str]:
    """Yield the number of each edge and its columns as tags; those that are NaN are left out."""
    columns = {"edge": range(len(table))} | {
        name: column.tolist()
        for name, column in table.properties.items()
        if name not in _COLUMNS_BY_DIRECTION
    }
    starts = [f"<tag k={quoteattr(_PREFIX + name)} v=" for name in columns]
    for values in zip(*columns.values(), strict=True):
        yield "".join(
            f"{start}{quoteattr(str(value))}/>"
            for start, value in zip(starts, values, strict=True)
            if not _is_nan(value)
        )


def _degrees(value: float) -> str:
    return f"{value:.{_DECIMALS}f}"


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)
