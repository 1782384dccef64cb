"""Branches of a merge tree: curves of archives, with walks for them on a common grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.numbering import number_by_visit
from gpszip.mapping.time_grid import TimeGrid, build_time_grid
from gpszip.merging.deviation import Curve, order_by_start, sample_weighted, share_at_knots
from gpszip.model import GridWalk, GridWalks, QuantisationGrid
from gpszip.model.grid import step_size

__all__ = ["ArchiveCurves", "Branch", "build_leaf", "build_leaves", "concatenate_branches"]

T = TypeVar("T")

#: Slots from which on a time grid is sparse.
_SPARSE_SLOTS = 500_000

#: Largest share of the weight that knots have in searches: without any weight between them, curves
#: would stray there.
_MAX_SHARE_AT_KNOTS = 0.6


@dataclass(frozen=True, eq=False)
class ArchiveCurves:
    """The curves of one archive, on the plane that all archives share, and its map.

    Parameters
    ----------
    curves : tuple of Curve
        One for each track.
    nodes : float64 array, shape (V, d)
        Positions of the map's nodes in metres.
    knot_nodes : tuple of int32 arrays
        Node at each knot of each curve.
    grid : QuantisationGrid
        The archive's grid, whose step sizes are tried.
    step : float, optional
        Seconds between two samples of the log, where known.
    limit_share : float, default 1.0
        Share of the limit by which these curves may be moved.
    """

    curves: tuple[Curve, ...]
    nodes: NDArray[np.float64]
    knot_nodes: tuple[NDArray[np.int32], ...]
    grid: QuantisationGrid
    step: float | None = None
    limit_share: float = 1.0

    @cached_property
    def at_knots(self) -> float:
        """Largest share of the log's samples at knots."""
        return share_at_knots(self.curves, self.step)

    @cached_property
    def points(self) -> tuple[Curve, ...]:
        """The curves as weighted points."""
        return tuple(sample_weighted(self.curves, min(self.at_knots, _MAX_SHARE_AT_KNOTS)))

    @property
    def knots(self) -> int:
        """Number of knots of all curves."""
        return sum(map(len, self.knot_nodes))


@dataclass(frozen=True, eq=False)
class Branch:
    """Some of the curves, with walks for them on the common grid.

    Parameters
    ----------
    curves : tuple of Curve
        One for each track.
    points : tuple of Curve
        The same as weighted points.
    walks : GridWalks
        One for each track.
    groups : tuple of int
        Number of the archive of each track.
    """

    curves: tuple[Curve, ...]
    points: tuple[Curve, ...]
    walks: GridWalks
    groups: tuple[int, ...]

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the tracks."""
        return tuple(curve.track.id for curve in self.curves)

    def sorted(self) -> Branch:
        """Return the same tracks in the order of their starts."""
        order = order_by_start(self.curves)
        walks = GridWalks(self.walks.nodes, _pick(self.walks.walks, order))
        return Branch(
            _pick(self.curves, order),
            _pick(self.points, order),
            number_by_visit(walks),
            _pick(self.groups, order),
        )

    def time_grid(self, grid: QuantisationGrid) -> TimeGrid:
        """Time grid over the points; a sparse one where a full one would be very large."""
        tracks, gaps = [point.track for point in self.points], [point.gaps for point in self.points]
        time_grid = build_time_grid(tracks, gaps, grid)
        if len(time_grid.time_steps) < _SPARSE_SLOTS:
            return time_grid
        return build_time_grid(tracks, gaps, grid, sparse=True)

    def point_groups(self) -> NDArray[np.int64]:
        """Number of the archive of each point."""
        return np.repeat(self.groups, [len(point.track) for point in self.points])


def build_leaves(archives: Sequence[ArchiveCurves], grid: QuantisationGrid) -> list[Branch]:
    """Round the walks of all archives to a grid."""
    return [build_leaf(archive, grid, number) for number, archive in enumerate(archives)]


def build_leaf(archive: ArchiveCurves, grid: QuantisationGrid, number: int) -> Branch:
    """Round the walks of one archive to a grid.

    Parameters
    ----------
    archive : ArchiveCurves
        The archive.
    grid : QuantisationGrid
        The common grid.
    number : int
        Number of the archive.
    """
    # Round the nodes.
    origin = np.asarray(grid.origin, dtype=np.float64) / 1000
    nodes = np.rint((archive.nodes - origin) / step_size(grid.space)).astype(np.int64)

    # Round the times of the knots.
    walks = []
    for curve, knot_nodes in zip(archive.curves, archive.knot_nodes, strict=True):
        exact_steps = (curve.track.times - grid.epoch / 1000) / step_size(grid.time)
        walks.append(GridWalk(knot_nodes, np.rint(exact_steps).astype(np.int64), curve.gaps))
    return Branch(
        archive.curves, archive.points, GridWalks(nodes, tuple(walks)), (number,) * len(walks)
    )


def concatenate_branches(branches: Sequence[Branch]) -> Branch:
    """Concatenate the tracks and nodes of branches; no nodes are merged."""
    walks: list[GridWalk] = []
    first_node = 0
    for branch in branches:
        # Each branch numbers its nodes from 0: shift them behind those of the branches before.
        walks += [
            replace(walk, nodes=walk.nodes + np.int32(first_node)) for walk in branch.walks.walks
        ]
        first_node += len(branch.walks.nodes)

    nodes = np.concatenate([branch.walks.nodes for branch in branches])
    groups = tuple(group for branch in branches for group in branch.groups)
    curves = tuple(curve for branch in branches for curve in branch.curves)
    points = tuple(point for branch in branches for point in branch.points)
    return Branch(curves, points, GridWalks(nodes, tuple(walks)), groups)


def _pick(values: Sequence[T], order: Sequence[int]) -> tuple[T, ...]:
    return tuple(values[i] for i in order)
