"""Walks of small logs polished by their real size: single changes that save more bits than their error is worth.

The search moves knots by prices; what a change really saves only the coder knows, since its model adapts. Here each change that
looks promising is coded, at first with the knots about it only, then with all walks, and made if bits and error together fall. The
price of the error goes up and down about the one that meets the bound, so that walks leave a local optimum behind.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.range_coder import writer
from gpszip.codec.kernels.walk_coder import code_walks
from gpszip.codec.kernels.walk_model import WalkModel, new_model
from gpszip.codec.prior import Past
from gpszip.codec.walks import encode
from gpszip.mapping.budgets import Shares
from gpszip.mapping.initial_map import list_parts, sample_errors, walks_of
from gpszip.mapping.kernels.function_pointer import pointer_to
from gpszip.mapping.kernels.local_search import Calls, Rule, decide, sweep_knots
from gpszip.mapping.kernels.local_search_bits import WORK, Desk, code_all, code_window
from gpszip.mapping.kernels.local_search_moves import MOST_OFFERS, Offers, Ways
from gpszip.mapping.kernels.local_search_nodes import sweep_nodes
from gpszip.mapping.kernels.local_search_state import BITS, KNOTS, SQUARE, TEMPORARY, Chain, Samples, copy_chain, renew
from gpszip.mapping.rounds import Outcome
from gpszip.mapping.time_grid import Slots, weigh_samples
from gpszip.model import LatticeWalks

__all__ = ["WORK_OF_EFFORT", "best_outcomes", "polish", "worthwhile"]

#: Knots that may be coded for one outcome, at each effort; a million take about 6 s.
WORK_OF_EFFORT = (0, 40_000, 80_000, 150_000, 300_000, 600_000, 1_200_000, 2_500_000, 5_000_000)

#: Knots coded, for each of the walks, until nothing is left to do; outcomes polished at least and at most.
_WORK_PER_KNOT, _FEWEST, _MOST = 1600, 2, 8

#: Walks of so many knots are left alone where this share of the work for a knot is not granted.
_WORTHWHILE = 0.03

#: Share of their bits that walks save when the squared error grows by a factor e.
_SLOPE = 0.55

#: The same for walks within a maximum, whose mean error hardly matters.
_SLOPE_WITHIN = 0.05

#: Turns over all knots and nodes: those with the price going to and fro and the error up to a share above the bound, and the last
#: ones, from the best walks, at falling prices within the bound; share of the work set aside for these.
_TURNS, _LAST_TURNS, _OVER, _RESERVE = 10, 2, 1.05, 0.15

#: Further turns while the root mean square error is below this share of the bound and walks still get smaller, each with as much work.
_MORE_TURNS, _FULL = 4, 0.993
_TO_AND_FRO, _LAST_PRICE = (1.0, 1.6, 1 / 1.6), 0.4

#: How the price follows the error, whose excess counts within these bounds.
_PUSH, _LEAST_EXCESS, _MOST_EXCESS = 2.5, 0.8, 1.25

#: Bits that an offer may look dearer than what is there and be coded all the same, in the first turns and later.
_HOPES = (4.0, 8.0, 14.0)

#: Offers coded in full for one knot, and bits of a window below which they are.
_TRIALS, _PROMISE = 4.0, 0.0

#: Bits of error that uniting two nodes may cost, or moving one, and be coded.
_UNITE, _MOVE = 24.0, 2.5

#: The bound that is aimed at, as a share of that allowed, since the sums count in whole ticks.
_AIM = 0.9999

#: Weight of the samples of the dearest group; the others have less, but at least 1.
_WEIGHTS = 16


@dataclass(frozen=True, eq=False)
class _Bench:
    """Walks in work: as they are, as they were before a change, and the smallest within the bound so far."""

    samples: Samples
    chain: Chain
    spare: Chain
    best: Chain
    desk: Desk
    offers: Offers
    ways: Ways
    calls: Calls
    slots: Slots

    def turn(self, rule: Rule, hope: float) -> None:
        """Go once over all knots and all nodes."""
        self.offers.terms[0] = hope
        sweep_knots(self.calls, self.desk, self.samples, self.ways, self.chain, self.spare, self.best, self.offers, rule)
        sweep_nodes(self.calls, self.desk, self.samples, self.chain, self.spare, self.best, rule)

    def weigh(self, weights: NDArray[np.int64]) -> None:
        """Give the samples other weights."""
        np.copyto(self.samples.sums, weigh_samples(self.slots, weights).sums)
        self.renew()

    def renew(self) -> None:
        """Measure all parts anew."""
        renew(self.samples, self.chain, 0, int(self.chain.counts[KNOTS]))


@dataclass(eq=False)
class _Steering:
    """What bounds the error and the price of it, which follows the error.

    With shares, each group has a price of its own: its samples weigh as much.
    """

    bench: _Bench
    bounds: NDArray[np.float64]
    prices: NDArray[np.float64]
    maximum: float
    shares: Shares | None
    weights: NDArray[np.float64]

    @property
    def bound(self) -> float:
        """Largest squared error, as its groups weigh now."""
        return float((self.weights * self.bounds).sum())

    def rule(self, swing: float, over: float) -> Rule:
        """What decides now, at a price so many times what it is."""
        price = swing * float(self.prices.max()) / float(self.weights.max())
        bounds = np.full(1, np.inf) if self.shares is None else self.weights * self.bounds
        return Rule(price, over * self.bound, self.bound, self.maximum, _UNITE, _MOVE, bounds, over)

    def follow(self) -> None:
        """Let the price follow the error."""
        if self.maximum > 0:
            return
        excess = self.bench.chain.squares / (0.995 * self.weights * self.bounds)
        self.prices = self.prices * excess.clip(_LEAST_EXCESS, _MOST_EXCESS) ** _PUSH
        self.weigh()

    def weigh(self) -> None:
        """Let the samples of each group weigh what their error is worth."""
        if self.shares is not None:
            self.weights = np.rint(_WEIGHTS * self.prices / self.prices.max()).clip(1)
            self.bench.weigh(self.weights.astype(np.int64)[self.shares.groups])


def best_outcomes(found: Iterable[Outcome], effort: int) -> list[Outcome]:
    """The outcomes that are worth polishing, the smallest first, of equal ones one; at least the smallest of any."""
    distinct: dict[tuple[int, float], Outcome] = {}
    for outcome in sorted(found, key=lambda one: one.cost):
        distinct.setdefault((outcome.size, outcome.error), outcome)
    smallest = list(distinct.values())
    knots = sum(len(walk.nodes) for walk in smallest[0].walks.walks) if smallest else 0
    work = WORK_OF_EFFORT[effort - 1]
    if work < _WORTHWHILE * _WORK_PER_KNOT * knots:
        return smallest[:1]
    return smallest[: min(max(work // (_WORK_PER_KNOT * max(knots, 1)), _FEWEST), _MOST)]


def worthwhile(outcome: Outcome, work: int) -> bool:
    """Whether polishing with so much work can do anything for an outcome."""
    knots = sum(len(walk.nodes) for walk in outcome.walks.walks)
    return not outcome.misses and work >= _WORTHWHILE * _WORK_PER_KNOT * knots


def polish(
    slots: Slots,
    outcome: Outcome,
    *,
    target: float | None = None,
    maximum: float | None = None,
    known: Past | None = None,
    work: int = WORK_OF_EFFORT[4],
    shares: Shares | None = None,
) -> Outcome:
    """Change walks knot by knot and node by node such that they take fewer bytes within the same bound.

    Parameters
    ----------
    slots : Slots
        All slots of the lattice on which the walks lie.
    outcome : Outcome
        The walks, of which no part misses the bound.
    target : float, optional
        Largest root mean square error, in quanta.
    maximum : float, optional
        Largest distance of any sample, in quanta; one of the bounds must be given, this one wins.
    known : Past, optional
        Walks on whose map these lie; its nodes stay where they are.
    work : int
        Knots that may be coded in all.
    shares : Shares, optional
        Root mean square errors that groups of samples keep to, in place of the target.

    Returns
    -------
    Outcome
        Fewer bytes, or the very same outcome; where that misses its shares, the smallest found that keeps to them, if any.
    """
    walks = outcome.walks
    at = _knots_on(slots, walks) if worthwhile(outcome, work) else None
    if at is None:
        return outcome
    bench = _bench(slots, at, walks, known, int((1 - _RESERVE) * work), shares)
    steering = _steering(bench, slots, at, walks, target, maximum, shares)
    if shares is not None and (bench.chain.squares > steering.bounds).any():
        bench.best.totals[BITS] = np.inf
    _work(bench, steering, int(_RESERVE * work))
    return _finished(slots, outcome, bench.best, target, maximum, known, shares)


def _steering(
    bench: _Bench,
    slots: Slots,
    at: NDArray[np.int64],
    walks: LatticeWalks,
    target: float | None,
    maximum: float | None,
    shares: Shares | None,
) -> _Steering:
    """Bounds of the squared error by the sums that count in whole ticks, and prices to begin with."""
    bounds, chain = np.full(len(bench.chain.squares), np.inf), bench.chain
    if maximum is None or shares is not None:
        errors = sample_errors(slots, list_parts(slots, at, len(walks.nodes)), walks.nodes.astype(np.float64))[0]
        squares = slots.weights * errors**2
        if shares is None:
            bounds[0] = slots.samples * (_AIM * (target or 0.0)) ** 2 - abs(float(squares.sum()) - float(chain.totals[SQUARE]))
        else:
            bounds = shares.sums(slots.weights) * (_AIM * shares.rms) ** 2 - abs(shares.sums(squares) - chain.squares)
    slope = _SLOPE if maximum is None else _SLOPE_WITHIN
    price = slope * chain.totals[BITS] / max(min(float(bounds.sum()), chain.totals[SQUARE]), 1e-9)
    return _Steering(bench, bounds, np.full(len(bounds), price), maximum or 0.0, shares, np.ones(len(bounds)))


def _work(bench: _Bench, steering: _Steering, reserve: int) -> None:
    """All turns; the smallest walks are the bench's best ones then."""
    chain = bench.chain
    steering.weigh()
    for turn in range(_TURNS):
        bench.turn(steering.rule(_TO_AND_FRO[turn % len(_TO_AND_FRO)], _OVER), _HOPES[min(turn, len(_HOPES) - 1)])
        if bench.desk.counts[WORK] <= 0:
            break
        steering.follow()
    if bench.best.totals[BITS] < np.inf:
        copy_chain(bench.best, chain)
        bench.renew()
    bench.desk.counts[WORK] += reserve
    for turn in range(_LAST_TURNS + _MORE_TURNS):
        bits = chain.totals[BITS]
        steering.prices = _LAST_PRICE * steering.prices
        bench.turn(steering.rule(1.0, 1.0), _HOPES[-1])
        settled = steering.maximum > 0 or chain.totals[SQUARE] > _FULL**2 * steering.bound
        if turn + 1 >= _LAST_TURNS and (settled or chain.totals[BITS] >= bits):
            break
        if not settled:
            bench.desk.counts[WORK] = max(bench.desk.counts[WORK], reserve)


