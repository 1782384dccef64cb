"""Paths from the end of a route to a node: the likeliest one, else the fastest."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.history.prediction.exits import Exits
from gpszip.history.prediction.sequence_model import SequenceModel

__all__ = ["PathSearch", "connect_roads", "fastest_path"]

#: Directed edges that the search for the likeliest path looks at; most trips pass fewer than 100.
_MAX_EDGES = 400

#: Roads that may lie between two samples of a route, and roads that are looked at for them.
_MAX_BETWEEN, _MAX_LOOKED_AT = 6, 200

#: Least probability of an edge whose logarithm is taken.
_MIN_PROBABILITY = 1e-12


class PathSearch:
    """Best-first search for the likeliest paths that follow a route.

    Each directed edge is reached once, by the likeliest path to it: the probability of what follows
    is that after this path. The search goes on from goal to goal.

    Parameters
    ----------
    model : SequenceModel
        What follows a route.
    exits : Exits
        Exits of each directed edge.
    route : sequence of int
        Directed edges travelled so far.
    hour, agent : int, optional
        As for the model.
    """

    def __init__(
        self,
        model: SequenceModel,
        exits: Exits,
        route: Sequence[int],
        hour: int | None = None,
        agent: int | None = None,
    ) -> None:
        self._model, self._exits = model, exits
        self._route, self._hour, self._agent = list(route), hour, agent

        # Paths in the order of their probabilities; the counter breaks ties.
        self._queue: list[tuple[float, int, list[int]]] = [(0.0, 0, [])]
        self._pushed = 0
        self._reached: set[int] = set()
        self._found: dict[int, list[int]] = {}

    def path_to(self, goal: int) -> list[int] | None:
        """Directed edges of the likeliest path to a node; None if the search doesn't come there."""
        while goal not in self._found and self._queue and len(self._reached) <= _MAX_EDGES:
            self._follow_likeliest()
        return self._found.get(goal)

    def _follow_likeliest(self) -> None:
        """Follow the likeliest path by one more edge."""
        # It is the likeliest to the node at which it ends.
        cost, _, path = heapq.heappop(self._queue)
        last = path[-1] if path else self._route[-1]
        self._found.setdefault(int(self._exits.heads[last]), path)
        if path and last in self._reached:
            return
        self._reached.add(last)

        # Go on by each exit that no likelier path has reached.
        probabilities = self._model.predict([*self._route, *path], self._hour, self._agent)
        for edge, probability in zip(self._model.options[last], probabilities, strict=True):
            if edge not in self._reached:
                self._pushed += 1
                bits = -math.log(max(probability, _MIN_PROBABILITY))
                heapq.heappush(self._queue, (cost + bits, self._pushed, [*path, edge]))


def fastest_path(
    exits: Exits, seconds: NDArray[np.float64], last: int, goal: int
) -> list[int] | None:
    """Edges of the fastest path from the end of a directed edge to a node.

    Parameters
    ----------
    exits : Exits
        Exits of each directed edge.
    seconds : float64 array, shape (2 E,)
        Seconds that each directed edge takes.
    last : int
        Directed edge after which the path begins.
    goal : int
        Node.

    Returns
    -------
    list of int, or None
        Directed edges; None if there is no path.

    Examples
    --------
    >>> from gpszip.history.prediction.exits import list_exits
    >>> from gpszip.testing import ring
    >>> exits = list_exits(ring(5).network)
    >>> fastest_path(exits, np.ones(10), 0, 3)  # edges 2 and 3
    [4, 6]
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    if exits.heads[last] == goal:
        return []

    # A graph of directed edges, each connection as long as the edge that it leads to.
    exists = exits.exists
    froms = np.repeat(np.arange(len(exits)), exists.sum(axis=1))
    onto = exits.options[exists]
    graph = csr_array((np.maximum(seconds[onto], 1e-9), (froms, onto)), shape=(len(exits),) * 2)
    reached, before = dijkstra(graph, indices=np.array(last), return_predecessors=True)

    # The first edge reached that ends at the goal, and the path back from it.
    arriving = np.flatnonzero(exits.heads == goal)
    if not len(arriving) or not np.isfinite(reached[arriving]).any():
        return None
    path = [int(arriving[np.argmin(reached[arriving])])]
    while before[path[-1]] != last:
        path.append(int(before[path[-1]]))
    return path[::-1]


def connect_roads(roads: Sequence[int], exits: Exits, lengths: NDArray[np.float64]) -> list[int]:
    """Fill in the roads between those on which the samples of a route lie, by shortest paths.

    Parameters
    ----------
    roads : sequence of int
        Directed edges in the order of travel, at least one.
    exits : Exits
        Exits of each directed edge.
    lengths : float64 array, shape (E,)
        Metres of each edge.

    Returns
    -------
    list of int
        Directed edges, each an exit of the one before, from the last edge on that is more than six
        edges after the one before it.

    Examples
    --------
    >>> from gpszip.history.prediction.exits import list_exits
    >>> from gpszip.testing import ring
    >>> network = ring(6).network
    >>> connect_roads([0, 8], list_exits(network), network.lengths)
    [0, 4, 6, 8]
    """
    route = [roads[0]]
    for road in roads[1:]:
        between = _between(route[-1], road, exits, lengths)
        if between is None:
            route = [road]
        else:
            route += [*between, road]
    return route


def _between(first: int, last: int, exits: Exits, lengths: NDArray[np.float64]) -> list[int] | None:
    """Shortest path between two directed edges; None if it is long."""
    queue: list[tuple[float, int, list[int]]] = [(0.0, first, [])]
    looked_at: set[int] = set()
    while queue and len(looked_at) < _MAX_LOOKED_AT:
        metres, edge, path = heapq.heappop(queue)
        following = [each for each in exits.options[edge].tolist() if each >= 0]
        if last in following:
            return path
        if edge in looked_at or len(path) == _MAX_BETWEEN:
            continue
        looked_at.add(edge)
        for each in following:
            if each not in looked_at and each != edge ^ 1:
                cost = metres + float(lengths[each >> 1])
                heapq.heappush(queue, (cost, each, [*path, each]))
    return None
