"""What learning returns: nodes and walks on a grid."""

from __future__ import annotations

from dataclasses import dataclass

from gpszip.model import GridWalks, QuantisationGrid

__all__ = ["Learned"]


@dataclass(frozen=True, eq=False)
class Learned:
    """Nodes and walks on a grid.

    Parameters
    ----------
    grid : QuantisationGrid
        The grid; on a known map, that of the map with both steps halved ``refinements`` times.
    grid_walks : GridWalks
        A walk for each track.
    refinements : int
        See ``grid``.
    """

    grid: QuantisationGrid
    grid_walks: GridWalks
    refinements: int = 0
