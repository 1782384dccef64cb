"""Transitions from one time step to the next: the Viterbi recursion over pairs of candidates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted
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

#: In a list of candidates linked by road: no next one.
_NONE = -1


@inner_uncounted
def max_path_length(straight: float, seconds: float, model: ModelParameters) -> float:
    """Upper bound in metres of the length of a path between two samples.

    A path within reach of the median speed is no detour: between two samples far apart in time, a
    vehicle may have gone round a block.
    """
    return (
        min(
            model.max_speed * seconds,
            max(model.max_detour * straight, model.median_speed * seconds),
        )
        + model.length_tolerance
    )


@inner_uncounted
def is_too_fast(straight: float, seconds: float, model: ModelParameters) -> bool:
    """Whether two samples lie too far apart for the time between them: the path breaks there."""
    return straight > model.max_speed * seconds + model.length_tolerance


@inner
def advance_paths(
    before: Candidates,
    n0: int,
    after: Candidates,
    n1: int,
    goal: NDArray[np.float64],
    straight: float,
    max_length: float,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
    transition_costs: NDArray[np.float64],
) -> None:
    """Find the cheapest path to each candidate of a time step from those of the one before.

    The Viterbi recursion on costs (Newson and Krumm 2009)::

        C_t(j) = min_i [C_(t-1)(i) + a(i, j)] + e(j)

    with the path cost C, the emission cost e, and the transition cost a. A path of x metres over
    roads costs ``a = |x - straight| / beta`` plus its turns; a jump costs ``jump_cost``, half of it
    where one of the two is off the roads, and nothing where both are.

    Of paths that cost the same but for rounding, such as those over the two roads that meet at a
    crossing, the one counts whose candidate before comes first: the nearest to its sample, then by
    the number of its directed road.

    Parameters
    ----------
    before, n0, after, n1
        The two time steps, and their numbers of candidates.
    goal
        The sample of the second time step.
    straight
        Metres between the two samples.
    max_length
        Upper bound in metres of the length of a path.
    transition_costs
        Receives the cost of every pair. Where it was not worth a search, it is that of a jump.
    """
    # Chain the candidates on each directed road, since a search reaches them together.
    linked, distinct = _link_candidates_by_road(after, n1, work)

    # Jumps: the upper bound of all other transitions.
    transitions = np.full((n0, n1), JUMP, np.uint8)
    for j in range(n1):
        after.path_costs[j] = np.inf
    for i in range(n0):
        for j in range(n1):
            ends_on_roads = (before.roads[i] >= 0) + (after.roads[j] >= 0)
            transition_costs[i, j] = 0.5 * model.jump_cost * ends_on_roads
            after.path_costs[j] = min(
                after.path_costs[j], before.path_costs[i] + transition_costs[i, j]
            )

    # On the same road, or turning round on it.
    on_roads = np.flatnonzero(before.roads[:n0] >= 0)
    for i in on_roads:
        _relax_on_same_road(
            i,
            straight,
            max_length,
            before,
            after,
            linked,
            graph,
            model,
            work,
            transition_costs,
            transitions,
        )

    # Over other roads: first bound the costs, then search within the bounds.
    if distinct > 0 and len(on_roads) > 0:
        upper_bounds = _bound_path_costs(
            on_roads,
            straight,
            max_length,
            before,
            after.path_costs[:n1].copy(),
            after,
            linked,
            goal,
            graph,
            model,
            work,
        )
        _relax_over_other_roads(
            on_roads,
            straight,
            max_length,
            before,
            upper_bounds,
            after,
            linked,
            distinct,
            graph,
            model,
            work,
            transition_costs,
            transitions,
        )

    # The first predecessor that is as cheap as the cheapest.
    for j in range(n1):
        if after.roads[j] >= 0:
            work.first_candidate[after.roads[j]] = _NONE
        i = 0
        while before.path_costs[i] + transition_costs[i, j] > after.path_costs[j] + ROUNDING:
            i += 1
        after.predecessors[j] = i
        after.transitions[j] = transitions[i, j]
        after.path_costs[j] += after.emission_costs[j]

    # Only differences matter; subtracting the least keeps their precision on a long track.
    after.path_costs[:n1] -= after.path_costs[:n1].min()


@inner
def _link_candidates_by_road(
    after: Candidates, n: int, work: Workspace
) -> tuple[NDArray[np.int32], int]:
    """Enter candidates in ``work.first_candidate`` by their directed roads.

    Returns the next candidate on the same directed road for each, and the number of distinct roads.
    """
    linked = np.full(n, _NONE, np.int32)
    distinct = 0
    for j in range(n):
        road = after.roads[j]
        if road >= 0:
            distinct += work.first_candidate[road] < 0
            linked[j] = work.first_candidate[road]
            work.first_candidate[road] = j
    return linked, distinct


@inner
def _bound_path_costs(
    on_roads: NDArray[np.int64],
    straight: float,
    max_length: float,
    before: Candidates,
    upper_bounds: NDArray[np.float64],
    after: Candidates,
    linked: NDArray[np.int32],
    goal: NDArray[np.float64],
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> NDArray[np.float64]:
    """Lower the upper bounds of path costs, by one search from all candidates before at once.

    The first path to reach a candidate is a path, so that its cost is an upper bound. It is not
    always the best one, since a path that is shorter than the straight line costs more.
    """
    # Begin at all candidates before, each with the cost of its path.
    cost_bound = straight + model.beta * _max_cost_on_roads(upper_bounds, after)
    start_search(work)
    for i in on_roads:
        road = before.roads[i]
        metres_left = graph.lengths[road] - before.metres[i]
        expand_to_goal(
            road,
            metres_left,
            metres_left + model.beta * before.path_costs[i],
            cost_bound,
            max_length,
            goal,
            model.search_radius,
            graph,
            model,
            work,
        )

    # Lower the bounds road by road. Candidates off the roads count as reached: no path leads there.
    is_reached = np.zeros(len(upper_bounds), np.bool_)
    for j in range(len(upper_bounds)):
        is_reached[j] = after.roads[j] < 0
    while True:
        reached = next_towards_goal(
            cost_bound, max_length, goal, model.search_radius, graph, model, work
        )
        if reached < 0:
            return upper_bounds

        # All candidates on the road that was reached.
        j = work.first_candidate[reached]
        if j < 0:
            continue
        while j >= 0:
            metres = work.metres[reached] + after.metres[j]
            if metres <= max_length:
                cost = (
                    work.costs[reached] - work.metres[reached] + abs(metres - straight)
                ) / model.beta
                upper_bounds[j] = min(upper_bounds[j], cost)
            is_reached[j] = True
            j = linked[j]

        # The search need only go as far as the candidates that are left.
        max_cost = -np.inf
        for k in range(len(upper_bounds)):
            if not is_reached[k]:
                max_cost = max(max_cost, upper_bounds[k])
        cost_bound = straight + model.beta * max_cost


@inner
def _relax_over_other_roads(
    on_roads: NDArray[np.int64],
    straight: float,
    max_length: float,
    before: Candidates,
    upper_bounds: NDArray[np.float64],
    after: Candidates,
    linked: NDArray[np.int32],
    distinct: int,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
    transition_costs: NDArray[np.float64],
    transitions: NDArray[np.uint8],
) -> None:
    """Relax the transitions over other roads that make paths within the bounds, plus the margin.

    Searches share what they find: one that comes to a road from whose end another search began
    does not go on there, but takes over the paths found. Candidates whose paths are cheaper at the
    ends of their roads go first, so that their searches found all that the others need.
    """
    # Backward from all candidates after: what is left to go from any road.
    targets = np.empty(len(upper_bounds), np.int32)
    target_costs = np.empty(len(upper_bounds))
    count = 0
    for j in range(len(upper_bounds)):
        if after.roads[j] >= 0:
            targets[count] = after.roads[j]
            target_costs[count] = after.metres[j] - model.beta * (
                upper_bounds[j] + model.cost_margin + ROUNDING
            )
            count += 1
    metres_left = graph.lengths[before.roads[on_roads]] - before.metres[on_roads]
    end_costs = metres_left + model.beta * before.path_costs[on_roads]
    search_backward(
        before.roads[on_roads],
        targets[:count],
        target_costs[:count],
        straight - model.beta * before.path_costs[on_roads].min(),
        max_length,
        graph,
        model,
        work.backward,
    )

    # Forward from each candidate before; table of paths from the ends of roads: costs and metres.
    costs = np.full((len(on_roads), len(upper_bounds)), np.inf)
    metres = np.empty((len(on_roads), len(upper_bounds)))
    for row in _order(end_costs):
        i = on_roads[row]
        road, cost_bound = before.roads[i], straight - end_costs[row]
        if work.path_rows[road] < 0:
            _search_from_road(
                road,
                row,
                cost_bound,
                max_length,
                linked,
                distinct,
                costs,
                metres,
                graph,
                model,
                work,
            )
            work.path_rows[road] = row

        # Transitions by these paths.
        path_row = work.path_rows[road]
        for j in range(len(upper_bounds)):
            length = metres_left[row] + metres[path_row, j]
            if costs[path_row, j] < np.inf and length + after.metres[j] <= max_length:
                turns = (costs[path_row, j] - metres[path_row, j]) / model.beta
                _relax_transition(
                    i,
                    j,
                    abs(length + after.metres[j] - straight) / model.beta + turns,
                    OTHER_ROADS,
                    before,
                    after,
                    transition_costs,
                    transitions,
                )

    # Leave no marks.
    for i in on_roads:
        work.path_rows[before.roads[i]] = _NONE


@inner
def _order(costs: NDArray[np.float64]) -> NDArray[np.int64]:
    """Indices of costs from the least to the greatest, equal ones in their order: insertion sort.

    NumPy's sort takes a second to compile, and there are some ten candidates.
    """
    order = np.empty(len(costs), np.int64)
    for i in range(len(costs)):
        place = i
        while place > 0 and costs[order[place - 1]] > costs[i]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = i
    return order


@inner_uncounted
def _search_from_road(
    road: int,
    row: int,
    cost_bound: float,
    max_length: float,
    linked: NDArray[np.int32],
    distinct: int,
    costs: NDArray[np.float64],
    metres: NDArray[np.float64],
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> None:
    """Fill a row of the path table: from the end of a directed road to the roads of candidates."""
    # Search from the end of the road, by cost, until all roads with candidates are reached.
    start_search(work)
    expand_to_targets(road, 0.0, 0.0, cost_bound, max_length, graph, model, work)
    reached_count = 0
    while reached_count < distinct:
        reached = next_towards_targets(cost_bound, work)
        if reached < 0:
            break

        # Candidates on the road that was reached.
        j = work.first_candidate[reached]
        reached_count += j >= 0
        while j >= 0:
            if work.costs[reached] < costs[row, j]:
                costs[row, j] = work.costs[reached]
                metres[row, j] = work.metres[reached]
            j = linked[j]

        # Go on from its end, or take over the paths that another search found from there.
        end_cost = work.costs[reached] + graph.lengths[reached]
        end_metres = work.metres[reached] + graph.lengths[reached]
        path_row = work.path_rows[reached]
        if path_row < 0:
            expand_to_targets(
                reached, end_metres, end_cost, cost_bound, max_length, graph, model, work
            )
            continue
        for k in range(costs.shape[1]):
            if end_cost + costs[path_row, k] < costs[row, k]:
                costs[row, k] = end_cost + costs[path_row, k]
                metres[row, k] = end_metres + metres[path_row, k]


@inner_uncounted
def _max_cost_on_roads(costs: NDArray[np.float64], candidates: Candidates) -> float:
    """The highest cost of a candidate on a road."""
    max_cost = -np.inf
    for j in range(len(costs)):
        if candidates.roads[j] >= 0:
            max_cost = max(max_cost, costs[j])
    return max_cost


@inner_uncounted
def _relax_on_same_road(
    i: int,
    straight: float,
    max_length: float,
    before: Candidates,
    after: Candidates,
    linked: NDArray[np.int32],
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
    transition_costs: NDArray[np.float64],
    transitions: NDArray[np.uint8],
) -> None:
    """Relax the transitions of candidate i that stay on its road, or turn round on it."""
    # Onward, or a little back by errors of a standing receiver.
    road, offset = before.roads[i], before.metres[i]
    j = work.first_candidate[road]
    while j >= 0:
        ahead = after.metres[j] - offset
        if -model.backward_tolerance <= ahead <= max_length:
            _relax_transition(
                i,
                j,
                abs(ahead - straight) / model.beta,
                SAME_ROAD,
                before,
                after,
                transition_costs,
                transitions,
            )
        j = linked[j]

    # Back, on the directed road of the other direction.
    j = work.first_candidate[road ^ 1]
    while j >= 0:
        metres = abs(graph.lengths[road] - after.metres[j] - offset)
        if metres <= max_length:
            _relax_transition(
                i,
                j,
                abs(metres - straight) / model.beta + model.u_turn_cost,
                U_TURN,
                before,
                after,
                transition_costs,
                transitions,
            )
        j = linked[j]


@inner_uncounted
def _relax_transition(
    i: int,
    j: int,
    cost: float,
    transition: int,
    before: Candidates,
    after: Candidates,
    transition_costs: NDArray[np.float64],
    transitions: NDArray[np.uint8],
) -> None:
    """Take a transition from i to j if it is cheaper, or as cheap and of a smaller number."""
    if cost < transition_costs[i, j] - ROUNDING or (
        cost <= transition_costs[i, j] + ROUNDING and transition < transitions[i, j]
    ):
        transitions[i, j] = transition
    transition_costs[i, j] = min(transition_costs[i, j], cost)
    after.path_costs[j] = min(after.path_costs[j], before.path_costs[i] + cost)
