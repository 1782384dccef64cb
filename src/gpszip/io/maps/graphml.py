"""Write a map as GraphML, for programs that work on graphs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from gpszip.io.maps.table import MapTable
from gpszip.model.directed_edges import split_directions

__all__ = ["write_map_graphml"]

_HEADER = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">\n'
)

#: Columns of a map that an edge of one direction has in another form: its source, its target, and
#: one number of traversals.
_COLUMNS_BY_DIRECTION = ("u", "v", "forward", "backward")


def write_map_graphml(table: MapTable, path: Path) -> None:
    """Write a directed graph: an edge for each direction that was travelled.

    Nodes have lon, lat or x, y[, z]. Edges have ``traversals`` in their direction, and the other
    columns. Edges with a shape have well-known text in the attribute ``line``, from source to
    target.

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
    yield '<key id="traversals" for="edge" attr.name="traversals" attr.type="long"/>\n'
    columns = {
        name: column
        for name, column in table.properties.items()
        if name not in _COLUMNS_BY_DIRECTION
    }
    for name, column in columns.items():
        kind = "long" if column.dtype.kind == "i" else "double"
        yield f'<key id="{name}" for="edge" attr.name="{name}" attr.type="{kind}"/>\n'
    if table.has_shapes:
        yield '<key id="line" for="edge" attr.name="line" attr.type="string"/>\n'
    yield '<graph edgedefault="directed">\n'

    # Nodes.
    node_positions = table.node_positions.tolist()
    for node in table.nodes.tolist():
        data = "".join(
            f'<data key="{axis}">{value!r}</data>'
            for axis, value in zip(table.axes, node_positions[node], strict=True)
        )
        yield f'<node id="{node}">{data}</node>\n'

    # What both directions of a street share. An attribute that is NaN is left out.
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    shared = [
        "".join(
            f'<data key="{name}">{value!r}</data>'
            for name, value in zip(columns, values, strict=True)
            if not _is_nan(value)
        )
        for values in rows
    ]

    # Edges, each with its line in its own direction.
    properties = {name: table.properties[name].astype(np.int64) for name in _COLUMNS_BY_DIRECTION}
    pairs = np.stack([properties["u"], properties["v"]], axis=1).astype(np.int32)
    directed = split_directions(pairs, properties["forward"], properties["backward"])
    # Reversing all points reverses the order of the lines, too, which the last slice restores.
    lines = {True: table.wkt, False: _reversed(table).wkt[::-1]} if table.has_shapes else None
    for (source, target, traversals), edge, forward in zip(
        directed, directed.edges.tolist(), directed.forward.tolist(), strict=True
    ):
        data = f'<data key="traversals">{traversals}</data>{shared[edge]}'
        if lines is not None:
            data += f'<data key="line">{lines[forward][edge]}</data>'
        yield f'<edge source="{source}" target="{target}">{data}</edge>\n'
    yield "</graph>\n</graphml>\n"


def _reversed(table: MapTable) -> MapTable:
    """Return the table with all points in the opposite order: each line, and the lines."""
    count = len(table.points)
    return replace(
        table,
        points=table.points[::-1],
        offsets=count - table.offsets[::-1],
        cuts=count - table.cuts[::-1],
    )


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)
