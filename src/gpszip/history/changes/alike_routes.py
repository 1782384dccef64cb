"""How likely agents at a junction are to take each edge, by what others did on routes like theirs.

The last few edges don't tell which line a bus serves: lines share streets. The last round tells.
So the last 30 edges of an agent are compared with those of the agents that came to the junction by
the same edge before. Two routes lie apart by ::

    d = |A - B| + |B - A| + 4 * #{places among the last 2 to 4 whose edges differ}

with their sets of edges A and B. Those before count ``w = exp(-0.35 (d - d0))`` each, d0 being the
least of all d, and the probability of an edge e is ::

    p(e) = (sum(w of those that took e) + q(e)) / (sum(w) + 1)

with its probability q(e) by the last edges only. A detour changes few of 30 edges, so that a bus
which had to go round a closed street once is still known in the next round.

Where d0 is more than 9, nobody travelled like that before: nothing is usual for such an agent.

On buses of which each changes its line now and then, the logarithms of p are 20 % smaller than with
the last 6 edges, and a closed street is found with half the evidence. On taxis, whose last fare
says nothing of the next one, they are larger, and the last edges are all that counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.changes.choices import Choices
from gpszip.history.traversals import Traversals

__all__ = ["AlikeRoutes", "compare_routes"]

#: Edges of the routes that are compared: about one round of a bus.
_EDGES = 30

#: Seconds after which what an agent did says nothing of what it does.
_MEMORY = 3 * 3600.0

#: Places before the junction at which differing edges count more: which way an agent came.
_PLACES = (2, 3, 4)

#: How much each of them adds to the distance.
_PLACE_WEIGHT = 4

#: Decay of the weight with the distance of routes, and distance at which it ends.
_DECAY, _REACH = 0.35, 8

#: Distance from all others beyond which a route is a new one.
_NEW = 9

#: Latest agents at a junction that count.
_LATEST = 300

#: Agents as which the probability by the last edges counts.
_PRIOR = 1.0

Longs = NDArray[np.int64]
Floats = NDArray[np.float64]


class AlikeRoutes(NamedTuple):
    """What others did on routes like those of agents at junctions.

    Parameters
    ----------
    probability : float64 array, shape (c,)
        How likely each choice was.
    is_usual : bool array, shape (c,)
        Whether anybody travelled like that before.
    """

    probability: Floats
    is_usual: NDArray[np.bool_]


def compare_routes(rows: Traversals, known: NDArray[np.bool_], choices: Choices) -> AlikeRoutes:
    """Compare the routes of agents at junctions with those of known agents.

    Parameters
    ----------
    rows : Traversals
        All traversals, with times.
    known : bool array, shape (n,)
        Which are known.
    choices : Choices
        What agents could have taken (:func:`~gpszip.history.changes.choices.list_choices`).
    """
    # Choices by the edge that leads to the junction, and known traversals by that and time.
    directed = rows.directed
    before = directed[choices.traversal - 1]
    by_edge = np.argsort(before, kind="stable")
    learnt = np.flatnonzero(known & ~rows.starts)
    learnt = learnt[np.lexsort((rows.enter[learnt], directed[learnt - 1]))]
    edges, first = np.unique(before[by_edge], return_index=True)
    low = np.searchsorted(directed[learnt - 1], edges)
    high = np.searchsorted(directed[learnt - 1], edges, side="right")

    # Weights by distance: all distances are whole numbers.
    weights = np.append(np.exp(-_DECAY * np.arange(_REACH + 1)), 0.0).astype(np.float32)

    # Junction by junction; where there is no choice, nothing is compared.
    probability, is_usual = choices.probability.copy(), np.ones(len(before), np.bool_)
    parts = np.split(by_edge, first[1:]) if len(edges) else []
    for part, begin, end in zip(parts, low.tolist(), high.tolist(), strict=True):
        others = learnt[max(begin, end - _LATEST) : end]
        asked, row = np.unique(choices.traversal[part], return_inverse=True)
        if len(asked) == len(part) or not len(others):
            continue
        options, column = np.unique(choices.option[part], return_inverse=True)
        took = (directed[others][:, None] == options).astype(np.float32)
        apart = _distances(rows, asked, others)
        nearest = apart.min(axis=1)
        weight = weights[np.minimum(apart - nearest[:, None], _REACH + 1)]
        taken, total = (weight @ took)[row, column], weight.sum(axis=1)[row]
        probability[part] = (taken + _PRIOR * probability[part]) / (total + _PRIOR)
        is_usual[part] = nearest[row] <= _NEW
    return AlikeRoutes(probability, is_usual)


def _distances(rows: Traversals, asked: Longs, others: Longs) -> NDArray[np.int32]:
    """How far the routes to some traversals lie from those to others, shape (asked, others)."""
    # Which edges each route has; whole numbers of 32 bits are exact.
    recent = np.concatenate([_recent_edges(rows, asked), _recent_edges(rows, others)])
    edges, place = np.unique(recent, return_inverse=True)
    has = np.zeros((len(recent), len(edges)), np.float32)
    has[np.arange(len(recent))[:, None], place.reshape(recent.shape)] = 1.0
    has[:, edges < 0] = 0.0

    # Edges that only one of two routes has, and places at which their edges differ.
    counts = has.sum(axis=1)
    common = has[: len(asked)] @ has[len(asked) :].T
    either = counts[: len(asked), None] + counts[len(asked) :]
    apart: NDArray[np.int32] = (either - 2.0 * common).astype(np.int32)
    for number in _PLACES:
        at_place = recent[:, number - 1]
        apart += _PLACE_WEIGHT * (at_place[: len(asked), None] != at_place[len(asked) :])
    return apart


def _recent_edges(rows: Traversals, at: Longs) -> Longs:
    """The last 30 directed edges before each of some traversals, the latest first; -1 for none."""
    index = at[:, None] - np.arange(1, _EDGES + 1)
    earlier = np.maximum(index, 0)
    is_own = (index >= 0) & (rows.track[earlier] == rows.track[at][:, None])
    is_own &= rows.enter[at][:, None] - rows.enter[earlier] < _MEMORY
    recent: Longs = np.where(is_own, rows.directed[earlier], -1)
    return recent
