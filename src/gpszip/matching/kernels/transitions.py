"""Moves from layer to layer: the cheapest chain to each candidate of one from those of the layer before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inlined, jit
from gpszip.matching.kernels.candidates import (
    JUMP,
    OTHER_ROADS,
    ROUNDING,
    SAME_ROAD,
    U_TURN,
    Candidates,
)
from gpszip.matching.kernels.roads import Graph, ModelParameters, Workspace
from gpszip.matching.kernels.search import (
    expand_to_goal,
    expand_to_targets,
    next_towards_goal,
    next_towards_targets,
    search_backward,
    start_search,
)

__all__ = ["advance_paths", "is_too_fast", "max_path_length"]


@jit
def max_path_length(straight: float, seconds: float, model: ModelParameters) -> float:
    """Metres that a way between two samples may have.

    What the usual speed allows is no detour: a vehicle that waits for its samples may have gone round.
    """
    return (
        min(
            model.max_speed * seconds,
            max(model.max_detour * straight, model.median_speed * seconds),
        )
        + model.length_tolerance
    )


@jit
def is_too_fast(straight: float, seconds: float, model: ModelParameters) -> bool:
    """Whether nobody goes so far in so many seconds: what comes after has nothing to do with what was before."""
    return straight > model.max_speed * seconds + model.length_tolerance


@jit
def advance_paths(
    before: Candidates,
    n0: int,
    after: Candidates,
    n1: int,
    goal: NDArray[np.float64],
    straight: float,
    longest: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
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
        after.path_costs[j] = np.inf
        road = after.roads[j]
        if road >= 0:
            distinct += work.targets[road] < 0
            linked[j] = work.targets[road]
            work.targets[road] = j
    kinds = np.full((n0, n1), JUMP, np.uint8)
    for i in range(n0):
        for j in range(n1):
            ends = (before.roads[i] >= 0) + (after.roads[j] >= 0)
            moves[i, j] = 0.5 * model.jump_cost * ends
            after.path_costs[j] = min(after.path_costs[j], before.path_costs[i] + moves[i, j])
    on = np.flatnonzero(before.roads[:n0] >= 0)
    for i in on:
        _on_same_road(i, straight, longest, before, after, linked, graph, model, work, moves, kinds)
    if distinct > 0 and len(on) > 0:
        wanted = _within_reach(
            on,
            straight,
            longest,
            before,
            after.path_costs[:n1].copy(),
            after,
            linked,
            goal,
            graph,
            model,
            work,
        )
        _over_roads(
            on,
            straight,
            longest,
            before,
            wanted,
            after,
            linked,
            distinct,
            graph,
            model,
            work,
            moves,
            kinds,
        )
    for j in range(n1):
        if after.roads[j] >= 0:
            work.targets[after.roads[j]] = -1
        i = 0
        while before.path_costs[i] + moves[i, j] > after.path_costs[j] + ROUNDING:
            i += 1
        after.predecessors[j], after.transitions[j] = i, kinds[i, j]
        after.path_costs[j] += after.emission_costs[j]
    after.path_costs[:n1] -= after.path_costs[
        :n1
    ].min()  # only differences count, and a long track must not wear them down


@inlined
def _within_reach(
    on: NDArray[np.int64],
    straight: float,
    longest: float,
    before: Candidates,
    scores: NDArray[np.float64],
    after: Candidates,
    linked: NDArray[np.int32],
    goal: NDArray[np.float64],
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> NDArray[np.float64]:
    """Lower the scores of candidates to what some way makes of them, by one search from all candidates before at once.

    The way that comes first at a place need not be the best one where ways are shorter than the straight line, but it is never better.
    """
    most = _worst(scores, after)
    bound = straight + model.beta * most
    start_search(work)
    for i in on:
        road = before.roads[i]
        rest = graph.lengths[road] - before.metres[i]
        expand_to_goal(
            road,
            rest,
            rest + model.beta * before.path_costs[i],
            bound,
            longest,
            goal,
            model.search_radius,
            graph,
            model,
            work,
        )
    met = np.zeros(len(scores), np.bool_)
    for j in range(len(scores)):
        met[j] = after.roads[j] < 0
    while True:
        found = next_towards_goal(bound, longest, goal, model.search_radius, graph, model, work)
        if found < 0:
            return scores
        j = work.targets[found]
        if j < 0:
            continue
        while j >= 0:
            metres = work.metres[found] + after.metres[j]
            if metres <= longest:
                price = (
                    work.costs[found] - work.metres[found] + abs(metres - straight)
                ) / model.beta
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
    before: Candidates,
    wanted: NDArray[np.float64],
    after: Candidates,
    linked: NDArray[np.int32],
    distinct: int,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
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
            begins[count] = after.metres[j] - model.beta * (
                wanted[j] + model.cost_margin + ROUNDING
            )
            count += 1
    rests = graph.lengths[before.roads[on]] - before.metres[on]
    ends = rests + model.beta * before.path_costs[on]
    least = straight - model.beta * before.path_costs[on].min()
    search_backward(
        before.roads[on],
        targets[:count],
        begins[:count],
        least,
        longest,
        graph,
        model,
        work.backward,
    )
    price, metres = (
        np.full((len(on), len(wanted)), np.inf),
        np.empty((len(on), len(wanted))),
    )  # from the ends of roads
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
                _offer(
                    i,
                    j,
                    abs(way + after.metres[j] - straight) / model.beta + turns,
                    OTHER_ROADS,
                    before,
                    after,
                    moves,
                    kinds,
                )
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
    model: ModelParameters,
    work: Workspace,
) -> None:
    """Fill row k with the ways from the end of a directed road to the beginnings of those of all candidates."""
    start_search(work)
    expand_to_targets(road, 0.0, 0.0, bound, longest, graph, model, work)
    reached = 0
    while reached < distinct:
        found = next_towards_targets(bound, work)
        if found < 0:
            break
        j = work.targets[found]
        reached += j >= 0
        while j >= 0:
            if work.costs[found] < price[k, j]:
                price[k, j], metres[k, j] = work.costs[found], work.metres[found]
            j = linked[j]
        end, way = (
            work.costs[found] + graph.lengths[found],
            work.metres[found] + graph.lengths[found],
        )
        known = work.known[found]
        if known < 0:
            expand_to_targets(found, way, end, bound, longest, graph, model, work)
            continue
        for one in range(price.shape[1]):
            if end + price[known, one] < price[k, one]:
                price[k, one], metres[k, one] = end + price[known, one], way + metres[known, one]


@inlined
def _worst(scores: NDArray[np.float64], layer: Candidates) -> float:
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
    before: Candidates,
    after: Candidates,
    linked: NDArray[np.int32],
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
    moves: NDArray[np.float64],
    kinds: NDArray[np.uint8],
) -> None:
    """Offer the ways that stay on a directed road, on or a little back, and those that turn round on it."""
    road, here = before.roads[i], before.metres[i]
    j = work.targets[road]
    while j >= 0:
        ahead = after.metres[j] - here
        if -model.backward_tolerance <= ahead <= longest:
            _offer(i, j, abs(ahead - straight) / model.beta, SAME_ROAD, before, after, moves, kinds)
        j = linked[j]
    j = work.targets[road ^ 1]
    while j >= 0:
        metres = abs(graph.lengths[road] - after.metres[j] - here)
        if metres <= longest:
            _offer(
                i,
                j,
                abs(metres - straight) / model.beta + model.u_turn_cost,
                U_TURN,
                before,
                after,
                moves,
                kinds,
            )
        j = linked[j]


@inlined
def _offer(
    i: int,
    j: int,
    price: float,
    kind: int,
    before: Candidates,
    after: Candidates,
    moves: NDArray[np.float64],
    kinds: NDArray[np.uint8],
) -> None:
    """Take a way from candidate i to candidate j where it is cheaper than what is known, or as cheap and of a kind that comes first."""
    if price < moves[i, j] - ROUNDING or (price <= moves[i, j] + ROUNDING and kind < kinds[i, j]):
        kinds[i, j] = kind
    moves[i, j] = min(moves[i, j], price)
    after.path_costs[j] = min(after.path_costs[j], before.path_costs[i] + price)
