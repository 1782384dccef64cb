"""Shortest-path trees over directed roads, for the alternative paths through a gap.

Each road e of the network makes two directed roads: 2e leads from its start to its end, 2e + 1 from
its end to its start. So ``a ^ 1`` is directed road a in the other direction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import inner_uncounted, jit

__all__ = ["SearchTree", "shortest_path_tree"]

#: First capacity of heap and tree; both double when they are full.
_FIRST_CAPACITY = 1024

#: Parent of a road at which the search begins.
_NO_PARENT = -1


class SearchTree(NamedTuple):
    """Directed roads that a search reached, by increasing cost.

    ``parents`` is the directed road through which each was reached, -1 where the search begins.
    """

    roads: NDArray[np.int32]
    costs: NDArray[np.float64]
    parents: NDArray[np.int32]


@inner_uncounted
def _turn_cost(
    a: int,
    b: int,
    is_crossing: bool,
    directions: NDArray[np.float64],
    turn_cost: float,
    u_turn_cost: float,
) -> float:
    """Cost of turning from directed road a into directed road b."""
    if b == a ^ 1:
        return u_turn_cost
    if not is_crossing:
        return 0.0
    cosine = -(directions[a ^ 1, 0] * directions[b, 0] + directions[a ^ 1, 1] * directions[b, 1])
    return 0.5 * turn_cost * (1.0 - cosine)


@jit
def shortest_path_tree(
    start_roads: NDArray[np.int64],
    start_costs: NDArray[np.float64],
    cost_bound: float,
    road_costs: NDArray[np.float64],
    link_starts: NDArray[np.int64],
    links: NDArray[np.int32],
    nodes: NDArray[np.int32],
    is_crossing: NDArray[np.bool_],
    directions: NDArray[np.float64],
    turn_cost: float,
    u_turn_cost: float,
    backward: bool,
) -> SearchTree:
    """Find all directed roads within a cost of where a search begins, by Dijkstra's algorithm.

    The label of a road b is the least ``label(a) + turn(a, b) + road_costs[b]`` over the roads a
    before it. A turn by an angle costs ``turn_cost * (1 - cos(angle)) / 2`` at a crossing, and
    ``u_turn_cost`` is the cost of turning round.

    Parameters
    ----------
    start_roads, start_costs
        Directed roads at which the search begins, and their labels.
    cost_bound
        Roads with higher labels are left out.
    road_costs
        Cost of travelling each directed road.
    link_starts, links, nodes
        Forward, ``links[link_starts[v]:link_starts[v + 1]]`` leave node v, ``nodes`` are those at
        the end of each directed road, and a label is the cost to the end of a road. Backward, they
        enter node v, ``nodes`` are those at the beginning, and a label is the cost from there.
    is_crossing, directions
        Whether turns at a node have a cost, and the unit vector at the beginning of each directed
        road.
    turn_cost, u_turn_cost
        Cost of a half turn at a crossing, and of turning round.
    backward
        Whether the search goes against the direction of travel.
    """
    # Begin.
    keys, items = np.empty(_FIRST_CAPACITY), np.empty(_FIRST_CAPACITY, np.int64)
    queued = 0
    best: dict[int, float] = {}
    parent: dict[int, int] = {}
    for i in range(len(start_roads)):
        road, cost = start_roads[i], start_costs[i]
        if cost <= cost_bound and (road not in best or cost < best[road]):
            best[road] = cost
            parent[road] = _NO_PARENT
            queued = push(keys, items, queued, cost, road)

    # The queued road with the least label is final.
    finished: dict[int, int] = {}
    roads = np.empty(_FIRST_CAPACITY, np.int32)
    costs = np.empty(_FIRST_CAPACITY)
    parents = np.empty(_FIRST_CAPACITY, np.int32)
    count = 0
    while queued > 0:
        label = keys[0]
        road, queued = pop(keys, items, queued)
        if road in finished:
            continue
        finished[road] = count
        if count == len(roads):
            roads = np.concatenate((roads, np.empty_like(roads)))
            costs = np.concatenate((costs, np.empty_like(costs)))
            parents = np.concatenate((parents, np.empty_like(parents)))
        roads[count] = road
        costs[count] = label
        parents[count] = parent[road]
        count += 1

        # Relax its neighbours.
        node = nodes[road]
        for k in range(link_starts[node], link_starts[node + 1]):
            other = links[k]
            if other in finished:
                continue
            first, second = (other, road) if backward else (road, other)
            turn = _turn_cost(first, second, is_crossing[node], directions, turn_cost, u_turn_cost)
            cost = label + turn + road_costs[other]
            if cost > cost_bound or (other in best and cost >= best[other]):
                continue
            best[other] = cost
            parent[other] = road
            if queued + 1 >= len(keys):
                keys = np.concatenate((keys, np.empty_like(keys)))
                items = np.concatenate((items, np.empty_like(items)))
            queued = push(keys, items, queued, cost, other)
    return SearchTree(roads[:count], costs[:count], parents[:count])
