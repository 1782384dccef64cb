"""Rounds of learning the connected map: segments end in nodes that walks share.

One objective decides everything, the rate-distortion cost J = bits + price x squared error. Each
round moves and relabels knots window by window (E-step), places all nodes by one sparse solve
(M-step), and merges nodes where that saves bits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.walk_model import DURATION_BITS, POSITION_BITS, STATISTICS, STEP_KIND_BITS
from gpszip.codec.prior import Prior
from gpszip.codec.walks import encode_with_statistics
from gpszip.mapping.assignment import assign_knots, cut_into_batches, drop_unused_nodes
from gpszip.mapping.initial_map import (
    Segments,
    allocate_working_map,
    list_segments,
    sample_errors,
    squared_error,
    walks_of,
)
from gpszip.mapping.kernels.assign import Prices
from gpszip.mapping.kernels.assign_max_error import build_directions
from gpszip.mapping.kernels.extreme_samples import mark_extreme_samples
from gpszip.mapping.kernels.initial_map import NODE_COUNT, cluster_by_leader, index_nodes
from gpszip.mapping.kernels.private_chain import find_private_chains
from gpszip.mapping.offered_slots import assign_on_offered_slots
from gpszip.mapping.placement import merge_nodes, place_nodes, place_on_grid
from gpszip.mapping.plan import Plan
from gpszip.mapping.time_grid import (
    TimeGrid,
    mask_near_knots,
    place_walks,
    reweight_samples,
    select_samples,
    select_slots,
    transfer_knots,
)
from gpszip.model import GridWalks
from gpszip.run.executor import Executor, local_executor

__all__ = ["Outcome", "Start", "estimate_prices", "fit", "measure_and_encode", "start_from"]

T = TypeVar("T")

#: Kind of a step in the coder's bit statistics: back along the edge that the walk came by.
_BACK = 0
#: Kind of a step along another known edge.
_KNOWN = 1
#: Kind of a step along a new edge to a known node.
_LINK = 2
#: Kind of a step to a new node.
_NEW = 3
#: Kind of a stop.
_STAY = 4

#: Power of the excess error by which the price changes after a first miss.
_PRICE_POWER = 2.5
#: What the power gains in each further round in which the error is on the same side.
_POWER_STEP = 1.5

#: Share of the error allowed that the price targets.
_AIM = 0.995
#: Excess below which the price falls harder each round, on a sparse time grid.
_SLACK = 0.99
#: The same where rounds follow until the error allowed is used up.
_SMALL_SLACK = 0.998
#: Share of the error allowed from which on it counts as used up.
_USED_UP = 0.992
#: Share of the last round's error above which the error hardly falls.
_STUCK = 0.98

#: Every so many rounds the price falls: walks that need fewer knots leave a local optimum.
_KICK_EVERY = 6
#: Factor by which it falls.
_KICK = 0.6

#: Share of a maximum beyond which a sample gains weight.
_PULL_SHARE = 0.87
#: Largest weight of a sample.
_MAX_WEIGHT = 64.0
#: Limits of the factor by which a weight changes in a round.
_MIN_REWEIGHT = 0.5
_MAX_REWEIGHT = 4.0
#: Share of the segments that may miss a maximum before the last rounds.
_MAX_MISSES = 0.04
#: Bytes that a miss counts for among the outcomes of a search.
_BYTES_PER_MISS = 3.0
#: Bytes that it takes to bring a segment that still misses within the maximum.
_BYTES_PER_REPAIR = 8.0
#: Power of the misses by which the price follows them.
_MISS_POWER = 0.15

#: Error in grid steps below which walks count as exact.
_MIN_ERROR = 1e-9
#: Logarithm of the largest factor between bytes at two errors: more overflows.
_MAX_EXPONENT = 50.0
#: Relative distance to the target at which an outcome that may miss it is near enough.
_NEAR = 0.06

#: Samples between two slots up to which a maximum limits all: of a million samples with 31 between
#: two slots, the quarter farthest out does as well as all, in a third of the time.
_FEW_SAMPLES = 8
#: Directions in the plane in which samples are farthest out.
_EXTREME_DIRECTIONS = 4
#: Rounds at the end whose walks are always encoded.
_ENCODED_ROUNDS = 2
#: Slots to either side of a knot to which it may move in one of the dense rounds.
_NEAR_SLOTS = 3

#: Bits of a knot when each piece gets its own chain, beside its position.
_CHAIN_KNOT_BITS = 7.0
#: Rounds in which the price of the first chains is adjusted.
_CHAIN_ROUNDS = 4
#: Share of the target that the first chains aim at.
_CHAIN_AIM = 0.93
#: Power of the miss by which their price changes, about what error and price follow.
_CHAIN_POWER = 1.6
#: Miss within which the first chains are good enough.
_CHAIN_TOLERANCE = 0.05

#: Bits of squared error for each slot when the error is on target: the first price.
_BITS_PER_SLOT = 0.3

#: Steps of each kind that a guess of its price counts for.
_GUESS_WEIGHT = 4
#: Bits of a known edge beside its share of the traffic.
_ESCAPE_BITS = 0.2


@dataclass(frozen=True, eq=False)
class Outcome:
    """A map with its walks.

    Parameters
    ----------
    walks : GridWalks
        Map and walks.
    size : int
        Encoded size in bytes.
    error : float
        Root mean square error in grid steps.
    misses : int, default 0
        Number of segments that miss a maximum.
    prices : Prices, optional
        Prices in bits at which the knots were assigned.
    """

    walks: GridWalks
    size: int
    error: float
    misses: int = 0
    prices: Prices | None = None

    @property
    def cost(self) -> float:
        """Bytes, with those that it takes to bring all segments within the maximum."""
        return self.size + _BYTES_PER_REPAIR * self.misses

    def cost_at(self, target: float, samples: int) -> float:
        """Bytes that it would take at another root mean square error, in grid steps.

        Bytes B fall as a power of the error D, B ~ D^-p. Since the price of a squared error is the
        slope of the bits 8 B over n D^2, p = price n D^2 / (4 B); D^2 is the mean of both errors.
        """
        assert self.prices is not None
        square = self.error * target
        power = self.prices.error * samples * square / (4 * max(self.cost, 1.0))
        exponent = power * np.log(max(self.error, _MIN_ERROR) / target)
        return float(self.cost * np.exp(min(exponent, _MAX_EXPONENT)))


class Start(NamedTuple):
    """Knots, nodes and prices with which the rounds begin.

    ``slot_nodes`` and ``positions`` are those of :func:`~gpszip.mapping.assignment.assign_knots`.
    """

    slot_nodes: NDArray[np.int64]
    positions: NDArray[np.float64]
    prices: Prices


def start_from(
    outcome: Outcome, time_grid: TimeGrid, time_ratio: float, space_ratio: float
) -> Start:
    """Start from an outcome on another grid.

    Parameters
    ----------
    outcome : Outcome
        With prices, and a walk for each track of the time grid.
    time_grid : TimeGrid
        Slots where the knots are to lie.
    time_ratio, space_ratio : float
        Time step and space step of the outcome, in those of the time grid.
    """
    assert outcome.prices is not None
    slot_nodes, positions = drop_unused_nodes(
        place_walks(time_grid, outcome.walks, time_ratio),
        space_ratio * outcome.walks.nodes.astype(np.float64),
    )
    price = outcome.prices.error / space_ratio**2
    return Start(slot_nodes, positions, outcome.prices._replace(error=price))


def fit(
    time_grid: TimeGrid,
    tracks: int,
    plan: Plan,
    *,
    sparse_grid: TimeGrid | None = None,
    prior: Prior | None = None,
    start: Start | None = None,
    executor: Executor | None = None,
) -> Outcome | None:
    """Learn a map and walks of few bytes whose error is within the plan's target.

    1. Each piece gets the cheapest chain of knots by itself; near knots share a node.
    2. In each round, knots are assigned (E-step), nodes placed (M-step) and merged, and the walks
       measured and encoded.
    3. After each round, prices follow the error and the coder's bit statistics.
    4. Under a maximum, the best walks are assigned again along segments that keep it.

    Parameters
    ----------
    time_grid : TimeGrid
        Slots where knots may lie.
    tracks : int
        Number of tracks.
    plan : Plan
        The target, and parameters of the search.
    sparse_grid : TimeGrid, optional
        Some of the slots: all rounds but the last few use these only, for speed.
    prior : Prior, optional
        Walks whose nodes the new walks may take, too: they stay where they are and come first in
        the outcome.
    start : Start, optional
        Knots on the slots of the sparse grid, or of the full one without it; private chains by
        default.
    executor : Executor, optional
        Runs the batches of a round; the outcome does not depend on it.

    Returns
    -------
    Outcome or None
        The smallest of all rounds; None if no round met the target.
    """
    # Start from private chains, with near knots clustered, unless there is a start.
    current_grid = time_grid if sparse_grid is None else sparse_grid
    is_cold = start is None
    start = start or _start_cold(current_grid, plan, prior, executor)
    if start is None:
        return None
    slot_nodes, positions, prices = start

    # Run the rounds: the last few on all slots, and extra ones while allowed error is left.
    best = _BestOutcome(plan, prior)
    control = _PriceControl(plan, prices.error, _choose_slack(plan, sparse_grid), is_cold)
    weights = np.ones(len(time_grid.times))
    for turn in range(plan.rounds + plan.extra_rounds):
        if (turn >= plan.rounds and control.is_near()) or best.is_enough(turn):
            break
        if sparse_grid is not None and turn >= plan.rounds - plan.dense_rounds:
            slot_nodes, current_grid = _restore_slots(
                time_grid, sparse_grid, current_grid, slot_nodes
            )
        weighted_grid = current_grid
        if plan.maximum is not None:
            weighted_grid = reweight_samples(current_grid, np.rint(weights).astype(np.int64))

        # E-step, while the walks of the round before are encoded.
        assign = partial(
            assign_on_offered_slots,
            weighted_grid,
            slot_nodes,
            positions,
            plan,
            prices,
            turn,
            prior=prior,
            executor=executor,
        )
        slot_nodes, positions = best.encode_beside(assign, executor)

        # M-step, merge and rounding.
        slot_nodes, positions, layout, segments = _place_and_merge(
            weighted_grid, slot_nodes, positions, plan, prices, prior
        )

        # Measure the walks, and encode them now or beside the next E-step.
        outcome, errors = _measure(layout, tracks, plan, prior, segments)
        outcome = replace(outcome, prices=prices)
        if _is_encoded(plan, turn):
            best.add(outcome, layout)
        if turn == 0 or not plan.encode_alternate_rounds:
            best.encode()

        # Let weights and prices follow the errors.
        if plan.maximum is not None:
            weights = _reweigh(weights, errors, plan.maximum)
        if not control.follow(outcome, turn):
            return None
        if turn % _KICK_EVERY == _KICK_EVERY - 1 and turn + _KICK_EVERY < plan.rounds:
            control.kick()
        prices = estimate_prices(
            best.bit_statistics, control.price, len(outcome.walks.nodes), plan.beam
        )

    # Encode what still waits, and bring the best walks within the maximum.
    best.encode()
    if best.outcome is None:
        return None
    if plan.maximum is None or best.layout is None:
        return best.outcome
    outcome = _enforce_max_error(best.layout, tracks, plan, prices, prior, executor)
    return replace(outcome, prices=prices)


@dataclass(frozen=True, eq=False)
class _Layout:
    """Knots on slots, and whole positions of their nodes."""

    time_grid: TimeGrid
    slot_nodes: NDArray[np.int64]
    positions: NDArray[np.float64]


@dataclass(eq=False)
class _BestOutcome:
    """The smallest outcome so far with its layout, and an outcome that waits to be encoded."""

    plan: Plan
    prior: Prior | None
    outcome: Outcome | None = None
    layout: _Layout | None = None
    bit_statistics: NDArray[np.float64] = field(default_factory=lambda: np.zeros((STATISTICS, 2)))
    waiting: tuple[Outcome, _Layout] | None = None

    def add(self, outcome: Outcome, layout: _Layout) -> None:
        """Let an outcome of unknown size wait to be encoded."""
        self.waiting = outcome, layout

    def encode(self) -> None:
        """Encode the waiting outcome, and keep it if it is the smallest."""
        if self.waiting is None:
            return
        (outcome, layout), self.waiting = self.waiting, None
        outcome, self.bit_statistics = _encode_outcome(outcome, self.prior)
        if _is_better(outcome, self.outcome, self.plan, layout.time_grid.samples):
            self.outcome, self.layout = outcome, layout

    def encode_beside(self, work: Callable[[], T], executor: Executor | None) -> T:
        """Encode the waiting outcome while other work runs; return the result of that work."""
        if self.waiting is None:
            return work()
        return _run_concurrently(local_executor(executor), self.encode, work)

    def is_enough(self, turn: int) -> bool:
        """Whether the best outcome uses up the error allowed, or was sought for long enough.

        Before the last of the rounds planned, only one of many knots does.
        """
        if turn < self.plan.rounds:
            return self._has_many_knots() and self.is_used_up()
        if self.plan.enough_rounds is not None and turn >= self.plan.enough_rounds:
            self.encode()
            return self.outcome is not None
        return self.is_used_up()

    def _has_many_knots(self) -> bool:
        """Whether the best outcome, or the one that waits, has many knots."""
        outcome = self.outcome if self.waiting is None else self.waiting[0]
        return (
            self.plan.many_knots is not None
            and outcome is not None
            and sum(len(walk.nodes) for walk in outcome.walks.walks) >= self.plan.many_knots
        )

    def is_used_up(self) -> bool:
        """Whether the best outcome uses up the error allowed."""
        enough = _USED_UP * self.plan.target
        best_error = self.outcome.error if self.outcome else 0.0
        if self.waiting is not None and max(self.waiting[0].error, best_error) > enough:
            self.encode()
        return self.outcome is not None and self.outcome.error > enough


@dataclass(eq=False)
class _PriceControl:
    """The price of a squared error, which follows the error from round to round.

    The longer the error stays on one side, the harder the price changes.
    """

    plan: Plan
    price: float
    slack: float
    is_cold: bool
    rise_power: float = _PRICE_POWER
    fall_power: float = _PRICE_POWER
    last_error: float = np.inf

    def is_near(self) -> bool:
        """Whether outcomes may miss the target, and the last one is near enough to it."""
        return self.plan.tolerance > 1 and abs(self.last_error / self.plan.target - 1) < _NEAR

    def _is_hopeless(self, outcome: Outcome) -> bool:
        """Whether the error is far too large, and hardly falls."""
        return (
            _find_excess(outcome, self.plan) > self.plan.give_up_ratio
            and outcome.error > _STUCK * self.last_error
        )

    def follow(self, outcome: Outcome, turn: int) -> bool:
        """Raise the price if the error is too large, and lower it if it is too small.

        The first walks of a cold start tell little.

        Returns
        -------
        bool
            Whether there is hope that the target is met.
        """
        if self.is_cold and turn == 0:
            return True

        # Let the price change the harder the longer the error stays on one side.
        if self._is_hopeless(outcome):
            return False
        excess = _find_excess(outcome, self.plan)
        self.last_error = outcome.error
        self.rise_power = self.rise_power + _POWER_STEP if excess > 1 else _PRICE_POWER
        self.fall_power = self.fall_power + _POWER_STEP if excess < self.slack else _PRICE_POWER
        self.price *= excess ** (self.rise_power if excess > 1 else self.fall_power)
        return True

    def kick(self) -> None:
        """Let the price fall, so that walks leave a local optimum."""
        self.price = _KICK * self.price
        self.rise_power = self.fall_power = _PRICE_POWER


def _choose_slack(plan: Plan, sparse_grid: TimeGrid | None) -> float:
    """Excess below which the price falls harder each round; 0 for never."""
    if sparse_grid is not None:
        return _SLACK
    return _SMALL_SLACK if plan.extra_rounds else 0.0


def _is_encoded(plan: Plan, turn: int) -> bool:
    """Whether the walks of a round are encoded."""
    return (
        not plan.encode_alternate_rounds or turn % 2 == 0 or turn >= plan.rounds - _ENCODED_ROUNDS
    )


def _run_concurrently(executor: Executor, aside: Callable[[], None], work: Callable[[], T]) -> T:
    """Run ``aside`` concurrently; return the result of ``work``."""
    results: list[T] = []
    for _ in executor.map(_call, [aside, lambda: results.append(work())]):
        pass
    return results[0]


def _call(step: Callable[[], None]) -> None:
    step()


def _restore_slots(
    time_grid: TimeGrid,
    sparse_grid: TimeGrid,
    current_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
) -> tuple[NDArray[np.int64], TimeGrid]:
    """Transfer the knots to a grid with all slots that are close to them."""
    transferred = transfer_knots(slot_nodes, current_grid, time_grid)
    near = mask_near_knots(sparse_grid, time_grid, np.flatnonzero(transferred >= 0), _NEAR_SLOTS)
    return transferred[near], select_slots(time_grid, near)


def _place_and_merge(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    plan: Plan,
    prices: Prices,
    prior: Prior | None,
) -> tuple[NDArray[np.int64], NDArray[np.float64], _Layout, Segments]:
    """Place all nodes, merge some, and round their positions.

    Returns
    -------
    slot_nodes, positions
        Knots and nodes after the merge.
    layout : _Layout
        The same with whole positions.
    segments : Segments
        The segments between the knots.
    """
    fixed = 0 if prior is None else prior.nodes
    segments = list_segments(time_grid, slot_nodes, len(positions))
    slot_nodes, segments, positions = merge_nodes(
        slot_nodes, segments, place_nodes(segments, positions, fixed), plan, prices, fixed
    )
    rounded = place_on_grid(segments, positions, fixed)
    return slot_nodes, positions, _Layout(time_grid, slot_nodes, rounded), segments


def _enforce_max_error(
    layout: _Layout,
    tracks: int,
    plan: Plan,
    prices: Prices,
    prior: Prior | None,
    executor: Executor | None,
) -> Outcome:
    """Assign the knots again at whole positions, along segments that keep the maximum."""
    # Measure at whole positions, to which new nodes are rounded, too: rounding after the
    # assignment could break the maximum.
    time_grid, slot_nodes, positions = layout.time_grid, layout.slot_nodes, layout.positions
    rounded_grid = replace(time_grid, positions=np.rint(time_grid.positions))
    best, _, _ = measure_and_encode(time_grid, slot_nodes, positions, tracks, plan, prior)

    # Where the maximum is kept, squared error costs nothing.
    beam = np.inf if plan.limits_all else plan.beam
    prices = prices._replace(error=0.0, beam=beam)
    maximum = plan.maximum or 0.0
    is_limited = np.ones(len(time_grid.times), np.bool_)
    if not plan.limits_all:
        is_limited = _find_extreme_samples(time_grid)
    for turn in range(plan.max_error_rounds):
        slot_nodes, positions = assign_knots(
            select_samples(rounded_grid, is_limited),
            slot_nodes,
            positions,
            plan,
            prices,
            turn,
            maximum=maximum,
            prior=prior,
            executor=executor,
        )
        outcome, bit_statistics, errors = measure_and_encode(
            time_grid, slot_nodes, positions, tracks, plan, prior
        )
        prices = estimate_prices(bit_statistics, 0.0, len(outcome.walks.nodes), beam)
        best = outcome if outcome.cost < best.cost else best

        # Samples that miss the maximum are limited from the next round on.
        is_limited |= errors > maximum
    return best


def _find_extreme_samples(time_grid: TimeGrid) -> NDArray[np.bool_]:
    """Mark the samples that lie farthest out between each two slots."""
    is_extreme = np.zeros(len(time_grid.times), np.bool_)
    directions, _ = build_directions(time_grid.positions.shape[1], _EXTREME_DIRECTIONS)
    mark_extreme_samples(
        time_grid.times,
        time_grid.sample_positions,
        time_grid.ends,
        directions,
        _FEW_SAMPLES,
        is_extreme,
    )
    return is_extreme


def _is_better(outcome: Outcome, best: Outcome | None, plan: Plan, samples: int) -> bool:
    """Whether an outcome is smaller; misses of a maximum count for some bytes.

    An outcome that misses the target, or is beyond the tolerance, is never better.
    """
    if plan.maximum is None and outcome.error > plan.tolerance * plan.target:
        return False
    if plan.maximum is None and plan.tolerance > 1:
        # Costs hardly tell where the target is far; within some percent of it, they do.
        return best is None or _rank(outcome, plan, samples) < _rank(best, plan, samples)
    return (
        best is None
        or outcome.size + _BYTES_PER_MISS * outcome.misses
        < best.size + _BYTES_PER_MISS * best.misses
    )


def _rank(outcome: Outcome, plan: Plan, samples: int) -> tuple[float, float]:
    """Distance to the target beyond what is near enough, and cost at the target."""
    distance = abs(outcome.error / plan.target - 1)
    return max(distance - _NEAR, 0.0), outcome.cost_at(plan.target, samples)


def _find_excess(outcome: Outcome, plan: Plan) -> float:
    """Ratio of an outcome's error, or of its misses, to those aimed at; above 1, prices rise."""
    if plan.maximum is None:
        return outcome.error / (_AIM * plan.target)
    segments = sum(len(walk.gaps) for walk in outcome.walks.walks)
    return float(((outcome.misses + 1) / (_MAX_MISSES * segments + 1)) ** _MISS_POWER)


