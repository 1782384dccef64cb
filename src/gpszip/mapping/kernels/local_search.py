"""Walks polished change by change: each that saves more bits than its error is worth is made, by the coder's real count."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.local_search_bits import FIXED, WORK, Desk, code_all, code_prefix
from gpszip.mapping.kernels.local_search_moves import PROMISE, TRIALS, Offers, Ways, offer_changes
from gpszip.mapping.kernels.local_search_state import BITS, KNOTS, SQUARE, Chain, Samples, copy_chain, is_within, replace_knots

__all__ = ["Calls", "Rule", "decide", "sweep_knots"]

#: Knots coded behind those that may change, and knots whose changes share a prefix.
_TAIL, _CHUNK = 12, 8


#: Bits that a change saves at least.
_LEAST = 1e-6


class Calls(NamedTuple):
    """Kernels that are called but not built in, since those that call them would take long to compile."""

    code: Any  # walk_coder.code_walks
    window: Any  # polish_code.code_window
    decide: Any  # decide, below


class Rule(NamedTuple):
    """What decides about a change."""

    price: float  # bits for a squared error
    most: float  # largest squared error, also on the way
    bound: float  # largest squared error of the best
    maximum: float  # largest distance of a sample, 0 if there is none
    unite: float  # bits of error that uniting two nodes may cost and be coded
    move: float  # the same for moving one
    bounds: NDArray[np.float64]  # largest squared error of each group in the best
    over: float  # what multiple of it is allowed on the way


@jit
def _cost(chain: Chain, rule: Rule) -> float:
    """Bits, and the error at its price."""
    return chain.totals[BITS] + rule.price * chain.totals[SQUARE]


@jit
def _keep_best(chain: Chain, best: Chain, rule: Rule) -> None:
    """Remember the smallest walks within the bound."""
    if chain.totals[SQUARE] <= rule.bound and chain.totals[BITS] < best.totals[BITS]:
        for g in range(len(chain.squares)):
            if chain.squares[g] > rule.bounds[g]:
                return
        copy_chain(chain, best)


@jit
def _strays(chain: Chain, spare: Chain, rule: Rule) -> bool:
    """Whether a change brings a group farther beyond its bound."""
    strays = False
    for g in range(len(chain.squares)):
        strays |= chain.squares[g] > rule.over * rule.bounds[g] and chain.squares[g] > spare.squares[g]
    return strays


@jit
def _is_allowed(samples: Samples, chain: Chain, offers: Offers, rule: Rule, row: int) -> bool:
    """Whether the error stays small enough with an offer."""
    square = chain.totals[SQUARE] + offers.error[row]
    if square > rule.most and offers.error[row] > 0:
        return False
    group = samples.groups[chain.slot[offers.first[row]]]
    if offers.error[row] > 0 and chain.squares[group] + offers.error[row] > rule.over * rule.bounds[group]:
        return False
    if rule.maximum == 0:
        return True
    first, after, count = offers.first[row], offers.after[row], offers.count[row]
    i = first - 1 if first > 0 and (first == after or chain.joined[first]) else -1
    slot, node = (chain.slot[i], chain.node[i]) if i >= 0 else (np.int64(-1), np.int64(-1))
    for k in range(count + 1):
        if k == count and (after >= chain.counts[KNOTS] or not chain.joined[after]):
            break
        to = offers.slots[row, k] if k < count else chain.slot[after]
        into = offers.nodes[row, k] if k < count else chain.node[after]
        if slot >= 0 and not is_within(samples, slot, chain.places[node], to, chain.places[into], rule.maximum):
            return False
        slot, node = to, into
    return True


@jit
def _look_ahead(desk: Desk, chain: Chain, end: int) -> None:
    for v in range(len(desk.later)):
        desk.later[v] = 0
    for i in range(end, chain.counts[KNOTS]):
        desk.later[chain.node[i]] += 1


@jit
def decide(code: Any, desk: Desk, cells: NDArray[np.int64], chain: Chain, spare: Chain, best: Chain, rule: Rule) -> bool:
    """Code walks that were changed; take the change back, from ``spare``, unless it saves."""
    if _strays(chain, spare, rule):
        copy_chain(spare, chain)
        return False
    chain.totals[BITS] = code_all(code, desk, chain, cells)
    if _cost(chain, rule) < _cost(spare, rule) - _LEAST:
        _keep_best(chain, best, rule)
        return True
    copy_chain(spare, chain)
    return False


@jit
def _improve(
    calls: Calls,
    desk: Desk,
    samples: Samples,
    chain: Chain,
    spare: Chain,
    best: Chain,
    offers: Offers,
    rule: Rule,
    start: int,
    end: int,
    base: float,
) -> bool:
    """Code the offers for one knot in a window and make the best change."""
    bits = np.full(offers.filled[0], np.inf)
    for row in range(offers.filled[0]):
        if _is_allowed(samples, chain, offers, rule, row):
            window = calls.window(
                calls.code, desk, chain, samples.cells, start, end, offers.first[row], offers.after[row], offers.count[row],
                offers.slots[row], offers.nodes[row],
            )  # fmt: skip
            bits[row] = window - base + rule.price * offers.error[row]
    for _ in range(np.int64(min(offers.terms[TRIALS], len(bits)))):
        row = np.argmin(bits)
        if bits[row] > -offers.terms[PROMISE]:
            return False
        copy_chain(chain, spare)
        if not replace_knots(
            samples,
            chain,
            desk.counts[FIXED],
            offers.first[row],
            offers.after[row],
            offers.count[row],
            offers.slots[row],
            offers.nodes[row],
        ):
            copy_chain(spare, chain)
        elif calls.decide(calls.code, desk, samples.cells, chain, spare, best, rule):
            return True
        bits[row] = np.inf
    return False


@jit
def sweep_knots(
    calls: Calls, desk: Desk, samples: Samples, ways: Ways, chain: Chain, spare: Chain, best: Chain, offers: Offers, rule: Rule
) -> int:
    """Go once along all walks and change what pays; return how often, ``best`` holds the smallest that was within the bound."""
    taken, start, none = 0, np.int64(0), np.int64(-1)
    while start < chain.counts[KNOTS] and desk.counts[WORK] > 0:
        j = start + 2 if start > 0 else np.int64(0)
        stop = start + 2 + _CHUNK
        code_prefix(calls.code, desk, chain, samples.cells, start + 1 if start > 0 else np.int64(0))
        renewed = True
        end, base = np.int64(0), 0.0
        while j < min(stop, chain.counts[KNOTS]) and desk.counts[WORK] > 0:
            if renewed:
                end = min(stop + _TAIL, chain.counts[KNOTS])
                _look_ahead(desk, chain, end)
                base = calls.window(
                    calls.code, desk, chain, samples.cells, start, end, none, none, np.int64(0), offers.slots[0], offers.nodes[0]
                )
            offer_changes(samples, chain, ways, offers, desk.counts[FIXED], j, rule.price)
            knots = chain.counts[KNOTS]
            renewed = _improve(calls, desk, samples, chain, spare, best, offers, rule, start, end, base)
            if renewed:
                taken += 1
                stop += chain.counts[KNOTS] - knots
            j += 1
        start = max(stop - 2, start + 1)
    return taken
