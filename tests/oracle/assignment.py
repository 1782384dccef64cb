"""Plain twin of the E-step on one window: every choice of slots and nodes is priced."""

from collections import Counter
from itertools import pairwise
from math import inf, log2

from oracle.moments import best_line_cost, line_cost, segment_samples

MAX_LINE_BITS = 200.0
NEW_NODE = -2


class Window:
    """Slots ``first`` to the last of a log.

    ``others`` are the walks that stay, and ``kept`` the nodes of the walk up to slot ``first``, as
    lists of nodes. ``own`` is the present node of each slot.
    """

    def __init__(self, log, nodes, others, kept, own, first, prices, max_near, reach, max_slots):
        self.log, self.nodes, self.first, self.last = log, nodes, first, len(log.ticks) - 1
        self.prices, self.max_near = prices, max_near
        self.reach, self.max_slots = reach, max_slots
        self.own = own
        self.uses = Counter(node for walk in [*others, kept] for node in walk)
        self.steps = Counter(step for walk in [*others, kept] for step in pairwise(walk))
        self.is_open = not kept
        self.segment_bits_by_knots = {}

    def candidates(self, slot):
        """Nodes that a slot may take."""
        if slot == self.first and not self.is_open:
            return [self.own[slot]]
        squares = sorted(
            (float(((position - self.log.positions[slot]) ** 2).sum()), node)
            for node, position in enumerate(self.nodes)
        )
        near = [node for square, node in squares if square <= self.reach**2][: self.max_near]
        present = [node for node in [self.own[slot]] if node >= 0 and node not in near]
        return [*near, *present, NEW_NODE]

    def outgoing_weight(self, u):
        """Weight of all steps from a node; a step against the direction of travel weighs half."""
        return sum(n * ((a == u) + 0.5 * (b == u)) for (a, b), n in self.steps.items() if a != b)

    def step_price(self, u, v):
        """Bits of a step, beside its duration."""
        prices = self.prices
        if u == v != NEW_NODE:
            return prices.stay + prices.stay_duration - prices.duration
        if not self.uses[v]:
            return prices.new_node + prices.position
        weight = self.steps[u, v] + 0.5 * self.steps[v, u]
        if not self.uses[u] or weight <= 0:
            return prices.new_edge
        return min(log2((self.outgoing_weight(u) + 1) / weight) + prices.escape, prices.new_edge)

    def position(self, slot, node):
        return self.log.positions[slot] if node == NEW_NODE else self.nodes[node]

    def segment_bits(self, a, u, b, v):
        """Bits of a segment from node u at slot a to node v at slot b."""
        key = a, u, b, v
        if key not in self.segment_bits_by_knots:
            log, prices = self.log, self.prices
            inside = list(segment_samples(log.ends, a, b))
            t, x, w = log.times[inside].astype(float), log.samples[inside], log.weights[inside]
            line_bits = prices.error * best_line_cost(t, x, w)
            is_allowed = b - a == 1 or (b - a <= self.max_slots and line_bits <= MAX_LINE_BITS)

            start, end = self.position(a, u), self.position(b, v)
            error = line_cost(t, x, w, start, end, log.ticks[a], log.ticks[b])
            bits = prices.duration + self.step_price(u, v) + prices.error * error
            self.segment_bits_by_knots[key] = bits if is_allowed else inf
        return self.segment_bits_by_knots[key]

    def cost(self, path):
        """Bits of a list of (slot, node)."""
        (_, first_node), start_bits = path[0], 0.0
        if self.is_open and not self.uses[first_node]:
            start_bits = self.prices.start + self.prices.position
        return start_bits + sum(self.segment_bits(*a, *b) for a, b in pairwise(path))

    def cheapest(self):
        """Least bits of all paths from the first to the last slot."""
        best = inf

        def extend(path):
            nonlocal best
            slot = path[-1][0]
            if slot == self.last:
                best = min(best, self.cost(path))
                return
            for next_slot in range(slot + 1, self.last + 1):
                for node in self.candidates(next_slot):
                    extend([*path, (next_slot, node)])

        for node in self.candidates(self.first):
            extend([(self.first, node)])
        return best