def _reweigh(
    weights: NDArray[np.float64], errors: NDArray[np.float64], maximum: float
) -> NDArray[np.float64]:
    """Weights of the samples: those near or beyond the maximum gain, the others lose.

    They are the multipliers of the constraints, by dual ascent.
    """
    factors = np.clip((errors / (_PULL_SHARE * maximum)) ** 2, _MIN_REWEIGHT, _MAX_REWEIGHT)
    return np.asarray(np.clip(weights * factors, 1.0, _MAX_WEIGHT))


def _start_from_private_chains(
    time_grid: TimeGrid, plan: Plan, executor: Executor | None
) -> tuple[NDArray[np.int64], NDArray[np.float64], float, float]:
    """Give every piece the cheapest chain by itself, at a price that meets the target.

    Returns
    -------
    slot_nodes : int64 array, shape (S,)
        Each knot has a node of its own; -1 where there is no knot.
    positions : float64 array, shape (V, d)
        The nodes, in grid steps.
    price : float
        Bits for a squared error.
    error : float
        Root mean square error in grid steps.
    """
    # At the first price, a squared error at the target costs a set number of bits per slot.
    price = _BITS_PER_SLOT * len(time_grid.time_steps) / (time_grid.samples * plan.target**2)
    slot_nodes = np.full(len(time_grid.time_steps), -1, np.int64)

    # Batches end between pieces, since only last slots are marked as knots.
    batches = cut_into_batches(
        time_grid, np.where(np.isin(np.arange(len(slot_nodes)), time_grid.last_slots), 0, -1), 0
    )

    # Batches write to slots of their own, so that they may run at once.
    def find_chains(batch: NDArray[np.int64]) -> None:
        find_private_chains(
            time_grid.sums,
            time_grid.ticks,
            time_grid.centers,
            time_grid.positions,
            time_grid.ticks_per_step,
            batch,
            price,
            _CHAIN_KNOT_BITS,
            plan.max_slots,
            slot_nodes,
        )

    # Find the chains anew at each price, until their error is near the target.
    for _ in range(_CHAIN_ROUNDS):
        for _ in (map if executor is None else executor.map)(find_chains, batches):
            pass

        # Number the knots, and measure their error at the best positions.
        is_knot = slot_nodes >= 0
        knots = int(is_knot.sum())
        slot_nodes[is_knot] = np.arange(knots)
        segments = list_segments(time_grid, slot_nodes, knots)
        positions = place_nodes(segments, time_grid.positions[is_knot])
        error = np.sqrt(squared_error(segments, positions) / time_grid.samples)

        # Adjust the price.
        miss = max(error, 1e-3) / (_CHAIN_AIM * plan.target)
        if 1 - _CHAIN_TOLERANCE < miss < 1 + _CHAIN_TOLERANCE:
            break
        price *= min(max(miss**_CHAIN_POWER, 0.02), 50.0)
    return slot_nodes, positions, price, float(error)


