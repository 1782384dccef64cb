"""The skeleton of the street network: a graph of closely spaced vertices, thinned from a density.

Spurs and small holes of noise are removed, junctions nearby are consolidated, and lines smoothed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gpszip.simplification.cell_grid import CellGrid, smooth_density

__all__ = [
    "Chains",
    "Skeleton",
    "build_chains",
    "build_skeleton",
    "consolidate_junctions",
    "drop_isolated_vertices",
    "prune_spurs",
    "simplify_chains",
    "smooth_skeleton",
]

#: Density in traversals above which a cell counts as part of a street.
_MIN_DENSITY = 0.4


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Vertices, and links between neighbouring ones.

    Parameters
    ----------
    positions : float64 array, shape (n, 2)
        Vertices in metres.
    links : int32 array, shape (m, 2)
        Vertices of each link, the lower number first; sorted, without duplicates.
    """

    positions: NDArray[np.float64]
    links: NDArray[np.int32]

    @property
    def degrees(self) -> NDArray[np.int64]:
        """Number of neighbours of each vertex."""
        return np.bincount(self.links.ravel(), minlength=len(self.positions))

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Length of each link in metres."""
        length: NDArray[np.float64] = np.linalg.norm(
            self.positions[self.links[:, 1]] - self.positions[self.links[:, 0]], axis=1
        )
        return length


@dataclass(frozen=True, eq=False)
class Chains:
    """Chains of links between junctions and dead ends.

    Parameters
    ----------
    offsets : int64 array, shape (c + 1,)
        Chain i consists of ``links[offsets[i]:offsets[i + 1]]``.
    links : int32 array, shape (m,)
        Numbers of the skeleton's links.
    is_forward : bool array, shape (m,)
        Whether the chain passes each link from its first vertex to its second.
    nodes : int32 array, shape (m + c,)
        Chain i visits the vertices ``nodes[offsets[i] + i:offsets[i + 1] + i + 1]``.
    """

    offsets: NDArray[np.int64]
    links: NDArray[np.int32]
    is_forward: NDArray[np.bool_]
    nodes: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, number: int) -> NDArray[np.int32]:
        """Vertices of one chain."""
        return self.nodes[self.offsets[number] + number : self.offsets[number + 1] + number + 1]

    @property
    def owner(self) -> NDArray[np.int64]:
        """Chain of each entry of ``links``."""
        return np.repeat(np.arange(len(self)), np.diff(self.offsets))

    @property
    def ends(self) -> NDArray[np.int32]:
        """First and last vertex of each chain, shape (c, 2)."""
        number = np.arange(len(self))
        first, last = self.offsets[:-1] + number, self.offsets[1:] + number
        return np.stack((self.nodes[first], self.nodes[last]), axis=1)

    def lengths(self, skeleton: Skeleton) -> NDArray[np.float64]:
        """Length of each chain in metres."""
        return np.bincount(
            self.owner, weights=skeleton.lengths[self.links], minlength=len(self)
        ).astype(np.float64)


def build_chains(skeleton: Skeleton) -> Chains:
    """Group the links of a skeleton to chains.

    Examples
    --------
    >>> positions = np.array([[0.0, 0], [1, 0], [2, 0]])
    >>> chains = build_chains(Skeleton(positions, np.array([[0, 1], [1, 2]], np.int32)))
    >>> chains[0].tolist(), chains.is_forward.tolist()
    ([0, 1, 2], [True, True])
    """
    from gpszip.graph.road_graph import build_road_graph
    from gpszip.simplification.kernels.chains import chain_edges

    graph = build_road_graph(skeleton.positions, skeleton.links)
    first, nodes, links = chain_edges(
        graph.offsets, graph.targets, graph.edges, len(skeleton.links)
    )

    # A chain has one vertex more than links; all but its last one start a link.
    offsets = first - np.arange(len(first))
    before = np.delete(nodes, first[1:] - 1)
    return Chains(offsets, links, before == skeleton.links[links, 0], nodes)


def build_skeleton(grid: CellGrid, density: NDArray[np.float64], hole: float) -> Skeleton:
    """Thin the cells with travel to lines.

    Parameters
    ----------
    grid : CellGrid
        The cells.
    density : float64 array, shape (c,)
        Traversals of each cell.
    hole : float
        Largest area in square metres of a hole that is filled before thinning.
    """
    from gpszip.simplification.kernels.thinning import thin

    travelled = smooth_density(grid, density, grid.size) > _MIN_DENSITY
    return _link_cells(grid, thin(_fill_holes(grid, travelled, hole), grid.neighbours))


def drop_isolated_vertices(skeleton: Skeleton) -> Skeleton:
    """Drop the vertices without neighbours and renumber the others."""
    used, links = np.unique(skeleton.links, return_inverse=True)
    return Skeleton(skeleton.positions[used], links.reshape(-1, 2).astype(np.int32))


def prune_spurs(skeleton: Skeleton, shortest: float) -> Skeleton:
    """Remove dead ends shorter than ``shortest`` metres; two chains always remain at a junction.

    Examples
    --------
    >>> positions = np.array([[0.0, 0], [9, 0], [18, 0], [9, 1]])
    >>> links = np.array([[0, 1], [1, 2], [1, 3]], np.int32)
    >>> prune_spurs(Skeleton(positions, links), 2.0).links.tolist()
    [[0, 1], [1, 2]]
    """
    while True:
        chains, degrees = build_chains(skeleton), skeleton.degrees
        is_spur = _find_spurs(chains, chains.lengths(skeleton), degrees, shortest)
        if not is_spur.any():
            return skeleton

        # Without its spurs a junction may become part of a longer dead end.
        removed = chains.links[is_spur[chains.owner]]
        links = np.delete(skeleton.links, removed, axis=0)
        skeleton = drop_isolated_vertices(Skeleton(skeleton.positions, links))


def consolidate_junctions(skeleton: Skeleton, shortest: float) -> Skeleton:
    """Merge junctions that a chain shorter than ``shortest`` metres joins, and rings as short.

    Examples
    --------
    >>> positions = np.array([[0.0, 5], [0, -5], [0, 0], [1, 0], [1, 5], [1, -5]])
    >>> links = np.array([[0, 2], [1, 2], [2, 3], [3, 4], [3, 5]], np.int32)
    >>> consolidate_junctions(Skeleton(positions, links), 2.0).degrees.max()
    np.int64(4)
    """
    # Find the links of short chains between junctions.
    chains, degrees = build_chains(skeleton), skeleton.degrees
    is_short = (chains.lengths(skeleton) < shortest) & (degrees[chains.ends] > 2).all(axis=1)
    short_links = skeleton.links[chains.links[is_short[chains.owner]]]

    # Move each group of vertices that they join to its mean.
    group, groups = _label_components(short_links[:, 0], short_links[:, 1], len(skeleton.positions))
    sums = np.stack(
        [np.bincount(group, weights=axis, minlength=groups) for axis in skeleton.positions.T],
        axis=1,
    )
    positions = sums / np.bincount(group, minlength=groups)[:, None].astype(np.float64)

    # Drop links within a group and duplicates.
    links = np.sort(group[skeleton.links], axis=1)
    links = np.unique(links[links[:, 0] != links[:, 1]], axis=0).astype(np.int32)
    return drop_isolated_vertices(Skeleton(positions, links))


def smooth_skeleton(skeleton: Skeleton, passes: int) -> Skeleton:
    """Smooth the chains of a skeleton; dead ends and junctions stay.

    Each pass moves a vertex halfway to the middle of its two neighbours.
    """
    positions, (low, high) = skeleton.positions, skeleton.links.T
    is_inner = (skeleton.degrees == 2)[:, None]
    for _ in range(passes):
        # Sum of the neighbours, coordinate by coordinate.
        sums = np.stack(
            [
                np.bincount(low, weights=axis[high], minlength=len(positions))
                + np.bincount(high, weights=axis[low], minlength=len(positions))
                for axis in positions.T
            ],
            axis=1,
        )
        positions = np.where(is_inner, 0.5 * positions + 0.25 * sums, positions)
    return Skeleton(positions, skeleton.links)


def simplify_chains(
    skeleton: Skeleton, chains: Chains, tolerance: float
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Drop vertices that the shape of chains doesn't need (Douglas and Peucker).

    Parameters
    ----------
    skeleton : Skeleton
        The vertices.
    chains : Chains
        The chains of the skeleton.
    tolerance : float
        Largest distance in metres between a dropped vertex and the simplified chain.

    Returns
    -------
    offsets : int64 array, shape (c + 1,)
        Chain i keeps ``vertices[offsets[i]:offsets[i + 1]]``.
    vertices : int32 array
        Remaining vertices of all chains.
    """
    from gpszip.simplification.kernels.smoothing import simplify_lines

    first = chains.offsets + np.arange(len(chains) + 1)
    kept = simplify_lines(skeleton.positions[chains.nodes], first, tolerance)
    return np.append(0, np.cumsum(kept))[first], chains.nodes[kept]


