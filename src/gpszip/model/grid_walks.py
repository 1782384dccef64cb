"""Map and walks as integers on an archive's lattice: what is coded, bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["GridWalk", "GridWalks", "PieceEnds", "concatenated_ends", "ends_of_walks", "refined"]


@dataclass(frozen=True, eq=False)
class GridWalk:
    """One track as a walk over nodes.

    Parameters
    ----------
    nodes : int32 array, shape (k + 1,)
        Node at each knot, k >= 0. The same node twice in a row is a stop.
    time_steps : int64 array, shape (k + 1,)
        Time cell of each knot, increasing; strictly, save in an archive without times, where all are 0.
    gaps : bool array, shape (k,)
        Parts during which no travel is claimed.
    """

    nodes: NDArray[np.int32]
    time_steps: NDArray[np.int64]
    gaps: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class PieceEnds:
    """When travel begins and ends in each piece, finer than the cells of the knots.

    Parameters
    ----------
    tick : int
        Index into :data:`gpszip.codec.ends.TICKS`; 0 where travel is claimed from knot to knot.
    first, last : int64 arrays, shape (P,)
        Ticks since the epoch at which the claim of each of the P pieces begins and ends, one walk after the other.
    """

    tick: int
    first: NDArray[np.int64]
    last: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class GridWalks:
    """All walks of an archive with the nodes that they share.

    Parameters
    ----------
    nodes : int64 array, shape (V, d)
        Coordinates in quanta, in the order in which the walks first visit them.
    walks : tuple of LatticeWalk
        One for each track.
    timed : bool
        Whether times are kept.
    ends : Ends, optional
        Where pieces begin and end; None where only their knots are known.
    untimed : frozenset of int
        Numbers of the walks whose log has no times, among others that have some.
    """

    nodes: NDArray[np.int64]
    walks: tuple[GridWalk, ...]
    timed: bool = True
    ends: PieceEnds | None = None
    untimed: frozenset[int] = frozenset()


def ends_of_walks(walks: GridWalks, first: int, after: int) -> PieceEnds | None:
    """Ends of the pieces of walks ``first`` to ``after - 1``."""
    if walks.ends is None or walks.ends.tick == 0:
        return walks.ends
    bounds = np.cumsum([0] + [1 + int(walk.gaps.sum()) for walk in walks.walks])
    own = slice(bounds[first], bounds[after])
    return PieceEnds(walks.ends.tick, walks.ends.first[own], walks.ends.last[own])


def concatenated_ends(groups: Sequence[GridWalks]) -> PieceEnds | None:
    """Ends of all pieces of several groups, one after the other; None unless all have ends on the same tick."""
    ends = [group.ends for group in groups if group.ends is not None]
    if len(ends) < len(groups) or len({one.tick for one in ends}) > 1:
        return None
    return PieceEnds(
        ends[0].tick,
        np.concatenate([one.first for one in ends]),
        np.concatenate([one.last for one in ends]),
    )


def refined(walks: GridWalks, times: int) -> GridWalks:
    """Return the same walks on the lattice with both quanta halved so many times.

    Examples
    --------
    >>> walk = GridWalk(np.array([0], np.int32), np.array([3]), np.zeros(0, bool))
    >>> refined(GridWalks(np.array([[5, -1]]), (walk,)), 2).nodes.tolist()
    [[20, -4]]
    """
    finer = tuple(GridWalk(walk.nodes, walk.time_steps << times, walk.gaps) for walk in walks.walks)
    return GridWalks(walks.nodes << times, finer, walks.timed)
