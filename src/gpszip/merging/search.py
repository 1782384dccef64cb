"""One map from the curves of several archives: lattices are tried, and walks refined together, as a tree (thesis, 2.4).

The curves are measured against what comes out at every knot of either, so that a merge tells exactly how far it moved them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.walks import encode
from gpszip.mapping.budgets import ErrorBudgets
from gpszip.mapping.initial_map import list_segments, sample_errors
from gpszip.mapping.initial_map import walks_of as drafted
from gpszip.mapping.local_search import improve_walks
from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import Outcome, fit
from gpszip.mapping.time_grid import TimeGrid
from gpszip.merging.deviation import Curve, measure_deviation, split_at_gaps, union_of_knot_times
from gpszip.merging.refine import AllowedDeviation, refine, snap_to_time_grid
from gpszip.merging.tree import (
    Branch,
    ArchiveCurves,
    build_leaf,
    build_leaves,
    concatenate_branches,
)
from gpszip.model import GridWalks, QuantisationGrid, Track, Walk
from gpszip.model.grid import STEP_SIZES, step_size
from gpszip.model.merge_report import Deviation
from gpszip.run.executor import Executor, SharedValue, reduce_tree, share_value
from gpszip.walks.error import TIME_SLACK, positions_at
from gpszip.walks.quantised import dequantise_walks, node_positions

__all__ = ["DeviationLimit", "MergedMap", "ArchiveCurves", "merge_archives"]

#: What is tried around each archive's own quanta: indices of space and time, eight to an octave.
_AROUND = ((0, 0), (0, -4), (-4, 0), (0, -8), (4, 0))
#: Where a maximum is to be kept, or nothing else has: finer ones.
_FINER = ((-8, -8), (-8, -16), (-16, -16), (-16, -24), (-24, -32), (-32, -48), (-48, -64))

#: Slots that all searches may take together, and the most of them; archives whose lattices are tried.
_BUDGET, _MOST, _LATTICES = 80_000, 4, 4

#: Bits for each knot that an error as large as is allowed counts for when lattices are ranked.
_ERROR = 2.0

#: Rounds of a whole search, of one on a large log, and of a merge within the tree.
_ROUNDS, _FEW_ROUNDS, _TREE_ROUNDS, _LARGE = 18, 10, 6, 200_000

#: The largest deviation, in root mean squares, that is aimed for where only the root mean square is limited.
_FAR = 4.0

#: The mean deviation aimed for, as a share of a maximum.
_RMS_OF_MAXIMUM = 0.5

#: Where what came out deviates more than is allowed, the next aim lies this much below what should do; this often.
_TIGHTER, _AIMS = 0.97, 4

#: Merged walks that are polished; knots that may be coded for each in all, and at once at least: in all, and for each of the walks.
_FINALISTS, _WORK, _WORK_AT_LEAST, _WORK_PER_KNOT = 2, 300_000, 60_000, 100

#: Slots up to which maps are searched anew, too; share by which walks grow when their error has to fall by a factor e.
_ANEW, _SLOPE = 4000, 1.1

#: The share of the limit that is aimed for; the factor by which its measure may differ between points and curves.
_FULL, _OTHER = 0.999, 1.6

#: How often knots are added where the maximum is missed at a knot that mending put in.
_MENDS = 6


@dataclass(frozen=True)
class DeviationLimit:
    """Metres by which curves may be moved: at any instant if ``maximum``, else in the root mean square of each archive."""

    metres: float
    maximum: bool

    def excess(self, moved: Sequence[Deviation]) -> NDArray[np.float64]:
        """What each part's curves were moved by as a multiple of what is allowed."""
        return np.array([one.maximum if self.maximum else one.rms for one in moved]) / self.metres


@dataclass(frozen=True, eq=False)
class MergedMap:
    """A map of all parts, the walks of all their tracks in the order of their starts with their names, and how far each part was moved."""

    grid: QuantisationGrid
    ids: tuple[str, ...]
    grid_walks: GridWalks
    deviations: tuple[Deviation, ...]
    size: int


