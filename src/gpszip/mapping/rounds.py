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

from gpszip.codec.kernels.walk_model import DURATION_BITS, POSITION_BITS, STATISTICS, STEP_KIND_BITS
from gpszip.codec.prior import Prior
from gpszip.codec.walks import encode_with_statistics
from gpszip.mapping.assignment import assign_knots, cut_into_batches
from gpszip.mapping.initial_map import (
    Segments,
    allocate_working_map,
    list_segments,
    sample_errors,
    squared_error,
    walks_of,
)
from gpszip.mapping.kernels.initial_map import cluster_by_leader, index_nodes
from gpszip.mapping.kernels.private_chain import find_private_chains
from gpszip.mapping.placement import merge_nodes, place_nodes, place_on_grid
from gpszip.mapping.plan import Plan
from gpszip.mapping.time_grid import (
    TimeGrid,
    mask_near_knots,
    reweight_samples,
    select_slots,
    transfer_knots,
)
from gpszip.model import GridWalks
from gpszip.run.executor import Executor, local_executor

__all__ = ["Outcome", "estimate_prices", "fit", "measure_and_encode"]

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

    walks: GridWalks
    size: int
    error: float
    misses: int = 0

    @property
    def cost(self) -> float:
        """Bytes, with what mending the parts that still miss a maximum takes, on a finer lattice for all."""
        return self.size + _MEND * self.misses


