"""The connected map: parts end in nodes that walks share, found by description length.

One objective decides everything: J = bits + price x squared error. Each round moves knots and relabels them window by window
(E-step), places all nodes by one sparse solve (M-step) and merges nodes where that saves bits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from gpszip.coding.past import Past
from gpszip.coding.walks import encode_with_ledger
from gpszip.kernels.chain import settle_chains
from gpszip.kernels.draft import enter_nodes, keep_disjoint, lead_clusters
from gpszip.kernels.walk_model import ACCOUNTS, KIND_BITS, PLACE_BITS, SPAN_BITS
from gpszip.mapping.drafting import (
    empty_draft,
    free_equations,
    list_parts,
    normal_equations,
    place_nodes,
    round_nodes,
    sample_errors,
    squared_error,
    walks_of,
)
from gpszip.mapping.settling import compact, cut_pieces, settle
from gpszip.mapping.slots import Slots, carry_knots, pick_slots, slots_near, weigh_samples
from gpszip.model import Executor, LatticeWalks
from gpszip.model.executor import local

__all__ = ["Outcome", "Plan", "fit", "place", "prices_of", "realise", "rounded_places", "settle", "unite"]

#: Steps of the walks' kinds in the coder's ledger.
_BACK, _KNOWN, _LINK, _NEW, _STAY = range(5)
#: Power of the error's excess by which the price rises after the first miss.
_PUSH = 2.5
#: Share of it below which the price falls harder each round, too.
_SLACK = 0.99
#: Share of the error allowed that is to be made use of.
_FULL = 0.992
#: Share of the last round's error above which it hardly falls.
_STUCK = 0.98
#: Every so many rounds the price falls by this factor: walks that need fewer knots leave a local optimum behind.
_KICK_EVERY, _KICK = 6, 0.6
#: A maximum: share of it beyond which a sample pulls harder, the heaviest weight, the share of parts that may miss it before the
#: last rounds, bytes that one takes there and afterwards, and how gently the price follows.
_PULL, _HEAVIEST, _MISSES, _HOLD, _MEND, _GENTLY = 0.87, 64.0, 0.04, 3.0, 8.0, 0.15
#: Rounds in which knots are settled along parts that keep the maximum.
_HOLDING_ROUNDS = 4
#: Rounds on all slots after those on the thin ones.
_LAST_ROUNDS = 5
#: Rounds at the end whose walks are coded in any case.
_CODED_ROUNDS = 2
#: Slots to either side of a knot to which it may move in one of them.
_NEAR_SLOTS = 3


@dataclass(frozen=True)
class Plan:
    """How one search for a map goes about it.

    Parameters
    ----------
    target : float
        Root mean square error to reach, in quanta.
    leader : float
        Radius, in targets, within which the first knots are gathered into shared nodes; 0 leaves each its own.
    rounds : int
        Number of rounds of E-step, M-step and merging.
    extra : int
        Rounds that may follow while the error allowed isn't made use of.
    hopeless : float
        Give up where the error is so many times the target, and hardly falls when the price rises.
    beam : float
        Bits beyond the cheapest node of a slot above which another one isn't looked at.
    frugal : bool
        Code the walks only every other round before the last few.
    maximum : float, optional
        Largest distance of any sample, in quanta, to aim for instead; ``target`` is then the error of the first walks.
    window : int
        Knots that the E-step chooses at once.
    widest : int
        Slots that a part may span.
    reach : float
        Radius, in targets, within which a knot may take a node.
    """

    target: float
    leader: float = 1.0
    rounds: int = 12
    extra: int = 0
    hopeless: float = np.inf
    beam: float = np.inf
    frugal: bool = False
    maximum: float | None = None
    window: int = 24
    widest: int = 300
    reach: float = 3.0


@dataclass(frozen=True, eq=False)
class Outcome:
    """A map with its walks: the coded size in bytes, the root mean square error in quanta, and the parts that miss a maximum."""

    walks: LatticeWalks
    size: int
    error: float
    misses: int = 0

    @property
    def cost(self) -> float:
        """Bytes, with what mending the parts that still miss a maximum takes, on a finer lattice for all."""
        return self.size + _MEND * self.misses


def fit(
    slots: Slots, tracks: int, plan: Plan, *, thin: Slots | None = None, known: Past | None = None, executor: Executor | None = None
) -> Outcome | None:
    """Learn a map and walks of few bytes whose error is within the plan's target.

    Parameters
    ----------
    slots : Slots
        Where knots may lie.
    tracks : int
        Number of tracks.
    plan : Plan
        The target and how to go about it.
    thin : Slots, optional
        Some of the slots: all rounds but the last few are spent on them, for speed.
    known : Past, optional
        Walks whose nodes these may take, too: they stay where they are and come first in the outcome.
    executor : Executor, optional
        Where the batches of a round are settled; the outcome does not depend on it.

    Returns
    -------
    Outcome or None
        The smallest that was met on the way; None if no round met the target.
    """
    here, fixed = slots if thin is None else thin, 0 if known is None else known.nodes
    at, places, price = _private_chains(here, plan, executor)
    at, places = _gather(here, at, places, plan, known)
    best: Outcome | None = None
    kept: tuple[Slots, NDArray[np.int64], NDArray[np.float64]] | None = None
    last, ledger = np.inf, np.zeros((ACCOUNTS, 2))
    push, fall, bits, weights = _PUSH, _PUSH, prices_of(None, price, len(places), plan.beam), np.ones(len(slots.times))
    for turn in range(plan.rounds + plan.extra):
        if turn >= plan.rounds and best is not None and best.error > _FULL * plan.target:
            break
        if thin is not None and turn >= plan.rounds - _LAST_ROUNDS:
            at, here = _refined(slots, thin, here, at)
        if plan.maximum is not None:
            here = weigh_samples(here, np.rint(weights).astype(np.int64))
        at, places = settle(here, at, places, plan, bits, turn, known=known, executor=executor)
        places = place(here, at, places, fixed)
        at, places = unite(here, at, places, plan, bits, fixed)
        rounded = rounded_places(here, at, places, fixed)
        coded = not plan.frugal or turn % 2 == 0 or turn >= plan.rounds - _CODED_ROUNDS
        outcome, spent, errors = realise(here, at, rounded, tracks, plan, known, executor, coded=coded)
        ledger = spent if coded else ledger
        if coded and _better(outcome, best, plan):
            best, kept = outcome, (here, at.copy(), rounded)
        if plan.maximum is not None:
            weights = _reweigh(weights, errors, plan.maximum)
        if turn >= 1:
            over = _excess(outcome, plan)
            if over > plan.hopeless and outcome.error > _STUCK * last:
                return None
            last = outcome.error
            # a map that lags behind its price is pushed harder each round
            push = push + 1.5 if over > 1 else _PUSH
            fall = fall + 1.5 if over < _SLACK and thin is not None else _PUSH
            price *= over ** (push if over > 1 else fall)
        if turn % _KICK_EVERY == _KICK_EVERY - 1 and turn + _KICK_EVERY < plan.rounds:
            price, push, fall = _KICK * price, _PUSH, _PUSH
        bits = prices_of(ledger, price, len(outcome.walks.nodes), plan.beam)
    return best if plan.maximum is None or kept is None else _hold(*kept, tracks, plan, bits, known, executor)


def _refined(slots: Slots, thin: Slots, here: Slots, at: NDArray[np.int64]) -> tuple[NDArray[np.int64], Slots]:
    """Carry the knots to slots that lie closely about them."""
    whole = carry_knots(at, here, slots)
    near = slots_near(thin, slots, np.flatnonzero(whole >= 0), _NEAR_SLOTS)
    return whole[near], pick_slots(slots, near)


def _hold(
    slots: Slots,
    at: NDArray[np.int64],
    places: NDArray[np.float64],
    tracks: int,
    plan: Plan,
    bits: NDArray[np.float64],
    known: Past | None,
    executor: Executor | None,
) -> Outcome:
    """Settle the knots once more on places that are whole already, along parts that keep the maximum."""
    whole = replace(slots, places=np.rint(slots.places))
    bits = np.concatenate([[0.0], bits[1:]])  # where the maximum is kept, squared error costs nothing
    best = realise(slots, at, places, tracks, plan, known)[0]
    for turn in range(_HOLDING_ROUNDS):
        at, places = settle(whole, at, places, plan, bits, turn, maximum=plan.maximum or 0.0, known=known, executor=executor)
        outcome, ledger, _ = realise(slots, at, places, tracks, plan, known)
        bits = prices_of(ledger, 0.0, len(outcome.walks.nodes))
        best = outcome if outcome.cost < best.cost else best
    return best


def _better(outcome: Outcome, best: Outcome | None, plan: Plan) -> bool:
    """Whether an outcome is smaller; a miss of the target is out, a part that misses the maximum costs what mending it will."""
    if plan.maximum is None and outcome.error > plan.target:
        return False
    return best is None or outcome.size + _HOLD * outcome.misses < best.size + _HOLD * best.misses


def _excess(outcome: Outcome, plan: Plan) -> float:
    """How far the walks are from what the price is to bring about; above 1 it must rise."""
    if plan.maximum is None:
        return outcome.error / (0.995 * plan.target)
    parts = sum(len(walk.gaps) for walk in outcome.walks.walks)
    return float(((outcome.misses + 1) / (_MISSES * parts + 1)) ** _GENTLY)


def _reweigh(weights: NDArray[np.float64], errors: NDArray[np.float64], maximum: float) -> NDArray[np.float64]:
    """Let samples near or beyond the maximum pull harder and the others less: multipliers of the constraints, by dual ascent."""
    return np.asarray(np.clip(weights * np.clip((errors / (_PULL * maximum)) ** 2, 0.5, 4.0), 1.0, _HEAVIEST))


def _private_chains(slots: Slots, plan: Plan, executor: Executor | None) -> tuple[NDArray[np.int64], NDArray[np.float64], float]:
    """Give every piece the cheapest chain of its own, at a price that meets the target."""
    price = 0.3 * len(slots.cells) / (slots.samples * plan.target**2)
    at = np.full(len(slots.cells), -1, np.int64)
    batches = cut_pieces(slots, np.where(np.isin(np.arange(len(at)), slots.lasts), 0, -1), 0)

    def chain(batch: NDArray[np.int64]) -> None:
        settle_chains(slots.sums, slots.ticks, slots.centers, slots.places, slots.place_unit, batch, price, 7.0, plan.widest, at)

    for _ in range(4):
        for _ in (map if executor is None else executor.map)(chain, batches):
            pass
        at[at >= 0] = np.arange((at >= 0).sum())
        places = place(slots, at, slots.places[at >= 0])
        error = np.sqrt(squared_error(list_parts(slots, at), places) / slots.samples)
        miss = max(error, 1e-3) / (0.93 * plan.target)
        if 0.95 < miss < 1.05:
            break
        price *= min(max(miss**1.6, 0.02), 50.0)
    return at, places, price


def _gather(
    slots: Slots, at: NDArray[np.int64], places: NDArray[np.float64], plan: Plan, known: Past | None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Let knots that are near each other, or a known node, share a node."""
    there = np.zeros((0, places.shape[1])) if known is None else known.walks.nodes.astype(np.float64)
    if plan.leader <= 0:
        return np.where(at >= 0, at + len(there), -1), np.concatenate([there, places])
    knots = int((at >= 0).sum())
    draft = empty_draft(places.shape[1], len(there) + knots, 8, plan.leader * plan.target)
    draft.places[: len(there)] = there
    draft.scalars[0] = len(there)
    enter_nodes(draft, len(there))
    spots = slots.places.copy()
    spots[at >= 0] = places[at[at >= 0]]
    lead_clusters(draft, spots, at)
    nodes = draft.places[: int(draft.scalars[0])]
    return at, place(slots, at, nodes, len(there))


