"""The lattice of a hidden Markov model on roads: a layer of candidates for each used sample, and the cheapest chain through them.

A candidate is a place on a directed road, or ``NOWHERE``: off all roads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inlined, jit
from gpszip.kernels.match_near import near_roads
from gpszip.kernels.match_roads import Cells, Graph, Model, Roads, Work, apart, larger
from gpszip.kernels.match_search import clear_search, leave_to_goal, leave_to_wanted, next_to_goal, next_to_wanted, search_back

__all__ = [
    "GAP",
    "JUMP",
    "NOWHERE",
    "OVER",
    "ROUND",
    "STAY",
    "Lattice",
    "Layer",
    "advance",
    "begin",
    "candidates",
    "empty_layer",
    "lattice",
    "layer_from",
    "longest_way",
    "thin",
]

NOWHERE = -1

#: How one candidate was reached from the one before: over other roads, on the same one, turned round on it, without a way, after a silence.
OVER, STAY, ROUND, JUMP, GAP = 0, 1, 2, 3, 4

#: Two sums of the same numbers differ by less.
_ROUNDING = 1e-9


class Layer(NamedTuple):
    """Candidates of one sample, or of many: directed roads, metres along them, distance to the sample, and price of being there.

    Then, of the cheapest chain to each: its price, the candidate of the layer before, and how it was reached from there.
    """

    roads: NDArray[np.int32]
    metres: NDArray[np.float64]
    distances: NDArray[np.float64]
    prices: NDArray[np.float64]
    scores: NDArray[np.float64]
    backs: NDArray[np.int16]
    kinds: NDArray[np.uint8]


class Lattice(NamedTuple):
    """All layers of a track: layer i has the candidates ``begins[i]`` to ``begins[i + 1]`` of ``all``.

    ``moves[starts[i]:starts[i + 1]]`` are the prices of moves from each candidate of layer i - 1 to each of layer i, none after a silence.
    """

    begins: NDArray[np.int64]
    all: Layer
    starts: NDArray[np.int64]
    moves: NDArray[np.float32]


@jit
def thin(positions: NDArray[np.float64], silent: NDArray[np.bool_], spacing: float) -> NDArray[np.int64]:
    """Samples that make a layer: the first, each that lies ``spacing`` from the last one used, and both ends of a silence."""
    n = len(positions)
    used, count = np.empty(n, np.int64), 0
    begin = 0  # layers before the last silence
    for i in range(n):
        first, last = i == 0 or silent[i - 1], i == n - 1 or silent[i]
        if first:
            begin = count
        far = first or apart(positions, i, used[count - 1]) >= spacing
        if last and not far:
            if count - begin > 1:  # the end itself stands for the layer just before it
                count -= 1
            far = True
        if far:
            used[count] = i
            count += 1
    return used[:count]


@jit
def candidates(at: NDArray[np.float64], roads: Roads, cells: Cells, graph: Graph, model: Model, out: Layer) -> int:
    """Fill a layer for one sample and return the number of its candidates; the last one is always off all roads."""
    found, offsets, distances = np.empty(model.most, np.int32), np.empty(model.most), np.empty(model.most)
    count = near_roads(at, model.reach, roads, cells, found, offsets, distances)
    n = 0
    for i in range(count):
        for way in range(2):
            road = 2 * found[i] + way
            if graph.open[road]:
                out.roads[n] = road
                out.metres[n] = offsets[i] if way == 0 else graph.lengths[road] - offsets[i]
                out.distances[n] = distances[i]
                out.prices[n] = 0.5 * (distances[i] / model.sigma) ** 2
                n += 1
    out.roads[n], out.metres[n], out.distances[n], out.prices[n] = NOWHERE, 0.0, 0.0, model.off
    return n + 1


@jit
def longest_way(straight: float, seconds: float, model: Model) -> float:
    """Metres that a way between two samples may have.

    What the usual speed allows is no detour: a vehicle that waits for its samples may have gone round.
    """
    return min(model.fastest * seconds, max(model.detour * straight, model.usual * seconds)) + model.spare


@jit
def advance(
    before: Layer,
    n0: int,
    after: Layer,
    n1: int,
    goal: NDArray[np.float64],
    straight: float,
    longest: float,
    graph: Graph,
    model: Model,
    work: Work,
    moves: NDArray[np.float64],
) -> None:
    """Find the cheapest chain to each candidate of a layer from those to the layer before.

    ``goal`` is the sample of the layer, ``straight`` its distance from the one before; no way is longer than ``longest``.
    ``moves`` gets the price of every pair; where it was not worth a search, that of a jump.
    """
    linked = np.full(n1, -1, np.int32)  # the next candidate on the same directed road
    distinct = 0
    for j in range(n1):
        after.scores[j], after.backs[j], after.kinds[j] = np.inf, 0, JUMP
        road = after.roads[j]
        if road >= 0:
            distinct += work.targets[road] < 0
            linked[j] = work.targets[road]
            work.targets[road] = j
    for i in range(n0):
        for j in range(n1):
            ends = (before.roads[i] >= 0) + (after.roads[j] >= 0)
            moves[i, j] = 0.5 * model.jump * ends
            _offer(i, j, moves[i, j], JUMP, before, after, moves)
    order = np.argsort(np.floor(before.scores[:n0] / _ROUNDING + 0.5), kind="mergesort")
    order = order[before.roads[order] >= 0]
    for i in order:
        _on_same_road(i, straight, longest, before, after, linked, graph, model, work, moves)
    if distinct > 0 and len(order) > 0:
        wanted = _within_reach(order, straight, longest, before, after.scores[:n1].copy(), after, linked, goal, graph, model, work)
        _over_roads(order, straight, longest, before, wanted, after, linked, distinct, graph, model, work, moves)
    for j in range(n1):
        if after.roads[j] >= 0:
            work.targets[after.roads[j]] = -1
        after.scores[j] += after.prices[j]
    after.scores[:n1] -= after.scores[:n1].min()  # only differences count, and a long track must not wear them down


@inlined
def _within_reach(
    order: NDArray[np.int64],
    straight: float,
    longest: float,
    before: Layer,
    scores: NDArray[np.float64],
    after: Layer,
    linked: NDArray[np.int32],
    goal: NDArray[np.float64],
    graph: Graph,
    model: Model,
    work: Work,
) -> NDArray[np.float64]:
    """Lower the scores of candidates to what some way makes of them, by one search from all candidates before at once.

    The way that comes first at a place need not be the best one where ways are shorter than the straight line, but it is never better.
    """
    most = _worst(scores, after)
    bound = straight + model.beta * most
    clear_search(work)
    for i in order:
        road = before.roads[i]
        rest = graph.lengths[road] - before.metres[i]
        leave_to_goal(road, rest, rest + model.beta * before.scores[i], bound, longest, goal, model.reach, graph, model, work)
    met = np.zeros(len(scores), np.bool_)
    for j in range(len(scores)):
        met[j] = after.roads[j] < 0
    while True:
        found = next_to_goal(bound, longest, goal, model.reach, graph, model, work)
        if found < 0:
            return scores
        j = work.targets[found]
        if j < 0:
            continue
        while j >= 0:
            metres = work.metres[found] + after.metres[j]
            if metres <= longest:
                price = (work.price[found] - work.metres[found] + abs(metres - straight)) / model.beta
                scores[j] = min(scores[j], price)
            met[j] = True
            j = linked[j]
        most = -np.inf
        for k in range(len(scores)):
            if not met[k]:
                most = max(most, scores[k])
        bound = straight + model.beta * most


@inlined
def _over_roads(
    order: NDArray[np.int64],
    straight: float,
    longest: float,
    before: Layer,
    wanted: NDArray[np.float64],
    after: Layer,
    linked: NDArray[np.int32],
    distinct: int,
    graph: Graph,
    model: Model,
    work: Work,
    moves: NDArray[np.float64],
) -> None:
    """Offer the ways over other roads that make chains with a score wanted, or a margin worse."""
    targets, begins = np.empty(len(wanted), np.int32), np.empty(len(wanted))
    count = 0
    for j in range(len(wanted)):
        if after.roads[j] >= 0:
            targets[count] = after.roads[j]
            begins[count] = after.metres[j] - model.beta * (wanted[j] + model.margin + _ROUNDING)
            count += 1
    least = straight - model.beta * before.scores[order[0]]
    search_back(before.roads[order], targets[:count], begins[:count], least, longest, graph, work.rest)
    for i in order:
        road, bound = before.roads[i], straight - model.beta * before.scores[i]
        rest = graph.lengths[road] - before.metres[i]
        clear_search(work)
        leave_to_wanted(road, rest, rest, bound, longest, graph, model, work)
        reached = 0
        while reached < distinct:
            found = next_to_wanted(bound, longest, graph, model, work)
            if found < 0:
                break
            j = work.targets[found]
            reached += j >= 0
            while j >= 0:
                metres = work.metres[found] + after.metres[j]
                if metres <= longest:
                    turns = (work.price[found] - work.metres[found]) / model.beta
                    _offer(i, j, abs(metres - straight) / model.beta + turns, OVER, before, after, moves)
                j = linked[j]


@inlined
def _worst(scores: NDArray[np.float64], layer: Layer) -> float:
    """The highest score of a candidate on a road."""
    worst = -np.inf
    for j in range(len(scores)):
        if layer.roads[j] >= 0:
            worst = max(worst, scores[j])
    return worst


@inlined
def _on_same_road(
    i: int,
    straight: float,
    longest: float,
    before: Layer,
    after: Layer,
    linked: NDArray[np.int32],
    graph: Graph,
    model: Model,
    work: Work,
    moves: NDArray[np.float64],
) -> None:
    """Offer the ways that stay on a directed road, on or a little back, and those that turn round on it."""
    road, here = before.roads[i], before.metres[i]
    j = work.targets[road]
    while j >= 0:
        ahead = after.metres[j] - here
        if -model.slack <= ahead <= longest:
            _offer(i, j, abs(ahead - straight) / model.beta, STAY, before, after, moves)
        j = linked[j]
    j = work.targets[road ^ 1]
    while j >= 0:
        metres = abs(graph.lengths[road] - after.metres[j] - here)
        if metres <= longest:
            _offer(i, j, abs(metres - straight) / model.beta + model.u_turn, ROUND, before, after, moves)
        j = linked[j]


@inlined
def _offer(i: int, j: int, price: float, kind: int, before: Layer, after: Layer, moves: NDArray[np.float64]) -> None:
    """Take a way from candidate i to candidate j where it is cheaper than what is known, by more than rounding."""
    moves[i, j] = min(moves[i, j], price)
    if before.scores[i] + price < after.scores[j] - _ROUNDING:
        after.scores[j], after.backs[j], after.kinds[j] = before.scores[i] + price, i, kind


@jit
def lattice(
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    silent: NDArray[np.bool_],
    used: NDArray[np.int64],
    roads: Roads,
    cells: Cells,
    graph: Graph,
    model: Model,
    work: Work,
) -> Lattice:
    """Layers of all used samples of a track and the cheapest chain to each candidate."""
    layers, width = len(used), 2 * model.most + 1
    begins, starts = np.zeros(layers + 1, np.int64), np.zeros(layers + 1, np.int64)
    room = width + 8 * layers
    every = empty_layer(room)
    moves = np.empty((width, width))
    kept = np.empty(8 * room, np.float32)
    for layer in range(layers):
        low = begins[layer]
        if low + width > room:
            room = 2 * room
            every = _more(every, room)
        here = layer_from(every, low)
        n = candidates(positions[used[layer]], roads, cells, graph, model, here)
        begins[layer + 1], filled = low + n, starts[layer]
        starts[layer + 1] = filled
        if layer == 0:
            begin(here, n, -1)
            continue
        last = begins[layer - 1]
        before = layer_from(every, last)
        if _silence(silent, used[layer - 1], used[layer]):
            begin(here, n, np.argmin(every.scores[last:low]))
            continue
        straight = apart(positions, used[layer - 1], used[layer])
        longest = longest_way(straight, times[used[layer]] - times[used[layer - 1]], model)
        n0 = low - last
        advance(before, n0, here, n, positions[used[layer]], straight, longest, graph, model, work, moves)
        if filled + n0 * n > len(kept):
            kept = larger(kept, 2 * len(kept) + n0 * n)
        for i in range(n0):
            for j in range(n):
                kept[filled + i * n + j] = moves[i, j]
        starts[layer + 1] = filled + n0 * n
    return Lattice(begins, layer_from(every, 0), starts, kept)


@jit
def begin(layer: Layer, n: int, back: int) -> None:
    """Begin new chains, all after one that has ended."""
    for j in range(n):
        layer.scores[j], layer.backs[j], layer.kinds[j] = layer.prices[j], back, GAP


@jit
def empty_layer(size: int) -> Layer:
    """Room for so many candidates."""
    return Layer(
        np.empty(size, np.int32),
        np.empty(size),
        np.empty(size),
        np.empty(size),
        np.empty(size),
        np.empty(size, np.int16),
        np.empty(size, np.uint8),
    )


@jit
def layer_from(layer: Layer, low: int) -> Layer:
    """The same room without its first candidates."""
    return Layer(
        layer.roads[low:],
        layer.metres[low:],
        layer.distances[low:],
        layer.prices[low:],
        layer.scores[low:],
        layer.backs[low:],
        layer.kinds[low:],
    )


@jit
def _more(layer: Layer, size: int) -> Layer:
    return Layer(
        larger(layer.roads, size),
        larger(layer.metres, size),
        larger(layer.distances, size),
        larger(layer.prices, size),
        larger(layer.scores, size),
        larger(layer.backs, size),
        larger(layer.kinds, size),
    )


@jit
def _silence(silent: NDArray[np.bool_], first: int, last: int) -> bool:
    return bool(silent[first:last].any())
