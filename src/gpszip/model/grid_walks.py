"""Walks as integers on an archive's quantisation grid: what the coder codes, bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpszip.model.text import count_text

__all__ = ["GridWalk", "GridWalks", "PieceEnds", "concatenated_ends", "ends_of_walks", "refined"]


@dataclass(frozen=True, eq=False, repr=False)
class GridWalk:
    """One track as a walk over nodes.

    Parameters
    ----------
    nodes : int32 array, shape (k + 1,)
        Node at each knot, k >= 0. The same node twice running is a stop.
    time_steps : int64 array, shape (k + 1,)
        Time step of each knot, strictly increasing; all 0 in an archive without times.
    gaps : bool array, shape (k,)
        Whether each segment is a gap, in which no travel is claimed.
    """

    nodes: NDArray[np.int32]
    time_steps: NDArray[np.int64]
    gaps: NDArray[np.bool_]

    def __repr__(self) -> str:
        knots, gaps = len(self.nodes), int(self.gaps.sum())
        return f"GridWalk({count_text(knots, 'knot')}, {count_text(gaps, 'gap')})"


@dataclass(frozen=True, eq=False, repr=False)
class PieceEnds:
    """When travel begins and ends in each piece, finer than the time steps of the knots.

    Parameters
    ----------
    tick : int
        Index into :data:`gpszip.codec.ends.TICKS`; 0 where pieces begin and end at their knots.
    first, last : int64 arrays, shape (P,)
        Ticks since the epoch at which travel begins and ends in each of the P pieces, walk after
        walk.
    """

    tick: int
    first: NDArray[np.int64]
    last: NDArray[np.int64]

    def __repr__(self) -> str:
        return f"PieceEnds(tick {self.tick}, {count_text(len(self.first), 'piece')})"


@dataclass(frozen=True, eq=False, repr=False)
class GridWalks:
    """All walks of an archive with the nodes that they share.

    Parameters
    ----------
    nodes : int64 array, shape (V, d)
        Coordinates in grid steps, in the order in which the walks first visit them.
    walks : tuple of GridWalk
        One for each track.
    timed : bool
        Whether times are kept.
    ends : PieceEnds, optional
        Where pieces begin and end; None where only their knots are known.
    untimed : frozenset of int
        Numbers of the walks whose log has no times, in an archive where others have some.
    """

    nodes: NDArray[np.int64]
    walks: tuple[GridWalk, ...]
    timed: bool = True
    ends: PieceEnds | None = None
    untimed: frozenset[int] = frozenset()

    def __repr__(self) -> str:
        return f"GridWalks({len(self.walks):,} on {count_text(len(self.nodes), 'node')})"

    @cached_property
    def first_pieces(self) -> NDArray[np.int64]:
        """Number of the first piece of each walk, and of all pieces: int64, shape (n + 1,)."""
        gaps = [np.count_nonzero(walk.gaps) for walk in self.walks]
        return np.concatenate([[0], np.cumsum(np.array(gaps, np.int64) + 1)])


def ends_of_walks(walks: GridWalks, first: int, after: int) -> PieceEnds | None:
    """Ends of the pieces of walks ``first`` to ``after - 1``."""
    # Tick 0 says that pieces last from knot to knot; the arrays are empty then.
    if walks.ends is None or walks.ends.tick == 0:
        return walks.ends
    pieces = slice(walks.first_pieces[first], walks.first_pieces[after])
    return PieceEnds(walks.ends.tick, walks.ends.first[pieces], walks.ends.last[pieces])


def concatenated_ends(groups: Sequence[GridWalks]) -> PieceEnds | None:
    """Ends of all pieces of several groups; None unless all groups have ends on the same tick."""
    # Ticks of different lengths can't stand in one array, and a group without ends has none to add.
    ends = [group.ends for group in groups if group.ends is not None]
    if len(ends) < len(groups) or len({group_ends.tick for group_ends in ends}) > 1:
        return None
    return PieceEnds(
        ends[0].tick,
        np.concatenate([group_ends.first for group_ends in ends]),
        np.concatenate([group_ends.last for group_ends in ends]),
    )


def refined(walks: GridWalks, times: int) -> GridWalks:
    """Return the same walks on the grid whose steps are halved ``times`` times.

    Examples
    --------
    >>> walk = GridWalk(np.array([0], np.int32), np.array([3]), np.zeros(0, bool))
    >>> refined(GridWalks(np.array([[5, -1]]), (walk,)), 2).nodes.tolist()
    [[20, -4]]
    """
    # A point has twice the number on a grid of half the step, a shift by a bit. Ends
    # of pieces and shapes stay behind: priors don't need them, and appending finds them anew.
    finer = tuple(GridWalk(walk.nodes, walk.time_steps << times, walk.gaps) for walk in walks.walks)
    return GridWalks(walks.nodes << times, finer, walks.timed)
