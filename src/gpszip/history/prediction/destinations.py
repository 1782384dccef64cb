"""Where trips end that began as this one: counts over trips that shared its last edges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.prediction.contexts import context_keys, label_keys, route_keys

__all__ = ["DestinationModel", "TripEnds", "learn_destinations"]

#: Numbers of last edges that are looked up.
_ORDERS = (1, 2, 4, 8, 20)

#: Latest passes of a context that count; more say the same.
_PASSES = 400

#: How much the estimate of the order below counts, in trips.
_PRIOR_TRIPS = 2.0

#: What a trip of the same agent counts more than one of another, and one at the same hour of the
#: day more than one at another.
_SAME_AGENT, _SAME_HOUR = 1.0, 1.0

#: Hours by which trips at the same hour may differ.
_HOURS = 1

Ints = NDArray[np.int64]


class TripEnds(NamedTuple):
    """What is known of each trip of a history.

    Parameters
    ----------
    node : int64 array, shape (t,)
        Node at which it ended.
    agent : int64 array, shape (t,)
        Number of its agent.
    hour : int64 array, shape (t,)
        Hour of the day at which it began, -1 where unknown.
    """

    node: Ints
    agent: Ints
    hour: Ints


class DestinationModel:
    """Ends of trips by the edges that they passed; made by :func:`learn_destinations`."""

    def __init__(
        self,
        ends: TripEnds,
        passes: dict[int, tuple[NDArray[np.uint64], Ints]],
        labels: list[int],
    ) -> None:
        self._ends, self._passes, self._labels = ends, passes, labels
        self._nodes, self._of = np.unique(ends.node, return_inverse=True)

    def predict(
        self, route: Sequence[int], hour: int | None = None, agent: int | None = None
    ) -> list[tuple[int, float]]:
        """Nodes and their probabilities, the most likely first.

        With w the weights of the trips that passed the last k edges of the route, and c = 2,
        ``p[k](node) = (sum(w at node) + c p[k-1](node)) / (sum(w) + c)``.

        Parameters
        ----------
        route : sequence of int
            Directed edges.
        hour : int, optional
            Hour of the day.
        agent : int, optional
            Number of the agent.
        """
        # Before an edge is known, all trips count.
        weights = self._weights(np.arange(len(self._ends.node)), hour, agent)
        estimate = np.bincount(self._of, weights, len(self._nodes)) / weights.sum()

        # From order to order, as long as somebody passed there.
        for order, key in route_keys([self._labels[edge] for edge in route[-_ORDERS[-1] :]]):
            if order not in self._passes:
                continue
            keys, trips = self._passes[order]
            begin = int(np.searchsorted(keys, np.uint64(key)))
            end = int(np.searchsorted(keys, np.uint64(key), side="right"))
            found = trips[max(begin, end - _PASSES) : end]
            if not len(found):
                break
            weights = self._weights(found, hour, agent)
            counts = np.bincount(self._of[found], weights, len(self._nodes))
            estimate = (counts + _PRIOR_TRIPS * estimate) / (weights.sum() + _PRIOR_TRIPS)

        likely = np.argsort(-estimate, kind="stable")
        return list(zip(self._nodes[likely].tolist(), estimate[likely].tolist(), strict=True))

    def _weights(self, trips: Ints, hour: int | None, agent: int | None) -> NDArray[np.float64]:
        """What each trip counts: more by the same agent, and at the same hour."""
        weights = np.ones(len(trips))
        if agent is not None:
            weights += _SAME_AGENT * (self._ends.agent[trips] == agent)
        if hour is not None:
            apart = np.abs(self._ends.hour[trips] - hour)
            is_near = np.minimum(apart, 24 - apart) <= _HOURS
            weights += _SAME_HOUR * (is_near & (self._ends.hour[trips] >= 0))
        return weights


def learn_destinations(
    directed: Ints, starts: NDArray[np.bool_], trip: Ints, ends: TripEnds, edges: int
) -> DestinationModel:
    """List the trips that passed each context.

    Parameters
    ----------
    directed : int64 array, shape (n,)
        Directed edges in the order of time.
    starts : bool array, shape (n,)
        Whether an edge does not go on from the one before.
    trip : int64 array, shape (n,)
        Trip of each.
    ends : TripEnds
        The trips.
    edges : int
        Number of directed edges.

    Examples
    --------
    >>> ends = TripEnds(np.array([7, 8, 8]), np.zeros(3, int), np.full(3, -1))
    >>> starts = np.array([True, False, True, False, True, False])
    >>> model = learn_destinations(np.array([0, 2, 0, 4, 0, 4]), starts, np.arange(6) // 2, ends, 6)
    >>> [(node, round(p, 2)) for node, p in model.predict([0])]
    [(8, 0.67), (7, 0.33)]
    >>> model.predict([0, 4])[0][0]
    8
    """
    passes = {}
    for order, keys, is_whole in context_keys(directed, starts):
        if order in _ORDERS:
            rows = np.flatnonzero(is_whole)
            rows = rows[np.argsort(keys[rows], kind="stable")]
            passes[order] = (keys[rows], trip[rows])
    return DestinationModel(ends, passes, label_keys(np.arange(edges), 0).tolist())
