"""Bounded search for ways over directed roads towards a goal, with prices for turns.

A label of the search belongs to the beginning of a directed road: the metres to it, and their price, which is metres and turns.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.kernels.match_roads import Graph, Model, Work

__all__ = ["begin_search", "find_way", "next_settled"]


@jit
def _turn_price(a: int, b: int, graph: Graph, model: Model) -> float:
    """Price in metres of going from the end of directed road a to directed road b; where the road only bends, it is nothing."""
    if b == a ^ 1:
        return model.beta * model.u_turn
    node = graph.heads[a]
    if graph.begins[node + 1] - graph.begins[node] <= 2:
        return 0.0
    cosine = -(graph.headings[a ^ 1, 0] * graph.headings[b, 0] + graph.headings[a ^ 1, 1] * graph.headings[b, 1])
    return 0.5 * model.beta * model.turn * (1.0 - cosine)


@jit
def _sift_up(work: Work, slot: int) -> None:
    heap, slots, keys = work.heap, work.slots, work.keys
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


@jit
def _sift_down(work: Work, size: int) -> None:
    heap, slots, keys = work.heap, work.slots, work.keys
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


@jit
def _relax(
    road: int, metres: float, price: float, bound: float, goal: NDArray[np.float64], near: float, graph: Graph, model: Model, work: Work
) -> None:
    """Offer the way to the end of a directed road to all that leave from there, unless the goal is out of bound from there."""
    node = graph.heads[road]
    square = 0.0
    for axis in range(len(goal)):
        square += (graph.nodes[node, axis] - goal[axis]) ** 2
    missing = max(math.sqrt(square) - near, 0.0)
    if price + missing > bound:
        return
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
        _sift_up(work, work.slots[out])


@jit
def begin_search(
    road: int, rest: float, bound: float, goal: NDArray[np.float64], near: float, graph: Graph, model: Model, work: Work
) -> None:
    """Start a search on a directed road, ``rest`` metres before its end, for ways whose price in metres is within a bound.

    Only ways to places within ``near`` metres of a goal are wanted: none that strays too far to reach them is followed.
    """
    work.state[0] += 1
    work.state[1] = 0
    _relax(road, rest, rest, bound, goal, near, graph, model, work)


@jit
def next_settled(bound: float, goal: NDArray[np.float64], near: float, graph: Graph, model: Model, work: Work) -> int:
    """Directed road whose beginning, and then the goal, is reached next at the least price; -1 if none is within the bound."""
    if work.state[1] == 0:
        return -1
    road = work.heap[0]
    if work.keys[road] > bound:
        return -1
    work.slots[road] = -1
    work.state[1] -= 1
    if work.state[1] > 0:
        work.heap[0] = work.heap[work.state[1]]
        work.slots[work.heap[0]] = 0
        _sift_down(work, work.state[1])
    length = graph.lengths[road]
    _relax(road, work.metres[road] + length, work.price[road] + length, bound, goal, near, graph, model, work)
    return road


@jit
def find_way(
    road: int,
    rest: float,
    target: int,
    bound: float,
    goal: NDArray[np.float64],
    near: float,
    graph: Graph,
    model: Model,
    work: Work,
) -> NDArray[np.int32]:
    """Directed roads after ``road``, ``rest`` metres before its end, up to and with ``target``; none if it is out of bound."""
    begin_search(road, rest, bound, goal, near, graph, model, work)
    found = -1
    while found != target:
        found = next_settled(bound, goal, near, graph, model, work)
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