def fit(
    time_grid: TimeGrid,
    tracks: int,
    plan: Plan,
    *,
    sparse_grid: TimeGrid | None = None,
    known: Prior | None = None,
    executor: Executor | None = None,
) -> Outcome | None:
    """Learn a map and walks of few bytes whose error is within the plan's target.

    Parameters
    ----------
    time_grid : Slots
        Where knots may lie.
    tracks : int
        Number of tracks.
    plan : Plan
        The target and how to go about it.
    sparse_grid : Slots, optional
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
    here, fixed = (
        time_grid if sparse_grid is None else sparse_grid,
        0 if known is None else known.nodes,
    )
    slot_nodes, positions, price = _start_from_private_chains(here, plan, executor)
    slot_nodes, positions = _cluster_knots(here, slot_nodes, positions, plan, known)
    tally, last = _BestOutcome(plan, known), np.inf
    slack = _SLACK if sparse_grid is not None else _NO_SLACK if plan.extra_rounds else 0.0
    push, fall, bits, weights = (
        _PUSH,
        _PUSH,
        estimate_prices(None, price, len(positions), plan.beam),
        np.ones(len(time_grid.times)),
    )
    for turn in range(plan.rounds + plan.extra_rounds):
        if turn >= plan.rounds and tally.is_full():
            break
        if sparse_grid is not None and turn >= plan.rounds - _LAST_ROUNDS:
            slot_nodes, here = _restore_slots(time_grid, sparse_grid, here, slot_nodes)
        if plan.maximum is not None:
            here = reweight_samples(here, np.rint(weights).astype(np.int64))
        anew = partial(
            assign_knots,
            here,
            slot_nodes,
            positions,
            plan,
            bits,
            turn,
            known=known,
            executor=executor,
        )
        slot_nodes, positions = (
            anew()
            if tally.waiting is None
            else _run_concurrently(local_executor(executor), tally.code, anew)
        )
        segments = list_segments(here, slot_nodes, len(positions))
        slot_nodes, segments, positions = merge_nodes(
            slot_nodes, segments, place_nodes(segments, positions, fixed), plan, bits, fixed
        )
        rounded = place_on_grid(segments, positions, fixed)
        outcome, errors = _measure(here, slot_nodes, rounded, tracks, plan, known, segments)
        if not plan.encode_alternate_rounds or turn % 2 == 0 or turn >= plan.rounds - _CODED_ROUNDS:
            tally.add(outcome, _Layout(here, slot_nodes, rounded))
        if turn == 0 or not plan.encode_alternate_rounds:
            tally.code()
        if plan.maximum is not None:
            weights = _reweigh(weights, errors, plan.maximum)
        if turn >= 1:
            over = _excess(outcome, plan)
            if over > plan.give_up_ratio and outcome.error > _STUCK * last:
                return None
            last = outcome.error
            # a map that lags behind its price is pushed harder each round
            push = push + 1.5 if over > 1 else _PUSH
            fall = fall + 1.5 if over < slack else _PUSH
            price *= over ** (push if over > 1 else fall)
        if turn % _KICK_EVERY == _KICK_EVERY - 1 and turn + _KICK_EVERY < plan.rounds:
            price, push, fall = _KICK * price, _PUSH, _PUSH
        bits = estimate_prices(tally.bit_statistics, price, len(outcome.walks.nodes), plan.beam)
    tally.code()
    if plan.maximum is None or tally.layout is None:
        return tally.best
    return _enforce_max_error(tally.layout, tracks, plan, bits, known, executor)


@dataclass(frozen=True, eq=False)
class _Layout:
    """Knots on slots, and whole places of their nodes."""

    time_grid: TimeGrid
    slot_nodes: NDArray[np.int64]
    positions: NDArray[np.float64]


@dataclass(eq=False)
class _BestOutcome:
    """The smallest outcome so far with its layout, what the coder last paid, and an outcome that it has still to code."""

    plan: Plan
    known: Prior | None
    best: Outcome | None = None
    layout: _Layout | None = None
    bit_statistics: NDArray[np.float64] = field(default_factory=lambda: np.zeros((STATISTICS, 2)))
    waiting: tuple[Outcome, _Layout] | None = None

    def add(self, outcome: Outcome, layout: _Layout) -> None:
        """Take note of an outcome whose size nobody knows yet."""
        self.waiting = outcome, layout

    def code(self) -> None:
        """Code what waits."""
        if self.waiting is None:
            return
        (outcome, layout), self.waiting = self.waiting, None
        outcome, self.bit_statistics = _encode_outcome(outcome, self.known)
        if _is_better(outcome, self.best, self.plan):
            self.best, self.layout = outcome, layout

    def is_full(self) -> bool:
        """Whether the best outcome makes use of the error allowed."""
        enough = _FULL * self.plan.target
        if (
            self.waiting is not None
            and max(self.waiting[0].error, self.best.error if self.best else 0.0) > enough
        ):
            self.code()
        return self.best is not None and self.best.error > enough


def _run_concurrently(executor: Executor, aside: Callable[[], None], work: Callable[[], T]) -> T:
    """Return what comes of work; something else is done at the same time."""
    found: list[T] = []
    for _ in executor.map(_call, [aside, lambda: found.append(work())]):
        pass
    return found[0]


def _call(step: Callable[[], None]) -> None:
    step()


def _restore_slots(
    time_grid: TimeGrid, sparse_grid: TimeGrid, here: TimeGrid, slot_nodes: NDArray[np.int64]
) -> tuple[NDArray[np.int64], TimeGrid]:
    """Carry the knots to slots that lie closely about them."""
    whole = transfer_knots(slot_nodes, here, time_grid)
    near = mask_near_knots(sparse_grid, time_grid, np.flatnonzero(whole >= 0), _NEAR_SLOTS)
    return whole[near], select_slots(time_grid, near)


def _enforce_max_error(
    layout: _Layout,
    tracks: int,
    plan: Plan,
    bits: NDArray[np.float64],
    known: Prior | None,
    executor: Executor | None,
) -> Outcome:
    """Settle the knots once more on places that are whole already, along parts that keep the maximum."""
    time_grid, slot_nodes, positions = layout.time_grid, layout.slot_nodes, layout.positions
    whole = replace(time_grid, positions=np.rint(time_grid.positions))
    bits = np.concatenate(
        [[0.0], bits[1:]]
    )  # where the maximum is kept, squared error costs nothing
    best = measure_and_encode(time_grid, slot_nodes, positions, tracks, plan, known)[0]
    for turn in range(_HOLDING_ROUNDS):
        slot_nodes, positions = assign_knots(
            whole,
            slot_nodes,
            positions,
            plan,
            bits,
            turn,
            maximum=plan.maximum or 0.0,
            known=known,
            executor=executor,
        )
        outcome, bit_statistics, _ = measure_and_encode(
            time_grid, slot_nodes, positions, tracks, plan, known
        )
        bits = estimate_prices(bit_statistics, 0.0, len(outcome.walks.nodes))
        best = outcome if outcome.cost < best.cost else best
    return best


def _is_better(outcome: Outcome, best: Outcome | None, plan: Plan) -> bool:
    """Whether an outcome is smaller; a miss of the target is out, a part that misses the maximum costs what mending it will."""
    if plan.maximum is None and outcome.error > plan.target:
        return False
    return best is None or outcome.size + _HOLD * outcome.misses < best.size + _HOLD * best.misses


def _excess(outcome: Outcome, plan: Plan) -> float:
    """How far the walks are from what the price is to bring about; above 1 it must rise."""
    if plan.maximum is None:
        return outcome.error / (0.995 * plan.target)
    segments = sum(len(walk.gaps) for walk in outcome.walks.walks)
    return float(((outcome.misses + 1) / (_MISSES * segments + 1)) ** _GENTLY)


def _reweigh(
    weights: NDArray[np.float64], errors: NDArray[np.float64], maximum: float
) -> NDArray[np.float64]:
    """Let samples near or beyond the maximum pull harder and the others less: multipliers of the constraints, by dual ascent."""
    return np.asarray(
        np.clip(weights * np.clip((errors / (_PULL * maximum)) ** 2, 0.5, 4.0), 1.0, _HEAVIEST)
    )


def _start_from_private_chains(
    time_grid: TimeGrid, plan: Plan, executor: Executor | None
) -> tuple[NDArray[np.int64], NDArray[np.float64], float]:
    """Give every piece the cheapest chain of its own, at a price that meets the target."""
    price = 0.3 * len(time_grid.time_steps) / (time_grid.samples * plan.target**2)
    slot_nodes = np.full(len(time_grid.time_steps), -1, np.int64)
    batches = cut_into_batches(
        time_grid, np.where(np.isin(np.arange(len(slot_nodes)), time_grid.last_slots), 0, -1), 0
    )

    def chain(batch: NDArray[np.int64]) -> None:
        find_private_chains(
            time_grid.sums,
            time_grid.ticks,
            time_grid.centers,
            time_grid.positions,
            time_grid.ticks_per_step,
            batch,
            price,
            7.0,
            plan.max_slots,
            slot_nodes,
        )

    for _ in range(4):
        for _ in (map if executor is None else executor.map)(chain, batches):
            pass
        slot_nodes[slot_nodes >= 0] = np.arange((slot_nodes >= 0).sum())
        segments = list_segments(time_grid, slot_nodes, int((slot_nodes >= 0).sum()))
        positions = place_nodes(segments, time_grid.positions[slot_nodes >= 0])
        error = np.sqrt(squared_error(segments, positions) / time_grid.samples)
        miss = max(error, 1e-3) / (0.93 * plan.target)
        if 0.95 < miss < 1.05:
            break
        price *= min(max(miss**1.6, 0.02), 50.0)
    return slot_nodes, positions, price


def _cluster_knots(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    plan: Plan,
    known: Prior | None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Let knots that are near each other, or a known node, share a node."""
    there = (
        np.zeros((0, positions.shape[1])) if known is None else known.walks.nodes.astype(np.float64)
    )
    if plan.leader_radius <= 0:
        return np.where(slot_nodes >= 0, slot_nodes + len(there), -1), np.concatenate(
            [there, positions]
        )
    knots = int((slot_nodes >= 0).sum())
    working_map = allocate_working_map(
        positions.shape[1], len(there) + knots, 8, plan.leader_radius * plan.target
    )
    working_map.positions[: len(there)] = there
    working_map.scalars[0] = len(there)
    index_nodes(working_map, len(there))
    spots = time_grid.positions.copy()
    spots[slot_nodes >= 0] = positions[slot_nodes[slot_nodes >= 0]]
    cluster_by_leader(working_map, spots, slot_nodes)
    nodes = working_map.positions[: int(working_map.scalars[0])]
    return slot_nodes, place_nodes(
        list_segments(time_grid, slot_nodes, len(nodes)), nodes, len(there)
    )