def _find_spurs(
    chains: Chains, lengths: NDArray[np.float64], degrees: NDArray[np.int64], shortest: float
) -> NDArray[np.bool_]:
    """Which chains are spurs: the shortest dead ends at each junction, except its last two chains.

    Parameters
    ----------
    chains : Chains
        The chains.
    lengths : float64 array, shape (c,)
        Length of each chain in metres.
    degrees : int64 array, shape (n,)
        Number of neighbours of each vertex.
    shortest : float
        Length in metres below which a dead end is a spur.
    """
    # Short chains between a dead end and a junction.
    degree = degrees[chains.ends]
    is_dead_end = (degree.min(axis=1) == 1) & (degree.max(axis=1) > 2)
    spurs = np.flatnonzero(is_dead_end & (lengths < shortest))

    # Rank them by length at each junction.
    junction = chains.ends[spurs, degree[spurs].argmax(axis=1)]
    order = np.lexsort((lengths[spurs], junction))
    spurs, junction = spurs[order], junction[order]
    _, first, inverse = np.unique(junction, return_index=True, return_inverse=True)
    rank = np.arange(len(spurs)) - first[inverse]

    # Keep two chains at each junction.
    is_spur = np.zeros(len(chains), np.bool_)
    is_spur[spurs[rank < degrees[junction] - 2]] = True
    return is_spur


