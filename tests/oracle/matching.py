"""Map matching by exhaustion: all candidates, all pairs of them, all shortest paths."""

import heapq
import math
from typing import NamedTuple

import numpy as np


class DirectedRoads:
    """A network as directed roads: 2e is road e from its start to its end, 2e + 1 back."""

    def __init__(self, network):
        roads = range(len(network))
        self.lines = [network.road(e)[::step] for e in roads for step in (1, -1)]
        self.lengths = [
            float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in self.lines
        ]
        self.is_open = np.stack((network.forward, network.backward), 1).ravel().tolist()
        self.tails = np.stack((network.starts, network.ends), 1).ravel().tolist()
        self.heads = np.stack((network.ends, network.starts), 1).ravel().tolist()
        self.leaving = {
            node: [a for a, tail in enumerate(self.tails) if tail == node and self.is_open[a]]
            for node in range(len(network.nodes))
        }

    def direction(self, a):
        """Unit vector at the beginning of directed road a."""
        step = self.lines[a][1] - self.lines[a][0]
        return step / np.linalg.norm(step)

    def cosine(self, a, metres, heading):
        """Cosine between a heading and directed road a, just behind a distance along it."""
        if heading is None:
            return 0.0
        steps = np.diff(self.lines[a], axis=0)
        ends = np.cumsum(np.linalg.norm(steps, axis=1))
        step = steps[min(int((ends <= metres + 1e-6).sum()), len(steps) - 1)]
        return float(heading @ step) / float(np.linalg.norm(step))

    def turn_cost(self, a, b, model):
        if b == a ^ 1:
            return model.u_turn_cost
        if len(self.leaving[self.heads[a]]) <= 2:
            return 0.0
        return 0.5 * model.turn_cost * (1 + float(self.direction(a ^ 1) @ self.direction(b)))

    def paths_from(self, a, metres_left, model):
        """(metres, turns) to the beginning of every directed road, by Dijkstra's algorithm.

        Paths begin ``metres_left`` before the end of directed road a.
        """
        queue = []
        for b in self.leaving[self.heads[a]]:
            turns = self.turn_cost(a, b, model)
            queue.append((metres_left + model.beta * turns, b, metres_left, turns))
        heapq.heapify(queue)
        paths = {}
        while queue:
            _, b, metres, turns = heapq.heappop(queue)
            if b in paths:
                continue
            paths[b] = (metres, turns)
            for c in self.leaving[self.heads[b]]:
                next_metres = metres + self.lengths[b]
                next_turns = turns + self.turn_cost(b, c, model)
                cost = next_metres + model.beta * next_turns
                heapq.heappush(queue, (cost, c, next_metres, next_turns))
        return paths


class Candidate(NamedTuple):
    """Directed road (-1 off the roads), metres on it, and emission cost."""

    road: int
    metres: float
    cost: float


def find_candidates(roads, position, model, heading=None):
    """Candidates of a time step, the last one off the roads; ``heading`` is a vector or None."""
    # nearest point of each line segment
    hits = []
    for e in range(0, len(roads.lines), 2):
        along = 0.0
        for p, q in zip(roads.lines[e][:-1], roads.lines[e][1:], strict=True):
            step = q - p
            fraction = (
                min(max(float(step @ (position - p)) / float(step @ step), 0.0), 1.0)
                if step.any()
                else 0.0
            )
            distance = float(np.linalg.norm(position - p - fraction * step))
            if distance <= model.search_radius:
                hits.append((distance, e, along + fraction * float(np.linalg.norm(step))))
            along += float(np.linalg.norm(step))

    # the nearest positions that are not near a nearer one on the same road
    nearest = []
    for distance, e, offset in sorted(hits):
        is_known = any(
            e == other and abs(offset - other_offset) <= model.search_radius
            for _, other, other_offset in nearest
        )
        if len(nearest) < model.max_candidates and not is_known:
            nearest.append((distance, e, offset))

    # both directions
    def heading_cost(cosine):
        return 0.0 if heading is None else math.log(1 + model.heading_weight * (1 - cosine))

    candidates = []
    for distance, e, offset in nearest:
        cosine = roads.cosine(e, offset, heading)
        distance_cost = 0.5 * (distance / model.sigma) ** 2
        if roads.is_open[e]:
            candidates.append(Candidate(e, offset, distance_cost + heading_cost(cosine)))
        if roads.is_open[e ^ 1]:
            metres = roads.lengths[e] - offset
            candidates.append(Candidate(e ^ 1, metres, distance_cost + heading_cost(-cosine)))
    return [*candidates, Candidate(-1, 0.0, model.off_road_cost + heading_cost(0.0))]