def _finished(
    slots: Slots,
    outcome: Outcome,
    chain: Chain,
    target: float | None,
    maximum: float | None,
    known: Past | None,
    shares: Shares | None,
) -> Outcome:
    """The polished walks as an outcome, measured sample by sample; the old one if they aren't smaller or miss the bound after all."""
    if chain.totals[BITS] == np.inf:
        return outcome
    at = np.full(len(slots.cells), -1, np.int64)
    knots, nodes = chain.counts.tolist()
    at[chain.slot[:knots]] = chain.node[:knots]
    places = chain.places[:nodes]
    walks = walks_of(slots, at, places, len(outcome.walks.walks), 0 if known is None else known.nodes)
    errors = sample_errors(slots, list_parts(slots, at, len(places)), places)[0]
    error, size = float(np.sqrt((slots.weights * errors**2).sum() / slots.samples)), len(encode(walks, known))
    polished = replace(outcome, walks=walks, size=size, error=error)
    if shares is not None:
        mean = np.sqrt(shares.sums(slots.weights * errors**2) / shares.sums(slots.weights))
        return polished if (mean <= shares.rms).all() else outcome
    held = error <= (target or 0.0) if maximum is None else float(errors.max()) <= maximum
    return polished if held and size < outcome.size else outcome


def _bench(slots: Slots, at: NDArray[np.int64], walks: LatticeWalks, known: Past | None, work: int, shares: Shares | None = None) -> _Bench:
    sums = slots.sums if shares is None else slots.sums.copy()
    samples = Samples(
        sums, slots.ticks, slots.centers, slots.place_unit, slots.ends, slots.times, slots.spots, slots.cells, _slot_groups(slots, shares)
    )
    chain = _chain(slots, at, walks.nodes, 1 if shares is None else len(shares.rms))
    desk, offers, zero = _desk(chain, walks, known, work), _offers(chain), np.int64(0)
    code = pointer_to(code_walks, desk.coder, desk.model, desk.nodes, desk.cells, desk.gaps, desk.begins, 1, True, True)
    window = pointer_to(code_window, code, desk, chain, slots.cells, zero, zero, zero, zero, zero, offers.slots[0], offers.nodes[0])
    accept = pointer_to(decide, code, desk, slots.cells, chain, chain, chain, Rule(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, chain.squares, 0.0))
    renew(samples, chain, 0, int(chain.counts[KNOTS]))
    chain.totals[BITS] = code_all(code, desk, chain, slots.cells)
    return _Bench(samples, chain, _like(chain), _like(chain), desk, offers, _ways(known), Calls(code, window, accept), slots)


