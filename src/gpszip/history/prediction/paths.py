"""Paths from the end of a route to a node: the likeliest one, else the fastest."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.history.prediction.exits import Exits
from gpszip.history.prediction.sequence_model import SequenceModel

__all__ = ["connect_roads", "fastest_path", "likeliest_path"]

#: Directed edges that the search for the likeliest path looks at; most trips pass fewer than 100.
_MAX_EDGES = 400

#: Roads that may lie between two samples of a route, and roads that are looked at for them.
_MAX_BETWEEN, _MAX_LOOKED_AT = 6, 200

#: Least probability of an edge whose logarithm is taken.
_MIN_PROBABILITY = 1e-12


def likeliest_path(
    model: SequenceModel,
    exits: Exits,
    route: Sequence[int],
    goal: int,
    hour: int | None = None,
    agent: int | None = None,
) -> list[int] | None:
    """Edges of the likeliest path to a node, by best-first search.

    Each directed edge is reached once, by the likeliest path to it: the probability of what follows
    is that after this path.

    Parameters
    ----------
    model : SequenceModel
        What follows a route.
    exits : Exits
        Exits of each directed edge.
    route : sequence of int
        Directed edges travelled so far.
    goal : int
        Node.
    hour, agent : int, optional
        As for the model.

    Returns
    -------
    list of int, or None
        Directed edges after the route; None if the goal is not among what was looked at.
    """
    # Paths in the order of their probabilities; the counter breaks ties.
    start = list(route)
    queue: list[tuple[float, int, list[int]]] = [(0.0, 0, [])]
    reached: set[int] = set()
    pushed = 0
    while queue and len(reached) <= _MAX_EDGES:
        cost, _, path = heapq.heappop(queue)
        last = path[-1] if path else start[-1]
        if exits.heads[last] == goal:
            return path
        if path and last in reached:
            continue
        reached.add(last)

        # Go on by each exit that no likelier path has reached.
        so_far = [*start, *path]
        probabilities = model.predict(so_far, hour, agent)
        for edge, probability in zip(model.options[last], probabilities, strict=True):
            if edge not in reached:
                pushed += 1
                bits = -math.log(max(probability, _MIN_PROBABILITY))
                heapq.heappush(queue, (cost + bits, pushed, [*path, edge]))
    return None


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