def measure_and_encode(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    tracks: int,
    plan: Plan,
    known: Prior | None = None,
) -> tuple[Outcome, NDArray[np.float64], NDArray[np.float64]]:
    """Measure the walks at whole places, sample by sample, and code them: outcome, ledger and distances."""
    outcome, errors = _measure(
        time_grid,
        slot_nodes,
        positions,
        tracks,
        plan,
        known,
        list_segments(time_grid, slot_nodes, len(positions)),
    )
    outcome, bit_statistics = _encode_outcome(outcome, known)
    return outcome, bit_statistics, errors


def _measure(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    tracks: int,
    plan: Plan,
    known: Prior | None,
    segments: Segments,
) -> tuple[Outcome, NDArray[np.float64]]:
    """The walks with their error but without a size, and the distance of each sample."""
    errors, part = sample_errors(time_grid, segments, positions)
    misses = 0 if plan.maximum is None else len(np.unique(part[errors > plan.maximum]))
    walks = walks_of(time_grid, slot_nodes, positions, tracks, 0 if known is None else known.nodes)
    return Outcome(
        walks, 0, float(np.sqrt((time_grid.weights * errors**2).sum() / time_grid.samples)), misses
    ), errors


def _encode_outcome(outcome: Outcome, known: Prior | None) -> tuple[Outcome, NDArray[np.float64]]:
    """The outcome with its size, and what the bits were spent on."""
    data, bit_statistics = encode_with_statistics(outcome.walks, known)
    return replace(outcome, size=len(data)), bit_statistics


def estimate_prices(
    bit_statistics: NDArray[np.float64] | None, price: float, nodes: int, beam: float = np.inf
) -> NDArray[np.float64]:
    """Prices of the E-step in bits, from what the coder last paid."""
    spent = np.zeros((STATISTICS, 2)) if bit_statistics is None else bit_statistics

    def mean(rows: list[int], guess: float) -> float:
        return float((spent[rows, 0].sum() + 4 * guess) / (spent[rows, 1].sum() + 4))

    moving = [DURATION_BITS + kind for kind in (_BACK, _KNOWN, _LINK, _NEW)]
    return np.array(
        [
            price,
            mean(moving, 4.0),
            mean([DURATION_BITS + _STAY], 6.0),
            mean([STEP_KIND_BITS + _NEW], 1.0),
            mean([POSITION_BITS], 9.0),
            mean([STEP_KIND_BITS + _LINK], 8.0),
            mean([STEP_KIND_BITS + _STAY], 4.0),
            np.log2(nodes + 2.0),
            0.2,
            beam,
        ]
    )
