"""Local search for walks of small logs: single changes that save more bits than their error costs.

The rounds of the search move knots by prices; what a change really saves only the coder knows,
since its model adapts. Here each change that looks good is encoded, at first with the knots around
it only, then with all walks, and made if the cost of bits and error falls. The price of the error
goes up and down around the one that meets the bound, so that walks leave a local optimum.
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
    NODES,
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

#: Knots that may be encoded for one outcome, at efforts 1 to 9; a million take about 6 s.
WORK_BY_EFFORT = (0, 30_000, 60_000, 120_000, 200_000, 400_000, 1_000_000, 2_500_000, 5_000_000)

#: Knots encoded for each knot of the walks until nothing is left to improve.
_WORK_PER_KNOT = 1600
#: Least number of outcomes that are improved, at efforts 1 to 9.
_MIN_OUTCOMES = (1, 1, 1, 1, 1, 2, 2, 2, 2)
#: Largest number of outcomes that are improved.
_MAX_OUTCOMES = 8

#: A local search is worthwhile from this share of ``_WORK_PER_KNOT`` on.
_MIN_WORK_SHARE = 0.03

#: Share of their bits that walks save when the squared error grows by a factor e.
_SLOPE = 0.55
#: The same for walks within a maximum, whose mean error hardly matters.
_SLOPE_WITHIN_MAXIMUM = 0.05

#: First turns over all knots and nodes, at changing prices.
_TURNS = 10
#: Factors on the price in the first turns, one after the other.
_PRICE_SWING = (1.0, 1.6, 1 / 1.6)
#: Multiple of the bound that the error may reach in the first turns.
_OVERSHOOT = 1.05

#: Last turns, from the best walks on, at falling prices within the bound.
_LAST_TURNS = 2
#: Factor by which the price falls in each of them.
_LAST_PRICE = 0.4
#: Share of the work that is reserved for each of them.
_RESERVE = 0.15
#: Further last turns while the error is well below the bound and walks still get smaller.
_MORE_TURNS = 4
#: Share of the bound above which the root mean square error uses it up.
_USED_UP = 0.993

#: Power of the excess error by which the price follows it.
_PRICE_POWER = 2.5
#: Limits of the excess.
_MIN_EXCESS = 0.8
_MAX_EXCESS = 1.25
#: Share of the bound that the price targets.
_PRICE_AIM = 0.995

#: Bits that a candidate move may score above the present walks and still be encoded, in the first
#: turns and from the third one on.
_MAX_EXTRA_BITS = (4.0, 8.0, 14.0)

#: Bits of error that a merge of two nodes may cost and still be encoded.
_MERGE_BITS = 24.0
#: Bits of error that a shift of a node may cost and still be encoded.
_SHIFT_BITS = 2.5

#: Share of the allowed error that is aimed at, since the sums count in whole ticks.
_AIM = 0.9999

#: Weight of the samples of the group with the highest price; others have less, but at least 1.
_MAX_WEIGHT = 16

#: Spare capacity of a knot list, beside a quarter of its knots.
_SPARE_KNOTS = 32
#: Spare capacity of the coder's workspace.
_SPARE_CODER_KNOTS = 8


@dataclass(frozen=True, eq=False)
class _SearchState:
    """State of a local search.

    Parameters
    ----------
    samples : GridSamples
        Slots and samples.
    knot_list, backup, best : KnotList
        The walks, a copy to undo a change from, and the smallest walks within the bound.
    workspace : CoderWorkspace
        The coder.
    moves : CandidateMoves
        Scratch space for candidate moves.
    prior_edges : PriorEdges
        Edges of prior walks.
    pointers : KernelPointers
        Kernels that other kernels call.
    time_grid : TimeGrid
        The slots.
    """

    samples: GridSamples
    knot_list: KnotList
    backup: KnotList
    best: KnotList
    workspace: CoderWorkspace
    moves: CandidateMoves
    prior_edges: PriorEdges
    pointers: KernelPointers
    time_grid: TimeGrid

    def run_turn(self, rule: AcceptanceRule, max_extra_bits: float) -> None:
        """Go once over all knots and all nodes."""
        # Shift, relabel, remove, merge and insert knots.
        sweep_knots(
            self.pointers,
            self.workspace,
            self.samples,
            self.prior_edges,
            self.knot_list,
            self.backup,
            self.best,
            self.moves._replace(max_extra_bits=max_extra_bits),
            rule,
        )

        # Merge and shift nodes.
        sweep_nodes(
            self.pointers,
            self.workspace,
            self.samples,
            self.knot_list,
            self.backup,
            self.best,
            rule,
        )

    def set_weights(self, weights: NDArray[np.int64]) -> None:
        """Give the samples other weights."""
        np.copyto(self.samples.sums, reweight_samples(self.time_grid, weights).sums)
        self.remeasure()

    def remeasure(self) -> None:
        """Measure all segments again."""
        remeasure(self.samples, self.knot_list, 0, int(self.knot_list.counts[KNOTS]))


@dataclass(eq=False)
class _PriceControl:
    """Bounds of the error and its price, which follows the error.

    With budgets, each group has a price of its own: its samples have a weight in proportion to it.

    Parameters
    ----------
    state : _SearchState
        The search.
    bounds : float64 array, shape (G,)
        Largest squared error of each group, in squared grid steps.
    prices : float64 array, shape (G,)
        Bits for a squared error of each group.
    maximum : float
        Largest distance of a sample in grid steps, 0 for none.
    budgets : ErrorBudgets, optional
        The groups.
    weights : float64 array, shape (G,)
        Weight of the samples of each group.
    """

    state: _SearchState
    bounds: NDArray[np.float64]
    prices: NDArray[np.float64]
    maximum: float
    budgets: ErrorBudgets | None
    weights: NDArray[np.float64]

    @property
    def bound(self) -> float:
        """Largest squared error by the present weights of the groups."""
        return float((self.weights * self.bounds).sum())

    def rule(self, swing: float, overshoot: float) -> AcceptanceRule:
        """Acceptance rule at a multiple of the present price."""
        unbounded = np.full(1, np.inf)
        return AcceptanceRule(
            price=swing * float(self.prices.max()) / float(self.weights.max()),
            max_square=overshoot * self.bound,
            bound=self.bound,
            maximum=self.maximum,
            merge_bits=_MERGE_BITS,
            shift_bits=_SHIFT_BITS,
            group_bounds=unbounded if self.budgets is None else self.weights * self.bounds,
            overshoot=overshoot,
        )

    def follow(self) -> None:
        """Let the prices follow the errors."""
        if self.maximum > 0:
            return
        excess = self.state.knot_list.group_squares / (_PRICE_AIM * self.weights * self.bounds)
        self.prices = self.prices * excess.clip(_MIN_EXCESS, _MAX_EXCESS) ** _PRICE_POWER
        self.set_weights()

    def set_weights(self) -> None:
        """Give the samples of each group a weight in proportion to the group's price."""
        if self.budgets is not None:
            self.weights = np.rint(_MAX_WEIGHT * self.prices / self.prices.max()).clip(1)
            self.state.set_weights(self.weights.astype(np.int64)[self.budgets.groups])


