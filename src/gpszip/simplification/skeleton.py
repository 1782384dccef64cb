"""Lines as a graph of close vertices: thinned from a density, freed of spurs and knots of noise, smoothed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gpszip.simplification.cell_grid import CellGrid, smooth

__all__ = ["LineGraph", "Strings", "compact", "contract", "prune", "simplified", "skeleton", "smooth_lines", "string"]

#: Density above which ground is taken for a way, in travels.
_TRAVELLED = 0.4


@dataclass(frozen=True, eq=False)
class LineGraph:
    """Vertices, and pairs of neighbouring ones.

    Parameters
    ----------
    places : float64 array, shape (n, 2)
        Metres.
    pairs : int32 array, shape (m, 2)
        Each pair once, the lower number first, sorted.
    """

    places: NDArray[np.float64]
    pairs: NDArray[np.int32]

    @property
    def degrees(self) -> NDArray[np.int64]:
        """Number of neighbours of each vertex."""
        return np.bincount(self.pairs.ravel(), minlength=len(self.places))

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Distance of each pair in metres."""
        length: NDArray[np.float64] = np.linalg.norm(self.places[self.pairs[:, 1]] - self.places[self.pairs[:, 0]], axis=1)
        return length


@dataclass(frozen=True, eq=False)
class Strings:
    """Pairs strung together from end to end, or junction to junction.

    Parameters
    ----------
    offsets : int64 array, shape (w + 1,)
        String i holds ``pairs[offsets[i]:offsets[i + 1]]``.
    pairs : int32 array, shape (m,)
        Numbers of the pairs.
    along : bool array, shape (m,)
        Whether the pair is travelled from its first to its second vertex.
    nodes : int32 array, shape (m + w,)
        String i runs through ``nodes[offsets[i] + i:offsets[i + 1] + i + 1]``.
    """

    offsets: NDArray[np.int64]
    pairs: NDArray[np.int32]
    along: NDArray[np.bool_]
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
        return np.stack((self.nodes[self.offsets[:-1] + number], self.nodes[self.offsets[1:] + number]), axis=1)

    def lengths(self, lines: LineGraph) -> NDArray[np.float64]:
        """Length of each string in metres."""
        return np.bincount(self.owner, weights=lines.lengths[self.pairs], minlength=len(self)).astype(np.float64)


def string(lines: LineGraph) -> Strings:
    """String the pairs together where nothing branches off.

    Examples
    --------
    >>> strings = string(LineGraph(np.array([[0.0, 0], [1, 0], [2, 0]]), np.array([[0, 1], [1, 2]], np.int32)))
    >>> strings[0].tolist(), strings.along.tolist()
    ([0, 1, 2], [True, True])
    """
    from gpszip.graph.road_graph import road_graph
    from gpszip.simplification.kernels.chains import string_ways

    graph = road_graph(lines.places, lines.pairs)
    first, nodes, pairs = string_ways(graph.offsets, graph.targets, graph.edges, len(lines.pairs))
    offsets = first - np.arange(len(first))
    before = np.delete(nodes, first[1:] - 1)
    return Strings(offsets, pairs, before == lines.pairs[pairs, 0], nodes)


def skeleton(grid: CellGrid, density: NDArray[np.float64], hole: float) -> LineGraph:
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

    travelled = smooth(grid, density, grid.size) > _TRAVELLED
    return _linked(grid, thin(_fill(grid, travelled, hole), grid.near))


def compact(lines: LineGraph) -> LineGraph:
    """Drop the vertices without neighbours; the others move up."""
    used, pairs = np.unique(lines.pairs, return_inverse=True)
    return LineGraph(lines.places[used], pairs.reshape(-1, 2).astype(np.int32))


def prune(lines: LineGraph, shortest: float) -> LineGraph:
    """Take away dead ends shorter than ``shortest`` metres, as long as a way goes on through their junction.

    Examples
    --------
    >>> places = np.array([[0.0, 0], [9, 0], [18, 0], [9, 1]])
    >>> prune(LineGraph(places, np.array([[0, 1], [1, 2], [1, 3]], np.int32)), 2.0).pairs.tolist()
    [[0, 1], [1, 2]]
    """
    while True:
        strings, degrees = string(lines), lines.degrees
        spurs = _spurs(strings, strings.lengths(lines), degrees, shortest)
        if not spurs.any():
            return lines
        gone = strings.pairs[spurs[strings.owner]]
        lines = compact(LineGraph(lines.places, np.delete(lines.pairs, gone, axis=0)))


