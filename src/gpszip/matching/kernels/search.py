"""Bounded search for ways over directed roads towards a goal, with prices for turns.

A label of the search belongs to the beginning of a directed road: the metres to it, and their price, which is metres and turns.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inlined, jit
from gpszip.matching.kernels.roads import BackwardSearch, Graph, ModelParameters, Workspace

__all__ = [
    "expand_to_goal",
    "expand_to_targets",
    "find_path",
    "next_towards_goal",
    "next_towards_targets",
    "search_backward",
    "start_search",
]


@inlined
def _turn_cost(a: int, b: int, graph: Graph, model: ModelParameters) -> float:
    """Price in metres of going from the end of directed road a to directed road b; where the road only bends, it is nothing."""
    if b == a ^ 1:
        return model.beta * model.u_turn_cost
    node = graph.heads[a]
    if graph.begins[node + 1] - graph.begins[node] <= 2:
        return 0.0
    cosine = -(
        graph.headings[a ^ 1, 0] * graph.headings[b, 0]
        + graph.headings[a ^ 1, 1] * graph.headings[b, 1]
    )
    return 0.5 * model.beta * model.turn_cost * (1.0 - cosine)


@inlined
def _sift_up(
    heap: NDArray[np.int32], slots: NDArray[np.int32], keys: NDArray[np.float64], slot: int
) -> None:
    item = heap[slot]
    key = keys[item]
    i = slot
    while i > 0:
        parent = (i - 1) // 2
        other = heap[parent]
        if keys[other] < key or (keys[other] == key and other <= item):
            break
        heap[i] = other
        slots[other] = i
        i = parent
    heap[i] = item
    slots[item] = i


@inlined
def _sift_down(
    heap: NDArray[np.int32], slots: NDArray[np.int32], keys: NDArray[np.float64], size: int
) -> None:
    item = heap[0]
    key = keys[item]
    i = 0
    while 2 * i + 1 < size:
        child = 2 * i + 1
        if child + 1 < size:
            left, right = heap[child], heap[child + 1]
            if keys[right] < keys[left] or (keys[right] == keys[left] and right < left):
                child += 1
        other = heap[child]
        if key < keys[other] or (key == keys[other] and item <= other):
            break
        heap[i] = other
        slots[other] = i
        i = child
    heap[i] = item
    slots[item] = i


@inlined
def _take_least(
    heap: NDArray[np.int32],
    slots: NDArray[np.int32],
    keys: NDArray[np.float64],
    state: NDArray[np.int64],
) -> None:
    """Drop the least item of a heap, whose size is ``state[1]``."""
    slots[heap[0]] = -1
    state[1] -= 1
    if state[1] > 0:
        heap[0] = heap[state[1]]
        slots[heap[0]] = 0
        _sift_down(heap, slots, keys, state[1])


@inlined
def _distance(node: int, at: NDArray[np.float64], graph: Graph) -> float:
    square = 0.0
    for axis in range(len(at)):
        square += (graph.nodes[node, axis] - at[axis]) ** 2
    return math.sqrt(square)


@inlined
def _label(
    road: int, price: float, metres: float, missing: float, parent: int, work: Workspace
) -> None:
    """Note that the beginning of a directed road is reached, unless it was reached as cheaply before."""
    new = work.stamps[road] != work.state[0]
    if not new and (work.slots[road] < 0 or not price < work.costs[road]):
        return
    work.stamps[road], work.costs[road], work.metres[road], work.parents[road] = (
        work.state[0],
        price,
        metres,
        parent,
    )
    work.keys[road] = price + missing
    if new:
        work.slots[road] = work.state[1]
        work.state[1] += 1
    work.heap[work.slots[road]] = road
    _sift_up(work.heap, work.slots, work.keys, work.slots[road])


@jit
def start_search(work: Workspace) -> None:
    """Begin a search, from nowhere yet."""
    work.state[0] += 1
    work.state[1] = 0


@inlined
def _next(bound: float, work: Workspace) -> int:
    if work.state[1] == 0:
        return -1
    road = work.heap[0]
    if work.keys[road] > bound:
        return -1
    _take_least(work.heap, work.slots, work.keys, work.state)
    return int(road)


@inlined
def expand_to_goal(
    road: int,
    metres: float,
    price: float,
    bound: float,
    longest: float,
    goal: NDArray[np.float64],
    near: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> None:
    """Go on from the end of a directed road, reached by so many metres at some price, to places within ``near`` metres of a goal.

    None is followed that strays too far to be there at a price in metres within the bound, or is longer than ``longest`` metres.
    """
    node = graph.heads[road]
    missing = max(_distance(node, goal, graph) - near, 0.0)
    if metres > longest or price + missing > bound:
        return
    for i in range(graph.begins[node], graph.begins[node + 1]):
        out = graph.outs[i]
        here = price + _turn_cost(road, out, graph, model)
        if here + missing <= bound:
            _label(out, here, metres, missing, road, work)


@inlined
def next_towards_goal(
    bound: float,
    longest: float,
    goal: NDArray[np.float64],
    near: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> int:
    """Directed road whose beginning, and then the goal, is reached next at the least price; -1 if none is within the bound."""
    road = _next(bound, work)
    if road >= 0:
        length = graph.lengths[road]
        expand_to_goal(
            road,
            work.metres[road] + length,
            work.costs[road] + length,
            bound,
            longest,
            goal,
            near,
            graph,
            model,
            work,
        )
    return road


@inlined
def expand_to_targets(
    road: int,
    metres: float,
    price: float,
    bound: float,
    longest: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> None:
    """Go on from the end of a directed road to what the last search back wanted."""
    if metres > longest:
        return
    node = graph.heads[road]
    least = work.backward.limits[0] - _away(
        node, graph, work.backward
    )  # where the search back did not get to, more is missing
    for i in range(graph.begins[node], graph.begins[node + 1]):
        out = graph.outs[i]
        met = work.backward.stamps[out] == work.backward.state[0] and work.backward.slots[out] < 0
        missing = work.backward.costs[out] if met else least
        here = price + _turn_cost(road, out, graph, model)
        if here + missing <= bound:
            _label(out, here, metres, missing, road, work)


@inlined
def next_towards_targets(bound: float, work: Workspace) -> int:
    """Directed road whose beginning, and then what is wanted, is reached next at the least price; -1 if none is within the bound."""
    return _next(bound, work)


@inlined
def _away(node: int, graph: Graph, rest: BackwardSearch) -> float:
    """Metres that a node is at least away from where ways come from."""
    return max(_distance(node, graph.nodes[rest.state[2]], graph) - rest.limits[1], 0.0)


@jit
def search_backward(
    sources: NDArray[np.int32],
    targets: NDArray[np.int32],
    begins: NDArray[np.float64],
    bound: float,
    longest: float,
    graph: Graph,
    model: ModelParameters,
    rest: BackwardSearch,
) -> None:
    """Find what is missing from the beginnings of directed roads to those of others, the targets, each with a price to begin with.

    Ways come from the ends of directed roads, the sources; the search ends when it met them all, or is out of bound.
    """
    rest.state[0] += 1
    rest.state[1] = 0
    rest.state[2] = graph.heads[sources[0]]
    rest.limits[1] = 0.0
    missing = 0
    for road in sources:
        node = graph.heads[road]
        rest.limits[1] = max(rest.limits[1], _distance(node, graph.nodes[rest.state[2]], graph))
        missing += not rest.wanted[node]
        rest.wanted[node] = True
    for j in range(len(targets)):
        _back_to(
            targets[j],
            begins[j],
            _away(graph.heads[targets[j] ^ 1], graph, rest),
            bound,
            longest,
            rest,
        )
    rest.limits[0] = bound
    while rest.state[1] > 0:
        road = rest.heap[0]
        if missing == 0:
            rest.limits[0] = rest.keys[road]
            break
        _take_least(rest.heap, rest.slots, rest.keys, rest.state)
        node = graph.heads[road ^ 1]
        missing -= rest.wanted[node]
        rest.wanted[node] = False
        for i in range(graph.arrivals[node], graph.arrivals[node + 1]):
            before = graph.ins[i]
            price = (
                rest.costs[road] + _turn_cost(before, road, graph, model) + graph.lengths[before]
            )
            _back_to(
                before, price, _away(graph.heads[before ^ 1], graph, rest), bound, longest, rest
            )
    for road in sources:
        rest.wanted[graph.heads[road]] = False


@inlined
def _back_to(
    road: int, price: float, away: float, bound: float, longest: float, rest: BackwardSearch
) -> None:
    new = rest.stamps[road] != rest.state[0]
    if not new and (rest.slots[road] < 0 or not price < rest.costs[road]):
        return
    if price + away > bound or away > longest:
        return
    rest.stamps[road], rest.costs[road], rest.keys[road] = rest.state[0], price, price + away
    if new:
        rest.slots[road] = rest.state[1]
        rest.state[1] += 1
    rest.heap[rest.slots[road]] = road
    _sift_up(rest.heap, rest.slots, rest.keys, rest.slots[road])


@jit
def find_path(
    road: int,
    rest: float,
    target: int,
    bound: float,
    longest: float,
    goal: NDArray[np.float64],
    near: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> NDArray[np.int32]:
    """Directed roads after ``road``, ``rest`` metres before its end, up to and with ``target``; none if it is out of bound."""
    start_search(work)
    longest += rest  # as in the lattice, whose searches begin at the ends of roads
    expand_to_goal(road, rest, rest, bound, longest, goal, near, graph, model, work)
    found = -1
    while found != target:
        found = next_towards_goal(bound, longest, goal, near, graph, model, work)
        if found < 0:
            return np.empty(0, np.int32)
    count, here = 1, target
    while work.parents[here] != road:
        here = work.parents[here]
        count += 1
    way = np.empty(count, np.int32)
    here = target
    for i in range(count - 1, -1, -1):
        way[i] = here
        here = work.parents[here]
    return way
