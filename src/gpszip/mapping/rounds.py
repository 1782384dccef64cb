"""The connected map: parts end in nodes that walks share, found by description length.

One objective decides everything: J = bits + price x squared error. Each round moves knots and relabels them window by window
(E-step), places all nodes by one sparse solve (M-step) and merges nodes where that saves bits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.walk_model import ACCOUNTS, KIND_BITS, PLACE_BITS, SPAN_BITS
from gpszip.codec.prior import Past
from gpszip.codec.walks import encode_with_ledger
from gpszip.mapping.assignment import cut_pieces, settle
from gpszip.mapping.initial_map import Parts, empty_draft, list_parts, sample_errors, squared_error, walks_of
from gpszip.mapping.kernels.initial_map import enter_nodes, lead_clusters
from gpszip.mapping.kernels.private_chain import settle_chains
from gpszip.mapping.placement import place, rounded_places, unite
from gpszip.mapping.plan import Plan
from gpszip.mapping.time_grid import Slots, carry_knots, pick_slots, slots_near, weigh_samples
from gpszip.model import LatticeWalks
from gpszip.run.executor import Executor, local

__all__ = ["Outcome", "fit", "prices_of", "realise"]

T = TypeVar("T")

#: Steps of the walks' kinds in the coder's ledger.
_BACK, _KNOWN, _LINK, _NEW, _STAY = range(5)
#: Power of the error's excess by which the price rises after the first miss.
_PUSH = 2.5
#: Share of it below which the price falls harder each round, too: on thin slots, and where rounds follow until none is left.
_SLACK, _NO_SLACK = 0.99, 0.998
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
    tally, last = _Tally(plan, known), np.inf
    slack = _SLACK if thin is not None else _NO_SLACK if plan.extra else 0.0
    push, fall, bits, weights = _PUSH, _PUSH, prices_of(None, price, len(places), plan.beam), np.ones(len(slots.times))
    for turn in range(plan.rounds + plan.extra):
        if turn >= plan.rounds and tally.is_full():
            break
        if thin is not None and turn >= plan.rounds - _LAST_ROUNDS:
            at, here = _refined(slots, thin, here, at)
        if plan.maximum is not None:
            here = weigh_samples(here, np.rint(weights).astype(np.int64))
        anew = partial(settle, here, at, places, plan, bits, turn, known=known, executor=executor)
        at, places = anew() if tally.waiting is None else _beside(local(executor), tally.code, anew)
        parts = list_parts(here, at, len(places))
        at, parts, places = unite(at, parts, place(parts, places, fixed), plan, bits, fixed)
        rounded = rounded_places(parts, places, fixed)
        outcome, errors = _measured(here, at, rounded, tracks, plan, known, parts)
        if not plan.frugal or turn % 2 == 0 or turn >= plan.rounds - _CODED_ROUNDS:
            tally.add(outcome, _Layout(here, at, rounded))
        if turn == 0 or not plan.frugal:
            tally.code()
        if plan.maximum is not None:
            weights = _reweigh(weights, errors, plan.maximum)
        if turn >= 1:
            over = _excess(outcome, plan)
            if over > plan.hopeless and outcome.error > _STUCK * last:
                return None
            last = outcome.error
            # a map that lags behind its price is pushed harder each round
            push = push + 1.5 if over > 1 else _PUSH
            fall = fall + 1.5 if over < slack else _PUSH
            price *= over ** (push if over > 1 else fall)
        if turn % _KICK_EVERY == _KICK_EVERY - 1 and turn + _KICK_EVERY < plan.rounds:
            price, push, fall = _KICK * price, _PUSH, _PUSH
        bits = prices_of(tally.ledger, price, len(outcome.walks.nodes), plan.beam)
    tally.code()
    if plan.maximum is None or tally.layout is None:
        return tally.best
    return _hold(tally.layout, tracks, plan, bits, known, executor)


@dataclass(frozen=True, eq=False)
class _Layout:
    """Knots on slots, and whole places of their nodes."""

    slots: Slots
    at: NDArray[np.int64]
    places: NDArray[np.float64]


@dataclass(eq=False)
class _Tally:
    """The smallest outcome so far with its layout, what the coder last paid, and an outcome that it has still to code."""

    plan: Plan
    known: Past | None
    best: Outcome | None = None
    layout: _Layout | None = None
    ledger: NDArray[np.float64] = field(default_factory=lambda: np.zeros((ACCOUNTS, 2)))
    waiting: tuple[Outcome, _Layout] | None = None

    def add(self, outcome: Outcome, layout: _Layout) -> None:
        """Take note of an outcome whose size nobody knows yet."""
        self.waiting = outcome, layout

    def code(self) -> None:
        """Code what waits."""
        if self.waiting is None:
            return
        (outcome, layout), self.waiting = self.waiting, None
        outcome, self.ledger = _coded(outcome, self.known)
        if _better(outcome, self.best, self.plan):
            self.best, self.layout = outcome, layout

    def is_full(self) -> bool:
        """Whether the best outcome makes use of the error allowed."""
        enough = _FULL * self.plan.target
        if self.waiting is not None and max(self.waiting[0].error, self.best.error if self.best else 0.0) > enough:
            self.code()
        return self.best is not None and self.best.error > enough


def _beside(executor: Executor, aside: Callable[[], None], work: Callable[[], T]) -> T:
    """Return what comes of work; something else is done at the same time."""
    found: list[T] = []
    for _ in executor.map(_do, [aside, lambda: found.append(work())]):
        pass
    return found[0]


def _do(step: Callable[[], None]) -> None:
    step()


def _refined(slots: Slots, thin: Slots, here: Slots, at: NDArray[np.int64]) -> tuple[NDArray[np.int64], Slots]:
    """Carry the knots to slots that lie closely about them."""
    whole = carry_knots(at, here, slots)
    near = slots_near(thin, slots, np.flatnonzero(whole >= 0), _NEAR_SLOTS)
    return whole[near], pick_slots(slots, near)


def _hold(layout: _Layout, tracks: int, plan: Plan, bits: NDArray[np.float64], known: Past | None, executor: Executor | None) -> Outcome:
    """Settle the knots once more on places that are whole already, along parts that keep the maximum."""
    slots, at, places = layout.slots, layout.at, layout.places
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
        parts = list_parts(slots, at, int((at >= 0).sum()))
        places = place(parts, slots.places[at >= 0])
        error = np.sqrt(squared_error(parts, places) / slots.samples)
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
    return at, place(list_parts(slots, at, len(nodes)), nodes, len(there))


def realise(
    slots: Slots, at: NDArray[np.int64], places: NDArray[np.float64], tracks: int, plan: Plan, known: Past | None = None
) -> tuple[Outcome, NDArray[np.float64], NDArray[np.float64]]:
    """Measure the walks at whole places, sample by sample, and code them: outcome, ledger and distances."""
    outcome, errors = _measured(slots, at, places, tracks, plan, known, list_parts(slots, at, len(places)))
    outcome, ledger = _coded(outcome, known)
    return outcome, ledger, errors


def _measured(
    slots: Slots, at: NDArray[np.int64], places: NDArray[np.float64], tracks: int, plan: Plan, known: Past | None, parts: Parts
) -> tuple[Outcome, NDArray[np.float64]]:
    """The walks with their error but without a size, and the distance of each sample."""
    errors, part = sample_errors(slots, parts, places)
    misses = 0 if plan.maximum is None else len(np.unique(part[errors > plan.maximum]))
    walks = walks_of(slots, at, places, tracks, 0 if known is None else known.nodes)
    return Outcome(walks, 0, float(np.sqrt((slots.weights * errors**2).sum() / slots.samples)), misses), errors


def _coded(outcome: Outcome, known: Past | None) -> tuple[Outcome, NDArray[np.float64]]:
    """The outcome with its size, and what the bits were spent on."""
    data, ledger = encode_with_ledger(outcome.walks, known)
    return replace(outcome, size=len(data)), ledger


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