def contract(lines: LineGraph, shortest: float) -> LineGraph:
    """Make one of two junctions that a way shorter than ``shortest`` metres joins, and of a ring as short.

    Examples
    --------
    >>> places = np.array([[0.0, 5], [0, -5], [0, 0], [1, 0], [1, 5], [1, -5]])
    >>> pairs = np.array([[0, 2], [1, 2], [2, 3], [3, 4], [3, 5]], np.int32)
    >>> contract(LineGraph(places, pairs), 2.0).degrees.max()
    np.int64(4)
    """
    strings, degrees = string(lines), lines.degrees
    ends = strings.ends
    short = (strings.lengths(lines) < shortest) & (degrees[ends] > 2).all(axis=1)
    joined = lines.pairs[strings.pairs[short[strings.owner]]]
    count = len(lines.places)
    links = coo_matrix((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(count, count))
    groups, group = connected_components(links, directed=False)
    sums = np.stack([np.bincount(group, weights=axis, minlength=groups) for axis in lines.places.T], axis=1)
    places = sums / np.bincount(group, minlength=groups)[:, None].astype(np.float64)
    pairs = np.sort(group[lines.pairs], axis=1)
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0).astype(np.int32)
    return compact(LineGraph(places, pairs))


def smooth_lines(lines: LineGraph, passes: int) -> LineGraph:
    """Move the vertices between two others halfway to their middle, so many times; ends and junctions stay."""
    places, (low, high) = lines.places, lines.pairs.T
    between = (lines.degrees == 2)[:, None]
    for _ in range(passes):
        sums = np.stack(
            [
                np.bincount(low, weights=axis[high], minlength=len(places)) + np.bincount(high, weights=axis[low], minlength=len(places))
                for axis in places.T
            ],
            axis=1,
        )
        places = np.where(between, 0.5 * places + 0.25 * sums, places)
    return LineGraph(places, lines.pairs)


def simplified(lines: LineGraph, strings: Strings, tolerance: float) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Offsets and vertices of the strings without those that lie within ``tolerance`` metres of what is left (Douglas-Peucker)."""
    from gpszip.simplification.kernels.smoothing import keep_corners

    first = strings.offsets + np.arange(len(strings) + 1)
    kept = keep_corners(lines.places[strings.nodes], first, tolerance)
    return np.append(0, np.cumsum(kept))[first], strings.nodes[kept]


def _spurs(strings: Strings, lengths: NDArray[np.float64], degrees: NDArray[np.int64], shortest: float) -> NDArray[np.bool_]:
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


def _fill(grid: CellGrid, area: NDArray[np.bool_], hole: float) -> NDArray[np.bool_]:
    """Fill the holes of the area; the cells at the edge of the ground are no hole."""
    sides = grid.near[:, ::2]
    cell, k = np.nonzero((sides >= 0) & ~area[:, None] & ~area[np.maximum(sides, 0)])
    links = coo_matrix((np.ones(len(cell)), (cell, sides[cell, k])), shape=(len(grid), len(grid)))
    groups, group = connected_components(links, directed=False)
    open_groups = np.zeros(groups, np.bool_)
    open_groups[group[(sides < 0).any(axis=1)]] = True
    small = np.bincount(group, minlength=groups) * grid.size**2 <= hole
    return area | (small & ~open_groups)[group]


def _linked(grid: CellGrid, thinned: NDArray[np.bool_]) -> LineGraph:
    """Join neighbouring cells; diagonally only where no third cell joins them."""
    cells = np.flatnonzero(thinned)
    around = grid.near[cells]
    on = (around >= 0) & thinned[np.maximum(around, 0)]
    found = []
    for k in range(4):
        joined = on[:, k] & ~(on[:, k - 1] | on[:, k + 1]) if k % 2 else on[:, k]
        found.append(np.stack((cells[joined], around[joined, k]), axis=1))
    pairs = np.sort(np.concatenate(found), axis=1)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return compact(LineGraph(grid.centers, pairs.astype(np.int32)))