@dataclass(frozen=True, eq=False)
class _Search:
    """What all searches of one merge have in common."""

    parts: tuple[ArchiveCurves, ...]
    limit: DeviationLimit

    @cached_property
    def limit_shares(self) -> NDArray[np.float64]:
        """Share of the limit of each part."""
        return np.array([part.limit_share for part in self.parts])

    def excess(self, moved: Sequence[Deviation]) -> NDArray[np.float64]:
        """What each part's curves were moved by as a multiple of what is allowed."""
        return self.limit.excess(moved) / self.limit_shares

    def allowed(self, grid: QuantisationGrid, aims: NDArray[np.float64]) -> AllowedDeviation:
        """What may be done on a lattice to aim at these shares of the limit."""
        reach = self.limit.metres / step_size(grid.space)
        if self.limit.maximum:
            return AllowedDeviation(
                _RMS_OF_MAXIMUM * reach * aims, 0.999 * reach * float(aims.min())
            )
        return AllowedDeviation(0.9995 * reach * aims, _FAR * reach)

    def finish(self, grid: QuantisationGrid, branch: Branch) -> MergedMap | None:
        """Refine walks of all parts until they keep the limit."""
        slots, groups = branch.time_grid(grid), branch.point_groups()
        aims, rounds = self.limit_shares, _ROUNDS if len(slots.time_steps) < _LARGE else _FEW_ROUNDS
        for _ in range(_AIMS):
            allowed = self.allowed(grid, aims)
            outcome = refine(
                slots,
                len(branch.curves),
                groups,
                *snap_to_time_grid(slots, branch.walks),
                allowed,
                rounds,
            )
            if outcome is None:
                return None
            found = self.mended(grid, branch, outcome)
            if found is None:
                return None
            over = np.maximum(self.excess(found.deviations), 1e-9)
            if self.holds(found):
                return found
            aims, rounds = (
                np.where(over > 1, aims * np.maximum(_TIGHTER / over, 0.5), aims),
                _FEW_ROUNDS,
            )
            branch = replace(branch, walks=outcome.walks)
        return None

    def anew(self, grid: QuantisationGrid, branch: Branch) -> MergedMap | None:
        """Walks that a search finds without those of the parts; only in the mean of all parts within the limit."""
        slots = branch.time_grid(grid)
        if self.limit.maximum or len(slots.time_steps) > _ANEW:
            return None
        plan = Plan(target=float(self.allowed(grid, self.limit_shares).rms.mean()), rounds=_ROUNDS)
        outcome = fit(slots, len(branch.curves), plan)
        return None if outcome is None else self.mended(grid, branch, outcome)

    def holds(self, found: MergedMap) -> bool:
        """Whether each part is within its limit."""
        return bool((self.excess(found.deviations) <= 1).all())

    def prospect(self, found: MergedMap) -> float:
        """Size of walks, with what it will take to bring them within the limit."""
        return found.size * (
            1 + _SLOPE * float(np.log(max(self.excess(found.deviations).max(), 1.0)))
        )

    def mended(self, grid: QuantisationGrid, branch: Branch, outcome: Outcome) -> MergedMap | None:
        """What becomes of walks of which a few parts miss the maximum, where that is limited."""
        grid_walks = outcome.walks
        for _ in range(_MENDS if self.limit.maximum else 0):
            moved = self.measure(grid, branch, grid_walks)
            if (self.excess(moved) <= 1).all():
                break
            walks = dequantise_walks(grid_walks, grid, branch.ids)
            tracks = [
                _sample_at_knots(curve, walk)
                for curve, walk in zip(branch.curves, walks, strict=True)
            ]
            mending = enforce_max_error(tracks, grid, grid_walks, 0.999 * self.limit.metres)
            if mending is None:
                return None
            grid, grid_walks = mending
        return MergedMap(
            grid,
            branch.ids,
            grid_walks,
            self.measure(grid, branch, grid_walks),
            len(encode(grid_walks)),
        )

    def improve_walks(self, found: MergedMap) -> MergedMap:
        """What becomes of walks that keep the limit by single changes; each part keeps to it by itself."""
        branch = concatenate_branches(build_leaves(self.parts, found.grid)).sorted()
        slots, groups = branch.time_grid(found.grid), branch.point_groups()
        work = max(_WORK_AT_LEAST, _WORK_PER_KNOT * sum(part.knots for part in self.parts))
        if self.limit.maximum:
            maximum = self.allowed(found.grid, self.limit_shares).maximum
            made = self.polished(
                found, branch, partial(improve_walks, slots, maximum=maximum, work=work)
            )
            return found if made is None else self.better(made, found)
        last, best = found, found
        for _ in range(_WORK // work):
            budgets = ErrorBudgets(
                groups, _FULL * self.limit_shares / self.measures(slots, groups, last)
            )
            made = self.polished(
                last, branch, partial(improve_walks, slots, budgets=budgets, work=work)
            )
            if made is None:
                break
            last, best = made, self.better(made, best)
        return best

    def measures(
        self, slots: TimeGrid, groups: NDArray[np.int64], last: MergedMap
    ) -> NDArray[np.float64]:
        """What each part moves by, as a share of the limit, where its points move by a quantum: as they do in the last walks."""
        slot_nodes, positions = snap_to_time_grid(slots, last.grid_walks)
        errors, _ = sample_errors(
            slots, list_segments(slots, slot_nodes, len(positions)), positions
        )
        mean = np.sqrt(
            np.bincount(groups, weights=slots.weights * errors**2)
            / np.bincount(groups, weights=slots.weights)
        )
        usual = step_size(last.grid.space) / self.limit.metres
        found: NDArray[np.float64] = np.clip(
            self.limit.excess(last.deviations) / np.maximum(mean, 1e-9),
            usual / _OTHER,
            usual * _OTHER,
        )
        return found

    def better(self, made: MergedMap, best: MergedMap) -> MergedMap:
        """The smaller one of those that keep the limit."""
        return (
            made if self.holds(made) and not (self.holds(best) and best.size <= made.size) else best
        )

    def polished(
        self, last: MergedMap, branch: Branch, step: Callable[[Outcome], Outcome]
    ) -> MergedMap | None:
        """What a step makes of walks; None if that is nothing new."""
        start = Outcome(last.grid_walks, last.size, 0.0)
        outcome = step(start)
        return None if outcome is start else self.mended(last.grid, branch, outcome)

    def measure(
        self, grid: QuantisationGrid, branch: Branch, grid_walks: GridWalks
    ) -> tuple[Deviation, ...]:
        """How far each part's curves were moved."""
        walks, nodes = (
            dequantise_walks(grid_walks, grid, branch.ids),
            node_positions(grid_walks, grid),
        )
        found = []
        for part in range(len(self.parts)):
            own = [i for i, group in enumerate(branch.groups) if group == part]
            found.append(
                measure_deviation(
                    [branch.curves[i] for i in own],
                    [walks[i] for i in own],
                    nodes,
                    self.parts[part].at_knots,
                )
            )
        return tuple(found)


def merge_archives(
    parts: Sequence[ArchiveCurves],
    limit: DeviationLimit,
    *,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> MergedMap | None:
    """Find one map and walks on it for the curves of all parts.

    Lattices of the parts, and finer and coarser ones about them, are ranked by what rounding to them costs; on the best few of
    them, walks are refined together. Of more than two parts, neighbours are merged first, as the leaves of a tree.

    Parameters
    ----------
    parts : sequence of ArchiveCurves
        At least one; all on one plane.
    limit : Limit
        How far curves may be moved.
    executor : Executor, optional
        Where searches and branches run; the result does not depend on it.
    progress : callable, optional
        Told how many searches are done, and of how many.

    Returns
    -------
    Merged or None
        The smallest that was found; None if none kept the limit.
    """
    search = _Search(tuple(parts), limit)
    with share_value(executor, search) as shared:
        ranked = _rank_grids(_list_grids(parts, _AROUND), shared)
        finer = [grid for grid in _list_grids(parts[:1], _FINER) if grid not in ranked]
        for frames in (ranked, *([grid] for grid in finer)):
            starts = [(grid, _merge_as_tree(search, grid, executor)) for grid in frames]
            found: list[MergedMap] = []
            for done, merged in enumerate(shared.map(_finish, starts), 1):
                found += merged
                if progress is not None:
                    progress(done, len(frames))
            finalists = sorted(found, key=search.prospect)[:_FINALISTS]
            # of finalists that don't hold yet, polishing may mend none
            held = [
                merged
                for merged in (*shared.map(_Search.improve_walks, finalists), *found)
                if search.holds(merged)
            ]
            if held:
                return min(held, key=lambda merged: merged.size)
    return None


def _finish(search: _Search, start: tuple[QuantisationGrid, Branch | None]) -> list[MergedMap]:
    grid, branch = start
    branch = (
        concatenate_branches(build_leaves(search.parts, grid)) if branch is None else branch
    ).sorted()
    found = search.finish(grid, branch), search.anew(grid, branch)
    return [merged for merged in found if merged is not None]


def _merge_as_tree(
    search: _Search, grid: QuantisationGrid, executor: Executor | None
) -> Branch | None:
    """Merge neighbours, then neighbours of what came out, until all is one; of two parts, nothing yet."""
    if len(search.parts) <= 2:
        return None
    unite = partial(_merge_pair, grid, search.allowed(grid, np.ones(1)))
    branch: Branch = reduce_tree(executor, unite, enumerate(search.parts), partial(_leaf_on, grid))
    return branch


def _leaf_on(grid: QuantisationGrid, numbered: tuple[int, ArchiveCurves]) -> Branch:
    number, part = numbered
    return build_leaf(part, grid, number)


def _merge_pair(
    grid: QuantisationGrid, allowed: AllowedDeviation, one: Branch, other: Branch
) -> Branch:
    both = concatenate_branches([one, other])
    slots = both.time_grid(grid)
    alike = np.zeros(len(slots.times), np.int64)
    outcome = refine(
        slots, len(both.curves), alike, *snap_to_time_grid(slots, both.walks), allowed, _TREE_ROUNDS
    )
    return both if outcome is None else replace(both, walks=outcome.walks)


def _list_grids(
    parts: Sequence[ArchiveCurves], around: Sequence[tuple[int, int]]
) -> list[QuantisationGrid]:
    """Lattices to try: those of the largest parts, with quanta about their own."""
    own = sorted(parts, key=lambda part: -part.knots)[:_LATTICES]
    plane = [
        replace(part.grid, space=part.grid.space + s, time=part.grid.time + t)
        for part in own
        for s, t in around
    ]
    return list(
        dict.fromkeys(
            grid for grid in plane if 0 <= grid.space < STEP_SIZES and 0 <= grid.time < STEP_SIZES
        )
    )


def _rank_grids(
    frames: Sequence[QuantisationGrid], shared: SharedValue[_Search]
) -> list[QuantisationGrid]:
    """The lattices that promise most, as many as there is time for, without those that lose a gap."""
    costs = list(shared.map(_cost, frames))
    order = sorted(
        (number for number, (cost, _) in enumerate(costs) if cost < np.inf),
        key=lambda number: costs[number][0],
    )
    if not order:
        return []
    slots = costs[order[0]][1]
    return [frames[number] for number in order[: min(max(_BUDGET // slots, 1), _MOST)]]


def _cost(search: _Search, grid: QuantisationGrid) -> tuple[float, int]:
    """Bits of the walks rounded to a lattice, with what their error will take to mend; and how many slots there are."""
    branch = concatenate_branches(build_leaves(search.parts, grid))
    slots = branch.time_grid(grid)
    if len(slots.first_slots) < sum(1 + _count_gaps(curve) for curve in branch.curves):
        return np.inf, len(slots.time_steps)
    slot_nodes, positions = snap_to_time_grid(slots, branch.walks)
    size = len(encode(drafted(slots, slot_nodes, positions, len(branch.curves))))
    errors, _ = sample_errors(slots, list_segments(slots, slot_nodes, len(positions)), positions)
    square = (
        float(np.average(errors**2, weights=slots.weights))
        / float(search.allowed(grid, np.ones(1)).rms[0]) ** 2
    )
    return 8 * size + _ERROR * sum(part.knots for part in search.parts) * square, len(
        slots.time_steps
    )


def _count_gaps(curve: Curve) -> int:
    return int((np.diff(curve.track.times)[curve.gaps] > TIME_SLACK).sum())


def _sample_at_knots(curve: Curve, walk: Walk) -> Track:
    """The curve's points at its own knots and at those of a walk."""
    own = curve.walk
    times = np.concatenate(
        [
            union_of_knot_times(curve.track.times[first:after], walk)
            for first, after in split_at_gaps(curve.gaps)
        ]
    )
    return Track(curve.track.id, times, positions_at(own, curve.track.positions, times))