def place(slots: Slots, at: NDArray[np.int64], places: NDArray[np.float64], fixed: int = 0) -> NDArray[np.float64]:
    """Place all nodes but the first ``fixed`` at least squared error (M-step)."""
    equations = normal_equations(list_parts(slots, at), places)
    return np.concatenate([places[:fixed], place_nodes(*free_equations(*equations, places, fixed))])


def rounded_places(slots: Slots, at: NDArray[np.int64], places: NDArray[np.float64], fixed: int) -> NDArray[np.float64]:
    """Whole places of all nodes; the first ``fixed`` are so already."""
    equations = normal_equations(list_parts(slots, at), places)
    return np.concatenate([places[:fixed], round_nodes(*free_equations(*equations, places, fixed), places[fixed:])])


def unite(
    slots: Slots, at: NDArray[np.int64], places: NDArray[np.float64], plan: Plan, bits: NDArray[np.float64], fixed: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Unite nodes whose error apart costs fewer bits than the second node, which is never one of the first ``fixed``."""
    parts = list_parts(slots, at)
    stiffness, _ = normal_equations(parts, places)
    pairs = _near_pairs(places, 4 * plan.target, fixed)
    if len(pairs) == 0:
        return at, places
    own = stiffness.diagonal()
    square = ((places[pairs[:, 0]] - places[pairs[:, 1]]) ** 2).sum(axis=1)
    # a node that stays where it is pulls as if it were infinitely stiff
    pull = np.where(pairs[:, 0] < fixed, 1.0, own[pairs[:, 0]] / (own[pairs[:, 0]] + own[pairs[:, 1]]))
    harm = bits[0] * square * own[pairs[:, 1]] * pull
    count = len(places)
    ones = np.ones(len(parts.starts))
    one_way = csr_array((ones, (parts.starts, parts.ends)), shape=(count, count))
    linked = ((one_way + one_way.T) > 0).astype(np.float64)
    shared = (linked @ linked).tocsr()[pairs[:, 0], pairs[:, 1]]
    gain = 0.7 * (bits[3] + bits[4]) + 0.7 * bits[5] * np.asarray(shared).ravel() - harm
    good = np.flatnonzero(gain > 0)
    if len(good) == 0:
        return at, places
    order = good[np.argsort(-gain[good], kind="stable")]
    target = np.arange(count)
    keep_disjoint(pairs[order], target)
    at = np.where(at >= 0, target[at], -1)
    at, places = compact(at, places, fixed)
    return at, place(slots, at, places, fixed)


def _near_pairs(places: NDArray[np.float64], reach: float, fixed: int) -> NDArray[np.int64]:
    """Pairs of nodes within reach, the lower number first, at least one of them not of the first ``fixed``."""
    if fixed == 0:
        return cKDTree(places).query_pairs(reach, output_type="ndarray").astype(np.int64)
    free = cKDTree(places[fixed:])
    pairs = [free.query_pairs(reach, output_type="ndarray") + fixed]
    low, high = places[fixed:].min(axis=0, initial=np.inf) - reach, places[fixed:].max(axis=0, initial=-np.inf) + reach
    near = np.flatnonzero(((places[:fixed] >= low) & (places[:fixed] <= high)).all(axis=1))
    found = cKDTree(places[near]).sparse_distance_matrix(free, reach, output_type="ndarray") if len(near) and free.n else None
    if found is not None:
        pairs.append(np.stack([near[found["i"]], found["j"] + fixed], axis=1))
    return np.concatenate(pairs).astype(np.int64)


def realise(
    slots: Slots,
    at: NDArray[np.int64],
    places: NDArray[np.float64],
    tracks: int,
    plan: Plan,
    known: Past | None = None,
    executor: Executor | None = None,
    *,
    coded: bool = True,
) -> tuple[Outcome, NDArray[np.float64], NDArray[np.float64]]:
    """Code the walks, at whole places, and at the same time measure what came out, sample by sample.

    Walks that are not to be coded have size 0 and an empty ledger.
    """
    walks = walks_of(slots, at, places, tracks, 0 if known is None else known.nodes)
    steps: list[Callable[[], Any]] = [
        partial(encode_with_ledger, walks, known) if coded else _uncoded,
        partial(sample_errors, slots, list_parts(slots, at), places),
    ]
    (data, ledger), (errors, part) = local(executor).map(_done, steps)
    misses = 0 if plan.maximum is None else len(np.unique(part[errors > plan.maximum]))
    return Outcome(walks, len(data), float(np.sqrt((slots.weights * errors**2).sum() / slots.samples)), misses), ledger, errors


def _uncoded() -> tuple[bytes, NDArray[np.float64]]:
    return b"", np.zeros((ACCOUNTS, 2))


def _done(step: Callable[[], Any]) -> Any:
    return step()


def prices_of(ledger: NDArray[np.float64] | None, price: float, nodes: int, beam: float = np.inf) -> NDArray[np.float64]:
    """Prices of the E-step in bits, from what the coder last paid."""
    spent = np.zeros((ACCOUNTS, 2)) if ledger is None else ledger

    def mean(rows: list[int], guess: float) -> float:
        return float((spent[rows, 0].sum() + 4 * guess) / (spent[rows, 1].sum() + 4))

    moving = [SPAN_BITS + kind for kind in (_BACK, _KNOWN, _LINK, _NEW)]
    return np.array(
        [
            price,
            mean(moving, 4.0),
            mean([SPAN_BITS + _STAY], 6.0),
            mean([KIND_BITS + _NEW], 1.0),
            mean([PLACE_BITS], 9.0),
            mean([KIND_BITS + _LINK], 8.0),
            mean([KIND_BITS + _STAY], 4.0),
            np.log2(nodes + 2.0),
            0.2,
            beam,
        ]
    )