def select_best_outcomes(outcomes: Iterable[Outcome], effort: int) -> list[Outcome]:
    """The outcomes that are worth a local search, the smallest first.

    Of equal ones, one; at least the smallest of any.
    """
    distinct: dict[tuple[int, float], Outcome] = {}
    for outcome in sorted(outcomes, key=lambda outcome: outcome.cost):
        distinct.setdefault((outcome.size, outcome.error), outcome)
    smallest = list(distinct.values())

    # The more work there is for each knot, the more outcomes.
    knots = _count_knots(smallest[0]) if smallest else 0
    work = WORK_BY_EFFORT[effort - 1]
    if work < _MIN_WORK_SHARE * _WORK_PER_KNOT * knots:
        return smallest[:1]
    enough = work // (_WORK_PER_KNOT * max(knots, 1))
    count = min(max(enough, _MIN_OUTCOMES[effort - 1]), _MAX_OUTCOMES)
    return smallest[:count]


def is_worthwhile(outcome: Outcome, work: int, share: float = _MIN_WORK_SHARE) -> bool:
    """Whether a local search with this much work can improve an outcome.

    ``share`` is the least share of the work that it takes until nothing is left to improve.
    """
    knots = _count_knots(outcome)
    return not outcome.misses and work >= share * _WORK_PER_KNOT * knots


