"""Whole nodes polished: united with another one, or moved by one quantum, by the coder's real count."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.local_search import Calls, Rule
from gpszip.mapping.kernels.local_search_bits import FIXED, WORK, Desk
from gpszip.mapping.kernels.local_search_state import KNOTS, NODES, SQUARE, Chain, Samples, copy_chain, error_of, is_within, renew

__all__ = ["sweep_nodes"]


#: Nodes with which one is tried to be united.
_PARTNERS = 6


@jit
def _error_at(samples: Samples, chain: Chain, node: int, place: NDArray[np.float64], knots: NDArray[np.int64], count: int) -> float:
    """Squared error that is added when a node, at the knots listed, lies at a place."""
    added = 0.0
    for k in range(count):
        i = knots[k]
        for j in range(i, min(i + 2, chain.counts[KNOTS])):
            # a part from the node to itself is met twice
            if chain.joined[j] and not (j == i + 1 and chain.node[j] == node):
                u, v = chain.node[j - 1], chain.node[j]
                start = place if u == node else chain.places[u]
                end = place if v == node else chain.places[v]
                error = error_of(samples, chain.slot[j - 1], start, chain.slot[j], end)
                added += error - chain.error[j]
    return added


@jit
def _keeps_maximum(
    samples: Samples, chain: Chain, node: int, place: NDArray[np.float64], knots: NDArray[np.int64], count: int, maximum: float
) -> bool:
    for k in range(count):
        i = knots[k]
        for j in range(i, min(i + 2, chain.counts[KNOTS])):
            if chain.joined[j]:
                u, v = chain.node[j - 1], chain.node[j]
                start = place if u == node else chain.places[u]
                end = place if v == node else chain.places[v]
                if not is_within(samples, chain.slot[j - 1], start, chain.slot[j], end, maximum):
                    return False
    return True


@jit
def _try(
    calls: Calls,
    desk: Desk,
    samples: Samples,
    chain: Chain,
    spare: Chain,
    best: Chain,
    rule: Rule,
    node: int,
    into: int,
    place: NDArray[np.float64],
    knots: NDArray[np.int64],
    count: int,
) -> bool:
    """Put a node's knots at a place, that of the node ``into`` or, if that is the node itself, another one; undo it if it costs."""
    if rule.maximum > 0 and not _keeps_maximum(samples, chain, node, place, knots, count, rule.maximum):
        return False
    copy_chain(chain, spare)
    if into == node:
        chain.places[node] = place
    else:
        for k in range(count):
            chain.node[knots[k]] = into
        chain.uses[into] += chain.uses[node]
        chain.uses[node] = 0
    for k in range(count):
        renew(samples, chain, knots[k], knots[k] + 1)
    return bool(calls.decide(calls.code, desk, samples.cells, chain, spare, best, rule))


@jit
def _partners(
    samples: Samples, chain: Chain, rule: Rule, fixed: int, node: int, knots: NDArray[np.int64], count: int, found: NDArray[np.int64]
) -> int:
    """The nodes with which a node may be united at the least error, and how many they are."""
    added = np.empty(len(found))
    filled = 0
    for w in range(chain.counts[NODES]):
        if w == node or (chain.uses[w] == 0 and w >= fixed):
            continue
        error = _error_at(samples, chain, node, chain.places[w], knots, count)
        if rule.price * error > rule.unite or chain.totals[SQUARE] + error > rule.most:
            continue
        i = filled
        while i > 0 and added[i - 1] > error:
            i -= 1
        if i < len(found):
            for k in range(min(filled, len(found) - 1), i, -1):
                found[k], added[k] = found[k - 1], added[k - 1]
            found[i], added[i] = w, error
            filled = min(filled + 1, len(found))
    return filled


@jit
def _shift(
    calls: Calls,
    desk: Desk,
    samples: Samples,
    chain: Chain,
    spare: Chain,
    best: Chain,
    rule: Rule,
    node: int,
    knots: NDArray[np.int64],
    count: int,
) -> int:
    """Move a node by one quantum along each axis while that pays; return how often."""
    taken = 0
    for axis in range(chain.places.shape[1]):
        for step in (-1.0, 1.0):
            place = chain.places[node].copy()
            place[axis] += step
            error = _error_at(samples, chain, node, place, knots, count)
            if rule.price * error < rule.move and (chain.totals[SQUARE] + error <= rule.most or error < 0):
                taken += _try(calls, desk, samples, chain, spare, best, rule, node, node, place, knots, count)
    return taken


@jit
def sweep_nodes(calls: Calls, desk: Desk, samples: Samples, chain: Chain, spare: Chain, best: Chain, rule: Rule) -> int:
    """Go once over all nodes, unite and move what pays; return how often."""
    taken = 0
    fixed = desk.counts[FIXED]
    knots = np.empty(len(chain.node), np.int64)
    found = np.empty(_PARTNERS, np.int64)
    for node in range(chain.counts[NODES]):
        if chain.uses[node] == 0 or desk.counts[WORK] <= 0:
            continue
        count = np.int64(0)
        for i in range(chain.counts[KNOTS]):
            if chain.node[i] == node:
                knots[count] = i
                count += 1
        united = False
        for k in range(_partners(samples, chain, rule, fixed, node, knots, count, found)):
            w = found[k]
            if _try(calls, desk, samples, chain, spare, best, rule, node, w, chain.places[w].copy(), knots, count):
                united = True
                break
        if united:
            taken += 1
        elif node >= fixed:
            taken += _shift(calls, desk, samples, chain, spare, best, rule, node, knots, count)
    return taken
