"""How likely agents at a junction are to take each edge, given their route so far.

Counts of contexts of up to 6 edges, the longest first, with an escape to shorter ones (method C of
prediction by partial matching; Moffat 1990)::

    P_k(e) = (n_k(e) + u_k P_(k-1)(e)) / (n_k + u_k)

with the traversals n_k(e) of edge e after the last k edges, their sum n_k over all e, and the
number u_k of different edges there. P_0 is even over the ways out of the node.

Counts are of the known traversals. A context that these don't have is counted among the asked ones,
as far as they come before: an agent on a detour is a surprise once, and not at each lap.

The sequence model of :mod:`gpszip.history.prediction` predicts better, but can't take this place.
It mixes all orders, and either never learns from what is watched, so that a detour would be a
surprise at each lap, or learns all of it, so that a closed edge would soon seem unlikely, and no
longer missed. Here contexts that were known before keep their counts. All choices are counted at
once, without fitting weights, and only edges that followed before are options.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.traversals import Traversals
from gpszip.model import Network

__all__ = ["Choices", "list_choices"]

#: Edges of the longest context. Longer ones are hardly more certain, and rarely known.
_ORDER = 6

Longs = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Choices(NamedTuple):
    """What agents could have taken at junctions.

    Parameters
    ----------
    traversal : int64 array, shape (c,)
        Traversal that the agent took next.
    option : int64 array, shape (c,)
        Directed edge that it could have taken: one that followed the same edge before.
    probability : float64 array, shape (c,)
        How likely that was.
    taken : bool array, shape (c,)
        Whether it was taken.
    """

    traversal: Longs
    option: Longs
    probability: NDArray[np.float64]
    taken: Mask


def list_choices(network: Network, rows: Traversals, known: Mask, asked: Mask) -> Choices:
    """List the choices of some traversals, as likely as those before them make them.

    Parameters
    ----------
    network : Network
        The edges.
    rows : Traversals
        All traversals, with times.
    known : bool array, shape (n,)
        Traversals that tell the options: edges that followed the same edge among them.
    asked : bool array, shape (n,)
        Traversals whose choices are listed. None that is known should be asked.

    Returns
    -------
    Choices
        Sorted by traversal and option.
    """
    # Every asked transition with the edges that followed the same one before.
    directed = rows.directed
    at = np.flatnonzero(asked & ~rows.starts)
    learnt = np.flatnonzero(known & ~rows.starts)
    size = 2 * len(network)
    pairs = np.unique(directed[learnt - 1] * size + directed[learnt])
    before, after = np.divmod(pairs, size)
    first = np.searchsorted(before, directed[at - 1])
    count = np.searchsorted(before, directed[at - 1], side="right") - first
    event = np.repeat(at, count)
    place = np.arange(len(event)) - np.repeat(np.cumsum(count) - count, count)
    option = after[np.repeat(first, count) + place]

    # Start even over the ways out of the node.
    degree = np.bincount(np.concatenate([network.starts, network.ends]))
    heads = np.stack([network.ends, network.starts], axis=1).reshape(-1)
    probability = 1.0 / degree[heads[directed[event - 1]]]

    # Longer and longer contexts, of all transitions in the order of time.
    rank = np.empty(len(rows), np.int64)
    rank[np.argsort(rows.enter, kind="stable")] = np.arange(len(rows))
    context = directed.copy()
    for order in range(1, _ORDER + 1):
        if order > 1:
            context = _longer(context, directed, rows.starts)
        wanted = _Transitions(context[event - 1], option, rank[event])
        probability, is_known = _refine(
            probability,
            _followed(context, directed, learnt, np.full(len(rows), -1)),
            wanted,
            size,
        )
        refined, _ = _refine(probability, _followed(context, directed, at, rank), wanted, size)
        probability = np.where(is_known, probability, refined)
    return Choices(event, option, probability, directed[event] == option)


class _Transitions(NamedTuple):
    """What followed contexts, or may follow them.

    Parameters
    ----------
    context : int64 array, shape (n,)
        Number of the context; -1 where it is not known.
    next : int64 array, shape (n,)
        Directed edge after it.
    rank : int64 array, shape (n,)
        Place in the order of time.
    """

    context: Longs
    next: Longs
    rank: Longs


def _followed(context: Longs, directed: Longs, at: Longs, rank: Longs) -> _Transitions:
    """What followed the contexts of some traversals, where these are known."""
    usable = at[context[at - 1] >= 0]
    return _Transitions(context[usable - 1], directed[usable], rank[usable])


def _longer(context: Longs, directed: Longs, starts: Mask) -> Longs:
    """Numbers of contexts that are an edge longer, -1 where the track has begun since."""
    # The context of the traversal before, and this one.
    before = np.append(-1, context[:-1])
    is_known = ~starts & (before >= 0)
    longer = np.full(len(context), -1, np.int64)
    keys = before[is_known] * (int(directed.max(initial=0)) + 1) + directed[is_known]
    longer[is_known] = np.unique(keys, return_inverse=True)[1].reshape(-1)
    return longer


def _refine(
    shorter: NDArray[np.float64], history: _Transitions, asked: _Transitions, size: int
) -> tuple[NDArray[np.float64], Mask]:
    """Probabilities by one more order, and where its contexts are known; else the shorter ones."""
    # Number the pairs of context and next edge; options that never followed are none of them.
    if not len(history.context):
        return shorter, np.zeros(len(shorter), np.bool_)
    keys = history.context * size + history.next
    pairs, pair = np.unique(keys, return_inverse=True)
    pair = pair.reshape(-1)
    wanted = asked.context * size + asked.next
    place = np.minimum(np.searchsorted(pairs, wanted), len(pairs) - 1)
    is_pair = pairs[place] == wanted

    # First time of each pair, at which its context gets another edge.
    last_rank = int(max(history.rank.max(), asked.rank.max(initial=0))) + 1
    first = np.full(len(pairs), last_rank, np.int64)
    np.minimum.at(first, pair, history.rank)

    # Counts before the time asked for.
    count = _count_before(pair, history.rank, np.where(is_pair, place, -1), asked.rank, last_rank)
    total = _count_before(history.context, history.rank, asked.context, asked.rank, last_rank)
    distinct = _count_before(pairs // size, first, asked.context, asked.rank, last_rank)
    refined = (count + distinct * shorter) / np.maximum(total + distinct, 1)
    return np.where(total > 0, refined, shorter), total > 0


def _count_before(
    group: Longs, rank: Longs, asked_group: Longs, asked_rank: Longs, last: int
) -> Longs:
    """How many members of each asked group have a lower rank; none of group -1.

    Examples
    --------
    >>> group, rank = np.array([0, 0, 1]), np.array([3, 5, 4])
    >>> _count_before(group, rank, np.array([0, 0, 1]), np.array([4, 9, 4]), 10).tolist()
    [1, 2, 0]
    """
    # A rank of -1 comes before all others.
    ordered = np.sort(group * (last + 2) + rank + 1)
    begin = asked_group * (last + 2)
    counts = np.searchsorted(ordered, begin + asked_rank + 1) - np.searchsorted(ordered, begin)
    return np.where(asked_group >= 0, counts, 0).astype(np.int64)
