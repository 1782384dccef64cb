"""Plain twin of the chain of knots: every subset of the slots is tried."""

from itertools import combinations, pairwise
from math import log2

from oracle.moments import free_cost, line_cost, part_samples

TOO_DEAR = 45.0


def chain_cost(log, knots, price, knot_bits, max_slots):
    """Bits of a chain; None if one of its parts is not allowed."""
    total = 0.0
    for a, b in pairwise(knots):
        mine = list(part_samples(log.ends, a, b))
        t, x, w = log.times[mine].astype(float), log.samples[mine], log.weights[mine]
        if b - a > max_slots or (b - a > 1 and price * free_cost(t, x, w) > TOO_DEAR):
            return None
        far = float(abs(log.positions[b] - log.positions[a]).sum())
        total += (
            knot_bits
            + 2 * log2(1 + far)
            + price
            * line_cost(t, x, w, log.positions[a], log.positions[b], log.ticks[a], log.ticks[b])
        )
    return total


def cheapest_chain(log, first, last, price, knot_bits, max_slots):
    inner = range(first + 1, last)
    every = (
        [first, *some, last] for size in range(len(inner) + 1) for some in combinations(inner, size)
    )
    costs = [chain_cost(log, knots, price, knot_bits, max_slots) for knots in every]
    return min(cost for cost in costs if cost is not None)
