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
    # Keys: short names of attributes, as they stand at each edge
    directed = directed_table(table)
    columns = {name: v for name, v in directed.properties.items() if name not in _ENDS}
    node_keys = {name: f"n{i}" for i, name in enumerate("xyz"[: table.node_positions.shape[1]])}
    shape = ["geometry"] if table.has_shapes else []
    edge_keys = {name: f"e{i}" for i, name in enumerate([*columns, *shape])}
    yield _HEADER
    for element, keys in (("graph", {"crs": "g0"}), ("node", node_keys), ("edge", edge_keys)):
        for name, key in keys.items():
            yield f'<key id="{key}" for="{element}" attr.name="{name}" attr.type="string"/>\n'
    yield f'<graph edgedefault="directed">\n{_data("g0", escape(table.crs))}\n'

    # Nodes
    positions = table.node_positions.tolist()
    for node in table.nodes.tolist():
        data = "".join(map(_data, node_keys.values(), positions[node]))
        yield f'<node id="{node}">{data}</node>\n'

    # Edges; an attribute that is NaN is left out.
    ends = zip(directed.properties["u"].tolist(), directed.properties["v"].tolist(), strict=True)
    cells = [column.tolist() for column in columns.values()]
    cells += [directed.wkt] if table.has_shapes else []
    for (source, target), values in zip(ends, zip(*cells, strict=True), strict=True):
        data = "".join(
            _data(key, value)
            for key, value in zip(edge_keys.values(), values, strict=True)
            if not _is_nan(value)
        )
        yield f'<edge source="{source}" target="{target}">{data}</edge>\n'
    yield "</graph>\n</graphml>\n"


def _data(key: str, value: object) -> str:
    return f'<data key="{key}">{value}</data>'


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)
