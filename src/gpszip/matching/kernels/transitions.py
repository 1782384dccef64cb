"""Moves from layer to layer: the cheapest chain to each candidate of one from those of the layer before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inlined, jit
from gpszip.matching.kernels.candidates import JUMP, OVER, ROUND, ROUNDING, STAY, Layer
from gpszip.matching.kernels.roads import Graph, Model, Work
from gpszip.matching.kernels.search import clear_search, leave_to_goal, leave_to_wanted, next_to_goal, next_to_wanted, search_back

__all__ = ["advance", "longest_way", "too_fast"]


@jit
def longest_way(straight: float, seconds: float, model: Model) -> float:
    """Metres that a way between two samples may have.

    What the usual speed allows is no detour: a vehicle that waits for its samples may have gone round.
    """
    return min(model.fastest * seconds, max(model.detour * straight, model.usual * seconds)) + model.spare


@jit
def too_fast(straight: float, seconds: float, model: Model) -> bool:
    """Whether nobody goes so far in so many seconds: what comes after has nothing to do with what was before."""
    return straight > model.fastest * seconds + model.spare


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

    Of chains equally cheap but for rounding, such as those by two names of one crossing, the one counts whose candidate of the layer
    before comes first: the nearest to its sample, then by the number of its directed road.
    """
    linked = np.full(n1, -1, np.int32)  # the next candidate on the same directed road
    distinct = 0
    for j in range(n1):
        after.scores[j] = np.inf
        road = after.roads[j]
        if road >= 0:
            distinct += work.targets[road] < 0
            linked[j] = work.targets[road]
            work.targets[road] = j
    kinds = np.full((n0, n1), JUMP, np.uint8)
    for i in range(n0):
        for j in range(n1):
            ends = (before.roads[i] >= 0) + (after.roads[j] >= 0)
            moves[i, j] = 0.5 * model.jump * ends
            after.scores[j] = min(after.scores[j], before.scores[i] + moves[i, j])
    on = np.flatnonzero(before.roads[:n0] >= 0)
    for i in on:
        _on_same_road(i, straight, longest, before, after, linked, graph, model, work, moves, kinds)
    if distinct > 0 and len(on) > 0:
        wanted = _within_reach(on, straight, longest, before, after.scores[:n1].copy(), after, linked, goal, graph, model, work)
        _over_roads(on, straight, longest, before, wanted, after, linked, distinct, graph, model, work, moves, kinds)
    for j in range(n1):
        if after.roads[j] >= 0:
            work.targets[after.roads[j]] = -1
        i = 0
        while before.scores[i] + moves[i, j] > after.scores[j] + ROUNDING:
            i += 1
        after.backs[j], after.kinds[j] = i, kinds[i, j]
        after.scores[j] += after.prices[j]
    after.scores[:n1] -= after.scores[:n1].min()  # only differences count, and a long track must not wear them down


@inlined
def _within_reach(
    on: NDArray[np.int64],
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
    for i in on:
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
    on: NDArray[np.int64],
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
    kinds: NDArray[np.uint8],
) -> None:
    """Offer the ways over other roads that make chains with a score wanted, or a margin worse.

    Searches share what they find: one that comes to a road from whose end all was searched before does not go on there, but takes over
    the ways found. Chains that are cheaper at the ends of their roads go first, so that what was found is all that others can want.
    """
    targets, begins = np.empty(len(wanted), np.int32), np.empty(len(wanted))
    count = 0
    for j in range(len(wanted)):
        if after.roads[j] >= 0:
            targets[count] = after.roads[j]
            begins[count] = after.metres[j] - model.beta * (wanted[j] + model.margin + ROUNDING)
            count += 1
    rests = graph.lengths[before.roads[on]] - before.metres[on]
    ends = rests + model.beta * before.scores[on]
    least = straight - model.beta * before.scores[on].min()
    search_back(before.roads[on], targets[:count], begins[:count], least, longest, graph, model, work.rest)
    price, metres = np.full((len(on), len(wanted)), np.inf), np.empty((len(on), len(wanted)))  # from the ends of roads
    for k in np.argsort(ends, kind="mergesort"):
        i, rest = on[k], rests[k]
        road, bound = before.roads[i], straight - ends[k]
        if work.known[road] < 0:
            _search_on(road, k, bound, longest, linked, distinct, price, metres, graph, model, work)
            work.known[road] = k
        known = work.known[road]
        for j in range(len(wanted)):
            way = rest + metres[known, j]
            if price[known, j] < np.inf and way + after.metres[j] <= longest:
                turns = (price[known, j] - metres[known, j]) / model.beta
                _offer(i, j, abs(way + after.metres[j] - straight) / model.beta + turns, OVER, before, after, moves, kinds)
    for i in on:
        work.known[before.roads[i]] = -1


@inlined
def _search_on(
    road: int,
    k: int,
    bound: float,
    longest: float,
    linked: NDArray[np.int32],
    distinct: int,
    price: NDArray[np.float64],
    metres: NDArray[np.float64],
    graph: Graph,
    model: Model,
    work: Work,
) -> None:
    """Fill row k with the ways from the end of a directed road to the beginnings of those of all candidates."""
    clear_search(work)
    leave_to_wanted(road, 0.0, 0.0, bound, longest, graph, model, work)
    reached = 0
    while reached < distinct:
        found = next_to_wanted(bound, work)
        if found < 0:
            break
        j = work.targets[found]
        reached += j >= 0
        while j >= 0:
            if work.price[found] < price[k, j]:
                price[k, j], metres[k, j] = work.price[found], work.metres[found]
            j = linked[j]
        end, way = work.price[found] + graph.lengths[found], work.metres[found] + graph.lengths[found]
        known = work.known[found]
        if known < 0:
            leave_to_wanted(found, way, end, bound, longest, graph, model, work)
            continue
        for one in range(price.shape[1]):
            if end + price[known, one] < price[k, one]:
                price[k, one], metres[k, one] = end + price[known, one], way + metres[known, one]


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
    kinds: NDArray[np.uint8],
) -> None:
    """Offer the ways that stay on a directed road, on or a little back, and those that turn round on it."""
    road, here = before.roads[i], before.metres[i]
    j = work.targets[road]
    while j >= 0:
        ahead = after.metres[j] - here
        if -model.slack <= ahead <= longest:
            _offer(i, j, abs(ahead - straight) / model.beta, STAY, before, after, moves, kinds)
        j = linked[j]
    j = work.targets[road ^ 1]
    while j >= 0:
        metres = abs(graph.lengths[road] - after.metres[j] - here)
        if metres <= longest:
            _offer(i, j, abs(metres - straight) / model.beta + model.u_turn, ROUND, before, after, moves, kinds)
        j = linked[j]


@inlined
def _offer(
    i: int, j: int, price: float, kind: int, before: Layer, after: Layer, moves: NDArray[np.float64], kinds: NDArray[np.uint8]
) -> None:
    """Take a way from candidate i to candidate j where it is cheaper than what is known, or as cheap and of a kind that comes first."""
    if price < moves[i, j] - ROUNDING or (price <= moves[i, j] + ROUNDING and kind < kinds[i, j]):
        kinds[i, j] = kind
    moves[i, j] = min(moves[i, j], price)
    after.scores[j] = min(after.scores[j], before.scores[i] + price)
