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

from gpszip.codec.kernels.range_coder import new_encoder
from gpszip.codec.kernels.walk_coder import code_walks
from gpszip.codec.kernels.walk_model import WalkModel, new_model
from gpszip.codec.prior import Prior
from gpszip.codec.walks import encode
from gpszip.mapping.budgets import ErrorBudgets
from gpszip.mapping.initial_map import list_segments, sample_errors, walks_of
from gpszip.mapping.kernels.function_pointer import pointer_to
from gpszip.mapping.kernels.local_search import (
    AcceptanceRule,
    KernelPointers,
    accept_or_undo,
    sweep_knots,
)
from gpszip.mapping.kernels.local_search_bits import WORK, CoderWorkspace, encode_all, encode_window
from gpszip.mapping.kernels.local_search_moves import MAX_MOVES, CandidateMoves, PriorEdges
from gpszip.mapping.kernels.local_search_nodes import sweep_nodes
from gpszip.mapping.kernels.local_search_state import (
    BITS,
    KNOTS,
    SQUARE,
    TEMPORARY,
    GridSamples,
    KnotList,
    copy_knot_list,
    remeasure,
)
from gpszip.mapping.rounds import Outcome
from gpszip.mapping.time_grid import TimeGrid, reweight_samples
from gpszip.model import GridWalks

__all__ = ["WORK_BY_EFFORT", "improve_walks", "is_worthwhile", "select_best_outcomes"]

#: Knots that may be coded for one outcome, at each effort; a million take about 6 s.
WORK_BY_EFFORT = (0, 40_000, 80_000, 150_000, 300_000, 600_000, 1_200_000, 2_500_000, 5_000_000)

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
_MAX_EXTRA_BITS = (4.0, 8.0, 14.0)

#: Offers coded in full for one knot, and bits of a window below which they are.
_TRIALS, _MIN_SAVING = 4.0, 0.0

#: Bits of error that uniting two nodes may cost, or moving one, and be coded.
_UNITE, _MOVE = 24.0, 2.5

#: The bound that is aimed at, as a share of that allowed, since the sums count in whole ticks.
_AIM = 0.9999

#: Weight of the samples of the dearest group; the others have less, but at least 1.
_WEIGHTS = 16


@dataclass(frozen=True, eq=False)
class _SearchState:
    """Walks in work: as they are, as they were before a change, and the smallest within the bound so far."""

    samples: GridSamples
    knot_list: KnotList
    backup: KnotList
    best: KnotList
    workspace: CoderWorkspace
    moves: CandidateMoves
    prior_edges: PriorEdges
    pointers: KernelPointers
    slots: TimeGrid

    def turn(self, rule: AcceptanceRule, hope: float) -> None:
        """Go once over all knots and all nodes."""
        self.moves.terms[0] = hope
        sweep_knots(
            self.pointers,
            self.workspace,
            self.samples,
            self.prior_edges,
            self.knot_list,
            self.backup,
            self.best,
            self.moves,
            rule,
        )
        sweep_nodes(
            self.pointers,
            self.workspace,
            self.samples,
            self.knot_list,
            self.backup,
            self.best,
            rule,
        )

    def weigh(self, weights: NDArray[np.int64]) -> None:
        """Give the samples other weights."""
        np.copyto(self.samples.sums, reweight_samples(self.slots, weights).sums)
        self.remeasure()

    def remeasure(self) -> None:
        """Measure all parts anew."""
        remeasure(self.samples, self.knot_list, 0, int(self.knot_list.counts[KNOTS]))


@dataclass(eq=False)
class _PriceControl:
    """What bounds the error and the price of it, which follows the error.

    With shares, each group has a price of its own: its samples weigh as much.
    """

    state: _SearchState
    bounds: NDArray[np.float64]
    prices: NDArray[np.float64]
    maximum: float
    budgets: ErrorBudgets | None
    weights: NDArray[np.float64]

    @property
    def bound(self) -> float:
        """Largest squared error, as its groups weigh now."""
        return float((self.weights * self.bounds).sum())

    def rule(self, swing: float, over: float) -> AcceptanceRule:
        """What decides now, at a price so many times what it is."""
        price = swing * float(self.prices.max()) / float(self.weights.max())
        bounds = np.full(1, np.inf) if self.budgets is None else self.weights * self.bounds
        return AcceptanceRule(
            price, over * self.bound, self.bound, self.maximum, _UNITE, _MOVE, bounds, over
        )

    def follow(self) -> None:
        """Let the price follow the error."""
        if self.maximum > 0:
            return
        excess = self.state.knot_list.squares / (0.995 * self.weights * self.bounds)
        self.prices = self.prices * excess.clip(_LEAST_EXCESS, _MOST_EXCESS) ** _PUSH
        self.weigh()

    def weigh(self) -> None:
        """Let the samples of each group weigh what their error is worth."""
        if self.budgets is not None:
            self.weights = np.rint(_WEIGHTS * self.prices / self.prices.max()).clip(1)
            self.state.weigh(self.weights.astype(np.int64)[self.budgets.groups])