def _start_cold(
    time_grid: TimeGrid, plan: Plan, prior: Prior | None, executor: Executor | None
) -> Start | None:
    """Start from private chains, with near knots clustered, and guesses of the prices.

    None where no price brings these near the target: the steps of the grid are too coarse for it.
    """
    slot_nodes, positions, price, error = _start_from_private_chains(time_grid, plan, executor)
    if error > plan.give_up_ratio * plan.target:
        return None
    slot_nodes, positions = _cluster_knots(time_grid, slot_nodes, positions, plan, prior)
    return Start(slot_nodes, positions, estimate_prices(None, price, len(positions), plan.beam))


def _cluster_knots(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    plan: Plan,
    prior: Prior | None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Let knots near each other, or near a prior node, share a node."""
    # Without a radius each knot keeps a node of its own, numbered after the prior nodes.
    prior_nodes = (
        np.zeros((0, positions.shape[1])) if prior is None else prior.walks.nodes.astype(np.float64)
    )
    is_knot = slot_nodes >= 0
    if plan.leader_radius <= 0:
        renumbered = np.where(is_knot, slot_nodes + len(prior_nodes), -1)
        return renumbered, np.concatenate([prior_nodes, positions])

    # Enter the prior nodes into an empty map.
    working_map = allocate_working_map(
        positions.shape[1],
        len(prior_nodes) + int(is_knot.sum()),
        8,
        plan.leader_radius * plan.target,
    )
    working_map.positions[: len(prior_nodes)] = prior_nodes
    working_map.counters[NODE_COUNT] = len(prior_nodes)
    index_nodes(working_map, len(prior_nodes))

    # Cluster the knots at their nodes' positions, and place the clusters.
    knot_positions = time_grid.positions.copy()
    knot_positions[is_knot] = positions[slot_nodes[is_knot]]
    cluster_by_leader(working_map, knot_positions, slot_nodes)
    nodes = working_map.positions[: int(working_map.counters[NODE_COUNT])]
    segments = list_segments(time_grid, slot_nodes, len(nodes))
    return slot_nodes, place_nodes(segments, nodes, len(prior_nodes))


def measure_and_encode(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    tracks: int,
    plan: Plan,
    prior: Prior | None = None,
) -> tuple[Outcome, NDArray[np.float64], NDArray[np.float64]]:
    """Measure walks at whole positions sample by sample, and encode them.

    Returns
    -------
    outcome : Outcome
        The walks with size and error.
    bit_statistics : float64 array
        Bits and counts by kind, of the coder.
    errors : float64 array, shape (n,)
        Distance of each sample, in grid steps.
    """
    outcome, errors = _measure(
        _Layout(time_grid, slot_nodes, positions),
        tracks,
        plan,
        prior,
        list_segments(time_grid, slot_nodes, len(positions)),
    )
    outcome, bit_statistics = _encode_outcome(outcome, prior)
    return outcome, bit_statistics, errors


def _measure(
    layout: _Layout, tracks: int, plan: Plan, prior: Prior | None, segments: Segments
) -> tuple[Outcome, NDArray[np.float64]]:
    """The walks with their error but without a size, and the distance of each sample."""
    time_grid = layout.time_grid
    errors, segment = sample_errors(time_grid, segments, layout.positions)
    misses = 0 if plan.maximum is None else len(np.unique(segment[errors > plan.maximum]))
    error = float(np.sqrt((time_grid.weights * errors**2).sum() / time_grid.samples))
    fixed = 0 if prior is None else prior.nodes
    walks = walks_of(time_grid, layout.slot_nodes, layout.positions, tracks, fixed)
    return Outcome(walks, 0, error, misses), errors


def _encode_outcome(outcome: Outcome, prior: Prior | None) -> tuple[Outcome, NDArray[np.float64]]:
    """The outcome with its size, and the coder's bit statistics."""
    data, bit_statistics = encode_with_statistics(outcome.walks, prior)
    return replace(outcome, size=len(data)), bit_statistics


def estimate_prices(
    bit_statistics: NDArray[np.float64] | None, price: float, nodes: int, beam: float = np.inf
) -> Prices:
    """Prices of the E-step in bits, from what the coder spent last.

    Parameters
    ----------
    bit_statistics : float64 array, optional
        Bits and counts by kind; without them, prices are guesses.
    price : float
        Bits for a squared error of one grid step.
    nodes : int
        Number of nodes.
    beam : float, default infinity
        Bits beyond the cheapest candidate of a slot at which others are left out.
    """
    # Before the first encoding, nothing is spent.
    spent = np.zeros((STATISTICS, 2)) if bit_statistics is None else bit_statistics

    # Guesses count for a few steps of each kind, so that rare kinds have a price, too.
    def mean_bits(kinds: list[int], guess: float) -> float:
        bits, count = spent[kinds, 0].sum(), spent[kinds, 1].sum()
        return float((bits + _GUESS_WEIGHT * guess) / (count + _GUESS_WEIGHT))

    # All steps that move share one duration price; a start costs the choice among all nodes.
    return Prices(
        error=float(price),
        duration=mean_bits([DURATION_BITS + kind for kind in (_BACK, _KNOWN, _LINK, _NEW)], 4.0),
        stay_duration=mean_bits([DURATION_BITS + _STAY], 6.0),
        new_node=mean_bits([STEP_KIND_BITS + _NEW], 1.0),
        position=mean_bits([POSITION_BITS], 9.0),
        new_edge=mean_bits([STEP_KIND_BITS + _LINK], 8.0),
        stay=mean_bits([STEP_KIND_BITS + _STAY], 4.0),
        start=float(np.log2(nodes + 2.0)),
        escape=_ESCAPE_BITS,
        beam=float(beam),
    )
