"""Edges drawn together into bundles: each follows the way that the others share, instead of cutting its corners.

Rare, noisy samples make one street into a thicket of nearly parallel edges. Here they attract each other: nodes move to
where edges are dense, every edge takes the cheapest way between its ends over dense ground, and the ways taken are the
ground of the next round.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.simplification.cell_grid import (
    CellGrid,
    build_cell_grid,
    find_cells,
    line_density,
    smooth_density,
)
from gpszip.simplification.corridors import corridor_bounds

__all__ = ["Bundles", "bundle_edges", "weigh_by_spacing"]

#: Rounds of attraction; after the second hardly an edge moves.
_ROUNDS = 2

#: Each round looks more closely, by this factor.
_SCALE_DECAY = 0.7

#: A node goes no farther than this many scales. A way between two samples stays in the ellipse about them whose axis is so many times
#: their distance; samples err by so many scales.
_REACH, _DETOUR, _MARGIN = 2.5, 1.35, 3.0

#: Price of a metre: 1 / (floor + density) to this power. The floor is what untravelled ground counts for in single edges.
_FLOOR, _POWER = 0.3, 0.8

#: Sides of a cell in one scale.
_CELLS_PER_SCALE = 2.0

#: More cells than this, and they are made larger.
_MAX_CELLS = 4_000_000


@dataclass(frozen=True, eq=False)
class Bundles:
    """Where the edges went.

    Parameters
    ----------
    grid : CellGrid
        The ground.
    density : float64 array, shape (c,)
        Travels of each cell in sides of a cell.
    """

    grid: CellGrid
    density: NDArray[np.float64]


def bundle_edges(
    nodes: NDArray[np.float64],
    edges: NDArray[np.int32],
    travels: NDArray[np.float64],
    spacing: NDArray[np.float64],
    scale: float,
) -> Bundles:
    """Draw the edges together.

    Parameters
    ----------
    nodes : float64 array, shape (V, 2)
        Metres.
    edges : int32 array, shape (E, 2)
        At least one.
    travels : float64 array, shape (E,)
        How often each was travelled.
    spacing : float64 array, shape (E,)
        Metres of each that may have been travelled unseen. Those with long chords, which cut more corners, count less at first.
    scale : float
        Deviation in metres of the bell by which edges attract each other.
    """
    from gpszip.simplification.kernels.density import find_peaks
    from gpszip.simplification.kernels.routes import cheapest_paths

    starts, ends = nodes[edges[:, 0]], nodes[edges[:, 1]]
    length = np.linalg.norm(ends - starts, axis=1)
    grid = _build_grid(starts, ends, length, scale)
    density = line_density(grid, starts, ends, travels * weigh_by_spacing(spacing, travels))
    home = np.maximum(find_cells(grid, nodes), 0)
    used = np.unique(edges)
    at = home.copy()
    for turn in range(_ROUNDS):
        height = smooth_density(grid, density, scale * _SCALE_DECAY**turn)
        at[used] = find_peaks(
            nodes[used],
            home[used],
            grid.centers,
            grid.neighbours,
            np.log(height + 1e-3),
            _REACH * scale,
            scale,
        )
        price = (_FLOOR + height) ** -_POWER
        first, last = at[edges[:, 0]], at[edges[:, 1]]
        apart = np.linalg.norm(grid.centers[last] - grid.centers[first], axis=1)
        offsets, cells = cheapest_paths(
            grid.centers,
            grid.neighbours,
            price,
            first,
            last,
            *corridor_bounds(apart, spacing, _DETOUR, _MARGIN * scale),
        )
        density = np.bincount(
            cells, weights=np.repeat(travels, np.diff(offsets)), minlength=len(grid)
        ).astype(np.float64)
    return Bundles(grid, density)


def weigh_by_spacing(
    spacing: NDArray[np.float64], travels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weight of edges by their chords in metres: half for a typical one, less for longer ones, which cut corners."""
    typical = float(np.average(spacing, weights=travels))
    weight: NDArray[np.float64] = 1 / (1 + (spacing / typical) ** 2)
    return weight


def _build_grid(
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    length: NDArray[np.float64],
    scale: float,
) -> CellGrid:
    size, margin = scale / _CELLS_PER_SCALE, math.ceil(_REACH * _CELLS_PER_SCALE)
    # Lines overlap, so that this is a bound.
    while (length.sum() / size + len(length)) * (2 * margin + 1) > 8 * _MAX_CELLS:
        size *= 1.5
    grid = build_cell_grid(starts, ends, size, margin)
    while len(grid) > _MAX_CELLS:
        size *= 1.5
        grid = build_cell_grid(starts, ends, size, margin)
    return grid
