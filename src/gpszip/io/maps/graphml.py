"""Write a map as GraphML, for programs that work on graphs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from gpszip.io.maps.table import MapTable

__all__ = ["write_map_graphml"]

_HEADER = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">\n'
)


def write_map_graphml(table: MapTable, path: Path) -> None:
    """Write nodes with lon, lat or x, y[, z], and edges with the other columns.

    Edges with a shape have well-known text in the attribute ``line``.

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
    # Keys: names and types of attributes.
    yield _HEADER
    for axis in table.axes:
        yield f'<key id="{axis}" for="node" attr.name="{axis}" attr.type="double"/>\n'
    columns = dict(list(table.properties.items())[2:])  # without u and v
    for name, column in columns.items():
        kind = "long" if column.dtype.kind == "i" else "double"
        yield f'<key id="{name}" for="edge" attr.name="{name}" attr.type="{kind}"/>\n'
    if table.has_shapes:
        yield '<key id="line" for="edge" attr.name="line" attr.type="string"/>\n'
    yield '<graph edgedefault="undirected">\n'

    # Nodes.
    node_positions = table.node_positions.tolist()
    for node in table.nodes.tolist():
        data = "".join(
            f'<data key="{axis}">{value!r}</data>'
            for axis, value in zip(table.axes, node_positions[node], strict=True)
        )
        yield f'<node id="{node}">{data}</node>\n'

    # Edges. An attribute that is NaN is left out.
    lines = table.wkt if table.has_shapes else [""] * len(table)
    rows = zip(*(column.tolist() for column in table.properties.values()), strict=True)
    for line, (u, v, *values) in zip(lines, rows, strict=True):
        data = "".join(
            f'<data key="{name}">{value!r}</data>'
            for name, value in zip(columns, values, strict=True)
            if not _is_nan(value)
        )
        data += f'<data key="line">{line}</data>' if line else ""
        yield f'<edge source="{u}" target="{v}">{data}</edge>\n'
    yield "</graph>\n</graphml>\n"


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)