def _count_knots(outcome: Outcome) -> int:
    return sum(len(walk.nodes) for walk in outcome.walks.walks)


def improve_walks(
    time_grid: TimeGrid,
    outcome: Outcome,
    *,
    target: float | None = None,
    maximum: float | None = None,
    prior: Prior | None = None,
    work: int = WORK_BY_EFFORT[4],
    budgets: ErrorBudgets | None = None,
) -> Outcome:
    """Change walks knot by knot and node by node so that they take fewer bytes within a bound.

    Parameters
    ----------
    time_grid : TimeGrid
        All slots of the grid of the walks.
    outcome : Outcome
        The walks; no segment misses the bound.
    target : float, optional
        Largest root mean square error, in grid steps.
    maximum : float, optional
        Largest distance of any sample, in grid steps. One of the bounds must be given; the maximum
        has priority.
    prior : Prior, optional
        Walks whose map these walks use; its nodes stay where they are.
    work : int, default 200 000
        Knots that may be encoded in all.
    budgets : ErrorBudgets, optional
        Bounds on the root mean square errors of groups of samples, in place of the target.

    Returns
    -------
    Outcome
        One of fewer bytes, or the given one. If the given one misses its budgets, the smallest
        outcome found that keeps them, if any.
    """
    walks = outcome.walks
    slot_nodes = _assign_slots(time_grid, walks) if is_worthwhile(outcome, work) else None
    if slot_nodes is None:
        return outcome

    state = _build_state(time_grid, slot_nodes, walks, prior, int((1 - _RESERVE) * work), budgets)
    price_control = _build_price_control(
        state, time_grid, slot_nodes, walks, target, maximum, budgets
    )
    if budgets is not None and (state.knot_list.group_squares > price_control.bounds).any():
        state.best.totals[BITS] = np.inf

    _run_turns(state, price_control, int(_RESERVE * work))
    return _as_outcome(time_grid, outcome, state.best, target, maximum, prior, budgets)


def _build_price_control(
    state: _SearchState,
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    walks: GridWalks,
    target: float | None,
    maximum: float | None,
    budgets: ErrorBudgets | None,
) -> _PriceControl:
    """Bounds of the squared error as the sums in whole ticks have it, and first prices."""
    # Bounds are tighter by what the sums differ from the samples' own errors.
    bounds, knot_list = np.full(len(state.knot_list.group_squares), np.inf), state.knot_list
    if maximum is None or budgets is not None:
        segments = list_segments(time_grid, slot_nodes, len(walks.nodes))
        errors, _ = sample_errors(time_grid, segments, walks.nodes.astype(np.float64))
        squares = time_grid.weights * errors**2
        if budgets is None:
            bounds[0] = time_grid.samples * (_AIM * (target or 0.0)) ** 2 - abs(
                float(squares.sum()) - float(knot_list.totals[SQUARE])
            )
        else:
            bounds = budgets.sum_by_group(time_grid.weights) * (_AIM * budgets.rms) ** 2 - abs(
                budgets.sum_by_group(squares) - knot_list.group_squares
            )

    # At the optimum, the price is the slope of the bits over the squared error.
    slope = _SLOPE if maximum is None else _SLOPE_WITHIN_MAXIMUM
    price = (
        slope
        * knot_list.totals[BITS]
        / max(min(float(bounds.sum()), knot_list.totals[SQUARE]), 1e-9)
    )
    return _PriceControl(
        state=state,
        bounds=bounds,
        prices=np.full(len(bounds), price),
        maximum=maximum or 0.0,
        budgets=budgets,
        weights=np.ones(len(bounds)),
    )