def _fill_holes(grid: CellGrid, area: NDArray[np.bool_], hole: float) -> NDArray[np.bool_]:
    """Fill the holes of an area up to a size in square metres."""
    # Connected components of the cells outside of the area, over sides.
    sides = grid.neighbours[:, ::2]
    cell, k = np.nonzero((sides >= 0) & ~area[:, None] & ~area[np.maximum(sides, 0)])
    group, groups = _label_components(cell, sides[cell, k], len(grid))

    # Components at the margin of the grid are no holes.
    is_open = np.zeros(groups, np.bool_)
    is_open[group[(sides < 0).any(axis=1)]] = True
    is_small = np.bincount(group, minlength=groups) * grid.size**2 <= hole
    return area | (is_small & ~is_open)[group]


def _label_components(
    first: NDArray[np.integer], second: NDArray[np.integer], count: int
) -> tuple[NDArray[np.int32], int]:
    """Connected component of each of ``count`` vertices joined by pairs, and their number."""
    adjacency = coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    groups, group = connected_components(adjacency, directed=False)
    return group, groups


def _link_cells(grid: CellGrid, thinned: NDArray[np.bool_]) -> Skeleton:
    """Link neighbouring cells; diagonal ones only if no third cell joins them."""
    cells = np.flatnonzero(thinned)
    neighbours = grid.neighbours[cells]
    is_set = (neighbours >= 0) & thinned[np.maximum(neighbours, 0)]

    # Four of the eight directions reach each pair once.
    links = []
    for k in range(4):
        linked = is_set[:, k] & ~(is_set[:, k - 1] | is_set[:, k + 1]) if k % 2 else is_set[:, k]
        links.append(np.stack((cells[linked], neighbours[linked, k]), axis=1))

    pairs = np.sort(np.concatenate(links), axis=1)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return drop_isolated_vertices(Skeleton(grid.centers, pairs.astype(np.int32)))
