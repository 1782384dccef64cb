"""Plain twin of the E-step on one window: every choice of slots and nodes is priced."""

from collections import Counter
from itertools import pairwise
from math import inf, log2

from oracle.moments import free_cost, line_cost, part_samples

TOO_DEAR = 200.0
FRESH = -2


class Window:
    """Slots ``first`` to the last of a log; ``others`` are the walks that stay, as lists of nodes."""

    def __init__(self, log, nodes, others, kept, own, first, prices, most, reach, max_slots):
        self.log, self.nodes, self.first, self.last = log, nodes, first, len(log.ticks) - 1
        self.prices, self.most, self.reach, self.max_slots = prices, most, reach, max_slots
        self.own = own
        self.uses = Counter(node for walk in [*others, kept] for node in walk)
        self.steps = Counter(step for walk in [*others, kept] for step in pairwise(walk))
        self.is_open = not kept
        self.squares = {}

    def candidates(self, slot):
        if slot == self.first and not self.is_open:
            return [self.own[slot]]
        away = sorted(
            (float(((place - self.log.positions[slot]) ** 2).sum()), node)
            for node, place in enumerate(self.nodes)
        )
        near = [node for square, node in away if square <= self.reach**2][: self.most]
        return (
            near + [node for node in [self.own[slot]] if node >= 0 and node not in near] + [FRESH]
        )

    def leaving(self, u):
        return sum(n * ((a == u) + 0.5 * (b == u)) for (a, b), n in self.steps.items() if a != b)

    def step_price(self, u, v):
        price = self.prices
        if u == v != FRESH:
            return price["stay"] + price["stay time"] - price["time"]
        if not self.uses[v]:
            return price["new"] + price["place"]
        weight = self.steps[u, v] + 0.5 * self.steps[v, u]
        if not self.uses[u] or weight <= 0:
            return price["link"]
        return min(log2((self.leaving(u) + 1) / weight) + price["escape"], price["link"])

    def place(self, slot, node):
        return self.log.positions[slot] if node == FRESH else self.nodes[node]

    def part_bits(self, a, u, b, v):
        key = a, u, b, v
        if key not in self.squares:
            mine = list(part_samples(self.log.ends, a, b))
            t, x, w = (
                self.log.times[mine].astype(float),
                self.log.samples[mine],
                self.log.weights[mine],
            )
            square = line_cost(
                t, x, w, self.place(a, u), self.place(b, v), self.log.ticks[a], self.log.ticks[b]
            )
            allowed = b - a == 1 or (
                b - a <= self.max_slots and self.prices["error"] * free_cost(t, x, w) <= TOO_DEAR
            )
            bits = self.prices["time"] + self.step_price(u, v) + self.prices["error"] * square
            self.squares[key] = bits if allowed else inf
        return self.squares[key]

    def cost(self, path):
        """Bits of a list of (slot, node)."""
        (_, u), lone = path[0], 0.0
        if self.is_open and not self.uses[u]:
            lone = self.prices["jump"] + self.prices["place"]
        return lone + sum(self.part_bits(*one, *other) for one, other in pairwise(path))

    def cheapest(self):
        best = inf

        def go(path):
            nonlocal best
            slot = path[-1][0]
            if slot == self.last:
                best = min(best, self.cost(path))
                return
            for following in range(slot + 1, self.last + 1):
                for node in self.candidates(following):
                    go([*path, (following, node)])

        for node in self.candidates(self.first):
            go([(self.first, node)])
        return best