def _run_turns(state: _SearchState, price_control: _PriceControl, reserve: int) -> None:
    """Run all turns; ``state.best`` then holds the smallest walks."""
    # First turns: the price swings, and the error may exceed the bound on the way.
    knot_list = state.knot_list
    price_control.set_weights()
    for turn in range(_TURNS):
        swing = _PRICE_SWING[turn % len(_PRICE_SWING)]
        state.run_turn(
            price_control.rule(swing, _OVERSHOOT),
            _MAX_EXTRA_BITS[min(turn, len(_MAX_EXTRA_BITS) - 1)],
        )
        if state.workspace.counts[WORK] <= 0:
            break
        price_control.follow()

    # Last turns: from the best walks on, within the bound.
    if state.best.totals[BITS] < np.inf:
        copy_knot_list(state.best, knot_list)
        state.remeasure()
    state.workspace.counts[WORK] += reserve
    for turn in range(_LAST_TURNS + _MORE_TURNS):
        bits = knot_list.totals[BITS]
        price_control.prices = _LAST_PRICE * price_control.prices
        state.run_turn(price_control.rule(1.0, 1.0), _MAX_EXTRA_BITS[-1])

        # More turns follow while they pay.
        is_used_up = (
            price_control.maximum > 0
            or knot_list.totals[SQUARE] > _USED_UP**2 * price_control.bound
        )
        if turn + 1 >= _LAST_TURNS and (is_used_up or knot_list.totals[BITS] >= bits):
            break
        if not is_used_up:
            state.workspace.counts[WORK] = max(state.workspace.counts[WORK], reserve)


def _as_outcome(
    time_grid: TimeGrid,
    outcome: Outcome,
    knot_list: KnotList,
    target: float | None,
    maximum: float | None,
    prior: Prior | None,
    budgets: ErrorBudgets | None,
) -> Outcome:
    """The improved walks as an outcome, measured sample by sample.

    The given outcome, if they are not smaller or miss the bound after all.
    """
    # Without any walks within the bound, the given outcome stays.
    if knot_list.totals[BITS] == np.inf:
        return outcome

    # Enter the knots on their slots.
    slot_nodes = np.full(len(time_grid.time_steps), -1, np.int64)
    knots, nodes = int(knot_list.counts[KNOTS]), int(knot_list.counts[NODES])
    slot_nodes[knot_list.slots[:knots]] = knot_list.nodes[:knots]
    positions = knot_list.positions[:nodes]
    fixed = 0 if prior is None else prior.nodes
    walks = walks_of(time_grid, slot_nodes, positions, len(outcome.walks.walks), fixed)

    # Measure and encode them.
    segments = list_segments(time_grid, slot_nodes, len(positions))
    errors, _ = sample_errors(time_grid, segments, positions)
    squares = time_grid.weights * errors**2
    error = float(np.sqrt(squares.sum() / time_grid.samples))
    size = len(encode(walks, prior))
    improved = replace(outcome, walks=walks, size=size, error=error)

    # Check the bounds.
    if budgets is not None:
        rms = np.sqrt(budgets.sum_by_group(squares) / budgets.sum_by_group(time_grid.weights))
        return improved if (rms <= budgets.rms).all() else outcome
    is_kept = error <= (target or 0.0) if maximum is None else float(errors.max()) <= maximum
    return improved if is_kept and size < outcome.size else outcome


def _build_state(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    walks: GridWalks,
    prior: Prior | None,
    work: int,
    budgets: ErrorBudgets | None = None,
) -> _SearchState:
    """Build the state of a search from walks, with their bits and errors."""
    # With budgets, the sums change with the weights.
    samples = GridSamples(
        sums=time_grid.sums if budgets is None else time_grid.sums.copy(),
        ticks=time_grid.ticks,
        centers=time_grid.centers,
        ticks_per_step=time_grid.ticks_per_step,
        ends=time_grid.ends,
        times=time_grid.times,
        sample_positions=time_grid.sample_positions,
        time_steps=time_grid.time_steps,
        groups=_slot_groups(time_grid, budgets),
    )
    knot_list = _build_knot_list(
        time_grid, slot_nodes, walks.nodes, 1 if budgets is None else len(budgets.rms)
    )
    workspace = _build_workspace(knot_list, walks, prior, work)
    moves = _allocate_moves(knot_list)
    pointers = _compile_pointers(knot_list, workspace, moves, time_grid.time_steps)

    # Measure and encode the walks.
    remeasure(samples, knot_list, 0, int(knot_list.counts[KNOTS]))
    knot_list.totals[BITS] = encode_all(pointers.code, workspace, knot_list, time_grid.time_steps)
    return _SearchState(
        samples=samples,
        knot_list=knot_list,
        backup=_copy_knot_list(knot_list),
        best=_copy_knot_list(knot_list),
        workspace=workspace,
        moves=moves,
        prior_edges=_list_prior_edges(prior),
        pointers=pointers,
        time_grid=time_grid,
    )


