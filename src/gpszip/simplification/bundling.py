"""Edge bundling: nearly parallel edges of the road map move together, onto the same course.

Sparse, noisy samples turn one street into a thicket of nearly parallel edges that cut its corners.
Bundling lets these edges attract each other. Each round has two steps:

1. Nodes move to where the density of edges is high.
2. Every edge takes the cheapest path between its ends over dense cells.

The paths make up the density of the next round.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.simplification.cell_grid import (
    CellGrid,
    build_cell_grid,
    count_cells,
    find_cells,
    line_density,
    smooth_density,
)
from gpszip.simplification.corridors import corridor_bounds

__all__ = ["Bundles", "bundle_edges", "weigh_by_spacing"]

#: Rounds of attraction; after the second one hardly any edge moves.
_ROUNDS = 2

#: Factor by which the smoothing scale shrinks from round to round.
_SCALE_DECAY = 0.7

#: Largest distance that a node moves, in scales.
_REACH = 2.5

#: Longest path between two samples, as a multiple of their distance.
_DETOUR = 1.35

#: Error of samples, in scales.
_MARGIN = 3.0

#: Traversals added to the density of every cell, so that cells without travel have a finite price.
_FLOOR = 0.3

#: The price of a metre is (floor + density) to the power of minus this.
_POWER = 0.8

#: Added to the density before its logarithm is taken, in traversals.
_MIN_HEIGHT = 1e-3

#: Cells in one scale, along each axis.
_CELLS_PER_SCALE = 2.0

#: Largest number of cells; above it cells become larger.
_MAX_CELLS = 4_000_000

#: Factor by which cells become larger.
_CELL_GROWTH = 1.5


@dataclass(frozen=True, eq=False)
class Bundles:
    """The density of bundled edges.

    Parameters
    ----------
    grid : CellGrid
        Cells along the edges.
    density : float64 array, shape (c,)
        Traversals of each cell, in sides of a cell.
    """

    grid: CellGrid
    density: NDArray[np.float64]


def bundle_edges(
    nodes: NDArray[np.float64],
    edges: NDArray[np.int32],
    counts: NDArray[np.float64],
    spacing: NDArray[np.float64],
    scale: float,
) -> Bundles:
    """Bundle the edges of a road map.

    Parameters
    ----------
    nodes : float64 array, shape (V, 2)
        Positions in metres.
    edges : int32 array, shape (E, 2)
        Nodes of each edge; at least one edge.
    counts : float64 array, shape (E,)
        Traversals of each edge.
    spacing : float64 array, shape (E,)
        Unobserved length of each edge in metres. Edges with a large one cut more corners, and so
        have less weight in the first round.
    scale : float
        Standard deviation in metres of the Gaussian by which edges attract each other; a cell if
        that is larger.
    """
    from gpszip.simplification.kernels.density import find_peaks
    from gpszip.simplification.kernels.grid_paths import cheapest_monotone_paths

    # The density of straight edges.
    starts, ends = nodes[edges[:, 0]], nodes[edges[:, 1]]
    length = np.linalg.norm(ends - starts, axis=1)
    grid = _build_grid(starts, ends, length, scale)
    scale = max(scale, grid.size)
    density = line_density(grid, starts, ends, counts * weigh_by_spacing(spacing, counts))

    # Alternate between moving nodes along the density and finding paths of edges over it.
    start_cell = np.maximum(find_cells(grid, nodes), 0)
    used = np.unique(edges)
    cell = start_cell.copy()
    for round_number in range(_ROUNDS):
        # Move nodes to peaks of the density near them.
        height = smooth_density(grid, density, scale * _SCALE_DECAY**round_number)
        cell[used] = find_peaks(
            nodes[used],
            start_cell[used],
            grid.centers,
            grid.neighbours,
            np.log(height + _MIN_HEIGHT),
            _REACH * scale,
            scale,
        )

        # Find the cheapest path of each edge.
        price = (_FLOOR + height) ** -_POWER
        first, last = cell[edges[:, 0]], cell[edges[:, 1]]
        distance = np.linalg.norm(grid.centers[last] - grid.centers[first], axis=1)
        offsets, cells = cheapest_monotone_paths(
            grid.centers,
            grid.neighbours,
            grid.size,
            price,
            first,
            last,
            *corridor_bounds(distance, spacing, _DETOUR, _MARGIN * scale),
        )

        # Count the traversals of each cell.
        density = np.bincount(
            cells, weights=np.repeat(counts, np.diff(offsets)), minlength=len(grid)
        ).astype(np.float64)
    return Bundles(grid, density)


def weigh_by_spacing(
    spacing: NDArray[np.float64], counts: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weight of edges by their unobserved length: 1/2 for a typical edge, less for longer ones.

    With s the unobserved length and m its mean over all traversals, the weight is
    ``1 / (1 + (s / m)^2)``. Edges with a long unobserved length cut corners.

    Parameters
    ----------
    spacing : float64 array, shape (E,)
        Unobserved length of each edge in metres.
    counts : float64 array, shape (E,)
        Traversals of each edge.
    """
    typical = float(np.average(spacing, weights=counts))
    weight: NDArray[np.float64] = 1 / (1 + (spacing / typical) ** 2)
    return weight


def _build_grid(
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    length: NDArray[np.float64],
    scale: float,
) -> CellGrid:
    """The grid about all edges, with as small cells as memory allows."""
    size, margin = scale / _CELLS_PER_SCALE, math.ceil(_REACH * _CELLS_PER_SCALE)

    # Bound the number of cells before any is built. Edges overlap, so 8 times as many may pass.
    while (length.sum() / size + len(length)) * (2 * margin + 1) > 8 * _MAX_CELLS:
        size *= _CELL_GROWTH

    # Then count them, and build the grid once.
    while count_cells(starts, ends, size, margin) > _MAX_CELLS:
        size *= _CELL_GROWTH
    return build_cell_grid(starts, ends, size, margin)
