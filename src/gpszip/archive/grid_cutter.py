"""Cut walks of an archive at times between their knots, on the archive's grid."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.end_kinds import MAX_QUOTIENT
from gpszip.model.grid import QuantisationGrid, step_size
from gpszip.model.grid_walks import GridWalk, GridWalks
from gpszip.walks.restrict import RestrictedKnots

__all__ = ["GridCutter"]

#: Share of a time step by which float noise may move a time off it.
_STEP_TOLERANCE = 1e-6

#: Time steps between a knot and where travel begins that the format can hold; beyond these, a new
#: knot stands there.
_MAX_OFFSET_STEPS = MAX_QUOTIENT

Floats = NDArray[np.float64]


class _Piece(NamedTuple):
    """A piece of what remains of a walk.

    Parameters
    ----------
    knots : int array, shape (k,)
        Indices of its knots.
    begin, end : float
        Seconds at which travel begins and ends.
    """

    knots: NDArray[np.intp]
    begin: float
    end: float


class GridCutter:
    """Brings what remains of walks to the grid.

    Where travel begins or ends too far from its knot for the format to say so, a new knot on the
    line takes the place of that knot.

    Parameters
    ----------
    grid : QuantisationGrid
        The grid.
    walks : GridWalks
        The walks as they are.
    """

    def __init__(self, grid: QuantisationGrid, walks: GridWalks) -> None:
        self._grid = grid
        self._nodes = walks.nodes
        self._new_nodes: list[NDArray[np.int64]] = []
        #: Largest distance in metres between a new knot and the line between its neighbours.
        self.moved = 0.0

    @property
    def nodes(self) -> NDArray[np.int64]:
        """The nodes of the walks, and new ones after them."""
        return np.concatenate([self._nodes, *(node[None] for node in self._new_nodes)])

    def cut(self, walk: GridWalk, kept: RestrictedKnots) -> tuple[GridWalk, Floats]:
        """Cut one walk.

        Parameters
        ----------
        walk : GridWalk
            The walk as it is.
        kept : RestrictedKnots
            What remains of it.

        Returns
        -------
        GridWalk
            What remains, on :attr:`nodes`.
        float64 array, shape (pieces, 2)
            Seconds at which travel begins and ends in each piece; empty for a walk without times.
        """
        # A shape has no times at which it could be cut.
        if not len(kept.time_ranges):
            shape = GridWalk(walk.nodes[kept.knots], walk.time_steps[kept.knots], kept.gaps)
            return shape, kept.time_ranges

        # Cut the pieces; the outer ends of a track have a finer place in the format than those at
        # a gap, and a knot of two pieces has to give way in both.
        pieces = self._distinct_pieces(kept)
        nodes, steps = [], []
        for number, piece in enumerate(pieces):
            before = pieces[number - 1].knots[-1] if number else -1
            after = pieces[number + 1].knots[0] if number + 1 < len(pieces) else len(walk.nodes)
            limits = (
                _MAX_OFFSET_STEPS if number == 0 else int(before < piece.knots[0]),
                _MAX_OFFSET_STEPS if number == len(pieces) - 1 else int(after > piece.knots[-1]),
            )
            own_nodes, own_steps = self._cut_piece(walk, piece, limits)
            nodes.append(own_nodes)
            steps.append(own_steps)

        # Join them, with a gap between any two.
        gaps = np.zeros(sum(map(len, nodes)) - 1, np.bool_)
        gaps[np.cumsum([len(own) for own in nodes])[:-1] - 1] = True
        time_ranges = np.array([(piece.begin, piece.end) for piece in pieces])
        return GridWalk(np.concatenate(nodes), np.concatenate(steps), gaps), time_ranges

    def _distinct_pieces(self, kept: RestrictedKnots) -> list[_Piece]:
        """Pieces of a walk; those that have a knot in common, and no time step between, are one."""
        # The knots and the time range of each piece.
        bounds = [0, *(np.flatnonzero(kept.gaps) + 1).tolist(), len(kept.knots)]
        pieces: list[_Piece] = []
        for (first, after), (begin, end) in zip(
            pairwise(bounds), kept.time_ranges.tolist(), strict=True
        ):
            piece = _Piece(kept.knots[first:after], begin, end)

            # Join it to the piece before where both can't be cut apart.
            if pieces and piece.knots[0] <= pieces[-1].knots[-1]:
                last_step = self._steps_around(pieces[-1].begin, pieces[-1].end)[1]
                if self._steps_around(begin, end)[0] <= last_step:
                    before = pieces.pop()
                    piece = _Piece(np.union1d(before.knots, piece.knots), before.begin, end)
            pieces.append(piece)
        return pieces

    def _cut_piece(
        self, walk: GridWalk, piece: _Piece, limits: tuple[int, int]
    ) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Nodes and time steps of a piece, with new knots where its ends are beyond some steps."""
        # Both ends are cut on the segments as they were: a piece may have but one.
        old_nodes, old_steps = walk.nodes[piece.knots], walk.time_steps[piece.knots]
        nodes, steps = old_nodes.copy(), old_steps.copy()
        begin_step, end_step = self._steps_around(piece.begin, piece.end)
        if begin_step - old_steps[0] > limits[0]:
            nodes[0] = self._add_node(old_nodes[:2], old_steps[:2], begin_step)
            steps[0] = begin_step
        if old_steps[-1] - end_step > limits[1]:
            nodes[-1] = self._add_node(old_nodes[-2:], old_steps[-2:], end_step)
            steps[-1] = end_step

        # Both may be at one time step of one segment.
        if len(steps) > 1 and steps[-1] <= steps[-2]:
            return nodes[:-1], steps[:-1]
        return nodes, steps

    def _steps_around(self, begin: float, end: float) -> tuple[int, int]:
        """The last time step at or before a time, and the first at or after another one."""
        epoch, step = self._grid.epoch / 1000, step_size(self._grid.time)
        first = math.floor((begin - epoch) / step + _STEP_TOLERANCE)
        return first, math.ceil((end - epoch) / step - _STEP_TOLERANCE)

    def _add_node(self, nodes: NDArray[np.int32], steps: NDArray[np.int64], time_step: int) -> int:
        """Add the node nearest to where a segment is at a time step, and return its number."""
        start, stop = self._nodes[nodes]
        share = (time_step - steps[0]) / (steps[1] - steps[0])
        position = start + share * (stop - start)
        node = np.rint(position).astype(np.int64)
        self._new_nodes.append(node)
        distance = float(np.linalg.norm(node - position)) * step_size(self._grid.space)
        self.moved = max(self.moved, distance)
        return len(self._nodes) + len(self._new_nodes) - 1
