"""Ways through a gap: cheapest ways over directed roads from one road and to another.

Road e of a network is directed road 2e from its start to its end and 2e + 1 the other way, so that ``a ^ 1`` is a turned round.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import jit

__all__ = ["shortest_path_tree"]


@jit
def _turn(
    a: int, b: int, crossing: bool, headings: NDArray[np.float64], turn: float, u_turn: float
) -> float:
    """Price of going from directed road a to directed road b."""
    if b == a ^ 1:
        return u_turn
    if not crossing:
        return 0.0
    cosine = -(headings[a ^ 1, 0] * headings[b, 0] + headings[a ^ 1, 1] * headings[b, 1])
    return 0.5 * turn * (1.0 - cosine)


@jit
def shortest_path_tree(
    roads: NDArray[np.int64],
    prices: NDArray[np.float64],
    bound: float,
    costs: NDArray[np.float64],
    begins: NDArray[np.int64],
    links: NDArray[np.int32],
    nodes: NDArray[np.int32],
    crossings: NDArray[np.bool_],
    headings: NDArray[np.float64],
    turn: float,
    u_turn: float,
    back: bool,
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.int32]]:
    """Directed roads within a price of where a search begins, with their price and the one through which they are reached.

    Forwards, ``links[begins[v]:begins[v + 1]]`` leave node v, ``nodes`` is where each road ends, and a price is that at the end of a
    road; backwards they enter it, ``nodes`` is where each begins, and a price is that from the beginning of a road. ``roads``
    and ``prices`` say where the search begins, prices at the same place of a road. What is reached comes in the order of prices.
    """
    size = 1024
    keys, items = np.empty(size), np.empty(size, np.int64)
    count = 0
    best: dict[int, float] = {}
    parent: dict[int, int] = {}
    for i in range(len(roads)):
        if prices[i] <= bound and (roads[i] not in best or prices[i] < best[roads[i]]):
            best[roads[i]], parent[roads[i]] = prices[i], -1
            count = push(keys, items, count, prices[i], roads[i])
    done: dict[int, int] = {}
    order = np.empty(size, np.int32)
    found = np.empty(size)
    through = np.empty(size, np.int32)
    settled = 0
    while count > 0:
        key = keys[0]
        road, count = pop(keys, items, count)
        if road in done:
            continue
        done[road] = settled
        if settled == len(order):
            order = np.concatenate((order, np.empty_like(order)))
            found = np.concatenate((found, np.empty_like(found)))
            through = np.concatenate((through, np.empty_like(through)))
        order[settled], found[settled], through[settled] = road, key, parent[road]
        settled += 1
        node = nodes[road]
        for j in range(begins[node], begins[node + 1]):
            other = links[j]
            if other in done:
                continue
            if back:
                price = (
                    key + _turn(other, road, crossings[node], headings, turn, u_turn) + costs[other]
                )
            else:
                price = (
                    key + _turn(road, other, crossings[node], headings, turn, u_turn) + costs[other]
                )
            if price > bound or (other in best and price >= best[other]):
                continue
            best[other], parent[other] = price, road
            if count + 1 >= len(keys):
                keys, items = (
                    np.concatenate((keys, np.empty_like(keys))),
                    np.concatenate((items, np.empty_like(items))),
                )
            count = push(keys, items, count, price, other)
    return order[:settled], found[:settled], through[:settled]
