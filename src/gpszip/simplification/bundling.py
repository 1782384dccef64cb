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

from gpszip.simplification.cell_grid import CellGrid, cells_along, cells_at, line_density, smooth
from gpszip.simplification.corridors import corridors

__all__ = ["Bundles", "bundle", "trust"]

#: Rounds of attraction; after the second hardly an edge moves.
_ROUNDS = 2

#: Each round looks more closely, by this factor.
_SHARPER = 0.7

#: A node goes no farther than this many scales. A way between two samples stays in the ellipse about them whose axis is so many times
#: their distance; samples err by so many scales.
_REACH, _DETOUR, _MARGIN = 2.5, 1.35, 3.0

#: Price of a metre: 1 / (floor + density) to this power. The floor is what untravelled ground counts for in single edges.
_FLOOR, _POWER = 0.3, 0.8

#: Sides of a cell in one scale.
_CELLS = 2.0

#: More cells than this, and they are made larger.
_MOST_CELLS = 4_000_000


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


def bundle(
    nodes: NDArray[np.float64], edges: NDArray[np.int32], travels: NDArray[np.float64], chord: NDArray[np.float64], scale: float
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
    chord : float64 array, shape (E,)
        Metres of each that may have been travelled unseen. Those with long chords, which cut more corners, count less at first.
    scale : float
        Deviation in metres of the bell by which edges attract each other.
    """
    from gpszip.simplification.kernels.density import climb
    from gpszip.simplification.kernels.routes import cheapest_routes

    starts, ends = nodes[edges[:, 0]], nodes[edges[:, 1]]
    length = np.linalg.norm(ends - starts, axis=1)
    grid = _ground(starts, ends, length, scale)
    density = line_density(grid, starts, ends, travels * trust(chord, travels))
    home = np.maximum(cells_at(grid, nodes), 0)
    used = np.unique(edges)
    at = home.copy()
    for turn in range(_ROUNDS):
        height = smooth(grid, density, scale * _SHARPER**turn)
        at[used] = climb(nodes[used], home[used], grid.centers, grid.near, np.log(height + 1e-3), _REACH * scale, scale)
        price = (_FLOOR + height) ** -_POWER
        first, last = at[edges[:, 0]], at[edges[:, 1]]
        apart = np.linalg.norm(grid.centers[last] - grid.centers[first], axis=1)
        offsets, cells = cheapest_routes(grid.centers, grid.near, price, first, last, *corridors(apart, chord, _DETOUR, _MARGIN * scale))
        density = np.bincount(cells, weights=np.repeat(travels, np.diff(offsets)), minlength=len(grid)).astype(np.float64)
    return Bundles(grid, density)


def trust(chord: NDArray[np.float64], travels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weight of edges by their chords in metres: half for a typical one, less for longer ones, which cut corners."""
    typical = float(np.average(chord, weights=travels))
    weight: NDArray[np.float64] = 1 / (1 + (chord / typical) ** 2)
    return weight


def _ground(starts: NDArray[np.float64], ends: NDArray[np.float64], length: NDArray[np.float64], scale: float) -> CellGrid:
    size, margin = scale / _CELLS, math.ceil(_REACH * _CELLS)
    # Lines overlap, so that this is a bound.
    while (length.sum() / size + len(length)) * (2 * margin + 1) > 8 * _MOST_CELLS:
        size *= 1.5
    grid = cells_along(starts, ends, size, margin)
    while len(grid) > _MOST_CELLS:
        size *= 1.5
        grid = cells_along(starts, ends, size, margin)
    return grid
