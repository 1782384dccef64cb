"""A network prepared for matching: a spatial index of its roads, and their directed graph."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.kernels.road_grid import count_cells, fill_cells, hash_cells
from gpszip.matching.kernels.roads import BackwardSearch, Graph, RoadGrid, Roads, Workspace
from gpszip.model import Network

__all__ = ["RoadIndex", "create_workspace", "index_network", "open_both_directions"]

#: Width of a cell in mean lengths of a line segment: few segments are in two cells, and few share
#: one.
_SEGMENTS_PER_CELL = 2.0


@dataclass(frozen=True, eq=False)
class RoadIndex:
    """A network as the kernels of matching take it; read-only, so that threads share it.

    Parameters
    ----------
    network : Network
        The roads.
    roads : Roads
        Their shapes, in two coordinates or more.
    road_grid : RoadGrid
        Where they are.
    graph : Graph
        How they connect.
    """

    network: Network
    roads: Roads
    road_grid: RoadGrid
    graph: Graph

    @property
    def dimension(self) -> int:
        """Number of coordinates, at least 2."""
        return int(self.roads.points.shape[1])


def create_workspace(index: RoadIndex) -> Workspace:
    """Allocate the arrays of one thread's searches, once: they are as large as the network."""
    # Searches label directed roads; only the sources of the backward one are nodes.
    roads, nodes = len(index.graph.is_open), len(index.graph.node_positions)

    # Backward from the candidates of a time step.
    backward = BackwardSearch(
        state=np.zeros(3, np.int64),
        limits=np.zeros(2),
        stamps=np.zeros(roads, np.int64),
        keys=np.zeros(roads),
        costs=np.zeros(roads),
        heap_slots=np.zeros(roads, np.int32),
        heap=np.zeros(roads, np.int32),
        is_source=np.zeros(nodes, np.bool_),
    )

    # Forward from those of the time step before.
    return Workspace(
        state=np.zeros(2, np.int64),
        stamps=np.zeros(roads, np.int64),
        keys=np.zeros(roads),
        costs=np.zeros(roads),
        metres=np.zeros(roads),
        parents=np.zeros(roads, np.int32),
        heap_slots=np.zeros(roads, np.int32),
        heap=np.zeros(roads, np.int32),
        first_candidate=np.full(roads, -1, np.int32),
        path_rows=np.full(roads, -1, np.int32),
        backward=backward,
    )


def index_network(network: Network, dimension: int | None = None) -> RoadIndex:
    """Prepare a network for matching.

    Parameters
    ----------
    network : Network
        The roads.
    dimension : int, optional
        Number of coordinates to use, where tracks have fewer than the network.

    Examples
    --------
    >>> nodes, yes = np.array([[0.0, 0.0], [30.0, 40.0]]), np.ones(1, bool)
    >>> start, end = np.zeros(1, np.int32), np.ones(1, np.int32)
    >>> lane = Network(nodes, start, end, np.array([0, 2]), nodes, yes, ~yes, np.full(1, 8.0))
    >>> index = index_network(lane)
    >>> index.graph.lengths.tolist(), index.graph.is_open.tolist()
    ([50.0, 50.0], [True, False])
    """
    points = _pad_coordinates(network.points, dimension)
    along = (
        network.along
        if points.shape[1] >= network.dimension
        else _measure_along(points, network.offsets)
    )
    roads = Roads(
        points, np.ascontiguousarray(along), np.ascontiguousarray(network.offsets, dtype=np.int64)
    )
    graph = _build_graph(network, roads, _pad_coordinates(network.nodes, dimension))
    return RoadIndex(network, roads, _build_grid(roads), graph)


def open_both_directions(index: RoadIndex) -> RoadIndex:
    """Open every road in both directions.

    Examples
    --------
    >>> nodes, yes = np.array([[0.0, 0.0], [30.0, 40.0]]), np.ones(1, bool)
    >>> start, end = np.zeros(1, np.int32), np.ones(1, np.int32)
    >>> lane = Network(nodes, start, end, np.array([0, 2]), nodes, yes, ~yes, np.full(1, 8.0))
    >>> open_both_directions(index_network(lane)).graph.is_open.tolist()
    [True, True]
    """
    network = index.network.two_way()
    graph = _build_graph(network, index.roads, index.graph.node_positions)
    return replace(index, network=network, graph=graph)


