"""Parts of a merge: the curves of an archive, and those of several with walks for them on a common lattice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.walks import number_by_visit
from gpszip.mapping.time_grid import TimeGrid, build_time_grid
from gpszip.merging.deviation import Curve, order_by_start, sample_weighted, share_at_knots
from gpszip.model import GridWalk, GridWalks, QuantisationGrid
from gpszip.model.grid import step_size

__all__ = ["Branch", "ArchiveCurves", "build_leaf", "build_leaves", "concatenate_branches"]

T = TypeVar("T")

#: Slots from which on only those next to points are taken.
_SPARSE = 500_000

#: The most weight that knots have in searches: without any between them, curves would stray there.
_AT_KNOTS = 0.6


@dataclass(frozen=True, eq=False)
class ArchiveCurves:
    """The curves of one archive, on the plane that all share, and its map.

    Parameters
    ----------
    curves : tuple of Curve
        One for each track.
    nodes : float64 array, shape (V, d)
        Places of the map's nodes in metres.
    knot_nodes : tuple of int32 arrays
        Node at each knot of each curve.
    grid : Frame
        The archive's lattice, whose quanta are tried.
    step : float, optional
        Seconds between two samples of the log, where that is known.
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
        """Share of the log's points that may lie at knots."""
        return share_at_knots(self.curves, self.step)

    @cached_property
    def points(self) -> tuple[Curve, ...]:
        """The curves as points with weights."""
        return tuple(sample_weighted(self.curves, min(self.at_knots, _AT_KNOTS)))

    @property
    def knots(self) -> int:
        """Number of knots of all curves."""
        return sum(map(len, self.knot_nodes))


@dataclass(frozen=True, eq=False)
class Branch:
    """Some of the curves with walks for them on the common lattice."""

    curves: tuple[Curve, ...]
    points: tuple[Curve, ...]
    walks: GridWalks
    groups: tuple[int, ...]

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the tracks."""
        return tuple(curve.track.id for curve in self.curves)

    def sorted(self) -> Branch:
        """The same in the order of starts."""
        order = order_by_start(self.curves)
        walks = GridWalks(self.walks.nodes, _pick(self.walks.walks, order))
        return Branch(
            _pick(self.curves, order),
            _pick(self.points, order),
            number_by_visit(walks),
            _pick(self.groups, order),
        )

    def time_grid(self, grid: QuantisationGrid) -> TimeGrid:
        """The slots of a lattice over the points, sparse ones where there would be very many."""
        tracks, gaps = [point.track for point in self.points], [point.gaps for point in self.points]
        time_grid = build_time_grid(tracks, gaps, grid)
        return (
            time_grid
            if len(time_grid.time_steps) < _SPARSE
            else build_time_grid(tracks, gaps, grid, sparse=True)
        )

    def point_groups(self) -> NDArray[np.int64]:
        """Archive of each point."""
        return np.repeat(self.groups, [len(point.track) for point in self.points])


def build_leaves(parts: Sequence[ArchiveCurves], grid: QuantisationGrid) -> list[Branch]:
    """Round all parts to a lattice."""
    return [build_leaf(part, grid, number) for number, part in enumerate(parts)]


def build_leaf(part: ArchiveCurves, grid: QuantisationGrid, number: int) -> Branch:
    """Round one part to a lattice."""
    corner = np.asarray(grid.origin, dtype=np.float64) / 1000
    nodes = np.rint((part.nodes - corner) / step_size(grid.space)).astype(np.int64)
    walks = [
        GridWalk(
            visits,
            np.rint((curve.track.times - grid.epoch / 1000) / step_size(grid.time)).astype(
                np.int64
            ),
            curve.gaps,
        )
        for curve, visits in zip(part.curves, part.knot_nodes, strict=True)
    ]
    return Branch(part.curves, part.points, GridWalks(nodes, tuple(walks)), (number,) * len(walks))


def concatenate_branches(branches: Sequence[Branch]) -> Branch:
    """Put branches side by side, each with its own nodes still."""
    walks: list[GridWalk] = []
    first = 0
    for branch in branches:
        walks += [replace(walk, nodes=walk.nodes + np.int32(first)) for walk in branch.walks.walks]
        first += len(branch.walks.nodes)
    nodes = np.concatenate([branch.walks.nodes for branch in branches])
    groups = tuple(group for branch in branches for group in branch.groups)
    curves = tuple(curve for branch in branches for curve in branch.curves)
    points = tuple(point for branch in branches for point in branch.points)
    return Branch(curves, points, GridWalks(nodes, tuple(walks)), groups)


def _pick(values: Sequence[T], order: Sequence[int]) -> tuple[T, ...]:
    return tuple(values[i] for i in order)