def select_best_outcomes(found: Iterable[Outcome], effort: int) -> list[Outcome]:
    """The outcomes that are worth polishing, the smallest first, of equal ones one; at least the smallest of any."""
    distinct: dict[tuple[int, float], Outcome] = {}
    for outcome in sorted(found, key=lambda one: one.cost):
        distinct.setdefault((outcome.size, outcome.error), outcome)
    smallest = list(distinct.values())
    knots = sum(len(walk.nodes) for walk in smallest[0].walks.walks) if smallest else 0
    work = WORK_BY_EFFORT[effort - 1]
    if work < _WORTHWHILE * _WORK_PER_KNOT * knots:
        return smallest[:1]
    return smallest[: min(max(work // (_WORK_PER_KNOT * max(knots, 1)), _FEWEST), _MOST)]


def is_worthwhile(outcome: Outcome, work: int) -> bool:
    """Whether polishing with so much work can do anything for an outcome."""
    knots = sum(len(walk.nodes) for walk in outcome.walks.walks)
    return not outcome.misses and work >= _WORTHWHILE * _WORK_PER_KNOT * knots


def improve_walks(
    slots: TimeGrid,
    outcome: Outcome,
    *,
    target: float | None = None,
    maximum: float | None = None,
    known: Prior | None = None,
    work: int = WORK_BY_EFFORT[4],
    budgets: ErrorBudgets | None = None,
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
    budgets : Shares, optional
        Root mean square errors that groups of samples keep to, in place of the target.

    Returns
    -------
    Outcome
        Fewer bytes, or the very same outcome; where that misses its shares, the smallest found that keeps to them, if any.
    """
    walks = outcome.walks
    at = _assign_slots(slots, walks) if is_worthwhile(outcome, work) else None
    if at is None:
        return outcome
    state = _build_state(slots, at, walks, known, int((1 - _RESERVE) * work), budgets)
    price_control = _build_price_control(state, slots, at, walks, target, maximum, budgets)
    if budgets is not None and (state.knot_list.squares > price_control.bounds).any():
        state.best.totals[BITS] = np.inf
    _run_turns(state, price_control, int(_RESERVE * work))
    return _as_outcome(slots, outcome, state.best, target, maximum, known, budgets)


def _build_price_control(
    state: _SearchState,
    slots: TimeGrid,
    at: NDArray[np.int64],
    walks: GridWalks,
    target: float | None,
    maximum: float | None,
    budgets: ErrorBudgets | None,
) -> _PriceControl:
    """Bounds of the squared error by the sums that count in whole ticks, and prices to begin with."""
    bounds, knot_list = np.full(len(state.knot_list.squares), np.inf), state.knot_list
    if maximum is None or budgets is not None:
        errors = sample_errors(
            slots, list_segments(slots, at, len(walks.nodes)), walks.nodes.astype(np.float64)
        )[0]
        squares = slots.weights * errors**2
        if budgets is None:
            bounds[0] = slots.samples * (_AIM * (target or 0.0)) ** 2 - abs(
                float(squares.sum()) - float(knot_list.totals[SQUARE])
            )
        else:
            bounds = budgets.sums(slots.weights) * (_AIM * budgets.rms) ** 2 - abs(
                budgets.sums(squares) - knot_list.squares
            )
    slope = _SLOPE if maximum is None else _SLOPE_WITHIN
    price = (
        slope
        * knot_list.totals[BITS]
        / max(min(float(bounds.sum()), knot_list.totals[SQUARE]), 1e-9)
    )
    return _PriceControl(
        state, bounds, np.full(len(bounds), price), maximum or 0.0, budgets, np.ones(len(bounds))
    )


def _run_turns(state: _SearchState, price_control: _PriceControl, reserve: int) -> None:
    """All turns; the smallest walks are the bench's best ones then."""
    knot_list = state.knot_list
    price_control.weigh()
    for turn in range(_TURNS):
        state.turn(
            price_control.rule(_TO_AND_FRO[turn % len(_TO_AND_FRO)], _OVER),
            _MAX_EXTRA_BITS[min(turn, len(_MAX_EXTRA_BITS) - 1)],
        )
        if state.workspace.counts[WORK] <= 0:
            break
        price_control.follow()
    if state.best.totals[BITS] < np.inf:
        copy_knot_list(state.best, knot_list)
        state.remeasure()
    state.workspace.counts[WORK] += reserve
    for turn in range(_LAST_TURNS + _MORE_TURNS):
        bits = knot_list.totals[BITS]
        price_control.prices = _LAST_PRICE * price_control.prices
        state.turn(price_control.rule(1.0, 1.0), _MAX_EXTRA_BITS[-1])
        settled = (
            price_control.maximum > 0 or knot_list.totals[SQUARE] > _FULL**2 * price_control.bound
        )
        if turn + 1 >= _LAST_TURNS and (settled or knot_list.totals[BITS] >= bits):
            break
        if not settled:
            state.workspace.counts[WORK] = max(state.workspace.counts[WORK], reserve)


def _as_outcome(
    slots: TimeGrid,
    outcome: Outcome,
    knot_list: KnotList,
    target: float | None,
    maximum: float | None,
    known: Prior | None,
    budgets: ErrorBudgets | None,
) -> Outcome:
    """The polished walks as an outcome, measured sample by sample; the old one if they aren't smaller or miss the bound after all."""
    if knot_list.totals[BITS] == np.inf:
        return outcome
    at = np.full(len(slots.time_steps), -1, np.int64)
    knots, nodes = knot_list.counts.tolist()
    at[knot_list.slot[:knots]] = knot_list.node[:knots]
    places = knot_list.places[:nodes]
    walks = walks_of(
        slots, at, places, len(outcome.walks.walks), 0 if known is None else known.nodes
    )
    errors = sample_errors(slots, list_segments(slots, at, len(places)), places)[0]
    error, size = (
        float(np.sqrt((slots.weights * errors**2).sum() / slots.samples)),
        len(encode(walks, known)),
    )
    polished = replace(outcome, walks=walks, size=size, error=error)
    if budgets is not None:
        mean = np.sqrt(budgets.sums(slots.weights * errors**2) / budgets.sums(slots.weights))
        return polished if (mean <= budgets.rms).all() else outcome
    held = error <= (target or 0.0) if maximum is None else float(errors.max()) <= maximum
    return polished if held and size < outcome.size else outcome


def _build_state(
    slots: TimeGrid,
    at: NDArray[np.int64],
    walks: GridWalks,
    known: Prior | None,
    work: int,
    budgets: ErrorBudgets | None = None,
) -> _SearchState:
    sums = slots.sums if budgets is None else slots.sums.copy()
    samples = GridSamples(
        sums,
        slots.ticks,
        slots.centers,
        slots.ticks_per_step,
        slots.ends,
        slots.times,
        slots.sample_positions,
        slots.time_steps,
        _slot_groups(slots, budgets),
    )
    knot_list = _build_knot_list(slots, at, walks.nodes, 1 if budgets is None else len(budgets.rms))
    workspace, moves, zero = (
        _build_workspace(knot_list, walks, known, work),
        _allocate_moves(knot_list),
        np.int64(0),
    )
    code = pointer_to(
        code_walks,
        workspace.coder,
        workspace.model,
        workspace.nodes,
        workspace.time_steps,
        workspace.gaps,
        workspace.begins,
        1,
        True,
        True,
    )
    window = pointer_to(
        encode_window,
        code,
        workspace,
        knot_list,
        slots.time_steps,
        zero,
        zero,
        zero,
        zero,
        zero,
        moves.slots[0],
        moves.nodes[0],
    )
    accept = pointer_to(
        accept_or_undo,
        code,
        workspace,
        slots.time_steps,
        knot_list,
        knot_list,
        knot_list,
        AcceptanceRule(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, knot_list.squares, 0.0),
    )
    remeasure(samples, knot_list, 0, int(knot_list.counts[KNOTS]))
    knot_list.totals[BITS] = encode_all(code, workspace, knot_list, slots.time_steps)
    return _SearchState(
        samples,
        knot_list,
        _copy_knot_list(knot_list),
        _copy_knot_list(knot_list),
        workspace,
        moves,
        _prior_edges(known),
        KernelPointers(code, window, accept),
        slots,
    )


def _slot_groups(slots: TimeGrid, budgets: ErrorBudgets | None) -> NDArray[np.int64]:
    if budgets is None:
        return np.zeros(len(slots.time_steps), np.int64)
    return np.repeat(
        budgets.groups[slots.ends[slots.first_slots]], slots.last_slots - slots.first_slots + 1
    )


def _assign_slots(slots: TimeGrid, walks: GridWalks) -> NDArray[np.int64] | None:
    """Node of each slot, -1 where there is no knot; None if a knot is on no slot, or a piece does not begin and end with one."""
    at = np.full(len(slots.time_steps), -1, np.int64)
    owner = np.repeat(slots.piece_tracks, slots.last_slots - slots.first_slots + 1)
    bounds = np.searchsorted(owner, np.arange(len(walks.walks) + 1))
    for track, walk in enumerate(walks.walks):
        own = np.arange(bounds[track], bounds[track + 1])
        found = np.searchsorted(slots.time_steps[own], walk.time_steps)
        if (
            found.max(initial=0) >= len(own)
            or (slots.time_steps[own[found]] != walk.time_steps).any()
        ):
            return None
        at[own[found]] = walk.nodes
    return at if (at[slots.first_slots] >= 0).all() and (at[slots.last_slots] >= 0).all() else None


def _build_knot_list(
    slots: TimeGrid, at: NDArray[np.int64], nodes: NDArray[np.int64], groups: int
) -> KnotList:
    knots = np.flatnonzero(at >= 0)
    count = len(knots)
    piece = np.searchsorted(slots.last_slots, knots)
    room = count + count // 4 + 32
    places = np.zeros((len(nodes) + room + TEMPORARY, nodes.shape[1]))
    places[: len(nodes)] = nodes
    joined, begins = np.zeros(room, np.int8), np.zeros(room, np.int8)
    joined[1:count] = piece[1:] == piece[:-1]
    begins[:count] = np.diff(slots.piece_tracks[piece], prepend=-1) != 0
    slot, node, uses = (
        np.zeros(room, np.int64),
        np.zeros(room, np.int64),
        np.zeros(len(places), np.int64),
    )
    slot[:count], node[:count] = knots, at[knots]
    uses += np.bincount(at[knots], minlength=len(places))
    return KnotList(
        slot,
        node,
        joined,
        begins,
        np.zeros(room),
        places,
        uses,
        np.array([count, len(nodes)]),
        np.zeros(2),
        np.zeros(groups),
    )


def _copy_knot_list(knot_list: KnotList) -> KnotList:
    return KnotList._make(array.copy() for array in knot_list)


def _build_workspace(
    knot_list: KnotList, walks: GridWalks, known: Prior | None, work: int
) -> CoderWorkspace:
    room, nodes = len(knot_list.slot) + 8, len(knot_list.places)
    fixed = 0 if known is None else known.nodes
    dimension = knot_list.places.shape[1]
    model, whole = _pack_model(new_model(room, dimension) if known is None else known.model(room))
    coder = new_encoder(0)
    number = np.full(nodes, -1, np.int64)
    number[:fixed] = np.arange(fixed)
    byte = np.zeros(room, np.int8)
    gapped = any(walk.gaps.any() for walk in walks.walks)
    counts = np.array([0, 0, len(walks.walks), fixed, work])
    long = [np.zeros(room, np.int64) for _ in range(3)]
    return CoderWorkspace(
        coder, coder.words.copy(), model, whole, whole.copy(), whole.copy(), long[0], long[1], byte, byte.copy(),
        number, number.copy(), np.zeros(nodes, np.int64), long[2], counts, gapped,
    )  # fmt: skip


def _pack_model(model: WalkModel) -> tuple[WalkModel, NDArray[np.int64]]:
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


def _prior_edges(known: Prior | None) -> PriorEdges:
    if known is None:
        return PriorEdges(np.zeros(1, np.int64), np.zeros(0, np.int64))
    one, two = known.edge_traversals[0].T
    pairs = np.unique(np.stack([np.append(one, two), np.append(two, one)], axis=1), axis=0)
    return PriorEdges(np.searchsorted(pairs[:, 0], np.arange(known.nodes + 1)), pairs[:, 1].copy())


def _allocate_moves(knot_list: KnotList) -> CandidateMoves:
    row, pair = np.zeros(MAX_MOVES, np.int64), np.zeros((MAX_MOVES, 2), np.int64)
    number = np.zeros(MAX_MOVES)
    return CandidateMoves(
        row, row.copy(), row.copy(), pair, pair.copy(), number, number.copy(), np.zeros(1, np.int64),
        np.zeros(len(knot_list.places), np.int8), np.zeros(knot_list.places.shape[1]), np.array([0.0, _TRIALS, _MIN_SAVING]),
    )  # fmt: skip
