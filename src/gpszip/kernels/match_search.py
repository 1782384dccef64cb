"""Bounded search for ways over directed roads towards a goal, with prices for turns.

A label of the search belongs to the beginning of a directed road: the metres to it, and their price, which is metres and turns.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inlined, jit
from gpszip.kernels.match_roads import Graph, Model, Rest, Work

__all__ = ["clear_search", "find_way", "leave_to_goal", "leave_to_wanted", "next_to_goal", "next_to_wanted", "search_back"]


@inlined
def _turn_price(a: int, b: int, graph: Graph, model: Model) -> float:
    """Price in metres of going from the end of directed road a to directed road b; where the road only bends, it is nothing."""
    if b == a ^ 1:
        return model.beta * model.u_turn
    node = graph.heads[a]
    if graph.begins[node + 1] - graph.begins[node] <= 2:
        return 0.0
    cosine = -(graph.headings[a ^ 1, 0] * graph.headings[b, 0] + graph.headings[a ^ 1, 1] * graph.headings[b, 1])
    return 0.5 * model.beta * model.turn * (1.0 - cosine)


@inlined
def _sift_up(heap: NDArray[np.int32], slots: NDArray[np.int32], keys: NDArray[np.float64], slot: int) -> None:
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
def _sift_down(heap: NDArray[np.int32], slots: NDArray[np.int32], keys: NDArray[np.float64], size: int) -> None:
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
def _take_least(heap: NDArray[np.int32], slots: NDArray[np.int32], keys: NDArray[np.float64], state: NDArray[np.int64]) -> None:
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
def _relax(
    road: int, metres: float, price: float, missing: float, bound: float, longest: float, graph: Graph, model: Model, work: Work
) -> None:
    """Offer the way to the end of a directed road to all that leave from there, unless what is missing from there is out of bound."""
    if metres > longest or price + missing > bound:
        return
    node = graph.heads[road]
    for i in range(graph.begins[node], graph.begins[node + 1]):
        out = graph.outs[i]
        here = price + _turn_price(road, out, graph, model)
        if here + missing > bound:
            continue
        new = work.stamps[out] != work.state[0]
        if not new and (work.slots[out] < 0 or not here < work.price[out]):
            continue
        work.stamps[out], work.price[out], work.metres[out], work.parents[out] = work.state[0], here, metres, road
        work.keys[out] = here + missing
        if new:
            work.slots[out] = work.state[1]
            work.state[1] += 1
        work.heap[work.slots[out]] = out
        _sift_up(work.heap, work.slots, work.keys, work.slots[out])


@jit
def clear_search(work: Work) -> None:
    """Begin a search, from nowhere yet."""
    work.state[0] += 1
    work.state[1] = 0


@inlined
def _next(bound: float, work: Work) -> int:
    if work.state[1] == 0:
        return -1
    road = work.heap[0]
    if work.keys[road] > bound:
        return -1
    _take_least(work.heap, work.slots, work.keys, work.state)
    return int(road)


@inlined
def leave_to_goal(
    road: int,
    metres: float,
    price: float,
    bound: float,
    longest: float,
    goal: NDArray[np.float64],
    near: float,
    graph: Graph,
    model: Model,
    work: Work,
) -> None:
    """Go on from the end of a directed road, reached by so many metres at some price, to places within ``near`` metres of a goal.

    None is followed that strays too far to be there at a price in metres within the bound, or is longer than ``longest`` metres.
    """
    missing = max(_distance(graph.heads[road], goal, graph) - near, 0.0)
    _relax(road, metres, price, missing, bound, longest, graph, model, work)


@inlined
def next_to_goal(bound: float, longest: float, goal: NDArray[np.float64], near: float, graph: Graph, model: Model, work: Work) -> int:
    """Directed road whose beginning, and then the goal, is reached next at the least price; -1 if none is within the bound."""
    road = _next(bound, work)
    if road >= 0:
        length = graph.lengths[road]
        leave_to_goal(road, work.metres[road] + length, work.price[road] + length, bound, longest, goal, near, graph, model, work)
    return road


@inlined
def leave_to_wanted(road: int, metres: float, price: float, bound: float, longest: float, graph: Graph, model: Model, work: Work) -> None:
    """Go on from the end of a directed road to what the last search back wanted."""
    _relax(road, metres, price, _missing(graph.heads[road], graph, work.rest), bound, longest, graph, model, work)


@inlined
def next_to_wanted(bound: float, longest: float, graph: Graph, model: Model, work: Work) -> int:
    """Directed road whose beginning, and then what is wanted, is reached next at the least price; -1 if none is within the bound."""
    road = _next(bound, work)
    if road >= 0:
        length = graph.lengths[road]
        leave_to_wanted(road, work.metres[road] + length, work.price[road] + length, bound, longest, graph, model, work)
    return road


@inlined
def _missing(node: int, graph: Graph, rest: Rest) -> float:
    """The least price in metres, without turns, from a node to what is wanted; a lower bound where the search did not get to."""
    if rest.stamps[node] == rest.state[0] and rest.slots[node] < 0:
        return float(rest.price[node])
    return float(rest.limits[0] - _away(node, graph, rest))


@inlined
def _away(node: int, graph: Graph, rest: Rest) -> float:
    """Metres that a node is at least away from where ways come from."""
    return max(_distance(node, graph.nodes[rest.state[2]], graph) - rest.limits[1], 0.0)


@jit
def search_back(
    sources: NDArray[np.int32],
    targets: NDArray[np.int32],
    begins: NDArray[np.float64],
    bound: float,
    longest: float,
    graph: Graph,
    rest: Rest,
) -> None:
    """Find what is missing from nodes to the beginnings of directed roads, the targets, each with a price to begin with.

    Ways come from the ends of other directed roads, the sources; the search ends when it met them all, or is out of bound.
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
        _back_to(graph.heads[targets[j] ^ 1], begins[j], bound, longest, graph, rest)
    rest.limits[0] = bound
    while rest.state[1] > 0:
        node = rest.heap[0]
        if missing == 0:
            rest.limits[0] = rest.keys[node]
            break
        _take_least(rest.heap, rest.slots, rest.keys, rest.state)
        missing -= rest.wanted[node]
        for i in range(graph.arrivals[node], graph.arrivals[node + 1]):
            road = graph.ins[i]
            _back_to(graph.heads[road ^ 1], rest.price[node] + graph.lengths[road], bound, longest, graph, rest)
    for road in sources:
        rest.wanted[graph.heads[road]] = False


@inlined
def _back_to(node: int, price: float, bound: float, longest: float, graph: Graph, rest: Rest) -> None:
    new = rest.stamps[node] != rest.state[0]
    if not new and (rest.slots[node] < 0 or not price < rest.price[node]):
        return
    away = _away(node, graph, rest)
    key = price + away
    if key > bound or away > longest:
        return
    rest.stamps[node], rest.price[node], rest.keys[node] = rest.state[0], price, key
    if new:
        rest.slots[node] = rest.state[1]
        rest.state[1] += 1
    rest.heap[rest.slots[node]] = node
    _sift_up(rest.heap, rest.slots, rest.keys, rest.slots[node])


@jit
def find_way(
    road: int,
    rest: float,
    target: int,
    bound: float,
    longest: float,
    goal: NDArray[np.float64],
    near: float,
    graph: Graph,
    model: Model,
    work: Work,
) -> NDArray[np.int32]:
    """Directed roads after ``road``, ``rest`` metres before its end, up to and with ``target``; none if it is out of bound."""
    clear_search(work)
    leave_to_goal(road, rest, rest, bound, longest, goal, near, graph, model, work)
    found = -1
    while found != target:
        found = next_to_goal(bound, longest, goal, near, graph, model, work)
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
