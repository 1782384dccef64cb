"""Plain twin of the private chain of knots: every subset of the slots is tried."""

from itertools import combinations, pairwise
from math import log2

from oracle.moments import best_line_cost, line_cost, segment_samples

MAX_LINE_BITS = 45.0


def chain_cost(log, knots, price, knot_bits, max_slots):
    """Bits of a chain; None if one of its segments is not allowed."""
    total = 0.0
    for a, b in pairwise(knots):
        inside = list(segment_samples(log.ends, a, b))
        t, x, w = log.times[inside].astype(float), log.samples[inside], log.weights[inside]
        line_bits = price * best_line_cost(t, x, w)
        if b - a > max_slots or (b - a > 1 and line_bits > MAX_LINE_BITS):
            return None

        length = float(abs(log.positions[b] - log.positions[a]).sum())
        error = line_cost(t, x, w, log.positions[a], log.positions[b], log.ticks[a], log.ticks[b])
        total += knot_bits + 2 * log2(1 + length) + price * error
    return total


def cheapest_chain(log, first, last, price, knot_bits, max_slots):
    """Least bits of all chains from the first to the last slot."""
    inner = range(first + 1, last)
    chains = (
        [first, *subset, last]
        for size in range(len(inner) + 1)
        for subset in combinations(inner, size)
    )
    costs = [chain_cost(log, knots, price, knot_bits, max_slots) for knots in chains]
    return min(cost for cost in costs if cost is not None)