def _slot_groups(slots: Slots, shares: Shares | None) -> NDArray[np.int64]:
    if shares is None:
        return np.zeros(len(slots.cells), np.int64)
    return np.repeat(shares.groups[slots.ends[slots.firsts]], slots.lasts - slots.firsts + 1)


def _knots_on(slots: Slots, walks: LatticeWalks) -> NDArray[np.int64] | None:
    """Node of each slot, -1 where there is no knot; None if a knot is on no slot, or a piece does not begin and end with one."""
    at = np.full(len(slots.cells), -1, np.int64)
    owner = np.repeat(slots.owners, slots.lasts - slots.firsts + 1)
    bounds = np.searchsorted(owner, np.arange(len(walks.walks) + 1))
    for track, walk in enumerate(walks.walks):
        own = np.arange(bounds[track], bounds[track + 1])
        found = np.searchsorted(slots.cells[own], walk.cells)
        if found.max(initial=0) >= len(own) or (slots.cells[own[found]] != walk.cells).any():
            return None
        at[own[found]] = walk.nodes
    return at if (at[slots.firsts] >= 0).all() and (at[slots.lasts] >= 0).all() else None


def _chain(slots: Slots, at: NDArray[np.int64], nodes: NDArray[np.int64], groups: int) -> Chain:
    knots = np.flatnonzero(at >= 0)
    count = len(knots)
    piece = np.searchsorted(slots.lasts, knots)
    room = count + count // 4 + 32
    places = np.zeros((len(nodes) + room + TEMPORARY, nodes.shape[1]))
    places[: len(nodes)] = nodes
    joined, begins = np.zeros(room, np.int8), np.zeros(room, np.int8)
    joined[1:count] = piece[1:] == piece[:-1]
    begins[:count] = np.diff(slots.owners[piece], prepend=-1) != 0
    slot, node, uses = np.zeros(room, np.int64), np.zeros(room, np.int64), np.zeros(len(places), np.int64)
    slot[:count], node[:count] = knots, at[knots]
    uses += np.bincount(at[knots], minlength=len(places))
    return Chain(slot, node, joined, begins, np.zeros(room), places, uses, np.array([count, len(nodes)]), np.zeros(2), np.zeros(groups))


