"""Bounded A* search over directed roads, with costs for turns.

A label of the search belongs to the beginning of a directed road: the metres to it, and the cost,
which is the metres plus the turns, in metres. The key of a label is its cost plus a lower bound of
the cost still to go. Two lower bounds are in use: the straight-line distance to a goal
(``expand_to_goal``), and the costs that a backward search found (``expand_to_targets``). Roads of
equal key leave the heap by number, so that results don't depend on the order of insertion.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit
from gpszip.matching.kernels.roads import (
    CENTRE_NODE,
    CENTRE_RADIUS,
    COST_LIMIT,
    HEAP_SIZE,
    SEARCH_NUMBER,
    BackwardSearch,
    Graph,
    ModelParameters,
    Workspace,
)

__all__ = [
    "expand_to_goal",
    "expand_to_targets",
    "find_path",
    "next_towards_goal",
    "next_towards_targets",
    "search_backward",
    "start_search",
]


@inner_uncounted
def _turn_cost(a: int, b: int, graph: Graph, model: ModelParameters) -> float:
    """Cost in metres of turning from the end of directed road a into directed road b.

    ``beta * turn_cost * (1 - cos(angle)) / 2``; nothing where no other road leaves the node, and
    ``beta * u_turn_cost`` for turning round.
    """
    if b == a ^ 1:
        return model.beta * model.u_turn_cost
    node = graph.heads[a]
    if graph.out_starts[node + 1] - graph.out_starts[node] <= 2:
        return 0.0
    cosine = -(
        graph.directions[a ^ 1, 0] * graph.directions[b, 0]
        + graph.directions[a ^ 1, 1] * graph.directions[b, 1]
    )
    return 0.5 * model.beta * model.turn_cost * (1.0 - cosine)


@inner_uncounted
def _sift_up(
    heap: NDArray[np.int32], heap_slots: NDArray[np.int32], keys: NDArray[np.float64], slot: int
) -> None:
    """Move the item in a slot of the heap up to its place."""
    item = heap[slot]
    key = keys[item]
    i = slot
    while i > 0:
        parent = (i - 1) // 2
        other = heap[parent]
        if keys[other] < key or (keys[other] == key and other <= item):
            break
        heap[i] = other
        heap_slots[other] = i
        i = parent
    heap[i] = item
    heap_slots[item] = i


@inner_uncounted
def _sift_down(
    heap: NDArray[np.int32], heap_slots: NDArray[np.int32], keys: NDArray[np.float64], size: int
) -> None:
    """Move the item at the top of the heap down to its place."""
    # Move lesser children up until none is less than the item.
    item = heap[0]
    key = keys[item]
    i = 0
    while 2 * i + 1 < size:
        # The lesser of the two children.
        child = 2 * i + 1
        if child + 1 < size:
            left, right = heap[child], heap[child + 1]
            if keys[right] < keys[left] or (keys[right] == keys[left] and right < left):
                child += 1

        # Trade places with it.
        other = heap[child]
        if key < keys[other] or (key == keys[other] and item <= other):
            break
        heap[i] = other
        heap_slots[other] = i
        i = child
    heap[i] = item
    heap_slots[item] = i


@inner_uncounted
def _pop_heap(
    heap: NDArray[np.int32],
    heap_slots: NDArray[np.int32],
    keys: NDArray[np.float64],
    state: NDArray[np.int64],
) -> None:
    """Remove the least item of a heap."""
    heap_slots[heap[0]] = -1
    state[HEAP_SIZE] -= 1
    if state[HEAP_SIZE] > 0:
        heap[0] = heap[state[HEAP_SIZE]]
        heap_slots[heap[0]] = 0
        _sift_down(heap, heap_slots, keys, state[HEAP_SIZE])


@inner_uncounted
def _distance_to_node(node: int, position: NDArray[np.float64], graph: Graph) -> float:
    square = 0.0
    for axis in range(len(position)):
        square += (graph.node_positions[node, axis] - position[axis]) ** 2
    return math.sqrt(square)


@inner_uncounted
def _relax(
    road: int, cost: float, metres: float, cost_to_go: float, parent: int, work: Workspace
) -> None:
    """Label the beginning of a directed road, unless it has a label that costs no more."""
    is_new = work.stamps[road] != work.state[SEARCH_NUMBER]
    if not is_new and (work.heap_slots[road] < 0 or not cost < work.costs[road]):
        return
    work.stamps[road] = work.state[SEARCH_NUMBER]
    work.costs[road] = cost
    work.metres[road] = metres
    work.parents[road] = parent
    work.keys[road] = cost + cost_to_go

    # Insert it in the heap, or move it up there.
    if is_new:
        work.heap_slots[road] = work.state[HEAP_SIZE]
        work.state[HEAP_SIZE] += 1
    work.heap[work.heap_slots[road]] = road
    _sift_up(work.heap, work.heap_slots, work.keys, work.heap_slots[road])


@inner_uncounted
def start_search(work: Workspace) -> None:
    """Begin a search; the labels of the search before are void."""
    work.state[SEARCH_NUMBER] += 1
    work.state[HEAP_SIZE] = 0


@inner_uncounted
def _pop_next(cost_bound: float, work: Workspace) -> int:
    """Take the directed road with the least key; -1 if there is none within the bound."""
    if work.state[HEAP_SIZE] == 0:
        return -1
    road = work.heap[0]
    if work.keys[road] > cost_bound:
        return -1
    _pop_heap(work.heap, work.heap_slots, work.keys, work.state)
    return int(road)


@inner_uncounted
def expand_to_goal(
    road: int,
    metres: float,
    cost: float,
    cost_bound: float,
    max_length: float,
    goal: NDArray[np.float64],
    goal_radius: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> None:
    """Label the roads that leave the end of a directed road, towards a goal.

    ``metres`` and ``cost`` are those to the end of the road. The cost to go is at least the
    straight line to within ``goal_radius`` metres of the goal. Paths longer than ``max_length``
    metres, or beyond the cost bound, are not followed.
    """
    # Lower bound of the cost to go.
    node = graph.heads[road]
    cost_to_go = max(_distance_to_node(node, goal, graph) - goal_radius, 0.0)
    if metres > max_length or cost + cost_to_go > cost_bound:
        return

    # Every road that leaves the node.
    for i in range(graph.out_starts[node], graph.out_starts[node + 1]):
        next_road = graph.out_roads[i]
        next_cost = cost + _turn_cost(road, next_road, graph, model)
        if next_cost + cost_to_go <= cost_bound:
            _relax(next_road, next_cost, metres, cost_to_go, road, work)


@inner_uncounted
def next_towards_goal(
    cost_bound: float,
    max_length: float,
    goal: NDArray[np.float64],
    goal_radius: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> int:
    """Take the next directed road of a search towards a goal, and expand it.

    Its label is final: no other path to its beginning costs less. -1 if there is none.
    """
    # The road with the least key comes next, if it is within the bound.
    road = _pop_next(cost_bound, work)

    # Metres and cost to its end.
    if road >= 0:
        length = graph.lengths[road]
        expand_to_goal(
            road,
            work.metres[road] + length,
            work.costs[road] + length,
            cost_bound,
            max_length,
            goal,
            goal_radius,
            graph,
            model,
            work,
        )
    return road


@inner_uncounted
def expand_to_targets(
    road: int,
    metres: float,
    cost: float,
    cost_bound: float,
    max_length: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> None:
    """Label the roads that leave the end of a directed road, towards targets.

    The cost to go is what the last backward search found, or at least its limit where it did not
    reach.
    """
    # Lower bound of the cost to go where the backward search did not reach.
    if metres > max_length:
        return
    node = graph.heads[road]
    least_to_go = work.backward.limits[COST_LIMIT] - _min_distance_to_sources(
        node, graph, work.backward
    )

    # Every road that leaves the node.
    for i in range(graph.out_starts[node], graph.out_starts[node + 1]):
        next_road = graph.out_roads[i]
        is_final = (
            work.backward.stamps[next_road] == work.backward.state[SEARCH_NUMBER]
            and work.backward.heap_slots[next_road] < 0
        )
        cost_to_go = work.backward.costs[next_road] if is_final else least_to_go
        next_cost = cost + _turn_cost(road, next_road, graph, model)
        if next_cost + cost_to_go <= cost_bound:
            _relax(next_road, next_cost, metres, cost_to_go, road, work)


@inner_uncounted
def next_towards_targets(cost_bound: float, work: Workspace) -> int:
    """Take the next directed road of a search towards targets; -1 if there is none."""
    return _pop_next(cost_bound, work)


@inner_uncounted
def _min_distance_to_sources(node: int, graph: Graph, backward: BackwardSearch) -> float:
    """Lower bound of the distance from a node to the sources: to the circle round all of them."""
    centre = graph.node_positions[backward.state[CENTRE_NODE]]
    return max(_distance_to_node(node, centre, graph) - backward.limits[CENTRE_RADIUS], 0.0)


@inner_uncounted
def search_backward(
    sources: NDArray[np.int32],
    targets: NDArray[np.int32],
    target_costs: NDArray[np.float64],
    cost_bound: float,
    max_length: float,
    graph: Graph,
    model: ModelParameters,
    backward: BackwardSearch,
) -> None:
    """Find the cost to go from beginnings of directed roads to the targets, by one search.

    Paths begin at the ends of the ``sources`` and lead to the beginnings of the ``targets``, both
    directed roads; each target has a cost of its own. The search ends when it has reached the ends
    of all sources, or when the rest is out of the bound.
    """
    # Circle round the ends of all sources.
    backward.state[SEARCH_NUMBER] += 1
    backward.state[HEAP_SIZE] = 0
    backward.state[CENTRE_NODE] = graph.heads[sources[0]]
    backward.limits[CENTRE_RADIUS] = 0.0
    missing = 0
    centre = graph.node_positions[backward.state[CENTRE_NODE]]
    for road in sources:
        node = graph.heads[road]
        backward.limits[CENTRE_RADIUS] = max(
            backward.limits[CENTRE_RADIUS], _distance_to_node(node, centre, graph)
        )
        missing += not backward.is_source[node]
        backward.is_source[node] = True

    # Begin at all targets.
    for j in range(len(targets)):
        distance = _min_distance_to_sources(graph.heads[targets[j] ^ 1], graph, backward)
        _relax_backward(targets[j], target_costs[j], distance, cost_bound, max_length, backward)

    # Expand until all sources are reached; whatever is left costs at least the last key.
    backward.limits[COST_LIMIT] = cost_bound
    while backward.state[HEAP_SIZE] > 0:
        road = backward.heap[0]
        if missing == 0:
            backward.limits[COST_LIMIT] = backward.keys[road]
            break
        _pop_heap(backward.heap, backward.heap_slots, backward.keys, backward.state)
        node = graph.heads[road ^ 1]
        missing -= backward.is_source[node]
        backward.is_source[node] = False
        for i in range(graph.in_starts[node], graph.in_starts[node + 1]):
            before = graph.in_roads[i]
            cost = (
                backward.costs[road]
                + _turn_cost(before, road, graph, model)
                + graph.lengths[before]
            )
            distance = _min_distance_to_sources(graph.heads[before ^ 1], graph, backward)
            _relax_backward(before, cost, distance, cost_bound, max_length, backward)

    # Leave no marks.
    for road in sources:
        backward.is_source[graph.heads[road]] = False


@inner_uncounted
def _relax_backward(
    road: int,
    cost: float,
    distance: float,
    cost_bound: float,
    max_length: float,
    backward: BackwardSearch,
) -> None:
    """Label the beginning of a directed road, ``distance`` metres or more from the sources."""
    is_new = backward.stamps[road] != backward.state[SEARCH_NUMBER]
    if not is_new and (backward.heap_slots[road] < 0 or not cost < backward.costs[road]):
        return
    if cost + distance > cost_bound or distance > max_length:
        return
    backward.stamps[road] = backward.state[SEARCH_NUMBER]
    backward.costs[road] = cost
    backward.keys[road] = cost + distance

    # Insert it in the heap, or move it up there.
    if is_new:
        backward.heap_slots[road] = backward.state[HEAP_SIZE]
        backward.state[HEAP_SIZE] += 1
    backward.heap[backward.heap_slots[road]] = road
    _sift_up(backward.heap, backward.heap_slots, backward.keys, backward.heap_slots[road])


@jit
def find_path(
    road: int,
    metres_left: float,
    target: int,
    cost_bound: float,
    max_length: float,
    goal: NDArray[np.float64],
    goal_radius: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> NDArray[np.int32]:
    """Find the cheapest path from a position on a road to the beginning of a target.

    The path begins ``metres_left`` metres before the end of ``road``. Returns the directed roads
    after ``road``, up to and with ``target``; none if the target is out of the bound.
    """
    # As in the trellis, whose searches begin at the ends of roads.
    start_search(work)
    max_length += metres_left
    expand_to_goal(
        road,
        metres_left,
        metres_left,
        cost_bound,
        max_length,
        goal,
        goal_radius,
        graph,
        model,
        work,
    )

    # Search until the target's label is final.
    reached = -1
    while reached != target:
        reached = next_towards_goal(cost_bound, max_length, goal, goal_radius, graph, model, work)
        if reached < 0:
            return np.empty(0, np.int32)

    # Follow the parents back.
    count, here = 1, target
    while work.parents[here] != road:
        here = work.parents[here]
        count += 1
    path = np.empty(count, np.int32)
    here = target
    for i in range(count - 1, -1, -1):
        path[i] = here
        here = work.parents[here]
    return path
