"""What may become of a knot and those beside it: the changes that look cheapest, by prices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.grid_moments import span_moments
from gpszip.mapping.kernels.local_search_state import KNOTS, NODES, TEMPORARY, Chain, Samples, error_of

__all__ = ["HOPE", "MOST_OFFERS", "PROMISE", "TRIALS", "Offers", "Ways", "offer_changes"]

#: Numbers kept in ``Offers.terms``: bits that an offer may look dearer than what is there, how many are coded in full, and the bits of a
#: window that these must promise.
HOPE, TRIALS, PROMISE = 0, 1, 2

#: Offers kept for a knot.
MOST_OFFERS = 32

#: Bits that a knot, a new way and a new node cost about.
_KNOT, _LINK, _PLACE = 5.0, 5.0, 10.0

#: Slots by which a knot may move at once, and slots that are tried for one between two others.
_SHIFT, _TRIES = 2, 8


class Ways(NamedTuple):
    """The ways between nodes that were known before, both directions, those of node v from ``offsets[v]`` on."""

    offsets: NDArray[np.int64]
    into: NDArray[np.int64]


class Offers(NamedTuple):
    """Changes: knots from ``first`` to before ``after`` become ``count`` others."""

    first: NDArray[np.int64]
    after: NDArray[np.int64]
    count: NDArray[np.int64]
    slots: NDArray[np.int64]
    nodes: NDArray[np.int64]
    error: NDArray[np.float64]  # squared error that is added
    score: NDArray[np.float64]  # bits and price of the error that are added, about
    filled: NDArray[np.int64]
    beside: NDArray[np.int8]  # by node: whether a way leads to the knot before (1) or after (2)
    right: NDArray[np.float64]  # room for one place
    terms: NDArray[np.float64]


@jit
def _offer(offers: Offers, first: int, after: int, count: int, error: float, score: float) -> int:
    """Row for an offer, or -1 if it is worse than all those kept."""
    if score >= offers.terms[HOPE]:
        return -1
    row = offers.filled[0]
    if row == MOST_OFFERS:
        row = np.int64(0)
        for other in range(MOST_OFFERS):
            if offers.score[other] > offers.score[row]:
                row = other
        if offers.score[row] <= score:
            return -1
    else:
        offers.filled[0] += 1
    offers.first[row], offers.after[row], offers.count[row] = first, after, count
    offers.error[row], offers.score[row] = error, score
    return row


@jit
def _mark_ways(chain: Chain, ways: Ways, offers: Offers, first: int, after: int, left: int, right: int) -> None:
    """Note which nodes have a way to the nodes ``left`` and ``right`` besides those of the knots that are to change."""
    beside = offers.beside
    for v in range(len(beside)):
        beside[v] = 0
    for i in range(1, chain.counts[KNOTS]):
        if chain.joined[i] and (i < first or i > after):
            u, v = chain.node[i - 1], chain.node[i]
            if u == left:
                beside[v] |= 1
            elif v == left:
                beside[u] |= 1
            if u == right:
                beside[v] |= 2
            elif v == right:
                beside[u] |= 2
    for side in range(2):
        node = left if side == 0 else right
        if 0 <= node < len(ways.offsets) - 1:
            for h in range(ways.offsets[node], ways.offsets[node + 1]):
                beside[ways.into[h]] |= 1 + side


@jit
def _link_bits(offers: Offers, node: int, left: int, right: int) -> float:
    bits = 0.0
    if left >= 0 and (offers.beside[node] & 1) == 0:
        bits += _LINK
    if right >= 0 and (offers.beside[node] & 2) == 0:
        bits += _LINK
    return bits


@jit
def _bowl(
    samples: Samples, chain: Chain, before: int, slot: int, behind: int, center: NDArray[np.int64], right: NDArray[np.float64]
) -> tuple[float, float]:
    """Stiffness K and rest r0 of the squared error K|x|^2 - 2 x.right + r0 of the parts from knot ``before`` to a slot and on.

    x is relative to ``center``; a knot of -1 stands for none.
    """
    dimension = len(right)
    m, n = np.empty(dimension), np.empty(dimension)
    stiffness, rest = 0.0, 0.0
    for axis in range(dimension):
        right[axis] = 0.0
    if before >= 0:
        a = chain.slot[before]
        w, u1, u2, q = span_moments(samples.sums, a, slot, samples.ticks[a], samples.ticks[slot], center, samples.unit, m, n)
        stiffness += u2
        rest += q
        for axis in range(dimension):
            x = chain.places[chain.node[before], axis] - center[axis] / samples.unit
            right[axis] += n[axis] - (u1 - u2) * x
            rest += (w - 2.0 * u1 + u2) * x * x - 2.0 * x * (m[axis] - n[axis])
    if behind >= 0:
        b = chain.slot[behind]
        w, u1, u2, q = span_moments(samples.sums, slot, b, samples.ticks[slot], samples.ticks[b], center, samples.unit, m, n)
        stiffness += w - 2.0 * u1 + u2
        rest += q
        for axis in range(dimension):
            x = chain.places[chain.node[behind], axis] - center[axis] / samples.unit
            right[axis] += m[axis] - n[axis] - (u1 - u2) * x
            rest += u2 * x * x - 2.0 * x * n[axis]
    return stiffness, rest


@jit
def _offer_place(
    samples: Samples,
    chain: Chain,
    offers: Offers,
    first: int,
    after: int,
    slot: int,
    center: NDArray[np.int64],
    bowl: tuple[float, float],
    step: int,
    price: float,
    old: float,
    bits: float,
) -> None:
    """Offer one knot with a node of its own at the whole place of least error, or ``step`` (1, 2.. up, -1, -2.. down an axis) beside."""
    dimension = len(offers.right)
    stiffness, rest = bowl
    if stiffness < 1e-9:
        return
    place = np.empty(dimension)
    error = rest - old
    for axis in range(dimension):
        middle = center[axis] / samples.unit
        place[axis] = np.rint(offers.right[axis] / stiffness + middle)
        if abs(step) == axis + 1:
            place[axis] += 1.0 if step > 0 else -1.0
        x = place[axis] - middle
        error += stiffness * x * x - 2.0 * x * offers.right[axis]
    row = _offer(offers, first, after, 1, error, price * error + bits)
    if row >= 0:
        node = len(chain.places) - TEMPORARY + row
        chain.places[node] = place
        offers.slots[row, 0], offers.nodes[row, 0] = slot, node


@jit
def _offer_one(
    samples: Samples,
    chain: Chain,
    ways: Ways,
    offers: Offers,
    fixed: int,
    first: int,
    after: int,
    low: int,
    high: int,
    stride: int,
    price: float,
) -> None:
    """Offer a single knot in place of those from ``first`` to before ``after``, at every ``stride``-th slot from low to high."""
    behind = after if after < chain.counts[KNOTS] and chain.joined[after] else -1
    before = first - 1 if first == after or chain.joined[first] else -1
    left = chain.node[before] if before >= 0 else -1
    right = chain.node[behind] if behind >= 0 else -1
    _mark_ways(chain, ways, offers, first, after, left, right)
    old, bits = 0.0, 0.0
    for i in range(first, after):
        old += chain.error[i]
        v = chain.node[i]
        chain.uses[v] -= 1
        bits -= _KNOT + _link_bits(offers, v, left, right if i == after - 1 else -1)
        if chain.uses[v] == 0 and v >= fixed:
            bits -= _PLACE
    if behind >= 0:
        old += chain.error[behind]
    bits += _KNOT
    links = (_LINK if left >= 0 else 0.0) + (0.5 * _LINK if right >= 0 else 0.0)
    for slot in range(low, high + 1, stride):
        center = samples.centers[slot]
        bowl = _bowl(samples, chain, before, slot, behind, center, offers.right)
        lowest = bowl[1] - old
        for axis in range(len(center)):
            lowest -= offers.right[axis] * offers.right[axis] / max(bowl[0], 1e-9)
        if price * lowest + bits >= offers.terms[HOPE]:
            continue
        for v in range(chain.counts[NODES]):
            if chain.uses[v] == 0 and v >= fixed:
                continue
            if after == first + 1 and slot == chain.slot[first] and v == chain.node[first]:
                continue
            error = bowl[1] - old
            for axis in range(len(center)):
                x = chain.places[v, axis] - center[axis] / samples.unit
                error += bowl[0] * x * x - 2.0 * x * offers.right[axis]
            score = price * error + bits
            if score < offers.terms[HOPE]:
                score += _link_bits(offers, v, left, right)
                row = _offer(offers, first, after, 1, error, score)
                if row >= 0:
                    offers.slots[row, 0], offers.nodes[row, 0] = slot, v
        _offer_place(samples, chain, offers, first, after, slot, center, bowl, np.int64(0), price, old, bits + _PLACE + links)
        if after == first + 1 and chain.uses[chain.node[first]] == 0 and slot == chain.slot[first]:
            for axis in range(len(center)):
                _offer_place(samples, chain, offers, first, after, slot, center, bowl, axis + 1, price, old, bits + _PLACE + links)
                _offer_place(samples, chain, offers, first, after, slot, center, bowl, -axis - 1, price, old, bits + _PLACE + links)
    for i in range(first, after):
        chain.uses[chain.node[i]] += 1


@jit
def _inner(chain: Chain, j: int) -> bool:
    """Whether a knot lies inside a piece."""
    return 0 < j < chain.counts[KNOTS] - 1 and chain.joined[j] == 1 and chain.joined[j + 1] == 1


@jit
def _offer_removal(samples: Samples, chain: Chain, offers: Offers, fixed: int, j: int, price: float) -> None:
    """Offer to leave out a knot, and to move those beside it by up to one slot then."""
    a, b = j - 1, j + 1
    u, v = chain.node[a], chain.node[b]
    back, forth = 1 if _inner(chain, a) else 0, 1 if _inner(chain, b) else 0
    bits = -_KNOT - (_PLACE if chain.uses[chain.node[j]] == 1 and chain.node[j] >= fixed else 0.0)
    for p in range(-back, back + 1):
        at = chain.slot[a] + p
        if p != 0 and at <= chain.slot[a - 1]:
            continue
        lead = (
            error_of(samples, chain.slot[a - 1], chain.places[chain.node[a - 1]], at, chain.places[u]) - chain.error[a] if p != 0 else 0.0
        )
        for q in range(-forth, forth + 1):
            to = chain.slot[b] + q
            if to <= at or (q != 0 and to >= chain.slot[b + 1]):
                continue
            tail = (
                error_of(samples, to, chain.places[v], chain.slot[b + 1], chain.places[chain.node[b + 1]]) - chain.error[b + 1]
                if q != 0
                else 0.0
            )
            error = lead + tail + error_of(samples, at, chain.places[u], to, chain.places[v]) - chain.error[j] - chain.error[b]
            row = _offer(offers, a, b + 1, 2, error, price * error + bits)
            if row >= 0:
                offers.slots[row, 0], offers.slots[row, 1] = at, to
                offers.nodes[row, 0], offers.nodes[row, 1] = u, v


@jit
def offer_changes(samples: Samples, chain: Chain, ways: Ways, offers: Offers, fixed: int, j: int, price: float) -> None:
    """List what may become of knot j: moved, given another node, left out, made one with the next, or followed by another."""
    offers.filled[0] = 0
    knots = chain.counts[KNOTS]
    here = chain.slot[j]
    inner = _inner(chain, j)
    low = max(here - _SHIFT, chain.slot[j - 1] + 1) if inner else here
    high = min(here + _SHIFT, chain.slot[j + 1] - 1) if inner else here
    _offer_one(samples, chain, ways, offers, fixed, j, j + 1, low, high, np.int64(1), price)
    if inner:
        _offer_removal(samples, chain, offers, fixed, j, price)
    if inner and _inner(chain, j + 1):
        low, high = chain.slot[j - 1] + 1, chain.slot[j + 2] - 1
        _offer_one(samples, chain, ways, offers, fixed, j, j + 2, low, high, (high - low) // _TRIES + 1, price)
    if j + 1 < knots and chain.joined[j + 1] and price * chain.error[j + 1] > _KNOT - offers.terms[HOPE]:
        low, high = here + 1, chain.slot[j + 1] - 1
        if low <= high:
            _offer_one(samples, chain, ways, offers, fixed, j + 1, j + 1, low, high, (high - low) // _TRIES + 1, price)