def _build_graph(network: Network, roads: Roads, node_positions: NDArray[np.float64]) -> Graph:
    """Connect the directed roads at their nodes."""
    # Directed road 2 i is edge i forward, 2 i + 1 is it backward; the tail of one is the head of
    # the other.
    is_open = np.stack((network.forward, network.backward), axis=1).ravel()
    heads = np.stack((network.ends, network.starts), axis=1).ravel().astype(np.int32)
    tails = heads.reshape(-1, 2)[:, ::-1].ravel()
    out_starts, out_roads = _list_open_roads(tails, is_open, len(node_positions))
    in_starts, in_roads = _list_open_roads(heads, is_open, len(node_positions))
    return Graph(
        out_starts=out_starts,
        out_roads=out_roads,
        heads=heads,
        lengths=np.repeat(roads.along[network.offsets[1:] - 1], 2),
        directions=_start_directions(network, roads.points),
        is_open=is_open,
        node_positions=node_positions,
        in_starts=in_starts,
        in_roads=in_roads,
    )


def _pad_coordinates(points: NDArray[np.float64], dimension: int | None) -> NDArray[np.float64]:
    """The first ``dimension`` coordinates, padded with zeros to at least two."""
    used = points[:, :dimension]
    return np.ascontiguousarray(np.pad(used, ((0, 0), (0, max(2 - used.shape[1], 0)))))


def _measure_along(points: NDArray[np.float64], offsets: NDArray[np.int64]) -> NDArray[np.float64]:
    """Metres from the start of its road to each vertex."""
    steps = np.zeros(len(points))
    steps[1:] = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    steps[offsets[:-1]] = 0.0
    total = np.cumsum(steps)
    along: NDArray[np.float64] = total - np.repeat(total[offsets[:-1]], np.diff(offsets))
    return along


def _list_open_roads(
    nodes: NDArray[np.int32], is_open: NDArray[np.bool_], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """List the open directed roads of each node, in compressed sparse rows.

    ``nodes`` is the node at one end of each directed road.
    """
    usable = np.flatnonzero(is_open)
    order = usable[np.argsort(nodes[usable], kind="stable")]
    starts = np.searchsorted(nodes[order], np.arange(count + 1)).astype(np.int64)
    return starts, order.astype(np.int32)


def _start_directions(network: Network, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors at the beginning of directed roads, shape (2 E, 2); zero without a length."""
    first, last = network.offsets[:-1], network.offsets[1:] - 1
    steps = np.stack(
        (points[first + 1] - points[first], points[last - 1] - points[last]), axis=1
    ).reshape(-1, points.shape[1])[:, :2]
    length = np.sqrt((steps**2).sum(axis=1, keepdims=True))
    return np.ascontiguousarray(
        np.divide(steps, length, out=np.zeros_like(steps), where=length > 0)
    )


def _build_grid(roads: Roads) -> RoadGrid:
    """Enter all line segments in the cells that they cross."""
    # Cells of about two segments.
    points, offsets = roads.points, roads.offsets
    lowest, highest = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    steps = np.sqrt((np.diff(points[:, :2], axis=0) ** 2).sum(axis=1))
    lengths = np.delete(steps, offsets[1:-1] - 1)  # without steps from road to road
    lengths = lengths[lengths > 0]
    cell_size = _SEGMENTS_PER_CELL * float(lengths.mean()) if len(lengths) else 1.0
    columns, rows = (int(n) + 1 for n in np.floor((highest - lowest) / cell_size))

    # Entries sorted by cell, and a hash table at most half full.
    total = count_cells(points, offsets, cell_size, lowest, columns)
    cells, vertices, owners = fill_cells(points, offsets, cell_size, lowest, columns, total)
    order = np.argsort(cells, kind="stable")
    keys, starts, ends = hash_cells(cells[order], 1 << (int(total).bit_length() + 1))
    return RoadGrid(
        keys=keys,
        starts=starts,
        ends=ends,
        vertices=vertices[order],
        roads=owners[order],
        x_min=float(lowest[0]),
        y_min=float(lowest[1]),
        cell_size=cell_size,
        columns=columns,
        rows=rows,
    )
