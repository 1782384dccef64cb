"""Maps as graphs of networkx and as GeoDataFrames, in the columns of osmnx."""

from __future__ import annotations

from typing import Any

from gpszip.io.maps.directed import directed_table
from gpszip.io.maps.table import MapTable
from gpszip.io.maps.wkb import table_wkb

__all__ = ["edge_frame", "node_frame", "to_graph"]

#: Columns of a line that name its edge in a graph.
_ENDS = ("u", "v", "key")

#: Vertices of a straight line.
_STRAIGHT = 2


def to_graph(table: MapTable, networkx: Any, shapely: Any) -> Any:
    """Return a map as a directed graph, see :meth:`gpszip.RoadMap.to_networkx`.

    Parameters
    ----------
    table : MapTable
        The map.
    networkx, shapely : module
        The packages.
    """
    # Nodes
    graph = networkx.MultiDiGraph(crs=table.crs)
    axes, positions = "xyz"[: table.node_positions.shape[1]], table.node_positions.tolist()
    graph.add_nodes_from(
        (node, dict(zip(axes, positions[node], strict=True))) for node in table.nodes.tolist()
    )

    # Edges. As in osmnx, a straight one has no geometry, and what is NaN is left out.
    directed = directed_table(table)
    columns = {name: v.tolist() for name, v in directed.properties.items() if name not in _ENDS}
    lines = shapely.from_wkb(table_wkb(directed)) if len(directed) else []
    counts = (directed.offsets[1:] - directed.offsets[:-1]).tolist()
    for row, ends in enumerate(zip(*_ends(directed), strict=True)):
        data = {name: values[row] for name, values in columns.items()}
        data = {name: value for name, value in data.items() if value == value}  # noqa: PLR0124
        if counts[row] > _STRAIGHT:
            data["geometry"] = lines[row]
        graph.add_edge(*ends, **data)
    return graph


def node_frame(table: MapTable, geopandas: Any) -> Any:
    """Return the nodes of a map as a GeoDataFrame by ``osmid``."""
    import pandas as pd

    positions = table.node_positions[table.nodes]
    columns = {axis: positions[:, i] for i, axis in enumerate("xyz"[: positions.shape[1]])}
    points = geopandas.points_from_xy(*columns.values())
    index = pd.Index(table.nodes, name="osmid")
    return geopandas.GeoDataFrame(columns, geometry=points, index=index, crs=table.crs)


def edge_frame(table: MapTable, geopandas: Any) -> Any:
    """Return the directed edges of a map as a GeoDataFrame by ``u``, ``v`` and ``key``."""
    import pandas as pd

    directed = directed_table(table)
    columns = {name: v for name, v in directed.properties.items() if name not in _ENDS}
    lines = geopandas.GeoSeries.from_wkb(table_wkb(directed)).to_numpy()
    index = pd.MultiIndex.from_arrays(_ends(directed), names=_ENDS)
    return geopandas.GeoDataFrame(columns, geometry=lines, index=index, crs=table.crs)


def _ends(directed: MapTable) -> list[list[int]]:
    """Nodes and keys of all lines."""
    return [directed.properties[name].tolist() for name in _ENDS]