def _compile_pointers(
    knot_list: KnotList,
    workspace: CoderWorkspace,
    moves: CandidateMoves,
    time_steps: NDArray[np.int64],
) -> KernelPointers:
    """Pointers to the kernels that other kernels call, for arguments of these types."""
    # The coder, for walks with times and with or without gaps.
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

    # The kernels that call it.
    zero = np.int64(0)
    window = pointer_to(
        encode_window,
        code,
        workspace,
        knot_list,
        time_steps,
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
        time_steps,
        knot_list,
        knot_list,
        knot_list,
        AcceptanceRule(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, knot_list.group_squares, 0.0),
    )
    return KernelPointers(code, window, accept)


def _slot_groups(time_grid: TimeGrid, budgets: ErrorBudgets | None) -> NDArray[np.int64]:
    """Group of each slot."""
    if budgets is None:
        return np.zeros(len(time_grid.time_steps), np.int64)
    return np.repeat(
        budgets.groups[time_grid.ends[time_grid.first_slots]],
        time_grid.last_slots - time_grid.first_slots + 1,
    )


def _assign_slots(time_grid: TimeGrid, walks: GridWalks) -> NDArray[np.int64] | None:
    """Node of each slot, -1 where there is no knot.

    None if a knot is on no slot, or a piece does not begin and end with a knot.
    """
    # Find the slots of each track.
    slot_nodes = np.full(len(time_grid.time_steps), -1, np.int64)
    owner = np.repeat(time_grid.piece_tracks, time_grid.last_slots - time_grid.first_slots + 1)
    bounds = np.searchsorted(owner, np.arange(len(walks.walks) + 1))

    # Find the slot of each knot by its time step.
    for track, walk in enumerate(walks.walks):
        slots = np.arange(bounds[track], bounds[track + 1])
        index = np.searchsorted(time_grid.time_steps[slots], walk.time_steps)
        if (
            index.max(initial=0) >= len(slots)
            or (time_grid.time_steps[slots[index]] != walk.time_steps).any()
        ):
            return None
        slot_nodes[slots[index]] = walk.nodes

    # Each piece must begin and end with a knot.
    has_ends = (slot_nodes[time_grid.first_slots] >= 0).all() and (
        slot_nodes[time_grid.last_slots] >= 0
    ).all()
    return slot_nodes if has_ends else None


def _build_knot_list(
    time_grid: TimeGrid, slot_nodes: NDArray[np.int64], nodes: NDArray[np.int64], groups: int
) -> KnotList:
    """Knots of all slots, with capacity for a quarter more; errors and bits are 0 still."""
    # Leave capacity for knots that the search adds.
    knots = np.flatnonzero(slot_nodes >= 0)
    count = len(knots)
    capacity = count + count // 4 + _SPARE_KNOTS

    # Nodes, with capacity for one for each knot and the temporary ones.
    positions = np.zeros((len(nodes) + capacity + TEMPORARY, nodes.shape[1]))
    positions[: len(nodes)] = nodes
    uses = np.zeros(len(positions), np.int64)
    uses += np.bincount(slot_nodes[knots], minlength=len(positions))

    # Knots, and where pieces and tracks begin.
    piece = np.searchsorted(time_grid.last_slots, knots)
    knot_slots, knot_nodes = np.zeros(capacity, np.int64), np.zeros(capacity, np.int64)
    knot_slots[:count], knot_nodes[:count] = knots, slot_nodes[knots]
    joined, begins = np.zeros(capacity, np.int8), np.zeros(capacity, np.int8)
    joined[1:count] = piece[1:] == piece[:-1]
    begins[:count] = np.diff(time_grid.piece_tracks[piece], prepend=-1) != 0

    # Enter the counts; errors are measured later, and bits when the walks are encoded.
    counts = np.zeros(2, np.int64)
    counts[KNOTS], counts[NODES] = count, len(nodes)
    return KnotList(
        slots=knot_slots,
        nodes=knot_nodes,
        joined=joined,
        begins=begins,
        errors=np.zeros(capacity),
        positions=positions,
        uses=uses,
        counts=counts,
        totals=np.zeros(2),
        group_squares=np.zeros(groups),
    )


