"""Legs of routes without the wandering of a standing receiver.

A receiver that stands still on an edge goes back and forth on it, and one that stands at a node
looks into the edges there. Both are no travel. A leg is one edge in one direction; legs of a piece
go on from each other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.groups import sum_by

__all__ = ["Legs", "remove_wandering"]

#: Metres below which two places on an edge are the same: rounding.
_SAME = 1e-6

Mask = NDArray[np.bool_]


class Legs(NamedTuple):
    """Legs of the routes of all pieces, in the order of travel.

    Parameters
    ----------
    piece : int64 array, shape (n,)
        Piece of a route; within it, a leg begins where the one before ended.
    track : int32 array, shape (n,)
        Its track.
    edge : int64 array, shape (n,)
        The edge.
    forward : bool array, shape (n,)
        Whether it was travelled from its start to its end.
    enter, leave : float64 array, shape (n,)
        Seconds at which the leg begins and ends.
    begin, end : float64 array, shape (n,)
        Metres from the edge's start at which it begins and ends.
    standing : float64 array, shape (n,)
        Seconds of these in which the agent stood still.
    """

    piece: NDArray[np.int64]
    track: NDArray[np.int32]
    edge: NDArray[np.int64]
    forward: NDArray[np.bool_]
    enter: NDArray[np.float64]
    leave: NDArray[np.float64]
    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    standing: NDArray[np.float64]


def remove_wandering(legs: Legs, tolerance: float) -> Legs:
    """Take out turning back within a tolerance; time passes on to the legs that stay.

    Until nothing changes:

    1. Legs without a length join their neighbour.
    2. Legs that go on in the same direction of the same edge are one.
    3. Three legs to and fro and to on one edge are one, if the middle one is shorter than the
       tolerance and than both others.
    4. Two legs from a node into an edge and back to the node join their neighbour, if they are
       shorter than the tolerance.
    5. The first or last leg of a piece joins one against it on the same edge, if it is shorter than
       the tolerance and that one.

    Parameters
    ----------
    legs : Legs
        As matched.
    tolerance : float
        Metres.

    Examples
    --------
    >>> piece, edge = np.zeros(3, np.int64), np.array([4, 4, 4])
    >>> enter, begin = np.array([0.0, 9, 12]), np.array([0.0, 90, 87])
    >>> legs = Legs(
    ...     piece, piece.astype(np.int32), edge, np.array([True, False, True]),
    ...     enter, np.array([9.0, 12, 20]), begin, np.array([90.0, 87, 200]), np.zeros(3),
    ... )
    >>> once = remove_wandering(legs, 5.0)
    >>> once.edge.tolist(), once.begin.tolist(), once.end.tolist(), once.leave.tolist()
    ([4], [0.0], [200.0], [20.0])
    """
    # A log may have no leg on the map.
    while True:
        count = len(legs.edge)
        if not count:
            return legs
        legs = _join_same(_join_empty(legs))
        legs = _join_excursions(_join_swings(legs, tolerance), tolerance)
        legs = _join_ends(legs, tolerance)
        if len(legs.edge) == count:
            return legs


def _join_empty(legs: Legs) -> Legs:
    """Join legs without a length to the one before, or to the one after at the start of a piece."""
    # Legs with a length, and the first of a piece that has none.
    kept = np.abs(legs.end - legs.begin) > _SAME
    starts = _starts(legs)
    has_kept = np.bincount(legs.piece, weights=kept, minlength=1)[legs.piece] > 0
    kept |= ~has_kept & starts
    if kept.all():
        return legs

    # The last of them up to each leg, or the first of its piece.
    rank = np.cumsum(kept)
    first: NDArray[np.int64] = (rank - kept)[starts][np.cumsum(starts) - 1]
    group = np.maximum(rank - 1, first)
    return _merge(legs, group, np.flatnonzero(kept), spans=False)


def _join_same(legs: Legs) -> Legs:
    """Join legs that go on in the same direction of the same edge."""
    goes_on = _next_is_on(legs, same_direction=True)
    goes_on &= np.abs(legs.end[:-1] - legs.begin[1:]) <= _SAME
    group = np.append(0, np.cumsum(~goes_on))[: len(legs.edge)]
    return _merge(legs, group, np.flatnonzero(np.append(True, ~goes_on)), spans=True)


def _join_swings(legs: Legs, tolerance: float) -> Legs:
    """Join three legs to and fro and to on one edge whose middle one is short."""
    # Middle legs that are no longer than their neighbours.
    turns = _next_is_on(legs, same_direction=False)
    metres = np.abs(legs.end - legs.begin)
    middle = np.zeros(len(metres), np.bool_)
    middle[1:-1] = turns[:-1] & turns[1:] & (metres[1:-1] < tolerance)
    middle[1:-1] &= (metres[1:-1] <= metres[:-2]) & (metres[1:-1] <= metres[2:])
    return _merge_runs(legs, _apart(middle, 3), before=1, after=1, spans=True)


def _join_excursions(legs: Legs, tolerance: float) -> Legs:
    """Join short legs from a node into an edge and back to the leg before or after them."""
    # Pairs that end where they begin.
    turns = _next_is_on(legs, same_direction=False)
    metres = np.abs(legs.end - legs.begin)
    pair = np.append(turns, False)
    pair[:-1] &= np.abs(legs.begin[:-1] - legs.end[1:]) <= _SAME
    pair &= metres < tolerance

    # Those with a leg before them join it, others the leg after.
    starts = _starts(legs)
    legs = _merge_runs(legs, _apart(pair & ~starts, 3), before=1, after=1, spans=False)
    if pair[starts].any():
        legs = _join_first_excursions(legs, tolerance)
    return legs


def _join_first_excursions(legs: Legs, tolerance: float) -> Legs:
    """Join short legs from the node at which a piece begins and back to the leg after them."""
    turns = _next_is_on(legs, same_direction=False)
    metres = np.abs(legs.end - legs.begin)
    pair = np.append(turns, False) & _starts(legs) & (metres < tolerance)
    pair[:-1] &= np.abs(legs.begin[:-1] - legs.end[1:]) <= _SAME
    has_third = np.append(legs.piece[2:] == legs.piece[:-2], [False, False])[: len(pair)]
    return _merge_runs(legs, pair & has_third, before=0, after=2, spans=False, chosen=2)


def _join_ends(legs: Legs, tolerance: float) -> Legs:
    """Join a short leg at either end of a piece to a longer one against it on the same edge."""
    # At the start of a piece, the second leg stays.
    turns = _next_is_on(legs, same_direction=False)
    metres = np.abs(legs.end - legs.begin)
    is_short = np.append(turns & (metres[:-1] < tolerance) & (metres[:-1] <= metres[1:]), False)
    legs = _merge_runs(legs, is_short & _starts(legs), before=0, after=1, spans=True, chosen=1)

    # At its end, the last but one.
    turns = _next_is_on(legs, same_direction=False)
    metres = np.abs(legs.end - legs.begin)
    last = np.append(_starts(legs)[1:], True)[: len(metres)]
    is_short = np.append(False, turns & (metres[1:] < tolerance) & (metres[1:] <= metres[:-1]))
    is_short = is_short[: len(metres)]
    return _merge_runs(legs, is_short & last, before=1, after=0, spans=True)


def _starts(legs: Legs) -> Mask:
    """Which legs are the first of their piece."""
    return np.append(True, legs.piece[1:] != legs.piece[:-1])[: len(legs.piece)]


def _next_is_on(legs: Legs, *, same_direction: bool) -> Mask:
    """Whether the next leg is of the same piece and edge, in the same direction or against it."""
    same: Mask = (legs.piece[1:] == legs.piece[:-1]) & (legs.edge[1:] == legs.edge[:-1])
    directed: Mask = (legs.forward[1:] == legs.forward[:-1]) == same_direction
    return same & directed


def _apart(mask: Mask, distance: int) -> Mask:
    """Some of the true values of a mask, at least a distance apart, the first of each run included.

    Examples
    --------
    >>> _apart(np.array([1, 1, 1, 1, 0, 0, 1], bool), 3).tolist()
    [True, False, False, True, False, False, True]
    """
    # Number the values of each cluster, in which each lies less than the distance behind the last.
    where = np.flatnonzero(mask)
    begins = np.append(True, np.diff(where) >= distance)[: len(where)]
    first = where[begins][np.cumsum(begins) - 1] if len(where) else where
    apart = np.zeros(len(mask), np.bool_)

    # In a cluster without holes every distance-th one is chosen; in others those that fit, too.
    apart[where[(where - first) % distance == 0]] = True
    return apart


def _merge_runs(
    legs: Legs, at: Mask, *, before: int, after: int, spans: bool, chosen: int = 0
) -> Legs:
    """Merge runs of legs around some; ``chosen`` is the one of each run that gives the edge."""
    centres = np.flatnonzero(at)
    if not len(centres):
        return legs

    # Every leg of a run but its first joins the one before.
    joins = np.zeros(len(legs.edge), np.bool_)
    for shift in range(1 - before, after + 1):
        joins[centres + shift] = True
    group = np.cumsum(~joins) - 1
    representative = np.flatnonzero(~joins)
    representative[group[centres]] += chosen
    return _merge(legs, group, representative, spans=spans)


def _merge(
    legs: Legs, group: NDArray[np.int64], representative: NDArray[np.int64], *, spans: bool
) -> Legs:
    """Merge successive legs of a group to one, on the edge of its representative.

    With ``spans``, all are on that edge, and the result leads from the start of the first to the
    end of the last; otherwise it is as long as the representative.
    """
    # First and last leg of each group.
    count = len(representative)
    first = np.searchsorted(group, np.arange(count))
    last = np.searchsorted(group, np.arange(count), side="right") - 1
    return Legs(
        legs.piece[representative],
        legs.track[representative],
        legs.edge[representative],
        legs.forward[representative],
        legs.enter[first],
        legs.leave[last],
        legs.begin[first if spans else representative],
        legs.end[last if spans else representative],
        sum_by(group, legs.standing, count),
    )
