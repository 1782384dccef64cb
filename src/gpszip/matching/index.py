"""A network made ready for matching: directed roads out of every node, and roads filed by the cells that they cross."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.kernels.road_grid import count_cells, fill_cells, hash_cells
from gpszip.matching.kernels.roads import BackwardSearch, Graph, RoadGrid, Roads, Workspace
from gpszip.model import Network

__all__ = ["RoadIndex", "create_workspace", "index_network", "open_both_ways"]

#: Cells are so many usual bits of road wide: few bits are filed twice, and few share a cell.
_BITS_PER_CELL = 2.0


@dataclass(frozen=True, eq=False)
class RoadIndex:
    """What the kernels of matching take of a network; read only, so that threads share it.

    Parameters
    ----------
    network : Network
        The roads.
    roads : Roads
        Their shapes, in two coordinates or more.
    road_grid : Cells
        Where they are.
    graph : Graph
        How they join.
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
    """Room for searches on one index, for one thread; made once, since it is as large as the network."""
    size, nodes = len(index.graph.open), len(index.graph.nodes)
    parents, slots, heap = (np.zeros(size, np.int32) for _ in range(3))
    state, stamps = np.zeros(2, np.int64), np.zeros(size, np.int64)
    targets, known = np.full((2, size), -1, np.int32)
    keys, price, metres = (np.zeros(size) for _ in range(3))
    back = (
        np.zeros(size, np.int64),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size, np.int32),
        np.zeros(size, np.int32),
    )
    rest = BackwardSearch(np.zeros(3, np.int64), np.zeros(2), *back, np.zeros(nodes, np.bool_))
    return Workspace(state, stamps, keys, price, metres, parents, slots, heap, targets, known, rest)


def index_network(network: Network, dimension: int | None = None) -> RoadIndex:
    """Make a network ready for matching.

    Parameters
    ----------
    network : Network
        The roads.
    dimension : int, optional
        Use only so many coordinates, where tracks have fewer than the network.

    Examples
    --------
    >>> nodes, one = np.array([[0.0, 0.0], [30.0, 40.0]]), np.ones(1, bool)
    >>> lane = Network(nodes, np.zeros(1, np.int32), np.ones(1, np.int32), np.array([0, 2]), nodes, one, ~one, np.full(1, 8.0))
    >>> index = index_network(lane)
    >>> index.graph.lengths.tolist(), index.graph.open.tolist()
    ([50.0, 50.0], [True, False])
    """
    points = _coordinates(network.points, dimension)
    along = (
        network.along if points.shape[1] >= network.dimension else _along(points, network.offsets)
    )
    roads = Roads(
        points, np.ascontiguousarray(along), np.ascontiguousarray(network.offsets, dtype=np.int64)
    )
    return RoadIndex(
        network,
        roads,
        _cells(roads),
        _graph(network, roads, _coordinates(network.nodes, dimension)),
    )


def open_both_ways(index: RoadIndex) -> RoadIndex:
    """The same roads, each of which may be travelled in both directions.

    Examples
    --------
    >>> nodes, one = np.array([[0.0, 0.0], [30.0, 40.0]]), np.ones(1, bool)
    >>> lane = Network(nodes, np.zeros(1, np.int32), np.ones(1, np.int32), np.array([0, 2]), nodes, one, ~one, np.full(1, 8.0))
    >>> open_both_ways(index_network(lane)).graph.open.tolist()
    [True, True]
    """
    network = index.network.two_way()
    return replace(index, network=network, graph=_graph(network, index.roads, index.graph.nodes))


def _graph(network: Network, roads: Roads, nodes: NDArray[np.float64]) -> Graph:
    open_ = np.stack((network.forward, network.backward), axis=1).ravel()
    lengths = np.repeat(roads.along[network.offsets[1:] - 1], 2)
    heads = np.stack((network.ends, network.starts), axis=1).ravel().astype(np.int32)
    tails = heads.reshape(-1, 2)[:, ::-1].ravel()
    outs, ins = _links(tails, open_, len(nodes)), _links(heads, open_, len(nodes))
    return Graph(*outs, heads, lengths, _headings(network, roads.points), open_, nodes, *ins)


def _coordinates(points: NDArray[np.float64], dimension: int | None) -> NDArray[np.float64]:
    """Two coordinates or more."""
    used = points[:, :dimension]
    return np.ascontiguousarray(np.pad(used, ((0, 0), (0, max(2 - used.shape[1], 0)))))


def _along(points: NDArray[np.float64], offsets: NDArray[np.int64]) -> NDArray[np.float64]:
    steps = np.zeros(len(points))
    steps[1:] = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    steps[offsets[:-1]] = 0.0
    total = np.cumsum(steps)
    along: NDArray[np.float64] = total - np.repeat(total[offsets[:-1]], np.diff(offsets))
    return along


def _links(
    nodes: NDArray[np.int32], open_: NDArray[np.bool_], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Directed roads that may be travelled, filed by their nodes at one end."""
    usable = np.flatnonzero(open_)
    order = usable[np.argsort(nodes[usable], kind="stable")]
    begins = np.searchsorted(nodes[order], np.arange(count + 1)).astype(np.int64)
    return begins, order.astype(np.int32)


def _headings(network: Network, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors at the beginning of each directed road, shape (2 E, 2); zero where a road has no length."""
    first, last = network.offsets[:-1], network.offsets[1:] - 1
    steps = np.stack(
        (points[first + 1] - points[first], points[last - 1] - points[last]), axis=1
    ).reshape(-1, points.shape[1])[:, :2]
    length = np.sqrt((steps**2).sum(axis=1, keepdims=True))
    return np.ascontiguousarray(
        np.divide(steps, length, out=np.zeros_like(steps), where=length > 0)
    )


def _cells(roads: Roads) -> RoadGrid:
    points, offsets = roads.points, roads.offsets
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    bits = np.delete(np.sqrt((np.diff(points[:, :2], axis=0) ** 2).sum(axis=1)), offsets[1:-1] - 1)
    bits = bits[bits > 0]
    size = _BITS_PER_CELL * float(bits.mean()) if len(bits) else 1.0
    columns, rows = (int(n) + 1 for n in np.floor((high - low) / size))
    total = count_cells(points, offsets, size, low, columns)
    cells, firsts, owners = fill_cells(points, offsets, size, low, columns, total)
    order = np.argsort(cells, kind="stable")
    table, begins, ends = hash_cells(cells[order], 1 << (int(total).bit_length() + 1))
    return RoadGrid(
        table,
        begins,
        ends,
        firsts[order],
        owners[order],
        float(low[0]),
        float(low[1]),
        size,
        columns,
        rows,
    )