def _like(chain: Chain) -> Chain:
    return Chain._make(array.copy() for array in chain)


def _desk(chain: Chain, walks: LatticeWalks, known: Past | None, work: int) -> Desk:
    room, nodes = len(chain.slot) + 8, len(chain.places)
    fixed = 0 if known is None else known.nodes
    dimension = chain.places.shape[1]
    model, whole = _in_a_row(new_model(room, dimension) if known is None else known.model(room))
    coder = writer(0)
    number = np.full(nodes, -1, np.int64)
    number[:fixed] = np.arange(fixed)
    byte = np.zeros(room, np.int8)
    gapped = any(walk.gaps.any() for walk in walks.walks)
    counts = np.array([0, 0, len(walks.walks), fixed, work])
    long = [np.zeros(room, np.int64) for _ in range(3)]
    return Desk(
        coder, coder.words.copy(), model, whole, whole.copy(), whole.copy(), long[0], long[1], byte, byte.copy(),
        number, number.copy(), np.zeros(nodes, np.int64), long[2], counts, gapped,
    )  # fmt: skip


def _in_a_row(model: WalkModel) -> tuple[WalkModel, NDArray[np.int64]]:
    """Return the same model on one array, so that it is copied at once."""
    sizes = [-(-array.nbytes // 8) for array in model]
    whole = np.zeros(sum(sizes), np.int64)
    ends = np.cumsum(sizes)
    views = []
    for number, (size, end) in enumerate(zip(sizes, ends.tolist(), strict=True)):
        array = model[number]
        view = whole[end - size : end].view(array.dtype)[: array.size].reshape(array.shape)
        view[...] = array
        views.append(view)
    return WalkModel._make(views), whole


def _ways(known: Past | None) -> Ways:
    if known is None:
        return Ways(np.zeros(1, np.int64), np.zeros(0, np.int64))
    one, two = known.steps[0].T
    pairs = np.unique(np.stack([np.append(one, two), np.append(two, one)], axis=1), axis=0)
    return Ways(np.searchsorted(pairs[:, 0], np.arange(known.nodes + 1)), pairs[:, 1].copy())


def _offers(chain: Chain) -> Offers:
    row, pair = np.zeros(MOST_OFFERS, np.int64), np.zeros((MOST_OFFERS, 2), np.int64)
    number = np.zeros(MOST_OFFERS)
    return Offers(
        row, row.copy(), row.copy(), pair, pair.copy(), number, number.copy(), np.zeros(1, np.int64),
        np.zeros(len(chain.places), np.int8), np.zeros(chain.places.shape[1]), np.array([0.0, _TRIALS, _PROMISE]),
    )  # fmt: skip