def transition_cost(roads, paths, first, second, straight, max_length, model):
    """Cost from one candidate to another; ``paths`` are those from the first."""
    (a, u, _), (b, v, _) = first, second
    if a < 0 or b < 0:
        return 0.5 * model.jump_cost * ((a >= 0) + (b >= 0))
    costs = [model.jump_cost]
    if a == b and -model.backward_tolerance <= v - u <= max_length:
        costs.append(abs(v - u - straight) / model.beta)
    if a == b ^ 1 and abs(roads.lengths[a] - v - u) <= max_length:
        metres = abs(roads.lengths[a] - v - u)
        costs.append(abs(metres - straight) / model.beta + model.u_turn_cost)
    if b in paths and paths[b][0] + v <= max_length:
        metres, turns = paths[b][0] + v, paths[b][1]
        costs.append(abs(metres - straight) / model.beta + turns)
    return min(costs)


def first_minimum(costs):
    """Index of the first cost that is the least but for rounding."""
    return next(i for i, cost in enumerate(costs) if cost <= min(costs) + 1e-9)


class Trellis:
    """All candidates and transition costs of a track."""

    def __init__(self, network, positions, times, model, headings=None):
        roads = DirectedRoads(network)
        self.steps = [
            find_candidates(roads, position, model, heading)
            for position, heading in zip(
                positions, headings or [None] * len(positions), strict=True
            )
        ]
        self.costs = [
            self._costs_between(roads, k, positions, times, model) for k in range(1, len(positions))
        ]

    def _costs_between(self, roads, k, positions, times, model):
        """Costs from each candidate of time step k - 1 to each of time step k."""
        before, after = self.steps[k - 1], self.steps[k]
        straight = float(np.linalg.norm(positions[k] - positions[k - 1]))
        seconds = times[k] - times[k - 1]
        if straight > model.max_speed * seconds + model.length_tolerance:
            return [[0.0] * len(after) for _ in before]  # a break: another track begins
        allowed = max(model.max_detour * straight, model.median_speed * seconds)
        max_length = min(model.max_speed * seconds, allowed) + model.length_tolerance
        table = []
        for first in before:
            paths = {}
            if first.road >= 0:
                metres_left = roads.lengths[first.road] - first.metres
                paths = roads.paths_from(first.road, metres_left, model)
            table.append(
                [
                    transition_cost(roads, paths, first, second, straight, max_length, model)
                    for second in after
                ]
            )
        return table

    def cheapest_path(self):
        """Cost of the cheapest path, and its candidates."""
        cost, predecessors = [candidate.cost for candidate in self.steps[0]], []
        for k, table in enumerate(self.costs, 1):
            best = [
                first_minimum([cost[i] + table[i][j] for i in range(len(cost))])
                for j in range(len(self.steps[k]))
            ]
            cost = [cost[i] + table[i][j] + self.steps[k][j].cost for j, i in enumerate(best)]
            predecessors.append(best)
        path = [first_minimum(cost)]
        for best in predecessors[::-1]:
            path.append(best[path[-1]])
        return min(cost), [step[j] for step, j in zip(self.steps, path[::-1], strict=True)]

    def cost_of(self, roads):
        """Least cost of a path over given directed roads, one for each time step."""
        costs = {j: c.cost for j, c in enumerate(self.steps[0]) if c.road == roads[0]}
        for k in range(1, len(roads)):
            table = self.costs[k - 1]
            costs = {
                j: min(cost + table[i][j] for i, cost in costs.items()) + candidate.cost
                for j, candidate in enumerate(self.steps[k])
                if candidate.road == roads[k]
            }
        return min(costs.values(), default=math.inf)
