"""Lines as a graph of close vertices: thinned from a density, freed of spurs and knots of noise, smoothed."""

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

#: Density above which ground is taken for a way, in travels.
_MIN_DENSITY = 0.4


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Vertices, and pairs of neighbouring ones.

    Parameters
    ----------
    positions : float64 array, shape (n, 2)
        Metres.
    links : int32 array, shape (m, 2)
        Each pair once, the lower number first, sorted.
    """

    positions: NDArray[np.float64]
    links: NDArray[np.int32]

    @property
    def degrees(self) -> NDArray[np.int64]:
        """Number of neighbours of each vertex."""
        return np.bincount(self.links.ravel(), minlength=len(self.positions))

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Distance of each pair in metres."""
        length: NDArray[np.float64] = np.linalg.norm(
            self.positions[self.links[:, 1]] - self.positions[self.links[:, 0]], axis=1
        )
        return length


@dataclass(frozen=True, eq=False)
class Chains:
    """Pairs strung together from end to end, or junction to junction.

    Parameters
    ----------
    offsets : int64 array, shape (w + 1,)
        String i holds ``pairs[offsets[i]:offsets[i + 1]]``.
    links : int32 array, shape (m,)
        Numbers of the pairs.
    is_forward : bool array, shape (m,)
        Whether the pair is travelled from its first to its second vertex.
    nodes : int32 array, shape (m + w,)
        String i runs through ``nodes[offsets[i] + i:offsets[i + 1] + i + 1]``.
    """

    offsets: NDArray[np.int64]
    links: NDArray[np.int32]
    is_forward: NDArray[np.bool_]
    nodes: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, number: int) -> NDArray[np.int32]:
        """Vertices of one string."""
        return self.nodes[self.offsets[number] + number : self.offsets[number + 1] + number + 1]

    @property
    def owner(self) -> NDArray[np.int64]:
        """String of each entry of ``pairs``."""
        return np.repeat(np.arange(len(self)), np.diff(self.offsets))

    @property
    def ends(self) -> NDArray[np.int32]:
        """First and last vertex of each string, shape (w, 2)."""
        number = np.arange(len(self))
        return np.stack(
            (self.nodes[self.offsets[:-1] + number], self.nodes[self.offsets[1:] + number]), axis=1
        )

    def lengths(self, lines: Skeleton) -> NDArray[np.float64]:
        """Length of each string in metres."""
        return np.bincount(
            self.owner, weights=lines.lengths[self.links], minlength=len(self)
        ).astype(np.float64)


def build_chains(lines: Skeleton) -> Chains:
    """String the pairs together where nothing branches off.

    Examples
    --------
    >>> strings = build_chains(Skeleton(np.array([[0.0, 0], [1, 0], [2, 0]]), np.array([[0, 1], [1, 2]], np.int32)))
    >>> strings[0].tolist(), strings.is_forward.tolist()
    ([0, 1, 2], [True, True])
    """
    from gpszip.graph.road_graph import build_road_graph
    from gpszip.simplification.kernels.chains import chain_edges

    graph = build_road_graph(lines.positions, lines.links)
    first, nodes, pairs = chain_edges(graph.offsets, graph.targets, graph.edges, len(lines.links))
    offsets = first - np.arange(len(first))
    before = np.delete(nodes, first[1:] - 1)
    return Chains(offsets, pairs, before == lines.links[pairs, 0], nodes)


def build_skeleton(grid: CellGrid, density: NDArray[np.float64], hole: float) -> Skeleton:
    """Thin the travelled ground to lines.

    Parameters
    ----------
    grid : CellGrid
        The ground.
    density : float64 array, shape (c,)
        Travels of each cell.
    hole : float
        Untravelled ground of at most so many square metres, with travels all around, is filled first.
    """
    from gpszip.simplification.kernels.thinning import thin

    travelled = smooth_density(grid, density, grid.size) > _MIN_DENSITY
    return _link_cells(grid, thin(_fill_holes(grid, travelled, hole), grid.neighbours))


def drop_isolated_vertices(lines: Skeleton) -> Skeleton:
    """Drop the vertices without neighbours; the others move up."""
    used, pairs = np.unique(lines.links, return_inverse=True)
    return Skeleton(lines.positions[used], pairs.reshape(-1, 2).astype(np.int32))


def prune_spurs(lines: Skeleton, shortest: float) -> Skeleton:
    """Take away dead ends shorter than ``shortest`` metres, as long as a way goes on through their junction.

    Examples
    --------
    >>> places = np.array([[0.0, 0], [9, 0], [18, 0], [9, 1]])
    >>> prune_spurs(Skeleton(places, np.array([[0, 1], [1, 2], [1, 3]], np.int32)), 2.0).links.tolist()
    [[0, 1], [1, 2]]
    """
    while True:
        strings, degrees = build_chains(lines), lines.degrees
        spurs = _find_spurs(strings, strings.lengths(lines), degrees, shortest)
        if not spurs.any():
            return lines
        gone = strings.links[spurs[strings.owner]]
        lines = drop_isolated_vertices(
            Skeleton(lines.positions, np.delete(lines.links, gone, axis=0))
        )