def _copy_knot_list(knot_list: KnotList) -> KnotList:
    return KnotList._make(array.copy() for array in knot_list)


def _build_workspace(
    knot_list: KnotList, walks: GridWalks, prior: Prior | None, work: int
) -> CoderWorkspace:
    """Coder with the model of the prior walks, and capacity for all knots."""
    # Take the model after the prior walks, or an untrained one, as words that one copy restores.
    capacity, nodes = len(knot_list.slots) + _SPARE_CODER_KNOTS, len(knot_list.positions)
    dimension = knot_list.positions.shape[1]
    model, model_words = _pack_model(
        new_model(capacity, dimension) if prior is None else prior.model(capacity)
    )
    coder = new_encoder(0)

    # The nodes of prior walks are visited already.
    fixed = 0 if prior is None else prior.nodes
    visit_numbers = np.full(nodes, -1, np.int64)
    visit_numbers[:fixed] = np.arange(fixed)
    return CoderWorkspace(
        coder=coder,
        empty_coder_words=coder.words.copy(),
        model=model,
        model_words=model_words,
        empty_model_words=model_words.copy(),
        prefix_model_words=model_words.copy(),
        nodes=np.zeros(capacity, np.int64),
        time_steps=np.zeros(capacity, np.int64),
        gaps=np.zeros(capacity, np.int8),
        begins=np.zeros(capacity, np.int8),
        visit_numbers=visit_numbers,
        saved_visit_numbers=visit_numbers.copy(),
        uses_after_window=np.zeros(nodes, np.int64),
        numbered_nodes=np.zeros(capacity, np.int64),
        counts=np.array([0, 0, len(walks.walks), fixed, work]),
        has_gaps=any(walk.gaps.any() for walk in walks.walks),
    )


def _pack_model(model: WalkModel) -> tuple[WalkModel, NDArray[np.int64]]:
    """Return the model as views of one array, so that one copy copies all of it."""
    sizes = [-(-array.nbytes // 8) for array in model]
    words = np.zeros(sum(sizes), np.int64)
    ends = np.cumsum(sizes)
    views = []
    for number, (size, end) in enumerate(zip(sizes, ends.tolist(), strict=True)):
        array = model[number]
        view = words[end - size : end].view(array.dtype)[: array.size].reshape(array.shape)
        view[...] = array
        views.append(view)
    return WalkModel._make(views), words


def _list_prior_edges(prior: Prior | None) -> PriorEdges:
    """Edges of prior walks in both directions, each once."""
    if prior is None:
        return PriorEdges(np.zeros(1, np.int64), np.zeros(0, np.int64))
    starts, ends = prior.edge_traversals[0].T
    pairs = np.unique(np.stack([np.append(starts, ends), np.append(ends, starts)], axis=1), axis=0)
    offsets = np.searchsorted(pairs[:, 0], np.arange(prior.nodes + 1))
    return PriorEdges(offsets, pairs[:, 1].copy())


def _allocate_moves(knot_list: KnotList) -> CandidateMoves:
    """Scratch space for the candidate moves of one knot."""
    nodes, dimension = knot_list.positions.shape
    return CandidateMoves(
        first=np.zeros(MAX_MOVES, np.int64),
        after=np.zeros(MAX_MOVES, np.int64),
        count=np.zeros(MAX_MOVES, np.int64),
        slots=np.zeros((MAX_MOVES, 2), np.int64),
        nodes=np.zeros((MAX_MOVES, 2), np.int64),
        errors=np.zeros(MAX_MOVES),
        scores=np.zeros(MAX_MOVES),
        counts=np.zeros(1, np.int64),
        links=np.zeros(nodes, np.int8),
        linear=np.zeros(dimension),
        max_extra_bits=_MAX_EXTRA_BITS[0],
    )
