"""Write a map as GraphML, for osmnx, networkx and other programs that work on graphs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape

from gpszip.io.maps.directed import directed_table
from gpszip.io.maps.table import MapTable

__all__ = ["write_map_graphml"]

_HEADER = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">\n'
)

#: Columns of a line that the element of an edge has in another form.
_ENDS = ("u", "v", "key")


def write_map_graphml(table: MapTable, path: Path) -> None:
    """Write a directed graph: an edge for each direction that was travelled.

    Nodes have ``x`` and ``y`` (longitude and latitude, or metres) and ``z`` if there is one. Edges
    have the columns of :func:`gpszip.io.maps.directed.directed_table`; edges with a shape have
    well-known text in ``geometry``, from source to target. The graph has its coordinate system in
    ``crs``. All values are of type string, which is what osmnx reads and writes.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    """
    with path.open("w", encoding="utf-8") as file:
        file.writelines(_iterate_xml(table))


def _iterate_xml(table: MapTable) -> Iterator[str]:
    # Keys: names of attributes
    directed = directed_table(table)
    columns = {name: v for name, v in directed.properties.items() if name not in _ENDS}
    axes = "xyz"[: table.node_positions.shape[1]]
    yield _HEADER
    yield _key("graph", "crs")
    yield from (_key("node", axis) for axis in axes)
    yield from (_key("edge", name) for name in columns)
    if table.has_shapes:
        yield _key("edge", "geometry")
    yield f'<graph edgedefault="directed">\n{_data("graph", "crs", escape(table.crs))}\n'

    # Nodes
    positions = table.node_positions.tolist()
    for node in table.nodes.tolist():
        data = "".join(_data("node", *pair) for pair in zip(axes, positions[node], strict=True))
        yield f'<node id="{node}">{data}</node>\n'

    # Edges; an attribute that is NaN is left out.
    ends = zip(directed.properties["u"].tolist(), directed.properties["v"].tolist(), strict=True)
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = directed.wkt if table.has_shapes else [""] * len(directed)
    for (source, target), values, line in zip(ends, rows, lines, strict=True):
        data = "".join(
            _data("edge", name, value)
            for name, value in zip(columns, values, strict=True)
            if not _is_nan(value)
        )
        data += _data("edge", "geometry", line) if line else ""
        yield f'<edge source="{source}" target="{target}">{data}</edge>\n'
    yield "</graph>\n</graphml>\n"


def _key(element: str, name: str) -> str:
    """Declare an attribute of nodes or edges; both may have one of the same name."""
    return f'<key id="{element}-{name}" for="{element}" attr.name="{name}" attr.type="string"/>\n'


def _data(element: str, name: str, value: object) -> str:
    return f'<data key="{element}-{name}">{value}</data>'


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)