def consolidate_junctions(lines: Skeleton, shortest: float) -> Skeleton:
    """Make one of two junctions that a way shorter than ``shortest`` metres joins, and of a ring as short.

    Examples
    --------
    >>> places = np.array([[0.0, 5], [0, -5], [0, 0], [1, 0], [1, 5], [1, -5]])
    >>> pairs = np.array([[0, 2], [1, 2], [2, 3], [3, 4], [3, 5]], np.int32)
    >>> consolidate_junctions(Skeleton(places, pairs), 2.0).degrees.max()
    np.int64(4)
    """
    strings, degrees = build_chains(lines), lines.degrees
    ends = strings.ends
    short = (strings.lengths(lines) < shortest) & (degrees[ends] > 2).all(axis=1)
    joined = lines.links[strings.links[short[strings.owner]]]
    count = len(lines.positions)
    links = coo_matrix((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(count, count))
    groups, group = connected_components(links, directed=False)
    sums = np.stack(
        [np.bincount(group, weights=axis, minlength=groups) for axis in lines.positions.T], axis=1
    )
    places = sums / np.bincount(group, minlength=groups)[:, None].astype(np.float64)
    pairs = np.sort(group[lines.links], axis=1)
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0).astype(np.int32)
    return drop_isolated_vertices(Skeleton(places, pairs))


def smooth_skeleton(lines: Skeleton, passes: int) -> Skeleton:
    """Move the vertices between two others halfway to their middle, so many times; ends and junctions stay."""
    places, (low, high) = lines.positions, lines.links.T
    between = (lines.degrees == 2)[:, None]
    for _ in range(passes):
        sums = np.stack(
            [
                np.bincount(low, weights=axis[high], minlength=len(places))
                + np.bincount(high, weights=axis[low], minlength=len(places))
                for axis in places.T
            ],
            axis=1,
        )
        places = np.where(between, 0.5 * places + 0.25 * sums, places)
    return Skeleton(places, lines.links)


def simplify_chains(
    lines: Skeleton, strings: Chains, tolerance: float
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Offsets and vertices of the strings without those that lie within ``tolerance`` metres of what is left (Douglas-Peucker)."""
    from gpszip.simplification.kernels.smoothing import simplify_lines

    first = strings.offsets + np.arange(len(strings) + 1)
    kept = simplify_lines(lines.positions[strings.nodes], first, tolerance)
    return np.append(0, np.cumsum(kept))[first], strings.nodes[kept]


def _find_spurs(
    strings: Chains, lengths: NDArray[np.float64], degrees: NDArray[np.int64], shortest: float
) -> NDArray[np.bool_]:
    """Which strings are spurs: the shortest at each junction, two ways always being left there."""
    at = degrees[strings.ends]
    loose = np.flatnonzero((at.min(axis=1) == 1) & (at.max(axis=1) > 2) & (lengths < shortest))
    junction = strings.ends[loose, at[loose].argmax(axis=1)]
    order = np.lexsort((lengths[loose], junction))
    loose, junction = loose[order], junction[order]
    _, first, inverse = np.unique(junction, return_index=True, return_inverse=True)
    rank = np.arange(len(loose)) - first[inverse]
    spurs = np.zeros(len(strings), np.bool_)
    spurs[loose[rank < degrees[junction] - 2]] = True
    return spurs


def _fill_holes(grid: CellGrid, area: NDArray[np.bool_], hole: float) -> NDArray[np.bool_]:
    """Fill the holes of the area; the cells at the edge of the ground are no hole."""
    sides = grid.neighbours[:, ::2]
    cell, k = np.nonzero((sides >= 0) & ~area[:, None] & ~area[np.maximum(sides, 0)])
    links = coo_matrix((np.ones(len(cell)), (cell, sides[cell, k])), shape=(len(grid), len(grid)))
    groups, group = connected_components(links, directed=False)
    open_groups = np.zeros(groups, np.bool_)
    open_groups[group[(sides < 0).any(axis=1)]] = True
    small = np.bincount(group, minlength=groups) * grid.size**2 <= hole
    return area | (small & ~open_groups)[group]


def _link_cells(grid: CellGrid, thinned: NDArray[np.bool_]) -> Skeleton:
    """Join neighbouring cells; diagonally only where no third cell joins them."""
    cells = np.flatnonzero(thinned)
    around = grid.neighbours[cells]
    on = (around >= 0) & thinned[np.maximum(around, 0)]
    found = []
    for k in range(4):
        joined = on[:, k] & ~(on[:, k - 1] | on[:, k + 1]) if k % 2 else on[:, k]
        found.append(np.stack((cells[joined], around[joined, k]), axis=1))
    pairs = np.sort(np.concatenate(found), axis=1)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return drop_isolated_vertices(Skeleton(grid.centers, pairs.astype(np.int32)))
