"""A road map as GraphML, for programs that work on graphs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gpszip.io.map_table import MapTable

__all__ = ["write_map_graphml"]

_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<graphml xmlns="http://graphml.graphdrawing.org/xmlns">\n'


def write_map_graphml(table: MapTable, path: Path) -> None:
    """Write nodes with lon, lat or x, y[, z], and edges with forward, backward and length (metres).

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    """
    with path.open("w", encoding="utf-8") as file:
        file.writelines(_lines(table))


def _lines(table: MapTable) -> Iterator[str]:
    axes = ["lon", "lat"] if table.geographic else list("xyz"[: table.places.shape[1]])
    yield _HEAD
    for axis in axes:
        yield f'<key id="{axis}" for="node" attr.name="{axis}" attr.type="double"/>\n'
    for name, kind in (("forward", "long"), ("backward", "long"), ("length", "double")):
        yield f'<key id="{name}" for="edge" attr.name="{name}" attr.type="{kind}"/>\n'
    yield '<graph edgedefault="undirected">\n'
    places = table.places.tolist()
    for node in table.nodes.tolist():
        data = "".join(f'<data key="{axis}">{value!r}</data>' for axis, value in zip(axes, places[node], strict=True))
        yield f'<node id="{node}">{data}</node>\n'
    for u, v, *values in zip(*(column.tolist() for column in table.properties.values()), strict=True):
        data = "".join(
            f'<data key="{name}">{value!r}</data>' for name, value in zip(("forward", "backward", "length"), values, strict=True)
        )
        yield f'<edge source="{u}" target="{v}">{data}</edge>\n'
    yield "</graph>\n</graphml>\n"
