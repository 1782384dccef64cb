"""Which nodes and edges of a map lie near a position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from gpszip.kernels.near import Grid

__all__ = ["EdgeIndex", "NodeIndex", "index_edges", "index_nodes", "near_edges", "near_nodes"]

_NOBODY = np.iinfo(np.int32).max


@dataclass(frozen=True, eq=False)
class NodeIndex:
    """Positions in a k-d tree."""

    tree: cKDTree


@dataclass(frozen=True, eq=False)
class EdgeIndex:
    """Straight edges, filed by the cells that they cross.

    Parameters
    ----------
    starts, ends : float64 array, shape (E, d)
        End points in metres.
    grid : Grid
        Edges by cell, over the first two axes.
    """

    starts: NDArray[np.float64]
    ends: NDArray[np.float64]
    grid: Grid


def index_nodes(nodes: ArrayLike) -> NodeIndex:
    """Index positions of shape (V, d) in metres for :func:`near_nodes`."""
    return NodeIndex(cKDTree(np.asarray(nodes, dtype=np.float64)))


def near_nodes(index: NodeIndex, positions: ArrayLike, radius: float, count: int) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Find the nodes nearest to each position.

    Parameters
    ----------
    index : NodeIndex
        What :func:`index_nodes` made.
    positions : array_like, shape (n, d)
        Where to look, in metres.
    radius : float
        Nodes farther than this many metres don't count.
    count : int
        Number of nodes wanted for each position, at least 1.

    Returns
    -------
    nodes : int32 array, shape (n, count)
        By increasing distance, equally near ones by index; -1 where there are no more.
    distances : float64 array, shape (n, count)
        Metres; infinite where there are no more.

    Examples
    --------
    >>> nodes, distances = near_nodes(index_nodes([[0, 0], [3, 4], [99, 0]]), [[0, 0]], radius=10, count=3)
    >>> nodes.tolist(), distances.tolist()
    ([[0, 1, -1]], [[0.0, 5.0, inf]])
    """
    size = index.tree.n
    # The tree looks strictly below its bound, and asks for a range of ranks so that even one comes in columns.
    bound = np.nextafter(radius, np.inf)
    found = index.tree.query(np.asarray(positions, dtype=np.float64), np.arange(1, count + 1), distance_upper_bound=bound)
    distances, nodes = np.asarray(found[0]), np.asarray(found[1])
    order = np.lexsort((nodes, distances), axis=1)
    nodes = np.take_along_axis(nodes, order, axis=1)
    return np.where(nodes == size, -1, nodes).astype(np.int32), np.take_along_axis(distances, order, axis=1)


def index_edges(nodes: ArrayLike, edges: ArrayLike, *, cell: float | None = None) -> EdgeIndex:
    """Index straight edges for :func:`near_edges`.

    Parameters
    ----------
    nodes : array_like, shape (V, d)
        Positions in metres, d >= 2.
    edges : array_like of int, shape (E, 2)
        The nodes that each edge joins.
    cell : float, optional
        Width of a cell in metres, best a little above the usual radius. Never below the mean length of the edges, which is
        also the default, so that the index takes a few numbers for each edge.

    Examples
    --------
    >>> index = index_edges([[0, 0], [10, 0], [10, 10]], [[0, 1], [1, 2]])
    >>> edges, fractions, distances = near_edges(index, [[4, 1]], radius=5, count=2)
    >>> edges.tolist(), fractions.tolist(), distances.tolist()
    ([[0, -1]], [[0.4, 0.0]], [[1.0, inf]])
    """
    from gpszip.kernels.near import Grid, count_cells, fill_cells

    positions = np.ascontiguousarray(nodes, dtype=np.float64)
    pairs = np.asarray(edges, dtype=np.int64).reshape(-1, 2)
    starts, ends = positions[pairs[:, 0]], positions[pairs[:, 1]]
    origin, width, columns, rows = _extent(starts, ends, cell)
    size = count_cells(starts, ends, origin, width, columns, rows)
    keys, members = np.empty(size, np.int64), np.empty(size, np.int32)
    fill_cells(starts, ends, origin, width, columns, rows, keys, members)
    order = np.argsort(keys, kind="stable")
    cells, first = np.unique(keys[order], return_index=True)
    offsets = np.append(first, size).astype(np.int64)
    return EdgeIndex(starts, ends, Grid(origin, width, columns, rows, cells, offsets, members[order]))


def near_edges(
    index: EdgeIndex, positions: ArrayLike, radius: float, count: int
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """Find the edges nearest to each position.

    Parameters
    ----------
    index : EdgeIndex
        What :func:`index_edges` made.
    positions : array_like, shape (n, d)
        Where to look, in metres.
    radius : float
        Edges farther than this many metres don't count.
    count : int
        Number of edges wanted for each position.

    Returns
    -------
    edges : int32 array, shape (n, count)
        By increasing distance, equally near ones by index; -1 where there are no more.
    fractions : float64 array, shape (n, count)
        Where on the edge its nearest point is, from 0 at the start to 1 at the end; 0 where there are no more.
    distances : float64 array, shape (n, count)
        Metres; infinite where there are no more.
    """
    from gpszip.kernels.near import nearest_segments

    points = np.ascontiguousarray(positions, dtype=np.float64)
    shape = (len(points), count)
    edges, fractions, squares = np.full(shape, _NOBODY, np.int32), np.zeros(shape), np.full(shape, np.inf)
    if len(index.starts):
        nearest_segments(points, float(radius), index.starts, index.ends, index.grid, edges, fractions, squares)
    edges[edges == _NOBODY] = -1
    return edges, fractions, np.sqrt(squares)


def _extent(starts: NDArray[np.float64], ends: NDArray[np.float64], cell: float | None) -> tuple[NDArray[np.float64], float, int, int]:
    if not len(starts):
        return np.zeros(2), 1.0, 1, 1
    low = np.minimum(starts, ends)[:, :2].min(axis=0)
    spread = np.maximum(starts, ends)[:, :2].max(axis=0) - low
    mean = float(np.linalg.norm(ends - starts, axis=1).mean())
    # Keys are products of columns and rows: the last term keeps them, and sums of doubles, far from their limits.
    width = max(cell or 0.0, mean, float(spread.max()) / 2**24, 1e-9)
    columns, rows = (spread // width).astype(np.int64) + 1
    return low, width, int(columns), int(rows)
